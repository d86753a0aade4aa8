"""Training one policy into a run folder, from which it can be taken up again at any time."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from agents import runs
from agents.algorithms import ALGORITHMS
from agents.checkpoints import Checkpoints, Stateful
from agents.config import Config
from agents.controller import STATE_SIZE
from agents.curve import Curve
from agents.files import remove_temporary, write_text
from agents.policy import CLIP, EPSILON, LearnedPolicy
from agents.sb3_state import SB3Environments, SB3Learner, running
from agents.stopping import Stop
from agents.training_env import RelativeObservations, make_training_env, task_equilibrium

STEPS_A_ROW = 32
"""A row of the curve tells of at least so many steps of each environment."""


def train(config: Config, folder: str | Path, *, progress: bool = True) -> LearnedPolicy:
    """Train, or go on with, the policy that `config` describes and that lives in `folder`.

    The same call goes on after an interruption, from the last checkpoint, and returns at once when all is done. The
    policy has the bits that it would have without the interruption (on the same machine).

    Raises ValueError where the folder holds something else (files of another kind, a run with another config, or
    another training at work), or where the environment refuses its arguments; then nothing has been written. Raises
    OSError where files can't be written, and `agents.stopping.Stopped`, a KeyboardInterrupt, after SIGINT or SIGTERM;
    then the last checkpoint is whole.
    """
    folder = Path(folder)
    reference = task_equilibrium(config)  # refuses wrong arguments of the environment before anything is written
    with runs.locked(folder), Stop() as stop:
        if prepare(config, folder):
            return LearnedPolicy.load(folder)
        torch.set_num_threads(1)  # such small networks lose time by sharing their work
        if config.algorithm == "shac":
            from agents.shac import train_shac

            return train_shac(config, folder, stop, progress=progress)
        return _train_sb3(config, folder, reference, stop, progress=progress)


def _train_sb3(
    config: Config, folder: Path, reference: NDArray[np.float64], stop: Stop, *, progress: bool
) -> LearnedPolicy:
    """The same for the algorithms of Stable-Baselines3, in a folder that is ready."""
    envs = make_training_env(config)
    env = VecNormalize(
        RelativeObservations(envs, reference),
        norm_reward=config.training.normalise_reward,
        clip_obs=CLIP,
        gamma=config.gamma,
        epsilon=EPSILON,
    )
    if config.observation.scales:
        env.obs_rms = _FixedScales(*config.observation.scales)  # type: ignore[assignment]  # declared as a mapping
    try:
        model = ALGORITHMS[config.algorithm].make_model(config, env, config.training.seed)
        model.set_logger(_logger(folder))
        recorder = _Recorder()
        parts: dict[str, Stateful] = {
            "learner": SB3Learner(model),
            "environments": SB3Environments(env, envs),
            "episodes": recorder,
        }
        recorder.checkpoints = checkpoints = Checkpoints(config, folder, parts, stop)
        steps = checkpoints.resume()
        with Curve(folder, steps, config.training.steps, progress) as curve:
            recorder.curve = curve
            if steps < config.training.steps:
                model.learn(config.training.steps - steps, callback=recorder, reset_num_timesteps=False)
        seen = running(env.obs_rms)
        policy = LearnedPolicy(config, model.policy, reference, seen.mean.copy(), seen.var.copy())
        policy.save(folder)
        checkpoints.finish(model.num_timesteps)
    finally:
        env.close()
    return policy


def prepare(config: Config, folder: Path) -> bool:
    """Make a folder that is there ready for this config; return whether its run is finished already.

    Raises ValueError where it holds something else.
    """
    remove_temporary(folder)
    if runs.is_there(folder / runs.CONFIG):
        difference = _difference(runs.read_run_config(folder).model_dump(), config.model_dump())
        if difference:
            raise ValueError(
                f"folder is {str(folder)!r}, which holds a run with another config ({difference}); "
                "allowed is a new folder or that of the same run"
            )
        if not runs.read_record(folder).get("finished"):
            return False
        (folder / runs.CHECKPOINT).unlink(missing_ok=True)  # killed between two of the last lines
        return True
    if any(folder.iterdir()):
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


class _FixedScales(RunningMeanStd):
    """Statistics that are given instead of gathered."""

    def __init__(self, position: float, velocity: float) -> None:
        super().__init__(shape=(STATE_SIZE,))
        self.var = np.repeat([position**2, velocity**2], STATE_SIZE // 2)

    def update(self, arr: NDArray[Any]) -> None:
        """Nothing is gathered."""


class _Recorder(BaseCallback):
    """Curve and checkpoints; `checkpoints` and `curve` are to be set before the training begins."""

    checkpoints: Checkpoints
    curve: Curve

    def __init__(self) -> None:
        super().__init__()
        self.episodes: list[tuple[float, int, bool]] = []  # return, control periods, whether it ended early

    def state(self) -> dict[str, Any]:
        """The episodes of which no row has told."""
        return {"episodes": self.episodes}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state()`."""
        self.episodes = [(float(total), int(length), bool(early)) for total, length, early in state["episodes"]]

    def _on_rollout_start(self) -> None:
        # Here the network has just been updated and no rollout is half done.
        self.checkpoints.between(self.model.num_timesteps)

    def _on_step(self) -> bool:
        for i in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][i]
            early = not info.get("TimeLimit.truncated", False)
            self.episodes.append((float(info["episode"]["r"]), int(info["episode"]["l"]), early))
        return True

    def _on_rollout_end(self) -> None:
        told = int(self.curve.rows[-1]["steps"]) if self.curve.rows else 0
        if self.num_timesteps - told < STEPS_A_ROW * self.training_env.num_envs:
            return  # an algorithm with a replay buffer has a rollout of a single step
        seconds = round(self.checkpoints.clock.read()[0], 2)
        row: dict[str, Any] = {"steps": self.num_timesteps, "seconds": seconds}
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
