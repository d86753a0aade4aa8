"""The reference data beside this file, and runs of the environments through them."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

import spring_pendulum_env

FloatArray = NDArray[np.float64]
Case = dict[str, Any]

assert spring_pendulum_env.__version__  # the import registers the environments


@functools.cache
def load(name: str) -> Any:
    """The content of reference/NAME.json."""
    return json.loads((Path(__file__).parent / "reference" / f"{name}.json").read_text())


CASES: dict[str, Case] = {case["name"]: case for case in load("trajectories")["cases"]}
PASSIVE = [name for name, case in CASES.items() if case["mode"] == "passive"]
ACTUATED = [name for name, case in CASES.items() if case["mode"] == "actuated"]

VIOLENT = np.array(CASES["chaotic_a"]["initial_state"])
"""Both masses held out level with the anchor and let go: a chaotic motion of the default pendulum."""


def passive(state: ArrayLike, parameters: Any = None, period: float = 0.02, tolerance: Any = None) -> Any:
    """A passive environment at a state of 12 numbers."""
    env = gym.make(
        "SpringPendulumPassive-v0",
        parameters=parameters,
        control_period=period,
        tolerance=tolerance,
        disable_env_checker=True,
    ).unwrapped
    env.reset(options={"state": state})
    return env


def actuated(
    state: ArrayLike, parameters: Any = None, period: float = 0.02, tolerance: Any = None, **kwargs: Any
) -> Any:
    """An actuated environment at a state of 18 numbers; the anchor may travel as far as it likes."""
    env = gym.make(
        "SpringPendulumDamping-v0",
        parameters=parameters,
        control_period=period,
        tolerance=tolerance,
        anchor_travel=1e9,
        disable_env_checker=True,
        **kwargs,
    ).unwrapped
    env.reset(options={"state": state})
    return env


def steps(env: Any, count: int, actions: ArrayLike | None = None) -> tuple[FloatArray, dict[str, Any]]:
    """The observation and the info after `count` steps under these actions, or under no force."""
    still = np.zeros(env.action_space.shape)
    for k in range(count):
        observation, _, _, _, info = env.step(still if actions is None else np.asarray(actions)[k])
    return observation, info


def largest_period(times: list[float]) -> float:
    """The longest period of which all these times are multiples, s."""
    fractions = [Fraction(time).limit_denominator(1000) for time in times]
    denominator = math.lcm(*(fraction.denominator for fraction in fractions))
    return math.gcd(*(int(fraction * denominator) for fraction in fractions)) / denominator


def records(name: str, tolerance: Any) -> Iterator[tuple[int, FloatArray, dict[str, Any]]]:
    """Runs an environment through a reference case: the number of each record, our state there, our info."""
    case = CASES[name]
    if case["mode"] == "passive":
        period = largest_period(case["times"])
        counts = [round(time / period) for time in case["times"]]
        env = passive(case["initial_state"], case["params"], period, tolerance)
        forces = np.zeros((counts[-1], 0))
    else:
        counts = case["period_index"]
        axes = [number for number, moves in enumerate(case["actuated_axes"]) if moves]
        largest = float(np.abs(case["u"]).max()) or 1.0
        forces = np.array(case["u"])[:, axes] / largest
        env = actuated(
            case["initial_state"],
            case["params"],
            case["control_period"],
            tolerance,
            max_force=largest,
            actuated_axes="".join("xyz"[axis] for axis in axes),
        )
    done = 0
    for number, count in enumerate(counts):
        observation, info = steps(env, count - done, forces[done:count])
        done = count
        yield number, observation, info


def allowed_error(name: str, number: int) -> float:
    """How far from a record of a case double precision may lead, for each component of the state."""
    case = CASES[name]
    return 1e-12 + 2.2e-11 * max(case["growth"][number], 1.0) * (1.0 + float(np.abs(case["states"][number]).max()))
