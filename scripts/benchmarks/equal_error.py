"""This system beside MuJoCo's model of it, with the same error of the state after 10 s."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.environments import DAMPING, ENDLESS, NEVER, PASSIVE
from benchmarks.measuring import Bench, FloatArray, Subject, Target, peer, repeated
from benchmarks.mujoco_peer import mujoco_batch, mujoco_model, mujoco_runner
from benchmarks.solvers import MOTIONS
from spring_pendulum_env import Parameters, equilibrium, simulate

MUST_REACH: Target = ("at least", 200.0)
SECONDS = 10.0
PERIOD = 0.02
MOST_SUBSTEPS = 1024


def measure(bench: Bench) -> None:
    """The passive pendulum, and the actuated one."""
    peer("mujoco")
    for motion, start in MOTIONS.items():
        _measure_passive(bench, motion, start)
    _measure_actuated(bench)


def _measure_passive(bench: Bench, motion: str, start: FloatArray) -> None:
    """The passive pendulum; both sides run the 10 s in one call."""
    exact = simulate(None, start, [0.0, SECONDS], rtol=3e-14, atol=1e-14).states[-1]
    env = gym.make(PASSIVE, tolerance=None, control_period=SECONDS, max_episode_steps=NEVER)

    def ours() -> FloatArray:
        env.reset(options={"state": start})
        return np.asarray(env.step(None)[0])

    batch = gym.make_vec(PASSIVE, num_envs=1024, tolerance=None, max_episode_steps=NEVER)
    batch.reset(options={"state": start})
    _compare(bench, f"{motion} passive motion", ours, start, np.zeros((1, 0)), exact, batch, None)


def _measure_actuated(bench: Bench) -> None:
    """The default damping task under random forces, one call for each control period."""
    random = np.random.default_rng(0)
    actions = random.uniform(-1.0, 1.0, (round(SECONDS / PERIOD), 3))
    spread = np.repeat([0.0, 0.4, 0.0, 1.0], (3, 6, 3, 6))
    start = equilibrium(None, "hanging-hanging") + spread * random.normal(size=18)
    env, fine = gym.make(DAMPING, **ENDLESS), gym.make(DAMPING, tolerance=1e-14, **ENDLESS)

    def run(environment: Any) -> FloatArray:
        environment.reset(options={"state": start})
        for action in actions:
            observation = environment.step(action)[0]
        return np.asarray(observation)

    batch = gym.make_vec(DAMPING, num_envs=1024, **ENDLESS)
    batch.reset(options={"state": start})
    forces = random.uniform(-1.0, 1.0, (1024, 3))
    _compare(bench, "motion under random forces", lambda: run(env), start, actions, run(fine), batch, forces)


def _compare(
    bench: Bench,
    motion: str,
    ours: Callable[[], FloatArray],
    start: FloatArray,
    actions: FloatArray,
    exact: FloatArray,
    batch: Any,
    forces: FloatArray | None,
) -> None:
    """One pendulum and many, MuJoCo's steps as short as our error needs.

    Args:
        bench: takes the results.
        motion: its name.
        ours: runs the 10 s in the environment; the state at the end.
        start: the state at the beginning.
        actions: one for each call of MuJoCo that makes up the 10 s.
        exact: the state at the end, as exact as can be had.
        batch: a vector environment of the same, and
        forces: its actions.
    """
    actuated = forces is not None
    in_a_call = round(SECONDS / PERIOD) // len(actions)

    def runner(substeps: int) -> Callable[[], FloatArray]:
        run = mujoco_runner(mujoco_model(Parameters(), substeps, actuated=actuated), substeps * in_a_call)
        return lambda: run(start, actions)

    def error(substeps: int) -> float:
        return float(np.abs(runner(substeps)() - exact).max())

    allowed = float(np.abs(ours() - exact).max())
    substeps = fewest(error, allowed)
    if substeps is None:
        bench.say(f"MuJoCo, {motion}: {MOST_SUBSTEPS} steps in {PERIOD} s err more than {allowed:.1e}, skipped")
        return
    periods = round(SECONDS / PERIOD)
    timings = bench.timings(
        [
            Subject("environment", repeated(ours), periods),
            Subject("MuJoCo", repeated(runner(substeps)), periods),
            Subject("vector environment", repeated(lambda: batch.step(forces)), batch.num_envs),
            mujoco_batch(start, 64, substeps, actuated=actuated),
        ]
    )
    one, other, row, other_row = (timing.whole for timing in timings)
    theirs, more = "this system in MuJoCo", f"; {substeps} steps of its RK4 in {PERIOD} s"
    what = f"{motion}, error {allowed:.1e} after {SECONDS:g} s"
    bench.compare("mujoco", f"{what}: one", one, theirs, other, MUST_REACH, more)
    bench.compare(
        "mujoco", f"{what}: a row of {batch.num_envs:,}", row, f"{theirs}, a batch", other_row, MUST_REACH, more
    )


def fewest(error: Callable[[int], float], allowed: float) -> int | None:
    """The fewest steps whose error is small enough, to a thirtieth, if more steps err less; None if MOST_SUBSTEPS err
    more."""
    high = 1
    while error(high) > allowed:
        if high >= MOST_SUBSTEPS:
            return None
        high *= 2
    low = high // 2
    while high - low > max(1, high // 32):
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) <= allowed else (middle, high)
    return high
