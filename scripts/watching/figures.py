"""Figures of episodes, and the learning curves of the policies among the players."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spring_pendulum_env import plots
from watching.cast import BUILT_IN
from watching.record import Record


def draw(folder: Path, records: Sequence[Record]) -> list[Path]:
    """Draw all that `plots` has of these episodes, as PNG and SVG; returns the files.

    Raises:
        DependencyNotInstalled: matplotlib isn't there.
        OSError: a file can't be written.
    """
    motions = [plots.Motion(one.name, one.parameters, one.times, one.states, one.errors) for one in records]
    figures = {"energy": plots.energy(motions), "spring-lengths": plots.spring_lengths(motions)}
    for number, motion in enumerate(motions, start=1):
        suffix = "" if len(motions) == 1 else f"-{number}"
        figures[f"paths{suffix}"] = plots.paths(motion)
        figures[f"phase-portraits{suffix}"] = plots.phase_portraits(motion)
    curves = {one.name: [_curve(one.name)] for one in records if one.name not in BUILT_IN}
    if curves:
        figures["learning"] = plots.learning_curves(curves)
    return [file for name, figure in figures.items() for file in plots.save(figure, folder / name)]


def _curve(name: str) -> tuple[list[float], list[float]]:
    """Steps, and the returns of the episodes that ended in them, where any did."""
    from agents import runs
    from agents.files import read_csv

    rows = read_csv(runs.find_run(name) / runs.CURVE)
    points = [(float(row["steps"]), float(row["return"])) for row in rows if row["return"] not in ("", "nan")]
    steps, returns = np.array(points).T.tolist()
    return steps, returns
