"""Playing episodes: one for each seed, all side by side in the native vector environment."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import spring_pendulum_env
from agents.controller import STATE_SIZE, Controller
from agents.disturbances import CALM, Disturbance
from agents.measures import Episodes
from spring_pendulum_env.scenario import Scenario

Array = NDArray[np.float64]


def scenario_of(env: Any) -> Scenario:
    """The arguments in force in an environment made by gym.make or gym.make_vec, before any randomising."""
    scenario: Scenario = env.unwrapped.scenario
    return scenario


def scenario_for(environment_id: str, arguments: Mapping[str, Any]) -> Scenario:
    """The scenario of gym.make's id and arguments; raises as gym.make does."""
    env = gym.make(environment_id, disable_env_checker=True, **arguments)
    env.close()
    return scenario_of(env)


def roll_out(
    controller: Controller,
    environment_id: str,
    arguments: Mapping[str, Any],
    seeds: Sequence[int],
    disturbance: Disturbance = CALM,
) -> Episodes:
    """Run one episode for each seed, all in lockstep, so that `predict` gets a stack.

    `arguments` are those of gym.make. Rows that have ended stay in the stack, their last observation repeated, since a
    controller may keep a state for each row.
    """
    spec = gym.spec(environment_id)
    if spec.max_episode_steps is None:
        raise ValueError(f"environment_id is {environment_id!r}; allowed is a task with a time limit")
    n, steps = len(seeds), spec.max_episode_steps
    env: Any = gym.make_vec(environment_id, num_envs=n, **arguments).unwrapped
    try:
        scenario = scenario_of(env)
        options = {"parameters": dict(disturbance.parameters)} if disturbance.parameters else {}
        observations, infos = env.reset(seed=list(seeds), options=options)
        constants = {name: infos["parameters"][name].copy() for name in spring_pendulum_env.Parameters.names()}
        states = np.full((n, steps + 1, STATE_SIZE), np.nan)
        excess = np.full((n, steps + 1), np.nan)
        forces = np.full((n, steps, 3), np.nan)
        rewards = np.full((n, steps), np.nan)
        lengths = np.full(n, steps)
        ended_early = np.zeros(n, dtype=bool)
        states[:, 0], excess[:, 0] = observations, infos["excess_energy"]

        seen = observations.copy()
        running = np.ones(n, dtype=bool)
        memory: Any = None
        noise = np.random.default_rng([disturbance.seed, 0])
        waiting = deque(np.zeros((disturbance.delay, n, len(scenario.actuated_axes))))
        kicked_at = round(disturbance.kick_time / scenario.control_period) if disturbance.kick else -1
        for step in range(steps):
            if step == kicked_at:
                seen[running] = _kick(env, constants, running, disturbance)[running]
            shown = seen + disturbance.noise * noise.standard_normal(seen.shape) if disturbance.noise else seen
            actions, memory = controller.predict(shown, memory, np.full(n, step == 0))
            waiting.append(actions)
            observations, reward, terminated, truncated, infos = env.step(waiting.popleft())
            # The vector environment starts rows anew that have ended; what they do then is nobody's business.
            seen[running] = observations[running]
            states[running, step + 1] = observations[running]
            excess[running, step + 1] = infos["excess_energy"][running]
            forces[running, step] = infos["force"][running]
            rewards[running, step] = reward[running]
            ended = running & (terminated | truncated)
            lengths[ended] = step + 1
            ended_early |= running & terminated
            running &= ~ended
            if not running.any():
                break
    finally:
        env.close()
    times = np.arange(steps + 1, dtype=np.float64) * scenario.control_period
    equilibria = _equilibria(constants, scenario.equilibrium, n)
    return Episodes(times, states, excess, forces, rewards, equilibria, lengths, ended_early)


def _equilibria(constants: Mapping[str, Array], name: str, n: int) -> Array:
    """Equilibria (n, 18) of the parameters of each row."""
    if all(np.ptp(values) == 0 for values in constants.values()):
        one = spring_pendulum_env.equilibrium({key: float(values[0]) for key, values in constants.items()}, name)
        return np.tile(one, (n, 1))
    rows = [{key: float(values[row]) for key, values in constants.items()} for row in range(n)]
    return np.array([spring_pendulum_env.equilibrium(row, name) for row in rows])


def _kick(env: Any, constants: Mapping[str, Array], running: NDArray[np.bool_], disturbance: Disturbance) -> Array:
    """Change the velocities of both masses in the rows that run, by an impulse on each, and return all states."""
    states: Array = env.states
    n = len(states)
    masses = np.stack([constants["m1"], constants["m2"]], axis=1)
    states[:, 12:18] += (disturbance.kicks(n) / masses[:, :, None]).reshape(n, 6)
    env.reset(options={"state": states, "parameters": dict(constants), "reset_mask": running})
    return states
