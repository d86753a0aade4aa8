"""A picture of swing-ups: how the pendulum gets up, as a strip of poses, and its energy on the way."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from agents.evaluation import Evaluation
from agents.files import write_atomically
from agents.plots import COLOURS, MASS_COLOURS, STYLES

Array = NDArray[np.float64]

POSES = 11
SECONDS = 4.0  # that the poses are taken from
SPACING = 2.3  # m between them
COILS = 7


def plot_swing_ups(evaluations: Sequence[Evaluation], path: Path) -> None:
    """A strip of poses for each episode (x, z), and below excess energy against time for all of them."""
    count = len(evaluations)
    figure, grid = plt.subplots(
        count + 1, 1, figsize=(10, 2.75 * count + 2.6), layout="constrained", height_ratios=[*[2.75] * count, 2.6]
    )
    for axes, evaluation in zip(grid[:count], evaluations, strict=True):
        _strip(axes, evaluation)
    _energy(grid[-1], evaluations)
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=110))
    plt.close(figure)


def _strip(axes: Axes, evaluation: Evaluation) -> None:
    episodes = evaluation.episodes
    track = episodes.states[0, : episodes.lengths[0] + 1, :9].reshape(-1, 3, 3)[:, :, [0, 2]]
    period = episodes.times[1]
    for pose in range(POSES):
        seconds = pose * SECONDS / (POSES - 1)
        step = min(round(seconds / period), len(track) - 1)
        shift = np.array([pose * SPACING, 0.0])
        bodies = track[step] + shift
        axes.plot([shift[0] - 0.9, shift[0] + 0.9], [0, 0], color="0.85", linewidth=1, zorder=0)
        for mass, colour in enumerate(MASS_COLOURS, start=1):
            trail = track[max(0, step - round(SECONDS / (POSES - 1) / period)) : step + 1, mass] + shift
            axes.plot(*trail.T, color=colour, alpha=0.35, linewidth=1, zorder=1)
        for near, far in itertools.pairwise(bodies):
            axes.plot(*_coil(near, far).T, color="0.35", linewidth=0.8, zorder=2)
        axes.plot(*bodies[0], "s", color="black", markersize=5, zorder=3)
        for body, colour in zip(bodies[1:], MASS_COLOURS, strict=True):
            axes.plot(*body, "o", color=colour, markersize=7, zorder=3)
        axes.text(shift[0], -3.1, f"{seconds:.1f} s", ha="center", va="bottom", fontsize=9)
    axes.set_title(f"{evaluation.controller}: anchor (black), mass 1 (orange), mass 2 (blue)", loc="left", fontsize=10)
    axes.set_aspect("equal")
    axes.set(xlim=(-1.4, (POSES - 1) * SPACING + 1.4), ylim=(-3.2, 2.6))
    axes.axis("off")


def _coil(near: Array, far: Array) -> Array:
    """Corners of a zigzag between two points (2,)."""
    along = far - near
    length = float(np.hypot(*along)) or 1.0
    share = np.linspace(0.0, 1.0, 2 * COILS + 3)
    side = np.zeros(len(share))
    side[2:-2] = 0.09 * (-1.0) ** np.arange(len(share) - 4)
    corners: Array = near + share[:, None] * along + side[:, None] * np.array([-along[1], along[0]]) / length
    return corners


def _energy(axes: Axes, evaluations: Sequence[Evaluation]) -> None:
    for evaluation, colour, style in zip(evaluations, COLOURS, STYLES, strict=False):
        episodes = evaluation.episodes
        last = episodes.lengths[0] + 1
        energy = episodes.excess_energy[0, :last]
        axes.plot(episodes.times[:last], energy, color=colour, linestyle=style, label=evaluation.controller)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.text(0.995, -2.0, "0: upright at rest", transform=axes.get_yaxis_transform(), ha="right", va="top", fontsize=9)
    axes.set(xlabel="time (s)", ylabel="excess energy (J)", xlim=(0, evaluations[0].episodes.times[-1]))
    axes.grid(alpha=0.3)
    if len(evaluations) > 1:
        axes.legend(frameon=False, loc="lower right")
