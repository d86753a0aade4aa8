"""Gradients through the motion, and the training that follows them."""

from __future__ import annotations

import copy
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch

import agents
import spring_pendulum_env
from agents import runs
from agents.adjoint import backward, forward, schedule
from agents.config import Config, default_path, read_config
from agents.files import read_csv
from agents.lqr import LQR
from agents.networks import limited
from spring_pendulum_env import Parameters
from spring_pendulum_env.layout import steps_in

TINY = [
    "training.steps=1024",
    "training.environments=8",
    "training.checkpoint_every=256",
    "network.layers=[8, 8]",
    "shac.horizon=16",
    "shac.batch_size=64",
]
STABILISATION = "stabilisation"


def tiny_config(*changes: str, task: str = STABILISATION, equilibrium: str | None = "inverted-inverted") -> Config:
    return read_config(default_path(task, "shac", equilibrium), [*TINY, *changes])


# The step and its adjoint

MODELS = {
    "default": ({}, "xyz", 0.02),
    "drag": ({"R0": 0.4, "R1": 0.3, "R2": 0.2}, "xyz", 0.02),
    "a held axis, stiff springs, long period": ({"m1": 0.3, "k1": 900.0, "k2": 400.0}, "xz", 0.05),
}


@pytest.mark.parametrize("name", MODELS)
def test_step_is_the_environments_and_its_adjoint_is_its_derivative(name: str) -> None:
    parameters, axes, period = MODELS[name]
    p = Parameters.of(parameters)
    rng = np.random.default_rng(1)
    n = 70  # more than a block of them, and not two whole ones
    rest = spring_pendulum_env.equilibrium(p, "inverted-hanging")
    states = rest + 0.1 * rng.standard_normal((n, 18))
    states[:, [9 + i for i, axis in enumerate("xyz") if axis not in axes]] = 0.0
    kept = [i for i, axis in enumerate("xyz") if axis in axes]
    forces = np.zeros((n, 3))
    forces[:, kept] = rng.uniform(-20.0, 20.0, (n, len(kept)))
    constants = np.tile(p.constants(axes), (n, 1))
    steps = steps_in(period, p.constants(axes))
    table = schedule(period, steps, np.tile(p.drag_rates(), (n, 1)))

    def step(at: np.ndarray, under: np.ndarray) -> np.ndarray:
        new = np.empty_like(at)
        forward(at, under, constants, table, steps, new)
        return new

    env = gym.make_vec(
        "SpringPendulumStabilisation-v0",
        num_envs=n,
        parameters=parameters,
        actuated_axes=axes,
        control_period=period,
        equilibrium="inverted-hanging",
    )
    env.reset(seed=0, options={"state": states})
    there = env.step(forces[:, kept] / 20.0)[0]
    env.close()
    assert np.abs(step(states, forces) - there).max() < 1e-13

    gradients = rng.standard_normal((n, 18))
    by_states, by_forces = np.empty((n, 18)), np.empty((n, 3))
    backward(states, forces, constants, table, steps, gradients, by_states, by_forces)
    along, push = rng.standard_normal((n, 18)), rng.standard_normal((n, 3))
    size = 1e-5
    change = (step(states + size * along, forces + size * push) - step(states - size * along, forces - size * push)) / (
        2 * size
    )
    expected = (gradients * change).sum(axis=1)
    assert np.allclose((by_states * along).sum(axis=1) + (by_forces * push).sum(axis=1), expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    ("task", "changes"),
    [
        (STABILISATION, []),
        ("damping", []),
        (STABILISATION, ["environment.randomise={m2: [0.5, 1.5], L1: [0.9, 1.1]}"]),
        (STABILISATION, ["environment.actuated_axes=xz", "environment.parameters={R1: 0.2}"]),
    ],
)
def test_return_and_its_gradient_are_those_of_the_environment(task: str, changes: list[str]) -> None:
    from agents.differentiable import DifferentiableEnv

    config = tiny_config(*changes, task=task, equilibrium=None if task == "damping" else "inverted-inverted")
    axes = len(config.environment.actuated_axes or "xyz")
    rng = np.random.default_rng(2)
    first = rng.uniform(-0.8, 0.8, (12, 8, axes))
    aim = rng.standard_normal(first.shape)

    def play(actions: np.ndarray) -> tuple[torch.Tensor, list[np.ndarray], torch.Tensor]:
        env = DifferentiableEnv(config, seed=3)
        env.limits[:] = 100
        env.limits[2] = 5  # this row begins anew in between, and its return has nothing to do with what comes after
        forces = torch.tensor(actions, requires_grad=True)
        transitions = [env.step(force) for force in forces]
        rewards = env.rewards(transitions)
        env.close()
        return rewards, [transition.paid for transition in transitions], forces

    rewards, paid, forces = play(first)
    assert np.allclose(rewards.detach().numpy(), np.array(paid), rtol=0, atol=1e-13)
    rewards.sum().backward()
    assert forces.grad is not None
    size = 1e-5
    up, down = (play(first + sign * size * aim)[0].sum().item() for sign in (1, -1))
    assert (forces.grad.numpy() * aim).sum() == pytest.approx((up - down) / (2 * size), rel=1e-5)


