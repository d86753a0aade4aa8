"""The cache of compiled code never serves stale code, and an unwritable one is done without."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "spring_pendulum_env"

FALL = """
import gymnasium as gym, numpy as np, spring_pendulum_env
env = gym.make("SpringPendulumPassive-v0", parameters={"k2": 0.0}, tolerance=None)
state = np.zeros(12)
state[2], state[5] = -1.0, -2.0
env.reset(options={"state": state})
print(spring_pendulum_env.__file__, env.step(None)[0][11])
"""


def speed_of_free_fall(folder: Path, **environment: str) -> float:
    """Speed of the second mass after one step of free fall, by the copy of the package in `folder`."""
    done = subprocess.run(
        [sys.executable, "-c", FALL],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    file, speed = done.stdout.split()
    assert Path(file).parent.parent == folder
    return float(speed)


def test_edit_of_a_formula_is_compiled_and_its_cache_replaces_the_old(tmp_path: Path) -> None:
    copy = tmp_path / "spring_pendulum_env"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {"NUMBA_CACHE_DIR": ""}
    assert abs(speed_of_free_fall(tmp_path, **environment) + 9.81 * 0.02) < 1e-12
    caches = list((copy / "__pycache__").glob("kernels-*"))
    assert len(caches) == 1
    assert list(caches[0].rglob("*.nbc"))

    physics = copy / "physics.py"
    text = physics.read_text()
    assert text.count("f2z * w2 - g,") == 1
    physics.write_text(text.replace("f2z * w2 - g,", "f2z * w2 - 2.0 * g,"))
    assert abs(speed_of_free_fall(tmp_path, **environment) + 2 * 9.81 * 0.02) < 1e-12
    replaced = list((copy / "__pycache__").glob("kernels-*"))
    assert len(replaced) == 1
    assert replaced != caches


def test_works_where_no_cache_can_be_written(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "spring_pendulum_env", ignore=shutil.ignore_patterns("__pycache__"))
    blocker = tmp_path / "file"
    blocker.write_text("a file where the cache folder should be")
    assert abs(speed_of_free_fall(tmp_path, NUMBA_CACHE_DIR=str(blocker)) + 9.81 * 0.02) < 1e-12
