"""Pictures of an evaluation. All are drawn off screen and written as PNG or GIF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from agents import tables
from agents.evaluation import Evaluation
from agents.files import write_atomically
from agents.measures import SETTLED_SHARE, measures_of
from agents.statistics import estimate
from spring_pendulum_env import plots as figures

Array = NDArray[np.float64]

# Of the palette of all figures the third is grey: it is for doing nothing.
COLOURS = (*figures.COLOURS[:2], "#666666", *figures.COLOURS[2:5])
STYLES = ("-", "--", ":", "-.", "-", "--")
MASS_COLOURS = ("#D55E00", "#0072B2")
FLOOR = 1e-5  # of the excess energy at the start; below it is nothing to see
FRAMES_PER_SECOND = 12.5
TRAIL = 25  # control periods
FORCE_SCALE = 20.0  # N that are drawn a metre long


def plot_energy(evaluations: Sequence[Evaluation], path: Path) -> None:
    """Excess energy over that at the start against time, log scale: median over starts, quartiles as a band."""
    figure, axes = plt.subplots(figsize=(8, 4.8), layout="constrained")
    for evaluation, colour, style in zip(evaluations, COLOURS, STYLES, strict=False):
        episodes = evaluation.episodes
        ratio = episodes.excess_energy / episodes.excess_energy[:, :1]
        for row, length in zip(ratio, episodes.lengths, strict=True):
            row[length + 1 :] = row[length]  # an episode that ended early stays where it was
        low, median, high = np.maximum(
            np.quantile(ratio, [0.25, 0.5, 0.75], axis=0), FLOOR / 100
        )  # none is quite zero or, by rounding, less
        axes.fill_between(episodes.times, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(episodes.times, median, color=colour, linestyle=style, linewidth=2, label=evaluation.controller)
    axes.axhline(SETTLED_SHARE, color="black", linewidth=0.8)
    axes.text(0.01, SETTLED_SHARE, "settled: 1 %", transform=axes.get_yaxis_transform(), va="bottom", fontsize=9)
    axes.set(yscale="log", ylim=(FLOOR, None), xlim=(0, evaluations[0].episodes.times[-1]))
    axes.set(xlabel="time (s)", ylabel="excess energy / excess energy at the start")
    count = len(evaluations[0].episodes.lengths)
    axes.set_title(f"Excess energy, {count} unseen starts: median, and quartiles as a band", loc="left", fontsize=11)
    axes.grid(which="major", alpha=0.3)
    axes.legend(frameon=False)
    _save(figure, path)


def plot_paths(evaluations: Sequence[Evaluation], path: Path, start: int = 0) -> None:
    """Paths of anchor and masses from one start, seen from the side (x, z) and from above (x, y), a column for each."""
    tracks = [_positions(evaluation, start) for evaluation in evaluations]
    low, high = _limits(tracks)
    width, depth, height = (high - low) * min(1.6, 3.4 / (high[0] - low[0]))  # inches
    size = (len(tracks) * (width + 0.3) + 0.6, height + depth + 1.6)
    figure, grid = plt.subplots(
        2, len(tracks), figsize=size, height_ratios=(height, depth), layout="constrained", squeeze=False
    )
    for column, (evaluation, track) in enumerate(zip(evaluations, tracks, strict=True)):
        for axes, vertical in zip(grid[:, column], (2, 1), strict=True):
            axes.plot(track[:, 0, 0], track[:, 0, vertical], color="black", linewidth=1.2, label="anchor")
            for mass, colour in enumerate(MASS_COLOURS, start=1):
                x, y = track[:, mass, 0], track[:, mass, vertical]
                axes.plot(x, y, color=colour, linewidth=0.9, alpha=0.8, label=f"mass {mass}")
                axes.plot(x[0], y[0], "o", color=colour, markersize=6, markerfacecolor="white")
                axes.plot(x[-1], y[-1], "o", color=colour, markersize=6)
            axes.set(xlim=(low[0], high[0]), ylim=(low[vertical], high[vertical]))
            axes.set_aspect("equal")
            axes.grid(alpha=0.3)
            if column:
                axes.tick_params(labelleft=False)
        grid[0, column].set_title(_title(evaluation, start), fontsize=11)
        grid[1, column].set_xlabel("x (m)")
    grid[0, 0].set_ylabel("from the side: z (m)")
    grid[1, 0].set_ylabel("from above: y (m)")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle("One start: open where it begins, filled where it ends", fontsize=11)
    _save(figure, path)


def plot_comparison(evaluations: Sequence[Evaluation], environment_id: str, path: Path) -> None:
    """Shares and medians of all measures with their 95 % intervals, the controllers below each other; and as SVG."""
    rows = {
        tables.title(measure).replace("N2", "N$^2$"): {
            e.controller: astuple(estimate(e.values[measure.name], measure.kind)) for e in evaluations
        }
        for measure in measures_of(environment_id).each
    }
    figures.save(figures.comparison(rows), path.with_suffix(""))


def animate(evaluations: Sequence[Evaluation], path: Path, start: int = 0, seconds: float = 8.0) -> None:
    """GIF of the pendulum from one start under each controller, from the side (x, z), and the force on the anchor."""
    times = evaluations[0].episodes.times
    period = times[1] - times[0]
    stride = max(1, round(1 / (FRAMES_PER_SECOND * period)))
    frames = range(0, min(len(times), round(seconds / period) + 1), stride)
    tracks = [_positions(evaluation, start) for evaluation in evaluations]
    low, high = _limits(tracks)
    width, _, height = (high - low) * min(1.0, 3.4 / (high[0] - low[0]))  # inches
    size = (len(tracks) * (width + 0.4) + 0.6, height + 1.2)
    figure, grid = plt.subplots(1, len(tracks), figsize=size, squeeze=False, sharey=True)
    pendulums = []
    for axes, evaluation, track in zip(grid[0], evaluations, tracks, strict=True):
        axes.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]), xlabel="x (m)")
        axes.set_title(_title(evaluation, start), fontsize=9)
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
        pendulums.append(_Pendulum(axes, track, evaluation.episodes.forces[start]))
    grid[0, 0].set_ylabel("z (m)")
    clock = figure.text(0.5, 0.01, "", ha="center", fontsize=10, animated=True)
    figure.tight_layout(rect=(0, 0.05, 1, 0.96))

    # The axes are drawn once, and for each frame only what moves: drawing all of it takes twenty times as long.
    canvas: Any = FigureCanvasAgg(figure)  # matplotlib leaves it untyped
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    images: list[Image.Image] = []
    for frame in frames:
        canvas.restore_region(background)
        clock.set_text(f"{times[frame]:.1f} s")
        for artist in (clock, *(part for pendulum in pendulums for part in pendulum.move(frame))):
            figure.draw_artist(artist)
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    plt.close(figure)
    palette = images[len(images) // 8].quantize(128)  # early on, when everything moves and has its colour
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    duration = round(1000 * stride * period)  # ms, of each frame
    options: dict[str, Any] = {"save_all": True, "append_images": images[1:], "duration": duration, "loop": 0}
    write_atomically(path, lambda file: images[0].save(file, format="GIF", **options))


class _Pendulum:
    """The moving parts of one panel."""

    def __init__(self, axes: Axes, track: Array, forces: Array) -> None:
        self.track = track
        self.forces = forces
        (self.force,) = axes.plot([], [], color="#009E73", linewidth=3, solid_capstyle="butt", animated=True)
        self.trails = [axes.plot([], [], color=c, linewidth=1, alpha=0.5, animated=True)[0] for c in MASS_COLOURS]
        (self.springs,) = axes.plot([], [], color="black", linewidth=1, animated=True)
        (self.anchor,) = axes.plot([], [], "s", color="black", markersize=7, animated=True)
        self.masses = [axes.plot([], [], "o", color=c, markersize=11, animated=True)[0] for c in MASS_COLOURS]

    def move(self, frame: int) -> list[Artist]:
        """Put everything where it is at a control period, and return it in the order of drawing."""
        last = min(frame, len(self.track) - 1)
        now = self.track[last][:, [0, 2]]
        self.springs.set_data(*now.T)
        self.anchor.set_data(*now[:1].T)
        for mass, (dot, trail) in enumerate(zip(self.masses, self.trails, strict=True), start=1):
            dot.set_data(*now[mass : mass + 1].T)
            trail.set_data(*self.track[max(0, last - TRAIL) : last + 1, mass][:, [0, 2]].T)
        force = self.forces[min(last, len(self.track) - 2)][[0, 2]] / FORCE_SCALE
        self.force.set_data(*np.array([now[0], now[0] + force]).T)
        return [*self.trails, self.springs, self.force, self.anchor, *self.masses]


def _positions(evaluation: Evaluation, start: int) -> Array:
    """(steps + 1, 3 bodies, 3 axes), up to the end of the episode, m."""
    last = evaluation.episodes.lengths[start]
    return evaluation.episodes.states[start, : last + 1, :9].reshape(-1, 3, 3)


def _limits(tracks: Sequence[Array]) -> tuple[Array, Array]:
    """What holds all paths, with a margin: lowest and highest x, y and z, m."""
    everything = np.concatenate(tracks)
    return everything.min(axis=(0, 1)) - 0.2, everything.max(axis=(0, 1)) + 0.2


def _title(evaluation: Evaluation, start: int) -> str:
    """Name of the controller, and when the episode ended if that was early."""
    episodes = evaluation.episodes
    end = episodes.times[episodes.lengths[start]]
    return evaluation.controller + (f" (out of bounds at {end:.1f} s)" if episodes.ended_early[start] else "")


def _save(figure: Figure, path: Path) -> None:
    write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=150))
    plt.close(figure)
