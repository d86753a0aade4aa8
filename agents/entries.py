"""What can be scored, by name: the classical controllers, shipped policies, and runs of scripts/train.py.

A name is one of CLASSICAL, a shipped policy (with its trainings from other seeds), the folder of a run, or a pattern
such as "runs/damping-ppo-seed*" that matches the folders of one training with several seeds, which then make one entry.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import load, runs
from agents.baselines import DRAG, Damper, Nothing
from agents.config import ENVIRONMENT_IDS, Config
from agents.controller import Controller
from agents.evaluation import ACTION_TIME, STARTS, Trial, score
from agents.lqr import LQR
from agents.rollout import scenario_for
from agents.tuned import nearest_settings, tuned_damper, tuned_lqr
from spring_pendulum_env.scenario import Scenario

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Entry:
    """`make(trial, scenario)` gives a controller for each training (one, where nothing was trained), none where the
    entry is not for that trial; `changes` are made to the arguments of gym.make.
    """

    name: str
    title: str
    make: Callable[[Trial, Scenario], Sequence[Controller]]
    changes: Mapping[str, Any] = field(default_factory=dict)
    folders: Sequence[Path] = ()
    """Of the trainings, where something was trained."""

    def arguments(self, trial: Trial) -> dict[str, Any]:
        """For gym.make."""
        return trial.arguments | dict(self.changes)

    def controllers(self, trial: Trial) -> Sequence[Controller]:
        """One for each training; none where this entry is not for the trial."""
        return self.make(trial, scenario_for(trial.environment_id, trial.arguments))


def _nothing(_: Trial, scenario: Scenario) -> Sequence[Controller]:
    return [Nothing(len(scenario.actuated_axes))]


def _lqr(_: Trial, scenario: Scenario) -> Sequence[Controller]:
    return [LQR(scenario.parameters, scenario.equilibrium, max_force=scenario.max_force)]


def _tuned_lqr(trial: Trial, scenario: Scenario) -> Sequence[Controller]:
    name = nearest_settings(trial.name, trial.equilibrium, trial.spread, "lqr")
    return [] if name is None else [tuned_lqr(name, scenario)]


def _damper(trial: Trial, scenario: Scenario) -> Sequence[Damper]:
    name = nearest_settings(trial.name, trial.equilibrium, trial.spread, "damper")
    return [] if name is None else [tuned_damper(name, scenario)]


def _nmpc(trial: Trial, scenario: Scenario) -> Sequence[Controller]:
    from agents.nmpc import NMPC  # CasADi is an extra

    # For damping the weights say how fast it is to be, and those tuned for LQR serve NMPC too. Where recovering is all
    # that counts they make up for what LQR doesn't know far from the equilibrium; NMPC knows, and has the usual ones.
    damping = trial.environment_id == ENVIRONMENT_IDS["damping"]
    model = tuned_lqr(trial.name, scenario) if damping else LQR(scenario.parameters, scenario.equilibrium)
    return [NMPC(model, anchor_travel=scenario.anchor_travel)]


CLASSICAL = {
    entry.name: entry
    for entry in (
        Entry("nothing", "nothing", _nothing),
        Entry("drag", f"nothing, but drag of {DRAG['R1']:g} kg/s", _nothing, {"parameters": DRAG}),
        Entry("damper", "damper, tuned", _damper),
        Entry("lqr", "LQR", _lqr),
        Entry("lqr-tuned", "LQR, tuned", _tuned_lqr),
        Entry("nmpc", "NMPC", _nmpc),
    )
}
"""By name."""


KINDS = {"policy": "policy", "randomised": "policy, randomised"}
"""Titles of the shipped policies, by kind: trained on the task as it is, or on randomised parameters."""


def kind_of(name: str) -> str:
    """What a table or a picture of all tasks calls an entry: a classical one by its name, a learned one by its kind."""
    if name in runs.RANDOMISED_NAMES:
        return "randomised"
    return "policy" if name in runs.SHIPPED_NAMES else name


def find(name: str) -> Entry:
    """The entry of a name (see above). Raises ValueError where it is none, or where a folder is no finished run."""
    if name in CLASSICAL:
        return CLASSICAL[name]
    if runs.is_shipped(name):
        folder = runs.find_run(name)
        return _learned(name, [folder, *sorted((folder.parent / "seeds").glob(f"{folder.name}-*"))])
    pattern = Path(name)
    folders = sorted(pattern.parent.glob(pattern.name)) if "*" in pattern.name else [pattern]
    if not folders or not all(folder.is_dir() for folder in folders):
        allowed = ", ".join((*CLASSICAL, *runs.available_names()))
        raise ValueError(f"entry is {name!r}; allowed are {allowed}, and the folder of a run or a pattern of several")
    return _learned(name, [runs.find_run(folder) for folder in folders])


def _learned(name: str, folders: Sequence[Path]) -> Entry:
    """The policies in some run folders, for the trials of the task that they were trained for."""
    configs = [runs.read_run_config(folder) for folder in folders]
    what = KINDS[kind_of(name)] if runs.is_shipped(name) else Path(name).name.rstrip("*-_") or name
    how = configs[0].algorithm.upper() + (" over LQR" if configs[0].guide is not None else "")
    count = f", {len(folders)} trainings" if len(folders) > 1 else ""

    loaded = functools.cache(load)  # they keep nothing from step to step, and many trials ask for them

    def make(trial: Trial, _: Scenario) -> Sequence[Controller]:
        return [loaded(folder) for folder, config in zip(folders, configs, strict=True) if is_for(config, trial)]

    return Entry(name, f"{what} ({how}{count})", make, folders=tuple(folders))


def is_for(config: Config, trial: Trial) -> bool:
    """Whether a policy was trained for a trial's task: same equilibrium, axes, force and control period.

    It may have been trained on other spreads, or on randomised parameters.
    """
    if config.environment_id != trial.environment_id:
        return False
    trained = scenario_for(config.environment_id, config.environment.arguments())
    asked = scenario_for(trial.environment_id, trial.arguments)
    same = ("equilibrium", "actuated_axes", "max_force", "control_period")
    return all(getattr(trained, name) == getattr(asked, name) for name in same)


def score_entry(entry: Entry, trial: Trial, folder: Path, starts: int = STARTS) -> dict[str, Array] | None:
    """Measures of an entry, arrays (trainings, starts), and the time of an action, (trainings, 1), s.

    Each training's scores are kept in `folder` as they are done, and not measured twice. None where the entry is not
    for the trial.
    """
    scored = [
        score(
            controller,
            trial.environment_id,
            entry.arguments(trial),
            folder / trial.name / f"{file_name(entry.name)}-{number}.npz",
            starts,
        )
        for number, controller in enumerate(entry.controllers(trial))
    ]
    return {key: np.stack([values[key] for values in scored]) for key in scored[0]} if scored else None


def action_times(values: Mapping[str, Array]) -> float:
    """The median time of an action over trainings, s."""
    return float(np.median(values[ACTION_TIME]))


def find_all(names: Iterable[str]) -> list[Entry]:
    """`find` for each."""
    return [find(name) for name in names]


def file_name(name: str) -> str:
    """An entry's name as part of a file name."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)
