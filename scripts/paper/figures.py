"""The paper's figures 3 to 9, and two that it should have had. Drawn off screen, as PNG and SVG."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray
from PIL import Image

from agents.files import write_atomically
from paper import measures
from paper.config import Motion
from paper.printed import FIGURE_9_X, FIGURE_9_Z
from paper.runs import Runs
from spring_pendulum_env import equilibrium, simulate
from spring_pendulum_env.simulation import Trajectory

FloatArray = NDArray[np.float64]

# Okabe and Ito's palette, told apart with any colour vision.
MASS_1, MASS_2, START, INK, GREY = "#0072B2", "#D55E00", "#C00000", "#222222", "#8A8A8A"
GREEN, PINK, ORANGE, SKY = "#009E73", "#CC79A7", "#E69F00", "#56B4E9"

DOTS = 200
"""Per inch, in a PNG and in what an SVG holds as dots."""

STYLE: Any = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "svg.hashsalt": "spring_pendulum_env",  # the same file each time
}


def draw(runs: Runs, name: str, folder: Path, *, svg: bool = True) -> None:
    """Draws one of FIGURES into a folder, as PNG and as SVG.

    The PNG has the 256 colours that come nearest to all that were drawn, by k-means: a third as large, and a colour bar
    shows no bands.
    """
    with plt.rc_context(STYLE):
        figure = FIGURES[name](runs)
        drawn = io.BytesIO()
        figure.savefig(drawn, format="png", dpi=DOTS)
        small = (
            Image.open(drawn).convert("RGB").quantize(256, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
        )
        write_atomically(
            folder / f"{name}.png", lambda file: small.save(file, format="png", optimize=True, dpi=(DOTS, DOTS))
        )
        if svg:
            write_atomically(
                folder / f"{name}.svg",
                lambda file: figure.savefig(file, format="svg", dpi=DOTS, metadata={"Date": None}),
            )
        plt.close(figure)


def figure_3(runs: Runs) -> Figure:
    return _spin(runs, runs.spinning, runs.config.spinning.rtol, "Figure 3")


def figure_4(runs: Runs) -> Figure:
    return _spin(runs, runs.spinning_finer, runs.config.spinning.finer_rtol, "Figure 4")


def _spin(runs: Runs, run: Trajectory, rtol: float, name: str) -> Figure:
    """Path of mass 1 in the plane of the spin, its colour the time, and the circle that it should keep touching."""
    figure, axes = plt.subplots(figsize=(5.9, 5.2), layout="constrained")
    x, y = run.states[:, 0], run.states[:, 1]
    widest = runs.spinning_extremes.longest.max() / 2
    angle = np.linspace(0, 2 * np.pi, 361)
    axes.plot(widest * np.cos(angle), widest * np.sin(angle), color=GREY, linewidth=1, linestyle="--")
    axes.annotate(
        "greatest distance\nof the exact motion",
        (widest * np.cos(0.8), widest * np.sin(0.8)),
        xytext=(4, 6), textcoords="offset points", fontsize=8, color="#555555",
    )  # fmt: skip
    path = np.stack([x, y], axis=1)
    line = LineCollection(list(np.stack([path[:-1], path[1:]], axis=1)), cmap="cividis", linewidth=0.8)
    line.set_array(run.times[:-1])
    line.set_rasterized(True)
    axes.add_collection(line)
    axes.plot(x[0], y[0], "o", color=START, markersize=8, zorder=3)
    axes.annotate("start", (x[0], y[0]), xytext=(-4, -18), textcoords="offset points", ha="right", color=START)
    axes.set(xlim=(-7.6, 7.6), ylim=(-7.3, 7.3), aspect="equal", xlabel="$X_1$ (m)", ylabel="$Y_1$ (m)")
    axes.set_title(
        f"{name}: two masses joined by a spring, ode45 at a relative\ntolerance of {rtol:g}; "
        f"energy error {100 * run.energy_error:.2f} % after {run.times[-1]:g} s"
    )
    figure.colorbar(line, ax=axes, label="time (s)", shrink=0.8)
    return figure


def figure_5(runs: Runs) -> Figure:
    """Paths of both masses, in space and seen from the side, square to where they spread most."""
    run = runs.chaotic
    figure = plt.figure(figsize=(10.2, 4.3))
    grid = figure.add_gridspec(1, 2, width_ratios=(1.05, 1), left=0.01, right=0.985, bottom=0.2, top=0.92, wspace=0.3)
    space: Any = figure.add_subplot(grid[0], projection="3d")
    for name, colour, first in (("mass 1", MASS_1, 0), ("mass 2", MASS_2, 3)):
        x, y, z = run.states[:, first : first + 3].T
        space.plot(x, y, z, color=colour, linewidth=1.2, label=name)
        space.scatter(x[0], y[0], z[0], color=START, s=36, depthshade=False)
    space.scatter(0, 0, 0, color=INK, marker="^", s=40, depthshade=False, label="anchor")
    space.set(xlabel="$X$ (m)", ylabel="$Y$ (m)", zlabel="$Z$ (m)")
    for axis in (space.xaxis, space.yaxis, space.zaxis):
        axis.set_major_locator(MultipleLocator(10))
    space.set_box_aspect(np.ptp(run.states[:, [0, 1, 2]], axis=0) + np.ptp(run.states[:, 3:6], axis=0), zoom=1.28)
    space.view_init(elev=20, azim=-40)
    side = figure.add_subplot(grid[1])
    along = np.linalg.svd(np.concatenate([run.states[:, 0:2], run.states[:, 3:5]]), full_matrices=False)[2][0]
    along *= np.sign(along.sum())
    for colour, first in ((MASS_1, 0), (MASS_2, 3)):
        x, z = run.states[:, first : first + 2] @ along, run.states[:, first + 2]
        side.plot(x, z, color=colour, linewidth=1.2)
        side.plot(x[0], z[0], "o", color=START, markersize=6, zorder=3)
    side.plot(0, 0, "^", color=INK, markersize=7)
    side.set(xlabel=f"distance along ({along[0]:.2f}, {along[1]:.2f}, 0) (m)", ylabel="$Z$ (m)", aspect="equal")
    handles, labels = space.get_legend_handles_labels()
    handles.append(Line2D([], [], marker="o", linestyle="", color=START))
    figure.legend(handles, [*labels, "start"], loc="lower center", ncols=4)
    figure.suptitle(
        f"Figure 5: position of the masses, a chaotic motion of {run.times[-1]:g} s "
        f"(ode45, relative tolerance {runs.config.chaotic.rtol:g})",
        x=0.01, y=0.985, ha="left", fontsize=11,
    )  # fmt: skip
    return figure


def _paths(axes: Axes, run: Trajectory, masses: int = 2) -> None:
    """Paths of the masses seen along y."""
    for mass, colour in enumerate((MASS_1, MASS_2)[:masses]):
        x, y = run.states[:, 3 * mass], run.states[:, 3 * mass + 2]
        axes.plot(x, y, color=colour, linewidth=1.2, label=f"mass {mass + 1}")
        axes.plot(x[0], y[0], "o", color=START, markersize=6, zorder=3)
    axes.plot(0, 0, "^", color=INK, markersize=7, label="anchor")
    index = "_1" if masses == 1 else ""
    axes.set(xlabel=f"$X{index}$ (m)", ylabel=f"$Z{index}$ (m)", aspect="equal")


def figure_6(runs: Runs) -> Figure:
    return _energy(
        runs.chaotic, runs.config.chaotic, "Figure 6: total energy of Figure 5's motion, which should be constant"
    )


def figure_7(runs: Runs) -> Figure:
    return _energy(
        runs.spinning, runs.config.spinning, "Figure 7: total energy of Figure 3's motion, which should be constant"
    )


def _energy(run: Trajectory, motion: Motion, title: str) -> Figure:
    figure, axes = plt.subplots(figsize=(7.6, 3.9), layout="constrained")
    axes.axhline(run.energy[0], color=GREY, linewidth=1, linestyle="--")
    axes.plot(run.times, run.energy, color=MASS_1, linewidth=1.4)
    axes.set(xlabel="time (s)", ylabel="total energy (J)", xlim=(0, run.times[-1]))
    right = axes.secondary_yaxis(
        "right",
        functions=(
            lambda joule: 100 * (np.asarray(joule) / run.energy[0] - 1),
            lambda per_cent: run.energy[0] * (1 + np.asarray(per_cent) / 100),
        ),
    )
    right.set_ylabel("change (%)")
    axes.text(
        0.03, 0.08,
        f"error at the end {100 * run.energy_error:.4g} %, mean {100 * abs(run.mean_energy_error):.4g} %\n"
        f"ode45, relative tolerance {motion.rtol:g}",
        transform=axes.transAxes, fontsize=9,
    )  # fmt: skip
    axes.set_title(title)
    return figure


def figure_8(runs: Runs) -> Figure:
    """Paths of both masses, with the springs at nine instants of half a period."""
    run, orbit = runs.periodic, runs.periodic_orbit
    figure, axes = plt.subplots(figsize=(6.9, 4.9), layout="constrained")
    exact = simulate(orbit.parameters, orbit.state, np.linspace(0, orbit.period / 2, 9)).states
    for number, state in enumerate(exact):
        label = "springs, 9 instants\nof a half period" if number == 0 else None
        axes.plot([0, state[0], state[3]], [0, state[2], state[5]], color=GREY, linewidth=0.7, alpha=0.8, label=label)
    _paths(axes, run)
    axes.set_title(
        f"Figure 8: position of the masses, a periodic motion,\n{runs.config.periodic.periods} periods of "
        f"{orbit.period:.4f} s on top of each other"
    )
    axes.plot([], [], "o", color=START, label="start")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center")
    return figure


def figure_9(runs: Runs) -> Figure:
    run, orbit = runs.single, runs.single_orbit
    figure, axes = plt.subplots(figsize=(6.2, 4.9), layout="constrained")
    _paths(axes, run, masses=1)
    axes.set(xlim=FIGURE_9_X, ylim=FIGURE_9_Z)
    axes.plot([], [], "o", color=START, label="start, at rest")
    axes.legend(loc="center", bbox_to_anchor=(0.5, 0.55))
    axes.set_title(
        f"Figure 9: one spring, one mass: {runs.config.single.periods} periods of {orbit.period:.3f} s\n"
        "on top of each other, on the axes of the paper"
    )
    return figure


def single_spring(runs: Runs) -> Figure:
    """A section of the energy surface, exponents, and the angle between greatest lengths without gravity."""
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(12.4, 4.3), width_ratios=(1.25, 1, 1), layout="constrained"
    )
    pendulum = runs.config.elastic_pendulum
    shades = iter((MASS_1, GREEN, PINK, SKY, ORANGE, MASS_2, "#8C6BB1"))
    starts = runs.pendulum_starts
    for start in sorted(starts, key=lambda one: not one.chaotic):
        points = start.crossings.states
        colour, size = ("#707070", 0.7) if start.chaotic else (next(shades, INK), 1.6)
        left.plot(points[:, 2], points[:, 8], ".", color=colour, markersize=size, markeredgewidth=0.4, rasterized=True)
    left.set(xlabel="$Z_1$ (m)", ylabel="$Z_1'$ (m/s)")
    left.set_title(f"With gravity, {pendulum.energy:g} J: section at $X_1 = 0$,\ngrey chaotic, coloured regular")

    for start in starts:
        times, values = start.exponent.times, np.abs(start.exponent.convergence)
        middle.plot(times, values, color=GREY if start.chaotic else MASS_1, linewidth=0.8, alpha=0.8)
    times = starts[0].exponent.times
    middle.plot(times, np.log1p(times) / times, color=INK, linestyle="--", linewidth=1.2)
    middle.set(xscale="log", yscale="log", xlabel="time averaged over (s)", ylabel="largest Lyapunov exponent (1/s)")
    middle.set(xlim=(10, times[-1]), ylim=(1e-4, 5))
    for colour, name, style in ((GREY, "chaotic", "-"), (MASS_1, "regular", "-"), (INK, "ln(1 + T) / T", "--")):
        middle.plot([], [], color=colour, linestyle=style, label=name)
    middle.legend(loc="upper center", ncols=3, columnspacing=1.0, handlelength=1.2, fontsize=9)
    middle.set_title("The exponents of these motions")

    speeds = [speed for speed, _ in runs.no_gravity]
    turns = [found.turns.mean() / (2 * np.pi) for _, found in runs.no_gravity]
    for share, name in ((1 / 2, "1/2"), (2 / 5, "2/5"), (1 / 3, "1/3"), (1 / 4, "1/4"), (1 / 5, "1/5")):
        right.axhline(share, color=GREY, linewidth=0.8, linestyle=":")
        right.text(max(speeds) * 1.02, share, name, va="center", fontsize=8, color="#555555")
    right.plot(speeds, turns, "o-", color=MASS_1, markersize=4)
    right.set(
        xlabel=f"speed sideways at {runs.config.no_gravity.distance:g} m (m/s)", xlim=(0, max(speeds)), ylim=(0, 0.52)
    )
    right.set(ylabel="turns from one greatest length to the next")
    right.set_title("Without gravity: the orbit closes only\nwhere this is a fraction (dotted: some)")
    figure.suptitle(
        "A single spring and mass without air resistance isn't always periodic", x=0.01, ha="left", fontsize=12
    )
    return figure


def air_resistance(runs: Runs) -> Figure:
    """Lengths of both springs against time, from one start with air resistance, and where they must end."""
    air = runs.config.resistance
    p = air.constants
    start = measures.random_starts(p, 1, air.seed)[0]
    run = simulate(p, start, np.linspace(0, 30, 1501), rtol=1e-9, atol=1e-9)
    lengths = measures.spring_lengths(run.states)
    heights = equilibrium(p, "hanging-hanging")
    rest = -heights[5], heights[5] - heights[8]
    figure, axes = plt.subplots(figsize=(7.6, 3.9), layout="constrained")
    for number, colour in enumerate((MASS_1, MASS_2)):
        axes.plot(run.times, lengths[:, number], color=colour, linewidth=1.1, label=f"spring {number + 1}")
        axes.axhline(rest[number], color=colour, linestyle="--", linewidth=1)
        axes.annotate(
            f"{rest[number]:.4f} m", (1.0, rest[number]), xycoords=("axes fraction", "data"),
            xytext=(4, 0), textcoords="offset points", va="center", fontsize=8, color=colour,
        )  # fmt: skip
    axes.axhline(p.L2, color=GREY, linewidth=1, linestyle=":")
    axes.annotate(
        "unstretched", (1.0, p.L2), xycoords=("axes fraction", "data"),
        xytext=(4, 0), textcoords="offset points", va="center", fontsize=8, color="#555555",
    )  # fmt: skip
    axes.set(xlabel="time (s)", ylabel="length of the spring (m)", xlim=(0, run.times[-1]))
    axes.legend(loc="upper right", ncols=2)
    axes.set_title(f"With air resistance (R = {p.R1:g} kg/s) the springs end stretched by the weight they carry")
    return figure


FIGURES: Mapping[str, Callable[[Runs], Figure]] = {
    "figure-3": figure_3,
    "figure-4": figure_4,
    "figure-5": figure_5,
    "figure-6": figure_6,
    "figure-7": figure_7,
    "figure-8": figure_8,
    "figure-9": figure_9,
    "single-spring": single_spring,
    "air-resistance": air_resistance,
}
