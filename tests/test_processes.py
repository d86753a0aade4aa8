"""Environments in other processes and threads: what Gymnasium's and Stable-Baselines3's parallel environments need."""

from __future__ import annotations

import concurrent.futures
import functools
import multiprocessing
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

from spring_pendulum_env.tasks import TASKS

IDS = list(TASKS)
ACTUATED = [name for name, task in TASKS.items() if task.actuated]
STARTS = [method for method in ("fork", "spawn") if method in multiprocessing.get_all_start_methods()]
KINDS = {"passive": ["SpringPendulumPassive-v0"], "actuated": ACTUATED}
"""Ids with the same spaces, which one vector environment can hold."""


def makers(names: list[str], **kwargs: Any) -> list[Callable[[], gym.Env[Any, Any]]]:
    """One function for each environment, with an end that is near; the prefix registers the ids in a new process."""
    return [functools.partial(gym.make, f"spring_pendulum_env:{name}", max_episode_steps=4, **kwargs) for name in names]


def trace(environment_id: str, seed: int) -> bytes:
    """The bits of an episode."""
    env = gym.make(environment_id)
    seen = [env.reset(seed=seed)[0]]
    random = np.random.default_rng(seed)
    for _ in range(50):
        seen.append(env.step(random.uniform(-1, 1, env.action_space.shape))[0])
    return np.array(seen).tobytes()


def trace_of(env: Any, seed: int) -> bytes:
    """The same of an environment that came from another process, half-way through an episode."""
    return np.array([env.step(np.full(env.action_space.shape, 0.1 * seed))[0] for _ in range(20)]).tobytes()


@pytest.mark.parametrize("method", STARTS)
def test_other_processes_give_the_same_bits(method: str) -> None:
    envs = [gym.make(name) for name in IDS]
    for env in envs:
        env.reset(seed=1)
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method)) as pool:
        fresh = list(pool.map(trace, IDS, range(4)))
        taken_along = list(pool.map(trace_of, envs, range(4)))
    assert fresh == [trace(name, seed) for seed, name in enumerate(IDS)]
    assert taken_along == [trace_of(env, seed) for seed, env in enumerate(envs)]


def test_threads_of_their_own_give_the_same_bits() -> None:
    jobs = [(name, seed) for name in IDS for seed in range(6)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        together = list(pool.map(trace, *zip(*jobs, strict=True)))
    assert together == [trace(name, seed) for name, seed in jobs]


def test_vector_environments_step_in_several_threads_at_once() -> None:
    def steps(seed: int) -> bytes:
        env: Any = gym.make_vec(ACTUATED[0], num_envs=200, threads=2)
        env.reset(seed=seed)
        for _ in range(20):
            env.step(np.full((200, 3), 0.1))
        states: bytes = env.states.tobytes()
        env.close()
        return states

    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        assert list(pool.map(steps, range(4))) == [steps(seed) for seed in range(4)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", STARTS)
def test_async_vector_env_gives_the_bits_of_the_synchronous_one(method: str, kind: str) -> None:
    there = AsyncVectorEnv(makers(KINDS[kind]), context=method)
    here = SyncVectorEnv(makers(KINDS[kind]))
    try:
        assert there.reset(seed=5)[0].tobytes() == here.reset(seed=5)[0].tobytes()
        random = np.random.default_rng(0)
        for _ in range(10):  # over two ends
            action = random.uniform(-1, 1, here.action_space.shape).astype(np.float32)
            for ours, theirs in zip(there.step(action)[:4], here.step(action)[:4], strict=True):
                assert np.asarray(ours).tobytes() == np.asarray(theirs).tobytes()
    finally:
        there.close()


@pytest.mark.parametrize("kind", KINDS)
def test_subproc_vec_env_gives_the_bits_of_the_one_in_this_process(kind: str) -> None:
    sb3 = pytest.importorskip("stable_baselines3.common.vec_env")
    there = sb3.SubprocVecEnv(makers(KINDS[kind]), start_method=STARTS[0])
    here = sb3.DummyVecEnv(makers(KINDS[kind]))
    try:
        for envs in (there, here):
            envs.seed(5)
        assert there.reset().tobytes() == here.reset().tobytes()
        random = np.random.default_rng(0)
        for _ in range(10):
            action = random.uniform(-1, 1, (here.num_envs, *here.action_space.shape)).astype(np.float32)
            for ours, theirs in zip(there.step(action)[:3], here.step(action)[:3], strict=True):
                # The one in this process rounds rewards to float32.
                assert ours.astype(theirs.dtype).tobytes() == theirs.tobytes()
        assert there.env_method("reset", seed=3)[0][0].tobytes() == here.env_method("reset", seed=3)[0][0].tobytes()
    finally:
        there.close()


@pytest.mark.filterwarnings("ignore::UserWarning")  # with which Gymnasium tells of the other process's traceback
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_error_in_another_process_arrives_here(wrong: float) -> None:
    there = AsyncVectorEnv(makers(ACTUATED), context=STARTS[0])
    try:
        there.reset(seed=0)
        action = np.zeros((len(ACTUATED), 3), dtype=np.float32)
        action[1, 2] = wrong
        with pytest.raises(ValueError, match="action"):
            there.step(action)
    finally:
        there.close(terminate=True)
