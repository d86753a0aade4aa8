"""The passive pendulum beside MuJoCo's model of it, with the same error after 10 s."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.environments import NEVER, PASSIVE
from benchmarks.measuring import Bench, FloatArray, Subject, Target, repeated
from benchmarks.mujoco_peer import mujoco_batch, mujoco_model, mujoco_run
from spring_pendulum_env import Parameters, simulate

MUST_REACH: Target = ("at least", 200.0)


def measure_beside_mujoco(bench: Bench, motion: str, start: FloatArray) -> None:
    """Both with the same error of the state after 10 s: MuJoCo's steps are made as short as that needs."""
    periods = 500
    exact = simulate(None, start, [0.0, 10.0], rtol=3e-14, atol=1e-14).states[-1]
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
        Subject("environment", repeated(ours), periods),
        Subject("MuJoCo", repeated(partial(mujoco_run, model, start, periods, substeps)), periods),
        Subject("vector environment of 1,024, a row", repeated(partial(batch.step, None)), 1024),
        mujoco_batch(start, 64, substeps, actuated=False),
    ]
    one, theirs, row, their_row = bench.timings(subjects)
    beside, more = "this system in MuJoCo", f"; {substeps} steps of RK4 in MuJoCo for one of ours"
    what = f"{motion}, error {allowed:.1e} after 10 s"
    bench.compare("passive", f"{what}: environment", one.whole, beside, theirs.whole, MUST_REACH, more)
    bench.compare(
        "passive", f"{what}: batch of 1,024, a row", row.whole, f"{beside}, a batch", their_row.whole, MUST_REACH, more
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
