"""Short-horizon actor-critic: learning by the gradient of the motion itself.

J. Xu et al., "Accelerated Policy Learning with Parallel Differentiable Simulation", ICLR 2022 (arXiv:2204.07137). Over
a short window the policy's return is differentiated through the pendulums' motion; a learned value stands for what
comes after it. The window is short because gradients through an unstable motion grow as the motion does. The value
learns from the same windows by TD(lambda) against a slowly following copy of itself.

A method that only sees rewards has to try out which force was better; this one is told by the equations.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from agents.checkpoints import Checkpoints, Stateful, check_learnt, fitting
from agents.config import Config
from agents.curve import Curve
from agents.differentiable import DifferentiableEnv, Transition
from agents.networks import multilayer
from agents.residual import ResidualNetwork, ResidualPolicy, make_residual_network
from agents.stopping import Stop

ACTOR_BETAS = (0.7, 0.95)
"""Adam's for the actor, the paper's: each window's gradient is good, so little need be remembered of older ones."""

OBJECTIVE_SHARE = 0.2
"""The objective is divided by this share of the largest possible return, so that gradients have the size of one."""


@dataclass(frozen=True)
class Window:
    """What the value learns from: what it sees (t, n, k) before each step, and the return it should tell (t, n)."""

    seen: Tensor
    returns: Tensor


