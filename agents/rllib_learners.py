"""What RLlib's learners lack: rewards scaled as Stable-Baselines3's VecNormalize does it, and a state to save."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.torch.ppo_torch_learner import PPOTorchLearner
from ray.rllib.connectors.connector_v2 import ConnectorV2
from ray.rllib.core import DEFAULT_MODULE_ID
from stable_baselines3.common.running_mean_std import RunningMeanStd

from agents.policy import CLIP, EPSILON


class ScaleRewards(ConnectorV2):
    """Divides rewards by the standard deviation of the discounted sum of those so far, with all runners' episodes.

    It stands in the learner rather than in the runners, so that there is one scale, which a lost runner doesn't take
    with it.
    """

    def __init__(self, gamma: float) -> None:
        super().__init__()
        self.gamma = gamma
        self.statistics = RunningMeanStd(shape=())
        self.sums: dict[str, float] = {}  # of the episodes that go on

    def __call__(self, *, episodes: list[Any], batch: dict[str, Any], **_: Any) -> dict[str, Any]:
        """`episodes` may be parts, each of which goes on where the last batch ended."""
        sums, rewards = [], []
        for episode in episodes:
            rewards.append(np.asarray(episode.get_rewards(), dtype=np.float64))
            total = self.sums.pop(episode.id_, 0.0)
            for reward in rewards[-1].tolist():
                total = self.gamma * total + reward
                sums.append(total)
            if not episode.is_done:
                self.sums[episode.id_] = total
        self._forget_all_but(episodes)
        self.statistics.update(np.array(sums))
        scale = np.sqrt(self.statistics.var + EPSILON)
        for episode, own in zip(episodes, rewards, strict=True):
            data = np.array(episode.rewards.data, dtype=np.float32)  # a copy, since Ray's can't be written to
            first = episode.rewards.lookback
            data[first : first + len(own)] = np.clip(own / scale, -CLIP, CLIP)
            episode.rewards.data = data
        return batch

    def _forget_all_but(self, episodes: list[Any]) -> None:
        """Episodes of a lost runner never end."""
        here = {episode.id_ for episode in episodes}
        self.sums = {name: total for name, total in self.sums.items() if name in here}


class ScalingPPOLearner(PPOTorchLearner):
    """RLlib's, with the scaling of rewards before all else."""

    def build(self) -> None:
        """Called once by RLlib."""
        super().build()
        self.rewards = ScaleRewards(self.config.gamma)
        self._learner_connector.prepend(self.rewards)


def learner_state(learner: Any) -> dict[str, Any]:
    """All that a learner has learnt, as tensors and plain numbers: a file of it is read with `weights_only=True`."""
    optimisers = learner.get_optimizers_for_module(DEFAULT_MODULE_ID)
    state: dict[str, Any] = {
        "module": learner.module[DEFAULT_MODULE_ID].state_dict(),
        "optimisers": {name: optimiser.state_dict() for name, optimiser in optimisers},
    }
    if isinstance(learner, ScalingPPOLearner):
        statistics = learner.rewards.statistics
        state["rewards"] = {name: float(getattr(statistics, name)) for name in ("mean", "var", "count")}
    if hasattr(learner, "curr_log_alpha"):  # SAC's weight of the entropy, which is no part of the module
        state["log_alpha"] = learner.curr_log_alpha[DEFAULT_MODULE_ID].detach().clone()
    return state


def restore_learner(learner: Any, state: dict[str, Any]) -> None:
    """Put back what `learner_state` gave."""
    learner.module[DEFAULT_MODULE_ID].load_state_dict(state["module"])
    for name, optimiser in learner.get_optimizers_for_module(DEFAULT_MODULE_ID):
        optimiser.load_state_dict(state["optimisers"][name])
    if "rewards" in state:
        for name, value in state["rewards"].items():
            setattr(learner.rewards.statistics, name, np.float64(value) if name != "count" else value)
    if "log_alpha" in state:
        with torch.no_grad():
            learner.curr_log_alpha[DEFAULT_MODULE_ID].copy_(state["log_alpha"])
