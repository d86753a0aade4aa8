"""Order or chaos, for many motions side by side: MEGNO.

The mean exponential growth factor of nearby orbits, P. M. Cincotta and C. Simo, "Simple tools to study global dynamics
in non-axisymmetric galactic potentials - I", Astron. Astrophys. Suppl. Ser. 147 (2000) 205-228: of a displacement of
length d(t), carried along exactly (`flow`),

    Y(t) = 2/t * integral from 0 to t of s d'(s)/d(s) ds,    mean MEGNO(t) = 1/t * integral from 0 to t of Y(s) ds.

In a regular motion d grows in proportion to time, and the mean MEGNO tends to 2 (to 0 where d doesn't grow at all: next
to harmonic motions). In a chaotic one with the largest exponent lambda it grows as lambda t / 2. So it tells the two
apart far sooner than an exponent does, which in a regular motion falls only as ln(t) / t.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env.dynamics.checks import checked_states, whole_number
from spring_pendulum_env.dynamics.flow import Flow, energy_errors
from spring_pendulum_env.dynamics.progress import Progress
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]

REGULAR = 2.0
"""The mean MEGNO of a regular motion after a long time."""

THRESHOLD = 3.0
"""A motion whose mean MEGNO is greater is called chaotic. Regular ones stay below 2, or go a little above it for a
while where unstable ones are near; an exponent lambda is seen after a time of about 2 * THRESHOLD / lambda."""

IN_PLANE = np.array([1.0, 0.0, 1.0] * 4)
"""Which components of a state stay in the vertical plane y = 0."""


@dataclasses.dataclass(frozen=True)
class Indicators:
    """What tells order from chaos in each of n motions; every array has shape (n,).

    All are nan where a motion came so near a spring's zero length that no step was small enough.
    """

    megno: FloatArray
    """Mean MEGNO at the end: 2 in a regular motion, half the exponent times the duration in a chaotic one."""
    megno_halfway: FloatArray
    """Mean MEGNO after half the duration: whether it says the same shows how far the duration is long enough."""
    exponent: FloatArray
    """Mean rate at which the displacement grew in the second half, 1/s: an estimate of the largest Lyapunov exponent,
    of which no less than 2 ln(2) / duration can be seen."""
    energy_error: FloatArray
    """Equation (42), where nothing braked: what the integration got wrong."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where the motion could be followed to the end."""
        return np.isfinite(self.megno)

    @property
    def chaotic(self) -> NDArray[np.bool_]:
        """Where the mean MEGNO is greater than `THRESHOLD`."""
        return self.megno > THRESHOLD

    @property
    def chaotic_halfway(self) -> NDArray[np.bool_]:
        """The same after half the duration."""
        return self.megno_halfway > THRESHOLD


def mean_megno(log_growth: FloatArray) -> FloatArray:
    """The mean MEGNO at the end, from the growth of displacements, by the trapezium rule.

    By parts, Y(t) = 2 (ln d(t) - 1/t * integral from 0 to t of ln d), where d(0) = 1.

    Args:
        log_growth: ln d at equal distances in time, the first at time 0, where it is 0; shape (m, n).

    Returns:
        Shape (n,).
    """
    times = np.arange(1.0, len(log_growth))[:, None]  # in intervals
    y = 2 * (log_growth[1:] - _integrals(log_growth) / times)
    mean: FloatArray = _integrals(np.concatenate([np.zeros_like(y[:1]), y]))[-1] / times[-1]
    return mean


def _integrals(values: FloatArray) -> FloatArray:
    """Integrals up to each interval's end."""
    sums: FloatArray = np.cumsum((values[1:] + values[:-1]) / 2, axis=0)
    return sums


