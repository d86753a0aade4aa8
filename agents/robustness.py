"""How much a controller bears: its success against errors of the model, noise, delay, kicks, and wilder starts.

Each sweep makes one thing worse, step by step, from the task as it is; the starts are the protocol's.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.config import ENVIRONMENT_IDS
from agents.disturbances import CALM, Disturbance
from agents.entries import KINDS, Entry, file_name, kind_of
from agents.evaluation import Trial, damping, fingerprint, seeds_of, stabilisation
from agents.files import write_json
from agents.measures import measures_of
from agents.rollout import roll_out, scenario_for
from agents.statistics import Estimate, estimate
from agents.tables import markdown
from spring_pendulum_env import EQUILIBRIA, Parameters

Array = NDArray[np.float64]

STARTS = 300
SPREAD = 0.05  # m, of the stabilisation starts in all sweeps but that of the spread
PARAMETERS_SEED = 5
SLOW = ("nmpc",)
"""Entries that take seconds for an episode: they are played on fewer starts, where it is hardest."""
HARDEST = "inverted-inverted"


@dataclass(frozen=True)
class Sweep:
    """`disturbance(value, trial, starts)` makes the episodes harder; `trial(base, value)` may change their starts."""

    name: str
    title: str
    unit: str
    values: tuple[float, ...]
    disturbance: Callable[[float, Trial, int], Disturbance] = lambda value, trial, starts: CALM  # noqa: ARG005
    trial: Callable[[Trial, float], Trial] = lambda base, value: base  # noqa: ARG005
    scale: float = 1.0
    """What values are multiplied by for a table or a picture, in whose `unit` they then are."""


def wrong_parameters(error: float, trial: Trial, starts: int) -> Disturbance:
    """All constants at once off by up to `error` of their value, drawn evenly for each episode; who steers knows the
    usual ones. The equilibrium that is to be held is that of the true ones.
    """
    usual = scenario_for(trial.environment_id, trial.arguments).parameters
    random = np.random.default_rng(PARAMETERS_SEED)
    factors = 1.0 + error * random.uniform(-1.0, 1.0, (len(Parameters.names()), starts))
    drawn = {name: getattr(usual, name) * factor for name, factor in zip(Parameters.names(), factors, strict=True)}
    return Disturbance(parameters=drawn)


def _delayed(seconds: float, trial: Trial, _: int) -> Disturbance:
    period = scenario_for(trial.environment_id, trial.arguments).control_period
    return Disturbance(delay=round(seconds / period))


SWEEPS = {
    sweep.name: sweep
    for sweep in (
        Sweep(
            "parameters",
            "joint error of all parameters",
            "%",
            (0.0, 0.05, 0.1, 0.15, 0.2, 0.3),
            wrong_parameters,
            scale=100,
        ),
        Sweep(
            "noise",
            "noise of each observation (mm, mm/s)",
            "mm",
            (0.0, 0.002, 0.005, 0.01, 0.02, 0.05),
            lambda value, trial, starts: Disturbance(noise=value),  # noqa: ARG005
            scale=1000,
        ),
        Sweep("delay", "delay of the action", "ms", (0.0, 0.02, 0.04, 0.06), _delayed, scale=1000),
        Sweep(
            "kick",
            "kick to each mass after 2 s",
            "N s",
            (0.0, 0.1, 0.25, 0.5, 1.0, 2.0),
            lambda value, trial, starts: Disturbance(kick=value),  # noqa: ARG005
        ),
        Sweep(
            "spread",
            "spread of the starts (m, m/s)",
            "m",
            (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3),
            trial=lambda base, value: stabilisation(base.equilibrium, value),
        ),
    )
}
"""By name."""

BASES = (damping(), *(stabilisation(name, SPREAD) for name in EQUILIBRIA))


def sweeps_of(base: Trial) -> list[Sweep]:
    """Those that make sense for a task: damping has its spread."""
    stabilising = base.environment_id == ENVIRONMENT_IDS["stabilisation"]
    return [sweep for sweep in SWEEPS.values() if sweep.name != "spread" or stabilising]


def sweep_named(name: str) -> Sweep:
    """A sweep of SWEEPS; raises ValueError where there is none of that name."""
    if name not in SWEEPS:
        raise ValueError(f"sweep is {name!r}; allowed are {', '.join(SWEEPS)}")
    return SWEEPS[name]


def shares(entry: Entry, base: Trial, sweep: Sweep, folder: Path, starts: int = STARTS) -> list[Estimate] | None:
    """The share of starts recovered or settled at each value of a sweep; None where the entry is not for the task.

    Kept in `folder`, value by value, and played again only where the controller or the task has changed.
    """
    path = folder / base.name / f"{sweep.name}-{file_name(entry.name)}.json"
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    results = []
    for value in sweep.values:
        trial = sweep.trial(base, value)
        controllers = entry.controllers(trial)
        if not controllers:
            return None
        successes = []
        for number, controller in enumerate(controllers):
            mark = fingerprint(controller, trial.environment_id, entry.arguments(trial), starts)
            key = f"{value:g}-{number}"
            if known.get(key, {}).get("fingerprint") != mark:
                disturbance = sweep.disturbance(value, trial, starts)
                episodes = roll_out(
                    controller, trial.environment_id, entry.arguments(trial), seeds_of(starts), disturbance
                )
                measures = measures_of(trial.environment_id)
                success = measures.compute(episodes)[measures.success]
                known[key] = {"fingerprint": mark, "success": "".join(str(int(one)) for one in success)}
                write_json(path, known)
            successes.append([float(one) for one in known[key]["success"]])
        results.append(estimate(np.array(successes), "share"))
    return results


Results = dict[str, dict[str, dict[str, list[Estimate]]]]
"""By sweep, task and entry's title, one estimate for each value."""


