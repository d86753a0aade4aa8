"""How fast the environments are beside others of their kind: ratios from one run, on one core.

In every round each subject runs once for a short while; ratios are formed within a round, so that what else the
machine does meanwhile falls on both sides, and medians and quartiles are taken over the rounds.
"""

from __future__ import annotations

import os

if __name__ == "__main__":  # before NumPy and JAX are imported: one thread each, and JAX on the processor
    os.environ.update(
        dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
        JAX_PLATFORMS="cpu",
        XLA_FLAGS="--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    )

import argparse
import functools
import gc
import importlib
import math
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from benchmark_peers import (
    EMPTY,
    EMPTY_ID,
    NEVER,
    FloatArray,
    NotInstalledError,
    Solver,
    Subject,
    envpool_batch,
    gymnasium_batch,
    gymnax_batch,
    heyoka_solver,
    installed,
    mujoco_batch,
    mujoco_model,
    mujoco_run,
    scipy_solver,
    single,
)
from benchmark_report import Record, draw, headline, machine, number, save, table

import spring_pendulum_env
from spring_pendulum_env import Parameters, energy, integrators, layout, physics, tasks
from spring_pendulum_env.scenario import Scenario

DAMPING = "SpringPendulumDamping-v0"
PASSIVE = "SpringPendulumPassive-v0"
ENDLESS: dict[str, Any] = {"anchor_travel": 1e9, "max_episode_steps": NEVER}
"""Arguments under which no episode ends."""
Target = tuple[str, float]

# What must be reached, by section and peer.
SINGLE: dict[str, Target] = {
    EMPTY: ("at most", 5.0),
    "CartPole-v1": ("at least", 3.5),
    "Acrobot-v1": ("at least", 20.0),
    "InvertedDoublePendulum-v5": ("at least", 30.0),
}
BATCH: dict[str, Target] = {
    "Acrobot-v1 in SyncVectorEnv of 64": ("at least", 300.0),
    "EnvPool Acrobot-v1": ("at least", 10.0),
    "gymnax Acrobot-v1, one call a step": ("at least", 3.0),
    "CartPole-v1, native": ("at least", 0.8),
}
LARGE_BATCH: Target = ("at most", 1.3)
HEYOKA: Target = ("at least", 1.0)
SCIPY: Target = ("at least", 300.0)
MUJOCO: Target = ("at least", 200.0)
IMPORT: Target = ("at most", 1.15)
COLD: Target = ("at most", 5.0)
WARM: Target = ("at most", 1.0)

ENERGY_ERROR = 1e-10
MOTIONS = {
    "regular": np.array([0.1, 0.0, -1.25, 0.25, 0.05, -2.35, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0]),
    "violent": np.array([0.26, 0.64, -1.08, 0.86, -0.12, -2.85, -1.55, -1.21, 0.62, -0.85, 0.2, 1.54]),
}
"""Starts of the passive pendulum: a small swing; 53 J above rest, chaotic, with springs never shorter than 0.15 m."""


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    rounds: int = 15
    chunk: float = 0.05
    """Least time that a subject runs in a round, s."""
    warm_up: int = 600
    """Steps after which the rows of a batch end at different times."""
    sizes: tuple[int, ...] = (64, 1024, 16384)
    counts: tuple[int, ...] = tuple(4**power for power in range(9))
    horizon: int = 1000
    """Length of a passive run, s."""
    passive_rounds: int = 3
    passive_rows: int = 256
    starts: int = 7


QUICK = Effort(rounds=3, warm_up=30, horizon=100, passive_rounds=2, passive_rows=64, starts=2)


@dataclass
class Bench:
    """What was found so far."""

    effort: Effort
    records: list[Record] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)
    said: set[str] = field(default_factory=set)

    def say(self, line: str) -> None:
        """One line for whoever waits, once."""
        if line not in self.said:
            print(line, file=sys.stderr, flush=True)
        self.said.add(line)

    def add(
        self, section: str, what: str, beside: str, values: Any, unit: str, target: Target | None = None, how: str = ""
    ) -> None:
        """Notes the median of one value for each round."""
        low, median, high = np.percentile(values, [25, 50, 75]).tolist()
        bound, aim = target or ("", 0.0)
        self.records.append(Record(section, what, beside, median, low, high, unit, bound, aim, how))

    def compare(
        self,
        section: str,
        what: str,
        ours: FloatArray,
        beside: str,
        theirs: FloatArray,
        target: Target | None,
        more: str = "",
    ) -> None:
        """Notes a ratio: how many times longer theirs takes, or ours where the target is a highest ratio."""
        turned = target is not None and target[0] == "at most"
        ratio = ours / theirs if turned else theirs / ours
        how = f"{_duration(ours)} beside {_duration(theirs)}{more}"
        self.add(section, what, beside, ratio, "x", target, how)


