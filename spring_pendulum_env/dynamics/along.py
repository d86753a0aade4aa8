"""Energy, angular momentum and momentum along a trajectory."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.equilibria import energy, full_state
from spring_pendulum_env.physics import Parameters

FloatArray = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Quantities:
    """What a motion keeps, or would keep without drag, gravity or anchor."""

    energy: FloatArray
    """Kinetic plus potential energy, J: equations (33) and (34); shape (...). Kept without drag and force."""
    angular_momentum: FloatArray
    """About the origin, where the pinned anchor is, kg m2/s; shape (..., 3). Its z component is kept without drag, all
    of it with g = 0 too."""
    momentum: FloatArray
    """Of all moving bodies, kg m/s; shape (..., 3). Kept with k1 = 0 and g = 0."""


def quantities(parameters: Parameters | Mapping[str, float] | None, states: ArrayLike) -> Quantities:
    """Energy, angular momentum and momentum of states, for example of `simulate(...).states`.

    Args:
        parameters: the constants, or a mapping of some of them.
        states: positions in m, then velocities in m/s; shape (..., 12), or (..., 18) with the anchor's first.

    Raises:
        ValueError: a wrong parameter or shape, or a number that isn't finite.
    """
    p = Parameters.of(parameters)
    total = np.asarray(energy(p, states))
    full = full_state(states)
    columns = np.moveaxis(full, -1, 0)
    masses = p.m0, p.m1, p.m2
    return Quantities(
        energy=total,
        angular_momentum=np.stack(physics.angular_momentum(*[*columns, *masses]), axis=-1),
        momentum=np.stack(physics.momentum(*[*columns[9:], *masses]), axis=-1),
    )
