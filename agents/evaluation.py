"""The protocol: the same unseen starts for every controller, a few numbers for each episode, saved as they come.

A trial is a task and the spread of its starts, which are those of the task's own `reset` with STARTS seeds from
FIRST_SEED on. These lie beyond all that a training can have, so no policy has ever been trained on one; what classical
controllers are tuned on begins at TUNING_SEED.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.config import ENVIRONMENT_IDS
from agents.controller import STATE_SIZE, Controller
from agents.files import read_arrays, write_arrays, write_csv, write_json, write_text
from agents.measures import Episodes, measures_of
from agents.rollout import roll_out, scenario_for, scenario_of
from agents.runs import provenance
from agents.statistics import estimate
from agents.tables import score_table
from spring_pendulum_env import equilibrium
from spring_pendulum_env.tasks import TASKS

__all__ = [
    "FIRST_SEED",
    "STARTS",
    "TRIALS",
    "TUNING_SEED",
    "Evaluation",
    "Trial",
    "action_time",
    "evaluate",
    "scenario_of",
    "score",
    "table",
    "trial_named",
    "write_evaluation",
]

Array = NDArray[np.float64]

FIRST_SEED = 2**40
TUNING_SEED = 2**41
STARTS = 1000
ACTION_TIME = "action_time"  # s, saved beside the measures


@dataclass(frozen=True)
class Trial:
    """A task and the spread of its starts; `spread` is the standard deviation of each mass's start, m on each axis."""

    name: str
    environment_id: str
    equilibrium: str
    spread: float

    @property
    def arguments(self) -> dict[str, Any]:
        """For gym.make."""
        task = TASKS[self.environment_id]
        scale = {} if self.spread == task.start_displacement else {"start_scale": self.spread / task.start_displacement}
        return ({"equilibrium": self.equilibrium} if task.chooses_equilibrium else {}) | scale


def damping() -> Trial:
    """The damping task as it is."""
    task = TASKS[ENVIRONMENT_IDS["damping"]]
    return Trial("damping", ENVIRONMENT_IDS["damping"], task.equilibrium, task.start_displacement)


def stabilisation(equilibrium_name: str, spread: float) -> Trial:
    """The stabilisation task at an equilibrium, with a spread in m (and, as many, in m/s)."""
    return Trial(f"{equilibrium_name}-{spread:g}", ENVIRONMENT_IDS["stabilisation"], equilibrium_name, spread)


TRIALS = {
    trial.name: trial
    for trial in (
        damping(),
        *(stabilisation("hanging-hanging", spread) for spread in (0.05, 0.1)),
        *(stabilisation("hanging-inverted", spread) for spread in (0.05, 0.1)),
        *(stabilisation("inverted-hanging", spread) for spread in (0.05, 0.1, 0.3)),
        *(stabilisation("inverted-inverted", spread) for spread in (0.05, 0.1)),
    )
}
"""By name: what the leaderboard is made of."""


def trial_named(name: str) -> Trial:
    """A trial of TRIALS; raises ValueError where there is none of that name."""
    if name not in TRIALS:
        raise ValueError(f"trial is {name!r}; allowed are {', '.join(TRIALS)}")
    return TRIALS[name]


@dataclass(frozen=True)
class Evaluation:
    """What one controller did: its episodes, and by name of the measure one number for each of them."""

    controller: str
    episodes: Episodes
    values: Mapping[str, Array]


def evaluate(
    controllers: Mapping[str, Controller], environment_id: str, arguments: Mapping[str, Any], episodes: int
) -> list[Evaluation]:
    """Play each controller on the same starts and keep the episodes, for pictures.

    Raises ValueError for a number below 1 or a task without measures.
    """
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}; allowed is a number from 1 on")
    measures = measures_of(environment_id)
    evaluations = []
    for name, controller in controllers.items():
        rolled = roll_out(controller, environment_id, arguments, seeds_of(episodes))
        evaluations.append(Evaluation(name, rolled, measures.compute(rolled)))
    return evaluations


def seeds_of(episodes: int) -> range:
    """The seeds of so many starts of the protocol."""
    return range(FIRST_SEED, FIRST_SEED + episodes)


