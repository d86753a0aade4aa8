"""The four vertical equilibria, the energy of a state, and small motions about an equilibrium."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.physics import Parameters

FloatArray = NDArray[np.float64]

EQUILIBRIA = ("hanging-hanging", "hanging-inverted", "inverted-hanging", "inverted-inverted")
"""Names of the equilibria, spring 1 named first. A hanging spring points down and pulls, an inverted one points up
and pushes."""

BODY_STATE = np.r_[3:9, 12:18]
"""Where the 12 numbers of the pinned system (the two masses) stand among the 18 of the one with an anchor."""


def full_state(state: ArrayLike) -> FloatArray:
    """States of 12 numbers as states of 18 with the anchor at rest at the origin; 18 numbers are left as they are.

    Args:
        state: shape (..., 12) or (..., 18).

    Raises:
        ValueError: another shape, or no real numbers.
    """
    from spring_pendulum_env.scenario import real_numbers  # here since scenario.py needs this file

    try:
        state = real_numbers(state)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"state = {state!r}: must be real numbers") from None
    if state.ndim < 1 or state.shape[-1] not in (12, 18):
        raise ValueError(f"state of shape {state.shape}: the last axis must have 12 or 18 numbers")
    if state.shape[-1] == 18:
        return state
    full = np.zeros((*state.shape[:-1], 18))
    full[..., BODY_STATE] = state
    return full


def energy(parameters: Parameters | Mapping[str, float] | None, state: ArrayLike) -> FloatArray | np.float64:
    """Kinetic plus potential energy, J: equations (33) and (34), and the anchor's own kinetic energy.

    Args:
        parameters: the constants, or a mapping of some of them.
        state: positions in m, then velocities in m/s; shape (..., 12) or (..., 18).

    Returns:
        One number for one state, else an array of shape (...).

    Raises:
        ValueError: a wrong parameter or shape, a number that isn't finite, or one so large that the energy isn't.
    """
    p = Parameters.of(parameters)
    full = full_state(state)
    total = unchecked_energy(p, full)
    if not np.isfinite(total).all():
        raise ValueError(f"state = {full}: must be finite, and so must its energy with {p}")
    return total[()]


def unchecked_energy(p: Parameters, full: FloatArray) -> FloatArray:
    """The energy of states of shape (..., 18), J, shape (...); not finite where it is beyond floating-point numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        total: FloatArray = physics.total_energy(
            *[*np.moveaxis(full, -1, 0), p.m0, p.m1, p.m2, p.k1, p.k2, p.L1, p.L2, p.g]
        )
    return total


def spring_lengths(parameters: Parameters, name: str) -> tuple[float, float]:
    """Heights of the far end of springs 1 and 2 over their near end at an equilibrium, m (negative: hanging).

    Raises:
        ValueError: an unknown name, or an equilibrium that the springs can't hold.
    """
    if not isinstance(name, str) or name not in EQUILIBRIA:
        raise ValueError(f"equilibrium = {name!r}: must be one of {', '.join(EQUILIBRIA)}")
    heights = []
    p = parameters
    springs = (("1", p.k1, p.L1, physics.static_load(p.m1, p.m2, p.g)), ("2", p.k2, p.L2, p.m2 * p.g))
    for way, (number, k, L, load) in zip(name.split("-"), springs, strict=True):
        if k == 0:
            raise ValueError(f"equilibrium = {name!r} with k{number} = 0.0: must have k{number} > 0 to hold the masses")
        if not math.isfinite(load / k):
            raise ValueError(f"equilibrium = {name!r} with k{number} = {k}: must be greater to hold {load:.6g} N")
        spring_length = L + load / k if way == "hanging" else L - load / k
        if way == "inverted" and spring_length <= 0:
            raise ValueError(
                f"equilibrium = {name!r}: spring {number} (k{number} = {k}, L{number} = {L}) would be compressed to "
                f"nothing by {load:.6g} N; k{number} * L{number} must be greater than that"
            )
        heights.append(-spring_length if way == "hanging" else spring_length)
    return heights[0], heights[1]


def vertical_state(height1: float, height2: float) -> FloatArray:
    """The state at rest on the vertical, shape (18,): springs of these heights, anchor at the origin."""
    state = np.zeros(18)
    state[5] = height1
    state[8] = height1 + height2
    return state + 0.0  # without negative zeros, see layout.KNOWN


