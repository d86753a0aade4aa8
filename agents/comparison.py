"""A policy beside doing nothing and LQR: evaluation, table, files and pictures in one go."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from agents.baselines import Nothing
from agents.config import Config
from agents.controller import Controller
from agents.evaluation import Evaluation, evaluate, table, write_evaluation
from agents.lqr import LQR
from agents.plots import animate, plot_comparison, plot_energy, plot_paths
from agents.rollout import scenario_for


def baselines(config: Config) -> dict[str, Controller]:
    """LQR and doing nothing, for the very environment of a config."""
    scenario = scenario_for(config.environment_id, config.environment.arguments())
    lqr = LQR(
        scenario.parameters,
        scenario.equilibrium,
        control_period=scenario.control_period,
        max_force=scenario.max_force,
        actuated_axes=scenario.actuated_axes,
    )
    return {"LQR": lqr, "nothing": Nothing(len(scenario.actuated_axes))}


def compare(
    policy: Controller, config: Config, folder: Path, *, episodes: int, name: str = "policy", animation: bool = False
) -> str:
    """Score `policy` beside the baselines on `episodes` unseen starts, write all results to `folder`, return the table.

    Raises ValueError as `agents.evaluation.evaluate` does.
    """
    torch.set_num_threads(1)  # a small network on many threads spends its time waiting for them
    controllers = {name: policy, **baselines(config)}
    evaluations = evaluate(controllers, config.environment_id, config.environment.arguments(), episodes)
    write_evaluation(folder, evaluations, config.environment_id, {"config": config.model_dump(mode="json")})
    plot_comparison(evaluations, config.environment_id, folder / "comparison.png")
    start = typical_start(evaluations[0])
    if config.task == "damping":
        plot_energy(evaluations, folder / "energy.png")
    against_nothing = [evaluations[0], evaluations[-1]]
    plot_paths(against_nothing, folder / "paths.png", start)
    if animation:
        animate(against_nothing, folder / "animation.gif", start)
    return table(evaluations, config.environment_id)


def typical_start(evaluation: Evaluation) -> int:
    """The start whose first excess energy is the median one: neither the tamest nor the wildest to show."""
    start_energy = evaluation.episodes.excess_energy[:, 0]
    return int(np.argsort(start_energy)[(len(start_energy) - 1) // 2])
