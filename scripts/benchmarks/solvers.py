"""Integrators of the passive pendulum as functions of how finely they are to integrate: ours, heyoka and SciPy.

Each is used as at its fastest: what can be compiled or made beforehand is, and nothing is asked of it on the way but
the states at the sampling times.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.environments import NEVER, PASSIVE
from benchmarks.measuring import FloatArray, peer
from spring_pendulum_env import Parameters, integrators, physics, simulate

MOTIONS = {
    "regular": np.array([0.1, 0.0, -1.25, 0.25, 0.05, -2.35, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0]),
    "violent": np.array([0.26, 0.64, -1.08, 0.86, -0.12, -2.85, -1.55, -1.21, 0.62, -0.85, 0.2, 1.54]),
}
"""Starts of the passive pendulum: a small swing; 53 J above rest, chaotic, with springs never shorter than 0.15 m."""

Solver = Callable[[Any], FloatArray]
"""From a setting, the steps between two sampling times or a tolerance, to the states at the sampling times."""


def fewest_calls(steps: int, interval: float) -> int | None:
    """Into how many control periods to divide an interval, so that they are as long as can be and the splitting takes
    so many steps in it: a control period longer than LONGEST_STEP is divided into equal steps. None if it can't."""
    for calls in range(1, steps + 1):
        period = interval / calls
        if steps % calls == 0 and steps // calls == max(1, math.ceil(period / integrators.LONGEST_STEP - 1e-9)):
            return calls
    return None


def _periods(setting: Any, times: FloatArray) -> tuple[int, dict[str, Any]]:
    """Calls between two sampling times, and the environment's arguments, for steps of the splitting or a tolerance."""
    interval = float(times[1] - times[0])
    calls = fewest_calls(setting, interval) if isinstance(setting, int) else 1
    if calls is None:
        raise ValueError(f"setting = {setting}: no control period gives so many steps in {interval} s")
    tolerance = None if isinstance(setting, int) else setting
    return calls, {"control_period": interval / calls, "tolerance": tolerance, "max_episode_steps": NEVER}


def environment_solver(start: FloatArray, times: FloatArray) -> Solver:
    """The environment, in control periods as long as the setting allows."""
    for tolerance in (None, 1e-6):  # compiles it
        gym.make(PASSIVE, tolerance=tolerance).reset(options={"state": start})
    made: dict[Any, Any] = {}

    def solve(setting: Any) -> FloatArray:
        calls, arguments = _periods(setting, times)
        if setting not in made:
            made[setting] = gym.make(PASSIVE, **arguments)
        step = made[setting].step
        observation, _ = made[setting].reset(options={"state": start})
        states = [observation]
        for _ in times[1:]:
            for _ in range(calls):
                observation = step(None)[0]
            states.append(observation)
        return np.array(states)

    return solve


def simulate_solver(start: FloatArray, times: FloatArray) -> Solver:
    """`simulate` by the splitting, all of the run in one call."""
    simulate(None, start, times[:2], "splitting")  # compiles it

    def solve(setting: Any) -> FloatArray:
        return simulate(None, start, times, "splitting", step=float(times[1] - times[0]) / setting).states

    return solve


def vector_solver(start: FloatArray, times: FloatArray, rows: int) -> Solver:
    """The vector environment likewise, every row the same motion; the states of the last row."""
    gym.make_vec(PASSIVE, num_envs=1, tolerance=None).reset(options={"state": start})  # compiles it
    made: dict[Any, Any] = {}

    def solve(setting: Any) -> FloatArray:
        calls, arguments = _periods(setting, times)
        if setting not in made:
            made[setting] = gym.make_vec(PASSIVE, num_envs=rows, **arguments)
        step = made[setting].step
        observations, _ = made[setting].reset(options={"state": start})
        states = [observations[-1]]
        for _ in times[1:]:
            for _ in range(calls):
                observations = step(None)[0]
            states.append(observations[-1])
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


def heyoka_solver(parameters: Parameters, start: FloatArray, times: FloatArray) -> Solver:
    """heyoka's Taylor integrator in its default mode, which runs faster than the compact one, with fast_math."""
    heyoka = peer("heyoka")
    system = heyoka_system(parameters)
    compiled: dict[float, Any] = {}

    def solve(tolerance: float) -> FloatArray:
        if tolerance not in compiled:
            compiled[tolerance] = heyoka.taylor_adaptive(system, start, tol=tolerance, fast_math=True)
        integrator = compiled[tolerance]
        integrator.time = times[0]
        integrator.state[:] = start
        return np.asarray(integrator.propagate_grid(times)[-1])

    return solve


def heyoka_lanes() -> int:
    """How many trajectories heyoka's batch mode takes best at once here."""
    lanes: int = peer("heyoka").recommended_simd_size()
    return lanes


def heyoka_batch_solver(parameters: Parameters, start: FloatArray, times: FloatArray) -> Solver:
    """heyoka's batch mode, every lane the same motion, so that none waits for another; the states of the last lane."""
    heyoka = peer("heyoka")
    system = heyoka_system(parameters)
    compiled: dict[float, Any] = {}
    state = np.repeat(start[:, None], heyoka_lanes(), axis=1)
    grid = np.repeat(times[:, None], heyoka_lanes(), axis=1)

    def solve(tolerance: float) -> FloatArray:
        if tolerance not in compiled:
            compiled[tolerance] = heyoka.taylor_adaptive_batch(system, state, tol=tolerance, fast_math=True)
        integrator = compiled[tolerance]
        integrator.set_time(times[0])
        integrator.state[:] = state
        return np.asarray(integrator.propagate_grid(grid)[-1])[..., -1]

    return solve


def scipy_solver(parameters: Parameters, start: FloatArray, times: FloatArray) -> Solver:
    """SciPy's DOP853 with the equations in Python, on Python's own numbers: on arrays they would take longer."""
    return lambda tolerance: simulate(parameters, start, times, "DOP853", tolerance, tolerance).states


def compiled_scipy_solver(parameters: Parameters, start: FloatArray, times: FloatArray) -> Solver:
    """SciPy's DOP853 with the equations compiled by numba."""
    from scipy.integrate import solve_ivp

    slope = compiled_slope(parameters)
    slope(0.0, start)  # compiles
    span = (times[0], times[-1])
    return lambda tolerance: solve_ivp(slope, span, start, "DOP853", times, rtol=tolerance, atol=tolerance).y.T


def compiled_slope(parameters: Parameters) -> Callable[[float, FloatArray], FloatArray]:
    """The right-hand side of the passive pendulum, compiled by numba."""
    import numba

    import spring_pendulum_env.jit  # noqa: F401 (lets numba compile the functions of physics.py)

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
