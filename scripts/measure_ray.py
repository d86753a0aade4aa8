"""What a step costs an RLlib training in processor time, and so what more runners bring: scripts/measure_ray.py.

All in one process, with PPO on the damping task as configs/damping-ppo.yaml says. Needs Ray: make ray.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands
from agents.config import default_path, read_config


def main() -> None:
    commands.Parser(description=__doc__).parse_args()

    import numpy as np
    import torch

    from agents.ray_start import ray_running
    from agents.rllib_env import NAME, RunnerEnv, make_runner_env

    config = read_config(default_path("damping", "ppo"))
    rows, length = config.training.environments, config.ppo.n_steps
    env = RunnerEnv(config, rows, [0])
    env.reset(seed=0)
    actions = np.zeros((rows, 3))
    env.step(actions)
    stepping = _seconds(lambda: [env.step(actions) for _ in range(10 * length)]) / (10 * length * rows)

    torch.set_num_threads(1)
    with ray_running(None, 1):
        from ray.tune.registry import register_env

        from agents.rllib_config import algorithm_config

        register_env(NAME, make_runner_env)
        algorithm = algorithm_config(config, runners=0).build_algo()
        episodes: list[Any] = []
        algorithm.env_runner.sample(num_timesteps=rows)
        sampling = _seconds(lambda: episodes.append(algorithm.env_runner.sample(num_timesteps=rows * length)))
        learning = _seconds(lambda: algorithm.learner_group.update(episodes=episodes[0], **_epochs(config)))
        algorithm.stop()
    count = rows * length
    per_step = {"environment": stepping, "a runner": sampling / count, "the learner": learning / count}
    for name, seconds in per_step.items():
        print(f"{name:12} {1e6 * seconds:8.1f} us a step")
    for runners in (1, 2, 4, 8):
        share = per_step["a runner"] / runners + per_step["the learner"]
        print(f"{runners} runners, each with a core of its own: at most {1 / share:,.0f} steps/s")


def _epochs(config: Any) -> dict[str, Any]:
    own = config.ppo
    batches = {"num_epochs": own.n_epochs, "minibatch_size": own.batch_size, "shuffle_batch_per_epoch": True}
    return batches | {"timesteps": {"num_env_steps_sampled_lifetime": 0}}


def _seconds(what: Callable[[], Any]) -> float:
    """Processor time, which other processes on the machine change little."""
    began = time.process_time()
    what()
    return time.process_time() - began


if __name__ == "__main__":
    commands.run(main)
