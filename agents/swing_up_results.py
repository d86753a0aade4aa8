"""Who swings up, and how well: plans, NMPC, learned policies, LQR and nothing on the same unseen starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import saved
from agents.config import ENVIRONMENT_IDS
from agents.controller import Controller
from agents.entries import CLASSICAL, Entry
from agents.evaluation import FIRST_SEED, Evaluation, Trial, score
from agents.files import write_arrays
from agents.measures import measures_of
from agents.rollout import roll_out, scenario_for
from agents.slow import nmpc_finder
from agents.swing_up import SECONDS, PlannedSwingUp
from agents.tables import markdown, score_table
from spring_pendulum_env.tasks import TASKS

Array = NDArray[np.float64]
Row = Mapping[str, float]

_ID = ENVIRONMENT_IDS["swing-up"]
TRIAL = Trial("swing-up", _ID, TASKS[_ID].equilibrium, TASKS[_ID].start_displacement)

DURATIONS = (1.6, 2.0, 3.0, 4.0)  # s
FORCES = (20.0, 10.0, 5.0)  # N
LITTLE = 0.02  # share of the limits that is left where they are sounded
ABOUT = {"what": "episodes; starts are counted from the protocol's first, times are in s, efforts in N2 s, ways in m"}


def planner() -> PlannedSwingUp:
    """The planner for the task as it is."""
    return PlannedSwingUp(scenario_for(TRIAL.environment_id, TRIAL.arguments))


def plan_finder(controller: PlannedSwingUp) -> Callable[[int], Row]:
    """Plays one start along a plan, and returns the measures and what the solver had to do."""
    measures = measures_of(TRIAL.environment_id)

    def find(start: int) -> Row:
        controller.solves = controller.iterations = controller.failures = 0
        controller.seconds_spent = 0.0
        episodes = roll_out(controller, TRIAL.environment_id, TRIAL.arguments, [FIRST_SEED + start])
        values = {name: float(np.squeeze(numbers)) for name, numbers in measures.compute(episodes).items()}
        solver = {"solves": controller.solves, "iterations": controller.iterations, "failures": controller.failures}
        return values | solver | {"seconds": controller.seconds_spent}

    return find


def fill(folder: Path, starts: int, nmpc_starts: int, told: Callable[[str], None]) -> dict[str, dict[str, Array]]:
    """Episodes along plans and under NMPC, by title; each start is saved as it is done, in `folder`."""
    found: dict[str, dict[str, Array]] = {}
    searches: tuple[tuple[str, str, int, Callable[[], Callable[[int], Row]]], ...] = (
        ("planned", f"plan of {SECONDS:g} s, LQR along it and after it", starts, lambda: plan_finder(planner())),
        ("nmpc", "NMPC, as for stabilising", nmpc_starts, lambda: nmpc_finder(TRIAL)),
    )
    for name, title, count, make in searches:
        path = folder / f"{name}.json"
        wanted = range(count)
        if saved.missing(path, TRIAL.name, wanted):

            def say(start: int, row: Row, name: str = name) -> None:
                told(f"{name}, start {start}: swung up {row['recovered']:g}, {row['seconds']:.1f} s of solving")

            saved.fill(path, TRIAL.name, wanted, make(), ABOUT, say)
        table = saved.columns(path, TRIAL.name)
        if table is not None:
            kept = np.isin(table[saved.START], wanted)
            found[f"{title} ({kept.sum()} starts)"] = {name: values[kept] for name, values in table.items()}
    return found


def scores(entries: Sequence[Entry], folder: Path, starts: int) -> dict[str, dict[str, Array]]:
    """Measures of nothing, LQR and learned entries, by title."""
    found = {}
    for entry in (CLASSICAL["nothing"], CLASSICAL["lqr"], *entries):
        for number, controller in enumerate(entry.controllers(TRIAL)):
            path = folder / "scores" / f"{Path(entry.name).name.replace('*', '')}-{number}.npz"
            values = score(controller, TRIAL.environment_id, entry.arguments(TRIAL), path, starts)
            found[f"{entry.title} ({starts} starts)"] = values
    return found


def table(values: Mapping[str, Mapping[str, Array]]) -> str:
    """One row for each controller, with 95 % intervals."""
    return score_table(values, measures_of(TRIAL.environment_id).each)


def play(controllers: Mapping[str, Controller], start: int = 0) -> list[Evaluation]:
    """Episodes from one start, for pictures."""
    compute = measures_of(TRIAL.environment_id).compute
    evaluations = []
    for name, controller in controllers.items():
        episodes = roll_out(controller, TRIAL.environment_id, TRIAL.arguments, [FIRST_SEED + start])
        evaluations.append(Evaluation(name, episodes, compute(episodes)))
    return evaluations


def states_along_plans(path: Path, episodes: int = 6) -> int:
    """Save the states of some episodes along plans, on their way up, where a training can start; how many there are.

    Their starts are not the protocol's.
    """
    controller = planner()
    played = roll_out(controller, TRIAL.environment_id, TRIAL.arguments, range(episodes))
    up = measures_of(TRIAL.environment_id).compute(played)["recovered"] == 1.0
    moving = round(SECONDS / controller.scenario.control_period)
    states = played.states[up, :moving].reshape(-1, played.states.shape[2])
    write_arrays(path, {"states": states})
    return len(states)


def limits(folder: Path, told: Callable[[str], None]) -> str:
    """From hanging rest, in how little time and with how little force is there a plan? A table of its effort.

    Each plan is played in the environment, and counts only if the pendulum stays up. Saved as they come.
    """
    rows = [["plan (s)", *(f"{force:g} N" for force in FORCES)]]
    for seconds in DURATIONS:
        cells = []
        for force in FORCES:
            path, name = folder / "limits.json", f"{seconds:g} s, {force:g} N"

            def find(_: int, seconds: float = seconds, force: float = force) -> Row:
                arguments: dict[str, Any] = {"max_force": force, "start_scale": 0.0}
                controller = PlannedSwingUp(scenario_for(_ID, arguments), seconds, LITTLE)
                episodes = roll_out(controller, _ID, arguments, [0])
                values = {k: float(np.squeeze(v)) for k, v in measures_of(_ID).compute(episodes).items()}
                return values | {"failures": controller.failures, "seconds": controller.seconds_spent}

            def say(_: int, row: Row, name: str = name) -> None:
                told(f"plan of {name}: swung up {row['recovered']:g}, {row['seconds']:.0f} s of solving")

            saved.fill(path, name, range(1), find, ABOUT, say)
            found = saved.columns(path, name)
            assert found is not None
            cells.append(f"{found['effort'][0]:.0f}" if found["recovered"][0] else "-")
        rows.append([f"{seconds:g}", *cells])
    return markdown(rows)