def test_starts_have_the_spread_that_the_config_says() -> None:
    from agents.differentiable import DifferentiableEnv

    config = tiny_config("training.environments=400", "training.start_scales=[0.5, 0.5]")
    env = DifferentiableEnv(config, seed=0)
    away = env.states.numpy() - spring_pendulum_env.equilibrium(Parameters(), "inverted-inverted")
    env.close()
    assert not away[:, [0, 1, 2, 9, 10, 11]].any()
    assert away[:, 3:9].std() == pytest.approx(0.5 * 0.05, rel=0.05)
    assert away[:, 12:].std() == pytest.approx(0.5 * 0.05, rel=0.05)


def test_episodes_are_cut_off_where_the_config_says() -> None:
    from agents.differentiable import DifferentiableEnv

    config = tiny_config("training.episode_steps=7", "training.environments=50", equilibrium="hanging-hanging")
    env = DifferentiableEnv(config, seed=0)
    cut = np.array([env.step(torch.zeros(50, 3, dtype=torch.float64)).truncated for _ in range(21)])
    env.close()
    assert np.array_equal(np.unique(cut[:7].argmax(axis=0)), np.arange(7))  # the first ones not all at once
    assert np.array_equal(cut.sum(axis=0), np.full(50, 3))


def test_limited_actions_can_come_back() -> None:
    values = torch.tensor([-2.0, -2.0, 0.5, 2.0, 2.0], requires_grad=True)
    result = limited(values)
    assert result.tolist() == [-1.0, -1.0, 0.5, 1.0, 1.0]
    # Descent goes against these: of those outside, the first and the last would be pushed further out.
    result.backward(torch.tensor([3.0, -3.0, 3.0, 3.0, -3.0]))
    assert values.grad is not None
    assert values.grad.tolist() == [0.0, -3.0, 3.0, 3.0, 0.0]


# Training


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, agents.policy.LearnedPolicy]:  # type: ignore[name-defined]
    from agents.training import train

    folder = tmp_path_factory.mktemp("runs") / "run"
    return folder, train(tiny_config(), folder, progress=False)


def test_run_folder_is_complete(finished) -> None:  # type: ignore[no-untyped-def]
    folder, _ = finished
    assert {path.name for path in folder.iterdir()} == {
        runs.CONFIG,
        runs.RECORD,
        runs.CURVE,
        runs.POLICY,
        runs.NORMALISATION,
    }
    assert runs.read_run_config(folder) == tiny_config()
    record = runs.read_record(folder)
    assert record["finished"]
    assert (record["algorithm"], record["seed"], record["steps"]) == ("shac", 0, 1024)
    curve = read_csv(folder / runs.CURVE)
    assert [int(row["steps"]) for row in curve] == list(range(128, 1025, 128))
    assert all(float(row["gradient"]) > 0 and float(row["value_loss"]) > 0 for row in curve)


def test_loaded_policy_acts_as_the_trained_one(finished) -> None:  # type: ignore[no-untyped-def]
    folder, trained = finished
    loaded = agents.load(folder)
    states = trained.reference + 0.05 * np.random.default_rng(0).standard_normal((30, 18))
    actions, memory = loaded.predict(states)
    assert memory is None
    assert actions.shape == (30, 3)
    assert actions.dtype == np.float64
    assert np.array_equal(actions, trained.predict(states)[0])
    assert np.array_equal(loaded.predict(states[4])[0].shape, (3,))
    assert np.abs(actions).max() <= 1.0


