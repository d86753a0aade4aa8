"""Figures that a paper could use, of motions, trainings and comparisons, from plain arrays.

Okabe and Ito's colours are told apart with any colour vision; lines differ in their style too, so that a print in
grey can be read. Nothing here touches a display or matplotlib's global state. matplotlib is imported by what draws:

    from spring_pendulum_env import plots
    run = simulate(parameters, state, times)
    motion = plots.Motion("chaotic", run.parameters, run.times, run.states)
    plots.save(plots.energy([motion]), "energy")          # energy.png and energy.svg
"""

from __future__ import annotations

import functools
import io
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.equilibria import energy as energy_of
from spring_pendulum_env.equilibria import full_state
from spring_pendulum_env.physics import Parameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]
P = ParamSpec("P")

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))  # one fewer, so that pairs come again only after thirty
MARKERS = ("o", "s", "^", "D", "v", "X")
MASSES = ("#0072B2", "#E69F00")  # dark and light in a grey print: paths are too tangled for dashes
INK, GREY = "#222222", "#767676"
WIDTH = 6.9  # inches: a page's text in A4
CONFIDENCE = 0.95
SIDES = np.array([-0.52, 0.52])
SMALLEST_ERROR = 1e-17  # drawn for an error of exactly 0, which a log scale has no place for

STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "svg.hashsalt": "spring_pendulum_env",  # the same file each time
    "svg.fonttype": "none",  # letters that can be searched and edited
}


