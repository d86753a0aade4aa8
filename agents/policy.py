"""A learned policy as it is used: raw observation in, action out, with nothing pickled on the way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents import torch_file
from agents.config import Config
from agents.controller import AXES, STATE_SIZE, StateFeedback
from agents.files import read_arrays, write_arrays
from agents.relative import relative
from agents.runs import NORMALISATION, POLICY, find_run, read_run_config

CLIP = 10.0  # standard deviations; a rare extreme must not push the network where it was never trained
EPSILON = 1e-8  # added to the variance, so that a coordinate that never moves divides by no zero


class LearnedPolicy(StateFeedback):
    """A trained network with all that stands between it and the environment's observation.

    Arguments:
        config: of the training.
        network: Stable-Baselines3's policy, or a torch module that a subclass knows to use.
        reference: (18,), the equilibrium that observations are made relative to.
        mean, variance: (18,), of the relative observations seen in training.
    """

    def __init__(
        self,
        config: Config,
        network: Any,
        reference: NDArray[np.float64],
        mean: NDArray[np.float64],
        variance: NDArray[np.float64],
    ) -> None:
        self.config = config
        self.network = network
        self.reference = reference
        self.mean = mean
        self.variance = variance
        network.train(False)

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:
        """What the network says, limited to [-1, 1]: (n, axes) for raw observations (n, 18)."""
        seen = relative(observations, self.reference).astype(np.float32)
        scaled = np.clip((seen - self.mean) / np.sqrt(self.variance + EPSILON), -CLIP, CLIP).astype(np.float32)
        actions: NDArray[np.float64] = self.network.predict(scaled, deterministic=deterministic)[0].astype(np.float64)
        return actions

    def save(self, folder: Path) -> None:
        """Write weights and statistics into a run folder."""
        torch_file.write(folder / POLICY, dict(self.network.state_dict()))
        arrays = {"reference": self.reference, "mean": self.mean, "variance": self.variance}
        write_arrays(folder / NORMALISATION, arrays)

    @classmethod
    def load(cls, name_or_folder: str | Path) -> LearnedPolicy:
        """Load a shipped policy or a run folder; raises ValueError where it is neither or is damaged."""
        folder = find_run(name_or_folder)
        config = read_run_config(folder)
        try:
            arrays = read_arrays(folder / NORMALISATION)
            reference, mean, variance = (_vector(arrays, name) for name in ("reference", "mean", "variance"))
        except (KeyError, ValueError, OSError) as error:
            raise ValueError(f"{folder / NORMALISATION} is not the statistics of a run: {error}") from error
        network, kind = cls._untrained(config)
        try:
            _take(network, torch_file.read(folder / POLICY))
        except (ValueError, OSError) as error:
            raise ValueError(f"{folder / POLICY} does not hold the weights of its config: {error}") from error
        return kind(config, network, reference, mean, variance)

    @staticmethod
    def _untrained(config: Config) -> tuple[Any, type[LearnedPolicy]]:
        """The network of a config, and the policy that runs it. Each imports only what it needs itself."""
        if config.algorithm == "shac":
            from agents.residual import ResidualNetwork, ResidualPolicy

            return ResidualNetwork(config), ResidualPolicy
        from agents.algorithms import make_network

        return make_network(config, axes=len(config.environment.actuated_axes or AXES)), LearnedPolicy


def _take(network: Any, weights: Any) -> None:
    """Put saved weights into a network. Raises ValueError where they aren't just those that it has, all finite."""
    own: dict[str, torch.Tensor] = network.state_dict()
    if not isinstance(weights, dict) or weights.keys() != own.keys():
        names = sorted(map(str, own.keys() ^ weights.keys())) if isinstance(weights, dict) else ["all"]
        raise ValueError(f"missing or unknown: {', '.join(names[:5])}{', ...' if len(names) > 5 else ''}")
    for name, tensor in weights.items():
        if not torch.is_tensor(tensor) or (tensor.shape, tensor.dtype) != (own[name].shape, own[name].dtype):
            found = f"{tensor.dtype} of shape {tuple(tensor.shape)}" if torch.is_tensor(tensor) else "no tensor"
            raise ValueError(f"{name} is {found}; allowed is {own[name].dtype} of shape {tuple(own[name].shape)}")
        if not tensor.isfinite().all():
            raise ValueError(f"{name} holds numbers that are not finite")
    network.load_state_dict(weights)


def _vector(arrays: dict[str, NDArray[Any]], name: str) -> NDArray[np.float64]:
    if arrays[name].dtype.kind != "f" or arrays[name].shape != (STATE_SIZE,):
        raise ValueError(
            f"{name} is {arrays[name].dtype} of shape {arrays[name].shape}; allowed are {STATE_SIZE} numbers"
        )
    vector = arrays[name].astype(np.float64)
    if not np.isfinite(vector).all() or (name == "variance" and (vector < 0.0).any()):
        raise ValueError(f"{name} holds {vector[~(np.isfinite(vector) & (vector >= 0))][0]}")
    return vector
