"""Following a plan: LQR along it, which makes up for what pushes the pendulum off it or differs from its model."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controller import STATE_SIZE
from agents.lqr import LQR
from agents.model import FORCES, casadi

Array = NDArray[np.float64]


def slopes_of(step: Any) -> Any:
    """A CasADi function (state, force) -> derivatives (18, 18), (18, 3) by both of a `model.step_function`."""
    library = casadi()
    state, force = library.MX.sym("state", STATE_SIZE), library.MX.sym("force", FORCES)
    end = step(state, force)
    return library.Function("slopes", [state, force], [library.jacobian(end, state), library.jacobian(end, force)])


def gains_along(lqr: LQR, slopes: Any, states: Array, forces: Array) -> list[Array]:
    """LQR's gains (axes, 18) along a plan, N/m and N s/m: the Riccati recursion of the linear models at its states.

    Arguments:
        lqr: its weights count along the plan, and its cost to come at the end.
        slopes: `slopes_of` a step as long as each of the plan's.
        states, forces: the plan, (N or more, 18) and (N, 3), N.
    """
    cost: Array = lqr.P
    gains: list[Array] = []
    for state, force in zip(states[len(forces) - 1 :: -1], forces[::-1], strict=True):
        A, B = (np.array(matrix) for matrix in slopes(state, force))
        B = B[:, lqr.axes]
        gain = np.linalg.solve(lqr.R + B.T @ cost @ B, B.T @ cost @ A)
        cost = lqr.Q + A.T @ cost @ (A - B @ gain)
        gains.append(gain)
    return gains[::-1]


def correction(lqr: LQR, gain: Array, state: Array, planned: Array, force: Array) -> Array:
    """The action (axes,) in [-1, 1] for a state (18,) where the plan has another, under a force (3,), N."""
    newtons = force[lqr.axes] - gain @ (state - planned)
    return np.clip(newtons / lqr.max_force, -1.0, 1.0)
