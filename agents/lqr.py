"""Linear-quadratic regulator about any of the four equilibria, from the linearisation of the simulated model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, expm, solve_discrete_are

from agents.controller import AXES, STATE_SIZE, StateFeedback
from agents.relative import TRANSFORM
from spring_pendulum_env import Parameters, equilibrium, linearise

# Bryson's rule: each weight is one over the square of the excursion that is held to be as bad as any other one. They
# are excursions of the relative coordinates, since what matters is a spring out of place, not where in the room it is.
# These serve all four equilibria and the damping of violent swings; a force held cheaper than this spends its time at
# its limit, which the linear theory knows nothing of, and then damps worse.
STATE_WEIGHTS = (1 / 1.0**2, 1 / 0.5**2, 1 / 0.5**2, 1 / 3.0**2, 1 / 1.0**2, 1 / 1.5**2)  # m, m, m, m/s, m/s, m/s
EFFORT_WEIGHT = 1 / 5.0**2  # N


class LQR(StateFeedback):
    """Discrete-time linear-quadratic regulator.

    The continuous linearisation (A, B) is discretised by the exact exponential for a force held over each control
    period, and the gain comes from the discrete algebraic Riccati equation. (Anderson and Moore, Optimal Control:
    Linear Quadratic Methods, 1990; Van Loan, IEEE Trans. Automat. Contr. 23, 1978, for the exponential.)

    Arguments:
        parameters: of the model, a `Parameters` or a mapping of some of its names to numbers.
        equilibrium_name: "hanging-hanging", "hanging-inverted", "inverted-hanging" or "inverted-inverted".
        control_period: s, for which each force is held.
        max_force: N on each axis; the action 1.
        actuated_axes: "xyz", "xz", "x", ... A held axis cannot be steered, and at a vertical equilibrium its motion
            does not act on the other axes, so its states are left out: their columns of K and P are zero.
        state_weights: six positive numbers, the weights of the anchor's position, spring 1's vector, spring 2's vector
            (1/m^2) and the rates of the three (s^2/m^2), each for all three axes.
        effort_weight: weight of the force, 1/N^2.

    Attributes (x is observation - equilibrium, 18 numbers in m and m/s; u is the force on the actuated axes in N):
        Q (18, 18), R (axes, axes): the cost is the sum over control periods of x' Q x + u' R u, without unit.
        K (axes, 18): the force is -K x before limiting, in N/m and N s/m.
        P (18, 18): the cost to come from x is x' P x.
        steered: indices of the states that are not left out.
        transition (n, n), input_matrix (n, axes): the discrete model of those states.

    Raises ValueError for an argument that is not allowed, also where the springs cannot hold the equilibrium or no
    gain stabilises it.
    """

    def __init__(
        self,
        parameters: Parameters | Mapping[str, float],
        equilibrium_name: str,
        *,
        control_period: float = 0.02,
        max_force: float = 20.0,
        actuated_axes: str = AXES,
        state_weights: Sequence[float] = STATE_WEIGHTS,
        effort_weight: float = EFFORT_WEIGHT,
    ) -> None:
        self.parameters = Parameters.of(parameters)
        self.equilibrium_name = equilibrium_name
        self.control_period = _positive("control_period", control_period)
        self.max_force = _positive("max_force", max_force)
        self.axes = _axis_numbers(actuated_axes)
        weights = np.asarray(state_weights, dtype=np.float64)
        if weights.shape != (6,) or not (np.isfinite(weights).all() and (weights > 0).all()):
            raise ValueError(f"state_weights is {state_weights!r}; allowed are six positive finite numbers")

        self.equilibrium = np.asarray(equilibrium(self.parameters, equilibrium_name), dtype=np.float64)
        A, B = linearise(self.parameters, equilibrium_name)
        self.steered = np.array([i for i in range(STATE_SIZE) if i % 3 in self.axes])
        kept = np.ix_(self.steered, self.steered)
        self.transition, self.input_matrix = discretise(A[kept], B[self.steered][:, self.axes], self.control_period)

        self.Q = TRANSFORM.T @ np.diag(np.repeat(weights, 3)) @ TRANSFORM
        held = np.setdiff1d(np.arange(STATE_SIZE), self.steered)
        self.Q[held] = 0.0
        self.Q[:, held] = 0.0
        self.R = _positive("effort_weight", effort_weight) * np.eye(len(self.axes))
        try:
            P = solve_discrete_are(self.transition, self.input_matrix, self.Q[kept], self.R)
        except LinAlgError as error:
            raise ValueError(
                f"equilibrium_name is {equilibrium_name!r}, which no gain stabilises with {self.parameters}: {error}"
            ) from error
        gain = self.input_matrix.T @ P
        self.P = np.zeros((STATE_SIZE, STATE_SIZE))
        self.P[kept] = P
        self.K = np.zeros((len(self.axes), STATE_SIZE))
        self.K[:, self.steered] = np.linalg.solve(self.R + gain @ self.input_matrix, gain @ self.transition)

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:  # noqa: ARG002
        """Force over max_force, limited to [-1, 1]: (n, axes) for observations (n, 18)."""
        forces = -(observations - self.equilibrium) @ self.K.T
        return np.clip(forces / self.max_force, -1.0, 1.0)


def discretise(
    A: NDArray[np.float64], B: NDArray[np.float64], period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exact discrete model of x' = A x + B u for u held over `period` (s): exp of the matrix augmented by B."""
    n, m = B.shape
    augmented = np.zeros((n + m, n + m))
    augmented[:n, :n] = A
    augmented[:n, n:] = B
    exponential = expm(augmented * period)
    return exponential[:n, :n], exponential[:n, n:]


def _positive(name: str, value: float) -> float:
    """Return the number, or raise a ValueError that names it."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not 0 < value < np.inf:
        raise ValueError(f"{name} is {value!r}; allowed is a positive finite number")
    return float(value)


def _axis_numbers(actuated_axes: str) -> list[int]:
    """Numbers of the axes, x = 0, in the order of the action, which is the alphabet's."""
    wrong = not isinstance(actuated_axes, str) or not actuated_axes or not set(actuated_axes) <= set(AXES)
    if wrong or len(set(actuated_axes)) != len(actuated_axes):
        raise ValueError(f"actuated_axes is {actuated_axes!r}; allowed are one to three different letters of 'xyz'")
    return sorted(AXES.index(axis) for axis in actuated_axes)
