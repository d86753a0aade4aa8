"""The algorithms of Stable-Baselines3 and sb3-contrib, as records: how one is made from a config, and its network.

A new algorithm of theirs is a section in agents/config.py and a record here. (SHAC is our own, in agents/shac.py.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.sac.policies import SACPolicy

from agents.config import Config, NetworkConfig, SACConfig
from agents.controller import STATE_SIZE
from agents.networks import ACTIVATIONS


@dataclass(frozen=True)
class Algorithm:
    """`make_model(config, env, seed)` returns the algorithm, `policy()` the class of its network."""

    make_model: Callable[[Config, VecEnv, int], BaseAlgorithm]
    policy: Callable[[], type[BasePolicy]]


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


def _make_sac(config: Config, env: VecEnv, seed: int) -> BaseAlgorithm:
    return SAC(
        SACPolicy, env, policy_kwargs=_network(config.network), seed=seed, device="cpu", **_off_policy(config.sac)
    )


def _make_tqc(config: Config, env: VecEnv, seed: int) -> BaseAlgorithm:
    model: BaseAlgorithm = _contrib().TQC(
        _tqc_policy(), env, policy_kwargs=_network(config.network), seed=seed, device="cpu", **_off_policy(config.tqc)
    )
    return model


def _off_policy(config: SACConfig) -> dict[str, Any]:
    """Arguments of an algorithm with a replay buffer; as many gradient steps as asked for each round of all rows."""
    return config.model_dump() | {"train_freq": 1}


def _network(config: NetworkConfig) -> dict[str, Any]:
    return {"net_arch": list(config.layers), "activation_fn": ACTIVATIONS[config.activation]}


def _contrib() -> Any:
    try:
        import sb3_contrib
    except ImportError as error:
        raise ValueError(f"algorithm is 'tqc', which needs sb3-contrib: pip install sb3-contrib ({error})") from error
    return sb3_contrib


def _tqc_policy() -> Any:
    _contrib()
    from sb3_contrib.tqc.policies import TQCPolicy

    return TQCPolicy


ALGORITHMS = {
    "ppo": Algorithm(_make_ppo, lambda: ActorCriticPolicy),
    "sac": Algorithm(_make_sac, lambda: SACPolicy),
    "tqc": Algorithm(_make_tqc, _tqc_policy),
}


def make_network(config: Config, axes: int) -> BasePolicy:
    """The policy's network, untrained, for `axes` actions: what a saved state_dict fits."""
    observations = spaces.Box(-np.inf, np.inf, (STATE_SIZE,), np.float32)
    actions = spaces.Box(-1.0, 1.0, (axes,), np.float32)
    return ALGORITHMS[config.algorithm].policy()(
        observations,
        actions,
        lambda _: 0.0,  # the learning rate, of no use here
        **_network(config.network),
    )