def _duration(seconds: Any) -> str:
    middle = float(np.median(seconds))
    if middle < 1e-2:
        return f"{number(middle * 1e6)} µs"
    return f"{number(middle)} s"


@dataclass(frozen=True)
class Timing:
    """Seconds for one step of one environment, one value for each round."""

    whole: FloatArray
    without_resets: FloatArray


def interleaved(subjects: Sequence[Subject], rounds: int, chunk: float) -> list[Timing]:
    """Times every subject once in each round, each time for at least `chunk` seconds, in the order given."""
    calls = [_calls_for(subject, chunk) for subject in subjects]
    whole, alone = np.empty((len(subjects), rounds)), np.empty((len(subjects), rounds))
    for turn in range(rounds):
        for place, subject in enumerate(subjects):
            gc.collect()
            begin = time.perf_counter()
            resets = subject.run(calls[place])
            spent = time.perf_counter() - begin
            whole[place, turn] = spent / (calls[place] * subject.steps)
            alone[place, turn] = (spent - resets) / (calls[place] * subject.steps)
    return [Timing(*pair) for pair in zip(whole, alone, strict=True)]


SLOW = 5.0
"""Seconds of a call after which nothing need be repeated or warmed up."""


def _calls_for(subject: Subject, chunk: float) -> int:
    """How many calls take that long; making them also warms the subject up, and the first compiles."""
    begin = time.perf_counter()
    subject.run(1)
    if time.perf_counter() - begin > SLOW:
        return 1
    calls = 1
    while True:
        begin = time.perf_counter()
        subject.run(calls)
        spent = time.perf_counter() - begin
        if spent >= chunk:
            return max(1, math.ceil(calls * chunk / spent))
        calls *= 2 if spent < 0.1 * chunk else max(2, math.ceil(chunk / spent))


def measure_single(bench: Bench) -> None:
    """Single steps through gym.make with default wrappers and the whole info."""
    names = {EMPTY_ID: EMPTY}
    ids = (DAMPING, EMPTY_ID, "CartPole-v1", "Pendulum-v1", "Acrobot-v1", "InvertedDoublePendulum-v5")
    subjects = installed([partial(single, env_id, names.get(env_id)) for env_id in ids], bench.say)
    ours, *others = interleaved(subjects, bench.effort.rounds, bench.effort.chunk)
    for subject, theirs in zip(subjects[1:], others, strict=True):
        target = SINGLE.get(subject.name)
        bench.compare("single", "a step, resets counted", ours.whole, subject.name, theirs.whole, target)
    for subject, theirs in zip(subjects[1:], others, strict=True):
        target = SINGLE.get(subject.name)
        bench.compare("single", "a step alone", ours.without_resets, subject.name, theirs.without_resets, target)


