"""The classical controllers with the settings that the scripted search found (scripts/tune_lqr.py)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from agents.baselines import Damper
from agents.config import FOLDER
from agents.files import write_text
from agents.lqr import LQR
from spring_pendulum_env.scenario import Scenario

SETTINGS = FOLDER / "classical" / "lqr.yaml"
"""By trial: state_weights and effort_weight of LQR, brake and centring of the damper, and how they were found."""

HEAD = """\
# What scripts/tune_lqr.py found: the weights of LQR for each task and spread of starts, and the gains of the damper.
# They were tuned on starts of their own, which no evaluation uses.
"""


def read_settings(path: Path = SETTINGS) -> dict[str, dict[str, Any]]:
    """Settings by trial. Raises ValueError where the file is damaged; where there is none, nothing was tuned yet."""
    if not path.is_file():
        return {}
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict) or not all(isinstance(settings, dict) for settings in data.values()):
        raise ValueError(f"{path} holds {type(data).__name__}; allowed is a mapping of trials to settings")
    return data


def write_settings(settings: dict[str, dict[str, Any]], path: Path = SETTINGS) -> None:
    """Write settings by trial."""
    write_text(path, HEAD + "\n" + yaml.safe_dump(settings, sort_keys=False, default_flow_style=None, width=110))


def tuned_lqr(trial: str, scenario: Scenario, path: Path = SETTINGS) -> LQR:
    """LQR with the weights tuned for a trial, on the model of a scenario. Raises ValueError where there are none."""
    settings = _settings(trial, "lqr", path)
    return LQR(
        scenario.parameters,
        scenario.equilibrium,
        control_period=scenario.control_period,
        max_force=scenario.max_force,
        actuated_axes=scenario.actuated_axes,
        state_weights=settings["state_weights"],
        effort_weight=settings["effort_weight"],
    )


def tuned_damper(trial: str, scenario: Scenario, path: Path = SETTINGS) -> Damper:
    """The damper with the gains tuned for a trial. Raises ValueError where there are none."""
    settings = _settings(trial, "damper", path)
    return Damper(
        settings["brake"],
        settings["centring"],
        max_force=scenario.max_force,
        actuated_axes=scenario.actuated_axes,
    )


def _settings(trial: str, controller: str, path: Path) -> dict[str, Any]:
    settings = read_settings(path)
    available = [name for name in settings if controller in settings[name]]
    if trial not in available:
        allowed = ", ".join(available) or "none so far: scripts/tune_lqr.py makes them"
        raise ValueError(f"trial is {trial!r}, for which no {controller} was tuned; allowed are {allowed}")
    found: dict[str, Any] = settings[trial][controller]
    return found


def nearest_settings(trial: str, equilibrium: str, spread: float, controller: str) -> str | None:
    """The trial whose settings serve another one: itself, or that of the same equilibrium with the nearest spread.

    None where the controller was tuned for no such trial.
    """
    available = [name for name, settings in read_settings().items() if controller in settings]
    if trial in available:
        return trial
    prefix = f"{equilibrium}-"
    spreads = {float(name.removeprefix(prefix)): name for name in available if name.startswith(prefix)}
    return spreads[min(spreads, key=lambda known: abs(math.log(known / spread)))] if spreads else None
