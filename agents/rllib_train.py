"""Training one policy by RLlib, with its runners on this machine or on a cluster, into a run folder like any other."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import torch

from agents import runs
from agents.config import Config
from agents.curve import Curve
from agents.files import write_atomically, write_json
from agents.policy import LearnedPolicy
from agents.ray_start import ray_running
from agents.rllib_env import NAME, fixed_variance, make_runner_env, seed_of_stretch
from agents.training import prepare
from agents.training_env import task_equilibrium

RECORD = "rllib.json"
"""In the run folder: what run.json doesn't say of such a training."""
ENGINE = "rllib"
TIMERS = ("training_step", "env_runner_sampling_timer", "learner_update_timer")
"""RLlib's, told in RECORD: means over the last rounds, of which each samples, learns and hands out the weights."""


def train(
    config: Config, folder: str | Path, *, runners: int = 2, address: str | None = None, progress: bool = True
) -> LearnedPolicy:
    """Train, or go on with, the policy that `config` describes and that lives in `folder`.

    The same call goes on after an interruption, from the last checkpoint, with any number of runners, and returns at
    once when all is done. The folder holds what one of scripts/train.py does, and nothing of Ray's.

    Arguments:
        runners: processes that step the environments; 0: this one does.
        address: of a Ray cluster, or None for this machine alone.

    Raises ValueError for what RLlib can't do, and as `agents.training.train` does; then nothing has been written.
    """
    from agents.rllib_config import refuse_what_cannot_be

    folder = Path(folder)
    refuse_what_cannot_be(config, runners)
    reference = task_equilibrium(config)  # refuses wrong arguments of the environment before anything is written
    with runs.locked(folder):
        checkpoint = _read_checkpoint(folder)
        if prepare(config, folder):
            return LearnedPolicy.load(folder)
        torch.set_num_threads(1)
        with ray_running(address, runners):
            training = _Training(config, folder, runners, checkpoint, progress)
            try:
                training.run()
                network = training.learner().module["default_policy"].unwrapped().sb3_network()
            finally:
                training.close()
        mean, variance = torch.zeros(len(reference), dtype=torch.float64).numpy(), fixed_variance(config)
        policy = LearnedPolicy(config, network, reference, mean, variance)
        policy.save(folder)
        runs.write_record(config, folder, training.steps, training.seconds(), finished=True)
        (folder / runs.CHECKPOINT).unlink(missing_ok=True)
        return policy


def _read_checkpoint(folder: Path) -> dict[str, Any] | None:
    path = folder / runs.CHECKPOINT
    if not path.is_file():
        return None
    checkpoint: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    if checkpoint.get("engine") != ENGINE:
        raise ValueError(f"{path} is of a training by scripts/train.py; allowed is a new folder or one of RLlib's")
    return checkpoint


class _Training:
    """RLlib's algorithm, with curve, checkpoints and records."""

    def __init__(
        self, config: Config, folder: Path, runners: int, checkpoint: dict[str, Any] | None, progress: bool
    ) -> None:
        from ray.tune.registry import register_env

        from agents.rllib_config import algorithm_config
        from agents.rllib_learners import restore_learner

        self.config, self.folder, self.runners = config, folder, runners
        self.steps_before = self.steps = self.saved_at = int(checkpoint["steps"]) if checkpoint else 0
        self.seconds_before = float(checkpoint["seconds"]) if checkpoint else 0.0
        self.restarts_before = self.restarts = int(checkpoint["restarts"]) if checkpoint else 0
        register_env(NAME, make_runner_env)
        torch.manual_seed(seed_of_stretch(config, self.steps))  # of the networks' first weights
        self.algorithm = algorithm_config(config, runners, self.steps).build_algo()
        if checkpoint:
            restore_learner(self.learner(), checkpoint["learner"])
            self.algorithm.env_runner_group.sync_weights(
                from_worker_or_learner_group=self.algorithm.learner_group, inference_only=True
            )
        self.timers: dict[str, float] = {}
        self.curve = Curve(folder, self.steps, config.training.steps, progress)
        self.started = time.monotonic()  # from here on there are steps

    def learner(self) -> Any:
        """RLlib's only learner, which lives in this process."""
        found: list[Any] = []
        self.algorithm.learner_group.foreach_learner(lambda learner, **_: found.append(learner))
        return found[0]

    def seconds(self) -> float:
        """Wall time that the training has taken, interruptions apart."""
        return self.seconds_before + time.monotonic() - self.started

    def run(self) -> None:
        """Train to the end."""
        while self.steps < self.config.training.steps:
            results = self.algorithm.train()
            told = results["env_runners"]
            self.steps = self.steps_before + int(told["num_env_steps_sampled_lifetime"])
            self.restarts = self.restarts_before + int(results["fault_tolerance"]["num_remote_worker_restarts"])
            self._add_to_curve(told)
            self.timers = {name: float(value) for name, value in results["timers"].items() if name in TIMERS}
            if self.steps - self.saved_at >= self.config.training.checkpoint_every:
                self._save()
        self._write_records()

    def close(self) -> None:
        """End the runners."""
        self.curve.close()
        self.algorithm.stop()

    def _add_to_curve(self, told: dict[str, Any]) -> None:
        from agents.rllib_config import ENDED_EARLY

        row: dict[str, Any] = {"steps": self.steps, "seconds": round(self.seconds(), 2)}
        row |= {"episodes": int(told.get("num_episodes", 0)), "return": "", "length": "", "ended_early": ""}
        if row["episodes"]:
            # RLlib's means are over the last hundred episodes or so.
            row |= {
                "return": round(float(told["episode_return_mean"]), 4),
                "length": round(float(told["episode_len_mean"]), 2),
                "ended_early": round(float(told[ENDED_EARLY]), 4),
            }
        self.curve.add(row, {"return": row["return"], "ended early": row["ended_early"]})

    def _save(self) -> None:
        from agents.rllib_learners import learner_state

        content = {
            "engine": ENGINE,
            "learner": learner_state(self.learner()),
            "steps": self.steps,
            "seconds": self.seconds(),
            "restarts": self.restarts,
        }
        write_atomically(self.folder / runs.CHECKPOINT, lambda file: torch.save(content, file))
        self._write_records()
        self.saved_at = self.steps

    def _write_records(self) -> None:
        import ray

        runs.write_record(self.config, self.folder, self.steps, self.seconds(), finished=False)
        speed = (self.steps - self.steps_before) / (time.monotonic() - self.started)
        record = {"ray": ray.__version__, "runners": self.runners, "runners_restarted": self.restarts}
        write_json(self.folder / RECORD, record | {"steps_per_second": round(speed), "seconds_of_a_round": self.timers})
