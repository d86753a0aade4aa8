"""Measuring controllers: the same unseen starts for each, a few numbers for each episode, an interval for each number.

Starts are those of the task's own `reset` with seeds from FIRST_SEED on, which lie beyond all that a training can
have, so no policy has ever been trained on one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import spring_pendulum_env
from agents.config import ENVIRONMENT_IDS
from agents.controller import STATE_SIZE, Controller
from agents.files import write_csv, write_json, write_text
from agents.runs import provenance
from spring_pendulum_env.scenario import Scenario

Array = NDArray[np.float64]

FIRST_SEED = 2**40
SETTLED_SHARE = 0.01  # of the excess energy at the start
MASS_DISTANCE = 0.1  # m from its place relative to the anchor
ANCHOR_DISTANCE = 0.5  # m from the origin
HELD_FOR = 1.0  # s at the end of the episode
CONFIDENCE = 0.95
RESAMPLES = 2000


@dataclass(frozen=True)
class Episodes:
    """n episodes of one task side by side, at most T control periods long; what lies behind an early end is nan.

    times (T + 1,) s; states (n, T + 1, 18) m and m/s; excess_energy (n, T + 1) J; forces (n, T, 3) N;
    equilibria (n, 18), each of the parameters in force; lengths (n,), in control periods; ended_early (n,).
    """

    times: Array
    states: Array
    excess_energy: Array
    forces: Array
    equilibria: Array
    lengths: NDArray[np.int64]
    ended_early: NDArray[np.bool_]


@dataclass(frozen=True)
class Measure:
    """A number for each episode. `statistic` is what is told of many: "share" or "median"."""

    name: str
    unit: str
    statistic: str
    title: str


@dataclass(frozen=True)
class Protocol:
    """How a task is scored: `compute` gives an array (n,) for each of `measures`, by name."""

    measures: tuple[Measure, ...]
    compute: Callable[[Episodes], dict[str, Array]]


@dataclass(frozen=True)
class Estimate:
    """A statistic over episodes with its 95 % interval; inf stands for "not reached"."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Evaluation:
    """What one controller did: its episodes, and by name of the measure one number for each of them."""

    controller: str
    episodes: Episodes
    values: Mapping[str, Array]


def scenario_of(env: gym.Env[Any, Any]) -> Scenario:
    """The arguments in force in an environment made by gym.make, its parameters before any randomising."""
    base: Any = env.unwrapped
    scenario: Scenario = base.scenario
    return scenario


def roll_out(
    controller: Controller, environment_id: str, arguments: Mapping[str, Any], seeds: Sequence[int]
) -> Episodes:
    """Run one episode for each seed, all in lockstep, so that `predict` gets a stack.

    `arguments` are those of gym.make. Rows that have ended stay in the stack, unread, since a controller may keep a
    state for each row.
    """
    envs = [gym.make(environment_id, disable_env_checker=True, **arguments) for _ in seeds]
    try:
        scenario = scenario_of(envs[0])
        spec = envs[0].spec
        if spec is None or spec.max_episode_steps is None:
            raise ValueError(f"environment_id is {environment_id!r}; allowed is a task with a time limit")
        n, steps = len(envs), spec.max_episode_steps
        states = np.full((n, steps + 1, STATE_SIZE), np.nan)
        excess = np.full((n, steps + 1), np.nan)
        forces = np.full((n, steps, 3), np.nan)
        equilibria = np.empty((n, STATE_SIZE))
        lengths = np.full(n, steps)
        ended_early = np.zeros(n, dtype=bool)
        for i, (env, seed) in enumerate(zip(envs, seeds, strict=True)):
            states[i, 0], info = env.reset(seed=seed)
            excess[i, 0] = info["excess_energy"]
            equilibria[i] = spring_pendulum_env.equilibrium(info["parameters"], scenario.equilibrium)

        seen = states[:, 0].copy()
        running = np.ones(n, dtype=bool)
        memory: Any = None
        for step in range(steps):
            actions, memory = controller.predict(seen, memory, np.full(n, step == 0))
            for i in np.flatnonzero(running).tolist():
                seen[i], _, terminated, truncated, info = envs[i].step(actions[i])
                states[i, step + 1] = seen[i]
                excess[i, step + 1] = info["excess_energy"]
                forces[i, step] = info["force"]
                if terminated or truncated:
                    running[i] = False
                    lengths[i] = step + 1
                    ended_early[i] = terminated
            if not running.any():
                break
        times = np.arange(steps + 1, dtype=np.float64) * scenario.control_period
    finally:
        for env in envs:
            env.close()
    return Episodes(times, states, excess, forces, equilibria, lengths, ended_early)


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
    """effort: integral of the squared force, N^2 s, until the episode ended; anchor_travel: largest coordinate, m."""
    period = episodes.times[1] - episodes.times[0]
    return {
        "effort": np.nansum(episodes.forces**2, axis=(1, 2)) * period,
        "anchor_travel": np.nanmax(np.abs(episodes.states[:, :, :3]), axis=(1, 2)),
    }


