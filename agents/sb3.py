"""Stable-Baselines3's view of the native vector environment: what DummyVecEnv over monitored single ones would give."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

import spring_pendulum_env  # noqa: F401  registers the tasks
from agents.checkpoints import fitting


class SpringPendulumVecEnv(VecEnv):
    """A SAME_STEP vector environment as SB3 wants it.

    Rewards are float32. The info of a row is new at each step and holds `TimeLimit.truncated`; where an episode ends
    also `terminal_observation`, and `episode`: return `r` of the raw rewards, length `l`, seconds since the start `t`,
    as SB3's Monitor puts it. Of the environment's own info only that of an ending step is handed on: a dictionary for
    each row and step would cost more than the physics.

    Args:
        name: a registered id.
        num_envs: rows.
        first_lengths: after so many steps the first episode of each row since a reset is truncated, if it lasts that
            long; None: it isn't. Started together, episodes of one length would stay in step, and each rollout would
            show one phase of them, all swinging or all at rest; an algorithm that learns from one rollout at a time
            forgets the other phase meanwhile.
        arguments: those of `gym.make_vec` besides.
    """

    def __init__(
        self, name: str, num_envs: int, first_lengths: NDArray[np.integer[Any]] | None = None, **arguments: Any
    ) -> None:
        self.venv = gym.make_vec(name, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
        self.render_mode = arguments.get("render_mode")
        self.actions: NDArray[Any] = np.zeros(())
        self.returns = np.zeros(num_envs)
        self.lengths = np.zeros(num_envs, dtype=np.int64)
        self.first_lengths = np.full(num_envs, np.inf) if first_lengths is None else np.asarray(first_lengths, float)
        self.limits = self.first_lengths.copy()
        self.started = time.time()
        super().__init__(num_envs, self.venv.single_observation_space, self.venv.single_action_space)

    def reset(self) -> VecEnvObs:
        options = self._options[0] if any(self._options) else None
        if any(own != self._options[0] for own in self._options):
            raise ValueError(f"options = {self._options!r}: must be the same for all environments")
        observations, infos = self.venv.reset(seed=self._seeds, options=options)  # type: ignore[arg-type]
        self.reset_infos = [_row_of(infos, row) for row in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        self.returns[:] = 0.0
        self.lengths[:] = 0
        self.limits[:] = self.first_lengths
        return np.asarray(observations)

    def step_async(self, actions: NDArray[Any]) -> None:
        self.actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, terminated, truncated, vector_infos = self.venv.step(self.actions)
        self.returns += rewards
        self.lengths += 1
        cut = (self.lengths >= self.limits) & ~(terminated | truncated)
        truncated = truncated | cut
        dones = terminated | truncated
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for row in np.flatnonzero(dones).tolist():
            last_info = vector_infos if cut[row] else vector_infos["final_info"]
            last = observations[row].copy() if cut[row] else vector_infos["final_obs"][row]
            infos[row] = _row_of(last_info, row) | {
                "TimeLimit.truncated": bool(truncated[row] and not terminated[row]),
                "terminal_observation": last,
                "episode": {
                    "r": round(float(self.returns[row]), 6),
                    "l": int(self.lengths[row]),
                    "t": round(time.time() - self.started, 6),
                },
            }
        self.returns[dones] = 0.0
        self.lengths[dones] = 0
        self.limits[dones] = np.inf
        if cut.any():
            observations[cut] = self.venv.reset(options={"reset_mask": cut})[0][cut]
        return observations, rewards.astype(np.float32), dones, infos

    def get_state(self) -> dict[str, Any]:
        """All that what comes depends on, as arrays."""
        state = {"returns": self.returns.copy(), "lengths": self.lengths.copy(), "limits": self.limits.copy()}
        return state | {"rows": self.venv.unwrapped.get_state()}  # type: ignore[attr-defined]

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from `get_state()`. Raises ValueError where it is of something else."""
        self.venv.unwrapped.set_state(state["rows"])  # type: ignore[attr-defined]
        for name in ("returns", "lengths", "limits"):
            setattr(self, name, fitting(name, state[name], getattr(self, name)))

    def close(self) -> None:
        self.venv.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        frames = self.venv.render()
        return [None] * self.num_envs if frames is None else list(frames)  # type: ignore[arg-type]

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        holder = self if attr_name == "render_mode" else self.venv.unwrapped
        return [getattr(holder, attr_name) for _ in self._rows(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        raise AttributeError(f"{attr_name} can't be set: all rows share one environment (make it with other arguments)")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        raise AttributeError(f"{method_name} can't be called for single rows: they share one environment")

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """True for Monitor, whose statistics the infos hold; no other wrapper is there."""
        return [issubclass(wrapper_class, Monitor) for _ in self._rows(indices)]

    def _rows(self, indices: VecEnvIndices) -> Iterable[int]:
        return self._get_indices(indices)


def _row_of(infos: dict[str, Any], row: int) -> dict[str, Any]:
    """The info of one row out of those of all."""
    return {
        key: _row_of(values, row) if isinstance(values, dict) else values[row]
        for key, values in infos.items()
        if not key.startswith(("_", "final_"))
    }
