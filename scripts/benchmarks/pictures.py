"""Pictures of what the benchmark found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import Record, number

BLUE, RED, GREY, INK = "#2b6cb0", "#c05621", "#a0aec0", "#2d3748"
FAMILY = ("#2b6cb0", "#c05621", "#2f855a", "#6b46c1", "#b7791f", "#4a5568", "#d53f8c")


def draw(folder: Path, about: Mapping[str, Any], records: Sequence[Record], curves: Mapping[str, Any]) -> list[Path]:
    """Draw what was measured; returns the files.

    Raises:
        ModuleNotFoundError: matplotlib isn't installed.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "font.size": 10, "axes.grid": False})
    figures = {
        "ratios": _ratios(plt, [record for record in records if record.bound and record.unit == "x"]),
        "scaling": _scaling(plt, curves),
        "passive": _passive(plt, curves),
        "parts": _parts(plt, curves),
    }
    files = []
    for name, figure in figures.items():
        if figure is None:
            continue
        figure.get_layout_engine().set(rect=(0, 0.2 / figure.get_figheight(), 1, 1 - 0.2 / figure.get_figheight()))
        figure.text(0.995, 0.004, f"{about['cpu']}, one core", ha="right", va="bottom", fontsize=7, color=GREY)
        files.append(folder / f"{name}.png")
        figure.savefig(files[-1], dpi=150)
        plt.close(figure)
    return files


def _ratios(plt: Any, records: Sequence[Record]) -> Any:
    """Each ratio as a multiple of what it must reach."""
    if not records:
        return None
    figure, axes = plt.subplots(figsize=(9.5, 0.9 + 0.3 * len(records)), layout="constrained")
    for place, record in enumerate(records):
        turned = record.bound == "at most"
        share, low, high = (
            record.target / value if turned else value / record.target
            for value in (record.value, record.high if turned else record.low, record.low if turned else record.high)
        )
        colour = BLUE if record.reached else RED
        axes.barh(place, share - 1, left=1, height=0.62, color=colour)
        axes.plot([low, high], [place, place], color=INK, linewidth=1)
        text = f"{number(record.value)} ({record.bound} {record.target:g})"
        axes.annotate(
            text, (max(share, high, 1), place), xytext=(5, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.axvline(1, color=INK, linewidth=1)
    axes.set_xscale("log")
    axes.set_xlim(right=axes.get_xlim()[1] * 5.0)
    low, high = axes.get_xlim()
    marks = [mark * 10.0**power for power in range(-3, 5) for mark in (1, 2, 5)]
    marks = [mark for mark in marks if low <= mark <= high]
    axes.set_xticks(marks, [f"{mark:g}" for mark in marks])
    axes.set_xticks([], minor=True)
    axes.set_yticks(range(len(records)), [f"{record.what}: {record.beside}" for record in records], fontsize=8)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(records) - 0.4, -0.6)
    axes.set_xlabel("multiple of what must be reached")
    figure.suptitle("Speed beside the peers: medians and quartiles, reached right of the line", fontsize=11)
    return figure


def _scaling(plt: Any, curves: Mapping[str, Any]) -> Any:
    """Time of one step of one environment against their number and against stiffness."""
    if "number" not in curves:
        return None
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), layout="constrained")
    for axes, name, label in (
        (left, "number", "environments in the batch"),
        (right, "stiffness", "stiffness of both springs, N/m"),
    ):
        variants = ((name, "", BLUE), (f"{name}, no episode ending", "no episode ending", RED))
        for key, caption, colour in variants:
            if key in curves:
                curve = curves[key]
                axes.fill_between(curve["x"], curve["low"], curve["high"], color=colour, alpha=0.2, linewidth=0)
                axes.plot(curve["x"], curve["median"], "o-", color=colour, markersize=4, label=caption or None)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel(label)
        axes.grid(alpha=0.25)
    steps = curves["stiffness"]["integration steps"]
    scale = curves["stiffness"]["median"][-1] / steps[-1]
    right.plot(
        curves["stiffness"]["x"],
        [scale * n for n in steps],
        "--",
        color=GREY,
        label="proportional to the integration steps",
    )
    right.legend(frameon=False)
    left.legend(frameon=False)
    left.set_ylabel("µs for one step of one environment")
    left.set_title("A full vector step", loc="left", fontsize=11)
    right.set_title(f"{curves['stiffness']['environments']:,} environments, no episode ending", loc="left", fontsize=11)
    return figure


def _passive(plt: Any, curves: Mapping[str, Any]) -> Any:
    """Time against energy error for each integrator, one panel for each motion."""
    motions = curves.get("passive")
    if not motions:
        return None
    figure, panels = plt.subplots(1, len(motions), figsize=(9.5, 4.0), layout="constrained", sharey=True, squeeze=False)
    for axes, (motion, solvers) in zip(panels[0], motions.items(), strict=True):
        for place, (name, points) in enumerate(solvers["solvers"].items()):
            axes.plot(
                [point["error"] for point in points],
                [point["seconds"] for point in points],
                "o-",
                color=FAMILY[place % len(FAMILY)],
                markersize=4,
                label=name,
            )
        axes.axvline(1e-10, color=INK, linewidth=1, linestyle=":")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.invert_xaxis()
        axes.grid(alpha=0.25)
        axes.set_xlabel("largest relative energy error")
        axes.set_title(f"{motion} motion, {solvers['horizon']:g} s", loc="left", fontsize=11)
    panels[0][0].set_ylabel("seconds")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _parts(plt: Any, curves: Mapping[str, Any]) -> Any:
    """Where the time of a vector step goes."""
    parts = curves.get("parts")
    if not parts:
        return None
    figure, panels = plt.subplots(
        len(parts), 1, figsize=(9.5, 0.9 + 0.95 * len(parts)), layout="constrained", squeeze=False
    )
    for axes, (size, entry) in zip(panels[:, 0], parts.items(), strict=True):
        left = 0.0
        for colour, (name, width) in zip(FAMILY, entry["parts"].items(), strict=False):
            axes.barh(0, max(width, 0.0), left=left, height=0.6, color=colour, label=name)
            left += max(width, 0.0)
        axes.axvline(entry["divider"], color=INK, linewidth=1.5, linestyle=":", label="the divider's limit")
        axes.set_yticks([0], [f"{size} environment{'s' if size != '1' else ''}"])
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(left=0)
    axes.set_xlabel("µs for one step of one environment")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    return figure
