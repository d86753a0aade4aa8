"""The ceiling: can a start be recovered at all, by someone who knows the model and may think as long as they like?

An open-loop optimum over three seconds, within all limits of the task and ending where LQR recovers for sure. IPOPT
finds local solutions, so a start for which it finds none may still be recoverable: the share is a lower bound. What it
finds is played in the environment, LQR along the plan making up for the difference between the model's integration and
the environment's, and only what is recovered there counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.controller import STATE_SIZE
from agents.evaluation import Trial
from agents.lqr import LQR
from agents.measures import Episodes, measures_of
from agents.model import FORCES, casadi, step_function
from agents.optimal_control import Problem, Solution, Solver, unsaturated_level
from agents.rollout import scenario_for
from agents.tracking import correction, gains_along, slopes_of
from spring_pendulum_env import physics

Array = NDArray[np.float64]

INTERVALS = 75
DURATION = 0.04  # s, of each
PARTS = 2
SPARE = 0.02  # share of the force, the travel and the distance that is left for playing the plan
OPTIONS = {"ipopt.tol": 1e-4, "ipopt.constr_viol_tol": 1e-6, "ipopt.max_iter": 150}
SECONDS = 10.0  # of an episode
SLOW = 25  # intervals, of a first guess that goes straight to the equilibrium


@dataclass(frozen=True)
class Outcome:
    """Whether a plan was found, whether it recovered the start in the environment, and the solver's iterations."""

    solved: bool
    recovered: bool
    iterations: int


class Optimum:
    """Plans for the starts of a trial of the stabilisation task. Raises ModuleNotFoundError without CasADi."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        scenario = scenario_for(trial.environment_id, trial.arguments)
        self.lqr = LQR(scenario.parameters, scenario.equilibrium, control_period=DURATION)
        library = casadi()
        limit = (1 - SPARE) * scenario.max_force
        self.problem = Problem(
            LQR(scenario.parameters, scenario.equilibrium, control_period=DURATION, max_force=limit),
            INTERVALS,
            DURATION,
            PARTS,
            stage_cost=lambda _, force: library.sumsqr(force) / limit**2 / INTERVALS,
            final_cost=lambda _: 0.0,
            anchor_travel=(1 - SPARE) * scenario.anchor_travel,
            largest_deviation=(1 - SPARE) * scenario.task.largest_deviation,
            final_level=unsaturated_level(self.lqr),
        )
        self._solver = Solver(self.problem, "ipopt", OPTIONS)
        axes = "".join(physics.AXES[axis] for axis in self.lqr.axes)
        self._slopes = slopes_of(step_function(scenario.parameters, DURATION, PARTS, axes))
        self._env = gym.make(trial.environment_id, disable_env_checker=True, control_period=DURATION, **trial.arguments)

    def find(self, start: Array) -> Outcome:
        """Plan from `start` (18,), from several first guesses, until one plan recovers it in the environment."""
        solved, iterations = False, 0
        for states, forces in self._guesses(start):
            solution = self._solver.solve(start, states, forces)
            iterations += solution.iterations
            solved |= solution.success
            if solution.success and self.recovers(start, solution):
                return Outcome(True, True, iterations)
        return Outcome(solved, False, iterations)

    def recovers(self, start: Array, plan: Solution) -> bool:
        """Whether the plan, followed in the environment by LQR along it, recovers the start as the protocol has it."""
        gains = gains_along(self.lqr, self._slopes, plan.states, plan.forces)
        steps = round(SECONDS / DURATION)
        states = np.full((1, steps + 1, STATE_SIZE), np.nan)
        states[0, 0], _ = self._env.reset(options={"state": start})
        ended, length = False, steps
        for k in range(steps):
            action = self.lqr.predict(states[0, k])[0]
            if k < INTERVALS:
                action = correction(self.lqr, gains[k], states[0, k], plan.states[k], plan.forces[k])
            states[0, k + 1], _, ended, _, _ = self._env.step(action)
            if ended:
                length = k + 1
                break
        nothing = np.full((1, steps + 1), np.nan)
        episodes = Episodes(
            times=np.arange(steps + 1, dtype=np.float64) * DURATION,
            states=states,
            excess_energy=nothing,
            forces=np.zeros((1, steps, FORCES)),
            rewards=nothing[:, 1:],
            equilibria=self.lqr.equilibrium[None],
            lengths=np.array([length]),
            ended_early=np.array([ended]),
        )
        return bool(measures_of(self.trial.environment_id).compute(episodes)["recovered"][0])

    def _guesses(self, start: Array) -> list[tuple[Array, Array]]:
        """First guesses: what LQR does with as much force as it likes, in the linear model; and straight home."""
        off = [start - self.lqr.equilibrium]
        forces = np.zeros((INTERVALS, FORCES))
        closed = np.eye(STATE_SIZE)
        closed[np.ix_(self.lqr.steered, self.lqr.steered)] = (
            self.lqr.transition - self.lqr.input_matrix @ self.lqr.K[:, self.lqr.steered]
        )
        for k in range(INTERVALS):
            forces[k, self.lqr.axes] = np.clip(-self.lqr.K @ off[k], -self.lqr.max_force, self.lqr.max_force)
            off.append(closed @ off[k])
        share = np.clip(1.0 - np.arange(INTERVALS + 1) / SLOW, 0.0, 1.0)[:, None]
        straight = share * start + (1 - share) * self.lqr.equilibrium
        return [(self.lqr.equilibrium + np.array(off), forces), (straight, np.zeros_like(forces))]


def row(outcome: Outcome, seconds: float) -> Mapping[str, Any]:
    """What is saved of a start that needed a plan."""
    return {
        "recovered": float(outcome.recovered),
        "planned": 1.0,
        "solved": float(outcome.solved),
        "iterations": outcome.iterations,
        "seconds": seconds,
    }


KNOWN = {"recovered": 1.0, "planned": 0.0, "solved": 0.0, "iterations": 0, "seconds": 0.0}
"""What is saved of a start that some controller recovers: there is nothing left to plan."""
