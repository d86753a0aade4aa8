"""An elastic double pendulum in three dimensions as Gymnasium environments. Importing this registers their ids."""

from __future__ import annotations

import gymnasium as _gym

from spring_pendulum_env.equilibria import EQUILIBRIA, NormalModes, energy, equilibrium, linearise, normal_modes
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.simulation import Trajectory, simulate
from spring_pendulum_env.tasks import TASKS

__version__ = "0.1.0"

__all__ = [
    "EQUILIBRIA",
    "NormalModes",
    "Parameters",
    "Trajectory",
    "energy",
    "equilibrium",
    "linearise",
    "normal_modes",
    "simulate",
]

for _id, _task in TASKS.items():
    if _id not in _gym.registry:
        _gym.register(
            id=_id,
            entry_point="spring_pendulum_env.env:SpringPendulumEnv",
            vector_entry_point="spring_pendulum_env.vector_env:SpringPendulumVectorEnv",
            max_episode_steps=_task.max_episode_steps,
            kwargs={"task": _task.name},
        )