def score(
    controller: Controller, environment_id: str, arguments: Mapping[str, Any], path: Path, starts: int = STARTS
) -> dict[str, Array]:
    """The measures of each episode, arrays (starts,), and the time of an action, an array (1,), s.

    They are kept in the .npz at `path`, and read from there where they were measured before: of a controller that acts
    alike, in the same environment, on as many starts.
    """
    mark = fingerprint(controller, environment_id, arguments, starts)
    if path.is_file():
        saved = read_arrays(path)
        if str(saved.pop("fingerprint", "")) == mark:
            return saved
    rolled = roll_out(controller, environment_id, arguments, seeds_of(starts))
    values = measures_of(environment_id).compute(rolled)
    values[ACTION_TIME] = np.array([action_time(controller, rolled.states[0, : rolled.lengths[0]])])
    write_arrays(path, values | {"fingerprint": np.array(mark)})
    return values


def fingerprint(controller: Controller, environment_id: str, arguments: Mapping[str, Any], starts: int) -> str:
    """A text that changes with the way a controller acts, the environment or the starts."""
    scenario = scenario_for(environment_id, arguments)
    rest = equilibrium(scenario.parameters, scenario.equilibrium)
    probes = rest + 0.1 * np.random.default_rng(0).standard_normal((32, STATE_SIZE))
    actions = np.round(controller.predict(probes)[0], 6)
    told = (repr(scenario), FIRST_SEED, starts, actions.tolist())
    return hashlib.sha256(repr(told).encode()).hexdigest()


def action_time(controller: Controller, observations: Array, tries: int = 100) -> float:
    """How long `predict` takes for one observation, s: the median over tries, as someone would use it on one plant."""
    times = []
    memory: Any = None
    for k in range(tries):
        observation = observations[k % len(observations)]
        began = time.perf_counter()
        _, memory = controller.predict(observation, memory)
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def table(evaluations: Sequence[Evaluation], environment_id: str) -> str:
    """Markdown: one row for each controller, each entry a share or a median with its 95 % interval."""
    return score_table({e.controller: e.values for e in evaluations}, measures_of(environment_id).each)


def write_evaluation(
    folder: Path, evaluations: Sequence[Evaluation], environment_id: str, context: Mapping[str, Any]
) -> None:
    """Write table.md, summary.csv, episodes.csv and, with `context` (config, seed), evaluation.json."""
    measures = measures_of(environment_id).each
    write_text(folder / "table.md", table(evaluations, environment_id) + "\n")
    write_csv(folder / "summary.csv", summary_rows({e.controller: e.values for e in evaluations}, environment_id))
    rows = []
    for evaluation in evaluations:
        for i, length in enumerate(evaluation.episodes.lengths):
            row = {"controller": evaluation.controller, "seed": FIRST_SEED + i, "control_periods": int(length)}
            rows.append(row | {m.name: float(evaluation.values[m.name][i]) for m in measures})
    write_csv(folder / "episodes.csv", rows)
    record = {"environment": environment_id, "first_seed": FIRST_SEED, "episodes": len(rows) // len(evaluations)}
    intervals = "95 %: Wilson's for shares, percentile bootstrap for the rest; inf: not reached within the episode"
    write_json(folder / "evaluation.json", record | {"intervals": intervals} | dict(context) | provenance())


def summary_rows(values: Mapping[str, Mapping[str, Array]], environment_id: str) -> list[dict[str, Any]]:
    """All statistics of each controller's measures (those that it has), a mapping of columns for each."""
    rows = []
    for name, of_measure in values.items():
        for measure in measures_of(environment_id).each:
            if measure.name not in of_measure:
                continue
            array = np.atleast_2d(of_measure[measure.name])
            for statistic in ("mean",) if measure.kind == "share" else ("median", "interquartile mean"):
                found = estimate(array, measure.kind, statistic)
                rows.append(
                    {
                        "controller": name,
                        "measure": measure.name,
                        "unit": measure.unit,
                        "statistic": statistic,
                        "value": found.value,
                        "low": found.low,
                        "high": found.high,
                        "trainings": array.shape[0],
                        "episodes": array.shape[1],
                    }
                )
    return rows