def collect(
    entries: Sequence[Entry],
    folder: Path,
    *,
    bases: Sequence[Trial] = BASES,
    sweeps: Sequence[Sweep] = tuple(SWEEPS.values()),
    starts: int = STARTS,
    slow_starts: int = 0,
    told: Callable[[str], None] = print,
) -> Results:
    """All shares; `told` hears of each sweep that is done. SLOW entries have `slow_starts`, at the HARDEST."""
    results: Results = {}
    for sweep in sweeps:
        for base in bases:
            if sweep.name not in [each.name for each in sweeps_of(base)]:
                continue
            for entry in entries:
                slow = entry.name in SLOW
                if slow and (slow_starts == 0 or label(base) != HARDEST):
                    continue
                found = shares(entry, base, sweep, folder, slow_starts if slow else starts)
                if found is not None:
                    title = KINDS.get(kind_of(entry.name), entry.title) + (f", {slow_starts} starts" if slow else "")
                    results.setdefault(sweep.name, {}).setdefault(label(base), {})[title] = found
            told(f"done: {sweep.name}, {label(base)}")
    return results


def label(base: Trial) -> str:
    """The task as a table calls it."""
    return "damping" if base.environment_id == ENVIRONMENT_IDS["damping"] else base.equilibrium


def tables(results: Results) -> str:
    """A table for each sweep, with a line for each task and entry."""
    text = []
    for name, of_tasks in results.items():
        sweep = SWEEPS[name]
        lines = [["", "", *(f"{sweep.scale * value:g} {sweep.unit}" for value in sweep.values)]]
        for task, of_entries in of_tasks.items():
            for title, found in of_entries.items():
                lines.append([task, title, *(f"{one.value:.2f}" for one in found)])
        text.append(f"### Success against the {sweep.title}\n\n{markdown(lines)}\n")
    return "\n".join(text)


def rows(results: Results) -> list[dict[str, str | float]]:
    """All numbers with their 95 % intervals, a mapping of columns for each."""
    return [
        {
            "sweep": name,
            "task": task,
            "entry": title,
            "value (SI)": value,
            "share": one.value,
            "low": one.low,
            "high": one.high,
        }
        for name, of_tasks in results.items()
        for task, of_entries in of_tasks.items()
        for title, found in of_entries.items()
        for value, one in zip(SWEEPS[name].values, found, strict=True)
    ]


def from_rows(lines: Iterable[Mapping[str, str]]) -> Results:
    """The results that `rows` told, read again from text."""
    results: Results = {}
    for line in lines:
        of_entries = results.setdefault(line["sweep"], {}).setdefault(line["task"], {})
        of_entries.setdefault(line["entry"], []).append(Estimate(*(float(line[k]) for k in ("share", "low", "high"))))
    return results
