"""The native vector environment as RLlib's runners step it: what the network sees, and no infos.

RLlib makes it by `gym_env_vectorize_mode = VECTOR_ENTRY_POINT`, which calls `make_runner_env` once in each runner.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

import spring_pendulum_env  # noqa: F401  registers the tasks
from agents.config import Config, check_config
from agents.controller import STATE_SIZE
from agents.policy import CLIP, EPSILON
from agents.relative import relative
from agents.training_env import staggered_lengths, task_equilibrium

NAME = "spring-pendulum-training"
"""Under which the environment is registered with Ray."""


def make_runner_env(context: Any) -> VectorEnv[Any, Any, Any]:
    """A runner's environments; `context` holds what `env_settings` gave, and from RLlib `num_envs`."""
    seeds = [int(context["seed"])]
    if _was_restarted():
        seeds.append(time.time_ns())  # or a runner that comes back would play the starts of its first life again
    return RunnerEnv(check_config(context["config"]), int(context["num_envs"]), seeds)


def seed_of_stretch(config: Config, steps_before: int) -> int:
    """Seed of a stretch of training: one that is taken up again must not see its first starts a second time."""
    if steps_before == 0:
        return config.training.seed
    return int(np.random.SeedSequence((config.training.seed, steps_before)).generate_state(1)[0])


def _was_restarted() -> bool:
    ray: Any = sys.modules.get("ray")  # it is there in a runner, and this module does without it elsewhere
    if ray is None or not ray.is_initialized():
        return False
    context = ray.get_runtime_context()
    in_worker = context.worker.mode == ray.WORKER_MODE  # elsewhere it is an error to ask for more
    return in_worker and bool(context.was_current_actor_reconstructed)


class RunnerEnv(VectorWrapper):
    """Observations float32 (n, 18), relative to the task's equilibrium, scaled and clipped as a `LearnedPolicy` does.

    It resets a row in the step after its end, as RLlib expects (Gymnasium's NEXT_STEP). The first episode of each row
    is cut short, at staggered lengths. Infos are left out: RLlib would make a dictionary of them for each row and step.

    Args:
        config: of the training; its observation.scales must be there.
        num_envs: rows.
        seeds: from which, with the seed that RLlib gives to `reset`, the rows' seeds come. RLlib's for two runners
            differ by one, and so do those of neighbouring rows: taken as they are, all but one of a runner's starts
            would be the next one's too.
    """

    def __init__(self, config: Config, num_envs: int, seeds: list[int]) -> None:
        arguments = config.environment.arguments()
        mode = gym.VectorizeMode.VECTOR_ENTRY_POINT
        super().__init__(gym.make_vec(config.environment_id, num_envs, mode, **arguments))
        self.reference = task_equilibrium(config)
        self.variance = fixed_variance(config)
        self.seeds = seeds
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (STATE_SIZE,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.first_lengths = staggered_lengths(config, num_envs)
        self.steps = 0
        self.in_first = np.ones(num_envs, dtype=bool)
        self.cut = np.zeros(num_envs, dtype=bool)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> Any:
        """Starts all rows."""
        if seed is not None:
            seed = int(np.random.SeedSequence([*self.seeds, seed]).generate_state(1)[0])
        observations, _ = self.env.reset(seed=seed, options=options)
        self.steps = 0
        self.in_first[:] = True
        self.cut[:] = False
        return self._seen(observations), {}

    def step(self, actions: Any) -> Any:
        """One control period of every row, or its reset where it ended in the step before."""
        observations, rewards, terminated, truncated, _ = self.env.step(actions)
        if self.cut.any():
            observations[self.cut] = self.env.reset(options={"reset_mask": self.cut})[0][self.cut]
            for array in (rewards, terminated, truncated):
                array[self.cut] = 0
        self.steps += 1
        self.cut = self.in_first & (self.steps >= self.first_lengths) & ~(terminated | truncated)
        truncated = truncated | self.cut
        self.in_first &= ~(terminated | truncated)
        return self._seen(observations), rewards.astype(np.float32), terminated, truncated, {}

    def _seen(self, observations: NDArray[np.float64]) -> NDArray[np.float32]:
        seen = relative(observations, self.reference).astype(np.float32)
        return np.clip(seen / np.sqrt(self.variance + EPSILON), -CLIP, CLIP).astype(np.float32)


def fixed_variance(config: Config) -> NDArray[np.float64]:
    """(18,), the squares of observation.scales. Raises ValueError where there are none."""
    if config.observation.scales is None:
        raise ValueError(
            "observation.scales is null: RLlib's runners gather no statistics; allowed are two numbers (m and m/s)"
        )
    position, velocity = config.observation.scales
    return np.repeat([position**2, velocity**2], STATE_SIZE // 2)


def env_settings(config: Config, seed: int) -> Mapping[str, Any]:
    """What `make_runner_env` needs, as plain data."""
    return {"config": config.model_dump(mode="json"), "seed": seed}
