"""Pictures of the leaderboard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from agents.config import ENVIRONMENT_IDS
from agents.entries import kind_of
from agents.evaluation import Trial
from agents.files import write_atomically
from agents.leaderboard import Row
from agents.measures import measures_of
from agents.statistics import estimate

# Okabe and Ito's palette, told apart with any colour vision; entries differ in their marker too.
LOOKS = {
    "nothing": ("nothing", "#666666", "x"),
    "lqr": ("LQR", "#E69F00", "v"),
    "lqr-tuned": ("LQR, tuned", "#D55E00", "^"),
    "nmpc": ("NMPC", "#009E73", "s"),
    "policy": ("learned policy", "#0072B2", "o"),
    "randomised": ("learned policy, randomised parameters", "#56B4E9", "P"),
    "optimum": ("open-loop optimum (at least)", "#CC79A7", "D"),
}


def plot_shares(rows_of: Mapping[Trial, Sequence[Row]], path: Path) -> None:
    """Share of starts recovered or settled, with its 95 % interval: a line for each trial, a dot for each entry."""
    figure, axes = plt.subplots(figsize=(8.5, 1.4 + 0.62 * len(rows_of)), layout="constrained")
    places = {kind: 0.11 * (i - (len(LOOKS) - 1) / 2) for i, kind in enumerate(LOOKS)}
    shown = set()
    for number, (trial, rows) in enumerate(rows_of.items()):
        axes.axhspan(number - 0.42, number + 0.42, color="black", alpha=0.035, linewidth=0)
        for row in rows:
            kind = kind_of(row.name)
            if kind not in LOOKS:  # the damper is for damping alone, and a run has its row in the tables
                continue
            found = estimate(row.values[measures_of(trial.environment_id).success], "share")
            label, colour, marker = LOOKS[kind]
            reach = [[found.value - found.low], [found.high - found.value]]
            axes.errorbar(
                found.value,
                number + places[kind],
                xerr=np.maximum(reach, 0.0),
                fmt=marker,
                color=colour,
                markersize=5,
                linewidth=1.2,
                label=None if kind in shown else label,
            )
            shown.add(kind)
    axes.set_yticks(range(len(rows_of)), [_label(trial) for trial in rows_of])
    axes.set(xlim=(-0.02, 1.02), ylim=(len(rows_of) - 0.5, -0.5), xlabel="share of starts recovered (damping: settled)")
    axes.set_title("Who recovers how many unseen starts, with 95 % intervals", loc="left", fontsize=11)
    axes.grid(axis="x", alpha=0.3)
    order = [LOOKS[kind][0] for kind in LOOKS if kind in shown]
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend([handles[name] for name in order], order, loc="outside lower center", ncols=3, frameon=False)
    _save(figure, path)


def plot_damping(rows_of: Mapping[Trial, Sequence[Row]], path: Path) -> None:
    """How many of the damping starts have settled by when, for each entry."""
    trial = next((trial for trial in rows_of if trial.environment_id == ENVIRONMENT_IDS["damping"]), None)
    if trial is None:
        return
    figure, axes = plt.subplots(figsize=(8, 4.6), layout="constrained")
    styles = ("-", "--", "-.", ":")
    for number, row in enumerate(rows_of[trial]):
        times = row.values["settling_time"].ravel()
        if not np.isfinite(times).any():
            continue
        grid = np.linspace(0.0, 10.0, 501)
        share = (times[:, None] <= grid).mean(axis=0)
        colour = LOOKS[kind_of(row.name)][1] if kind_of(row.name) in LOOKS else "#666666"
        axes.plot(grid, share, color=colour, linestyle=styles[number % len(styles)], linewidth=2, label=row.title)
    axes.set(xlim=(0, 10), ylim=(0, 1.02), xlabel="time (s)", ylabel="share of starts settled by then")
    axes.set_title("Damping: excess energy under 1 % of its start, for good", loc="left", fontsize=11)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="lower right")
    _save(figure, path)


def _label(trial: Trial) -> str:
    if trial.environment_id == ENVIRONMENT_IDS["damping"]:
        return "damping"
    return f"{trial.equilibrium}\nspread {trial.spread:g} m"


def _save(figure: Figure, path: Path) -> None:
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=150))
    plt.close(figure)
