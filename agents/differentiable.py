"""The environments' motion and reward as torch sees them: what they give, and the gradient of it.

The numbers are the environment's own, starts, ends and time limit included; only the way back is added here. So what an
algorithm climbs is the very return that the environment pays.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from torch import Tensor

from agents import adjoint
from agents.checkpoints import fitting
from agents.config import Config
from agents.controller import AXES, STATE_SIZE
from agents.files import read_arrays
from spring_pendulum_env import physics, tasks
from spring_pendulum_env.equilibria import energy, vertical_state
from spring_pendulum_env.layout import steps_in
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.starts import generator_of, words_of

Array = NDArray[np.float64]

MOST_STEPS = 10_000
"""Steps in a control period that a checkpoint may ask for: what the adjoint keeps grows with them."""


@dataclasses.dataclass(frozen=True)
class Models:
    """The constants in force in each of n rows: inverse masses and so on (n, CONSTANTS), rates of drag (n, 3), heights
    of the springs at rest (n, 2) and where episodes start (n, 2), what the energy is made of (n, 8), energy at rest
    (n,), and the adjoint's schedule.
    """

    constants: Array
    drag: Array
    heights: Array
    start_heights: Array
    energetics: Array  # m0, m1, m2, k1, k2, L1, L2, g
    rest_energy: Array
    schedule: Array
    steps: int

    @classmethod
    def of(cls, scenario: Scenario, parameters: Sequence[Parameters]) -> Models:
        """Those of parameters, one for each row."""
        constants = np.array([p.constants(scenario.actuated_axes) for p in parameters])
        drag = np.array([p.drag_rates() for p in parameters])
        heights = np.array([scenario.spring_heights(p) for p in parameters])
        start_heights = np.array([scenario.start_heights(p) for p in parameters])
        energetics = np.array([(p.m0, p.m1, p.m2, p.k1, p.k2, p.L1, p.L2, p.g) for p in parameters])
        rest = np.array([energy(p, vertical_state(*pair)) for p, pair in zip(parameters, heights, strict=True)])
        # As many steps as the row needs that needs most: all are then at least as exact as in the environment.
        steps = max(steps_in(scenario.control_period, tuple(row)) for row in np.unique(constants, axis=0))
        schedule = adjoint.schedule(scenario.control_period, steps, drag)
        return cls(constants, drag, heights, start_heights, energetics, rest, schedule, steps)

    def replaced(self, scenario: Scenario, rows: NDArray[np.intp], parameters: Sequence[Parameters]) -> Models:
        """A copy in which `rows` have other parameters."""
        others = Models.of(scenario, parameters)
        arrays = {}
        for name in _DRAWN:
            arrays[name] = getattr(self, name).copy()
            arrays[name][rows] = getattr(others, name)
        steps = max(self.steps, others.steps)
        schedule = adjoint.schedule(scenario.control_period, steps, arrays["drag"])
        return Models(**arrays, schedule=schedule, steps=steps)


_DRAWN = ("constants", "drag", "heights", "start_heights", "energetics", "rest_energy")


@dataclasses.dataclass(frozen=True)
class Transition:
    """One control period of n rows: the states that it reached (n, 18) with their gradient and the actions (n, axes)
    that did it; which rows ended early and which a time limit cut off; what the environment paid, and its models."""

    reached: Tensor
    actions: Tensor
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    paid: Array
    models: Models


class DifferentiableEnv:
    """`config.training.environments` pendulums side by side, started anew where they end.

    Attributes:
        states: (n, 18), in the observation's layout; carries the gradient of all steps since `detach`.
        limits: (n,), after so many steps a row is cut off: the first time sooner, so that the rows don't keep in step.
    """

    def __init__(self, config: Config, seed: int) -> None:
        self.rows = config.training.environments
        self.scales = config.training.start_scales
        self.along = _states_in(config.training.starts_along) if config.training.starts_along else None
        self.along_share = config.training.starts_along_share
        self._envs: Any = gym.make_vec(
            config.environment_id,
            num_envs=self.rows,
            autoreset_mode=AutoresetMode.DISABLED,
            **config.environment.arguments(),
        )
        base: Any = self._envs.unwrapped
        self.scenario: Scenario = base.scenario
        self.axes = [AXES.index(axis) for axis in self.scenario.actuated_axes]
        self._random = np.random.default_rng(seed)
        self.models = Models.of(self.scenario, [self.scenario.parameters] * self.rows)
        self._envs.reset(seed=seed)
        self.longest = min(config.training.episode_steps or base.max_episode_steps, base.max_episode_steps)
        self.limits = self._random.integers(1, self.longest + 1, self.rows)
        self.lengths = np.zeros(self.rows, dtype=np.int64)
        self.states = torch.from_numpy(self._restart(np.ones(self.rows, dtype=np.bool_)))

    def detach(self) -> None:
        """Forget how the states came about: gradients end here."""
        self.states = self.states.detach()

    def step(self, actions: Tensor) -> Transition:
        """One control period under actions (n, axes) in [-1, 1]; rows that end in it begin anew."""
        models = self.models
        reached, paid, terminated, truncated = _ControlPeriod.apply(self.states, actions, self)  # type: ignore[no-untyped-call]
        self.lengths += 1
        truncated = (truncated | (self.lengths >= self.limits)) & ~terminated
        ended = terminated | truncated
        self.states = reached
        if ended.any():
            self.limits[ended] = self.longest
            self.lengths[ended] = 0
            fresh = torch.from_numpy(self._restart(ended))
            self.states = torch.where(torch.from_numpy(ended)[:, None], fresh, reached)
        return Transition(reached, actions, terminated, truncated, paid, models)

    def rewards(self, transitions: Sequence[Transition]) -> Tensor:
        """What the environment paid, (t, n), with its gradient by the states reached and the actions."""
        task = self.scenario.task
        states = torch.stack([transition.reached for transition in transitions])
        actions = torch.stack([transition.actions for transition in transitions])
        heights = torch.from_numpy(np.stack([transition.models.heights for transition in transitions]))
        x0 = states[..., 0:3]
        error1 = states[..., 3:6] - x0
        error2 = states[..., 6:9] - states[..., 3:6]
        posture = sum(
            (error[..., :2] ** 2).sum(-1) + (error[..., 2] - heights[..., i]) ** 2
            for i, error in enumerate((error1, error2))
        )
        excess: Any = 0.0
        if "energy" in task.terms:
            energetics = torch.from_numpy(np.stack([transition.models.energetics for transition in transitions]))
            rest = torch.from_numpy(np.stack([transition.models.rest_energy for transition in transitions]))
            excess = physics.total_energy(*states.unbind(-1), *energetics.unbind(-1)) - rest
        terms = tasks.reward_terms(
            excess,
            posture,
            (states[..., 9:] ** 2).sum(-1),
            (x0**2).sum(-1),
            (actions**2).mean(-1),
            task.energy_scale,
            task.posture_scale,
            task.velocity_scale,
            task.centring_scale,
        )
        paid: Any = sum(
            task.weights[name] * term
            for name, term in zip(tasks.REWARD_TERMS, terms, strict=True)
            if name in task.terms
        )
        return torch.as_tensor(paid)

    def state(self) -> dict[str, Any]:
        """All that what comes depends on."""
        return {
            "rows": self._envs.unwrapped.get_state(),
            "random": words_of(self._random),
            "limits": self.limits,
            "lengths": self.lengths,
            "states": self.states.detach(),
            "models": {name: getattr(self.models, name) for name in _DRAWN} | {"steps": self.models.steps},
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state()`. Raises ValueError where it is of something else."""
        self._envs.unwrapped.set_state(state["rows"])
        self._random = generator_of(fitting("random", state["random"], words_of(self._random)))
        self.limits = fitting("limits", state["limits"], self.limits)
        self.lengths = fitting("lengths", state["lengths"], self.lengths)
        self.states = torch.from_numpy(fitting("states", state["states"], self.states.detach().numpy()))
        saved = state["models"]
        arrays = {name: fitting(name, saved[name], getattr(self.models, name)) for name in _DRAWN}
        steps = int(saved["steps"])
        if not self.models.steps <= steps <= MOST_STEPS:
            raise ValueError(f"steps is {steps}; allowed is {self.models.steps} to {MOST_STEPS}")
        schedule = adjoint.schedule(self.scenario.control_period, steps, arrays["drag"])
        self.models = Models(**arrays, schedule=schedule, steps=steps)

    def close(self) -> None:
        self._envs.close()

    def advance(self, actions: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """The environment's own step: states, rewards, terminated, truncated."""
        reached, rewards, terminated, truncated, _ = self._envs.step(actions)
        return reached, rewards, terminated, truncated

    def _restart(self, mask: NDArray[np.bool_]) -> Array:
        """New starts in the rows of a mask, each with a spread of its own; all states (n, 18)."""
        states, infos = self._envs.reset(options={"reset_mask": mask})
        options: dict[str, Any] = {"reset_mask": mask}
        if self.scenario.randomise:
            rows = np.flatnonzero(mask)
            drawn = {name: infos["parameters"][name] for name in Parameters.names()}
            new = [Parameters(**{name: float(values[row]) for name, values in drawn.items()}) for row in rows.tolist()]
            self.models = self.models.replaced(self.scenario, rows, new)
            # Placed again below, rows must keep what was drawn for them just now; of other rows nothing is read.
            options["parameters"] = {name: np.where(mask, values, 1.0) for name, values in drawn.items()}
        low, high = self.scales
        if low == high == 1.0 and self.along is None:
            return np.asarray(states)
        usual = np.zeros((self.rows, STATE_SIZE))
        usual[:, 5], usual[:, 8] = self.models.start_heights[:, 0], self.models.start_heights.sum(axis=1)
        scale = self._random.uniform(low, high, (self.rows, 1))
        about = usual
        if self.along is not None:
            drawn_there = self.along[self._random.integers(len(self.along), size=self.rows)]
            there = self._random.uniform(size=(self.rows, 1)) < self.along_share
            about = np.where(there, drawn_there, usual)
        placed, _ = self._envs.reset(options=options | {"state": about + scale * (states - usual)})
        started: Array = np.where(mask[:, None], placed, states)
        return started


def _states_in(path: str) -> Array:
    """The states (n, 18) in an .npz. Raises ValueError where there are none."""
    try:
        states = read_arrays(Path(path))["states"]
    except (OSError, KeyError) as error:
        raise ValueError(
            f"training.starts_along is {path!r}: must be an .npz of states, and is not ({error})"
        ) from None
    if states.ndim != 2 or states.shape[1] != STATE_SIZE or not len(states):
        raise ValueError(f"training.starts_along is {path!r}: its states have shape {states.shape}; must be (n, 18)")
    return states.astype(np.float64)


class _ControlPeriod(torch.autograd.Function):
    """A step of the environment, and its adjoint."""

    @staticmethod
    def forward(ctx: Any, states: Tensor, actions: Tensor, env: DifferentiableEnv) -> Any:
        reached, rewards, terminated, truncated = env.advance(actions.numpy())
        ctx.save_for_backward(states, actions)
        ctx.models, ctx.axes, ctx.max_force = env.models, env.axes, env.scenario.max_force
        return torch.from_numpy(reached), rewards, terminated, truncated

    @staticmethod
    def backward(ctx: Any, gradients: Tensor, *_: Any) -> Any:
        states, actions = (tensor.numpy() for tensor in ctx.saved_tensors)
        forces = np.zeros((len(states), 3))
        forces[:, ctx.axes] = ctx.max_force * actions
        by_states = np.empty_like(states)
        by_forces = np.empty_like(forces)
        models: Models = ctx.models
        adjoint.backward(
            states,
            forces,
            models.constants,
            models.schedule,
            models.steps,
            np.ascontiguousarray(gradients.numpy()),
            by_states,
            by_forces,
        )
        # No number where a spring came too close to zero length: nothing is learnt from that.
        wrong = ~np.isfinite(by_states.sum(axis=1) + by_forces.sum(axis=1))
        by_states[wrong] = 0.0
        by_forces[wrong] = 0.0
        return torch.from_numpy(by_states), torch.from_numpy(ctx.max_force * by_forces[:, ctx.axes]), None
