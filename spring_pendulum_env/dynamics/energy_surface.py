"""Starts spread evenly over a surface of constant energy: the microcanonical ensemble."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.dynamics.checks import whole_number
from spring_pendulum_env.equilibria import BODY_STATE, energy, spring_lengths, vertical_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]

TRIES = 4096
"""Points of configuration space that are tried at once."""

MOST_TRIES = 20_000
"""So many times, after which the region that can be reached is too small a part of what is searched."""


def lowest_state(parameters: Parameters | Mapping[str, float] | None) -> FloatArray:
    """The state of lowest energy, both springs hanging at rest: shape (12,).

    Raises:
        ValueError: a wrong parameter, or k1 = 0 or k2 = 0, where there is none.
    """
    state: FloatArray = vertical_state(*spring_lengths(Parameters.of(parameters), "hanging-hanging"))[BODY_STATE]
    return state


def microcanonical_starts(
    parameters: Parameters | Mapping[str, float] | None,
    excess_energy: float,
    count: int,
    *,
    plane: bool = False,
    seed: int = 0,
) -> FloatArray:
    """Random states of one energy, with the Liouville measure, delta(H - E) dq dp, which the motion keeps.

    Positions: with n degrees of freedom (6, or 4 in the plane) the momenta of kinetic energy T = E - V(q) have measure
    T^(n/2 - 1), which is the density of q. It is drawn by rejection. In the length r and the angle a from the downward
    vertical of each spring, the potential above hanging rest is a sum over springs of

        k (r - r0)^2 / 2 + W r (1 - cos a),    r0 the length at rest, W the weight that the spring carries,

    so that r and a are tried evenly over all that the energy allows to each spring alone; r^2 sin a (in the plane r)
    is the rest of the density. Velocities: a direction evenly on the sphere of sqrt(m) v.

    Args:
        parameters: the constants, or a mapping of some of them.
        excess_energy: above hanging rest, J.
        count: how many states.
        plane: in the plane y = 0.
        seed: of the random numbers.

    Returns:
        Shape (count, 12), m and m/s.

    Raises:
        ValueError: a wrong argument, or k1 = 0 or k2 = 0, where the energy has no lowest value.
    """
    p = Parameters.of(parameters)
    excess = positive_number("excess_energy", excess_energy)
    whole_number("count", count, 1)
    whole_number("seed", seed, 0)
    lowest = lowest_state(p)
    lowest_energy = float(energy(p, lowest))
    random = np.random.default_rng(seed)
    freedoms = 4 if plane else 6
    springs = [
        _Reach(abs(height), k, weight, excess, plane)
        for height, k, weight in zip(
            (lowest[2], lowest[5] - lowest[2]),
            (p.k1, p.k2),
            (physics.static_load(p.m1, p.m2, p.g), p.m2 * p.g),
            strict=True,
        )
    ]
    found: list[FloatArray] = []
    missing = count
    for _ in range(MOST_TRIES):
        (d1, measure1), (d2, measure2) = (spring.draw(random, TRIES) for spring in springs)
        states = np.zeros((TRIES, 12))
        states[:, :3], states[:, 3:6] = d1, d1 + d2
        kinetic = excess + lowest_energy - np.asarray(energy(p, states))
        density = measure1 * measure2 * np.maximum(kinetic / excess, 0.0) ** (freedoms / 2 - 1)
        taken = np.flatnonzero(random.random(TRIES) < density)[:missing]
        velocities = random.standard_normal((TRIES, 6))
        if plane:
            velocities[:, [1, 4]] = 0.0
        velocities *= (2 * np.maximum(kinetic, 0.0))[:, None] ** 0.5 / np.linalg.norm(velocities, axis=1)[:, None]
        states[:, 6:] = velocities / np.repeat([p.m1, p.m2], 3) ** 0.5
        found.append(states[taken])
        missing -= len(taken)
        if missing == 0:
            return np.concatenate(found)
    raise ValueError(f"excess_energy = {excess_energy!r}: too few states found among {MOST_TRIES * TRIES:,} tried")


class _Reach:
    """Where one spring's far end can be when all the energy is its own."""

    def __init__(self, rest: float, k: float, weight: float, excess: float, plane: bool) -> None:
        stretch = (2 * excess / k) ** 0.5
        self.low, self.high = max(rest - stretch, 0.0), rest + stretch
        self.plane = plane
        lift = weight * self.low
        self.cosine = max(1 - excess / lift, -1.0) if lift > 0 else -1.0

    def draw(self, random: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
        """Spring vectors, shape (count, 3), and the measure of each over the greatest, shape (count,)."""
        r = random.uniform(self.low, self.high, count)
        turn = random.random(count)
        if self.plane:
            angle = np.arccos(self.cosine) * (2 * turn - 1)
            vectors = np.stack([r * np.sin(angle), np.zeros(count), -r * np.cos(angle)], axis=1)
            return vectors, r / self.high
        cosine = random.uniform(self.cosine, 1.0, count)
        across = r * np.sqrt(1 - cosine * cosine)
        phi = 2 * np.pi * turn
        return np.stack([across * np.cos(phi), across * np.sin(phi), -r * cosine], axis=1), (r / self.high) ** 2
