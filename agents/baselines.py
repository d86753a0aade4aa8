"""The controllers that every other one has to beat: none at all, and a brake on the anchor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.controller import StateFeedback

DRAG = {"R0": 1.0, "R1": 1.0, "R2": 1.0}
"""Air resistance for the comparison with a pendulum that is damped by nature, kg/s: a mass of 1 kg alone would lose its
speed within a second or two."""


class Nothing(StateFeedback):
    """Applies no force; at rest the gantry carries the weight, so an undisturbed pendulum stays where it is.

    `axes` is the number of actuated axes, 1 to 3. Raises ValueError for another number.
    """

    def __init__(self, axes: int = 3) -> None:
        if axes not in (1, 2, 3):
            raise ValueError(f"axes is {axes!r}; allowed are 1, 2 and 3")
        self.axes = axes

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:  # noqa: ARG002
        """Zeros (n, axes)."""
        return np.zeros((len(observations), self.axes))


class Damper(StateFeedback):
    """Takes energy out through the anchor, whatever the pendulum's parameters are: u = -brake q0' - centring q0, in N.

    The force's power is u . q0' (see the package's energy budget), so the first term can only take energy out; the
    second is a weak spring that brings the anchor back and, over any closed path, neither gives nor takes. (Passivity:
    Ortega and others, Passivity-based Control of Euler-Lagrange Systems, 1998.) It looks at nothing but the anchor.

    Arguments: `brake` in kg/s and `centring` in N/m, positive; `max_force` in N, the action 1; the actuated axes.
    Raises ValueError for another number or other axes.
    """

    def __init__(self, brake: float, centring: float, *, max_force: float = 20.0, actuated_axes: str = "xyz") -> None:
        for name, value in (("brake", brake), ("centring", centring), ("max_force", max_force)):
            if not 0 < value < np.inf:
                raise ValueError(f"{name} is {value!r}; allowed is a positive finite number")
        if not actuated_axes or not set(actuated_axes) <= set("xyz"):
            raise ValueError(f"actuated_axes is {actuated_axes!r}; allowed are one to three letters of 'xyz'")
        self.brake, self.centring, self.max_force = float(brake), float(centring), float(max_force)
        self.axes = sorted("xyz".index(axis) for axis in actuated_axes)

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:  # noqa: ARG002
        """Force over max_force, limited to [-1, 1]: (n, axes) for observations (n, 18)."""
        places, rates = observations[:, self.axes], observations[:, [9 + axis for axis in self.axes]]
        return np.clip(-(self.brake * rates + self.centring * places) / self.max_force, -1.0, 1.0)
