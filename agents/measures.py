"""What is measured of episodes: a few numbers for each, as the protocol defines them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.config import ENVIRONMENT_IDS

Array = NDArray[np.float64]

SETTLED_SHARE = 0.01  # of the excess energy at the start
MASS_DISTANCE = 0.1  # m from its place relative to the anchor
ANCHOR_DISTANCE = 0.5  # m from the origin
HELD_FOR = 1.0  # s at the end of the episode


@dataclass(frozen=True)
class Episodes:
    """n episodes of one task side by side, at most T control periods long; what lies behind an early end is nan.

    times (T + 1,) s; states (n, T + 1, 18) m and m/s; excess_energy (n, T + 1) J; forces (n, T, 3) N; rewards (n, T);
    equilibria (n, 18), each of the parameters in force; lengths (n,), in control periods; ended_early (n,).
    """

    times: Array
    states: Array
    excess_energy: Array
    forces: Array
    rewards: Array
    equilibria: Array
    lengths: NDArray[np.int64]
    ended_early: NDArray[np.bool_]


@dataclass(frozen=True)
class Measure:
    """A number for each episode. `kind` is "share" (0 or 1 for each) or "amount"."""

    name: str
    unit: str
    kind: str
    title: str


@dataclass(frozen=True)
class Measures:
    """How a task is scored: `compute` gives an array (n,) for each of `each`, by name."""

    each: tuple[Measure, ...]
    compute: Callable[[Episodes], dict[str, Array]]

    @property
    def success(self) -> str:
        """Name of the share that says in how many episodes the task was done."""
        return self.each[0].name

    @property
    def time(self) -> str:
        """Name of the time that it took."""
        return self.each[1].name


def settling_times(calm: NDArray[np.bool_], times: Array, ended_early: NDArray[np.bool_]) -> Array:
    """Time (n,) from which on `calm` (n, T + 1) holds until the end; inf where it doesn't, or where it ended early."""
    calm_from_the_end = np.logical_and.accumulate(calm[:, ::-1], axis=1).sum(axis=1)
    first = np.minimum(calm.shape[1] - calm_from_the_end, calm.shape[1] - 1)
    return np.where((calm_from_the_end > 0) & ~ended_early, times[first], np.inf)


def damping_values(episodes: Episodes) -> dict[str, Array]:
    """Settled: not ended early, and excess energy under 1 % of that at the start until the end.

    settling_time: s, inf where unsettled. energy_integral: excess energy over that at the start, integrated, s; where
    an episode ended early, its last value is counted until the time limit, so that failing early is no way to score.
    """
    start = episodes.excess_energy[:, :1]
    if not (start > 0).all():
        raise ValueError(f"a start has an excess energy of {start.min()} J; only positive ones can be damped")
    ratio = episodes.excess_energy / start
    times = settling_times(ratio < SETTLED_SHARE, episodes.times, episodes.ended_early)
    held = ratio.copy()
    for row, length in zip(held, episodes.lengths, strict=True):
        row[length + 1 :] = row[length]
    return {
        "settled": np.isfinite(times).astype(float),
        "settling_time": times,
        "energy_integral": np.asarray(np.trapezoid(held, episodes.times, axis=1)),
        **_common_values(episodes),
    }


def stabilisation_values(episodes: Episodes) -> dict[str, Array]:
    """Recovered: not ended early, and for the last second both masses within 0.1 m of their places relative to the
    anchor and the anchor within 0.5 m of the origin. recovery_time: from when on that holds, s, inf where it doesn't.
    """
    positions = episodes.states[:, :, :9].reshape(*episodes.states.shape[:2], 3, 3)
    anchor = positions[:, :, :1]
    errors = positions - anchor - episodes.equilibria[:, None, :9].reshape(-1, 1, 3, 3)
    near = np.linalg.norm(errors, axis=3).max(axis=2) < MASS_DISTANCE
    near &= np.linalg.norm(anchor[:, :, 0], axis=2) < ANCHOR_DISTANCE
    times = settling_times(near, episodes.times, episodes.ended_early)
    recovered = times <= episodes.times[-1] - HELD_FOR + 1e-9  # the last second's first sample is a rounded sum
    return {
        "recovered": recovered.astype(float),
        "recovery_time": np.where(recovered, times, np.inf),
        **_common_values(episodes),
    }


def _common_values(episodes: Episodes) -> dict[str, Array]:
    """effort: integral of the squared force, N^2 s, until the episode ended; anchor_travel: largest coordinate, m;
    mean_reward: of all control periods until the time limit, those after an early end counting 0.
    """
    period = episodes.times[1] - episodes.times[0]
    return {
        "effort": np.nansum(episodes.forces**2, axis=(1, 2)) * period,
        "anchor_travel": np.nanmax(np.abs(episodes.states[:, :, :3]), axis=(1, 2)),
        "mean_reward": np.nansum(episodes.rewards, axis=1) / episodes.rewards.shape[1],
    }


_COMMON = (
    Measure("effort", "N2 s", "amount", "effort"),
    Measure("anchor_travel", "m", "amount", "anchor travel"),
    Measure("mean_reward", "", "amount", "reward"),
)
MEASURES = {
    ENVIRONMENT_IDS["damping"]: Measures(
        (
            Measure("settled", "", "share", "settled"),
            Measure("settling_time", "s", "amount", "settling time"),
            Measure("energy_integral", "s", "amount", "energy integral"),
            *_COMMON,
        ),
        damping_values,
    ),
    ENVIRONMENT_IDS["stabilisation"]: Measures(
        (
            Measure("recovered", "", "share", "recovered"),
            Measure("recovery_time", "s", "amount", "recovery time"),
            *_COMMON,
        ),
        stabilisation_values,
    ),
    ENVIRONMENT_IDS["swing-up"]: Measures(
        (
            Measure("recovered", "", "share", "swung up"),
            Measure("recovery_time", "s", "amount", "time until up"),
            *_COMMON,
        ),
        stabilisation_values,
    ),
}
"""By registered id."""


def measures_of(environment_id: str) -> Measures:
    """The measures of a registered task. Raises ValueError for a task that has none."""
    if environment_id not in MEASURES:
        raise ValueError(f"environment_id is {environment_id!r}; allowed are {', '.join(MEASURES)}")
    return MEASURES[environment_id]
