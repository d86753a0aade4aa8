"""Figures of trainings and of comparisons."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env.plots.style import GREY, MARKERS, all_looks, empty_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

CONFIDENCE = 0.95


@styled
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
    figure = empty_figure(3.6)
    axes = figure.subplots()
    for (name, seeds), look in zip(curves.items(), all_looks(), strict=False):
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
    axes.xaxis.set_major_formatter(millions)
    axes.grid(axis="y", alpha=0.25)
    axes.legend()
    return figure


@styled
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
    figure = empty_figure(rows * (0.8 + 0.28 * len(names)), width=max(3.4, 2.3 * columns))
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axes in panels.flat[len(measures) :]:
        axes.set_axis_off()
    for axes, (title, of) in zip(panels.flat, measures.items(), strict=False):
        for place, (name, look, marker) in enumerate(zip(names, all_looks(), itertools.cycle(MARKERS), strict=False)):
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


def millions(steps: float, _: float) -> str:
    """A number of steps on an axis."""
    if steps >= 1e6:
        return f"{steps / 1e6:g} M"
    return f"{steps / 1e3:g} k" if steps else "0"
