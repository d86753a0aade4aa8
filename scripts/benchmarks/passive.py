"""Long runs without a force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.equal_error import measure_beside_mujoco
from benchmarks.inside import loop_solver
from benchmarks.measuring import Bench, FloatArray, SkippedError, Subject, Target, clock
from benchmarks.solvers import Solver, environment_solver, heyoka_solver, scipy_solver, vector_solver
from spring_pendulum_env import Parameters, energy

HEYOKA: Target = ("at least", 1.0)
SCIPY: Target = ("at least", 300.0)


ENERGY_ERROR = 1e-10
MOTIONS = {
    "regular": np.array([0.1, 0.0, -1.25, 0.25, 0.05, -2.35, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0]),
    "violent": np.array([0.26, 0.64, -1.08, 0.86, -0.12, -2.85, -1.55, -1.21, 0.62, -0.85, 0.2, 1.54]),
}
"""Starts of the passive pendulum: a small swing; 53 J above rest, chaotic, with springs never shorter than 0.15 m."""


def measure(bench: Bench) -> None:
    """Long runs without a force: time at equal energy error, and against MuJoCo at equal error after 10 s."""
    bench.curves["passive"] = {}
    for motion, start in MOTIONS.items():
        _passive_at_equal_energy_error(bench, motion, start)
        try:
            measure_beside_mujoco(bench, motion, start)
        except SkippedError as error:
            bench.say(str(error))


def _passive_at_equal_energy_error(bench: Bench, motion: str, start: FloatArray) -> None:
    horizon = bench.effort.horizon
    times = np.arange(horizon + 1.0)
    rows = bench.effort.passive_rows
    what = f"{motion}, {horizon:,} s"
    sweeps: dict[str, tuple[Callable[[], Solver], Sequence[Any]]] = {
        "environment, splitting": (partial(environment_solver, start, times), STEPS_PER_SECOND),
        "environment, adaptive": (
            partial(environment_solver, start, times),
            (1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13),
        ),
        "heyoka": (partial(heyoka_solver, Parameters(), start, times), TOLERANCES),
        "SciPy DOP853": (partial(scipy_solver, Parameters(), start, times, compiled=False), TOLERANCES[5::2]),
    }
    points: dict[str, list[dict[str, Any]]] = {}
    solvers: dict[str, Solver] = {}
    for name, (make, settings) in sweeps.items():
        try:
            solvers[name] = make()
        except SkippedError as error:
            bench.say(str(error))
            continue
        points[name] = _swept(solvers[name], settings, start)
    bench.curves["passive"][motion] = {"horizon": horizon, "solvers": points}
    chosen = {name: _cheapest(swept) for name, swept in points.items()}
    for name in [name for name, point in chosen.items() if point is None]:
        bench.say(f"{name}: no setting reaches an energy error of {ENERGY_ERROR:g} over {what}, left out")
        del chosen[name]
    best = min((name for name in chosen if name.startswith("environment")), key=lambda name: chosen[name]["seconds"])

    runs: dict[str, tuple[Solver, Any, int]] = {name: (solvers[name], chosen[name]["setting"], 1) for name in chosen}
    if "environment, splitting" in chosen:  # the same bits, so the same setting
        steps = chosen["environment, splitting"]["setting"]
        runs["compiled loop, splitting"] = (loop_solver(start, times), steps, 1)
        runs["vector environment, splitting, a row"] = (vector_solver(start, times, rows), steps, rows)
    if "heyoka" in chosen:
        tolerance = chosen["heyoka"]["setting"]
        runs["heyoka, a batch of 8, a row"] = (heyoka_solver(Parameters(), start, times, 8), tolerance, 8)
    if "SciPy DOP853" in chosen:
        compiled = scipy_solver(Parameters(), start, times, compiled=True)
        runs["SciPy DOP853, compiled equations"] = (compiled, chosen["SciPy DOP853"]["setting"], 1)
    subjects = [Subject(name, _calling(solver, setting), share) for name, (solver, setting, share) in runs.items()]
    timings = bench.timings(subjects, bench.effort.passive_rounds)
    seconds = {subject.name: timing.whole for subject, timing in zip(subjects, timings, strict=True)}

    row = "vector environment, splitting, a row"
    pairs: list[tuple[str, str, Target | None]] = [
        (mine, theirs, target)
        for mine in (best, "compiled loop, splitting", row)
        for theirs, target in (("heyoka", HEYOKA), ("SciPy DOP853", SCIPY))
    ]
    pairs += [(row, "heyoka, a batch of 8, a row", None), (best, "SciPy DOP853, compiled equations", None)]
    for mine, theirs, target in pairs:
        if mine in seconds and theirs in seconds:
            how = f"; {_setting(runs[mine][1])} beside {_setting(runs[theirs][1])}"
            bench.compare("passive", f"{what}: {mine}", seconds[mine], theirs, seconds[theirs], target, how)


STEPS_PER_SECOND = (50, 60, 70, 80, 90, 100, 110, 120, 140, 160, 200, 250, 320)
TOLERANCES = (1e-8, 3e-9, 1e-9, 3e-10, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12, 3e-13, 1e-13, 3e-14)


def _setting(setting: Any) -> str:
    return f"{setting} steps/s" if isinstance(setting, int) else f"tolerance {setting:g}"


def _swept(solve: Solver, settings: Sequence[Any], start: FloatArray) -> list[dict[str, Any]]:
    """Time and largest energy error for each setting, coarsest first, up to one beyond what is accurate enough."""
    first = energy(Parameters(), start)
    swept: list[dict[str, Any]] = []
    for setting in settings:
        enough = bool(swept) and swept[-1]["error"] <= ENERGY_ERROR
        begin = clock()
        states = solve(setting)
        spent = clock() - begin
        if spent < 1.0:  # the first call may have compiled
            begin = clock()
            solve(setting)
            spent = clock() - begin
        error = float(np.abs(energy(Parameters(), states) - first).max() / abs(first))
        swept.append({"setting": setting, "seconds": spent, "error": error})
        if enough:
            break
    return swept


def _cheapest(swept: list[dict[str, Any]]) -> Any:
    return next((point for point in swept if point["error"] <= ENERGY_ERROR), None)


def _calling(solve: Solver, setting: Any) -> Callable[[int], float]:
    def run(calls: int) -> float:
        for _ in range(calls):
            solve(setting)
        return 0.0

    return run
