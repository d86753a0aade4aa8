"""Training one policy into a run folder, from which it can be taken up again at any time."""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from agents import runs
from agents.algorithms import ALGORITHMS
from agents.config import Config
from agents.controller import STATE_SIZE
from agents.curve import Curve
from agents.files import write_atomically, write_text
from agents.policy import CLIP, EPSILON, LearnedPolicy
from agents.training_env import RelativeObservations, make_training_env, task_equilibrium

STEPS_A_ROW = 32
"""A row of the curve tells of at least so many steps of each environment."""


def train(config: Config, folder: str | Path, *, progress: bool = True) -> LearnedPolicy:
    """Train, or go on with, the policy that `config` describes and that lives in `folder`.

    The same call goes on after an interruption, from the last checkpoint, and returns at once when all is done.
    Raises ValueError where the folder holds something else (files of another kind, or a run with another config), or
    where the environment refuses its arguments; then nothing has been written.
    """
    folder = Path(folder)
    reference = task_equilibrium(config)  # refuses wrong arguments of the environment before anything is written
    if _prepare(config, folder):
        return LearnedPolicy.load(folder)
    torch.set_num_threads(1)  # such small networks lose time by sharing their work
    if config.algorithm == "shac":
        from agents.shac import train_shac

        return train_shac(config, folder, progress=progress)

    checkpoint = _read_checkpoint(folder)
    steps_before = int(checkpoint["steps"]) if checkpoint else 0
    env = VecNormalize(
        RelativeObservations(make_training_env(config), reference),
        norm_reward=config.training.normalise_reward,
        clip_obs=CLIP,
        gamma=config.gamma,
        epsilon=EPSILON,
    )
    if config.observation.scales:
        env.obs_rms = _FixedScales(*config.observation.scales)  # type: ignore[assignment]  # declared as a mapping
    try:
        model = ALGORITHMS[config.algorithm].make_model(config, env, runs.seed_of_stretch(config, steps_before))
        model.set_logger(_logger(folder))
        if checkpoint:
            _restore(model, env, checkpoint)
        recorder = _Recorder(config, folder, env, progress, seconds_before=checkpoint["seconds"] if checkpoint else 0.0)
        remaining = config.training.steps - steps_before
        if remaining > 0:
            model.learn(remaining, callback=recorder, reset_num_timesteps=False)
        seen = _running(env.obs_rms)
        policy = LearnedPolicy(config, model.policy, reference, seen.mean.copy(), seen.var.copy())
        policy.save(folder)
        runs.write_record(config, folder, model.num_timesteps, recorder.seconds(), finished=True)
        (folder / runs.CHECKPOINT).unlink(missing_ok=True)
    finally:
        env.close()
    return policy


def _prepare(config: Config, folder: Path) -> bool:
    """Make the folder ready for this config; return whether its run is finished already."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder is {str(folder)!r}, which is a file; allowed is a new folder or that of the same run")
    if (folder / runs.CONFIG).is_file():
        difference = _difference(runs.read_run_config(folder).model_dump(), config.model_dump())
        if difference:
            raise ValueError(
                f"folder is {str(folder)!r}, which holds a run with another config ({difference}); "
                "allowed is a new folder or that of the same run"
            )
        return bool(runs.read_record(folder).get("finished"))
    if folder.is_dir() and any(folder.iterdir()):
        raise ValueError(
            f"folder is {str(folder)!r}, which holds files but no run; allowed is a new folder or that of the same run"
        )
    write_text(folder / runs.CONFIG, config.to_yaml())
    return False


def _difference(there: Any, here: Any, name: str = "") -> str:
    """The first setting in which two configs differ, in words."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in here:
            words = _difference(there.get(key), here[key], f"{name}.{key}" if name else key)
            if words:
                return words
        return ""
    return "" if there == here else f"{name} is {there} there and {here} here"


def _logger(folder: Path) -> Any:
    formats = ["tensorboard"] if importlib.util.find_spec("tensorboard") else []
    return configure(str(folder / runs.TENSORBOARD), formats)


def _write_checkpoint(model: BaseAlgorithm, env: VecNormalize, folder: Path, seconds: float) -> None:
    """One file, replaced at once, so that weights, optimiser, statistics and counters always belong together."""
    content = {
        "parameters": model.get_parameters(),
        "observations": _statistics(_running(env.obs_rms)),
        "returns": _statistics(env.ret_rms),
        "steps": model.num_timesteps,
        "seconds": seconds,
    }
    entropy = getattr(model, "log_ent_coef", None)  # SAC's, which `get_parameters` leaves out
    if entropy is not None:
        content["entropy"] = entropy.detach()
    write_atomically(folder / runs.CHECKPOINT, lambda file: torch.save(content, file))


