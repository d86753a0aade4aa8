"""Periodic orbits by shooting, and their stability.

Newton's method on the state and the period together, with the derivative of the motion over a period, the monodromy
matrix, from the exact tangent map: S. C. Farantos, "POMULT: A program for computing periodic orbits in Hamiltonian
systems based on multiple shooting algorithms", Comput. Phys. Commun. 108 (1998) 240-258, with one shot. Periodic orbits
come in families (along the orbit itself, with the energy, turned about the vertical), so the equations for the next
guess are singular on the orbit: the smallest correction that solves them is taken, by a singular value decomposition in
which what is nearly zero counts as zero. So the orbit that is found is the one near the guess.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env.dynamics.checks import checked_state, whole_number
from spring_pendulum_env.dynamics.flow import Flow
from spring_pendulum_env.equilibria import energy
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]

FINER = 16
"""Steps are so many times shorter than the environments': of order 6, so that rounding is left."""

MOST_STEPS = 2_000_000
"""In a period: minutes of computing."""

SINGULAR = 1e-7
"""Singular values below this count as zero, in lengths, rates over the orbit's frequency, and the period times it."""

MASS_1 = np.r_[0:3, 6:9]


class NotPeriodicError(ArithmeticError):
    """No periodic orbit was found from a guess."""


@dataclasses.dataclass(frozen=True)
class PeriodicOrbit:
    """A motion that comes back to where it started."""

    parameters: Parameters
    state: FloatArray
    """One of its states: positions in m, then velocities in m/s; shape (12,)."""
    period: float
    """s."""
    closure: float
    """Largest difference between the state and what it becomes after a period, m or m/s."""
    monodromy: FloatArray
    """What becomes of small displacements in a period; shape (12, 12), or (6, 6) of mass 1 alone where k2 = 0."""
    multipliers: NDArray[np.complex128]
    """Its eigenvalues, the Floquet multipliers, largest first. Without drag they come in pairs with product 1, and
    those for the families that the orbit belongs to are 1, to about 1e-6 (they are double roots)."""
    iterations: int
    """Corrections that were needed."""

    @property
    def stable(self) -> bool:
        """Whether no small displacement grows exponentially: no multiplier is beyond 1 by more than 1e-4."""
        return bool(np.abs(self.multipliers).max() < 1 + 1e-4)


def periodic_orbit(
    parameters: Parameters | Mapping[str, float] | None,
    guess: ArrayLike,
    period: float,
    *,
    hold: str = "energy",
    tolerance: float = 1e-11,
    max_iterations: int = 30,
) -> PeriodicOrbit:
    """The periodic orbit of the passive pendulum that is close to a guess.

    Where k2 = 0, mass 2 falls freely and is left out: the orbit is mass 1's.

    Args:
        parameters: the constants, or a mapping of some of them.
        guess: positions X1 Y1 Z1 X2 Y2 Z2 in m, then their rates in m/s; shape (12,).
        period: guess of the period, s.
        hold: which member of a family of orbits is wanted: "energy", the one with the guess's energy, or "period", with
            its period.
        tolerance: the largest closure, m or m/s, that will do.
        max_iterations: corrections after which the search is given up.

    Raises:
        ValueError: a wrong argument.
        NotPeriodicError: the search doesn't converge; the message says how close it came.
        ArithmeticError: a spring passes through zero length, or the motion is beyond what floats can hold.
    """
    flow = _accurate_flow(parameters)
    state = checked_state(guess, "guess")
    duration = _followable(flow, "period", period)
    positive_number("tolerance", tolerance)
    whole_number("max_iterations", max_iterations, 1)
    if hold not in ("energy", "period"):
        raise ValueError(f"hold = {hold!r}: must be 'energy' or 'period'")
    shot = _Shot(flow, state, duration)
    wanted = shot.energy
    for iteration in range(max_iterations + 1):
        if shot.closure <= tolerance:
            if np.abs(shot.start_slope).max() < 1e-6:
                raise NotPeriodicError(f"{_failure(guess, period, iteration, shot)}: it is at rest")
            if shot.duration < flow.longest_step:  # a motion misses its start by nothing where it has no time to move
                raise NotPeriodicError(f"{_failure(guess, period, iteration, shot)}: that is no time at all")
            multipliers = np.linalg.eigvals(shot.monodromy).astype(complex)
            multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
            return PeriodicOrbit(
                flow.parameters, shot.state, shot.duration, shot.closure, shot.monodromy, multipliers, iteration
            )
        if iteration == max_iterations:
            break
        try:
            shot = shot.corrected(wanted if hold == "energy" else None)
        except ArithmeticError as error:
            raise NotPeriodicError(f"{_failure(guess, period, iteration, shot)}: {error}") from None
    raise NotPeriodicError(_failure(guess, period, max_iterations, shot))


