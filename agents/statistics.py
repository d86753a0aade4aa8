"""What is told of many episodes: shares, medians and interquartile means, each with a 95 % interval.

The intervals are those that Agarwal and others, "Deep Reinforcement Learning at the Edge of the Statistical Precipice"
(2021), recommend: a bootstrap that is stratified by task, here with one stratum for each task, and Wilson's interval
for the share of one controller. Their library rliable would bring
old versions of plotting libraries for these few lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

CONFIDENCE = 0.95
RESAMPLES = 2000
_Z = 1.959963984540054  # quantile of the normal distribution for 95 %


@dataclass(frozen=True)
class Estimate:
    """A statistic over episodes with its 95 % interval; inf stands for "not reached"."""

    value: float
    low: float
    high: float


def mean(values: Array) -> Array:
    """Mean along the last axis."""
    return np.asarray(values.mean(axis=-1))


def median(values: Array) -> Array:
    """Median along the last axis. inf counts as larger than all else, so a median over times of which some were not
    reached is right as long as half of them are finite.
    """
    ordered = np.sort(values, axis=-1)
    n = values.shape[-1]
    low, high = ordered[..., (n - 1) // 2], ordered[..., n // 2]
    return np.asarray(np.where(low == high, low, (low + high) / 2))


def interquartile_mean(values: Array) -> Array:
    """Mean of the middle half along the last axis; inf where the middle half holds one."""
    n = values.shape[-1]
    cut = n // 4
    return np.asarray(np.sort(values, axis=-1)[..., cut : n - cut].mean(axis=-1))


Statistic = Callable[[Array], Array]
STATISTICS: dict[str, Statistic] = {"mean": mean, "median": median, "interquartile mean": interquartile_mean}


def wilson(values: ArrayLike) -> Estimate:
    """Share of ones with Wilson's interval (Wilson, J. Amer. Statist. Assoc. 22, 1927)."""
    array = np.asarray(values, dtype=np.float64)
    n = array.size
    share = float(array.mean())
    centre = (share + _Z * _Z / (2 * n)) / (1 + _Z * _Z / n)
    half = _Z / (1 + _Z * _Z / n) * math.sqrt(share * (1 - share) / n + _Z * _Z / (4 * n * n))
    # At the ends the bound is the share itself, but for rounding.
    return Estimate(share, 0.0 if share == 0 else centre - half, 1.0 if share == 1 else centre + half)


def bootstrap(strata: Sequence[ArrayLike], statistic: str, resamples: int = RESAMPLES, seed: int = 0) -> Estimate:
    """A statistic of all values together, with a percentile interval.

    Each stratum (a task) is an array (starts,), or (seeds, starts) where several trainings met the same starts. Within
    each, starts are drawn anew with replacement, and trainings too where there are several: a start that is hard is
    hard for all of them, so one draw of starts serves all. Raises ValueError for an unknown statistic or no values.
    """
    if statistic not in STATISTICS:
        raise ValueError(f"statistic is {statistic!r}; allowed are {', '.join(STATISTICS)}")
    arrays = [np.atleast_2d(np.asarray(stratum, dtype=np.float64)) for stratum in strata]
    if not arrays or any(array.size == 0 for array in arrays):
        raise ValueError("strata has none, or an empty one; allowed are arrays with at least one value")
    compute = STATISTICS[statistic]
    random = np.random.default_rng(seed)
    drawn = []
    for array in arrays:
        seeds, starts = array.shape
        columns = random.integers(0, starts, (resamples, 1, starts))
        rows = random.integers(0, seeds, (resamples, seeds, 1)) if seeds > 1 else np.zeros((resamples, 1, 1), dtype=int)
        drawn.append(array[rows, columns].reshape(resamples, -1))
    results = compute(np.concatenate(drawn, axis=1))
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(results, [tail, 1 - tail], method="nearest")  # others average, and inf - inf is nan
    everything = np.concatenate([array.ravel() for array in arrays])
    return Estimate(float(compute(everything)), float(low), float(high))


def estimate(values: ArrayLike, kind: str, statistic: str = "median") -> Estimate:
    """What a table says of values (starts,) or (seeds, starts): of the kind "share" the mean, else `statistic`.

    Of the share of several seeds the interval is the bootstrap's, but never narrower than Wilson's for as many starts:
    where all succeed, resampling knows no failure.
    """
    array = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if kind != "share":
        return bootstrap([array], statistic)
    if len(array) == 1:
        return wilson(array)
    drawn, least = bootstrap([array], "mean"), wilson(array.mean(axis=0))
    return Estimate(drawn.value, min(drawn.low, least.low), max(drawn.high, least.high))


def paired_difference(first: ArrayLike, second: ArrayLike, statistic: str = "median") -> Estimate:
    """A statistic of first - second on the same starts, (starts,) or (seeds, starts) each; fewer seeds are repeated.

    Where neither was reached (inf and inf) there is no difference.
    """
    one, two = np.atleast_2d(np.asarray(first, dtype=np.float64)), np.atleast_2d(np.asarray(second, dtype=np.float64))
    if one.shape[1] != two.shape[1]:
        raise ValueError(f"first and second hold {one.shape[1]} and {two.shape[1]} starts; allowed are equal numbers")
    if len(one) > 1 and len(two) > 1 and len(one) != len(two):
        two = two.mean(axis=0, keepdims=True)
    with np.errstate(invalid="ignore"):
        difference = one - two
    return bootstrap([np.where(np.isnan(difference), 0.0, difference)], statistic)