def _read_checkpoint(folder: Path) -> dict[str, Any] | None:
    path = folder / runs.CHECKPOINT
    return torch.load(path, map_location="cpu", weights_only=True) if path.is_file() else None


def _restore(model: BaseAlgorithm, env: VecNormalize, checkpoint: dict[str, Any]) -> None:
    model.set_parameters(checkpoint["parameters"], exact_match=True, device="cpu")
    if "entropy" in checkpoint:
        with torch.no_grad():
            model.log_ent_coef.copy_(checkpoint["entropy"])  # type: ignore[attr-defined]
    model.num_timesteps = checkpoint["steps"]
    pairs = ((_running(env.obs_rms), checkpoint["observations"]), (env.ret_rms, checkpoint["returns"]))
    for statistics, saved in pairs:
        statistics.mean, statistics.var = saved["mean"].numpy(), saved["variance"].numpy()
        statistics.count = saved["count"]


def _running(statistics: Any) -> RunningMeanStd:
    """VecNormalize keeps a mapping of statistics where observations are a mapping; here they never are."""
    if not isinstance(statistics, RunningMeanStd):
        raise TypeError(f"statistics of observations are {type(statistics).__name__}; allowed is RunningMeanStd")
    return statistics


class _FixedScales(RunningMeanStd):
    """Statistics that are given instead of gathered."""

    def __init__(self, position: float, velocity: float) -> None:
        super().__init__(shape=(STATE_SIZE,))
        self.var = np.repeat([position**2, velocity**2], STATE_SIZE // 2)

    def update(self, arr: NDArray[Any]) -> None:
        """Nothing is gathered."""


def _statistics(running: RunningMeanStd) -> dict[str, Any]:
    return {
        "mean": torch.as_tensor(np.asarray(running.mean)),
        "variance": torch.as_tensor(np.asarray(running.var)),
        "count": float(running.count),
    }


class _Recorder(BaseCallback):
    """Progress bar, curve and checkpoints."""

    def __init__(self, config: Config, folder: Path, env: VecNormalize, progress: bool, seconds_before: float) -> None:
        super().__init__()
        self.config = config
        self.folder = folder
        self.env = env
        self.progress = progress
        self.seconds_before = seconds_before
        self.started = time.monotonic()
        self.episodes: list[tuple[float, int, bool]] = []  # return, control periods, whether it ended early
        self.saved_at = 0
        self.curve: Curve | None = None

    def seconds(self) -> float:
        """Wall time that the training has taken, interruptions apart."""
        return self.seconds_before + time.monotonic() - self.started

    def _on_training_start(self) -> None:
        self.saved_at = self.num_timesteps = self.model.num_timesteps
        self.curve = Curve(self.folder, self.saved_at, self.config.training.steps, self.progress)

    def _on_rollout_start(self) -> None:
        # Here the network has just been updated and no rollout is half done.
        if self.num_timesteps - self.saved_at >= self.config.training.checkpoint_every:
            _write_checkpoint(self.model, self.env, self.folder, self.seconds())
            runs.write_record(self.config, self.folder, self.num_timesteps, self.seconds(), finished=False)
            self.saved_at = self.num_timesteps

    def _on_step(self) -> bool:
        for i in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][i]
            early = not info.get("TimeLimit.truncated", False)
            self.episodes.append((float(info["episode"]["r"]), int(info["episode"]["l"]), early))
        return True

    def _on_rollout_end(self) -> None:
        assert self.curve is not None, "training has started"
        told = int(self.curve.rows[-1]["steps"]) if self.curve.rows else 0
        if self.num_timesteps - told < STEPS_A_ROW * self.config.training.environments:
            return  # an algorithm with a replay buffer has a rollout of a single step
        row: dict[str, Any] = {"steps": self.num_timesteps, "seconds": round(self.seconds(), 2)}
        row |= {"episodes": len(self.episodes), "return": "", "length": "", "ended_early": ""}
        if self.episodes:
            returns, lengths, early = (np.array(column, dtype=float) for column in zip(*self.episodes, strict=True))
            row |= {
                "return": round(returns.mean(), 4),
                "length": round(lengths.mean(), 2),
                "ended_early": round(early.mean(), 4),
            }
            for name in ("return", "length", "ended_early"):
                self.logger.record(f"episode/{name}", row[name])
        self.episodes.clear()
        self.curve.add(row, {"return": row["return"], "ended early": row["ended_early"]})

    def _on_training_end(self) -> None:
        assert self.curve is not None, "training has started"
        self.curve.close()
