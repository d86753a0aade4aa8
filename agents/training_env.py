"""The environments that a policy is trained in, as Stable-Baselines3 wants them."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from agents.config import Config
from agents.controller import STATE_SIZE
from agents.evaluation import scenario_of
from agents.relative import relative
from agents.sb3 import SpringPendulumVecEnv
from spring_pendulum_env import equilibrium


def make_training_env(config: Config) -> SpringPendulumVecEnv:
    """All environments of one training: raw observations (n, 18), episode statistics in the infos.

    Raises ValueError, or Gymnasium's own error, for arguments that the environment refuses.
    """
    count = config.training.environments
    staggered = staggered_lengths(config, count)
    return SpringPendulumVecEnv(config.environment_id, count, staggered, **config.environment.arguments())


def staggered_lengths(config: Config, count: int) -> NDArray[np.int64]:
    """(count,), the length at which the first episode of each environment is cut, so that they don't stay in step."""
    limit = gym.spec(config.environment_id).max_episode_steps or 0
    return 1 + np.arange(count) * limit // count


def task_equilibrium(config: Config) -> NDArray[np.float64]:
    """(18,), the equilibrium that a config's task is about, with its parameters before any randomising."""
    env = gym.make(config.environment_id, **config.environment.arguments())
    scenario = scenario_of(env)
    env.close()
    return equilibrium(scenario.parameters, scenario.equilibrium)


class RelativeObservations(VecEnvWrapper):
    """Turns a batch's observations into float32 ones relative to `reference`, as `agents.relative` says."""

    def __init__(self, venv: VecEnv, reference: NDArray[np.float64]) -> None:
        super().__init__(venv, observation_space=gym.spaces.Box(-np.inf, np.inf, (STATE_SIZE,), np.float32))
        self.reference = reference

    def reset(self) -> NDArray[np.float32]:
        return self._relative(self.venv.reset())

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones):
            infos[i]["terminal_observation"] = self._relative(infos[i]["terminal_observation"])
        return self._relative(observations), rewards, dones, infos

    def _relative(self, observations: Any) -> NDArray[np.float32]:
        return relative(np.asarray(observations, dtype=np.float64), self.reference).astype(np.float32)
