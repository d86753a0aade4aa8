"""Policies in Stable-Baselines3's own archives, such as the Zoo leaves. They are pickled: loading one may run anything.

Nothing else here loads them, and this only for who says --trust.
"""

from __future__ import annotations

import importlib
import json
import zipfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.controller import STATE_SIZE, StateFeedback

ALGORITHMS = {
    "stable_baselines3.common.policies": ("stable_baselines3", "PPO"),
    "stable_baselines3.sac.policies": ("stable_baselines3", "SAC"),
    "stable_baselines3.td3.policies": ("stable_baselines3", "TD3"),
    "sb3_contrib.tqc.policies": ("sb3_contrib", "TQC"),
}
"""By the module of an archive's policy: where its algorithm is, and its name."""

STATISTICS = "vecnormalize.pkl"


def is_archive(name: str | Path) -> bool:
    """Whether this names an archive of SB3."""
    return str(name).endswith(".zip")


class TrustedPolicy(StateFeedback):
    """An algorithm of SB3 that was trained on raw observations, or on those that `normalised` makes of them."""

    def __init__(self, model: Any, normalised: Any) -> None:
        self.model = model
        self.normalised = normalised

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:
        """Actions (n, axes) in [-1, 1] for raw observations (n, 18)."""
        seen = observations if self.normalised is None else self.normalised.normalize_obs(observations)
        actions: NDArray[np.float64] = self.model.predict(seen, deterministic=deterministic)[0].astype(np.float64)
        return actions


def load(path: str | Path, environment_id: str, axes: str, *, trust: bool) -> TrustedPolicy:
    """Load an archive, and the statistics of observations in `vecnormalize.pkl` beside it or one folder below.

    Raises ValueError without `trust`, and where the file is no archive of SB3 or is for something else.
    """
    path = Path(path)
    if not trust:
        raise ValueError(
            f"{path} is an archive of Stable-Baselines3, which is pickled and can run code when it is loaded: "
            "say --trust if you know who made it"
        )
    algorithm = _algorithm(path)
    from stable_baselines3.common.vec_env import VecNormalize

    from agents.sb3 import SpringPendulumVecEnv

    try:
        model = algorithm.load(path, device="cpu")
    except Exception as error:  # whatever the archive does
        raise ValueError(f"{path} can't be loaded by Stable-Baselines3: {type(error).__name__}: {error}") from error
    shapes = (model.observation_space.shape, model.action_space.shape)
    if shapes != ((STATE_SIZE,), (len(axes),)):
        raise ValueError(
            f"{path} takes {shapes[0]} and gives {shapes[1]}; allowed are ({STATE_SIZE},) and ({len(axes)},)"
        )
    statistics = [
        file for file in (path.parent / STATISTICS, *sorted(path.parent.glob(f"*/{STATISTICS}"))) if file.is_file()
    ]
    normalised = None
    if statistics:
        env = SpringPendulumVecEnv(environment_id, 1, actuated_axes=axes)
        normalised = VecNormalize.load(str(statistics[0]), env)
        env.close()
    return TrustedPolicy(model, normalised)


def _algorithm(path: Path) -> Any:
    """The class whose archive this is, by the one part of it that is plain text."""
    try:
        with zipfile.ZipFile(path) as archive:
            module = json.loads(archive.read("data"))["policy_class"]["__module__"]
        package, name = ALGORITHMS[module]
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        known = ", ".join(name for _, name in ALGORITHMS.values())
        raise ValueError(f"{path} is no archive of Stable-Baselines3 with one of {known}: {error}") from None
    try:
        return getattr(importlib.import_module(package), name)
    except ImportError as error:
        hint = f"{path} needs {package}: pip install {package}"
        raise gym.error.DependencyNotInstalled(hint) from error
