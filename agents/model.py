"""The dynamics of physics.py with CasADi's symbols, for optimal control: the same functions, nothing restated."""

from __future__ import annotations

from typing import Any

from agents.controller import STATE_SIZE
from spring_pendulum_env import Parameters, physics

FORCES = 3


def casadi() -> Any:
    """The library, imported on first use. Raises ModuleNotFoundError with a hint how to install it."""
    try:
        import casadi as library
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("optimal control needs CasADi: pip install '.[control]'") from error
    return library


def slope(parameters: Parameters, state: Any, force: Any, actuated_axes: str = physics.AXES) -> Any:
    """Time derivative of the state (18,) under a force (3,), N, on the anchor: `physics.derivatives` on symbols."""
    constants = (*parameters.constants(actuated_axes), *parameters.drag_rates())
    numbers = (*(state[i] for i in range(STATE_SIZE)), *(force[i] for i in range(FORCES)))
    return casadi().vertcat(*physics.derivatives(*[*numbers, *constants]))


def energy(parameters: Parameters, state: Any) -> Any:
    """Kinetic plus potential energy, J: `physics.total_energy` on symbols."""
    p = parameters
    numbers = [state[i] for i in range(STATE_SIZE)]
    return physics.total_energy(*[*numbers, p.m0, p.m1, p.m2, p.k1, p.k2, p.L1, p.L2, p.g])


def step_function(parameters: Parameters, duration: float, parts: int, actuated_axes: str = physics.AXES) -> Any:
    """A CasADi function (state, force) -> state after `duration` s of that force, by `parts` steps of Runge-Kutta 4.

    The environment's own scheme is far more exact, and three times as many operations; how far apart the two are in
    one step, tests/test_optimal_control.py says.
    """
    library = casadi()
    state, force = library.SX.sym("state", STATE_SIZE), library.SX.sym("force", FORCES)
    h = duration / parts
    end = state
    for _ in range(parts):
        slope1 = slope(parameters, end, force, actuated_axes)
        slope2 = slope(parameters, end + h / 2 * slope1, force, actuated_axes)
        slope3 = slope(parameters, end + h / 2 * slope2, force, actuated_axes)
        slope4 = slope(parameters, end + h * slope3, force, actuated_axes)
        end = end + h / 6 * (slope1 + 2 * slope2 + 2 * slope3 + slope4)
    return library.Function("step", [state, force], [end], ["state", "force"], ["end"], {"cse": True})
