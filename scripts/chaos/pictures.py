"""Pictures of order and chaos."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from agents.files import write_atomically
from agents.plots import COLOURS
from chaos.config import Study
from chaos.study import MOTIONS, Row, squeezing_energy
from spring_pendulum_env import Parameters
from spring_pendulum_env.dynamics import ChaosMap
from spring_pendulum_env.dynamics.megno import THRESHOLD

LABELS = {"plane": "in a vertical plane", "space": "in space"}
MARKERS = {"plane": "o", "space": "s"}
GREY = "#666666"
ORDER = "#bcd9ea"


def draw_map(chart: ChaosMap, title: str, stem: Path, *, duration: float) -> list[Path]:
    """The map as PNG and SVG; returns the files. Order is blue, and chaos coloured by its exponent."""
    figure, axes = plt.subplots(figsize=(7.6, 5.0), layout="constrained")
    degrees = np.degrees(chart.angles)
    floor = 4 * np.log(2) / duration
    chaotic = np.where(chart.chaotic, np.maximum(chart.exponent, floor), np.nan)
    ceiling = max(float(np.nanmax(chaotic)), 2 * floor) if chart.chaotic.any() else 2 * floor
    edges = _edges(degrees), _edges(chart.energies)
    known = np.isfinite(chart.megno)
    axes.set_facecolor("white")
    lost = np.ma.masked_where(~(chart.possible & ~known), np.ones(known.shape))
    order = np.ma.masked_where(~(known & ~chart.chaotic), np.ones(known.shape))
    axes.pcolormesh(*edges, order, cmap=ListedColormap([ORDER]), rasterized=True)
    axes.pcolormesh(*edges, lost, cmap=ListedColormap(["black"]), rasterized=True)
    shown = axes.pcolormesh(
        *edges, np.ma.masked_invalid(chaotic), cmap="YlOrRd", norm=LogNorm(floor, ceiling), rasterized=True
    )
    low = np.where(chart.possible.any(axis=0), chart.possible.argmax(axis=0), len(chart.energies))
    key = [Patch(facecolor=ORDER, label=f"order (mean MEGNO up to {THRESHOLD:g})")]
    if not chart.possible.all():
        axes.fill_between(
            np.repeat(edges[0], 2)[1:-1], edges[1][0], np.repeat(edges[1][low], 2),
            facecolor="#eeeeee", edgecolor="#aaaaaa", hatch="///", linewidth=0,
        )  # fmt: skip
        label = "too little energy to stand still at the angle"
        key.append(Patch(facecolor="#eeeeee", edgecolor="#aaaaaa", hatch="///", label=label))
    if (chart.possible & ~known).any():
        key.append(Patch(facecolor="black", label="too near a spring's zero length to follow"))
    axes.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    axes.set(xlabel="start angle from the downward vertical (degrees)", ylabel="energy above hanging rest (J)")
    axes.set_title(title, loc="left", fontsize=11)
    figure.colorbar(shown, label="chaos: largest Lyapunov exponent (1/s), estimated")
    figure.legend(handles=key, loc="outside lower center", ncols=len(key), frameon=False, fontsize=9)
    return _save(figure, stem)


def draw_study(study: Study, rows: Sequence[Row], stem: Path) -> list[Path]:
    """Share of chaotic starts and their exponents, against energy and against stiffness; returns the files."""
    figure, grid = plt.subplots(
        2, 2, figsize=(9.5, 6.6), layout="constrained", sharex="col", sharey="row", height_ratios=(3, 2)
    )
    p = Parameters.of(study.parameters)
    k, energy = study.energy_panel.stiffness, study.stiffness_panel.energy
    per_stiffness = squeezing_energy(p.replace({"k1": 1.0}))  # J for each N/m
    titles = (f"k1 = k2 = {k:g} N/m", f"{energy:g} J above hanging rest")
    marks = (k * per_stiffness, energy / per_stiffness if per_stiffness else None)
    for column, panel in enumerate(("energy", "stiffness")):
        share, exponent = grid[:, column]
        for motion, colour in zip(MOTIONS, COLOURS, strict=False):
            line = sorted(
                (row for row in rows if (row.panel, row.motion) == (panel, motion)), key=lambda row: getattr(row, panel)
            )
            across = [getattr(row, panel) for row in line]
            shares = np.array([row.share for row in line])
            reach = np.maximum([shares - [row.low for row in line], [row.high for row in line] - shares], 0.0)
            style: dict[str, Any] = {"color": colour, "marker": MARKERS[motion], "markersize": 4.5, "linewidth": 1.4}
            share.errorbar(across, shares, reach, capsize=2.5, label=LABELS[motion], **style)
            share.plot(across, [row.share_halfway for row in line], color=colour, linewidth=1.2, linestyle=":")
            exponent.plot(across, [max(row.median_exponent, 1e-9) for row in line], **style)
        for axes in (share, exponent):
            axes.grid(alpha=0.3)
            if marks[column]:
                axes.axvline(marks[column], color=GREY, linewidth=0.9, linestyle="--")
        if marks[column]:
            share.annotate(
                "energy = k L² / 2", (marks[column], 0.03), xytext=(4, 0), textcoords="offset points",
                color=GREY, fontsize=8,
            )  # fmt: skip
        share.set_title(f"{'ab'[column]}  {titles[column]}", loc="left", fontsize=11)
        exponent.axhline(2 * np.log(2) / study.duration, color=GREY, linewidth=0.9, linestyle=":")
        exponent.set(xscale="log", yscale="log")
    floor = 2 * np.log(2) / study.duration
    grid[1, 0].annotate(
        "what a regular motion shows", (0.98, floor), xycoords=("axes fraction", "data"), xytext=(0, -4),
        textcoords="offset points", ha="right", va="top", color=GREY, fontsize=8,
    )  # fmt: skip
    grid[1, 0].set_ylim(bottom=floor / 4)
    grid[0, 0].set(ylim=(-0.03, 1.05), ylabel="share of chaotic starts")
    grid[1, 0].set(ylabel="median exponent (1/s)", xlabel="energy above hanging rest (J)")
    grid[1, 1].set(xlabel="stiffness of both springs (N/m)")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    handles.append(Line2D([], [], color=GREY, linewidth=1.2, linestyle=":"))
    labels.append(f"the same after {study.duration / 2:g} s")
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.suptitle(
        f"Chaotic after {study.duration:g} s: {study.starts} starts drawn evenly from each energy surface, "
        "with 95 % intervals",
        fontsize=11,
    )
    return _save(figure, stem)


def _edges(centres: Any) -> Any:
    """Where the cells around the centres begin and end."""
    if len(centres) == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middles = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middles[0]], middles, [2 * centres[-1] - middles[-1]]])


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically."""
    write_atomically(path, lambda file: file.write(data))


def _save(figure: Any, stem: Path) -> list[Path]:
    files = []
    for ending in ("png", "svg"):
        files.append(stem.with_suffix(f".{ending}"))
        buffer = io.BytesIO()
        figure.savefig(buffer, format=ending, dpi=120)
        write_bytes(files[-1], buffer.getvalue())
    plt.close(figure)
    return files