def measure_batch(bench: Bench) -> None:
    """Full steps of batches, per environment."""
    for size in bench.effort.sizes:
        warm_up = bench.effort.warm_up
        makers = [
            partial(gymnasium_batch, DAMPING, size, "ours", warm_up),
            partial(gymnasium_batch, DAMPING, size, "ours, no episode ending", 10, **ENDLESS),
            partial(gymnasium_batch, "CartPole-v1", size, "CartPole-v1, native", warm_up),
            partial(gymnasium_batch, "Acrobot-v1", 64, "Acrobot-v1 in SyncVectorEnv of 64", 10, "sync"),
            partial(envpool_batch, "Acrobot-v1", size),
            partial(envpool_batch, "Pendulum-v1", size),
            partial(gymnax_batch, size),
            partial(gymnax_batch, size, 100 if size <= 1024 else 10),
            partial(mujoco_batch, _rest(), min(size, 1024), 4, actuated=True),
        ]
        if size > 1024:
            makers.append(partial(gymnasium_batch, DAMPING, 1024, "ours at 1,024", warm_up))
        subjects = installed(makers, bench.say)
        ours, *others = interleaved(subjects, bench.effort.rounds, bench.effort.chunk)
        for subject, theirs in zip(subjects[1:], others, strict=True):
            target = BATCH.get(subject.name) if size == 1024 else None
            target = LARGE_BATCH if subject.name == "ours at 1,024" else target
            bench.compare("batch", f"{size:,} environments", ours.whole, subject.name, theirs.whole, target)


def _rest() -> FloatArray:
    """The actuated pendulum hanging, a little aside."""
    state: FloatArray = spring_pendulum_env.equilibrium(None, "hanging-hanging") + np.eye(18)[3] * 0.1
    return state


def measure_passive(bench: Bench) -> None:
    """Long runs without a force: time at equal energy error, and against MuJoCo at equal error after 10 s."""
    bench.curves["passive"] = {}
    for motion, start in MOTIONS.items():
        _passive_at_equal_energy_error(bench, motion, start)
        try:
            _mujoco_at_equal_error(bench, motion, start)
        except NotInstalledError as error:
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
        except NotInstalledError as error:
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
    timings = interleaved(subjects, bench.effort.passive_rounds, bench.effort.chunk)
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
        begin = time.perf_counter()
        states = solve(setting)
        spent = time.perf_counter() - begin
        if spent < 1.0:  # the first call may have compiled
            begin = time.perf_counter()
            solve(setting)
            spent = time.perf_counter() - begin
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


def environment_solver(start: FloatArray, times: FloatArray) -> Solver:
    """The environment itself, stepped: a whole number is the splitting's steps a second, else it is a tolerance."""
    made: dict[Any, Any] = {}

    def solve(setting: Any) -> FloatArray:
        splitting = isinstance(setting, int)
        per_second = setting if splitting else 1
        if setting not in made:
            made[setting] = gym.make(
                PASSIVE,
                control_period=1 / per_second,
                tolerance=None if splitting else setting,
                max_episode_steps=len(times) * per_second,
            )
        step = made[setting].step
        observation, _ = made[setting].reset(options={"state": start})
        states = [observation]
        for _ in times[1:]:
            for _ in range(per_second):
                observation = step(None)[0]
            states.append(observation)
        return np.array(states)

    return solve


def vector_solver(start: FloatArray, times: FloatArray, rows: int) -> Solver:
    """The vector environment, every row the same motion."""
    made: dict[int, Any] = {}

    def solve(per_second: int) -> FloatArray:
        if per_second not in made:
            arguments: dict[str, Any] = {"control_period": 1 / per_second, "tolerance": None}
            made[per_second] = gym.make_vec(PASSIVE, num_envs=rows, max_episode_steps=NEVER, **arguments)
        step = made[per_second].step
        observations, _ = made[per_second].reset(options={"state": start})
        states = [observations[0].copy()]
        for _ in times[1:]:
            for _ in range(per_second):
                observations = step(None)[0]
            states.append(observations[-1].copy())
        return np.array(states)

    return solve


@functools.cache
def _compiled_loop() -> tuple[Any, Any]:
    """The compiled step, and a compiled loop around it."""
    import numba

    advance = importlib.import_module("spring_pendulum_env.kernels").advance

    def loop(rows: Any, settings: Any, states: Any, per_second: Any) -> None:
        for sample in range(1, states.shape[0]):
            for _ in range(per_second):
                advance(rows, 0, 1, settings)
            states[sample] = rows[0, :18, 0]

    return advance, numba.njit(error_model="numpy")(loop)


