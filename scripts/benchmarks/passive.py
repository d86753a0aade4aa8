"""Long runs of the passive pendulum: time at equal energy error, for one trajectory and for many.

The energy error is the largest relative one at any of the sampling times. Each solver gets the cheapest setting with
which it is small enough: its settings stand on a ladder from coarse to fine, a search finds the rung from which on it
is, and the fastest of that rung and the next finer ones is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.measuring import Bench, FloatArray, SkippedError, Subject, Target, clock, repeated
from benchmarks.solvers import (
    MOTIONS,
    Solver,
    compiled_scipy_solver,
    environment_solver,
    fewest_calls,
    heyoka_batch_solver,
    heyoka_lanes,
    heyoka_solver,
    scipy_solver,
    simulate_solver,
    vector_solver,
)
from spring_pendulum_env import Parameters, energy, integrators

HEYOKA: Target = ("at least", 1.0)
SCIPY: Target = ("at least", 300.0)
ENERGY_ERROR = 1e-10
SAMPLES = 101
"""Instants at which the energy is looked at, the first and the last among them."""
FINER = 2
"""How many finer settings must be accurate too, lest one that is so by chance is taken."""

SIMULATE = "simulate, splitting"
SPLITTING, ADAPTIVE = "environment, splitting", "environment, adaptive"
VECTOR = "vector environment, splitting"
HEYOKA_ONE, HEYOKA_MANY = "heyoka", "heyoka, batch mode"
SCIPY_ONE, SCIPY_COMPILED = "SciPy DOP853", "SciPy DOP853, compiled equations"
Pair = tuple[str, str, Target | None]
FAST_PAIRS: list[Pair] = [
    (SIMULATE, HEYOKA_ONE, HEYOKA),
    (SPLITTING, HEYOKA_ONE, HEYOKA),
    (ADAPTIVE, HEYOKA_ONE, HEYOKA),
    (VECTOR, HEYOKA_MANY, HEYOKA),
]
SLOW_PAIRS: list[Pair] = [
    (SIMULATE, SCIPY_ONE, SCIPY),
    (SPLITTING, SCIPY_ONE, SCIPY),
    (VECTOR, SCIPY_ONE, SCIPY),
    (SPLITTING, SCIPY_COMPILED, None),
]


@dataclass(frozen=True)
class Point:
    """What a setting gave."""

    setting: Any
    description: str
    seconds: float
    error: float


@dataclass(frozen=True)
class Entry:
    """A solver, its settings from coarse to fine, and how many trajectories it runs at once."""

    make: Callable[[], Solver]
    ladder: Sequence[Any]
    trajectories: int = 1


def measure(bench: Bench) -> None:
    """Each motion."""
    bench.curves["passive"] = {}
    for motion, start in MOTIONS.items():
        _measure_motion(bench, motion, start)


def _measure_motion(bench: Bench, motion: str, start: FloatArray) -> None:
    effort = bench.effort
    times = np.linspace(0.0, effort.horizon, SAMPLES)
    contestants: dict[str, Contestant] = {}
    curves: dict[str, list[dict[str, Any]]] = {}
    for name, entry in _entries(bench, start, times).items():
        try:
            solve = entry.make()
        except SkippedError as error:
            bench.say(str(error))
            continue
        chosen, tried = search(partial(_point, solve, start, times, entry.trajectories), entry.ladder)
        curves[name] = [asdict(point) for point in tried]
        if chosen is None:
            bench.say(f"{name}, {motion}: no setting gives an energy error of {ENERGY_ERROR:g}, skipped")
        else:
            contestants[name] = Contestant(name, solve, chosen, entry.trajectories)
    bench.curves["passive"][motion] = {"horizon": effort.horizon, "energy error": ENERGY_ERROR, "solvers": curves}
    if SCIPY_COMPILED in contestants:  # with Python's equations the same steps but for rounding: no second long search
        solve = scipy_solver(Parameters(), start, times)
        contestants[SCIPY_ONE] = Contestant(SCIPY_ONE, solve, contestants[SCIPY_COMPILED].point, 1)
    run = f"{motion}, {effort.horizon:,} s"
    _compare(bench, run, contestants, FAST_PAIRS, effort.rounds)
    _compare(bench, run, contestants, SLOW_PAIRS, effort.slow_rounds)


def _entries(bench: Bench, start: FloatArray, times: FloatArray) -> dict[str, Entry]:
    interval = float(times[1] - times[0])
    steps = steps_ladder(interval)
    rows = bench.effort.passive_rows
    usual = (Parameters(), start, times)
    try:
        lanes = heyoka_lanes()
    except SkippedError:
        lanes = 1
    return {
        SIMULATE: Entry(partial(simulate_solver, start, times), free_ladder(interval)),
        SPLITTING: Entry(partial(environment_solver, start, times), steps),
        ADAPTIVE: Entry(partial(environment_solver, start, times), tolerances(-6, -14)),
        VECTOR: Entry(partial(vector_solver, start, times, rows), steps, rows),
        HEYOKA_ONE: Entry(partial(heyoka_solver, *usual), tolerances(-6, -16)),
        HEYOKA_MANY: Entry(partial(heyoka_batch_solver, *usual), tolerances(-6, -16), lanes),
        SCIPY_COMPILED: Entry(partial(compiled_scipy_solver, *usual), tolerances(-9, -13.5)),
    }


def tolerances(coarsest: float, finest: float) -> list[float]:
    """Powers of ten between two exponents, four to a decade."""
    return [10.0**exponent for exponent in np.arange(coarsest, finest - 0.1, -0.25)]


def free_ladder(interval: float) -> list[int]:
    """Numbers of steps in an interval, from steps of 0.06 s to such of 0.002 s, each two per cent finer."""
    coarsest, finest = interval / 0.06, interval / 0.002
    return sorted({math.ceil(coarsest * 1.02**rung) for rung in range(math.ceil(math.log(finest / coarsest, 1.02)))})


def steps_ladder(interval: float) -> list[int]:
    """Numbers of steps of the splitting in an interval, from the fewest that it takes to eight times as many, each two
    per cent finer than the one before; of equally fine ones that with the fewest calls."""
    fewest = max(1, round(interval / integrators.LONGEST_STEP))
    rungs: dict[int, tuple[int, int]] = {}
    for steps in range(fewest, 8 * fewest + 1):
        calls = fewest_calls(steps, interval)
        if calls is not None:
            rung = int(np.log(steps / fewest) / np.log(1.02))
            rungs[rung] = min(rungs.get(rung, (calls, steps)), (calls, steps))
    return [steps for _, steps in rungs.values()]


def _point(solve: Solver, start: FloatArray, times: FloatArray, trajectories: int, setting: Any) -> Point:
    """Time of a trajectory and energy error with a setting."""
    spent = np.inf
    for _ in range(2):  # the first call may compile
        begin = clock()
        states = solve(setting)
        spent = min(spent, clock() - begin)
        if spent > 1.0:
            break
    first = energy(Parameters(), start)
    error = float(np.abs(energy(Parameters(), states) - first).max() / abs(first))
    words = f"{setting / (times[1] - times[0]):g} steps/s" if isinstance(setting, int) else f"tolerance {setting:.1e}"
    return Point(setting, f"{words}, error {error:.1e}", spent / trajectories, error)


def search(point: Callable[[Any], Point], ladder: Sequence[Any]) -> tuple[Point | None, list[Point]]:
    """The fastest of the coarsest settings that are accurate enough, and all that were tried, from coarse to fine."""
    found: dict[int, Point] = {}

    def accurate(rung: int) -> bool:
        if rung not in found:
            found[rung] = point(ladder[rung])
        return found[rung].error <= ENERGY_ERROR

    low, high = -1, len(ladder)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if accurate(middle) else (middle, high)
    rung = high
    while rung < min(high + FINER + 1, len(ladder)):
        if not accurate(rung):  # it was by chance that the one before was
            high = rung + 1
        rung += 1
    enough = [found[place] for place in found if place >= high]
    tried = [found[place] for place in sorted(found)]
    return min(enough, key=lambda one: one.seconds, default=None), tried


@dataclass(frozen=True)
class Contestant:
    """A solver with the setting that was found for it."""

    name: str
    solve: Solver
    point: Point
    trajectories: int

    @property
    def label(self) -> str:
        return self.name + (f", each of {self.trajectories}" if self.trajectories > 1 else "")

    def subject(self) -> Subject:
        return Subject(self.name, repeated(partial(self.solve, self.point.setting)), self.trajectories)


def _compare(bench: Bench, run: str, contestants: Mapping[str, Contestant], pairs: Sequence[Pair], rounds: int) -> None:
    """Times them once more, interleaved, and notes the ratios of the pairs of which both are there."""
    pairs = [pair for pair in pairs if pair[0] in contestants and pair[1] in contestants]
    if not pairs:
        return
    names = list(dict.fromkeys(name for pair in pairs for name in pair[:2]))
    timings = bench.timings([contestants[name].subject() for name in names], rounds)
    seconds = {name: timing.whole for name, timing in zip(names, timings, strict=True)}
    for mine, theirs, target in pairs:
        ours, other = contestants[mine], contestants[theirs]
        settings = f"; {ours.point.description} beside {other.point.description}"
        bench.compare("passive", f"{run}: {ours.label}", seconds[mine], other.label, seconds[theirs], target, settings)