def chaos_indicators(
    parameters: Parameters | Mapping[str, float] | None,
    states: ArrayLike,
    duration: float = 2_000.0,
    *,
    plane: bool = False,
    interval: float = 1.0,
    longest_step: float | None = None,
    seed: int = 0,
    block: int = 256,
    file: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Indicators:
    """MEGNO and growth rate of motions of the passive pendulum without drag, side by side.

    Each motion gets the same numbers whatever others stand beside it.

    Args:
        parameters: the constants, or a mapping of some of them.
        states: where the motions start, m and m/s; shape (n, 12).
        duration: how long they are followed, s.
        plane: the motions are in the plane y = 0 and are compared with neighbours in it alone. (A planar motion may be
            regular among its like, though a push out of the plane would grow.)
        interval: after which the displacement is noted and shortened again, s (adjusted so that the duration holds an
            even number).
        longest_step: of the integration, s, as for `Flow`; None: as the environments'.
        seed: of the displacements' first direction, the same for all.
        block: motions that are followed together, after which the results are saved.
        file: an .npz that holds what is done; a second call with it goes on where the first was interrupted.
        progress: draw a progress bar.

    Raises:
        ValueError: a wrong argument, drag, or a file of other motions.
        OSError: the file can't be written; it is tried before the work begins.
    """
    starts = checked_states(states)
    flow = Flow(parameters, longest_step)
    p = flow.parameters
    if p.R1 > 0 or p.R2 > 0:
        raise ValueError(f"R1 = {p.R1}, R2 = {p.R2}: must be 0; with drag all motion ends")
    if plane and np.any(starts[:, IN_PLANE == 0] != 0):
        raise ValueError("states: must have Y1 = Y2 = VY1 = VY2 = 0 where plane is True")
    positive_number("duration", duration)
    positive_number("interval", interval)
    whole_number("seed", seed, 0)
    whole_number("block", block, 1)
    if duration < 2 * flow.longest_step:
        raise ValueError(f"duration = {duration!r}: must be at least two steps, {2 * flow.longest_step:g} s")
    half = max(1, round(duration / (2 * interval)))
    direction = np.random.default_rng(seed).standard_normal(12) * (IN_PLANE if plane else 1.0)
    direction /= np.linalg.norm(direction)

    about = {
        "parameters": p.as_dict(),
        "states": hashlib.sha256(starts.tobytes()).hexdigest(),
        "duration": duration,
        "intervals": 2 * half,
        "step": flow.longest_step,
        "plane": plane,
        "seed": seed,
    }
    store = _Store(None if file is None else Path(file), about, len(starts))
    blocks = range(0, len(starts), block)
    done = sum(len(store.missing(first, block)) == 0 for first in blocks)
    with Progress("chaos", 2 * half * len(blocks), done=2 * half * done, show=progress) as bar:
        for first in blocks:
            rows = store.missing(first, block)
            if len(rows):
                store.add(rows, _followed(flow, starts[rows], direction, duration, half, bar))
    return Indicators(*store.results)


def _followed(
    flow: Flow, starts: FloatArray, direction: FloatArray, duration: float, half: int, bar: Progress
) -> FloatArray:
    """The four indicators of motions, shape (4, n), rows of nan among them."""
    count = len(starts)
    found = np.full((4, count), np.nan)
    alive = np.arange(count)
    points = np.ascontiguousarray(np.concatenate([starts.T, np.repeat(direction[:, None], count, axis=1)]))
    log_growth = np.zeros((2 * half + 1, count))
    for number in range(2 * half):
        points, kept = _advanced(flow, points, duration / (2 * half))
        alive = alive[kept]
        grown = _lengths(points[12:])
        points[12:] /= grown
        log_growth[number + 1, alive] = log_growth[number, alive] + np.log(grown)
        bar.add(1)
    log_growth = log_growth[:, alive]
    found[0, alive] = mean_megno(log_growth)
    found[1, alive] = mean_megno(log_growth[: half + 1])
    found[2, alive] = (log_growth[-1] - log_growth[half]) / (duration / 2)
    found[3, alive] = energy_errors(flow.parameters, starts[alive], points[:12].T)
    return found


def _lengths(columns: FloatArray) -> FloatArray:
    """Lengths of columns, summed in the same order however many stand side by side, as NumPy's norm isn't."""
    squares = np.zeros(columns.shape[1])
    for row in columns:
        squares += row * row
    return np.sqrt(squares)


def _advanced(flow: Flow, points: FloatArray, duration: float) -> tuple[FloatArray, NDArray[np.intp]]:
    """Points moved on, and which of them could be: one that runs into zero length doesn't stop the others."""
    moved = points.copy()
    try:
        if points.shape[1]:
            flow.advance(moved, duration)
    except ArithmeticError:
        if points.shape[1] == 1:
            return points[:, :0].copy(), np.arange(0)
        parts = [_advanced(flow, points[:, j : j + 1].copy(), duration) for j in range(points.shape[1])]
        kept = np.flatnonzero([len(part[1]) for part in parts])
        return np.ascontiguousarray(np.concatenate([part[0] for part in parts], axis=1)), kept
    return moved, np.arange(points.shape[1])


class _Store:
    """Results by rows, kept in a file that is whole at any time, if there is one."""

    def __init__(self, path: Path | None, about: Mapping[str, Any], rows: int) -> None:
        self._path, self._about = path, json.dumps(about)
        self.results = np.full((4, rows), np.nan)
        self._done = np.zeros(rows, dtype=np.bool_)
        if path is not None and path.exists():
            self._read(path, about)
        else:
            self._save()  # so that a folder that can't be written to is found before the work

    def missing(self, first: int, block: int) -> NDArray[np.intp]:
        """Rows of a block that aren't done."""
        return first + np.flatnonzero(~self._done[first : first + block])

    def add(self, rows: NDArray[np.intp], results: FloatArray) -> None:
        """Notes the results of some rows, and saves them all."""
        self.results[:, rows] = results
        self._done[rows] = True
        self._save()

    def _save(self) -> None:
        """Writes everything to the file, if there is one, whole or not at all."""
        if self._path is None:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=self._path.parent, prefix=f".{self._path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez(file, about=np.array(self._about), results=self.results, done=self._done)
            Path(name).replace(self._path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise

    def _read(self, path: Path, about: Mapping[str, Any]) -> None:
        try:
            with np.load(path, allow_pickle=False) as archive:
                there = json.loads(str(archive["about"]))
                results, done = archive["results"], archive["done"]
        except (ValueError, KeyError, OSError, EOFError) as error:
            raise ValueError(f"file = {str(path)!r}: isn't one that chaos_indicators wrote ({error})") from None
        other = [name for name in about if there.get(name) != about[name]]
        if other:
            raise ValueError(
                f"file = {str(path)!r}: holds a run with other {', '.join(other)}; "
                "remove it, or name another file or folder"
            )
        self.results, self._done = results, done
