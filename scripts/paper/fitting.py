"""How constants and starts were found with which ode45 makes nearly the energy errors that the paper prints.

A search through round numbers. Many others would do: the paper prints five errors, and a motion has twenty constants.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from paper import measures
from paper.printed import PRINTED
from spring_pendulum_env import simulate
from spring_pendulum_env.dynamics.progress import Progress

FloatArray = NDArray[np.float64]

LONGEST = 100.0
"""s; of a spin, whose duration is searched for too."""

REST_LENGTH, STIFFNESS = 3.0, 20.0
"""m and N/m of the spinning pair. Without gravity nothing else of them matters than the start's size and speed in units
of these (and of ode45's AbsTol)."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """A motion, and the errors (per cent) that ode45 makes on it."""

    misfit: float
    """Largest natural logarithm of an error over the printed one, either way."""
    parameters: Mapping[str, float]
    start: FloatArray
    duration: float
    errors: Mapping[str, float]


def misfit(errors: Mapping[str, float]) -> float:
    """How far errors are from the printed ones of the same names, as `Fit` says."""
    return max(abs(math.log(max(error, 1e-12) / PRINTED[name])) for name, error in errors.items())


def spinning(
    sizes: tuple[float, ...] = (3.0, 4.5, 6.0, 9.0), speeds: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0)
) -> Iterator[Fit]:
    """Two masses joined by a spring, at the default tolerance and at a tenth of it; durations of whole ten seconds.

    Args:
        sizes: distances of each mass from the centre at the start, m.
        speeds: of each mass, m/s.
    """
    parameters = {"k1": 0.0, "k2": STIFFNESS, "L1": REST_LENGTH, "L2": REST_LENGTH, "g": 0.0}
    pairs = list(itertools.product(sizes, speeds))
    with Progress("spinning", len(pairs)) as bar:
        for size, speed in pairs:
            start = np.array([-size, 0, 0, size, 0, 0, 0, -speed, 0, 0, speed, 0])
            loose, fine = (simulate(parameters, start, (0.0, LONGEST), "ode45", rtol) for rtol in (1e-3, 1e-4))
            for duration in np.arange(10.0, LONGEST + 1, 10.0):
                # What a shorter run would give, but for its very last step.
                ends = [int(np.searchsorted(run.times, duration, "right")) for run in (loose, fine)]
                change = np.abs(measures.per_cent(loose.energy[: ends[0]]))
                errors = {
                    "figure 3, final": float(change[-1]),
                    "figure 7, mean": abs(float(measures.per_cent(loose.energy[: ends[0]]).mean())),
                    "figure 4, final": abs(float(measures.per_cent(fine.energy[: ends[1]])[-1])),
                }
                yield Fit(misfit(errors), parameters, start, float(duration), errors)
            bar.add(1)


def chaotic(
    stiffnesses: tuple[float, ...] = (20.0, 25.0),
    places: tuple[float, ...] = (0.0, 5.0, 10.0),
    rest_length: float = 10.0,
) -> Iterator[Fit]:
    """Both springs, let go from rest on a grid, for 10 s; only those whose energy falls last in the last second.

    Args:
        stiffnesses: of each spring, N/m.
        places: coordinates of the masses, m; turned and mirrored starts are left out.
        rest_length: of both springs, m.
    """
    tries = []
    for x1, y1, z1, x2, y2, z2 in itertools.product(places, repeat=6):
        first, second = (x1, y1, z1), (x2, y2, z2)
        if any(first) and first != second and x1 <= y1:  # x and y can be exchanged
            tries += [(first, second, k1, k2) for k1, k2 in itertools.product(stiffnesses, repeat=2)]
    with Progress("chaotic", len(tries)) as bar:
        for first, second, k1, k2 in tries:
            bar.add(1)
            parameters = {"k1": k1, "k2": k2, "L1": rest_length, "L2": rest_length}
            start = np.array([*first, *second, *[0.0] * 6])
            run = simulate(parameters, start, (0.0, 10.0), "ode45")
            errors = {
                "figure 5, final": 100 * run.energy_error,
                "figure 5, mean": 100 * abs(run.mean_energy_error),
            }
            dive = measures.time_of_last_fall(run.times, run.energy)
            if run.energy[-1] < run.energy[0] and abs(dive - PRINTED["figure 6, dive"]) < 0.5:
                yield Fit(misfit(errors), parameters, start, 10.0, errors)
