"""RLlib's modules around Stable-Baselines3's networks, so that what RLlib trains is what a run folder holds."""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.algorithms.sac.torch.default_sac_torch_rl_module import DefaultSACTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian
from ray.rllib.core.models.base import ENCODER_OUT
from ray.rllib.core.rl_module.apis import ValueFunctionAPI
from ray.rllib.core.rl_module.torch import TorchRLModule
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN
from torch import nn

from agents.algorithms import make_network
from agents.config import Config, check_config

CONFIG = "training_config"
"""Key of a module's settings under which the training's config stands, as plain data."""


class PPOModule(TorchRLModule, ValueFunctionAPI):
    """SB3's ActorCriticPolicy, with a value network of its own and a spread that doesn't depend on the state."""

    policy: Any  # torch would have it a tensor or a module

    def setup(self) -> None:
        """Called by RLlib's constructor."""
        config = check_config(self.model_config[CONFIG])
        policy: Any = make_network(config, self.action_space.shape[0])
        with torch.no_grad():
            policy.log_std.fill_(config.ppo.log_std_init)
        self.policy: Any = policy
        self.action_dist_cls = TorchDiagGaussian

    def _forward(self, batch: dict[str, Any], **_: Any) -> dict[str, Any]:
        mean = self.policy.action_net(self.policy.mlp_extractor.forward_actor(batch[Columns.OBS]))
        return {Columns.ACTION_DIST_INPUTS: torch.cat([mean, self.policy.log_std.expand_as(mean)], dim=-1)}

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> torch.Tensor:  # noqa: ARG002
        """(n,), the value of each observation."""
        values: torch.Tensor = self.policy.value_net(self.policy.mlp_extractor.forward_critic(batch[Columns.OBS]))
        return values.squeeze(-1)

    def sb3_network(self) -> BasePolicy:
        """The network as `agents.load` makes it, with these weights."""
        network: BasePolicy = self.policy
        return network


class _Observations(nn.Module):
    def __init__(self, net: nn.Module) -> None:
        super().__init__()
        self.net = net

    def forward(self, batch: dict[str, Any]) -> dict[str, Any]:
        return {ENCODER_OUT: self.net(batch[Columns.OBS])}


class _ObservationsAndActions(nn.Module):
    def forward(self, batch: dict[str, Any]) -> dict[str, Any]:
        return {ENCODER_OUT: torch.cat([batch[Columns.OBS], batch[Columns.ACTIONS]], dim=-1)}


class _GaussianHead(nn.Module):
    def __init__(self, mu: nn.Module, log_std: nn.Module) -> None:
        super().__init__()
        self.mu, self.log_std = mu, log_std

    def forward(self, latent: torch.Tensor) -> torch.Tensor:
        return torch.cat([self.mu(latent), self.log_std(latent).clamp(LOG_STD_MIN, LOG_STD_MAX)], dim=-1)


class SACModule(DefaultSACTorchRLModule):
    """RLlib's SAC module with the parts of SB3's SACPolicy: an actor and two critics of observation and action.

    RLlib's own critics are of another shape (observation and action first go through networks of their own).
    """

    def setup(self) -> None:
        """Called by RLlib's constructor, which takes the critics away again where only actions are wanted."""
        policy: Any = make_network(self._training_config(), self.action_space.shape[0])
        self.twin_q = True
        self.pi_encoder = _Observations(policy.actor.latent_pi)
        self.pi = _GaussianHead(policy.actor.mu, policy.actor.log_std)
        self.qf_encoder, self.qf_twin_encoder = _ObservationsAndActions(), _ObservationsAndActions()
        self.qf, self.qf_twin = policy.critic.q_networks

    def sb3_network(self) -> BasePolicy:
        """The network as `agents.load` makes it, with these weights."""
        network: Any = make_network(self._training_config(), self.action_space.shape[0])
        pairs = [
            (network.actor.latent_pi, self.pi_encoder.net),
            (network.actor.mu, self.pi.mu),
            (network.actor.log_std, self.pi.log_std),
            *zip(network.critic.q_networks, (self.qf, self.qf_twin), strict=True),
            *zip(network.critic_target.q_networks, (self.target_qf, self.target_qf_twin), strict=True),
        ]
        for there, here in pairs:
            there.load_state_dict(here.state_dict())
        policy: BasePolicy = network
        return policy

    def _training_config(self) -> Config:
        return check_config(self.model_config[CONFIG])
