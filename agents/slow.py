"""Finding the results that are saved in agents/results: NMPC's episodes, and the open-loop optimum."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import gymnasium as gym
import numpy as np

from agents import saved
from agents.config import ENVIRONMENT_IDS
from agents.entries import CLASSICAL
from agents.evaluation import FIRST_SEED, Trial
from agents.leaderboard import NMPC_FILE, OPTIMUM_FILE
from agents.measures import measures_of
from agents.nmpc import NMPC
from agents.optimum import KNOWN, Optimum, row
from agents.rollout import roll_out

Row = Mapping[str, float]

ABOUT_NMPC = {
    "what": "NMPC's episodes; starts are counted from the protocol's first, times are in s, efforts in N2 s, ways in m"
}

ABOUT_OPTIMUM = {
    "what": "starts that LQR, tuned LQR or NMPC recovers (planned is 0), or an open-loop optimum played in the "
    "environment; starts are counted from the protocol's first; solved: IPOPT found a plan; seconds of its work"
}


def fill(name: str, trials: Sequence[Trial], starts: int, *, anew: bool = False, path: Path | None = None) -> None:
    """Find what isn't saved yet of "nmpc" or "optimum" for the first so many starts of each trial; `anew`: all of it.

    Each start is saved as it is done, and told on the standard error output. Raises ValueError for another name.
    """
    if name not in FINDERS:
        raise ValueError(f"name is {name!r}; allowed are {', '.join(FINDERS)}")
    about, file, finder = FINDERS[name]
    file = path or file
    if anew:
        file.unlink(missing_ok=True)
    for trial in trials:
        find = finder(trial)
        if find is None:
            continue
        began = time.monotonic()
        count = len(saved.missing(file, trial.name, range(starts)))

        def told(start: int, row: Row, trial: Trial = trial, began: float = began) -> None:
            success = row[measures_of(trial.environment_id).success]
            seconds = time.monotonic() - began
            print(
                f"{name}, {trial.name}, start {start}: {success:g}, after {seconds:.0f} s", file=sys.stderr, flush=True
            )

        if count:
            saved.fill(file, trial.name, range(starts), find, about, told)


def nmpc_finder(trial: Trial) -> Callable[[int], Row]:
    """Plays one start under NMPC and returns the measures, and what the solver had to do."""
    entry = CLASSICAL["nmpc"]
    (controller,) = entry.controllers(trial)
    assert isinstance(controller, NMPC)
    measures = measures_of(trial.environment_id)

    def find(start: int) -> Row:
        controller.solves, controller.failures, controller.seconds = 0, 0, 0.0
        episodes = roll_out(controller, trial.environment_id, entry.arguments(trial), [FIRST_SEED + start])
        values = {name: float(np.squeeze(numbers)) for name, numbers in measures.compute(episodes).items()}
        solver = {"solves": controller.solves, "failures": controller.failures, "seconds": controller.seconds}
        return values | solver

    return find


def optimum_finder(trial: Trial) -> Callable[[int], Row] | None:
    """Whether a start can be recovered: some classical controller does so, or a plan does. None for damping."""
    if trial.environment_id != ENVIRONMENT_IDS["stabilisation"]:
        return None
    planner: Optimum | None = None
    quick = [CLASSICAL[name].controllers(trial)[0] for name in ("lqr", "lqr-tuned")]
    played = saved.columns(NMPC_FILE, trial.name) or {"start": np.array([]), "recovered": np.array([])}
    by_nmpc = set(played["start"][played["recovered"] == 1.0].tolist())
    env = gym.make(trial.environment_id, disable_env_checker=True, **trial.arguments)

    def find(start: int) -> Row:
        nonlocal planner
        seed = [FIRST_SEED + start]
        compute = measures_of(trial.environment_id).compute
        if start in by_nmpc or any(
            compute(roll_out(controller, trial.environment_id, trial.arguments, seed))["recovered"][0]
            for controller in quick
        ):
            return KNOWN
        planner = planner or Optimum(trial)
        began = time.process_time()
        outcome = planner.find(env.reset(seed=seed[0])[0])
        return row(outcome, time.process_time() - began)

    return find


FINDERS: dict[str, tuple[dict[str, str], Path, Callable[[Trial], Callable[[int], Row] | None]]] = {
    "nmpc": (ABOUT_NMPC, NMPC_FILE, nmpc_finder),
    "optimum": (ABOUT_OPTIMUM, OPTIMUM_FILE, optimum_finder),
}
"""By name: what the file says of itself, the file, and what finds the row of a start, or nothing for a trial."""
