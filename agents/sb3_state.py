"""All that an algorithm of Stable-Baselines3 and its environments remember between two rollouts.

SB3's own `save` leaves out where its environments and random numbers are, what was observed last and the rewards'
statistics, and pickles what it saves.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from agents.checkpoints import check_learnt, fitting
from agents.sb3 import SpringPendulumVecEnv
from spring_pendulum_env.starts import generator_of, words_of

_REMEMBERED = ("_last_obs", "_last_original_obs", "_last_episode_starts")
_REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class SB3Learner:
    """The algorithm's own part: weights, optimisers, replay buffer, last observations, random actions."""

    def __init__(self, model: BaseAlgorithm) -> None:
        self.model = model

    def state(self) -> dict[str, Any]:
        content: dict[str, Any] = {
            "steps": self.model.num_timesteps,
            "parameters": self.model.get_parameters(),
            "remembered": {name: getattr(self.model, name) for name in _REMEMBERED},
            "exploration": words_of(self.model.action_space.np_random),
        }
        entropy = getattr(self.model, "log_ent_coef", None)  # SAC's, which `get_parameters` leaves out
        if entropy is not None:
            content["entropy"] = entropy.detach()
        buffer = self._replay_buffer()
        if buffer is not None:
            filled = slice(0, buffer.buffer_size if buffer.full else buffer.pos)
            content["replay"] = {name: getattr(buffer, name)[filled] for name in _REPLAYED}
            content["replay"] |= {"pos": buffer.pos, "full": buffer.full}
        return content

    def restore(self, state: dict[str, Any]) -> None:
        model = self.model
        model.set_parameters(state["parameters"], exact_match=True, device="cpu")
        entropy = getattr(model, "log_ent_coef", None)
        learnt = list(model.policy.parameters())
        if entropy is not None:
            with torch.no_grad():
                entropy.copy_(state["entropy"])
            learnt.append(entropy)
        check_learnt(learnt, _optimisers(model))
        assert model.env is not None, "it is made with environments"
        count = model.env.num_envs
        observations = np.zeros((count, *model.observation_space.shape), np.float32)  # type: ignore[misc]
        own = dict(zip(_REMEMBERED, (observations, observations, np.zeros(count, dtype=np.bool_)), strict=True))
        for name, given in state["remembered"].items():
            setattr(model, name, None if given is None else fitting(name, given, own[name]))
        generator = generator_of(fitting("exploration", state["exploration"], words_of(model.action_space.np_random)))
        model.action_space.np_random.bit_generator.state = generator.bit_generator.state
        model.num_timesteps = int(state["steps"])
        buffer = self._replay_buffer()
        if buffer is not None:
            _refill(buffer, state["replay"])

    def _replay_buffer(self) -> ReplayBuffer | None:
        return getattr(self.model, "replay_buffer", None)


class SB3Environments:
    """The part of the environments, and of the statistics that are gathered on the way from them.

    Arguments:
        normalised: the outermost wrapper.
        envs: what lies within all wrappers.
    """

    def __init__(self, normalised: VecNormalize, envs: SpringPendulumVecEnv) -> None:
        self.normalised = normalised
        self.envs = envs

    def state(self) -> dict[str, Any]:
        return {
            "envs": self.envs.get_state(),
            "observations": _statistics(running(self.normalised.obs_rms)),
            "rewards": _statistics(self.normalised.ret_rms),
            "returns": self.normalised.returns,
        }

    def restore(self, state: dict[str, Any]) -> None:
        self.envs.set_state(state["envs"])
        _restore_statistics(running(self.normalised.obs_rms), state["observations"])
        _restore_statistics(self.normalised.ret_rms, state["rewards"])
        self.normalised.returns = fitting("returns", state["returns"], self.normalised.returns)


def running(statistics: Any) -> RunningMeanStd:
    """VecNormalize keeps a mapping of statistics where observations are a mapping; here they never are."""
    if not isinstance(statistics, RunningMeanStd):
        raise TypeError(f"statistics of observations are {type(statistics).__name__}; allowed is RunningMeanStd")
    return statistics


def _statistics(of: RunningMeanStd) -> dict[str, Any]:
    return {"mean": np.asarray(of.mean), "variance": np.asarray(of.var), "count": float(of.count)}


def _restore_statistics(of: RunningMeanStd, state: dict[str, Any]) -> None:
    of.mean = fitting("mean", state["mean"], np.asarray(of.mean))
    of.var = fitting("variance", state["variance"], np.asarray(of.var))
    of.count = float(state["count"])


def _optimisers(model: BaseAlgorithm) -> list[torch.optim.Optimizer]:
    of = (model.policy, *(getattr(model.policy, name, None) for name in ("actor", "critic")))
    found = [getattr(part, "optimizer", None) for part in of] + [getattr(model, "ent_coef_optimizer", None)]
    return [optimiser for optimiser in found if optimiser is not None]


def _refill(buffer: ReplayBuffer, state: dict[str, Any]) -> None:
    """Put back what was kept. Only what was filled is saved."""
    pos, full = int(state["pos"]), bool(state["full"])
    if not 0 <= pos < buffer.buffer_size:
        raise ValueError(f"pos is {pos}; allowed is 0 to {buffer.buffer_size - 1}")
    filled = slice(0, buffer.buffer_size if full else pos)
    for name in _REPLAYED:
        own = getattr(buffer, name)
        own[filled] = fitting(name, state[name], own[filled])
    buffer.pos, buffer.full = pos, full
