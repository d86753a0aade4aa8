"""The compiled sources in plain Python, without numba: the same motions, and lines that a debugger and coverage see."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parent.parent

EPISODES = """
import json
import gymnasium as gym
import numpy as np
import spring_pendulum_env

DRAG = {"R0": 0.2, "R1": 0.3, "R2": 0.1}
seen = {}
for name, task in spring_pendulum_env.TASKS.items():
    size = 18 if task.actuated else 12
    close = np.zeros(size)  # a spring that passes zero length: the guard, and then the adaptive scheme
    close[size // 2 - 4], close[size // 2 - 1] = -1.2, -2.3
    close[size // 2 - 6 : size // 2 - 3] = [1e-3, 0.0, -1e-3]
    for tolerance in (None, 1e-5):
        kwargs = {"tolerance": tolerance, "parameters": DRAG, "max_episode_steps": 2}
        env = gym.make(name, **kwargs)
        action = np.full(env.action_space.shape, 0.3)
        numbers = [*env.reset(seed=0)[0]]
        for _ in range(2):
            observation, reward, terminated, truncated, info = env.step(action)
            numbers += [*observation, reward, info["energy"], info["energy_error"], info["work"], info["dissipated"]]
            assert type(reward) is float and type(terminated) is bool
        env.reset(options={"state": close})
        numbers += [*env.step(action)[0]]
        try:
            env.step(np.full((*action.shape, 1), np.nan))
        except ValueError:
            numbers.append(1.0)
        mode = "NEXT_STEP" if tolerance else "SAME_STEP"
        many = gym.make_vec(name, num_envs=3, autoreset_mode=mode, randomise={"k1": (60, 400)}, **kwargs)
        numbers += many.reset(seed=0)[0].ravel().tolist()
        for _ in range(3):
            observations, rewards, *_ = many.step(np.full((3, *action.shape), 0.3))
            numbers += [*observations.ravel(), *rewards]
        many.reset(options={"state": np.stack([many.reset(seed=1)[0][0], close, many.reset(seed=1)[0][2]])})
        numbers += [*many.step(np.full((3, *action.shape), 0.3))[0].ravel()]
        seen[f"{name} {tolerance}"] = [float(number) for number in numbers]
block = gym.make_vec("SpringPendulumDamping-v0", num_envs=65)  # a whole block, and rows that the compiled loop places
seen["block"] = [*map(float, block.reset(seed=1)[0].ravel()), *map(float, block.step(np.zeros((65, 3)))[0].ravel())]
alone = gym.make("SpringPendulumDamping-v0")  # without drag, whose step is one of its own
starts = [alone.reset(seed=1)[0], alone.reset(options={"state": close})[0]]
seen["alone"] = [*map(float, np.ravel([*starts, alone.step(np.full(3, 0.3))[0]]))]
print(json.dumps(seen))
"""


def episodes(**environment: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-W", "ignore::RuntimeWarning", "-c", EPISODES],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    seen: dict[str, Any] = json.loads(done.stdout)
    return seen


def test_plain_python_gives_the_motions_of_the_compiled_step() -> None:
    """But for the last bit of a root, which Python may round the other way."""
    plain, compiled = episodes(NUMBA_DISABLE_JIT="1"), episodes()
    assert plain.keys() == compiled.keys()
    for name, numbers in plain.items():
        np.testing.assert_allclose(numbers, compiled[name], rtol=1e-9, atol=1e-9, err_msg=name)
