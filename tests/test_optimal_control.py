"""The CasADi model is the simulated one, the solvers agree, NMPC does its work, and rewards rank as they should."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import spring_pendulum_env
from agents import saved
from agents.evaluation import FIRST_SEED, TRIALS
from agents.lqr import LQR
from agents.measures import measures_of
from agents.model import energy, slope, step_function
from agents.nmpc import NMPC
from agents.optimal_control import Problem, Solver, unsaturated_level
from agents.rollout import roll_out
from spring_pendulum_env import Parameters, physics

casadi = pytest.importorskip("casadi")

STABILISATION = "SpringPendulumStabilisation-v0"
PARAMETERS = Parameters(m0=0.7, m1=1.2, k1=130.0, L2=0.9, R0=0.3, R1=0.1, R2=0.2)


def some_state(seed: int = 0) -> np.ndarray:
    state = spring_pendulum_env.equilibrium(PARAMETERS, "hanging-inverted")
    return np.asarray(state + 0.3 * np.random.default_rng(seed).standard_normal(18))


def test_the_model_is_the_physics() -> None:
    state, force = casadi.SX.sym("x", 18), casadi.SX.sym("u", 3)
    model = casadi.Function("model", [state, force], [slope(PARAMETERS, state, force, "xz"), energy(PARAMETERS, state)])
    for seed in range(3):
        at, u = some_state(seed), np.array([3.0, -2.0, 5.0])
        derivative, joule = model(at, u)
        expected = physics.derivatives(*at, *u, *PARAMETERS.constants("xz"), *PARAMETERS.drag_rates())
        assert np.array(derivative).ravel() == pytest.approx(np.array(expected), rel=1e-13, abs=1e-13)
        assert float(joule) == pytest.approx(float(spring_pendulum_env.energy(PARAMETERS, at)), rel=1e-13)


def test_the_linear_model_is_its_jacobian() -> None:
    state, force = casadi.SX.sym("x", 18), casadi.SX.sym("u", 3)
    right = slope(PARAMETERS, state, force)
    jacobians = casadi.Function("J", [state, force], [casadi.jacobian(right, state), casadi.jacobian(right, force)])
    rest = spring_pendulum_env.equilibrium(PARAMETERS, "inverted-hanging")
    for ours, theirs in zip(
        spring_pendulum_env.linearise(PARAMETERS, "inverted-hanging"), jacobians(rest, np.zeros(3)), strict=True
    ):
        assert ours == pytest.approx(np.array(theirs), abs=1e-10)


@pytest.mark.parametrize(("parts", "error"), [(1, 3e-3), (2, 2e-4), (8, 1e-6)])
def test_a_step_is_that_of_the_environment(parts: int, error: float) -> None:
    """To the error of Runge-Kutta 4, which falls with the fourth power."""
    env = gym.make(STABILISATION, equilibrium="hanging-inverted", parameters=PARAMETERS, control_period=0.04)
    env.reset(options={"state": some_state()})
    action = np.array([0.5, -1.0, 0.2])
    observation = env.step(action)[0]
    end = np.array(step_function(PARAMETERS, 0.04, parts)(some_state(), 20.0 * action)).ravel()
    assert np.abs(end - observation).max() < error
    assert np.abs(end - some_state()).max() > 0.1


@pytest.mark.parametrize("name", ["hanging-hanging", "inverted-inverted"])
def test_lqr_stays_within_its_force_inside_the_ellipsoid(name: str) -> None:
    """On its edge the largest force is the limit itself; and LQR recovers from there in the environment."""
    lqr = LQR({}, name)
    level = unsaturated_level(lqr)
    directions = np.random.default_rng(0).standard_normal((2000, 18))
    edge = directions * np.sqrt(level / np.einsum("ni,ij,nj->n", directions, lqr.P, directions))[:, None]
    assert np.abs(edge @ lqr.K.T).max() <= 20.0
    worst = np.linalg.solve(lqr.P, lqr.K[0])
    worst *= np.sqrt(level / (worst @ lqr.P @ worst))
    assert np.abs(lqr.K @ worst).max() == pytest.approx(20.0, rel=0.2)
    env = gym.make(STABILISATION, equilibrium=name)
    for off in edge[:5]:
        observation, _ = env.reset(options={"state": lqr.equilibrium + off})
        for _ in range(400):
            observation, _, terminated, _, _ = env.step(lqr.predict(observation)[0])
            assert not terminated
        assert np.abs(observation - lqr.equilibrium).max() < 0.05


def short_problem(lqr: LQR) -> Problem:
    off = lqr.equilibrium

    def stage(state, force):  # type: ignore[no-untyped-def]
        return 0.02 * (casadi.bilin(casadi.DM(lqr.Q), state - off, state - off) + 0.04 * casadi.sumsqr(force))

    def final(state):  # type: ignore[no-untyped-def]
        return 0.02 * casadi.bilin(casadi.DM(lqr.P), state - off, state - off)

    return Problem(lqr, 12, 0.04, 1, stage, final, anchor_travel=2.0, largest_deviation=1.5)


def test_both_solvers_find_the_same() -> None:
    lqr = LQR({}, "inverted-hanging")
    start = lqr.equilibrium + 0.1 * np.random.default_rng(4).standard_normal(18)
    solutions = []
    for solver in ("ipopt", "fatrop"):
        solution = Solver(short_problem(lqr), solver, {f"{solver}.tol": 1e-7}).solve(
            start, np.tile(start, (13, 1)), np.zeros((12, 3))
        )
        assert solution.success
        solutions.append(solution)
    one, two = solutions
    assert one.states == pytest.approx(two.states, abs=1e-4)
    assert one.forces == pytest.approx(two.forces, abs=1e-2)
    assert one.states[0] == pytest.approx(start)
    assert np.abs(one.forces).max() <= 20.0 + 1e-4
    step = step_function(lqr.parameters, 0.04, 1)
    for k in range(12):
        assert np.array(step(one.states[k], one.forces[k])).ravel() == pytest.approx(one.states[k + 1], abs=1e-6)
    with pytest.raises(ValueError, match=r"solver is 'magic'; allowed are ipopt, fatrop"):
        Solver(short_problem(lqr), "magic", {})


def test_nmpc_is_lqr_near_the_equilibrium_and_remembers_each_row() -> None:
    lqr = LQR({}, "inverted-inverted")
    nmpc = NMPC(lqr, intervals=15)
    near = lqr.equilibrium + 1e-3
    assert nmpc.predict(near)[0] == pytest.approx(lqr.predict(near)[0])
    assert nmpc.solves == 0
    far = lqr.equilibrium + np.r_[np.zeros(3), 0.12, np.zeros(2), 0.25, np.zeros(11)]
    actions, plans = nmpc.predict(np.stack([near, far]), None, np.ones(2, dtype=bool))
    assert nmpc.solves == 1
    assert plans[0] is None
    assert actions.shape == (2, 3)
    assert actions[0] == pytest.approx(lqr.predict(near)[0])
    assert np.abs(actions).max() <= 1.0
    again, plans = nmpc.predict(np.stack([near, far]), plans)
    assert nmpc.solves == 1  # a force is held for two control periods
    assert np.array_equal(again[1], actions[1])
    nmpc.predict(np.stack([near, far]), plans)
    assert nmpc.solves == 2
    assert nmpc.failures == 0
    with pytest.raises(ValueError, match=r"observation has shape \(12,\)"):
        nmpc.predict(np.zeros(12))
    with pytest.raises(ValueError, match="intervals is 0; allowed"):
        NMPC(lqr, intervals=0)


def test_a_failing_solver_is_counted_and_lqr_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    lqr = LQR({}, "inverted-inverted")
    nmpc = NMPC(lqr, intervals=5)
    solve = nmpc._first.solve
    monkeypatch.setattr(nmpc._first, "solve", lambda *a: solve(*a)._replace(success=False))
    far = lqr.equilibrium + np.r_[np.zeros(3), 0.3, np.zeros(2), 0.5, np.zeros(11)]
    actions, _ = nmpc.predict(far)
    assert nmpc.failures == nmpc.solves == 1
    assert actions == pytest.approx(lqr.predict(far)[0])


@pytest.mark.parametrize(
    "trial",
    ["damping", "hanging-hanging-0.1", "hanging-inverted-0.1", "inverted-hanging-0.3", "inverted-inverted-0.05"],
)
def test_rewards_rank_nmpc_over_lqr_over_nothing(trial: str) -> None:
    """By the mean over episodes of the saved NMPC runs, and of LQR and nothing on the same starts."""
    from agents.entries import find
    from agents.leaderboard import NMPC_FILE

    nmpc = saved.columns(NMPC_FILE, trial)
    assert nmpc is not None
    chosen = TRIALS[trial]
    seeds = [FIRST_SEED + int(start) for start in nmpc["start"]]
    means = [float(nmpc["mean_reward"].mean())]
    for name in ("lqr", "nothing"):
        (controller,) = find(name).controllers(chosen)
        episodes = roll_out(controller, chosen.environment_id, chosen.arguments, seeds)
        assert np.nanmin(episodes.rewards) >= 0.0
        assert np.nanmax(episodes.rewards) <= 1.0
        means.append(float(measures_of(chosen.environment_id).compute(episodes)["mean_reward"].mean()))
    assert means == sorted(means, reverse=True)


def test_results_are_saved_row_by_row(tmp_path: Path) -> None:
    path, told = tmp_path / "results.json", []

    def find(start: int) -> dict[str, float]:
        if start == 2 and len(told) == 2:
            raise KeyboardInterrupt
        return {"recovered": 1.0, "recovery_time": 0.123456 if start else np.inf}

    for _ in range(2):
        try:
            saved.fill(path, "a", range(4), find, {"what": "a test"}, lambda start, row: told.append((start, row)))
        except KeyboardInterrupt:
            told.append(("interrupted", {}))
    assert [start for start, _ in told] == [0, 1, "interrupted", 2, 3]
    columns = saved.columns(path, "a")
    assert columns is not None
    assert columns["start"].tolist() == [0, 1, 2, 3]
    assert columns["recovery_time"].tolist() == [np.inf, 0.12346, 0.12346, 0.12346]
    assert json.loads(path.read_text())["about"]["what"] == "a test"
    assert saved.columns(path, "b") is None
    with pytest.raises(ValueError, match="columns"):
        saved.add(path, "a", 9, {"other": 1.0}, {})


def test_the_optimum_recovers_what_lqr_cannot() -> None:
    """A plan within the limits, from the protocol's start 2, recovers it in the environment; LQR loses it."""
    from agents.optimum import INTERVALS, Optimum

    trial = TRIALS["inverted-inverted-0.1"]
    optimum = Optimum(trial)
    start, _ = gym.make(trial.environment_id, **trial.arguments).reset(seed=FIRST_SEED + 2)
    lqr = roll_out(LQR({}, "inverted-inverted"), trial.environment_id, trial.arguments, [FIRST_SEED + 2])
    assert lqr.ended_early[0]
    plan = optimum._solver.solve(start, *optimum._guesses(start)[0])
    assert plan.success
    assert np.abs(plan.forces).max() <= 20.0
    assert np.abs(plan.states[:, :3]).max() <= 2.0
    off = plan.states[INTERVALS] - optimum.lqr.equilibrium
    assert off @ optimum.lqr.P @ off <= 1.001 * unsaturated_level(optimum.lqr)
    assert optimum.recovers(start, plan)
    assert not optimum.recovers(start, plan._replace(forces=0.0 * plan.forces))
    outcome = optimum.find(start)
    assert outcome.solved
    assert outcome.recovered