def test_what_training_begins_with_is_lqr() -> None:
    from agents.residual import ResidualPolicy, make_residual_network

    config = tiny_config()
    assert config.guide is not None
    network, reference = make_residual_network(config)
    with torch.no_grad():
        for parameter in network.body.parameters():
            parameter.zero_()
    policy = ResidualPolicy(config, network, reference, np.zeros(18), np.ones(18))
    lqr = LQR(
        {},
        "inverted-inverted",
        state_weights=config.guide.state_weights,
        effort_weight=config.guide.effort_weight,
    )
    states = reference + 0.05 * np.random.default_rng(0).standard_normal((30, 18))
    expected = lqr.predict(states)[0]
    assert (np.abs(expected) < 1).any()
    assert np.allclose(policy.predict(states)[0], expected, atol=1e-5)  # the network is float32
    # What it sees of LQR's cost is a distance: its square is the cost, but for one factor.
    with torch.no_grad():
        seen = network.seen(torch.from_numpy(states - reference)).numpy()[:, 18:]
    cost = np.einsum("ni,ij,nj->n", states - reference, lqr.P, states - reference)
    assert np.ptp((seen**2).sum(axis=1) / cost) < 1e-4 * ((seen**2).sum(axis=1) / cost).mean()


def test_restored_learner_is_the_one_that_was_saved() -> None:
    from agents.differentiable import DifferentiableEnv
    from agents.residual import make_residual_network
    from agents.shac import SHAC

    config = tiny_config()
    learners = [SHAC(config, DifferentiableEnv(config, 0), *make_residual_network(config)) for _ in range(2)]
    learners[0].round(0.0)
    learners[1].restore(copy.deepcopy(learners[0].state()))
    assert learners[1].actor_optimiser.state_dict()["state"][0]["exp_avg"].any()
    for there, here in zip(learners[0].policy.parameters(), learners[1].policy.parameters(), strict=True):
        assert torch.equal(there, here)
    # From the same states on, both learn the same.
    for learner in learners:
        learner.env = DifferentiableEnv(config, 5)
    random = torch.get_rng_state()
    results = []
    for learner in learners:
        torch.set_rng_state(random)
        results.append(learner.round(0.5)[1])
    assert results[0] == results[1]


def test_it_learns_by_the_gradient_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without LQR to begin with and without a value, windows as long as the episodes are enough to calm a swing."""
    from agents.differentiable import DifferentiableEnv
    from agents.residual import make_residual_network
    from agents.shac import SHAC

    config = tiny_config(
        "guide=null",
        "shac.horizon=50",
        "training.episode_steps=50",
        "network.layers=[32, 32]",
        equilibrium="hanging-hanging",
    )
    torch.manual_seed(0)
    learner = SHAC(config, DifferentiableEnv(config, 0), *make_residual_network(config))
    monkeypatch.setattr(learner, "_improve_value", lambda _window: 0.0)
    with torch.no_grad():
        for parameter in learner.value.parameters():
            parameter.zero_()

    def mean_reward() -> float:
        env = DifferentiableEnv(config, 99)  # other starts
        env.limits[:] = 50
        with torch.no_grad():
            paid = [env.step(learner.policy(env.states - learner.reference)).paid for _ in range(50)]
        env.close()
        return float(np.mean(paid[25:]))

    before = mean_reward()
    for _ in range(40):
        learner.round(0.0)
    assert mean_reward() > before + 0.05


@pytest.mark.parametrize(
    ("algorithm", "change", "words"),
    [
        ("shac", "observation.scales=null", ["observation.scales is missing", "shac"]),
        ("shac", "training.start_scales=[2, 1]", ["training.start_scales", "(2.0, 1.0)", "first"]),
        ("shac", "guide={state_weights: [1, 1, 1, 1, 1, 0], effort_weight: 1}", ["guide.state_weights.5", "greater"]),
        ("shac", "guide={colour: red}", ["guide.colour", "allowed", "effort_weight"]),
        ("shac", "shac.horizons=3", ["shac.horizons", "allowed", "horizon"]),
        ("ppo", "training.episode_steps=100", ["training.episode_steps", "only shac"]),
        ("ppo", "training.start_scales=[0.1, 1]", ["training.start_scales", "only shac"]),
        ("ppo", "guide={state_weights: [1, 1, 1, 1, 1, 1], effort_weight: 1}", ["guide", "only shac"]),
    ],
)
def test_settings_that_do_not_fit_are_refused(algorithm: str, change: str, words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        read_config(default_path(STABILISATION, algorithm, "inverted-inverted"), [change])
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
