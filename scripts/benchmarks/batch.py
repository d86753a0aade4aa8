"""Full steps of vector environments."""

from __future__ import annotations

from functools import partial

import numpy as np

import spring_pendulum_env
from benchmarks.environments import DAMPING, ENDLESS, envpool_batch, gymnasium_batch, gymnax_batch
from benchmarks.measuring import Bench, FloatArray, Target, installed
from benchmarks.mujoco_peer import mujoco_batch

MUST_REACH: dict[str, Target] = {
    "Acrobot-v1 in SyncVectorEnv of 64": ("at least", 300.0),
    "EnvPool Acrobot-v1": ("at least", 10.0),
    "gymnax Acrobot-v1, one call a step": ("at least", 3.0),
    "gymnax Acrobot-v1, one call a step, NumPy in and out": ("at least", 3.0),
    "CartPole-v1, native": ("at least", 0.8),
}
"""Of 1,024 environments."""
LARGEST_GROWTH: Target = ("at most", 1.3)
"""Time of a step of one environment of 16,384, beside one of 1,024."""


def measure(bench: Bench) -> None:
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
            partial(gymnax_batch, size, as_numpy=True),
            partial(gymnax_batch, size, 100 if size <= 1024 else 10),
            partial(mujoco_batch, _rest(), min(size, 1024), 4, actuated=True),
        ]
        if size > 1024:
            makers.append(partial(gymnasium_batch, DAMPING, 1024, "ours at 1,024", warm_up))
        subjects = installed(makers, bench.say)
        ours, *others = bench.timings(subjects)
        for subject, theirs in zip(subjects[1:], others, strict=True):
            target = MUST_REACH.get(subject.name) if size == 1024 else None
            target = LARGEST_GROWTH if subject.name == "ours at 1,024" else target
            bench.compare("batch", f"{size:,} environments", ours.whole, subject.name, theirs.without_resets, target)


def _rest() -> FloatArray:
    """The actuated pendulum hanging, a little aside."""
    state: FloatArray = spring_pendulum_env.equilibrium(None, "hanging-hanging") + np.eye(18)[3] * 0.1
    return state