class SHAC:
    """The networks, their optimisers and one round of learning.

    Arguments:
        config: with `algorithm` shac.
        env: the pendulums.
        policy: the network that learns to act.
        reference: (18,), the equilibrium.
    """

    def __init__(self, config: Config, env: DifferentiableEnv, policy: ResidualNetwork, reference: Any) -> None:
        self.settings = config.shac
        self.env = env
        self.policy = policy
        self.reference = torch.from_numpy(reference)
        self.largest_return = 1.0 / (1.0 - self.settings.gamma)
        size = policy.features.shape[0]
        self.value = multilayer(size, config.network.layers, 1, config.network.activation)
        self.target = copy.deepcopy(self.value)
        self.actor_optimiser = torch.optim.Adam(
            policy.body.parameters(), self.settings.learning_rate, betas=ACTOR_BETAS
        )
        self.value_optimiser = torch.optim.Adam(self.value.parameters(), self.settings.critic_learning_rate)

    def round(self, progress: float) -> tuple[list[Transition], dict[str, float]]:
        """One window played and learnt from; `progress` in [0, 1] says how much of the training is done."""
        share = 1.0 - (1.0 - self.settings.final_share) * progress
        for optimiser, rate in (
            (self.actor_optimiser, self.settings.learning_rate),
            (self.value_optimiser, self.settings.critic_learning_rate),
        ):
            for group in optimiser.param_groups:
                group["lr"] = rate * share
        self.env.detach()
        before, transitions = [], []
        at_rest = self.policy.at_rest()
        for _ in range(self.settings.horizon):
            displacements = self.env.states - self.reference
            before.append(displacements.detach())
            transitions.append(self.env.step(self.policy(displacements, at_rest)))
        rewards = self.env.rewards(transitions)
        norm = self._improve_policy(transitions, rewards)
        window = self._returns(torch.stack(before), transitions, rewards.detach())
        loss = self._improve_value(window)
        return transitions, {"gradient": norm, "value_loss": loss}

    def _improve_policy(self, transitions: list[Transition], rewards: Tensor) -> float:
        """A step up the gradient of the discounted return; the gradient's norm before clipping."""
        terminated, cut = _ends(transitions)
        cut = cut.clone()
        cut[-1] = ~terminated[-1]  # the window ends like an episode that time has cut off
        discount = torch.empty(rewards.shape, dtype=torch.float64)
        current = torch.ones(rewards.shape[1], dtype=torch.float64)
        for t, ended in enumerate(terminated | cut):
            discount[t] = current
            current = torch.where(ended, 1.0, current * self.settings.gamma)
        where = torch.nonzero(cut, as_tuple=True)
        last = torch.stack([transition.reached for transition in transitions])[where]
        self.value.requires_grad_(False)
        # An early end is the worst that can happen: nothing is paid from it on, itself included.
        paid = (discount * rewards * ~terminated).sum()
        coming = (self.settings.gamma * discount[where] * self._values(self.value, last)).sum()
        objective = (paid + coming) / (rewards.shape[1] * self.largest_return * OBJECTIVE_SHARE)
        self.actor_optimiser.zero_grad()
        (-objective).backward()  # type: ignore[no-untyped-call]
        self.value.requires_grad_(True)
        norm = nn.utils.clip_grad_norm_(self.policy.body.parameters(), self.settings.max_grad_norm)
        if torch.isfinite(norm):
            self.actor_optimiser.step()
        return float(norm)

    @torch.no_grad()
    def _returns(self, before: Tensor, transitions: list[Transition], rewards: Tensor) -> Window:
        """TD(lambda) returns by the slow copy of the value."""
        terminated, cut = _ends(transitions)
        ahead = self._values(self.target, torch.stack([transition.reached for transition in transitions]))
        returns = torch.empty_like(rewards)
        following = ahead[-1]
        for t in range(len(transitions) - 1, -1, -1):
            if t < len(transitions) - 1:
                mixed = (1.0 - self.settings.td_lambda) * ahead[t] + self.settings.td_lambda * returns[t + 1]
                following = torch.where(cut[t], ahead[t], mixed)
            returns[t] = torch.where(terminated[t], 0.0, rewards[t] + self.settings.gamma * following)
        return Window(self.policy.seen(before), returns)

    def _improve_value(self, window: Window) -> float:
        """Regression of the value on the returns; its mean loss."""
        seen = window.seen.flatten(0, 1)
        returns = (window.returns / self.largest_return).float().flatten()
        losses = []
        for _ in range(self.settings.critic_epochs):
            for batch in torch.split(torch.randperm(len(seen)), self.settings.batch_size):
                loss = nn.functional.mse_loss(self.value(seen[batch])[:, 0], returns[batch])
                self.value_optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                self.value_optimiser.step()
                losses.append(loss.item())
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.value.parameters(), strict=True):
                slow.lerp_(fast, self.settings.target_rate)
        return float(np.mean(losses))

    def _values(self, network: nn.Module, states: Tensor) -> Tensor:
        """Discounted returns (...,) that a value network expects from states (..., 18)."""
        values: Tensor = network(self.policy.seen(states - self.reference))[..., 0].double() * self.largest_return
        return values

    def state(self) -> dict[str, Any]:
        """All that it remembers between two rounds."""
        return {name: getattr(self, name).state_dict() for name in _STATEFUL}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state()`."""
        for name in _STATEFUL:
            getattr(self, name).load_state_dict(state[name])
        networks = (self.policy, self.value, self.target)
        weights = [weight for network in networks for weight in network.state_dict().values()]
        check_learnt(weights, (self.actor_optimiser, self.value_optimiser))


_STATEFUL = ("policy", "value", "target", "actor_optimiser", "value_optimiser")


def _ends(transitions: list[Transition]) -> tuple[Tensor, Tensor]:
    """Which rows ended early after each step, and which were cut off by time: (t, n) each."""
    terminated = np.stack([transition.terminated for transition in transitions])
    truncated = np.stack([transition.truncated for transition in transitions])
    return torch.from_numpy(terminated), torch.from_numpy(truncated)


def train_shac(config: Config, folder: Path, stop: Stop, *, progress: bool) -> ResidualPolicy:
    """Train, or go on with, the policy of a run folder that is ready for it (see `agents.training.train`)."""
    torch.manual_seed(config.training.seed)
    network, reference = make_residual_network(config)
    env = DifferentiableEnv(config, config.training.seed)
    learner = SHAC(config, env, network, reference)
    episodes = _Episodes(env.rows)
    parts: dict[str, Stateful] = {"learner": learner, "environments": env, "episodes": episodes}
    checkpoints = Checkpoints(config, folder, parts, stop)
    try:
        steps = checkpoints.resume()
        with Curve(folder, steps, config.training.steps, progress) as curve:
            while steps < config.training.steps:
                checkpoints.between(steps)
                transitions, row = learner.round(steps / config.training.steps)
                steps += env.rows * len(transitions)
                finished = episodes.finished(transitions)
                seconds = round(checkpoints.clock.read()[0], 2)
                curve.add({"steps": steps, "seconds": seconds} | finished | _rounded(row), finished)
    finally:
        env.close()
    assert config.observation.scales is not None, "the config is checked"
    variance = np.repeat(np.square(config.observation.scales), len(reference) // 2)
    policy = ResidualPolicy(config, network, reference, np.zeros_like(reference), variance)
    policy.save(folder)
    checkpoints.finish(steps)
    return policy


def _rounded(row: dict[str, float]) -> dict[str, float]:
    return {name: float(f"{value:.4g}") for name, value in row.items()}


class _Episodes:
    """Counts what episodes paid, from step to step."""

    def __init__(self, rows: int) -> None:
        self.returns = np.zeros(rows)
        self.lengths = np.zeros(rows)

    def state(self) -> dict[str, Any]:
        """Those that are not over."""
        return {"returns": self.returns, "lengths": self.lengths}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state()`."""
        self.returns = fitting("returns", state["returns"], self.returns)
        self.lengths = fitting("lengths", state["lengths"], self.lengths)

    def finished(self, transitions: list[Transition]) -> dict[str, Any]:
        """Of the episodes that have ended in a window: how many, mean return and length, share that ended early."""
        done: list[tuple[float, float, bool]] = []
        for transition in transitions:
            self.returns += transition.paid
            self.lengths += 1
            ended = transition.terminated | transition.truncated
            done += zip(self.returns[ended], self.lengths[ended], transition.terminated[ended], strict=True)
            self.returns[ended] = 0.0
            self.lengths[ended] = 0.0
        if not done:
            return {"episodes": 0, "return": "", "length": "", "ended_early": ""}
        returns, lengths, early = np.array(done, dtype=np.float64).mean(axis=0)
        return {
            "episodes": len(done),
            "return": round(returns, 4),
            "length": round(lengths, 2),
            "ended_early": round(early, 4),
        }
