"""Single steps."""

from __future__ import annotations

from functools import partial

from benchmarks.environments import DAMPING, EMPTY, EMPTY_ID, single_steps
from benchmarks.measuring import Bench, Target, installed

MUST_REACH: dict[str, Target] = {
    EMPTY: ("at most", 5.0),
    "CartPole-v1": ("at least", 3.5),
    "Acrobot-v1": ("at least", 20.0),
    "InvertedDoublePendulum-v5": ("at least", 30.0),
}


def measure(bench: Bench) -> None:
    """Single steps through gym.make, wrapped as registered, with the whole info."""
    names = {EMPTY_ID: EMPTY}
    ids = (DAMPING, EMPTY_ID, "CartPole-v1", "Pendulum-v1", "Acrobot-v1", "InvertedDoublePendulum-v5")
    makers = [partial(single_steps, env_id, names.get(env_id)) for env_id in ids]
    makers.append(partial(single_steps, DAMPING, "ours, with the checking wrappers that are default", checked=True))
    subjects = installed(makers, bench.say)
    ours, *others = bench.timings(subjects)
    for subject, theirs in zip(subjects[1:], others, strict=True):
        target = MUST_REACH.get(subject.name)
        bench.compare("single", "a step, resets counted", ours.whole, subject.name, theirs.whole, target)
    for subject, theirs in zip(subjects[1:], others, strict=True):
        target = MUST_REACH.get(subject.name)
        bench.compare("single", "a step alone", ours.without_resets, subject.name, theirs.without_resets, target)
