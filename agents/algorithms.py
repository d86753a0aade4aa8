"""The learning algorithms, as records: how one is made from a config, and what network its policy is.

A new algorithm is a section in agents/config.py and a record here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.vec_env import VecEnv

from agents.config import Config, NetworkConfig
from agents.controller import STATE_SIZE
from agents.networks import ACTIVATIONS


@dataclass(frozen=True)
class Algorithm:
    """`make_model(config, env, seed)` returns the algorithm, `policy` is the class of its network."""

    make_model: Callable[[Config, VecEnv, int], BaseAlgorithm]
    policy: type[BasePolicy]


def _make_ppo(config: Config, env: VecEnv, seed: int) -> BaseAlgorithm:
    settings = config.ppo.model_dump(exclude={"learning_rate", "final_learning_rate", "log_std_init"})
    first, last = config.ppo.learning_rate, config.ppo.final_learning_rate
    return PPO(
        ActorCriticPolicy,
        env,
        learning_rate=lambda remaining: last + (first - last) * remaining,
        policy_kwargs={**_network(config.network), "log_std_init": config.ppo.log_std_init},
        seed=seed,
        device="cpu",
        **settings,
    )


def _network(config: NetworkConfig) -> dict[str, Any]:
    return {"net_arch": list(config.layers), "activation_fn": ACTIVATIONS[config.activation]}


ALGORITHMS = {"ppo": Algorithm(_make_ppo, ActorCriticPolicy)}


def make_network(config: Config, axes: int) -> BasePolicy:
    """The policy's network, untrained, for `axes` actions: what a saved state_dict fits."""
    observations = spaces.Box(-np.inf, np.inf, (STATE_SIZE,), np.float32)
    actions = spaces.Box(-1.0, 1.0, (axes,), np.float32)
    return ALGORITHMS[config.algorithm].policy(
        observations,
        actions,
        lambda _: 0.0,  # the learning rate, of no use here
        **_network(config.network),
    )
