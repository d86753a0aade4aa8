"""Imports, and the first step."""

from __future__ import annotations

import math
import tempfile

import numpy as np

from benchmarks.environments import DAMPING
from benchmarks.measuring import Bench, Target, printed_number

IMPORT: Target = ("at most", 1.15)
COLD: Target = ("at most", 5.0)
WARM: Target = ("at most", 1.0)


def measure(bench: Bench) -> None:
    """How long the import takes, and the first environment, with and without compiled code at hand."""
    once = "import time; begin = time.process_time(); import {}; print(time.process_time() - begin)"
    imports: dict[str, list[float]] = {"gymnasium": [], "spring_pendulum_env": []}
    for _ in range(bench.effort.starts + 1):  # the first only fills the file cache
        for module, seconds in imports.items():
            seconds.append(printed_number(once.format(module)) or math.nan)
    alone, ours = (np.array(seconds[1:]) for seconds in imports.values())
    bench.compare("start", "import spring_pendulum_env", ours, "import gymnasium", alone, IMPORT)
    for call, cold_target, warm_target in (("make", COLD, WARM), ("make_vec", None, None)):
        program = _FIRST_STEP.format(call=call, id=DAMPING)
        cold, warm = [], []
        for _ in range(max(1, bench.effort.starts // 2)):
            with tempfile.TemporaryDirectory() as folder:
                cold.append(printed_number(program, NUMBA_CACHE_DIR=folder) or math.nan)
                warm.append(printed_number(program, NUMBA_CACHE_DIR=folder) or math.nan)
        bench.add("start", f"first {call}, reset and step, nothing compiled", "", cold, "s", cold_target)
        bench.add("start", f"first {call}, reset and step, compiled before", "", warm, "s", warm_target)


_FIRST_STEP = """
import time, gymnasium as gym, spring_pendulum_env
begin = time.process_time()
env = gym.{call}("{id}")
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.process_time() - begin)
"""
