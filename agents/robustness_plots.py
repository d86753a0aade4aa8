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
from agents.plots import COLOURS, STYLES
from agents.robustness import SPREAD, SWEEPS, Results
from agents.statistics import Estimate

MARKERS = ("o", "^", "s", "v", "D", "x")


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
            _draw(axes, name, results[name].get(task, {}), _looks(results))
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
        _draw(axes, "spread", of_entries, _looks(results))
        axes.set_title(task, fontsize=10)
    for axes in grid[-1]:
        axes.set_xlabel("spread of the starts (m, m/s)")
    for axes in grid[:, 0]:
        axes.set_ylabel("share recovered")
    _legend(figure, results)
    figure.suptitle("Region of recovery, with 95 % intervals", fontsize=11)
    _save(figure, path)


def _looks(results: Results) -> dict[str, int]:
    """A number for each entry's looks."""
    titles = dict.fromkeys(t for of_tasks in results.values() for of_entries in of_tasks.values() for t in of_entries)
    return {title: number % len(COLOURS) for number, title in enumerate(titles)}


def _draw(axes: Axes, name: str, of_entries: dict[str, list[Estimate]], looks: dict[str, int]) -> None:
    values = SWEEPS[name].scale * np.array(SWEEPS[name].values)
    for title, found in of_entries.items():
        look = looks[title]
        low, value, high = (np.array([getattr(one, part) for one in found]) for part in ("low", "value", "high"))
        axes.fill_between(values, low, high, color=COLOURS[look], alpha=0.15, linewidth=0)
        axes.plot(
            values, value, color=COLOURS[look], linestyle=STYLES[look], marker=MARKERS[look], markersize=4, label=title
        )
    axes.set(ylim=(-0.03, 1.03), xlim=(values[0], values[-1]))
    axes.grid(alpha=0.3)


def _legend(figure: Figure, results: Results) -> None:
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        lines, titles = axes.get_legend_handles_labels()
        handles |= dict(zip(titles, lines, strict=True))
    order = [title for title in _looks(results) if title in handles]
    shown: Any = [handles[title] for title in order]
    figure.legend(shown, order, loc="outside lower center", ncols=4, frameon=False)


def _save(figure: Figure, path: Path) -> None:
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=150))
    plt.close(figure)
