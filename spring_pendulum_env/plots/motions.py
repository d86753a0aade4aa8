"""Figures of motions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.equilibria import energy as energy_of
from spring_pendulum_env.equilibria import full_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.plots.style import GREY, INK, MASSES, all_looks, empty_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

SIDES = np.array([-0.52, 0.52])
SMALLEST_ERROR = 1e-17  # drawn for an error of exactly 0, which a log scale has no place for


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


@styled
def energy(motions: Sequence[Motion]) -> Figure:
    """Energy, and below it the energy error, against time."""
    figure = empty_figure(4.2)
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


@styled
def spring_lengths(motions: Sequence[Motion]) -> Figure:
    """Lengths of spring 1, and below it of spring 2, against time; dotted: unstretched."""
    figure = empty_figure(4.2)
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


@styled
def paths(motion: Motion) -> Figure:
    """Paths of both masses, and of an anchor that moves: in space, and seen from the front, the side and above."""
    figure = empty_figure(6.9)
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


@styled
def phase_portraits(motion: Motion) -> Figure:
    """Of both springs: the length against its rate, and the angle from hanging down against its rate."""
    figure = empty_figure(5.4)
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


def _looks(motions: Sequence[Motion]) -> Iterator[tuple[Motion, dict[str, Any]]]:
    if not motions:
        raise ValueError("motions is empty: must hold at least one motion")
    return zip(motions, all_looks(), strict=False)


def _legend(axes: Axes, motions: Sequence[Motion]) -> None:
    """Names above the axes; a single one is a title."""
    if len(motions) == 1:
        axes.set_title(motions[0].name)
    else:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)


def _ticks(most: int) -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(most)