def equilibrium(parameters: Parameters | Mapping[str, float] | None, name: str) -> FloatArray:
    """The state at an equilibrium, anchor at the origin: shape (18,), m and m/s.

    Hanging: |d1| = L1 + (m1 + m2) g / k1 and |d2| = L2 + m2 g / k2; inverted: with a minus.

    Args:
        parameters: the constants, or a mapping of some of them.
        name: one of `EQUILIBRIA`.

    Raises:
        ValueError: a wrong parameter, an unknown name, or an equilibrium that the springs can't hold (k = 0, or a
            spring compressed to nothing).
    """
    return vertical_state(*spring_lengths(Parameters.of(parameters), name))


@overload
def linearise(
    parameters: Parameters | Mapping[str, float] | None, name: str, pinned: Literal[False] = False
) -> tuple[FloatArray, FloatArray]: ...
@overload
def linearise(parameters: Parameters | Mapping[str, float] | None, name: str, pinned: Literal[True]) -> FloatArray: ...
def linearise(
    parameters: Parameters | Mapping[str, float] | None, name: str, pinned: bool = False
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Linear model of small motions about an equilibrium, in continuous time: x' = A x + B u.

    The derivatives are those of `physics.derivatives` itself, by complex steps, so exact to rounding.

    Args:
        parameters: the constants, or a mapping of some of them.
        name: one of `EQUILIBRIA`.
        pinned: the anchor is held (the paper's system) instead of free on all three axes.

    Returns:
        A, shape (18, 18), 1/s, and B, shape (18, 3), per newton; with `pinned` A alone, shape (12, 12).

    Raises:
        ValueError: as `equilibrium` does.
    """
    p = Parameters.of(parameters)
    at = np.concatenate([equilibrium(p, name), np.zeros(3)]).astype(complex)
    constants = (*p.constants("" if pinned else physics.AXES), *p.drag_rates())
    tiny = 1e-30
    jacobian = np.empty((18, 21))
    for column in range(21):
        stepped = at.copy()
        stepped[column] += 1j * tiny
        with np.errstate(over="ignore", invalid="ignore"):
            slope = physics.derivatives(*[*stepped, *constants])
            jacobian[:, column] = np.imag(slope) / tiny
    if not np.isfinite(jacobian).all():
        raise ValueError(f"parameters = {p}: too large or too small for a linear model in floating-point numbers")
    if pinned:
        bodies: FloatArray = jacobian[np.ix_(BODY_STATE, BODY_STATE)]
        return bodies
    return jacobian[:, :18], jacobian[:, 18:]


class NormalModes(NamedTuple):
    """Small motions without drag: eigenvalues and shapes, slowest-growing first."""

    omega_squared: FloatArray
    """Squared angular frequencies, rad2/s2, ascending; negative ones grow at the rate sqrt(-omega_squared)."""
    shapes: FloatArray
    """Columns: displacements of the bodies' coordinates in each mode, normalised so that shapes^T M shapes = 1."""

    @property
    def frequencies(self) -> NDArray[np.complex128]:
        """Angular frequencies, rad/s: real for a mode that swings, imaginary (times 1/s) for one that grows."""
        return np.sqrt(self.omega_squared.astype(np.complex128))


def normal_modes(parameters: Parameters | Mapping[str, float] | None, name: str, pinned: bool = True) -> NormalModes:
    """Normal modes about an equilibrium, drag left out: x'' = -omega^2 x along each shape.

    Args:
        parameters: the constants, or a mapping of some of them.
        name: one of `EQUILIBRIA`.
        pinned: the anchor is held (6 modes) instead of free (9 modes, three of them drifts with omega = 0).

    Raises:
        ValueError: as `equilibrium` does.
    """
    p = Parameters.of(parameters)
    matrix = linearise(p, name, pinned=True) if pinned else linearise(p, name)[0]
    size = matrix.shape[0] // 2
    masses = np.repeat([p.m1, p.m2] if pinned else [p.m0, p.m1, p.m2], 3)
    root = np.sqrt(masses)
    # The block of A that says what displacements do, in which drag has no part.
    stiffness = -matrix[size:, :size] * root[:, None] / root[None, :]
    omega_squared, vectors = np.linalg.eigh(stiffness / 2 + stiffness.T / 2)
    return NormalModes(omega_squared, vectors / root[:, None])
