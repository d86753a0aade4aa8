"""`simulate` by the splitting: the bits of an environment, at any step, and errors that say what is wrong."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import spring_pendulum_env  # noqa: F401 (registers the ids)
from spring_pendulum_env import simulate

PASSIVE = "SpringPendulumPassive-v0"
SWING = np.array([0.1, 0.0, -1.25, 0.25, 0.05, -2.35, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0])
VIOLENT = np.array([0.26, 0.64, -1.08, 0.86, -0.12, -2.85, -1.55, -1.21, 0.62, -0.85, 0.2, 1.54])
THROUGH_ZERO = np.array([1e-3, 0.0, -1e-3, 0.0, 0.0, -2.3, 0.3, -0.1, 0.2, 0.0, 0.0, 0.0])
DRAG = {"R1": 0.2, "R2": 0.1}


@pytest.mark.parametrize("parameters", [{}, DRAG, {"k1": 5000.0}])
@pytest.mark.parametrize("start", [SWING, VIOLENT, THROUGH_ZERO])
def test_bits_are_those_of_an_environment(start: Any, parameters: dict[str, float]) -> None:
    """Near misses of zero length included, with finer steps and the adaptive scheme; the instants are exact numbers."""
    step = 2.0**-6 if "k1" not in parameters else 2.0**-8
    env = gym.make(PASSIVE, tolerance=None, control_period=step, parameters=parameters)
    expected = [env.reset(options={"state": start})[0]]
    for _ in range(200):
        expected.append(env.step(None)[0])
    run = simulate(parameters, start, step * np.arange(201), "splitting", step=step)
    assert run.states.tobytes() == np.array(expected).tobytes()


def test_bits_do_not_depend_on_how_many_steps_a_call_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calls are so short that they can be interrupted between; some steps here are left to the adaptive scheme."""
    whole = simulate(None, THROUGH_ZERO, [0.0, 2.0], "splitting").states
    monkeypatch.setattr("spring_pendulum_env.simulation.STEPS_AT_ONCE", 7)
    assert simulate(None, THROUGH_ZERO, [0.0, 2.0], "splitting").states.tobytes() == whole.tobytes()


def test_one_interval_has_the_bits_of_one_step() -> None:
    env = gym.make(PASSIVE, tolerance=None, control_period=0.02)
    env.reset(options={"state": VIOLENT})
    expected = env.step(None)[0]
    assert simulate(None, VIOLENT, [0.0, 0.02], "splitting").states[1].tobytes() == expected.tobytes()


def test_error_falls_with_the_sixth_power_of_the_step() -> None:
    exact = simulate(None, SWING, [0.0, 4.0], rtol=1e-13, atol=1e-13).states[-1]
    errors = [
        np.abs(simulate(None, SWING, [0.0, 4.0], "splitting", step=step).states[-1] - exact).max()
        for step in (0.08, 0.04)
    ]
    assert 40.0 < errors[0] / errors[1] < 110.0
    assert simulate(None, SWING, [0.0, 100.0], "splitting").energy_error < 1e-12


def test_any_instants_will_do() -> None:
    times = [1.0, 1.005, 1.3, 1.31, 4.0]
    run = simulate(DRAG, VIOLENT, times, "splitting")
    exact = simulate(DRAG, VIOLENT, times, rtol=1e-13, atol=1e-13)
    assert np.abs(run.states - exact.states).max() < 1e-7
    np.testing.assert_array_equal(run.times, times)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"method": "splitting", "step": 0.0}, "step = 0.0"),
        ({"method": "splitting", "step": "short"}, "step = 'short'"),
        ({"method": "splitting", "step": np.nan}, "step = nan"),
        ({"method": "splitting", "rtol": 1e-9}, "rtol = 1e-09"),
        ({"method": "splitting", "atol": 1e-9}, "atol = 1e-09"),
        ({"method": "RK45", "step": 0.01}, "step = 0.01"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        simulate(None, SWING, [0.0, 1.0], **arguments)


def test_motion_that_overflows_is_an_error() -> None:
    with pytest.raises(ArithmeticError, match="splitting"):
        simulate({"k1": 0.0, "k2": 0.0, "g": 1e300}, SWING, [0.0, 1e3], "splitting")
