"""Environments as subjects of the benchmark: ours through Gymnasium's interface, and the peers through theirs."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

import spring_pendulum_env  # noqa: F401 (registers the ids)
from benchmarks.measuring import FloatArray, SkippedError, Subject, clock, peer

DAMPING = "SpringPendulumDamping-v0"
PASSIVE = "SpringPendulumPassive-v0"
EMPTY = "an empty environment"
EMPTY_ID = "BenchmarkEmpty-v0"
NATIVE = "vector_entry_point"
NEVER = 10**9
"""Steps after which an episode ends that is to go on."""
PREPARED = 1000
"""Random actions that are drawn before the clock starts, and used again and again."""
ENDLESS: dict[str, Any] = {"anchor_travel": 1e9, "max_episode_steps": NEVER}
"""Arguments under which no episode ends."""
LASTING = 80
"""Steps after which such ones are all reset, beside the clock: about as long as episodes last under random forces,
which would otherwise drive the motion on and on."""


class EmptyEnv(gym.Env[FloatArray, Any]):
    """Does nothing: what all of Gymnasium's default wrappers cost."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (18,), np.float64)
    action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)

    def __init__(self) -> None:
        self._observation = np.zeros(18)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        return self._observation, {}

    def step(self, action: Any) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        return self._observation, 0.0, False, False, {}


def single_steps(env_id: str, name: str | None = None, *, checked: bool = False) -> Subject:
    """Steps of gym.make(env_id) with its default wrappers and random actions; episodes that end start anew.

    Ours are registered without the wrappers that check an environment and the order of calls; `checked` puts them on.
    """
    if env_id == EMPTY_ID and env_id not in gym.registry:
        gym.register(EMPTY_ID, entry_point=lambda **_: EmptyEnv(), max_episode_steps=500)
    try:
        env: Any = gym.make(env_id)
    except gym.error.DependencyNotInstalled:
        raise SkippedError(f"{env_id}: MuJoCo not installed, skipped") from None
    if checked:
        checker = gym.wrappers.OrderEnforcing(gym.wrappers.PassiveEnvChecker(env.unwrapped))
        env = gym.wrappers.TimeLimit(checker, env.spec.max_episode_steps)
    env.action_space.seed(0)
    actions = itertools.cycle([env.action_space.sample() for _ in range(PREPARED)])
    env.reset(seed=0)

    def run(calls: int) -> float:
        step = env.step
        resets = 0.0
        for _, action in zip(range(calls), actions, strict=False):
            _, _, terminated, truncated, _ = step(action)
            if terminated or truncated:
                begin = clock()
                env.reset()
                resets += clock() - begin
        return resets

    return Subject(name or env_id, run)


def _batch(name: str, env: Any, pool: NDArray[Any], warm_up: int, lasting: int = NEVER) -> Subject:
    """Full steps of a vector environment; warmed up, so that its rows end and start anew at different times.

    Args:
        name: as the table says it.
        env: what is stepped.
        pool: random actions, PREPARED more than there are rows. Each step's are a window of it, so that a row gets
            PREPARED different ones: with few of them, their mean drives the rows off and ends episodes early.
        warm_up: steps.
        lasting: steps after which all rows are reset.
    """
    offsets = itertools.cycle(np.random.default_rng(0).permutation(PREPARED).tolist())
    count = env.num_envs
    env.reset(seed=0)
    done = itertools.count(1)

    def run(calls: int) -> float:
        resets = 0.0
        for _, offset in zip(range(calls), offsets, strict=False):
            env.step(pool[offset : offset + count])
            if next(done) % lasting == 0:
                begin = clock()
                env.reset()
                resets += clock() - begin
        return resets

    run(warm_up)
    return Subject(name, run, count)


def gymnasium_batch(
    env_id: str, num_envs: int, name: str, warm_up: int, mode: str = NATIVE, **arguments: Any
) -> Subject:
    """A Gymnasium vector environment under random actions: the native one, or mode "sync"."""
    env = gym.make_vec(env_id, num_envs=num_envs, vectorization_mode=mode, **arguments)
    actions = batch_space(env.single_action_space, num_envs + PREPARED)
    actions.seed(0)
    endless = arguments.get("max_episode_steps") == NEVER
    return _batch(name, env, actions.sample(), warm_up, LASTING if endless else NEVER)


def envpool_batch(env_id: str, num_envs: int) -> Subject:
    """EnvPool on one thread."""
    env = peer("envpool").make(env_id, env_type="gymnasium", num_envs=num_envs, num_threads=1, seed=0)
    random = np.random.default_rng(0)
    number = num_envs + PREPARED
    if isinstance(env.action_space, gym.spaces.Discrete):
        pool = random.integers(0, env.action_space.n, number).astype(np.int32)
    else:
        pool = random.uniform(-2, 2, (number, 1)).astype(np.float32)
    return _batch(f"EnvPool {env_id}", _Seedless(env, num_envs), pool, 20)


@dataclass(frozen=True)
class _Seedless:
    """EnvPool's environments are seeded when they are made."""

    env: Any
    num_envs: int

    def reset(self, seed: int) -> None:  # noqa: ARG002
        self.env.reset()

    def step(self, actions: Any) -> Any:
        return self.env.step(actions)


def gymnax_batch(num_envs: int, scan: int = 0, as_numpy: bool = False) -> Subject:
    """gymnax's Acrobot with its automatic reset: one compiled call for each step, or one for `scan` steps. Float32.

    As JAX is at its fastest: the state's memory is handed over to each call, a call begins while the one before may
    still be running, and what comes out stays with JAX. Or `as_numpy`, as whatever isn't written in JAX needs it:
    NumPy actions go in, and observations, rewards and ends are NumPy arrays before the next call.
    """
    gymnax = peer("gymnax")
    jax = peer("jax")
    env, parameters = gymnax.make("Acrobot-v1")
    keys = jax.random.split(jax.random.key(0), num_envs)
    _, state = jax.jit(jax.vmap(env.reset, in_axes=(0, None)))(keys, parameters)
    batched = jax.vmap(env.step, in_axes=(0, 0, 0, None))

    def step(carry: Any, action: Any) -> Any:
        key, state = carry
        key, now = jax.random.split(key)
        observation, state, *rest = batched(jax.random.split(now, num_envs), state, action, parameters)
        return (key, state), (observation, *rest)

    def steps(carry: Any, actions: Any) -> Any:
        return jax.lax.scan(step, carry, actions)

    advance = jax.jit(steps if scan else step, donate_argnums=0)
    shape = (scan, num_envs) if scan else (num_envs,)
    random = np.random.default_rng(0)
    kind = np.asarray if as_numpy else jax.numpy.asarray
    actions = itertools.cycle([kind(random.integers(0, 3, shape).astype(np.int32)) for _ in range(1 if scan else 64)])
    carried = [(jax.random.key(1), state)]

    def run(calls: int) -> float:
        carry = carried[0]
        for _, action in zip(range(calls), actions, strict=False):
            carry, output = advance(carry, action)
            if as_numpy:
                output = [np.asarray(part) for part in output[:3]]
        carried[0] = jax.block_until_ready((carry, output))[0]
        return 0.0

    run(2)
    name = f"gymnax Acrobot-v1, {scan} steps in a scan" if scan else "gymnax Acrobot-v1, one call a step"
    name += ", NumPy in and out" if as_numpy else ""
    return Subject(name, run, num_envs * max(scan, 1))
