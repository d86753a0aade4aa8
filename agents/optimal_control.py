"""Optimal control by direct multiple shooting: the problem that both the NMPC and the open-loop optimum solve.

(Bock and Plitt, IFAC World Congress 1984, for multiple shooting; Andersson and others, Math. Program. Comput. 11, 2019,
for CasADi.) States and forces of each interval are the unknowns, that the dynamics join them is a constraint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.controller import STATE_SIZE
from agents.lqr import LQR
from agents.model import FORCES, casadi, step_function
from spring_pendulum_env import physics

Array = NDArray[np.float64]

SOLVERS: dict[str, dict[str, Any]] = {
    "ipopt": {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0},
    "fatrop": {"fatrop.print_level": 0, "print_time": 0, "structure_detection": "auto"},
}
"""Interior-point solvers that come with CasADi: IPOPT for any problem (Waechter and Biegler, Math. Program. 106, 2006),
and fatrop, which knows the structure of optimal control and finds the same in half the time (Vanroye and others, IROS
2023), but version 1.1.8 was seen to search for ever where there is nothing to be found, so it is no default."""


class Solution(NamedTuple):
    """States (N + 1, 18), forces (N, 3) in N, whether the solver says it is one, its number of iterations."""

    states: Array
    forces: Array
    success: bool
    iterations: int


@dataclass(frozen=True)
class Problem:
    """What is to be made small over N intervals, and within which bounds.

    Arguments:
        lqr: knows the model, the equilibrium, the force limit and the axes; its Q and R may serve as the cost.
        intervals, duration: how many, and how long each is, s; the force is held over each.
        parts: steps of the integration in each interval.
        stage_cost: of (state, force), CasADi expressions, for each interval.
        final_cost: of the last state.
        anchor_travel: bound of the anchor's coordinates, m.
        largest_deviation: bound of each mass's distance from its place relative to the anchor, m, or None.
        final_level: bound of x' P x at the end, x being what is off the equilibrium and P LQR's, or None.
    """

    lqr: LQR
    intervals: int
    duration: float
    parts: int
    stage_cost: Callable[[Any, Any], Any]
    final_cost: Callable[[Any], Any]
    anchor_travel: float
    largest_deviation: float | None = None
    final_level: float | None = None


class Solver:
    """Solves a `Problem` from any start. `solver` is "ipopt" or "fatrop", `options` are its own.

    Raises ValueError for an unknown solver, ModuleNotFoundError where CasADi isn't there.
    """

    def __init__(self, problem: Problem, solver: str, options: dict[str, Any]) -> None:
        if solver not in SOLVERS:
            raise ValueError(f"solver is {solver!r}; allowed are {', '.join(SOLVERS)}")
        library = casadi()
        self.problem = problem
        n, lqr = problem.intervals, problem.lqr
        axes = "".join(physics.AXES[axis] for axis in lqr.axes)
        step = step_function(lqr.parameters, problem.duration, problem.parts, axes)
        states = [library.MX.sym(f"state{k}", STATE_SIZE) for k in range(n + 1)]
        forces = [library.MX.sym(f"force{k}", FORCES) for k in range(n)]  # in units of max_force
        start = library.MX.sym("start", STATE_SIZE)
        unknowns: list[Any] = []
        constraints: list[tuple[Any, Array, Array]] = []
        cost = 0
        for k in range(n):
            unknowns += [states[k], forces[k]]
            newtons = lqr.max_force * forces[k]
            cost += problem.stage_cost(states[k], newtons)
            constraints.append(_equal(states[k + 1] - step(states[k], newtons)))
            constraints += [_equal(states[0] - start)] if k == 0 else self._path(states[k])
        unknowns.append(states[n])
        cost += problem.final_cost(states[n])
        constraints += self._path(states[n])
        if problem.final_level is not None:
            off = states[n] - lqr.equilibrium
            constraints.append(_at_most(library.bilin(library.DM(lqr.P), off, off) / problem.final_level, 1.0))

        self._lower, self._upper = (np.concatenate(sides) for sides in zip(*(c[1:] for c in constraints), strict=True))
        structure = {"equality": (self._lower == self._upper).tolist()} if solver == "fatrop" else {}
        self._solve = library.nlpsol(
            "optimum",
            solver,
            {
                "x": library.vertcat(*unknowns),
                "p": start,
                "f": cost,
                "g": library.vertcat(*(c[0] for c in constraints)),
            },
            {"expand": True, "error_on_fail": False} | SOLVERS[solver] | structure | options,
        )
        self._bounds = self._unknowns_bounds()

    def solve(self, start: Array, states: Array, forces: Array) -> Solution:
        """Solve from `start` (18,), beginning with a guess: states (N + 1, 18) and forces (N, 3), N."""
        low, high = self._bounds
        guess = self._pack(states, forces / self.problem.lqr.max_force)
        found = self._solve(x0=guess, p=start, lbx=low, ubx=high, lbg=self._lower, ubg=self._upper)
        numbers = np.append(np.asarray(found["x"]).ravel(), np.zeros(FORCES))
        table = numbers.reshape(self.problem.intervals + 1, STATE_SIZE + FORCES)
        told = self._solve.stats()
        sound = bool(told["success"]) and bool(np.isfinite(numbers).all())
        newtons = self.problem.lqr.max_force * table[:-1, STATE_SIZE:]
        return Solution(table[:, :STATE_SIZE], newtons, sound, int(told["iter_count"]))

    def _path(self, state: Any) -> Sequence[tuple[Any, Array, Array]]:
        """The masses' distance from their places relative to the anchor."""
        if self.problem.largest_deviation is None:
            return []
        library, rest = casadi(), self.problem.lqr.equilibrium
        return [
            _at_most(library.sumsqr(state[i : i + 3] - state[:3] - rest[i : i + 3]), self.problem.largest_deviation**2)
            for i in (3, 6)
        ]

    def _pack(self, states: Array, forces: Array) -> Array:
        """States and forces in the order of the unknowns."""
        padded = np.vstack([forces, np.zeros((1, FORCES))])
        packed: Array = np.hstack([states, padded]).ravel()[:-FORCES]
        return packed

    def _unknowns_bounds(self) -> tuple[Array, Array]:
        state = np.full(STATE_SIZE, np.inf)
        state[:3] = self.problem.anchor_travel
        force = np.isin(np.arange(FORCES), self.problem.lqr.axes).astype(float)
        high = self._pack(np.tile(state, (self.problem.intervals + 1, 1)), np.tile(force, (self.problem.intervals, 1)))
        return -high, high


def _equal(expression: Any) -> tuple[Any, Array, Array]:
    zeros = np.zeros(expression.numel())
    return expression, zeros, zeros


def _at_most(expression: Any, limit: float) -> tuple[Any, Array, Array]:
    return expression, np.array([-np.inf]), np.array([limit])


def unsaturated_level(lqr: LQR) -> float:
    """The largest c for which LQR's force stays within its limit on all of x' P x <= c: the ellipsoid touches the
    planes where K x is max_force, and as the linear model never leaves it, LQR recovers everything inside.
    """
    kept = np.ix_(lqr.steered, lqr.steered)
    gains = lqr.K[:, lqr.steered]
    reach = np.einsum("ij,ji->i", gains, np.linalg.solve(lqr.P[kept], gains.T))
    return float(lqr.max_force**2 / reach.max())
