"""What every controller here has in common: Stable-Baselines3's `predict` on raw observations of the actuated tasks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

AXES = "xyz"
"""The axes along which an anchor can be actuated, all of them by default."""

STATE_SIZE = 18
"""Numbers in an observation of an actuated task: positions of anchor, mass 1 and mass 2 (m), then velocities (m/s)."""

Prediction = tuple[NDArray[np.float64], Any]
"""Normalised action or stack of actions, and the recurrent state, which is handed back as it came."""


class Controller(Protocol):
    """Anything with this `predict` can be evaluated."""

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Actions in [-1, 1], shape (axes,) or (n, axes), for observations of shape (18,) or (n, 18).

        Raises ValueError for any other shape and for numbers that are not finite.
        """
        ...


class StateFeedback(ABC):
    """A controller whose action follows from the observation alone."""

    @abstractmethod
    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:
        """Actions (n, axes) in [-1, 1] for observations (n, 18)."""

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,  # noqa: ARG002  nothing is remembered that a new episode could spoil
        deterministic: bool = True,
    ) -> Prediction:
        """Actions in [-1, 1], shape (axes,) or (n, axes), for observations of shape (18,) or (n, 18).

        Raises ValueError for any other shape and for numbers that are not finite.
        """
        array = np.asarray(observation, dtype=np.float64)
        if array.ndim not in (1, 2) or array.shape[-1] != STATE_SIZE:
            raise ValueError(f"observation has shape {array.shape}; allowed are ({STATE_SIZE},) and (n, {STATE_SIZE})")
        if not np.isfinite(array).all():
            raise ValueError(f"observation holds {array[~np.isfinite(array)][0]}; allowed are finite numbers")
        actions = self.actions(np.atleast_2d(array), deterministic)
        return (actions[0] if array.ndim == 1 else actions), state
