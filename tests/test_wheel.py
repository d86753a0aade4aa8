"""The wheel holds spring_pendulum_env alone and works with the core dependencies only."""

from __future__ import annotations

import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

SMOKE = """
import importlib.util
import gymnasium as gym
import numpy as np
import spring_pendulum_env as package
from spring_pendulum_env import regression

for absent in ("torch", "stable_baselines3", "pygame", "matplotlib", "yaml"):
    assert importlib.util.find_spec(absent) is None, absent
assert "site-packages" in package.__file__
for task in ("Passive", "Damping", "Stabilisation", "SwingUp"):
    name = f"SpringPendulum{task}-v0"
    env = gym.make(name)
    first, _ = env.reset(seed=0)
    for _ in range(10):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert np.isfinite(observation).all() and info["energy_error"] < 1e-6 and observation.shape == first.shape
    env.close()
run = package.simulate({}, [0.1, 0, -1.2, 0, 0, -2.3] + [0] * 6, [0, 1])
assert run.energy_error < 1e-11
a, b = package.linearise({}, "inverted-inverted")
assert a.shape == (18, 18) and b.shape == (18, 3)
try:
    gym.make("SpringPendulumPassive-v0", render_mode="rgb_array").reset(seed=0)
    env = gym.make("SpringPendulumPassive-v0", render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
except gym.error.DependencyNotInstalled as error:
    assert "spring-pendulum-env[render]" in str(error), error
else:
    raise AssertionError("rendering without pygame raised nothing")
assert regression.main(["--case", "regular", "--case", "pushed"]) == 0
print("smoke test passed")
"""


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT, cwd=ROOT)
    (built,) = folder.glob("*.whl")
    return built


def test_wheel_holds_the_package_alone(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0].split("-")[0] for name in names} == {"spring_pendulum_env"}
    assert {"spring_pendulum_env/py.typed", "spring_pendulum_env/data/regression_cases.json"} <= set(names)
    assert not [name for name in names if "__pycache__" in name or name.endswith((".nbi", ".nbc"))]


def test_wheel_works_with_the_core_dependencies_alone(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=True)
    folder = "Scripts" if sys.platform == "win32" else "bin"
    python = tmp_path / "venv" / folder / "python"
    run(python, "-m", "pip", "install", "--quiet", "--constraint", ROOT / "constraints.txt", wheel, cwd=tmp_path)
    assert "smoke test passed" in run(python, "-c", SMOKE, cwd=tmp_path)
