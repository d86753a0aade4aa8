"""Nonlinear model-predictive control: the optimal forces of the next second or two, found anew all the time.

(Rawlings, Mayne and Diehl, Model Predictive Control, 2nd edition 2017.) The model is physics.py's. Stage and final cost
are those of LQR, so near the equilibrium both do the same; there LQR takes over (dual-mode control: Michalska and
Mayne, IEEE Trans. Automat. Contr. 38, 1993).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.controller import STATE_SIZE, Prediction
from agents.lqr import LQR
from agents.model import casadi
from agents.optimal_control import Problem, Solver, unsaturated_level

Array = NDArray[np.float64]

TOLERANCE = 1e-3
MOST_ITERATIONS = 60
SAFE_TRAVEL = 0.95  # of the allowed one: a plan that ends exactly there would, by the model's error, go beyond
FIRST_BARRIER = 1e-2
"""Where the guess is the last solution, moved on, the solver may begin close to the bounds."""


@dataclass
class Plan:
    """What NMPC remembers of an episode: the last solution, and for how many control periods its force is held."""

    states: Array
    forces: Array
    held: int
    sound: bool = True
    """Whether the solver found it; if not, its force is the last plan's or LQR's, and the next one begins afresh."""


class NMPC:
    """A controller with Stable-Baselines3's `predict`; what it remembers from step to step is the recurrent state.

    Arguments:
        lqr: whose model, equilibrium, weights, axes and force limit are taken over.
        anchor_travel: bound of the anchor's coordinates, m.
        intervals: of the horizon.
        periods: control periods in each interval; a new solution is sought after each interval.
        solver: "ipopt" or "fatrop".

    Attributes: solves, failures (the last plan is then carried on, or LQR asked), and seconds spent in solving.
    Raises ValueError for another solver or a number below 1, ModuleNotFoundError without CasADi.
    """

    def __init__(
        self,
        lqr: LQR,
        *,
        anchor_travel: float = 2.0,
        intervals: int = 40,
        periods: int = 2,
        solver: str = "ipopt",
    ) -> None:
        for name, value in (("intervals", intervals), ("periods", periods)):
            if value < 1:
                raise ValueError(f"{name} is {value!r}; allowed is a number from 1 on")
        self.lqr = lqr
        self.intervals, self.periods = intervals, periods
        self.level = unsaturated_level(lqr)
        self.solves, self.failures, self.seconds = 0, 0, 0.0
        library = casadi()
        rest, effort = lqr.equilibrium, float(lqr.R[0, 0])
        scale = 1.0 / self.level  # costs of the order of one suit the solvers

        def stage_cost(state: Any, force: Any) -> Any:
            off = state - rest
            return scale * periods * (library.bilin(library.DM(lqr.Q), off, off) + effort * library.sumsqr(force))

        def final_cost(state: Any) -> Any:
            off = state - rest
            return scale * library.bilin(library.DM(lqr.P), off, off)

        problem = Problem(
            lqr,
            intervals,
            periods * lqr.control_period,
            parts=1,
            stage_cost=stage_cost,
            final_cost=final_cost,
            anchor_travel=SAFE_TRAVEL * anchor_travel,
        )
        options = {f"{solver}.tol": TOLERANCE, f"{solver}.max_iter": MOST_ITERATIONS}
        self._first = Solver(problem, solver, options)
        self._next = Solver(problem, solver, options | {f"{solver}.mu_init": FIRST_BARRIER})

    def predict(
        self,
        observation: ArrayLike,
        state: Sequence[Plan | None] | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Actions in [-1, 1], shape (axes,) or (n, axes), and the plans; `state` is what the last call returned.

        Raises ValueError for observations of another shape than (18,) or (n, 18), or not finite.
        """
        actions, _ = self.lqr.predict(observation, None, None, deterministic)  # which checks the observation too
        rows = np.atleast_2d(np.asarray(observation, dtype=np.float64))
        begins = np.broadcast_to(False if episode_start is None else np.asarray(episode_start, dtype=bool), len(rows))
        plans: list[Plan | None] = [None] * len(rows) if state is None else list(state)
        result = np.atleast_2d(actions)
        for i, row in enumerate(rows):
            off = row - self.lqr.equilibrium
            if off @ self.lqr.P @ off <= self.level:
                plans[i] = None
                continue
            plan = self._planned(row, None if begins[i] else plans[i])
            plans[i] = plan
            result[i] = plan.forces[0, self.lqr.axes] / self.lqr.max_force
        return np.clip(result.reshape(actions.shape), -1.0, 1.0), plans

    def _planned(self, start: Array, plan: Plan | None) -> Plan:
        """The plan to follow from here: the one at hand while its force is to be held, else a new one."""
        if plan is not None and plan.held > 1:
            return Plan(plan.states, plan.forces, plan.held - 1, plan.sound)
        began = time.process_time()
        if plan is None or not plan.sound:
            states, forces = self._straight(start)
            found = self._first.solve(start, states, forces)
        else:
            states, forces = _moved_on(plan)
            found = self._next.solve(start, states, forces)
        self.seconds += time.process_time() - began
        self.solves += 1
        if found.success:
            return Plan(found.states, found.forces, self.periods)
        self.failures += 1
        if plan is not None and plan.sound:  # what remains of the last solution will do for an interval
            return Plan(states, forces, self.periods, sound=False)
        forces = np.zeros_like(forces)
        forces[:, self.lqr.axes] = self.lqr.max_force * self.lqr.predict(start)[0]
        return Plan(states, forces, self.periods, sound=False)

    def _straight(self, start: Array) -> tuple[Array, Array]:
        """A first guess: in a straight line to the equilibrium, without force."""
        share = np.linspace(1.0, 0.0, self.intervals + 1)[:, None]
        states = share * start + (1 - share) * self.lqr.equilibrium
        return states.reshape(-1, STATE_SIZE), np.zeros((self.intervals, 3))


def _moved_on(plan: Plan) -> tuple[Array, Array]:
    """The last solution one interval later, its end repeated."""
    return np.vstack([plan.states[1:], plan.states[-1:]]), np.vstack([plan.forces[1:], plan.forces[-1:]])
