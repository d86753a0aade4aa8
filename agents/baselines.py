"""The controller that every other one has to beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.controller import StateFeedback


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