def _styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Lets a function draw in STYLE, and leaves matplotlib as it was."""

    @functools.wraps(draw)
    def styled(*arguments: P.args, **options: P.kwargs) -> Figure:
        with _matplotlib().rc_context(STYLE):
            return draw(*arguments, **options)

    return styled


@dataclass(frozen=True)
class Motion:
    """One motion, of the passive pendulum or of an actuated one.

    Raises ValueError for arrays whose shapes don't go together.
    """

    name: str
    parameters: Parameters
    times: FloatArray
    """Instants, s; shape (n,)."""
    states: FloatArray
    """Positions in m, then velocities in m/s; shape (n, 12), or with the anchor (n, 18)."""
    errors: FloatArray | None = None
    """Energy errors, equation (42), shape (n,); None where nothing drives and nothing drags, so that they follow from
    the energy."""

    def __post_init__(self) -> None:
        n = len(self.times)
        if n < 2 or np.shape(self.states) not in ((n, 12), (n, 18)):
            raise ValueError(f"states of shape {np.shape(self.states)}: must be ({n}, 12) or ({n}, 18), n at least 2")
        if self.errors is not None and np.shape(self.errors) != (n,):
            raise ValueError(f"errors of shape {np.shape(self.errors)}: must be ({n},)")

    @property
    def bodies(self) -> FloatArray:
        """Positions, then velocities of anchor, m1 and m2; shape (n, 2, 3 bodies, 3 axes)."""
        return full_state(self.states).reshape(-1, 2, 3, 3)

    @property
    def energy(self) -> FloatArray:
        """Kinetic plus potential energy, J; (n,)."""
        return np.asarray(energy_of(self.parameters, self.states))

    @property
    def energy_errors(self) -> FloatArray:
        """Equation (42) between the first and each instant; (n,)."""
        if self.errors is not None:
            return np.asarray(self.errors)
        energies = self.energy
        return np.asarray(physics.energy_error(energies - energies[0], energies[0]))

    def springs(self) -> tuple[FloatArray, FloatArray]:
        """Vectors of both springs, m, and their rates, m/s; each of shape (n, 2, 3)."""
        along = np.diff(self.bodies, axis=2)
        return along[:, 0], along[:, 1]

    @property
    def lengths(self) -> FloatArray:
        """Of both springs, m; (n, 2)."""
        return np.asarray(physics.length(*np.moveaxis(self.springs()[0], -1, 0)))


@_styled
def energy(motions: Sequence[Motion]) -> Figure:
    """Energy, and below it the energy error, against time."""
    figure = _figure(4.2)
    above, below = figure.subplots(2, 1, sharex=True)
    for motion, look in _looks(motions):
        above.plot(motion.times, motion.energy, label=motion.name, **look)
        below.plot(motion.times[1:], np.maximum(motion.energy_errors[1:], SMALLEST_ERROR), **look)
    above.set(ylabel="energy (J)")
    above.margins(x=0)
    low, high = above.get_ylim()
    if high - low < 1e-3 * max(abs(low), abs(high)):  # a flat line says it best without an offset on the axis
        middle = (low + high) / 2
        above.set_ylim(middle - 0.05 * abs(middle) - 1e-9, middle + 0.05 * abs(middle) + 1e-9)
    below.set(yscale="log", xlabel="time (s)", ylabel="energy error (42)")
    _legend(above, motions)
    return figure


@_styled
def spring_lengths(motions: Sequence[Motion]) -> Figure:
    """Lengths of spring 1, and below it of spring 2, against time; dotted: unstretched."""
    figure = _figure(4.2)
    panels = figure.subplots(2, 1, sharex=True)
    for number, axes in enumerate(panels):
        for motion, look in _looks(motions):
            axes.plot(motion.times, motion.lengths[:, number], label=motion.name, **look)
        for natural in {(motion.parameters.L1, motion.parameters.L2)[number] for motion in motions}:
            axes.axhline(natural, color=GREY, linewidth=0.8, linestyle=":", zorder=0)
        axes.set(ylabel=f"spring {number + 1} (m)")
        axes.margins(x=0)
    panels[1].set(xlabel="time (s)")
    _legend(panels[0], motions)
    return figure


@_styled
def paths(motion: Motion) -> Figure:
    """Paths of both masses, and of an anchor that moves: in space, and seen from the front, the side and above."""
    figure = _figure(6.9)
    grid = figure.add_gridspec(2, 2)
    space: Any = figure.add_subplot(grid[0, 0], projection="3d")
    places = motion.bodies[:, 0]
    moving = [number for number in range(3) if number or np.ptp(places[:, 0], axis=0).max() > 0.0]
    names, colours = ("anchor", "mass 1", "mass 2"), (INK, *MASSES)
    low, high = places[:, moving].min(axis=(0, 1)), places[:, moving].max(axis=(0, 1))
    middle, half = (low + high) / 2, 0.56 * float((high - low).max()) + 1e-6  # one scale for all views
    views = ((0, 2, grid[0, 1]), (1, 2, grid[1, 1]), (0, 1, grid[1, 0]))
    flat = [(across, up, figure.add_subplot(place)) for across, up, place in views]
    for number in moving:
        track = places[:, number]
        look: dict[str, Any] = {"color": colours[number], "linewidth": 0.9}
        space.plot(*track.T, label=names[number], **look)
        for across, up, axes in flat:
            axes.plot(track[:, across], track[:, up], **look)
            axes.plot(*track[0, [across, up]], "o", color=colours[number], markerfacecolor="white", markersize=5)
            axes.plot(*track[-1, [across, up]], "o", color=colours[number], markersize=5)
    for across, up, axes in flat:
        axes.set(xlabel=f"{'xyz'[across]} (m)", ylabel=f"{'xyz'[up]} (m)")
        axes.set_xlim(middle[across] - half, middle[across] + half)
        axes.set_ylim(middle[up] - half, middle[up] + half)
        axes.set_aspect("equal")
    space.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    wide = np.maximum(high - low, 0.9 * half)
    space.set(xlim=middle[0] + wide[0] * SIDES, ylim=middle[1] + wide[1] * SIDES, zlim=middle[2] + wide[2] * SIDES)
    space.set_box_aspect(wide, zoom=0.78)
    for axis in (space.xaxis, space.yaxis, space.zaxis):
        axis.set_major_locator(_ticks(3))
        axis.pane.set_facecolor("white")
    space.view_init(elev=18, azim=-60)
    figure.suptitle(f"{motion.name}: open where it begins, filled where it ends", x=0.01, ha="left", fontsize=10)
    figure.legend(*space.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@_styled
def phase_portraits(motion: Motion) -> Figure:
    """Of both springs: the length against its rate, and the angle from hanging down against its rate."""
    figure = _figure(5.4)
    panels = figure.subplots(2, 2)
    along, rates = motion.springs()
    for number in range(2):
        d, v = along[:, number], rates[:, number]
        length, aside = motion.lengths[:, number], np.hypot(d[:, 0], d[:, 1])
        with np.errstate(invalid="ignore", divide="ignore"):  # no rate in a point, no turn on the vertical
            stretching = (d * v).sum(axis=1) / length
            angle = np.arctan2(aside, -d[:, 2])
            outwards = (d[:, 0] * v[:, 0] + d[:, 1] * v[:, 1]) / aside
            turning = (aside * v[:, 2] - d[:, 2] * outwards) / length**2
        for axes, x, y in ((panels[0, number], length, stretching), (panels[1, number], angle, turning)):
            axes.plot(x, y, color=MASSES[number], linewidth=0.7)
            axes.plot(x[0], y[0], "o", color=MASSES[number], markerfacecolor="white", markersize=5)
            axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)
        panels[0, number].set(xlabel=f"length of spring {number + 1} (m)", ylabel="its rate (m/s)")
        panels[1, number].set(xlabel=f"angle of spring {number + 1} from hanging (rad)", ylabel="its rate (rad/s)")
    figure.suptitle(f"{motion.name}: open where it begins", x=0.01, ha="left", fontsize=10)
    return figure


@_styled
def learning_curves(
    curves: Mapping[str, Sequence[tuple[ArrayLike, ArrayLike]]], quantity: str = "return of an episode"
) -> Figure:
    """What is learned against environment steps, a line for each algorithm or task.

    With several seeds: their mean, and as a band its 95 % interval by Student's t. With one: its values as they are,
    faint, and their running mean over a twentieth of the training.

    Args:
        curves: by name, for each seed the steps, increasing, and the values at them, both of shape (n,).
        quantity: what the values are, with its unit.

    Raises:
        ValueError: a curve without a seed, or steps and values that don't go together.
    """
    figure = _figure(3.6)
    axes = figure.subplots()
    for (name, seeds), look in zip(curves.items(), _all_looks(), strict=False):
        runs = [_curve(name, *seed) for seed in seeds]
        if not runs:
            raise ValueError(f"curves[{name!r}]: must hold at least one seed")
        if len(runs) == 1:
            steps, values = runs[0]
            axes.plot(steps, values, color=look["color"], alpha=0.25, linewidth=0.7)
            axes.plot(steps, _running_mean(values, max(1, len(values) // 20)), label=name, **look)
        else:
            from scipy.stats import t

            grid = np.linspace(max(s[0] for s, _ in runs), min(s[-1] for s, _ in runs), 200)
            stack = np.array([np.interp(grid, *run) for run in runs])
            half = t.ppf((1 + CONFIDENCE) / 2, len(runs) - 1) * stack.std(axis=0, ddof=1) / len(runs) ** 0.5
            middle = stack.mean(axis=0)
            axes.fill_between(grid, middle - half, middle + half, color=look["color"], alpha=0.2, linewidth=0)
            axes.plot(grid, middle, label=f"{name}, {len(runs)} seeds", **look)
    axes.set(xlabel="environment steps", ylabel=quantity)
    axes.set_xlim(left=0)
    axes.xaxis.set_major_formatter(_millions)
    axes.grid(axis="y", alpha=0.25)
    axes.legend()
    return figure


@_styled
def comparison(measures: Mapping[str, Mapping[str, tuple[float, float, float]]]) -> Figure:
    """Controllers beside each other, a panel for each measure: a value with its interval.

    Args:
        measures: by the measure's title, with its unit, and then by controller: the value, and the low and the high
            end of its interval. inf stands for "not reached".

    Raises:
        ValueError: no measure.
    """
    if not measures:
        raise ValueError("measures is empty: must hold at least one measure")
    names = list(dict.fromkeys(name for of in measures.values() for name in of))
    columns = min(len(measures), 3)
    rows = -(-len(measures) // columns)
    figure = _figure(rows * (0.8 + 0.28 * len(names)), width=max(3.4, 2.3 * columns))
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axes in panels.flat[len(measures) :]:
        axes.set_axis_off()
    for axes, (title, of) in zip(panels.flat, measures.items(), strict=False):
        for place, (name, look, marker) in enumerate(zip(names, _all_looks(), itertools.cycle(MARKERS), strict=False)):
            value, low, high = of.get(name, (np.nan, np.nan, np.nan))
            if np.isinf(value):
                axes.text(0.5, place, "not reached", transform=axes.get_yaxis_transform(),
                          ha="center", va="center", fontsize=8, color=GREY)  # fmt: skip
                continue
            ends = [[max(value - low, 0.0)], [max(high - value, 0.0) if np.isfinite(high) else 0.0]]
            axes.errorbar(
                value, place, xerr=ends, fmt=marker, color=look["color"], markersize=5, capsize=2.5, clip_on=False
            )
            if np.isinf(high):  # its interval has no end
                axes.annotate("", (1.0, place), (value, place), xycoords=axes.get_yaxis_transform(), textcoords="data",
                              arrowprops={"arrowstyle": "->", "color": look["color"]})  # fmt: skip
        axes.set_xlabel(title)
        axes.set_xlim(left=0.0)
        axes.margins(x=0.15)
        axes.grid(axis="x", alpha=0.25)
        axes.tick_params(axis="y", length=0)
    panels[0, 0].set_yticks(range(len(names)), names)
    panels[0, 0].set_ylim(len(names) - 0.5, -0.5)
    return figure


def save(figure: Figure, path: str | Path) -> list[Path]:
    """Write a figure as PNG, 200 dots per inch, and as SVG; the same figure gives the same bits.

    Args:
        figure: from one of the functions here.
        path: without a suffix; its folder is made.

    Returns:
        The files.

    Raises:
        OSError: they can't be written.
    """
    matplotlib = _matplotlib()
    files = []
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        drawn = io.BytesIO()
        with matplotlib.rc_context(STYLE):
            figure.savefig(drawn, format=kind, dpi=200, metadata=metadata)
        file = Path(f"{path}.{kind}")
        file.write_bytes(drawn.getvalue())
        files.append(file)
    return files


def _matplotlib() -> Any:
    try:
        import matplotlib
        import matplotlib.figure
    except ImportError:
        hint = 'figures need matplotlib: pip install "spring-pendulum-env[plot]"'
        raise gym.error.DependencyNotInstalled(hint) from None
    return matplotlib


def _figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure, sizes in inches; without pyplot, so that nobody has to close it."""
    figure: Figure = _matplotlib().figure.Figure(figsize=(width, height), layout="constrained")
    return figure


