"""Integrators of the passive pendulum as functions of how finely they are to integrate: ours, heyoka and SciPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.environments import NEVER, PASSIVE
from benchmarks.measuring import FloatArray, peer
from spring_pendulum_env import Parameters, physics

Solver = Callable[[Any], FloatArray]
"""From a setting to the states at the sampling times."""


def environment_solver(start: FloatArray, times: FloatArray) -> Solver:
    """The environment itself, stepped: a whole number is the splitting's steps a second, else it is a tolerance."""
    made: dict[Any, Any] = {}

    def solve(setting: Any) -> FloatArray:
        splitting = isinstance(setting, int)
        per_second = setting if splitting else 1
        if setting not in made:
            made[setting] = gym.make(
                PASSIVE,
                control_period=1 / per_second,
                tolerance=None if splitting else setting,
                max_episode_steps=len(times) * per_second,
            )
        step = made[setting].step
        observation, _ = made[setting].reset(options={"state": start})
        states = [observation]
        for _ in times[1:]:
            for _ in range(per_second):
                observation = step(None)[0]
            states.append(observation)
        return np.array(states)

    return solve


def vector_solver(start: FloatArray, times: FloatArray, rows: int) -> Solver:
    """The vector environment, every row the same motion."""
    made: dict[int, Any] = {}

    def solve(per_second: int) -> FloatArray:
        if per_second not in made:
            arguments: dict[str, Any] = {"control_period": 1 / per_second, "tolerance": None}
            made[per_second] = gym.make_vec(PASSIVE, num_envs=rows, max_episode_steps=NEVER, **arguments)
        step = made[per_second].step
        observations, _ = made[per_second].reset(options={"state": start})
        states = [observations[0].copy()]
        for _ in times[1:]:
            for _ in range(per_second):
                observations = step(None)[0]
            states.append(observations[-1].copy())
        return np.array(states)

    return solve


def heyoka_system(parameters: Parameters) -> Any:
    """The passive pendulum's equations as heyoka's expressions, from the package's one statement of them."""
    heyoka = peer("heyoka")
    names = ("x1", "y1", "z1", "x2", "y2", "z2")
    q, v = heyoka.make_vars(*names), heyoka.make_vars(*(f"v{name}" for name in names))
    still = [0.0] * 3
    constants = (*still, *parameters.constants(actuated_axes=""), *parameters.drag_rates())
    slope = physics.derivatives(*still, *q, *still, *v, *constants)
    return list(zip([*q, *v], [*slope[3:9], *slope[12:18]], strict=True))


def heyoka_solver(parameters: Parameters, start: FloatArray, times: FloatArray, lanes: int = 1) -> Solver:
    """heyoka's Taylor integrator, compiled before the clock starts; with several lanes the same motion in each."""
    heyoka = peer("heyoka")
    system = heyoka_system(parameters)
    compiled: dict[float, Any] = {}
    state = start if lanes == 1 else np.repeat(start[:, None], lanes, axis=1)
    make = heyoka.taylor_adaptive if lanes == 1 else heyoka.taylor_adaptive_batch
    grid = times if lanes == 1 else np.repeat(times[:, None], lanes, axis=1)

    def solve(tolerance: float) -> FloatArray:
        if tolerance not in compiled:
            compiled[tolerance] = make(system, state, tol=tolerance)
        integrator = compiled[tolerance]
        if lanes == 1:
            integrator.time = times[0]
        else:
            integrator.set_time(times[0])
        integrator.state[:] = state
        outcome = integrator.propagate_grid(grid)
        states = np.asarray(outcome[-1])
        return states if lanes == 1 else states[..., 0]

    return solve


def scipy_solver(parameters: Parameters, start: FloatArray, times: FloatArray, *, compiled: bool) -> Solver:
    """SciPy's DOP853 over the package's equations, as plain Python or compiled by numba."""
    from scipy.integrate import solve_ivp

    if not compiled:
        from spring_pendulum_env import simulate

        return lambda tolerance: simulate(parameters, start, times, "DOP853", tolerance, tolerance).states

    slope = compiled_slope(parameters)
    span = (times[0], times[-1])
    return lambda tolerance: (
        solve_ivp(slope, span, start, "DOP853", times, rtol=tolerance, atol=tolerance).y.T  # the transpose is a view
    )


def compiled_slope(parameters: Parameters) -> Callable[[float, FloatArray], FloatArray]:
    """The right-hand side of the passive pendulum, compiled by numba."""
    import numba

    import spring_pendulum_env.kernels  # noqa: F401 (lets numba compile the functions of physics.py)

    constants = (*parameters.constants(actuated_axes=""), *parameters.drag_rates())
    derivatives = physics.derivatives

    def slope(_time: float, y: Any) -> Any:
        (w0x, w0y, w0z, w1, w2, k1, k2, L1, L2, g, load, c0, c1, c2) = constants
        d = derivatives(
            0.0, 0.0, 0.0, y[0], y[1], y[2], y[3], y[4], y[5], 0.0, 0.0, 0.0, y[6], y[7], y[8], y[9], y[10], y[11],
            0.0, 0.0, 0.0, w0x, w0y, w0z, w1, w2, k1, k2, L1, L2, g, load, c0, c1, c2,
        )  # fmt: skip
        return np.array([d[3], d[4], d[5], d[6], d[7], d[8], d[12], d[13], d[14], d[15], d[16], d[17]])

    function: Callable[[float, FloatArray], FloatArray] = numba.njit(error_model="numpy")(slope)
    return function
