"""The RL Baselines3 Zoo trains on our ids by its own command, with the hyperparameters in configs/zoo.

It needs a virtual environment of its own (`make zoo`, which runs this file in it); elsewhere its runs skip.
"""

from __future__ import annotations

import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from spring_pendulum_env.tasks import TASKS

yaml = pytest.importorskip("yaml")
stable_baselines3 = pytest.importorskip("stable_baselines3")
sb3_contrib = pytest.importorskip("sb3_contrib")

FOLDER = Path(__file__).parent.parent / "configs" / "zoo"
IDS = [name for name, task in TASKS.items() if task.actuated]
ALGORITHMS = {"ppo": stable_baselines3.PPO, "sac": stable_baselines3.SAC, "tqc": sb3_contrib.TQC}
OF_THE_ZOO = {"n_timesteps", "n_envs", "normalize"}  # what it doesn't hand on to the algorithm
STEPS = 200
SOONER = {"ppo": (), "sac": ("-params", "learning_starts:100"), "tqc": ("-params", "learning_starts:100")}


def settings(algorithm: str) -> dict[str, dict[str, Any]]:
    loaded: dict[str, dict[str, Any]] = yaml.safe_load((FOLDER / f"{algorithm}.yml").read_text(encoding="utf-8"))
    return loaded


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_each_actuated_id_has_settings_that_the_algorithm_knows(algorithm: str) -> None:
    known = OF_THE_ZOO | set(inspect.signature(ALGORITHMS[algorithm].__init__).parameters)
    entries = settings(algorithm)
    assert list(entries) == IDS
    for entry in entries.values():
        assert OF_THE_ZOO | {"policy"} <= set(entry) <= known


@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed: make zoo")
@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_short_run_of_its_own_command(algorithm: str, name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rl_zoo3.train", "--algo", algorithm, "--env", name]
    command += ["--gym-packages", "spring_pendulum_env", "--conf-file", str(FOLDER / f"{algorithm}.yml")]
    command += ["-n", str(STEPS), "-f", str(tmp_path), "--eval-freq", "-1", "--num-threads", "1", "--seed", "0"]
    done = subprocess.run([*command, *SOONER[algorithm]], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    folder = tmp_path / algorithm / f"{name}_1"
    model = ALGORITHMS[algorithm].load(folder / f"{name}.zip", device="cpu")
    assert model.num_timesteps >= STEPS
    assert model._n_updates > 0
    assert (folder / name / "vecnormalize.pkl").is_file()
