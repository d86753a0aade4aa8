"""Who moves the anchor, and in which task: from the names that a user gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import spring_pendulum_env
from agents.baselines import Nothing
from agents.controller import StateFeedback
from agents.lqr import LQR
from agents.trusted import is_archive
from agents.trusted import load as load_archive
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.tasks import TASKS, task_named

HANDS = ("keyboard", "mouse")
BUILT_IN = ("nothing", "lqr", *HANDS)

assert spring_pendulum_env.__version__  # the import registers the environments


class Hand(StateFeedback):
    """The watcher's own force: the window sets `force`, in units of the greatest one, x y z; it is held until it is set
    anew. `axes` are the actuated ones."""

    def __init__(self, device: str, axes: str) -> None:
        self.device = device
        self.force = np.zeros(3)
        self._places = ["xyz".index(axis) for axis in axes]

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:  # noqa: ARG002
        """The force along the actuated axes, limited to [-1, 1]: (n, axes)."""
        return np.tile(np.clip(self.force[self._places], -1.0, 1.0), (len(observations), 1))


def described(name: str) -> str:
    """A player's name for somebody who didn't choose it."""
    if name in HANDS:
        return name
    return {"nothing": "no control", "lqr": "LQR"}.get(name, f"policy {name}")


@dataclass(frozen=True)
class Cast:
    """A task, and those who play it from the same starts: name and controller of each, None in the passive task."""

    environment_id: str
    arguments: Mapping[str, Any]
    scenario: Scenario
    players: Sequence[tuple[str, Any]]


def choose(
    names: Sequence[str],
    task: str | None = None,
    equilibrium: str | None = None,
    parameters: Mapping[str, float] | None = None,
    start_scale: float | None = None,
    *,
    trust: bool = False,
) -> Cast:
    """Find the controllers of these names and the task for them.

    Args:
        names: each one of BUILT_IN, a shipped policy, a run folder, or an archive of Stable-Baselines3.
        task: passive, damping, stabilisation or swing-up; None: what the first policy among the names was trained
            for, or damping where there is none.
        equilibrium: of the stabilisation task; None: as for the task.
        parameters: constants that replace those of the task.
        start_scale: multiplies the spread of the start; None: as for the task.
        trust: whether archives may be loaded, which can run code.

    Raises:
        ValueError: a name, the task or an argument isn't known, or they don't go together.
        DependencyNotInstalled: a policy is named, and what runs it isn't installed.
    """
    configs = {name: _config_of(name) for name in names if name not in BUILT_IN and not is_archive(name)}
    arguments: dict[str, Any] = {}
    if task is None and equilibrium is None and configs:
        config = next(iter(configs.values()))
        environment_id, arguments = config.environment_id, config.environment.arguments()
    else:
        task = task or ("damping" if equilibrium is None else "stabilisation")
        task_named(task)  # says which there are
        environment_id = next(name for name, record in TASKS.items() if record.name == task)
    if equilibrium is not None:
        arguments["equilibrium"] = equilibrium
    if parameters:
        arguments["parameters"] = {**arguments.get("parameters", {}), **parameters}
    if start_scale is not None:
        arguments["start_scale"] = start_scale
    scenario = Scenario.of(TASKS[environment_id], **arguments)
    players = [(name, _player(name, environment_id, scenario, trust)) for name in names]
    return Cast(environment_id, arguments, scenario, players)


def _player(name: str, environment_id: str, scenario: Scenario, trust: bool) -> Any:
    if not scenario.task.actuated:
        if name != "nothing":
            raise ValueError(f"{name!r} can't play the passive task, whose anchor is held: allowed is 'nothing'")
        return None
    axes = scenario.actuated_axes
    if name == "nothing":
        return Nothing(len(axes))
    if name in HANDS:
        return Hand(name, axes)
    if name == "lqr":
        return LQR(
            scenario.parameters,
            scenario.equilibrium,
            control_period=scenario.control_period,
            max_force=scenario.max_force,
            actuated_axes=axes,
        )
    if is_archive(name):
        return load_archive(name, environment_id, axes, trust=trust)
    import torch

    from agents import load

    torch.set_num_threads(1)  # a small network on many threads spends its time waiting for them
    policy = load(name)
    trained = policy.config.environment.actuated_axes or "xyz"
    if trained != axes:
        raise ValueError(f"{name!r} was trained for the axes {trained!r} and can't play a task with {axes!r}")
    return policy


def _config_of(name: str) -> Any:
    """Config of a learned policy."""
    try:
        from agents import runs
    except ImportError as error:
        hint = f"the policy {name!r} needs {error.name}: pip install '.[train]'"
        raise gym.error.DependencyNotInstalled(hint) from None
    if not runs.is_shipped(name) and not Path(name).is_dir():
        allowed = ", ".join((*BUILT_IN, *runs.SHIPPED_NAMES, *runs.RANDOMISED_NAMES))
        raise ValueError(f"controller {name!r} is unknown: must be {allowed}, or the folder of a run")
    return runs.read_run_config(runs.find_run(name))
