"""What each part of a step costs, and how much of the processor's divider a step uses."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.environments import DAMPING, ENDLESS, gymnasium_batch
from benchmarks.inside import CALM, placed, require, stepping
from benchmarks.measuring import Bench, Subject, repeated
from benchmarks.report import number
from spring_pendulum_env import integrators, physics, tasks


def measure(bench: Bench) -> None:
    """What each part of a vector step costs, beside what the processor's divider alone would need."""
    require("parts")
    bench.curves["parts"] = {}
    roots, divisions = divider_work()
    divider = divider_subject(roots, divisions)
    for size in (1, *bench.effort.sizes):
        subjects = [
            gymnasium_batch(DAMPING, size, "ours", bench.effort.warm_up),
            gymnasium_batch(DAMPING, size, "ours, no episode ending", 10, **ENDLESS),
            Subject("compiled", repeated(stepping(*placed(size))), size),
            Subject("calm", repeated(stepping(*placed(size, start_scale=CALM))), size),
            # five integration steps in a control period, and one report as before
            Subject("longer", repeated(stepping(*placed(size, start_scale=CALM, control_period=0.1))), size),
            divider,
        ]
        timings = bench.timings(subjects)
        ending, whole, compiled, calmly, extended, limit = (timing.without_resets * 1e6 for timing in timings)
        integrate = (extended - calmly) / 4
        parts = {
            "integrate": integrate,
            "near misses again": compiled - calmly,
            "report, in and out": calmly - integrate,
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
