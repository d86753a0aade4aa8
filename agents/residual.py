"""A network whose action is added to that of LQR: it begins as LQR and learns what a linear law cannot do."""

from __future__ import annotations

import copy

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.config import Config
from agents.controller import AXES, STATE_SIZE
from agents.evaluation import scenario_of
from agents.lqr import LQR
from agents.networks import limited, multilayer
from agents.policy import LearnedPolicy
from agents.relative import TRANSFORM

LARGEST_COST_COORDINATE = 3.0
"""The coordinates of LQR's cost are scaled so that the dearest one is about this where all others are about one."""


class ResidualNetwork(nn.Module):
    """Actions from how far the state is from the task's equilibrium: LQR's, limited, plus a network's, limited again.

    Without a `guide` in the config there is no LQR: its gain is zero.

    What the network would do at the equilibrium is taken off everywhere, so that the equilibrium stays one. Otherwise
    the pendulum is parked far off its middle, where LQR's weak pull to it balances a small constant push.

    The network sees the relative coordinates of `agents.relative`, scaled as the config says, and where there is a
    guide also those in which LQR's cost is the square of a distance. Close to an unstable equilibrium a few directions
    decide whether it can be saved, small differences of the other coordinates; in these they are large.
    """

    features: Tensor  # (k, 18), from the displacement to what the network sees
    gain: Tensor  # (axes, 18), from the displacement to LQR's action

    def __init__(self, config: Config) -> None:
        super().__init__()
        axes = len(config.environment.actuated_axes or AXES)
        size = STATE_SIZE * (2 if config.guide else 1)
        self.register_buffer("features", torch.zeros(size, STATE_SIZE))
        self.register_buffer("gain", torch.zeros(axes, STATE_SIZE))
        self.body = multilayer(size, config.network.layers, axes, config.network.activation)
        with torch.no_grad():  # to begin with LQR and next to nothing besides
            last: nn.Linear = self.body[-1]  # type: ignore[assignment]
            last.weight.mul_(0.01)
            last.bias.zero_()

    def seen(self, displacements: Tensor) -> Tensor:
        """What the network sees, (..., k), of displacements (..., 18) from the equilibrium, m and m/s."""
        return displacements.to(self.features.dtype) @ self.features.T

    def at_rest(self) -> Tensor:
        """What the body says at the equilibrium, (axes,)."""
        said: Tensor = self.body(self.features.new_zeros(self.features.shape[0]))
        return said

    def forward(self, displacements: Tensor, at_rest: Tensor | None = None) -> Tensor:
        """Actions (..., axes) in [-1, 1], in float64; `at_rest()` may be handed in by who needs it many times."""
        guided = limited(displacements.to(self.gain.dtype) @ self.gain.T)
        offset = self.at_rest() if at_rest is None else at_rest
        actions: Tensor = limited(guided + self.body(self.seen(displacements)) - offset).double()
        return actions


def make_residual_network(config: Config) -> tuple[ResidualNetwork, NDArray[np.float64]]:
    """An untrained network for a config, and the equilibrium (18,) from which its displacements count."""
    env = gym.make(config.environment_id, **config.environment.arguments())
    scenario = scenario_of(env)
    env.close()
    network = ResidualNetwork(config)
    assert config.observation.scales is not None, "the config is checked"
    spread = np.repeat(config.observation.scales, STATE_SIZE // 2)
    features = TRANSFORM / spread[:, None]
    if config.guide:
        guide = LQR(
            scenario.parameters,
            scenario.equilibrium,
            control_period=scenario.control_period,
            max_force=scenario.max_force,
            actuated_axes=scenario.actuated_axes,
            state_weights=config.guide.state_weights,
            effort_weight=config.guide.effort_weight,
        )
        network.gain.copy_(torch.from_numpy(-guide.K / scenario.max_force))
        values, vectors = np.linalg.eigh(guide.P)
        coordinates = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        sizes = np.linalg.norm(coordinates @ np.linalg.inv(TRANSFORM) * spread, axis=1)
        features = np.vstack([features, coordinates * LARGEST_COST_COORDINATE / sizes.max()])
    network.features.copy_(torch.from_numpy(features))
    return network, np.asarray(scenario.rest)


class ResidualPolicy(LearnedPolicy):
    """A trained `ResidualNetwork`; `mean` is zero and `variance` tells of the config's scales, which it holds.

    It acts in double precision, though it was trained in single: LQR's large numbers cancel, so that single precision
    would leave an error of 1e-5 far from the equilibrium, another one for each number of observations at once.
    """

    def __init__(self, config: Config, network: ResidualNetwork, *statistics: NDArray[np.float64]) -> None:
        super().__init__(config, network, *statistics)
        self._exact = copy.deepcopy(network).double()

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:  # noqa: ARG002
        """Actions (n, axes) in [-1, 1] for raw observations (n, 18)."""
        with torch.no_grad():
            actions: NDArray[np.float64] = self._exact(torch.from_numpy(observations - self.reference)).numpy()
        return actions
