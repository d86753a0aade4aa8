"""An elastic double pendulum in three dimensions as Gymnasium environments. Importing this registers their ids."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium as _gym

from spring_pendulum_env.equilibria import EQUILIBRIA, NormalModes, energy, equilibrium, linearise, normal_modes
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.tasks import TASKS

if TYPE_CHECKING:
    from spring_pendulum_env.env import SpringPendulumEnv
    from spring_pendulum_env.simulation import Trajectory, simulate
    from spring_pendulum_env.vector_env import SpringPendulumVectorEnv

__version__ = "0.1.0"

__all__ = [
    "EQUILIBRIA",
    "NormalModes",
    "Parameters",
    "SpringPendulumEnv",
    "SpringPendulumVectorEnv",
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
            # Wrappers cost a tenth of a step. The environment refuses calls out of order itself, and the tests run
            # Gymnasium's checks; gym.make(..., disable_env_checker=False) has them made again.
            order_enforce=False,
            disable_env_checker=True,
            kwargs={"task": _task.name},
        )


_ON_FIRST_USE = {
    "SpringPendulumEnv": "env",
    "SpringPendulumVectorEnv": "vector_env",
    "Trajectory": "simulation",
    "simulate": "simulation",
}
"""Public names whose modules take long to import, the environments' with numba as long as all the rest."""


def __getattr__(name: str) -> Any:
    """A name of those that are imported on first use."""
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_ON_FIRST_USE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_ON_FIRST_USE})
