"""The swing-up: its reward ranks controllers, plans get there within the limits, and are followed when disturbed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.config import check_config
from agents.lqr import LQR
from spring_pendulum_env import equilibrium

pytest.importorskip("casadi")

from agents.baselines import Nothing
from agents.evaluation import FIRST_SEED
from agents.measures import Episodes, measures_of
from agents.model import step_function
from agents.optimal_control import unsaturated_level
from agents.rollout import roll_out, scenario_for
from agents.swing_up import SPARE, Plan, PlannedSwingUp, Progress
from agents.swing_up_plots import plot_swing_ups
from agents.swing_up_results import TRIAL, plan_finder, play
from agents.tracking import gains_along, slopes_of

ID = TRIAL.environment_id
SEEDS = [FIRST_SEED, FIRST_SEED + 1]


@pytest.fixture(scope="module")
def planner() -> PlannedSwingUp:
    return PlannedSwingUp(scenario_for(ID, {}), seconds=2.4)


@pytest.fixture(scope="module")
def played(planner: PlannedSwingUp) -> Episodes:
    return roll_out(planner, ID, {}, SEEDS)


@pytest.fixture(scope="module")
def plan(planner: PlannedSwingUp) -> Plan:
    found = planner.plan(gym.make(ID).reset(seed=FIRST_SEED)[0])
    assert found is not None
    return found


def test_plans_swing_up_and_the_reward_ranks_them_over_nothing(played: Episodes) -> None:
    compute = measures_of(ID).compute
    idle = compute(roll_out(Nothing(), ID, {}, SEEDS))
    up = compute(played)
    assert up["recovered"].tolist() == [1.0, 1.0]
    assert idle["recovered"].tolist() == [0.0, 0.0]
    assert (up["mean_reward"] > 2 * idle["mean_reward"]).all()
    rewards = played.rewards
    assert (rewards >= 0.0).all() and (rewards <= 1.0).all()
    assert (rewards[:, -1] > 0.95).all()


def test_lqr_alone_does_not_swing_up() -> None:
    episodes = roll_out(LQR({}, "inverted-inverted"), ID, {}, SEEDS)
    assert measures_of(ID).compute(episodes)["recovered"].tolist() == [0.0, 0.0]


def test_plans_keep_a_share_of_the_limits_and_end_where_lqr_holds(planner: PlannedSwingUp, plan: Plan) -> None:
    assert np.array_equal(plan.states[0], gym.make(ID).reset(seed=FIRST_SEED)[0])
    assert len(plan.states) == len(plan.forces) + 1 == len(plan.gains) + 1 == 121
    assert np.abs(plan.forces).max() <= (1 - SPARE) * 20.0 + 1e-6
    assert np.abs(plan.states[:, :3]).max() <= (1 - SPARE) * 2.0 + 1e-4
    off = plan.states[-1] - planner.lqr.equilibrium
    assert off @ planner.lqr.P @ off <= 1.1 * unsaturated_level(planner.lqr)


def test_a_pushed_pendulum_comes_back_to_its_plan(planner: PlannedSwingUp, plan: Plan) -> None:
    env = gym.make(ID)
    errors = {}
    for feedback in (True, False):
        state, memory = env.reset(seed=FIRST_SEED)[0], [Progress(plan, 0)]
        for k in range(len(plan.forces)):
            if k == 40:
                state = state + 0.1 * np.eye(18)[12]
                env.reset(options={"state": state})
            action, memory = planner.predict(state, memory)
            state, *_ = env.step(action if feedback else plan.forces[k] / 20.0)
        errors[feedback] = float(np.abs(state - plan.states[-1])[:9].max())
    assert errors[True] < 0.25 * errors[False]


def test_rows_have_their_own_plans_that_a_new_episode_forgets(
    planner: PlannedSwingUp, played: Episodes, plan: Plan
) -> None:
    starts = played.states[:, 0]
    together, memory = planner.predict(starts)
    assert np.allclose(together, played.forces[:, 0] / 20.0, atol=1e-12)
    assert np.array_equal(together[0], planner.predict(starts[0], [Progress(plan, 0)])[0])
    assert [row.step for row in memory] == [1, 1]
    again, memory = planner.predict(starts[::-1], memory, np.array([True, False]))
    assert np.array_equal(again[0], together[1])
    assert [row.step for row in memory] == [1, 2]


def test_a_start_without_a_plan_gets_no_force_and_is_counted(planner: PlannedSwingUp) -> None:
    hopeless = PlannedSwingUp(scenario_for(ID, {"max_force": 0.5}), seconds=0.4)
    action, memory = hopeless.predict(equilibrium({}, "hanging-hanging"))
    assert action.tolist() == [0.0, 0.0, 0.0]
    assert memory[0].plan is None
    assert (hopeless.solves, hopeless.failures) == (2, 1)
    with pytest.raises(ValueError, match="seconds"):
        PlannedSwingUp(planner.scenario, seconds=0.01)
    with pytest.raises(ValueError, match="spare"):
        PlannedSwingUp(planner.scenario, spare=1.0)


def test_gains_along_a_plan_that_rests_are_lqr_s() -> None:
    lqr = LQR({}, "inverted-inverted")
    rest = np.tile(lqr.equilibrium, (4, 1))
    slopes = slopes_of(step_function(lqr.parameters, lqr.control_period, 4))
    for gain in gains_along(lqr, slopes, rest, np.zeros((3, 3))):
        assert np.allclose(gain, lqr.K, rtol=1e-5, atol=1e-5)


def test_rows_are_saved_and_the_picture_is_drawn(planner: PlannedSwingUp, tmp_path: Path) -> None:
    row = plan_finder(planner)(0)
    assert row["recovered"] == 1.0 and row["failures"] == 0 and row["iterations"] > 0
    plot_swing_ups(play({"nothing": Nothing(), "LQR": LQR({}, "inverted-inverted")}), tmp_path / "up.png")
    assert (tmp_path / "up.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def training(**changes: Any) -> dict[str, Any]:
    data = {"task": "swing-up", "algorithm": "shac", "observation": {"scales": [0.5, 2.0]}}
    return data | {"training": {"environments": 64, **changes}}


def test_training_starts_along_saved_states(tmp_path: Path) -> None:
    from agents.differentiable import DifferentiableEnv

    path = tmp_path / "plans.npz"
    up = equilibrium({}, "inverted-inverted")
    np.savez(path, states=up[None])
    env = DifferentiableEnv(check_config(training(starts_along=str(path), starts_along_share=0.5)), seed=0)
    heights = env.states[:, 8].numpy()
    assert ((np.abs(heights - up[8]) < 0.3) | (np.abs(heights + 2.3) < 0.3)).all()
    assert 16 < (heights > 0).sum() < 48
    env.close()
    below = DifferentiableEnv(check_config(training(start_scales=[0.5, 2.0])), seed=0)
    assert (below.states[:, 8].numpy() < -1.9).all()
    below.close()
    np.savez(path, states=np.zeros((3, 12)))
    for wrong in (path, tmp_path / "none.npz"):
        with pytest.raises(ValueError, match="starts_along"):
            DifferentiableEnv(check_config(training(starts_along=str(wrong))), seed=0)
    with pytest.raises(ValueError, match="starts_along"):
        check_config({"task": "swing-up", "algorithm": "ppo", "training": {"starts_along": str(path)}})