def loop_solver(start: FloatArray, times: FloatArray) -> Solver:
    """The compiled step called from a compiled loop: what the environment costs without Python around it."""
    advance, compiled = _compiled_loop()

    def solve(per_second: int) -> FloatArray:
        task = tasks.task_named("passive")
        scenario = Scenario.of(task, control_period=1 / per_second, tolerance=None)
        rows = np.zeros((1, layout.FIELDS, 1))
        full = scenario.checked_state(start)
        layout.fill(rows, 0, layout.template(scenario, scenario.parameters), full)
        settings = layout.settings_of(scenario)
        advance(rows, 0, 1, settings)  # only reports what was just placed
        states = np.empty((len(times), 18))
        states[0] = full
        compiled(rows, settings, states, per_second)
        return np.concatenate([states[:, 3:9], states[:, 12:18]], axis=1)

    return solve


def _mujoco_at_equal_error(bench: Bench, motion: str, start: FloatArray) -> None:
    """Both with the same error of the state after 10 s: MuJoCo's steps are made as short as that needs."""
    periods = 500
    exact = spring_pendulum_env.simulate(None, start, [0.0, 10.0], rtol=3e-14, atol=1e-14).states[-1]
    env = gym.make(PASSIVE, tolerance=None)

    def ours() -> FloatArray:
        env.reset(options={"state": start})
        for _ in range(periods):
            observation = env.step(None)[0]
        return np.asarray(observation)

    def error(substeps: int) -> float:
        model = mujoco_model(Parameters(), substeps, actuated=False)
        return float(np.abs(mujoco_run(model, start, periods, substeps) - exact).max())

    allowed = float(np.abs(ours() - exact).max())
    substeps = _fewest(error, allowed)
    model = mujoco_model(Parameters(), substeps, actuated=False)
    batch: Any = gym.make_vec(PASSIVE, num_envs=1024, tolerance=None, max_episode_steps=NEVER)
    batch.reset(options={"state": start})
    subjects = [
        Subject("environment", _repeated(ours), periods),
        Subject("MuJoCo", _repeated(partial(mujoco_run, model, start, periods, substeps)), periods),
        Subject("vector environment of 1,024, a row", _repeated(partial(batch.step, None)), 1024),
        mujoco_batch(start, 64, substeps, actuated=False),
    ]
    one, theirs, row, their_row = interleaved(subjects, bench.effort.rounds, bench.effort.chunk)
    beside, more = "this system in MuJoCo", f"; {substeps} steps of RK4 in MuJoCo for one of ours"
    what = f"{motion}, error {allowed:.1e} after 10 s"
    bench.compare("passive", f"{what}: environment", one.whole, beside, theirs.whole, MUJOCO, more)
    bench.compare(
        "passive", f"{what}: batch of 1,024, a row", row.whole, f"{beside}, a batch", their_row.whole, MUJOCO, more
    )


def _fewest(error: Callable[[int], float], allowed: float) -> int:
    """The fewest steps whose error is small enough, if more steps err less; 1,024 where even these don't do."""
    high = 1
    while error(high) > allowed and high < 1024:
        high *= 2
    low = high // 2
    while high - low > max(1, high // 32):
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) <= allowed else (middle, high)
    return high


def _repeated(function: Callable[[], Any]) -> Callable[[int], float]:
    def run(calls: int) -> float:
        for _ in range(calls):
            function()
        return 0.0

    return run


