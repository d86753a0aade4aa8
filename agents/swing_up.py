"""Swinging up by a plan: the cheapest way up, found anew from each start, and LQR along it and at its end.

The plan is an open-loop optimum within all limits of the task (agents/optimal_control.py) that ends where LQR holds
both springs upside down for sure. Solvers find local solutions: which way around the pendulum goes is up to the first
guess, a turn of both springs by half a circle in a vertical plane.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.controller import STATE_SIZE, Prediction
from agents.lqr import LQR
from agents.model import FORCES, casadi, step_function
from agents.optimal_control import Problem, Solver, unsaturated_level
from agents.tracking import correction, gains_along, slopes_of
from spring_pendulum_env import physics
from spring_pendulum_env.equilibria import spring_lengths
from spring_pendulum_env.scenario import Scenario

Array = NDArray[np.float64]

SECONDS = 3.0  # of a plan; it can be done in 1.4 s too, with four times the effort
PERIODS = 2  # control periods for which each force is held
SPARE = 0.15
OPTIONS = {"ipopt.tol": 1e-4, "ipopt.constr_viol_tol": 1e-6, "ipopt.max_iter": 300, "ipopt.mu_strategy": "adaptive"}


@dataclass(frozen=True)
class Plan:
    """States (N + 1, 18), forces (N, 3), N, and LQR's gains, N times (axes, 18), one for each control period."""

    states: Array
    forces: Array
    gains: Sequence[Array]


@dataclass(frozen=True)
class Progress:
    """What the controller remembers of an episode: the plan, None where there was none to be found, and the time."""

    plan: Plan | None
    step: int


class PlannedSwingUp:
    """A controller with Stable-Baselines3's `predict`, whose recurrent state holds a plan for each row.

    Arguments:
        scenario: of the swing-up task.
        seconds: length of a plan.
        spare: share of the force and of the travel that is left for following it.

    Attributes: solves, iterations, failures (starts without a plan; these get no force), seconds_spent.
    Raises ValueError for a plan shorter than one force is held or a share that isn't one, ModuleNotFoundError without
    CasADi.
    """

    def __init__(self, scenario: Scenario, seconds: float = SECONDS, spare: float = SPARE) -> None:
        self.scenario = scenario
        period = scenario.control_period
        self.intervals = round(seconds / (PERIODS * period))
        if self.intervals < 1:
            raise ValueError(f"seconds is {seconds}; allowed is a number from {PERIODS * period:g} on")
        if not 0 <= spare < 1:
            raise ValueError(f"spare is {spare}; allowed is a number from 0 to below 1")
        self.lqr = _lqr(scenario, scenario.max_force)
        limit = (1 - spare) * scenario.max_force
        library = casadi()
        self._solver = Solver(
            Problem(
                _lqr(scenario, limit),
                self.intervals,
                PERIODS * period,
                PERIODS,
                stage_cost=lambda _, force: library.sumsqr(force) / limit**2 / self.intervals,
                final_cost=lambda _: 0.0,
                anchor_travel=(1 - spare) * scenario.anchor_travel,
                final_level=unsaturated_level(self.lqr),
            ),
            "ipopt",
            OPTIONS,
        )
        axes = "".join(physics.AXES[axis] for axis in self.lqr.axes)
        self._step = step_function(scenario.parameters, period, 1, axes)
        self._slopes = slopes_of(self._step)
        self.solves = self.iterations = self.failures = 0
        self.seconds_spent = 0.0

    def predict(
        self,
        observation: ArrayLike,
        state: Sequence[Progress | None] | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> Prediction:
        """Actions in [-1, 1], shape (axes,) or (n, axes), and what is remembered; `state` is what the last call
        returned, and a row without any is planned for.

        Raises ValueError for observations of another shape than (18,) or (n, 18), or not finite.
        """
        held, _ = self.lqr.predict(observation, None, None, deterministic)  # which checks the observation too
        rows = np.atleast_2d(np.asarray(observation, dtype=np.float64))
        begins = np.broadcast_to(False if episode_start is None else np.asarray(episode_start, dtype=bool), len(rows))
        memory: list[Progress | None] = [None] * len(rows) if state is None else list(state)
        actions = np.atleast_2d(held)
        for i, row in enumerate(rows):
            progress = memory[i]
            if progress is None or begins[i]:
                progress = Progress(self.plan(row), 0)
            actions[i] = self._action(row, progress, actions[i])
            memory[i] = replace(progress, step=progress.step + 1)
        return actions.reshape(held.shape), memory

    def _action(self, state: Array, progress: Progress, held: Array) -> Array:
        """Along the plan, and `held` once it has come to its end; nothing where there is none."""
        plan, k = progress.plan, progress.step
        if plan is None:
            return np.zeros_like(held)
        if k >= len(plan.forces):
            return held
        return correction(self.lqr, plan.gains[k], state, plan.states[k], plan.forces[k])

    def plan(self, start: Array) -> Plan | None:
        """The way up from a state (18,), by the first guess that leads to one."""
        began = time.perf_counter()
        try:
            for states, forces in self._guesses():
                found = self._solver.solve(start, states, forces)
                self.solves += 1
                self.iterations += found.iterations
                if found.success:
                    return self._plan(start, np.repeat(found.forces, PERIODS, axis=0))
            self.failures += 1
            return None
        finally:
            self.seconds_spent += time.perf_counter() - began

    def _plan(self, start: Array, forces: Array) -> Plan:
        """With a state for each control period."""
        states = [start]
        for force in forces:
            states.append(np.asarray(self._step(states[-1], force)).ravel())
        table = np.array(states)
        return Plan(table, forces, gains_along(self.lqr, self._slopes, table, forces))

    def _guesses(self) -> Iterator[tuple[Array, Array]]:
        """Both springs turn together, or one the other way; in the plane of the first axis along which the anchor
        moves."""
        share = np.linspace(0.0, 1.0, self.intervals + 1)
        turned = np.pi * (0.5 - 0.5 * np.cos(np.pi * share))
        p = self.scenario.parameters
        below, above = (np.abs(spring_lengths(p, f"{way}-{way}")) for way in ("hanging", "inverted"))
        lengths = below + share[:, None] * (above - below)
        sideways = min(self.lqr.axes)
        for second in (1.0, -1.0):
            springs = np.zeros((self.intervals + 1, 2, 3))
            for number, angle in enumerate((turned, second * turned)):
                springs[:, number, sideways] += lengths[:, number] * np.sin(angle)
                springs[:, number, 2] -= lengths[:, number] * np.cos(angle)
            states = np.zeros((self.intervals + 1, STATE_SIZE))
            states[:, 3:9] = springs.cumsum(axis=1).reshape(-1, 6)
            states[1:-1, 9:] = np.gradient(states[:, :9], PERIODS * self.scenario.control_period, axis=0)[1:-1]
            yield states, np.zeros((self.intervals, FORCES))


def _lqr(scenario: Scenario, max_force: float) -> LQR:
    return LQR(
        scenario.parameters,
        scenario.equilibrium,
        control_period=scenario.control_period,
        max_force=max_force,
        actuated_axes=scenario.actuated_axes,
    )
