"""Runs everything that is registered through the same tests: the contract of the environments."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import spring_pendulum_env
from spring_pendulum_env import EQUILIBRIA, Parameters, integrators
from spring_pendulum_env.tasks import REWARD_TERMS, TASKS

IDS = list(TASKS)
ACTUATED = [name for name, task in TASKS.items() if task.actuated]
PASSIVE = "SpringPendulumPassive-v0"
DAMPING = "SpringPendulumDamping-v0"
STABILISATION = "SpringPendulumStabilisation-v0"
SWING_UP = "SpringPendulumSwingUp-v0"
INFO = {"time", "energy", "excess_energy", "energy_error", "work", "dissipated", "parameters"}


@pytest.fixture(params=IDS)
def env(request: pytest.FixtureRequest) -> Iterator[gym.Env[Any, Any]]:
    made = gym.make(request.param)
    yield made
    made.close()


def run(env: gym.Env[Any, Any], steps: int, seed: int | None = 0, **reset: Any) -> np.ndarray:
    """Observations and rewards of an episode under random actions drawn with seed 7."""
    random = np.random.default_rng(7)
    observation, _ = env.reset(seed=seed, **reset)
    rows = [np.append(observation, 0.0)]
    for _ in range(steps):
        observation, reward, *_ = env.step(random.uniform(-1, 1, env.action_space.shape))
        rows.append(np.append(observation, reward))
    return np.array(rows)


def test_gymnasium_check_passes_without_warnings(env: gym.Env[Any, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Of an unbounded observation space the checker warns whoever makes it; positions have no bounds.
        warnings.filterwarnings("ignore", message=".*Box observation space (minimum|maximum) value is.*")
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", IDS)
def test_stable_baselines_check_passes_without_warnings(name: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gym.make(name))


@pytest.mark.parametrize("name", IDS)
def test_id_works_with_the_module_prefix(name: str) -> None:
    assert gym.make(f"spring_pendulum_env:{name}").spec is not None


def test_spaces_and_time_limit_are_the_contract(env: gym.Env[Any, Any]) -> None:
    assert env.spec is not None
    actuated = env.spec.id in ACTUATED
    assert env.observation_space == gym.spaces.Box(-np.inf, np.inf, (18 if actuated else 12,), np.float64)
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (3 if actuated else 0,), np.float32)
    assert env.spec.max_episode_steps == (500 if actuated else 1000)


def test_same_seed_same_bits_and_other_seed_other_start(env: gym.Env[Any, Any]) -> None:
    first, again, other = run(env, 20, seed=3), run(env, 20, seed=3), run(env, 20, seed=4)
    assert first.tobytes() == again.tobytes()
    assert not np.array_equal(first[0], other[0])


def test_reset_without_a_seed_goes_on_with_the_random_numbers(env: gym.Env[Any, Any]) -> None:
    starts = [env.reset(seed=1)[0], env.reset()[0], env.reset()[0], env.reset(seed=1)[0], env.reset()[0]]
    assert not np.array_equal(starts[0], starts[1])
    assert not np.array_equal(starts[1], starts[2])
    assert np.array_equal(starts[0], starts[3])
    assert np.array_equal(starts[1], starts[4])


def test_state_set_and_replayed_gives_the_same_bits(env: gym.Env[Any, Any]) -> None:
    whole = run(env, 30, options={"state": env.reset(seed=5)[0]})
    random = np.random.default_rng(7)
    actions = random.uniform(-1, 1, (30, *env.action_space.shape))  # type: ignore[misc]
    observation, _ = env.reset(options={"state": whole[15, :-1]})
    assert observation.tobytes() == whole[15, :-1].tobytes()
    for step in range(15, 30):
        observation, reward, *_ = env.step(actions[step])
        assert np.append(observation, reward).tobytes() == whole[step + 1].tobytes()


def test_spec_survives_json_with_all_arguments(env: gym.Env[Any, Any]) -> None:
    assert env.spec is not None
    kwargs: dict[str, Any] = {
        "parameters": Parameters(m2=2.0, R1=0.1),
        "control_period": 0.03,
        "tolerance": 1e-10,
        "randomise": {"k1": (90.0, 110.0)},
        "start_scale": 0.5,
        "render_mode": "rgb_array",
    }
    if env.spec.id in ACTUATED:
        kwargs |= {"max_force": 10.0, "anchor_travel": 1.0, "actuated_axes": "xz"}
    if env.spec.id == STABILISATION:
        kwargs |= {"equilibrium": "hanging-inverted"}
    made = gym.make(env.spec.id, **kwargs)
    assert made.spec is not None
    text = made.spec.to_json()
    assert json.loads(text)["kwargs"]["parameters"]["m2"] == 2.0
    again = gym.make(gym.envs.registration.EnvSpec.from_json(text))
    assert run(made, 20).tobytes() == run(again, 20).tobytes()


@pytest.mark.parametrize("name", Parameters.names())
def test_each_parameter_changes_the_motion(name: str) -> None:
    drag = {"R0": 0.3, "R1": 0.3, "R2": 0.3}
    base = gym.make(DAMPING, parameters=drag)
    changed = gym.make(DAMPING, parameters={**drag, name: 1.25 * getattr(Parameters(**drag), name)})
    state = {"state": base.reset(seed=2)[0]}
    difference = np.abs(run(base, 5, options=state)[-1, :18] - run(changed, 5, options=state)[-1, :18])
    assert difference.max() > 1e-6


def test_parameters_of_reset_hold_for_one_episode(env: gym.Env[Any, Any]) -> None:
    _, info = env.reset(seed=0, options={"parameters": {"k2": 150.0}})
    assert info["parameters"]["k2"] == 150.0
    assert env.step(np.zeros(env.action_space.shape))[4]["parameters"]["k2"] == 150.0  # type: ignore[arg-type]
    assert env.reset()[1]["parameters"]["k2"] == 100.0


def test_randomise_draws_within_its_range_at_each_reset() -> None:
    env = gym.make(DAMPING, randomise={"m1": (0.5, 2.0), "k1": (80.0, 120.0)})
    drawn = [env.reset(seed=0)[1]["parameters"]] + [env.reset()[1]["parameters"] for _ in range(50)]
    for name, low, high in (("m1", 0.5, 2.0), ("k1", 80.0, 120.0)):
        values = [parameters[name] for parameters in drawn]
        assert len(set(values)) == 51
        assert low <= min(values) < low + 0.2 * (high - low)
        assert high >= max(values) > high - 0.2 * (high - low)
    assert {parameters["m2"] for parameters in drawn} == {1.0}
    swapped = gym.make(DAMPING, randomise={"k1": (80.0, 120.0), "m1": (0.5, 2.0)})
    assert swapped.reset(seed=0)[1]["parameters"] == drawn[0]


@pytest.mark.parametrize("name", IDS)
def test_start_is_the_same_with_and_without_options(name: str) -> None:
    """The usual start is displaced by the compiled step, others are by NumPy."""
    compiled, other = gym.make(name), gym.make(name)
    for seed in range(50):
        np.testing.assert_array_equal(compiled.reset(seed=seed)[0], other.reset(seed=seed, options={})[0])
        np.testing.assert_array_equal(compiled.reset()[0], other.reset(options={})[0])


@pytest.mark.parametrize(
    ("name", "displacement", "velocity"),
    [(PASSIVE, 0.4, 1.0), (DAMPING, 0.4, 1.0), (STABILISATION, 0.05, 0.05), (SWING_UP, 0.05, 0.05)],
)
def test_start_is_spread_as_documented(name: str, displacement: float, velocity: float) -> None:
    env = gym.make(name)
    equilibrium = "inverted-inverted" if name == STABILISATION else "hanging-hanging"
    rest = spring_pendulum_env.equilibrium({}, equilibrium)
    starts = np.array([env.reset(seed=seed)[0] for seed in range(400)])
    if name in ACTUATED:
        assert (starts[:, [0, 1, 2, 9, 10, 11]] == 0).all()
        starts = np.delete(starts, [0, 1, 2, 9, 10, 11], axis=1)
    deviation = starts - np.r_[rest[3:9], np.zeros(6)]
    spread = np.r_[np.full(6, displacement), np.full(6, velocity)]
    # 400 draws: the mean is within 4 standard errors and the spread within 4 of its own.
    assert (np.abs(deviation.mean(axis=0)) < 4 * spread / 20).all()
    assert (np.abs(deviation.std(axis=0) / spread - 1) < 4 / np.sqrt(800)).all()


def test_start_scale_multiplies_the_spread() -> None:
    rest = spring_pendulum_env.equilibrium({}, "hanging-hanging")
    wide, narrow, none = (gym.make(DAMPING, start_scale=scale).reset(seed=0)[0] for scale in (2.0, 0.5, 0.0))
    assert np.allclose(wide - rest, 4 * (narrow - rest), atol=1e-14)
    assert np.array_equal(none, rest)


def test_step_reports_the_info_of_the_contract(env: gym.Env[Any, Any]) -> None:
    assert env.spec is not None
    env.reset(seed=0)
    _, reward, _, _, info = env.step(env.action_space.sample())
    assert set(info) >= INFO
    assert info["time"] == 0.02
    json.dumps(info["parameters"])
    if env.spec.id in ACTUATED:
        assert info["force"].shape == (3,)
        terms = {key: value for key, value in info.items() if key.startswith("reward_")}
        assert sum(terms.values()) == pytest.approx(reward, abs=1e-15)
        assert list(terms) == [f"reward_{term}" for term in REWARD_TERMS]
        used = {name.removeprefix("reward_") for name, value in terms.items() if value > 0.0}
        assert used == set(TASKS[env.spec.id].terms)


def test_energy_is_the_state_s(env: gym.Env[Any, Any]) -> None:
    observation, info = env.reset(seed=1)
    equilibrium = env.unwrapped.scenario.equilibrium  # type: ignore[attr-defined]
    rest = spring_pendulum_env.energy({}, spring_pendulum_env.equilibrium({}, equilibrium))
    for _ in range(20):
        assert info["energy"] == pytest.approx(spring_pendulum_env.energy({}, observation), abs=1e-12)
        assert info["excess_energy"] == pytest.approx(info["energy"] - rest, abs=1e-12)
        observation, *_, info = env.step(env.action_space.sample())


@pytest.mark.parametrize("name", ACTUATED)
def test_reward_is_in_range_and_falls_far_from_the_goal(name: str) -> None:
    env = gym.make(name)
    env.reset(options={"state": env.unwrapped.scenario.rest})  # type: ignore[attr-defined]
    best = env.step(np.zeros(3))[1]
    assert best == pytest.approx(1.0, abs=1e-6)
    rewards = run(gym.make(name, start_scale=3.0, anchor_travel=1e6), 300)[1:, -1]
    assert (rewards >= 0.0).all()
    assert (rewards <= 1.0).all()
    assert rewards.mean() < 0.5


def test_passive_reward_is_zero() -> None:
    assert (run(gym.make(PASSIVE), 20)[:, -1] == 0.0).all()


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_reward_weights_sum_to_one(task: Any) -> None:
    assert set(task.weights) <= set(REWARD_TERMS)
    if task.actuated:
        assert sum(task.weights.values()) == pytest.approx(1.0, abs=1e-15)


def test_anchor_beyond_its_travel_terminates() -> None:
    env = gym.make(DAMPING)
    env.reset(seed=0)
    for _ in range(500):
        observation, _, terminated, truncated, _ = env.step(np.array([1.0, 0.0, 0.0]))
        assert terminated == (np.abs(observation[:3]).max() > 2.0)
        if terminated:
            break
    assert terminated
    assert not truncated


def test_mass_far_from_its_place_terminates_stabilisation_only() -> None:
    state = spring_pendulum_env.equilibrium({}, "inverted-inverted")
    state[3] += 1.49
    for offset, expected in ((0.0, False), (0.05, True)):
        moved = state + offset * np.eye(18)[3]
        # A very short period, so that the masses are where they were put.
        short = gym.make(STABILISATION, control_period=1e-6)
        short.reset(options={"state": moved})
        assert short.step(np.zeros(3))[2] == expected
        damping = gym.make(DAMPING, control_period=1e-6)
        damping.reset(options={"state": moved})
        assert damping.step(np.zeros(3))[2] is False


@pytest.mark.parametrize("name", IDS)
def test_time_limit_truncates(name: str) -> None:
    env = gym.make(name, start_scale=0.0)
    env.reset(seed=0)
    limit = TASKS[name].max_episode_steps
    for step in range(limit):
        _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape))  # type: ignore[arg-type]
        assert not terminated
        assert truncated == (step == limit - 1)


@pytest.mark.parametrize("name", EQUILIBRIA)
def test_stabilisation_starts_at_each_equilibrium_and_stays(name: str) -> None:
    env = gym.make(STABILISATION, equilibrium=name, start_scale=0.0)
    start, info = env.reset(seed=0)
    assert np.array_equal(start, spring_pendulum_env.equilibrium({}, name))
    assert info["excess_energy"] == 0.0
    assert np.abs(env.step(np.zeros(3))[0] - start).max() < 1e-12


def test_swing_up_starts_hanging_and_wants_both_springs_inverted() -> None:
    parameters = {"m2": 1.5}
    hanging, inverted = (spring_pendulum_env.equilibrium(parameters, f"{way}-{way}") for way in ("hanging", "inverted"))
    env = gym.make(SWING_UP, parameters=parameters, start_scale=0.0)
    for start, info in (
        env.reset(seed=0),
        gym.make(SWING_UP, start_scale=0.0).reset(options={"parameters": parameters}),
    ):
        assert np.array_equal(start, hanging)
        missing = spring_pendulum_env.energy(parameters, hanging) - spring_pendulum_env.energy(parameters, inverted)
        assert info["excess_energy"] == pytest.approx(missing, abs=1e-12)
    below = env.step(np.zeros(3))[1]
    env.reset(options={"state": inverted})
    assert below < 0.3 < env.step(np.zeros(3))[1]
    assert env.unwrapped.scenario.start.tolist() == hanging.tolist()  # type: ignore[attr-defined]


def test_force_is_the_clipped_action_along_the_actuated_axes() -> None:
    env = gym.make(DAMPING, actuated_axes="zx", max_force=5.0, start_scale=0.0)
    assert env.action_space.shape == (2,)
    env.reset(seed=0)
    observation, *_, info = env.step(np.array([0.5, -3.0]))
    assert info["force"].tolist() == [2.5, 0.0, -5.0]
    assert observation[9] > 0.04
    assert observation[10] == observation[1] == 0.0
    assert observation[11] < -0.08


def test_float64_action_is_used_as_it_is() -> None:
    env = gym.make(DAMPING)
    env.reset(seed=0)
    action = np.array([0.1, 0.2, 0.3])
    assert env.step(action)[4]["force"].tolist() == (20.0 * action).tolist()
    rounded = action.astype(np.float32)
    assert (
        env.step(rounded)[4]["force"].tolist()
        == (20.0 * rounded.astype(np.float64)).tolist()
        != (20.0 * action).tolist()
    )
    assert env.step(action.tolist())[4]["force"].tolist() == (20.0 * action).tolist()


def test_observation_and_info_are_fresh_objects(env: gym.Env[Any, Any]) -> None:
    observation, info = env.reset(seed=0)
    kept, kept_parameters = observation.copy(), dict(info["parameters"])
    observation[:] = 1e9
    info["parameters"]["m1"] = 1e9
    again, *_, new = env.step(env.action_space.sample())
    assert np.abs(again - kept).max() < 1.0
    assert new["parameters"] == kept_parameters


def test_an_info_is_a_plain_dict_whatever_was_put_into_others(env: gym.Env[Any, Any]) -> None:
    """All infos share the names that Python keeps of them."""
    _, first = env.reset(seed=0)
    names = list(first)
    for number in range(40):
        *_, info = env.step(env.action_space.sample())
        assert type(info) is dict
        assert list(info) == names
        info[f"of a wrapper {number}"] = number
        del info["energy"]
    assert list(first) == names
    copied = pickle.loads(pickle.dumps(info))
    assert list(copied) == list(info) == [name for name in names if name != "energy"] + ["of a wrapper 39"]


def test_passive_and_all_axes_held_give_the_same_bits() -> None:
    for tolerance in (None, 1e-13):
        drag = {"R1": 0.2, "R2": 0.1}
        passive = gym.make(PASSIVE, tolerance=tolerance, parameters=drag)
        held = gym.make(DAMPING, tolerance=tolerance, parameters=drag, actuated_axes="")
        start, _ = passive.reset(seed=0)
        full = np.r_[np.zeros(3), start[:6], np.zeros(3), start[6:]]
        held.reset(options={"state": full})
        for _ in range(100):
            a, _, _, _, info_a = passive.step(None)
            b, _, _, _, info_b = held.step(np.zeros(0))
            assert a.tobytes() == np.r_[b[3:9], b[12:18]].tobytes()
            assert info_a["energy"] == info_b["energy"]
            assert info_a["dissipated"] == info_b["dissipated"]


def test_passive_without_a_spring_starts_about_the_unstretched_lengths() -> None:
    for missing in ("k1", "k2"):
        env = gym.make(PASSIVE, parameters={missing: 0.0, "L1": 2.0}, start_scale=0.0)
        observation, info = env.reset(seed=0)
        assert observation.tolist() == [0, 0, -2, 0, 0, -3] + [0] * 6
        assert info["excess_energy"] == 0.0


WRONG_ARGUMENTS = [
    (DAMPING, {"parameters": {"m1": 0.0}}, "m1"),
    (DAMPING, {"parameters": {"m1": float("nan")}}, "m1"),
    (DAMPING, {"parameters": {"k1": -1.0}}, "k1"),
    (DAMPING, {"parameters": {"L2": -1.0}}, "L2"),
    (DAMPING, {"parameters": {"R0": float("inf")}}, "R0"),
    (DAMPING, {"parameters": {"mass": 1.0}}, "mass"),
    (DAMPING, {"parameters": [1.0]}, "parameters"),
    (DAMPING, {"parameters": {"k1": 0.0}}, "k1"),
    (PASSIVE, {"control_period": 0.0}, "control_period"),
    (PASSIVE, {"control_period": "fast"}, "control_period"),
    (PASSIVE, {"control_period": 1e-309}, "control_period"),
    (PASSIVE, {"tolerance": 0.0}, "tolerance"),
    (PASSIVE, {"tolerance": 1e-16}, "tolerance"),
    (PASSIVE, {"tolerance": "tight"}, "tolerance"),
    (PASSIVE, {"randomise": {"k3": (1, 2)}}, "k3"),
    (PASSIVE, {"randomise": {"k1": (2, 1)}}, "k1"),
    (PASSIVE, {"randomise": {"k1": 5}}, "k1"),
    (PASSIVE, {"randomise": {"m1": (0.0, 1.0)}}, "m1"),
    (PASSIVE, {"randomise": "all"}, "randomise"),
    (PASSIVE, {"start_scale": -1.0}, "start_scale"),
    (PASSIVE, {"render_mode": "ascii"}, "render_mode"),
    (PASSIVE, {"max_force": 1.0}, "max_force"),
    (PASSIVE, {"actuated_axes": "x"}, "actuated_axes"),
    (PASSIVE, {"equilibrium": "hanging-hanging"}, "equilibrium"),
    (DAMPING, {"equilibrium": "hanging-hanging"}, "equilibrium"),
    (DAMPING, {"max_force": 0.0}, "max_force"),
    (DAMPING, {"max_force": 1e-200}, "max_force"),  # its square is zero, and the effort 0 / 0
    (DAMPING, {"max_force": 1e200}, "max_force"),
    (DAMPING, {"anchor_travel": -2.0}, "anchor_travel"),
    (DAMPING, {"actuated_axes": "xw"}, "actuated_axes"),
    (DAMPING, {"actuated_axes": "xx"}, "actuated_axes"),
    (DAMPING, {"actuated_axes": 3}, "actuated_axes"),
    (STABILISATION, {"equilibrium": "upright"}, "equilibrium"),
    (STABILISATION, {"equilibrium": np.zeros(2)}, "equilibrium"),
    (STABILISATION, {"parameters": {"k2": 5.0}}, "spring 2"),
    (STABILISATION, {"randomise": {"k2": (5.0, 100.0)}}, "spring 2"),
    # Too much work for one step, and numbers that leave the range.
    (DAMPING, {"control_period": 2000.0}, "control_period = 2000.0 .* 100000 steps"),
    (DAMPING, {"parameters": {"k1": 1e5, "m1": 1e-3}, "control_period": 10.0}, "control_period .* k1 = 100000.0"),
    (DAMPING, {"randomise": {"k1": (100.0, 1e13)}}, "control_period .* k1 = 10000000000000.0"),
    (DAMPING, {"parameters": {"k1": 1e308, "k2": 1e308, "m1": 1e-3}}, "k1 = 1e\\+308"),
    (PASSIVE, {"parameters": {"k1": 1e300, "k2": 1e300}}, "k1 = 1e\\+300"),
    (PASSIVE, {"parameters": {"g": 1e200}}, "parameters = .*g=1e\\+200"),
    (PASSIVE, {"parameters": {"R1": 1e308, "m1": 1e-3}}, "parameters = .*R1=1e\\+308"),
]


@pytest.mark.parametrize(("name", "kwargs", "named"), WRONG_ARGUMENTS)
def test_wrong_argument_is_named(name: str, kwargs: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        gym.make(name, **kwargs)


def test_work_of_a_step_has_a_ceiling_in_every_episode() -> None:
    env = gym.make(DAMPING, control_period=1000.0)  # as far as it goes with the usual springs
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"control_period .* k2 = 10000\.0"):
        env.reset(options={"parameters": {"k2": 1e4}})
    gym.make(DAMPING, control_period=1000.0, tolerance=1e-6).reset(options={"parameters": {"k2": 1e4}})
    manual = spring_pendulum_env.SpringPendulumEnv.__doc__ or ""
    assert f"more than {integrators.MOST_FIXED_STEPS:,} steps" in manual


WRONG_OPTIONS = [
    ({"state": np.zeros(5)}, "shape"),
    ({"state": ["0"] * 18}, "state"),
    ({"state": np.zeros(18, dtype=complex)}, "state"),
    ({"state": [10**400] * 18}, "state"),
    ({"state": np.full(18, np.nan)}, "finite"),
    ({"state": "rest"}, "state"),
    ({"states": np.zeros(18)}, "states"),
    ({"parameters": {"k9": 1.0}}, "k9"),
    ({"parameters": {"m1": -1.0}}, "m1"),
]


@pytest.mark.parametrize(("options", "named"), WRONG_OPTIONS)
def test_wrong_option_is_named_and_changes_nothing(options: dict[str, Any], named: str) -> None:
    env = gym.make(DAMPING)
    env.reset(seed=0)
    before = env.unwrapped.state.tobytes()  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=named):
        env.reset(options=options)
    assert env.unwrapped.state.tobytes() == before  # type: ignore[attr-defined]
    env.reset()
    env.step(np.zeros(3))


def test_held_axis_that_moves_is_refused() -> None:
    env = gym.make(DAMPING, actuated_axes="xy")
    with pytest.raises(ValueError, match="held along z"):
        env.reset(options={"state": 0.1 * np.eye(18)[11]})


WRONG_ACTIONS = [np.zeros(2), np.zeros((1, 3)), 0.5, None, "left", [np.nan, 0, 0], [np.inf, 0, 0]]
UNREAL_ACTIONS = [["1", "0", "0"], [1j, 0, 0], np.array([1j, 0, 0]), [10**400, 0, 0], np.array([10**400, 0, 0])]


@pytest.mark.parametrize("action", WRONG_ACTIONS + UNREAL_ACTIONS)
def test_wrong_action_is_refused_and_changes_nothing(action: Any) -> None:
    env = gym.make(DAMPING)
    reference = gym.make(DAMPING)
    env.reset(seed=0)
    reference.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(action)
    assert env.step(np.full(3, 0.3))[0].tobytes() == reference.step(np.full(3, 0.3))[0].tobytes()


@pytest.mark.parametrize("name", IDS)
def test_step_before_reset_is_refused(name: str) -> None:
    env = gym.make(name).unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(env.action_space.shape))  # type: ignore[arg-type]


def test_start_that_overflows_is_an_error() -> None:
    state = np.r_[np.ones(6), np.full(6, 1e200)]
    for env in (gym.make(PASSIVE), gym.make_vec(PASSIVE, num_envs=2)):
        with pytest.raises(FloatingPointError, match="range"):
            env.reset(options={"state": state})
        env.reset(seed=0)


@pytest.mark.parametrize(("tolerance", "said"), [(None, "range"), (1e-13, "1000000 steps")])
def test_motion_that_overflows_is_an_error(tolerance: float | None, said: str) -> None:
    env = gym.make(PASSIVE, tolerance=tolerance, parameters={"k1": 0.0, "k2": 0.0, "g": 1e300})
    env.reset(options={"state": np.r_[np.ones(6), np.zeros(6)]})
    with pytest.raises(FloatingPointError, match=said):
        env.step(None)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_with_the_same_bits_by_itself(env: gym.Env[Any, Any], copied: Any) -> None:
    run(env, 5)
    twin = copied(env)
    action = np.full(env.action_space.shape, 0.2)  # type: ignore[arg-type]
    first = env.step(action)[0].tobytes()
    env.step(action)
    assert twin.step(action)[0].tobytes() == first
    assert twin.reset()[0].tobytes() == env.reset()[0].tobytes()


def test_classes_are_public_and_imported_only_when_asked_for() -> None:
    assert issubclass(spring_pendulum_env.SpringPendulumEnv, gym.Env)
    assert issubclass(spring_pendulum_env.SpringPendulumVectorEnv, gym.vector.VectorEnv)
    with pytest.raises(AttributeError, match="SpringPendulum"):
        _ = spring_pendulum_env.SpringPendulum
    late = {"numba", "scipy.integrate", "pygame", "torch", "spring_pendulum_env.simulation"}
    code = f"import sys, spring_pendulum_env; print(*{late} & set(sys.modules))"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.strip() == ""
    assert set(spring_pendulum_env.__all__) <= set(dir(spring_pendulum_env))


def test_close_may_be_called_twice(env: gym.Env[Any, Any]) -> None:
    env.reset(seed=0)
    env.close()
    env.close()


@pytest.mark.parametrize("text", [np.array(["0.1", "0", "1"]), np.array([b"0.1", b"0", b"1"]), ["0.1", "0", "1"],
                                  np.array([0.1, 0.0, "1"], dtype=object), np.array(b"0.0"),
                                  np.array(["0000-12-31"] * 3, dtype="M8[s]")])  # fmt: skip
def test_text_is_no_action(text: Any) -> None:
    env = gym.make(DAMPING, disable_env_checker=True)
    env.reset(seed=0)
    before = env.unwrapped.state
    with pytest.raises(ValueError, match="action"):
        env.step(text)
    np.testing.assert_array_equal(env.unwrapped.state, before)


def test_step_after_a_reset_that_failed_asks_for_another() -> None:
    for env in (gym.make(DAMPING, start_scale=1e160), gym.make_vec(DAMPING, num_envs=2, start_scale=1e160)):
        with pytest.raises(FloatingPointError):
            env.reset(seed=0)
        with pytest.raises(gym.error.ResetNeeded):
            env.step(env.action_space.sample())


def test_huge_action_is_clipped() -> None:
    """Even if the sum of its numbers is beyond the range."""
    first, second = gym.make(DAMPING), gym.make(DAMPING)
    first.reset(seed=0)
    second.reset(seed=0)
    np.testing.assert_array_equal(first.step(np.full(3, 1.7e308))[0], second.step(np.ones(3))[0])


@pytest.mark.parametrize("name", IDS)
def test_an_environment_has_few_attributes(name: str) -> None:
    """CPython keeps the attributes of an object of at most thirty where it finds them fast."""
    env = gym.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    assert len(vars(env.unwrapped)) <= 30
