"""A map of chaos: which starts of a family lead to order, and which to chaos."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env.dynamics.checks import finite_number, real_array
from spring_pendulum_env.dynamics.energy_surface import lowest_state
from spring_pendulum_env.dynamics.megno import Indicators, chaos_indicators
from spring_pendulum_env.equilibria import energy
from spring_pendulum_env.physics import Parameters

FloatArray = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class ChaosMap:
    """Order and chaos over start angle and energy. In the arrays of two axes row i belongs to `energies[i]`, column j
    to `angles[j]`; their shape is (len(energies), len(angles))."""

    angles: FloatArray
    """From the downward vertical, rad."""
    energies: FloatArray
    """Above hanging rest, J."""
    megno: FloatArray
    """Mean MEGNO at the end; nan where there is no such start, or its motion couldn't be followed."""
    megno_halfway: FloatArray
    """Mean MEGNO after half the duration."""
    exponent: FloatArray
    """Mean rate of growth in the second half, 1/s: an estimate of the largest Lyapunov exponent."""
    energy_error: FloatArray
    """Equation (42): what the integration got wrong."""
    possible: NDArray[np.bool_]
    """Where there is a start: the energy suffices to stand still at the angle."""

    @property
    def chaotic(self) -> NDArray[np.bool_]:
        """Where the mean MEGNO says chaos; False where it is nan."""
        return self._indicators.chaotic

    @property
    def agreement(self) -> float:
        """Share of the motions for which half the duration says the same."""
        found = self._indicators
        return float((found.chaotic == found.chaotic_halfway)[found.known].mean()) if found.known.any() else np.nan

    @property
    def _indicators(self) -> Indicators:
        return Indicators(self.megno, self.megno_halfway, self.exponent, self.energy_error)


def thrown_straight(
    parameters: Parameters | Mapping[str, float] | None, angles: ArrayLike, energies: ArrayLike, heading: float = 0.0
) -> FloatArray:
    """Starts of the map's family: the pendulum straight at an angle, thrown as if it were one rigid body.

    Both springs have the lengths at which they carry their load at rest and point the same way, at `angle` from the
    downward vertical towards x. All energy that this leaves is in a turn about the anchor by one angular velocity for
    both masses: towards larger angles in the plane y = 0, or with a `heading`, turned from there towards y.

    Args:
        parameters: the constants, or a mapping of some of them.
        angles: rad; shape (n,).
        energies: above hanging rest, J; shape (n,).
        heading: rad; 0: the motion stays in the plane; pi/2: thrown sideways, as a conical pendulum.

    Returns:
        Shape (n, 12), m and m/s; rows of nan where the energy doesn't suffice to stand still at the angle.

    Raises:
        ValueError: a wrong parameter, a number that isn't finite, or k1 = 0 or k2 = 0, where there is no rest.
    """
    p = Parameters.of(parameters)
    finite_number("heading", heading)
    rest = lowest_state(p)
    angles, energies = np.broadcast_arrays(real_array(angles, "angles"), real_array(energies, "energies"))
    if not (np.isfinite(angles).all() and np.isfinite(energies).all()):
        raise ValueError(f"angles = {angles}, energies = {energies}: must be finite")
    sine, cosine, zero = np.sin(angles), np.cos(angles), np.zeros(angles.shape)
    sideways = np.sin(heading)
    outward = np.stack([sine, zero, -cosine], axis=-1)
    onward = np.cos(heading) * np.stack([cosine, zero, sine], axis=-1)
    onward[..., 1] += sideways
    states = np.concatenate([-rest[2] * outward, -rest[5] * outward, -rest[2] * onward, -rest[5] * onward], axis=-1)
    still = states.copy()
    still[..., 6:] = 0.0
    standing = np.asarray(energy(p, still))
    turning = np.asarray(energy(p, states)) - standing  # at 1 rad/s
    left = energies - (standing - float(energy(p, rest)))
    left = np.where(np.abs(left) <= 1e-12 * energies, 0.0, left)
    with np.errstate(invalid="ignore"):
        states[..., 6:] *= np.sqrt(left / turning)[..., None]
    states[~(left >= 0)] = np.nan
    return states


def chaos_map(
    parameters: Parameters | Mapping[str, float] | None,
    angles: ArrayLike,
    energies: ArrayLike,
    duration: float = 500.0,
    *,
    heading: float = 0.0,
    interval: float = 1.0,
    longest_step: float | None = None,
    seed: int = 0,
    block: int = 256,
    file: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> ChaosMap:
    """Mean MEGNO of the motions from a grid of starts, all side by side.

    The starts are those of `thrown_straight`: the straight pendulum at an angle, its springs as long as at rest,
    thrown like a rigid body with all the energy that is left. With a heading of 0 the motions are planar, and are
    compared with planar neighbours.

    Args:
        parameters: the constants, or a mapping of some of them; no drag.
        angles: from the downward vertical, rad, increasing; shape (n,).
        energies: above hanging rest, J, increasing, none below 0; shape (m,).
        duration: how long each motion is followed, s.
        heading: of the throw, rad: 0 in the plane, pi/2 sideways.
        interval, longest_step, seed, block: as of `chaos_indicators`.
        file: an .npz that holds what is done; a second call with it goes on where the first was interrupted.
        progress: draw a progress bar.

    Raises:
        ValueError: a wrong argument, drag, a spring without stiffness, no start that is possible, or a file of another
            map.
    """
    across = _axis("angles", angles)
    up = _axis("energies", energies)
    if up[0] < 0:
        raise ValueError(f"energies = {up[0]:g} J and more: must be >= 0, they count from hanging rest")
    finite_number("heading", heading)
    starts = thrown_straight(parameters, across[None, :], up[:, None], heading)
    possible: NDArray[np.bool_] = np.asarray(np.isfinite(starts).all(axis=-1))
    if not possible.any():
        raise ValueError(f"energies up to {up[-1]:g} J: too little to stand still at any of the angles")
    found = chaos_indicators(
        parameters, starts[possible], duration, plane=bool(heading == 0), interval=interval,
        longest_step=longest_step, seed=seed, block=block, file=file, progress=progress,
    )  # fmt: skip
    grids = {}
    for field in dataclasses.fields(Indicators):
        grids[field.name] = np.full(possible.shape, np.nan)
        grids[field.name][possible] = getattr(found, field.name)
    return ChaosMap(across, up, possible=possible, **grids)


def _axis(name: str, values: ArrayLike) -> FloatArray:
    """Values along an axis of the map.

    Raises:
        ValueError: they aren't finite numbers in increasing order.
    """
    array = real_array(values, name)
    if array.ndim != 1 or len(array) == 0:
        raise ValueError(f"{name} of shape {array.shape}: must have shape (n,)")
    if not np.isfinite(array).all() or (np.diff(array) <= 0).any():
        raise ValueError(f"{name} = {array}: must be finite and increasing")
    return array