def measure_scaling(bench: Bench) -> None:
    """Time for one environment as their number and their stiffness grow, and memory."""
    effort = bench.effort
    for ending, name, arguments in ((True, "", {}), (False, ", no episode ending", ENDLESS)):
        warm_ups = [min(effort.warm_up, 2**22 // count) if ending else 10 for count in effort.counts]
        subjects = [
            gymnasium_batch(DAMPING, count, "ours", warm_up, **arguments)
            for count, warm_up in zip(effort.counts, warm_ups, strict=True)
        ]
        timings = interleaved(subjects, effort.rounds, effort.chunk)
        for count, timing in zip(effort.counts, timings, strict=True):
            how = f"{_duration(timing.whole * count)} a step of the batch"
            what = f"{count:,} environment{'s' if count > 1 else ''}{name}, each"
            bench.add("scaling", what, "", timing.whole * 1e6, "µs", None, how)
        bench.curves[f"number{name}"] = {"x": list(effort.counts), **_spread(timings)}

    stiffnesses = [10.0**power for power in range(1, 7)]
    environments = min(1024, max(effort.counts))
    subjects, steps = [], []
    for k in stiffnesses:
        # Starts of equal spring energy, so that stiffness alone changes.
        arguments = {"parameters": {"k1": k, "k2": k}, "start_scale": min(1.0, math.sqrt(100.0 / k)), **ENDLESS}
        steps.append(layout.steps_in(0.02, Parameters(k1=k, k2=k).constants()))
        subjects.append(gymnasium_batch(DAMPING, environments, f"k = {k:g}", 10, **arguments))
    timings = interleaved(subjects, effort.rounds, effort.chunk)
    for k, count, timing in zip(stiffnesses, steps, timings, strict=True):
        how = f"{count} integration step{'s' if count > 1 else ''} a control period"
        bench.add("scaling", f"k = {k:,.0f} N/m, each of {environments:,}", "", timing.whole * 1e6, "µs", None, how)
    bench.curves["stiffness"] = {
        "x": stiffnesses,
        "environments": environments,
        "integration steps": steps,
        **_spread(timings),
    }
    largest = max(effort.counts)
    grown = _python(_MEMORY.format(id=DAMPING, count=largest))
    if grown is None:
        bench.say("memory: /proc/self/status isn't there, skipped")
    else:
        how = f"{grown / largest / 1e3:.2f} kB for each"
        bench.add("scaling", f"memory for {largest:,} environments", "", grown / 1e6, "MB", None, how)


def _spread(timings: Sequence[Timing]) -> dict[str, list[float]]:
    quartiles = np.percentile([timing.whole * 1e6 for timing in timings], [25, 50, 75], axis=1)
    return dict(zip(("low", "median", "high"), quartiles.tolist(), strict=True))


_MEMORY = """
import gymnasium as gym, spring_pendulum_env
def used():
    lines = open("/proc/self/status").read().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
small = gym.make_vec("{id}", num_envs=64)
small.reset(seed=0)
small.step(small.action_space.sample())
before = used()
env = gym.make_vec("{id}", num_envs={count})
env.reset(seed=0)
kept = env.step(env.action_space.sample())
print(used() - before)
"""


def measure_parts(bench: Bench) -> None:
    """What each part of a vector step costs, beside what the processor's divider alone would need."""
    bench.curves["parts"] = {}
    roots, divisions = divider_work()
    divider = divider_subject(roots, divisions)
    for size in (1, *bench.effort.sizes):
        subjects = [
            gymnasium_batch(DAMPING, size, "ours", bench.effort.warm_up),
            gymnasium_batch(DAMPING, size, "ours, no episode ending", 10, **ENDLESS),
            Subject("compiled", _repeated(_stepping(*_placed(size))), size),
            Subject("advance", _repeated(partial(_advance, *_placed(size))), size),
            Subject("calm", _repeated(partial(_advance, *_placed(size, start_scale=CALM))), size),
            # five integration steps in a control period, and one report as before
            Subject("longer", _repeated(partial(_advance, *_placed(size, start_scale=CALM, control_period=0.1))), size),
            divider,
        ]
        timings = interleaved(subjects, bench.effort.rounds, bench.effort.chunk)
        ending, whole, compiled, advanced, calmly, extended, limit = (timing.whole * 1e6 for timing in timings)
        integrate = (extended - calmly) / 4
        parts = {
            "integrate": integrate,
            "near misses again": advanced - calmly,
            "report": calmly - integrate,
            "copy in and out": compiled - advanced,
            "Python": whole - compiled,
            "start rows anew": ending - whole,
        }
        what = f"{size:,} environment{'s' if size > 1 else ''}"
        for name, values in parts.items():
            how = f"{float(np.median(values / ending)):.0%} of {number(float(np.median(ending)))} µs"
            bench.add("parts", f"{what}, each: {name}", "", values, "µs", None, how)
        how = f"{roots} roots and {divisions} divisions a step: {number(float(np.median(limit)) * 1e3)} ns"
        for name, values in (("the compiled step", compiled), ("no episode ending", whole), ("the whole step", ending)):
            bench.add("parts", f"{what}: divider's share of {name}", "", 100 * limit / values, "%", None, how)
        bench.curves["parts"][f"{size:,}"] = {
            "parts": {name: float(np.median(values)) for name, values in parts.items()},
            "divider": float(np.median(limit)),
        }


def _advance(rows: FloatArray, settings: FloatArray, size: int) -> None:
    """The compiled step, on as many rows at a time as the vector environment takes."""
    kernels: Any = importlib.import_module("spring_pendulum_env.kernels")
    for first in range(0, size, layout.CHUNK):
        kernels.advance(rows, first, min(layout.CHUNK, size - first), settings)


def _stepping(rows: FloatArray, settings: FloatArray, size: int) -> Callable[[], None]:
    """The one compiled call of a vector step: actions in, the step, all that it reports out."""
    kernels: Any = importlib.import_module("spring_pendulum_env.kernels")
    actions = np.random.default_rng(0).uniform(-1, 1, (size, 3))
    outcomes = np.empty((layout.STATUS - layout.CLOCK, size))
    outputs = (np.empty((size, 18)), outcomes, np.empty((size, 3)), np.empty(size, dtype=np.bool_))
    return partial(kernels.step_batch, rows, 0, size, settings, actions, *outputs)


CALM = 0.1
"""A spread of the start with which no spring comes close to zero length."""


def _placed(size: int, control_period: float = 0.02, start_scale: float = 1.0) -> tuple[FloatArray, FloatArray, int]:
    """Rows for the compiled step, started as the damping task starts them, its settings, and the number of rows."""
    scenario = Scenario.of(tasks.task_named("damping"), control_period=control_period, start_scale=start_scale)
    width = min(size, layout.WIDTH)
    rows = np.zeros((-(-size // width), layout.FIELDS, width))
    random = np.random.default_rng(0)
    for index in range(size):
        parameters, state = scenario.draw(random, None)
        layout.fill(rows, index, layout.template(scenario, parameters), state)
    settings = layout.settings_of(scenario)
    _advance(rows, settings, size)  # only reports what was just placed
    return rows, settings, size


class Counted:
    """A number that counts the roots and divisions it goes through."""

    roots = 0
    divisions = 0

    def _same(self, *_: Any) -> Counted:
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __abs__ = _same

    def __truediv__(self, _: Any) -> Counted:
        Counted.divisions += 1
        return self

    __rtruediv__ = __truediv__

    def __pow__(self, exponent: float) -> Counted:
        assert exponent == 0.5
        Counted.roots += 1
        return self

    def __eq__(self, _: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


def divider_work() -> tuple[int, int]:
    """Roots and divisions in one control period of one pendulum: the package's formulas, run on numbers that count.

    The accelerations once for each kick of the splitting, the energy, its error and the reward terms once.
    """
    n = Counted()
    Counted.roots = Counted.divisions = 0
    for _ in integrators.KICKS:
        physics.accelerations(*[n] * 23)
    physics.total_energy(*[n] * 26)
    physics.energy_error(n, n)
    tasks.reward_terms(*[n] * 9)
    return Counted.roots, Counted.divisions


def divider_subject(roots: int, divisions: int) -> Subject:
    """As many roots and divisions as a step has, independent of each other, on numbers in the nearest cache."""
    import numba

    def work(x: Any, root: Any, quotient: Any, times: Any) -> None:
        for _ in range(times):
            for _ in range(roots):
                for j in range(64):
                    x[j] += 1.0
                    root[j] += x[j] ** 0.5
            for _ in range(divisions):
                for j in range(64):
                    x[j] += 1.0
                    quotient[j] += 1.0 / x[j]

    compiled: Any = numba.njit(error_model="numpy")(work)
    buffers = [np.ones(64) for _ in range(3)]

    def run(calls: int) -> float:
        buffers[0][:] = 1.0
        compiled(*buffers, calls)
        return 0.0

    return Subject("divider", run, 64)


def measure_start(bench: Bench) -> None:
    """How long the import takes, and the first environment, with and without compiled code at hand."""
    once = "import time; begin = time.perf_counter(); import {}; print(time.perf_counter() - begin)"
    imports: dict[str, list[float]] = {"gymnasium": [], "spring_pendulum_env": []}
    for _ in range(bench.effort.starts + 1):  # the first only fills the file cache
        for module, seconds in imports.items():
            seconds.append(_python(once.format(module)) or math.nan)
    alone, ours = (np.array(seconds[1:]) for seconds in imports.values())
    bench.compare("start", "import spring_pendulum_env", ours, "import gymnasium", alone, IMPORT)
    cold, warm = [], []
    for _ in range(max(1, bench.effort.starts // 2)):
        with tempfile.TemporaryDirectory() as folder:
            cold.append(_python(_FIRST_STEP.format(id=DAMPING), NUMBA_CACHE_DIR=folder) or math.nan)
            warm.append(_python(_FIRST_STEP.format(id=DAMPING), NUMBA_CACHE_DIR=folder) or math.nan)
    bench.add("start", "first make, reset and step, nothing compiled", "", cold, "s", COLD)
    bench.add("start", "first make, reset and step, compiled before", "", warm, "s", WARM)


_FIRST_STEP = """
import time, gymnasium as gym, spring_pendulum_env
begin = time.perf_counter()
env = gym.make("{id}")
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - begin)
"""


def _python(program: str, **environment: str) -> float | None:
    """The number that a program prints in a process of its own; None if it fails."""
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    return float(done.stdout) if done.returncode == 0 else None


SECTIONS: Mapping[str, Callable[[Bench], None]] = {
    "single": measure_single,
    "batch": measure_batch,
    "passive": measure_passive,
    "scaling": measure_scaling,
    "parts": measure_parts,
    "start": measure_start,
}


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message: str) -> Any:
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(2)


def options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line, checked."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("runs/benchmark"), help="for the files (%(default)s)")
    parser.add_argument("--only", default=",".join(SECTIONS), help="sections, by commas (%(default)s)")
    parser.add_argument("--rounds", type=int, help=f"rounds of each section ({Effort.rounds}, quick {QUICK.rounds})")
    parser.add_argument("--quick", action="store_true", help="few rounds, passive runs of 100 s: to see that it works")
    given = parser.parse_args(arguments)
    given.only = [name.strip() for name in given.only.split(",")]
    for name in given.only:
        if name not in SECTIONS:
            parser.error(f"--only: unknown section {name!r}: must be some of {','.join(SECTIONS)}")
    if given.rounds is not None and given.rounds < 1:
        parser.error(f"--rounds {given.rounds}: must be at least 1")
    if given.folder.exists() and not given.folder.is_dir():
        parser.error(f"--folder {given.folder}: is a file")
    return given


def pin_to_one_core() -> None:
    """Keeps this process and those it starts on one core, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main(arguments: Sequence[str] | None = None) -> None:
    given = options(arguments)
    effort = QUICK if given.quick else Effort()
    if given.rounds is not None:
        effort = Effort(
            **{**vars(effort), "rounds": given.rounds, "passive_rounds": given.rounds, "starts": given.rounds}
        )
    warnings.filterwarnings("ignore")  # the peers' own
    gym.logger.min_level = gym.logger.ERROR
    pin_to_one_core()
    about = machine()
    bench = Bench(effort)
    for name in SECTIONS:
        if name in given.only:
            bench.say(f"measuring: {name}")
            SECTIONS[name](bench)
    print(headline(about))
    print(f"medians of {effort.rounds} rounds ({effort.passive_rounds} of the passive runs); x: times as fast\n")
    print(table(bench.records))
    about["effort"] = vars(effort)
    save(given.folder, about, bench.records, bench.curves)
    try:
        draw(given.folder, about, bench.records, bench.curves)
    except ModuleNotFoundError:
        bench.say("matplotlib: not installed, no pictures")
    print(f"\nTable, numbers and pictures: {given.folder}")


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        raise SystemExit(130) from None