def monodromy_matrix(
    parameters: Parameters | Mapping[str, float] | None, state: ArrayLike, duration: float
) -> tuple[FloatArray, FloatArray]:
    """What becomes of a state and of small displacements from it.

    Args:
        parameters: the constants, or a mapping of some of them.
        state: shape (12,), m and m/s.
        duration: s.

    Returns:
        The state after the duration, shape (12,), and the matrix of its derivatives, shape (12, 12).

    Raises:
        ValueError: a wrong argument.
        ArithmeticError: a spring passes through zero length, or the motion is beyond what floats can hold.
    """
    flow = _accurate_flow(parameters)
    return _with_derivatives(flow, checked_state(state), _followable(flow, "duration", duration))


def _accurate_flow(parameters: Parameters | Mapping[str, float] | None) -> Flow:
    usual = Flow(parameters)
    return Flow(usual.parameters, usual.longest_step / FINER)


def _followable(flow: Flow, name: str, duration: float) -> float:
    """A time that takes no more than MOST_STEPS.

    Raises:
        ValueError: it is longer, or no time.
    """
    longest = MOST_STEPS * flow.longest_step
    if positive_number(name, duration) > longest:
        raise ValueError(f"{name} = {duration!r} s: must be at most {longest:g} s, which are {MOST_STEPS:,} steps")
    return float(duration)


def _with_derivatives(flow: Flow, state: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    points = np.concatenate([np.repeat(state[:, None], 12, axis=1), np.eye(12)])
    flow.advance(points, duration)
    return points[:12, 0].copy(), points[12:].copy()


class _Shot:
    """A motion over a guessed period."""

    def __init__(self, flow: Flow, state: FloatArray, duration: float) -> None:
        self.flow, self.state, self.duration = flow, state, duration
        end, matrix = _with_derivatives(flow, state, duration)
        self.kept = MASS_1 if flow.parameters.k2 == 0 else np.arange(12)
        self.miss = (end - state)[self.kept]
        self.closure = float(np.abs(self.miss).max())
        self.monodromy = matrix[np.ix_(self.kept, self.kept)]
        held = state if flow.parameters.k2 > 0 else np.r_[state[:3], np.zeros(3), state[6:9], np.zeros(3)]
        self.energy = float(energy(flow.parameters, held))
        self.start_slope, self.end_slope = flow.slope(np.stack([state, end]))[:, self.kept]

    def corrected(self, wanted_energy: float | None) -> _Shot:
        """A shot that misses by less, from the smallest correction after which, to first order, the motion closes.

        Raises:
            ArithmeticError: even an eighth of the correction doesn't lead closer, or there is no motion to be had.
        """
        state_change, duration_change = self._correction(wanted_energy)
        for share in (1.0, 0.5, 0.25, 0.125):
            duration = self.duration + share * duration_change
            if duration > 0:
                shot = _Shot(self.flow, self.state + share * state_change, duration)
                if shot.closure < self.closure:
                    return shot
        raise ArithmeticError("no correction leads closer")

    def _correction(self, wanted_energy: float | None) -> tuple[FloatArray, float]:
        """Changes of the state, shape (12,), and of the period, s; None for the energy holds the period."""
        size = len(self.kept)
        half = size // 2
        # In meters: rates over a frequency, the period times a speed, so that lengths of corrections mean something.
        frequency = 2 * np.pi / self.duration
        scale = np.r_[np.ones(half), np.full(half, frequency), 1.0 / frequency]
        rows = [*((self.monodromy - np.eye(size)) / scale[:size, None]).T, self.end_slope / scale[:size]]
        equations = np.array(rows).T * scale
        missed = -self.miss / scale[:size]
        # A change along the motion itself would lead nowhere.
        extra = [(np.r_[self.start_slope / scale[:size], 0.0], 0.0)]
        if wanted_energy is None:
            equations[:, size] = 0.0
        else:
            p = self.flow.parameters
            masses = np.repeat([p.m1, p.m2], 3)[:half]
            gradient = np.r_[-masses * self.start_slope[half:], masses * self.start_slope[:half]]
            extra.append((np.r_[gradient * scale[:size], 0.0], wanted_energy - self.energy))
        for row, value in extra:
            steepness = np.linalg.norm(row)
            if steepness > 0:
                equations = np.vstack([equations, row / steepness])
                missed = np.r_[missed, value / steepness]
        left, values, right = np.linalg.svd(equations, full_matrices=False)
        counts = values > max(SINGULAR, 1e-13 * values[0])
        correction = right[counts].T @ ((left.T @ missed)[counts] / values[counts]) * scale
        change = np.zeros(12)
        change[self.kept] = correction[:size]
        return change, float(correction[size])


def _failure(guess: ArrayLike, period: float, iterations: int, shot: _Shot) -> str:
    return (
        f"no periodic orbit found near guess = {np.asarray(guess).tolist()}, period = {period}: after {iterations} "
        f"corrections the motion misses its start by {shot.closure:.3g} (m or m/s) in {shot.duration:.6g} s"
    )
