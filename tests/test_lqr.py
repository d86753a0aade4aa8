"""LQR against the theory: its closed loop is stable, and what it costs is what the Riccati equation says."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import spring_pendulum_env
from agents.evaluation import evaluate
from agents.lqr import LQR, discretise
from spring_pendulum_env import Parameters

EQUILIBRIA = ("hanging-hanging", "hanging-inverted", "inverted-hanging", "inverted-inverted")
TASK = "SpringPendulumStabilisation-v0"


@pytest.mark.parametrize("name", EQUILIBRIA)
@pytest.mark.parametrize("axes", ["xyz", "xz", "x"])
def test_closed_loop_is_stable(name: str, axes: str) -> None:
    lqr = LQR(Parameters(), name, actuated_axes=axes)
    open_loop = np.abs(np.linalg.eigvals(lqr.transition)).max()
    closed_loop = np.abs(np.linalg.eigvals(lqr.transition - lqr.input_matrix @ lqr.K[:, lqr.steered])).max()
    assert closed_loop < 1 - 1e-4
    assert open_loop >= 1 - 1e-9  # else the line above would say nothing about the gain


@pytest.mark.parametrize("name", EQUILIBRIA)
@pytest.mark.parametrize("axes", ["xyz", "xz"])
def test_cost_in_the_environment_is_what_riccati_predicts(name: str, axes: str) -> None:
    """Near the equilibrium, where the model is linear, rolled out until next to nothing is left to come."""
    parameters = Parameters(m0=0.8, m2=1.3, k1=130.0, R1=0.1)
    lqr = LQR(parameters, name, actuated_axes=axes)
    moving = [i for i in range(18) if i % 3 in lqr.axes]
    start = lqr.equilibrium.copy()
    start[moving] += 1e-5 * np.random.default_rng(1).standard_normal(len(moving))

    env = gym.make(TASK, equilibrium=name, parameters=parameters, actuated_axes=axes, max_episode_steps=5000)
    observation, _ = env.reset(options={"state": start})
    predicted = (observation - lqr.equilibrium) @ lqr.P @ (observation - lqr.equilibrium)
    cost = 0.0
    for _ in range(5000):
        deviation = observation - lqr.equilibrium
        action, _ = lqr.predict(observation)
        force = action * lqr.max_force
        cost += deviation @ lqr.Q @ deviation + force @ lqr.R @ force
        observation = env.step(action)[0]
    deviation = observation - lqr.equilibrium
    to_come = deviation @ lqr.P @ deviation
    assert to_come < 1e-3 * predicted
    assert cost + to_come == pytest.approx(predicted, rel=1e-3)


def test_cost_to_come_solves_the_riccati_equation() -> None:
    lqr = LQR(Parameters(), "inverted-inverted")
    A, B, K, P = lqr.transition, lqr.input_matrix, lqr.K, lqr.P
    np.testing.assert_allclose(lqr.Q + A.T @ P @ A - A.T @ P @ B @ K, P, rtol=0, atol=1e-9 * np.abs(P).max())
    assert np.linalg.eigvalsh(P).min() > 0


def test_discretisation_is_exact() -> None:
    """A double integrator has a closed form; Euler would leave the position's response to the force at zero."""
    A, B = discretise(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [2.0]]), 0.1)
    np.testing.assert_allclose(A, [[1.0, 0.1], [0.0, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(B, [[0.01], [0.2]], rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "share"),
    [("hanging-hanging", 1.0), ("hanging-inverted", 0.85), ("inverted-hanging", 1.0), ("inverted-inverted", 0.4)],
)
def test_recovers_the_default_starts(name: str, share: float) -> None:
    lqr = LQR(Parameters(), name)
    (evaluation,) = evaluate({"LQR": lqr}, TASK, {"equilibrium": name}, 60)
    assert evaluation.values["recovered"].mean() >= share


def test_damps_violent_starts() -> None:
    lqr = LQR(Parameters(), "hanging-hanging")
    (evaluation,) = evaluate({"LQR": lqr}, "SpringPendulumDamping-v0", {}, 60)
    assert evaluation.values["settled"].mean() >= 0.95
    assert np.median(evaluation.values["settling_time"]) < 3.5


def test_stack_and_single_agree() -> None:
    lqr = LQR(Parameters(), "hanging-inverted")
    stack = lqr.equilibrium + 0.3 * np.random.default_rng(2).standard_normal((40, 18))
    actions, state = lqr.predict(stack, state="kept")
    assert state == "kept"
    assert actions.shape == (40, 3)
    assert actions.dtype == np.float64
    assert np.abs(actions).max() == 1.0  # some of these starts are far enough out to meet the limit
    for observation, action in zip(stack, actions, strict=True):
        assert lqr.predict(observation)[0] == pytest.approx(action, abs=1e-12)
    assert lqr.predict(lqr.equilibrium)[0] == pytest.approx(np.zeros(3))


def test_force_does_not_depend_on_the_limit_inside_it() -> None:
    """The action is normalised by max_force, the force is not."""
    small, large = (LQR(Parameters(), "hanging-hanging", max_force=limit) for limit in (20.0, 40.0))
    observation = small.equilibrium + 0.01
    assert 20.0 * small.predict(observation)[0] == pytest.approx(40.0 * large.predict(observation)[0])


def test_held_axes_are_left_alone() -> None:
    lqr = LQR(Parameters(), "inverted-inverted", actuated_axes="zx")
    assert lqr.axes == [0, 2]  # the environment sorts them too
    sideways = lqr.equilibrium.copy()
    sideways[[4, 7]] += 0.2
    assert lqr.predict(sideways)[0] == pytest.approx(np.zeros(2))
    for matrix in (lqr.P, lqr.K, lqr.Q):
        assert not matrix[:, [4, 7, 13, 16]].any()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"equilibrium_name": "sideways"}, ["sideways", "hanging-hanging"]),
        ({"parameters": Parameters(k1=10.0), "equilibrium_name": "inverted-inverted"}, ["inverted-inverted"]),
        ({"parameters": {"m3": 1.0}}, ["m3", "m0"]),
        ({"control_period": 0.0}, ["control_period", "0.0", "positive"]),
        ({"max_force": float("nan")}, ["max_force", "nan", "positive"]),
        ({"max_force": "20"}, ["max_force", "'20'", "positive"]),
        ({"actuated_axes": "xx"}, ["actuated_axes", "xx", "xyz"]),
        ({"actuated_axes": ""}, ["actuated_axes", "''", "xyz"]),
        ({"actuated_axes": "w"}, ["actuated_axes", "w", "xyz"]),
        ({"state_weights": (1.0,) * 5}, ["state_weights", "six positive"]),
        ({"state_weights": (1.0,) * 5 + (-1.0,)}, ["state_weights", "-1.0", "six positive"]),
        ({"effort_weight": 0}, ["effort_weight", "0", "positive"]),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], words: list[str]) -> None:
    all_arguments = {"parameters": Parameters(), "equilibrium_name": "hanging-hanging"} | arguments
    with pytest.raises(ValueError) as caught:
        LQR(**all_arguments)  # type: ignore[arg-type]
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("observation", [np.zeros(12), np.zeros((2, 3, 18)), np.full(18, np.nan)])
def test_wrong_observations_are_named(observation: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"observation .*(allowed)"):
        LQR(Parameters(), "hanging-hanging").predict(observation)


def test_linearises_the_model_that_is_simulated() -> None:
    """The discrete model is the environment's own step, to first order in the deviation."""
    lqr = LQR(Parameters(), "inverted-hanging")
    env = gym.make(TASK, equilibrium="inverted-hanging")
    deviation = 1e-6 * np.random.default_rng(3).standard_normal(18)
    action = 1e-6 * np.array([1.0, -2.0, 3.0])
    env.reset(options={"state": spring_pendulum_env.equilibrium(Parameters(), "inverted-hanging") + deviation})
    observation = env.step(action)[0]
    expected = lqr.transition @ deviation + lqr.input_matrix @ (20.0 * action)
    assert observation - lqr.equilibrium == pytest.approx(expected, rel=1e-4, abs=1e-11)
