"""One controller at work in one environment, a control period at a time."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import Parameters
from spring_pendulum_env.rendering import Renderer
from watching.cast import Cast, described

FloatArray = NDArray[np.float64]


class Episode:
    """What one of a cast does from a start. `ended` says why it came to its end, and is empty before.

    The time limit of the task isn't kept: who shows an episode knows how long to.

    Arguments:
        cast: the task and the players.
        number: which of the players.
        beyond_end: whether it goes on where the task would end it, the anchor or a mass out of bounds.
    """

    def __init__(self, cast: Cast, number: int, *, beyond_end: bool = False) -> None:
        self.name, self.controller = cast.players[number]
        self.scenario = cast.scenario
        self.period = cast.scenario.control_period
        self.ended = ""
        self.info: dict[str, Any] = {}
        self._env: Any = gym.make(cast.environment_id, disable_env_checker=True, **cast.arguments).unwrapped
        self._beyond_end = beyond_end
        self._memory: Any = None
        self._first = True

    @property
    def state(self) -> FloatArray:
        """Positions in m, then velocities in m/s of the anchor, m1 and m2; shape (18,)."""
        state: FloatArray = self._env.state
        return state

    @property
    def parameters(self) -> Parameters:
        """The constants in force."""
        parameters: Parameters = self._env.parameters
        return parameters

    @property
    def force(self) -> FloatArray:
        """The force on the anchor over the last control period, N; shape (3,)."""
        return np.asarray(self.info.get("force", np.zeros(3)), dtype=np.float64)

    @property
    def time(self) -> float:
        """Since the start, s."""
        return float(self.info["time"])

    @property
    def title(self) -> str:
        """Who plays, and how it ended."""
        who = described(self.name)
        return f"{who}: {self.ended}" if self.ended else who

    def reset(self, seed: int) -> None:
        """Begin at the start that the task draws with a seed."""
        self._observation, self.info = self._env.reset(seed=seed)
        self.ended, self._memory, self._first = "", None, True

    def step(self) -> None:
        """One control period, or nothing once it has ended."""
        if self.ended:
            return
        action = None
        if self.controller is not None:
            action, self._memory = self.controller.predict(self._observation, self._memory, np.array([self._first]))
            self._first = False
        try:
            self._observation, _, terminated, _, self.info = self._env.step(action)
        except FloatingPointError:
            self.ended = f"beyond all numbers after {self.time:.1f} s"
            return
        if terminated and not self._beyond_end:
            self.ended = f"out of bounds after {self.time:.1f} s"

    def note(self, renderer: Renderer) -> None:
        """Leave this moment in the renderer's trails, without a picture."""
        renderer.remember(self.state, self.parameters, self.time)

    def draw(self, renderer: Renderer) -> NDArray[np.uint8]:
        """The picture of this moment, by a renderer in mode "rgb_array"."""
        renderer.title = self.title
        picture = renderer.draw(self.state, self.parameters, self.force, self.time)
        assert picture is not None  # only a window gives none
        return picture

    def close(self) -> None:
        """Close the environment."""
        self._env.close()
