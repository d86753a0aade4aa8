"""The tasks' numbers and the reward's formulas, without an environment."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from spring_pendulum_env.tasks import REWARD_TERMS, TASKS, Task, displaced, reward_terms, task_named

SCALES = (2.0, 0.3, 4.0, 5.0)  # of energy (J), posture (m), velocity (m/s) and centring (m)

USUAL: dict[str, Any] = {
    "actuated": True,
    "max_episode_steps": 500,
    "equilibrium": "hanging-hanging",
    "chooses_equilibrium": False,
    "start_equilibrium": None,
    "tolerance": None,
    "weights": {},
    "energy_scale": 1.0,
    "posture_scale": 0.3,
    "velocity_scale": 1.0,
    "centring_scale": 1.0,
    "largest_deviation": math.inf,
}
WIDE = {"start_displacement": 0.4, "start_velocity": 1.0}
NARROW = {"start_displacement": 0.05, "start_velocity": 0.05}
CONTRACT: dict[str, dict[str, Any]] = {
    "SpringPendulumPassive-v0": {
        "name": "passive",
        "actuated": False,
        "max_episode_steps": 1000,
        "tolerance": 1e-13,
        **WIDE,
    },
    "SpringPendulumDamping-v0": {
        "name": "damping",
        "weights": {"energy": 0.8, "centring": 0.15, "effort": 0.05},
        **WIDE,
    },
    "SpringPendulumStabilisation-v0": {
        "name": "stabilisation",
        "equilibrium": "inverted-inverted",
        "chooses_equilibrium": True,
        "weights": {"posture": 0.6, "stillness": 0.15, "centring": 0.2, "effort": 0.05},
        "largest_deviation": 1.5,
        **NARROW,
    },
    "SpringPendulumSwingUp-v0": {
        "name": "swing-up",
        "equilibrium": "inverted-inverted",
        "start_equilibrium": "hanging-hanging",
        "weights": {"energy": 0.3, "posture": 0.5, "centring": 0.15, "effort": 0.05},
        "energy_scale": 10.0,
        "posture_scale": 0.5,
        **NARROW,
    },
}


def test_ids_and_records_are_the_contract() -> None:
    assert {name: dataclasses.asdict(task) for name, task in TASKS.items()} == {
        name: USUAL | changes for name, changes in CONTRACT.items()
    }


def test_a_new_task_has_the_usual_scales_and_no_weights() -> None:
    task = Task("new", True, 500, "hanging-hanging", False, tolerance=None, **WIDE)
    assert dataclasses.asdict(task) == USUAL | {"name": "new", **WIDE}
    assert task.terms == ()
    with pytest.raises(dataclasses.FrozenInstanceError):
        task.name = "old"  # type: ignore[misc]


def test_terms_are_those_with_a_weight_in_their_order() -> None:
    weights = {"effort": 0.5, "energy": 0.4, "posture": 0.0, "stillness": 0.1}
    task = dataclasses.replace(TASKS["SpringPendulumDamping-v0"], weights=weights)
    assert task.terms == ("energy", "stillness", "effort")
    assert REWARD_TERMS == ("energy", "posture", "stillness", "centring", "effort")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_term_is_one_at_its_best_and_a_half_at_its_scale(sign: float) -> None:
    energy, posture, velocity, centring = SCALES
    assert reward_terms(0.0, 0.0, 0.0, 0.0, 0.0, *SCALES) == (1.0, 1.0, 1.0, 1.0, 1.0)
    at_scales = reward_terms(sign * energy, posture**2, velocity**2, centring**2, 0.5, *SCALES)
    assert at_scales == pytest.approx((0.5, 0.5, 0.5, 0.5, 0.5), rel=1e-15)


def test_terms_are_the_manual_s_formulas() -> None:
    rng = np.random.default_rng(0)
    for E, e, v, q0, effort in rng.uniform(0.0, 10.0, (50, 5)) * [-1.0, 1.0, 1.0, 1.0, 0.1]:
        expected = (
            1 / (1 + abs(E) / SCALES[0]),
            1 / (1 + (e / SCALES[1]) ** 2),
            1 / (1 + (v / SCALES[2]) ** 2),
            1 / (1 + (q0 / SCALES[3]) ** 2),
            1 - effort,
        )
        terms = reward_terms(E, e**2, v**2, q0**2, effort, *SCALES)
        assert terms == pytest.approx(expected, rel=1e-13)
        assert min(terms) >= 0.0
        assert max(terms) <= 1.0


def test_each_term_depends_on_its_own_argument_alone() -> None:
    before = reward_terms(1.0, 1.0, 1.0, 1.0, 0.1, *SCALES)
    for number in range(5):
        arguments = [1.0, 1.0, 1.0, 1.0, 0.1]
        arguments[number] += 0.5
        changed = reward_terms(*arguments, *SCALES)
        assert [a != b for a, b in zip(before, changed, strict=True)] == [place == number for place in range(5)]


def test_displaced_is_rest_and_noise_in_units_of_the_spread() -> None:
    assert displaced(2.0, 0.5, -3.0) == 0.5
    assert displaced(2.0, 0.5, 0.0) == displaced(2.0, 0.0, 7.0) == 2.0


def test_task_named() -> None:
    for task in TASKS.values():
        assert task_named("".join(list(task.name))) is task  # another object of the same letters
    with pytest.raises(ValueError) as caught:
        task_named("juggling")
    assert str(caught.value) == "task = 'juggling': must be one of passive, damping, stabilisation, swing-up"
