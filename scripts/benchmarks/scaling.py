"""How time and memory grow with the number of environments, and time with stiffness."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.environments import DAMPING, ENDLESS, gymnasium_batch
from benchmarks.inside import integration_steps
from benchmarks.measuring import Bench, Timing, duration, printed_number
from spring_pendulum_env import Parameters


def measure(bench: Bench) -> None:
    """Time for one environment as their number and their stiffness grow, and memory."""
    effort = bench.effort
    for ending, name, arguments in ((True, "", {}), (False, ", no episode ending", ENDLESS)):
        warm_ups = [min(effort.warm_up, 2**22 // count) if ending else 10 for count in effort.counts]
        subjects = [
            gymnasium_batch(DAMPING, count, "ours", warm_up, **arguments)
            for count, warm_up in zip(effort.counts, warm_ups, strict=True)
        ]
        timings = bench.timings(subjects)
        for count, timing in zip(effort.counts, timings, strict=True):
            how = f"{duration(timing.without_resets * count)} a step of the batch"
            what = f"{count:,} environment{'s' if count > 1 else ''}{name}, each"
            bench.add("scaling", what, "", timing.without_resets * 1e6, "µs", None, how)
        bench.curves[f"number{name}"] = {"x": list(effort.counts), **_spread(timings)}

    stiffnesses = [10.0**power for power in range(1, 7)]
    environments = min(1024, max(effort.counts))
    subjects, steps = [], []
    for k in stiffnesses:
        # Starts of equal spring energy, so that stiffness alone changes.
        arguments = {"parameters": {"k1": k, "k2": k}, "start_scale": min(1.0, math.sqrt(100.0 / k)), **ENDLESS}
        steps.append(integration_steps(0.02, Parameters(k1=k, k2=k).constants()))
        subjects.append(gymnasium_batch(DAMPING, environments, f"k = {k:g}", 10, **arguments))
    timings = bench.timings(subjects)
    for k, count, timing in zip(stiffnesses, steps, timings, strict=True):
        how = f"{count} integration step{'s' if count > 1 else ''} a control period"
        bench.add(
            "scaling", f"k = {k:,.0f} N/m, each of {environments:,}", "", timing.without_resets * 1e6, "µs", None, how
        )
    bench.curves["stiffness"] = {
        "x": stiffnesses,
        "environments": environments,
        "integration steps": steps,
        **_spread(timings),
    }
    largest = max(effort.counts)
    grown = printed_number(_MEMORY.format(id=DAMPING, count=largest))
    if grown is None:
        bench.say("memory: /proc/self/status isn't there, skipped")
    else:
        how = f"{grown / largest / 1e3:.2f} kB for each"
        bench.add("scaling", f"memory for {largest:,} environments", "", grown / 1e6, "MB", None, how)


def _spread(timings: Sequence[Timing]) -> dict[str, list[float]]:
    quartiles = np.percentile([timing.without_resets * 1e6 for timing in timings], [25, 50, 75], axis=1)
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