def _all_looks() -> Iterator[dict[str, Any]]:
    """Colour and style of one line after the other."""
    for colour, style in zip(itertools.cycle(COLOURS), itertools.cycle(STYLES), strict=False):
        yield {"color": colour, "linestyle": style}


def _looks(motions: Sequence[Motion]) -> Iterator[tuple[Motion, dict[str, Any]]]:
    if not motions:
        raise ValueError("motions is empty: must hold at least one motion")
    return zip(motions, _all_looks(), strict=False)


def _legend(axes: Axes, motions: Sequence[Motion]) -> None:
    """Names above the axes; a single one is a title."""
    if len(motions) == 1:
        axes.set_title(motions[0].name)
    else:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)


def _curve(name: str, steps: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    x, y = np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape or x.size < 2 or (np.diff(x) <= 0).any():
        raise ValueError(
            f"curves[{name!r}] with steps of shape {x.shape} and values of shape {y.shape}: must be the same (n,), "
            "n at least 2, steps increasing"
        )
    return x, y


def _running_mean(values: FloatArray, count: int) -> FloatArray:
    """Of `count` values about each, fewer at the ends."""
    sums = np.cumsum(np.insert(values, 0, 0.0))
    places = np.arange(len(values))
    starts, ends = np.maximum(places - count // 2, 0), np.minimum(places + count // 2 + 1, len(values))
    means: FloatArray = (sums[ends] - sums[starts]) / (ends - starts)
    return means


def _ticks(most: int) -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(most)


def _millions(steps: float, _: float) -> str:
    """A number of steps on an axis."""
    if steps >= 1e6:
        return f"{steps / 1e6:g} M"
    return f"{steps / 1e3:g} k" if steps else "0"
