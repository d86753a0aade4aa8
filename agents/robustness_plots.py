"""Pictures of the robustness sweeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.files import write_atomically
from agents.leaderboard import COLUMNS
from agents.leaderboard_plots import LOOKS
from agents.robustness import SPREAD, SWEEPS, Results
from agents.statistics import Estimate

OTHER = (("damper, tuned", "#222222", "P"), ("", "#CC79A7", "D"), ("", "#F0E442", "X"))
"""Name, colour and marker of the damper and of further entries; the others' are those of the leaderboard."""


def plot_sweeps(results: Results, path: Path) -> None:
    """A row for each task and a column for each sweep but that of the spread: share recovered against what disturbs."""
    names = [name for name in results if name != "spread"]
    if not names:
        return
    tasks = list(dict.fromkeys(task for name in names for task in results[name]))
    size = (2.9 * len(names) + 0.8, 1.9 * len(tasks) + 1.1)
    figure, grid = plt.subplots(len(tasks), len(names), figsize=size, layout="constrained", squeeze=False, sharey=True)
    for row, task in zip(grid, tasks, strict=True):
        for axes, name in zip(row, names, strict=True):
            _draw(axes, name, results[name].get(task, {}), results)
            if axes not in grid[-1]:
                axes.tick_params(labelbottom=False)
        row[0].set_ylabel(f"{task}\nshare of starts", fontsize=9)
    for axes, name in zip(grid[-1], names, strict=True):
        unit = "" if "(" in SWEEPS[name].title else f" ({SWEEPS[name].unit})"
        axes.set_xlabel(f"{SWEEPS[name].title}{unit}", fontsize=9)
    _legend(figure, results)
    figure.suptitle(
        f"What each controller bears: share of starts settled (damping) or recovered (spread {SPREAD:g} m)", fontsize=11
    )
    _save(figure, path)


def plot_region(results: Results, path: Path) -> None:
    """A panel for each equilibrium: share recovered against the spread of the starts."""
    of_tasks = results.get("spread", {})
    if not of_tasks:
        return
    figure, grid = plt.subplots(2, 2, figsize=(8.5, 6.2), layout="constrained", sharex=True, sharey=True)
    for axes, (task, of_entries) in zip(grid.ravel(), of_tasks.items(), strict=False):
        _draw(axes, "spread", of_entries, results)
        axes.set_title(task, fontsize=10)
    for axes in grid[-1]:
        axes.set_xlabel("spread of the starts (m, m/s)")
    for axes in grid[:, 0]:
        axes.set_ylabel("share recovered")
    _legend(figure, results)
    figure.suptitle("Region of recovery, with 95 % intervals", fontsize=11)
    _save(figure, path)


def _looks(results: Results) -> dict[str, tuple[str, str, str]]:
    """Name, colour and marker by entry's title."""
    titles = dict.fromkeys(t for of_tasks in results.values() for of_entries in of_tasks.values() for t in of_entries)
    known = {COLUMNS[kind]: look for kind, look in LOOKS.items()}
    looks, others = {}, 0
    for title in titles:
        if title in known:
            looks[title] = known[title]
        elif title.startswith("NMPC"):
            looks[title] = (title, *LOOKS["nmpc"][1:])
        else:
            looks[title] = (title, *OTHER[others % len(OTHER)][1:])
            others += 1
    return looks


def _draw(axes: Axes, name: str, of_entries: dict[str, list[Estimate]], results: Results) -> None:
    """One panel: values at even distances, but for the spread, whose size means something."""
    sweep, looks = SWEEPS[name], _looks(results)
    values = sweep.scale * np.array(sweep.values)
    places = values if name == "spread" else np.arange(len(values))
    for title, found in of_entries.items():
        label, colour, marker = looks[title]
        low, value, high = (np.array([getattr(one, part) for one in found]) for part in ("low", "value", "high"))
        axes.fill_between(places, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(places, value, color=colour, marker=marker, markersize=5, linewidth=1.6, label=label, clip_on=False)
    if name == "spread":
        axes.set_xticks([0.01, 0.05, 0.1, 0.15, 0.2, 0.3])
    else:
        axes.set_xticks(places, [f"{value:g}" for value in values])
    margin = 0.04 * (places[-1] - places[0])
    axes.set(ylim=(-0.03, 1.03), xlim=(places[0] - margin, places[-1] + margin))
    axes.grid(alpha=0.3)


def _legend(figure: Figure, results: Results) -> None:
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        lines, titles = axes.get_legend_handles_labels()
        handles |= dict(zip(titles, lines, strict=True))
    order = [name for name, _, _ in _looks(results).values() if name in handles]
    shown: Any = [handles[name] for name in order]
    figure.legend(shown, order, loc="outside lower center", ncols=3, frameon=False)


def _save(figure: Figure, path: Path) -> None:
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=150))
    plt.close(figure)
