"""What is measured on motions to judge the paper's claims: plain functions, each of which a test can call."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import simpson, solve_ivp

from spring_pendulum_env import Parameters, energy, physics, simulate, tasks
from spring_pendulum_env.dynamics.flow import Flow
from spring_pendulum_env.equilibria import BODY_STATE
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.simulation import right_hand_side

FloatArray = NDArray[np.float64]
Constants = Parameters | Mapping[str, float]

EXACT = 1e-12
"""Tolerances of the runs that others are measured against; DOP853."""


def lagrangian_mismatch(parameters: Constants, states: ArrayLike) -> float:
    """How far equations (25) to (30) are from the Lagrangian's: largest |m a + dV/dq + R v| over the largest |m a|.

    The derivative of V, equation (34), is taken by complex steps, so it is exact to rounding.

    Args:
        parameters: the constants.
        states: shape (n, 12), m and m/s.
    """
    p = Parameters.of(parameters)
    still = [0.0] * 3
    slope = right_hand_side(p)
    masses, drags = np.repeat([p.m1, p.m2], 3), np.repeat([p.R1, p.R2], 3)
    misses, sizes = [], []
    for state in np.asarray(states, dtype=np.float64):
        gradient = np.empty(6)
        for number in range(6):
            where = state[:6].astype(complex)
            where[number] += 1e-30j
            potential = physics.potential_energy(*[*still, *where, p.m1, p.m2, p.k1, p.k2, p.L1, p.L2, p.g])
            gradient[number] = potential.imag / 1e-30
        forces = masses * np.array(slope(0.0, state)[6:])
        misses.append(np.abs(forces + gradient + drags * state[6:]).max())
        sizes.append(np.abs(forces).max())
    return float(np.max(misses) / np.max(sizes))


def action_changes(
    parameters: Constants, start: ArrayLike, duration: float, size: float = 1e-3, samples: int = 2001
) -> FloatArray:
    """By how much the action of neighbouring paths with the same ends differs from that of the motion, J s.

    The action is the time integral of T - V, equations (32) to (34); a neighbour is displaced along one coordinate by
    size * sin(pi t / duration). What is linear in the displacement is taken off, so that what is left has the sign of
    the action's curvature there.

    Args:
        parameters: the constants.
        start: shape (12,), m and m/s.
        duration: s.
        size: m.
        samples: instants at which the integrand is evaluated.

    Returns:
        One number for each coordinate, shape (6,).
    """
    p = Parameters.of(parameters)
    times = np.linspace(0.0, duration, samples)
    states = simulate(p, start, times, rtol=EXACT, atol=EXACT).states
    rest = np.zeros((3, samples))
    phase = np.pi * times / duration

    def action(coordinate: int, amplitude: float) -> float:
        columns = states.T.copy()
        columns[coordinate] += amplitude * np.sin(phase)
        columns[6 + coordinate] += amplitude * np.pi / duration * np.cos(phase)
        kinetic = physics.kinetic_energy(*[*rest, *columns[6:], p.m0, p.m1, p.m2])
        potential = physics.potential_energy(*[*rest, *columns[:6], p.m1, p.m2, p.k1, p.k2, p.L1, p.L2, p.g])
        return float(simpson(kinetic - potential, x=times))

    return np.array([(action(c, size) + action(c, -size)) / 2 - action(c, 0.0) for c in range(6)])


@dataclasses.dataclass(frozen=True)
class Extremes:
    """Where a spring is longest and shortest in a motion."""

    times: FloatArray
    """Of the greatest lengths, s; shape (n,)."""
    longest: FloatArray
    """The greatest lengths, m; shape (n,)."""
    shortest: FloatArray
    """The smallest lengths, m; shape (about n,)."""
    turns: FloatArray
    """Angle that the spring turned by from each greatest length to the next, rad, from 0 to 2 pi; shape (n - 1,)."""


def extremes(parameters: Constants, start: ArrayLike, duration: float, spring: int = 1) -> Extremes:
    """Greatest and smallest lengths of a spring along an accurate run, and the angles between them.

    Args:
        parameters: the constants.
        start: shape (12,), m and m/s.
        duration: s.
        spring: 1, from the anchor to mass 1, or 2, from mass 1 to mass 2.
    """

    def vectors(state: FloatArray) -> tuple[FloatArray, FloatArray]:
        before = slice(0, 3), slice(6, 9)
        if spring == 1:
            return state[before[0]], state[before[1]]
        return state[3:6] - state[before[0]], state[9:12] - state[before[1]]

    def stretching(_time: float, state: FloatArray) -> float:
        along, rate = vectors(state)
        return float(along @ rate)

    run = solve_ivp(
        right_hand_side(parameters),
        (0.0, duration),
        np.asarray(start, dtype=np.float64),
        method="DOP853",
        rtol=EXACT,
        atol=EXACT,
        events=stretching,
    )
    times, states = run.t_events[0], run.y_events[0].reshape(-1, 12)
    springs = [vectors(state) for state in states]
    lengths = np.array([np.linalg.norm(along) for along, _ in springs])
    middle = (lengths.max(initial=0.0) + lengths.min(initial=np.inf)) / 2
    far = lengths > middle
    axis = np.cross(*springs[0]) if springs else np.zeros(3)
    axis /= np.linalg.norm(axis) or 1.0
    ends = [along for (along, _), is_far in zip(springs, far, strict=True) if is_far]
    turns = [np.arctan2(axis @ np.cross(a, b), a @ b) % (2 * np.pi) for a, b in itertools.pairwise(ends)]
    return Extremes(times[far], lengths[far], lengths[~far], np.array(turns))


def sideways(distance: float, speed: float) -> FloatArray:
    """A start of mass 1 at a distance in m along x, with a speed in m/s along y; mass 2 at rest elsewhere."""
    state = np.zeros(12)
    state[[0, 3, 7]] = distance, 2 * distance, speed
    return state


def on_energy(parameters: Constants, height: float, rise: float, joule: float) -> FloatArray:
    """The start of mass 1 under the anchor at a height Z1 in m, rising at m/s, that moves to the right with an energy.

    Mass 2 is at rest at the height of the anchor, where it has no energy: for one spring alone (k2 = 0).

    Raises:
        ValueError: the energy is too small for that.
    """
    state = np.zeros(12)
    state[[2, 8]] = height, rise
    left = joule - float(energy(parameters, state))
    if left < 0:
        raise ValueError(f"start Z1 = {height}, VZ1 = {rise}: needs {-left:.3g} J more than energy = {joule}")
    state[6] = np.sqrt(2 * left / Parameters.of(parameters).m1)
    return state


def random_starts(parameters: Constants, count: int, seed: int) -> FloatArray:
    """Starts as SpringPendulumPassive-v0 draws them with seeds seed, seed + 1, ...; shape (count, 12)."""
    scenario = Scenario.of(tasks.PASSIVE, parameters=Parameters.of(parameters))
    drawn = [scenario.draw(np.random.default_rng(seed + number), None)[1] for number in range(count)]
    return np.array(drawn)[:, BODY_STATE]


def moved(parameters: Constants, starts: ArrayLike, duration: float) -> FloatArray:
    """Where motions are after a duration in s, drag included; starts and result of shape (n, 12)."""
    starts = np.asarray(starts, dtype=np.float64)
    points = np.zeros((24, len(starts)))
    points[:12] = starts.T
    Flow(parameters).advance(points, duration)
    return points[:12].T.copy()


def spring_lengths(states: ArrayLike) -> FloatArray:
    """Lengths of both springs, m: states of shape (..., 12), result of shape (..., 2)."""
    columns = np.moveaxis(np.asarray(states, dtype=np.float64), -1, 0)
    return np.stack([physics.length(*columns[:3]), physics.length(*(columns[3:6] - columns[:3]))], axis=-1)


def time_of_last_fall(times: FloatArray, values: FloatArray, share: float = 0.5) -> float:
    """From when on values stay below a share of the way down to their end, s.

    Args:
        times: s, shape (n,).
        values: shape (n,), the first taken as 0.
        share: of the change from the first to the last.
    """
    way = (values - values[0]) / (values[-1] - values[0])
    before = np.flatnonzero(way < share)
    return float(times[before[-1]])


def of_one_mass(parameters: Constants, states: ArrayLike) -> FloatArray:
    """Energy of mass 1 and its spring alone, J: mass 2 counted as at rest at the height of the anchor (for k2 = 0)."""
    alone = np.array(states, dtype=np.float64)
    alone[..., [3, 4, 5, 9, 10, 11]] = 0.0
    return np.asarray(energy(parameters, alone))


def per_cent(run_energy: Sequence[float] | FloatArray) -> FloatArray:
    """Change of an energy since its start, per cent of its size there."""
    values = np.asarray(run_energy)
    return np.asarray(100 * (values - values[0]) / abs(values[0]))