_COMMON = (
    Measure("effort", "N2 s", "median", "effort"),
    Measure("anchor_travel", "m", "median", "anchor travel"),
)
PROTOCOLS = {
    ENVIRONMENT_IDS["damping"]: Protocol(
        (
            Measure("settled", "", "share", "settled"),
            Measure("settling_time", "s", "median", "settling time"),
            Measure("energy_integral", "s", "median", "energy integral"),
            *_COMMON,
        ),
        damping_values,
    ),
    ENVIRONMENT_IDS["stabilisation"]: Protocol(
        (
            Measure("recovered", "", "share", "recovered"),
            Measure("recovery_time", "s", "median", "recovery time"),
            *_COMMON,
        ),
        stabilisation_values,
    ),
}
"""By registered id."""


def estimate(values: Array, statistic: str) -> Estimate:
    """Share with Wilson's interval, or median with a percentile-bootstrap one (2,000 resamples, fixed seed).

    inf counts as larger than all else, so a median over censored times is right as long as half of them are finite.
    """
    n = len(values)
    if statistic == "share":
        share = float(values.mean())
        z = 1.959963984540054
        centre = (share + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
        # At the ends the bound is the share itself, but for rounding.
        low, high = (0.0 if share == 0 else centre - half), (1.0 if share == 1 else centre + half)
        return Estimate(share, low, high)
    rows = np.random.default_rng(0).integers(0, n, (RESAMPLES, n))
    medians = np.median(values[rows], axis=1)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(medians, [tail, 1 - tail], method="nearest")  # others average, and inf - inf is nan
    return Estimate(float(np.median(values)), float(low), float(high))


def evaluate(
    controllers: Mapping[str, Controller], environment_id: str, arguments: Mapping[str, Any], episodes: int
) -> list[Evaluation]:
    """Score each controller on the same starts. Raises ValueError for a number below 1 or a task without a protocol."""
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}; allowed is a number from 1 on")
    if environment_id not in PROTOCOLS:
        raise ValueError(f"environment_id is {environment_id!r}; allowed are {', '.join(PROTOCOLS)}")
    evaluations = []
    for name, controller in controllers.items():
        rolled = roll_out(controller, environment_id, arguments, range(FIRST_SEED, FIRST_SEED + episodes))
        evaluations.append(Evaluation(name, rolled, PROTOCOLS[environment_id].compute(rolled)))
    return evaluations


def table(evaluations: Sequence[Evaluation], environment_id: str) -> str:
    """Markdown: one row for each controller, each entry a share or a median with its 95 % interval."""
    measures = PROTOCOLS[environment_id].measures
    titles = ["", *(f"{m.title}{f' ({m.unit})' if m.unit else ''}" for m in measures)]
    rows = [[e.controller, *(_entry(e.values[m.name], m.statistic) for m in measures)] for e in evaluations]
    widths = [max(len(row[i]) for row in [titles, *rows]) for i in range(len(titles))]
    head, *lines = (_row(cells, widths) for cells in [titles, *rows])
    return "\n".join([head, "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines])


def _row(cells: Sequence[str], widths: Sequence[int]) -> str:
    return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) + " |"


def _entry(values: Array, statistic: str) -> str:
    found = estimate(values, statistic)
    numbers = (found.value, found.low, found.high)
    value, low, high = (f"{number:.3f}" if statistic == "share" else _digits(number) for number in numbers)
    return f"{value} [{low}, {high}]"


def _digits(number: float) -> str:
    """Three significant digits; a time that was not reached is a dash."""
    if math.isinf(number):
        return "-"
    return f"{number:.0f}" if abs(number) >= 100 else f"{number:#.3g}"


def write_evaluation(
    folder: Path, evaluations: Sequence[Evaluation], environment_id: str, context: Mapping[str, Any]
) -> None:
    """Write table.md, summary.csv, episodes.csv and, with `context` (config, seed), evaluation.json."""
    measures = PROTOCOLS[environment_id].measures
    write_text(folder / "table.md", table(evaluations, environment_id) + "\n")
    summary = []
    for evaluation in evaluations:
        for measure in measures:
            found = estimate(evaluation.values[measure.name], measure.statistic)
            summary.append(
                {
                    "controller": evaluation.controller,
                    "measure": measure.name,
                    "unit": measure.unit,
                    "statistic": measure.statistic,
                    "value": found.value,
                    "low": found.low,
                    "high": found.high,
                    "episodes": len(evaluation.episodes.lengths),
                }
            )
    write_csv(folder / "summary.csv", summary)
    rows = []
    for evaluation in evaluations:
        for i, length in enumerate(evaluation.episodes.lengths):
            row = {"controller": evaluation.controller, "seed": FIRST_SEED + i, "control_periods": int(length)}
            rows.append(row | {m.name: float(evaluation.values[m.name][i]) for m in measures})
    write_csv(folder / "episodes.csv", rows)
    record = {"environment": environment_id, "first_seed": FIRST_SEED, "episodes": len(rows) // len(evaluations)}
    intervals = "95 %: Wilson's for shares, percentile bootstrap for medians; inf: not reached within the episode"
    write_json(folder / "evaluation.json", record | {"intervals": intervals} | dict(context) | provenance())
