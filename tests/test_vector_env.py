"""The native vector environment gives the bits of single environments, in every mode."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import NormalizeObservation, NormalizeReward, RecordEpisodeStatistics

import spring_pendulum_env
from spring_pendulum_env.jit import DISABLED
from spring_pendulum_env.kernels import batch
from spring_pendulum_env.starts import MOST_AHEAD
from spring_pendulum_env.tasks import TASKS

IDS = list(TASKS)
DAMPING, PASSIVE = "SpringPendulumDamping-v0", "SpringPendulumPassive-v0"
WILD = {"randomise": {"k1": (60, 400), "R1": (0, 0.2)}, "start_scale": 2.0, "parameters": {"m1": 1.5}}


def arguments(name: str, **more: Any) -> dict[str, Any]:
    """Arguments under which rows end at different times, need different numbers of steps, and meet the guard."""
    stable = {"equilibrium": "hanging-hanging"} if "Stabilisation" in name else {}
    return {**WILD, **stable, **more}


def assert_same_bits(ours: Any, theirs: Any, path: str = "") -> None:
    """Equal types, shapes and bits, all the way down."""
    if isinstance(theirs, dict):
        assert set(ours) == set(theirs), path
        for key in theirs:
            assert_same_bits(ours[key], theirs[key], f"{path}/{key}")
    elif theirs.dtype == object:
        for one, other in zip(ours, theirs, strict=True):
            assert (one is None) == (other is None), path
            if other is not None:
                assert_same_bits(one, other, path)
    else:
        assert ours.dtype == theirs.dtype, path
        assert ours.shape == theirs.shape, path
        assert ours.tobytes() == theirs.tobytes(), path


def compare(ours: Any, theirs: Any, steps: int) -> int:
    """Steps both under the same actions and resets; returns how many episodes ended."""
    random = np.random.default_rng(0)
    for one, other in zip(ours.reset(seed=3), theirs.reset(seed=3), strict=True):
        assert_same_bits(one, other, "reset")
    ended = np.zeros(ours.num_envs, dtype=bool)
    episodes = 0
    for step in range(steps):
        if ours.metadata["autoreset_mode"] == AutoresetMode.DISABLED and ended.any():
            resets = [env.reset(options={"reset_mask": ended.copy()}) for env in (ours, theirs)]
            for one, other in zip(*resets, strict=True):
                assert_same_bits(one, other, f"masked reset before step {step}")
        actions = random.uniform(-1.2, 1.2, ours.action_space.shape)
        results = ours.step(actions), theirs.step(actions)
        for what, one, other in zip(("obs", "reward", "terminated", "truncated", "info"), *results, strict=True):
            assert_same_bits(one, other, f"{what} of step {step}")
        ended = results[0][2] | results[0][3]
        episodes += int(ended.sum())
    return episodes


@pytest.mark.parametrize("tolerance", [None, 1e-9])
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", IDS)
def test_rows_equal_single_environments_bit_for_bit(name: str, mode: AutoresetMode, tolerance: float | None) -> None:
    kwargs = arguments(name, tolerance=tolerance, max_episode_steps=40)
    ours = gym.make_vec(name, num_envs=7, autoreset_mode=mode, **kwargs)
    theirs = SyncVectorEnv([lambda: gym.make(name, **kwargs)] * 7, autoreset_mode=mode)
    assert compare(ours, theirs, 90) >= 14


def test_a_thousand_rows_equal_single_environments_with_one_thread_and_two() -> None:
    kwargs = arguments(DAMPING, max_episode_steps=25)
    one = gym.make_vec(DAMPING, num_envs=1000, **kwargs)
    two = gym.make_vec(DAMPING, num_envs=1000, threads=2, **kwargs)
    theirs = SyncVectorEnv([lambda: gym.make(DAMPING, **kwargs)] * 1000)
    assert compare(one, theirs, 30) >= 1000
    assert compare(two, one, 30) >= 1000
    two.close()


def test_guard_was_met_in_these_comparisons() -> None:
    """Else the comparisons above would not show that near misses keep the bits."""
    env: Any = gym.make_vec(DAMPING, num_envs=1000, **arguments(DAMPING))
    env.reset(seed=3)
    random = np.random.default_rng(0)
    states = []
    for _ in range(25):
        env.step(random.uniform(-1, 1, (1000, 3)))
        states.append(env.states)
    springs = np.array(states)[:, :, 3:9] - np.array(states)[:, :, 0:6]
    shortest = np.linalg.norm(springs.reshape(25, 1000, 2, 3), axis=3).min()
    assert shortest < 0.05


@pytest.mark.parametrize("mode", AutoresetMode)
def test_starts_drawn_ahead_are_those_of_single_environments(mode: AutoresetMode) -> None:
    """Without randomised parameters the rows' random numbers are drawn some starts ahead."""
    ours = gym.make_vec(DAMPING, num_envs=70, autoreset_mode=mode, max_episode_steps=2)
    theirs = SyncVectorEnv([lambda: gym.make(DAMPING, max_episode_steps=2)] * 70, autoreset_mode=mode)
    assert compare(ours, theirs, 3 * (MOST_AHEAD + 4)) >= 70 * (MOST_AHEAD + 2)
    state = {"state": np.zeros(18)}  # a start that takes no random numbers, then one that goes on with them
    for options in (state, None, {"parameters": {"m2": 2.0}}, None):
        ours_again = ours.reset(options=options)[0]
        singles = [env.reset(options=options)[0] for env in theirs.envs]
        assert ours_again.tobytes() == np.array(singles).tobytes()
    if mode != AutoresetMode.DISABLED:
        theirs.reset(options=state)  # after which the environment of environments knows that none has ended
        ours.reset(options=state)
        for _ in range(3 * MOST_AHEAD + 6):
            for one, other in zip(*(env.step(np.zeros((70, 3))) for env in (ours, theirs)), strict=True):
                assert_same_bits(one, other)


def test_rows_beyond_the_splitting_equal_single_environments() -> None:
    """Springs so close to zero length that only the adaptive scheme will do, beside others and beside bad luck."""
    states = np.zeros((70, 18))
    states[:, 5], states[:, 8] = -1.2, -2.3
    states[3:70:5, 3:6] = [1e-3, 0.0, -1e-3]
    states[3:70:5, 12:15] = np.random.default_rng(0).normal(size=(14, 3))
    env: Any = gym.make_vec(DAMPING, num_envs=70)
    env.reset(options={"state": states})
    stepped, rewards, _, _, infos = env.step(np.full((70, 3), 0.1))
    for row in range(70):
        single = gym.make(DAMPING)
        single.reset(options={"state": states[row]})
        observation, reward, _, _, info = single.step(np.full(3, 0.1))
        assert observation.tobytes() == stepped[row].tobytes()
        assert (reward, info["energy_error"]) == (rewards[row], infos["energy_error"][row])
    assert infos["energy_error"].max() < 1e-10

    # Where one of them also leaves the range of numbers, it is named.
    states[5, 9:] = 1e200
    with pytest.raises(FloatingPointError, match="rows 5"):
        env.reset(options={"state": states})


def test_row_is_reset_with_seed_plus_its_number() -> None:
    env = gym.make_vec(DAMPING, num_envs=5)
    observations, _ = env.reset(seed=11)
    for row in range(5):
        assert observations[row].tobytes() == gym.make(DAMPING).reset(seed=11 + row)[0].tobytes()
    again, _ = env.reset(seed=[15, 14, 13, 12, 11])
    assert again.tobytes() == observations[::-1].tobytes()


def test_options_set_states_and_parameters_of_each_row() -> None:
    env = gym.make_vec(DAMPING, num_envs=3)
    states = np.random.default_rng(0).normal(size=(3, 18))
    stiffness = np.array([50.0, 100.0, 200.0])
    observations, infos = env.reset(options={"state": states, "parameters": {"k1": stiffness, "m2": 2.0}})
    assert observations.tobytes() == states.tobytes()
    assert infos["parameters"]["k1"].tolist() == stiffness.tolist()
    assert infos["parameters"]["m2"].tolist() == [2.0] * 3
    stepped = env.step(np.full((3, 3), 0.5))[0]
    for row in range(3):
        single = gym.make(DAMPING)
        single.reset(options={"state": states[row], "parameters": {"k1": stiffness[row], "m2": 2.0}})
        assert single.step(np.full(3, 0.5))[0].tobytes() == stepped[row].tobytes()
    assert env.reset()[1]["parameters"]["k1"].tolist() == [100.0] * 3
    assert (env.reset(options={"state": states[0]})[0] == states[0]).all()


def test_infos_handed_out_are_not_changed_later() -> None:
    env = gym.make_vec(DAMPING, num_envs=4, **arguments(DAMPING))
    observations, infos = env.reset(seed=0)
    kept = pickle.dumps((observations, infos))
    for _ in range(80):
        env.step(env.action_space.sample())
    assert pickle.dumps((observations, infos)) == kept
    for one in (env, copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        _, infos = one.reset()
        for shared in (infos["parameters"]["k1"], infos["_time"]):
            with pytest.raises(ValueError, match="read-only"):
                shared[:] = 0.0


@pytest.mark.parametrize("wrap", [RecordEpisodeStatistics, NormalizeObservation, NormalizeReward])
def test_works_under_gymnasium_s_vector_wrappers(wrap: Callable[[Any], Any]) -> None:
    env = wrap(gym.make_vec(DAMPING, num_envs=4, max_episode_steps=10))
    env.reset(seed=0)
    for _ in range(30):
        observations, rewards, *_ = env.step(env.action_space.sample())
        assert np.isfinite(observations).all()
        assert np.isfinite(rewards).all()


def test_episode_statistics_equal_single_environments() -> None:
    returns = []
    for make in (gym.make_vec, lambda name, num_envs, **kw: SyncVectorEnv([lambda: gym.make(name, **kw)] * num_envs)):
        env = RecordEpisodeStatistics(make(DAMPING, num_envs=3, max_episode_steps=10))
        env.reset(seed=0)
        for _ in range(35):
            env.step(np.full((3, 3), 0.3))
        returns.append((list(env.return_queue), list(env.length_queue)))
    assert returns[0] == returns[1]
    assert len(returns[0][0]) == 9


WRONG_ARGUMENTS = [
    ({"num_envs": 0}, "num_envs"),
    ({"num_envs": 2.5}, "num_envs"),
    ({"num_envs": 2, "threads": 0}, "threads"),
    ({"num_envs": 2, "autoreset_mode": "never"}, "autoreset_mode"),
    ({"num_envs": 2, "render_mode": "human"}, "render_mode"),
    ({"num_envs": 2, "render_mode": "rgb_array", "render_rows": [2]}, "render_rows"),
    ({"num_envs": 2, "render_rows": 1}, "render_rows"),
    ({"num_envs": 2, "render_rows": [0.5]}, "render_rows"),
    ({"num_envs": 2, "max_episode_steps": 0}, "max_episode_steps"),
    ({"num_envs": 2, "parameters": {"m1": -1}}, "m1"),
]


@pytest.mark.parametrize(("kwargs", "named"), WRONG_ARGUMENTS)
def test_wrong_argument_is_named(kwargs: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        gym.make_vec(DAMPING, **kwargs)


WRONG_RESETS: list[tuple[dict[str, Any], str]] = [
    ({"seed": [1, 2]}, "seed"),
    ({"seed": 1.5}, "seed"),
    ({"seed": "one"}, "seed"),
    ({"seed": [1, 2, -3]}, "seed"),
    ({"options": {"reset_mask": np.ones(4, dtype=bool)}}, "reset_mask"),
    ({"options": {"reset_mask": np.zeros(3, dtype=bool)}}, "reset_mask"),
    ({"options": {"reset_mask": [1, 0, 1]}}, "reset_mask"),
    ({"options": {"parameters": {"k1": np.ones(4)}}}, "k1"),
    ({"options": {"parameters": {"k9": np.ones(3)}}}, "k9"),
    ({"options": {"parameters": {"m1": np.array([1.0, -1.0, 1.0])}}}, "m1"),
    ({"options": {"state": np.zeros((4, 18))}}, "state"),
    ({"options": {"state": np.full((3, 18), np.nan)}}, "state"),
    ({"options": {"start": 1}}, "start"),
    ({"options": [1]}, "options"),
]


@pytest.mark.parametrize(("reset", "named"), WRONG_RESETS)
def test_wrong_reset_is_named_and_changes_nothing(reset: dict[str, Any], named: str) -> None:
    env: Any = gym.make_vec(DAMPING, num_envs=3)
    env.reset(seed=0)
    twin: Any = copy.deepcopy(env)
    with pytest.raises(ValueError, match=named):
        env.reset(**reset)
    assert env.states.tobytes() == twin.states.tobytes()
    env.step(env.action_space.sample())
    if "seed" in reset:  # the random numbers are where they were
        assert env.reset()[0].tobytes() == twin.reset()[0].tobytes()


def test_wrong_actions_name_the_rows_and_change_nothing() -> None:
    env: Any = gym.make_vec(DAMPING, num_envs=4)
    env.reset(seed=0)
    before = env.states.tobytes()
    actions = np.zeros((4, 3))
    actions[[1, 3], 2] = np.nan, np.inf
    unreal = [np.zeros((4, 3), dtype=complex), [["0"] * 3] * 4, [[10**400] * 3] * 4]
    for wrong, named in (
        (actions, "rows 1, 3"),
        (np.zeros((4, 2)), "shape"),
        *((wrong, "actions") for wrong in (None, "up", *unreal)),
    ):
        with pytest.raises(ValueError, match=named):
            env.step(wrong)
    assert env.states.tobytes() == before
    env.step(np.zeros((4, 3)))


def test_rows_that_ended_must_be_reset_when_autoreset_is_disabled() -> None:
    env = gym.make_vec(DAMPING, num_envs=2, autoreset_mode="DISABLED", max_episode_steps=2)
    env.reset(seed=0)
    env.step(np.zeros((2, 3)))
    env.step(np.zeros((2, 3)))
    with pytest.raises(gym.error.ResetNeeded, match="rows 0, 1"):
        env.step(np.zeros((2, 3)))


def test_step_before_reset_is_refused() -> None:
    with pytest.raises(gym.error.ResetNeeded):
        gym.make_vec(DAMPING, num_envs=2).step(np.zeros((2, 3)))


def step_in_the_child(env: Any, to_parent: Any) -> None:
    to_parent.send_bytes(env.step(np.full((200, 3), 0.5))[0].tobytes())


def test_threads_outlive_copying_closing_and_forking() -> None:
    env: Any = gym.make_vec(DAMPING, num_envs=200, threads=2)
    env.reset(seed=0)
    env.step(np.zeros((200, 3)))
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    from_child, to_parent = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=step_in_the_child, args=(env, to_parent))
    child.start()
    assert from_child.poll(60), "the child hangs"
    forked = from_child.recv_bytes()
    child.join()
    env.close()
    for one in (env, *copies):
        assert one.step(np.full((200, 3), 0.5))[0].tobytes() == forked
        one.close()


def test_states_show_the_anchor_of_the_passive_task_too() -> None:
    env: Any = gym.make_vec("SpringPendulumPassive-v0", num_envs=70)
    observations, _ = env.reset(seed=0)
    assert env.states.shape == (70, 18)
    assert np.array_equal(env.states[:, spring_pendulum_env.equilibria.BODY_STATE], observations)


def test_chosen_rows_are_drawn_as_single_environments_are() -> None:
    pytest.importorskip("pygame")
    env = gym.make_vec(DAMPING, num_envs=70, render_mode="rgb_array", render_rows=[2, 65])
    singles = [gym.make(DAMPING, render_mode="rgb_array") for _ in range(2)]
    env.reset(seed=0)
    singles[0].reset(seed=2)
    singles[1].reset(seed=65)
    for _ in range(3):
        env.step(np.full((70, 3), 0.5))
        frames: Any = env.render()
        assert len(frames) == 2
        for single, frame in zip(singles, frames, strict=True):
            single.step(np.full(3, 0.5))
            assert np.array_equal(single.render(), frame)
    with pytest.warns(UserWarning, match="render_mode"):
        assert gym.make_vec(DAMPING, num_envs=2).render() is None


@pytest.mark.parametrize("randomise", [None, {"k1": (50.0, 150.0), "m2": (0.5, 2.0)}])
def test_goes_on_from_a_state_that_was_taken(randomise: dict[str, tuple[float, float]] | None) -> None:
    def make() -> Any:
        return gym.make_vec(DAMPING, num_envs=70, max_episode_steps=9, randomise=randomise).unwrapped

    first, second = make(), make()
    first.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 70, 3))
    for action in actions[:25]:
        first.step(action)
    taken = first.get_state()
    for action in actions[25:]:  # long enough for starts beyond those that were drawn ahead
        first.step(action)
    assert all(array.dtype.kind in "fib" for array in taken.values())
    second.reset(seed=99)
    second.step(actions[0])
    second.set_state(taken)
    third = make()  # never reset
    third.set_state(taken)
    for action in actions[25:]:
        results = [env.step(action) for env in (second, third)]
        for one, other in zip(*results, strict=True):
            if isinstance(one, np.ndarray):
                assert one.tobytes() == other.tobytes()
        assert results[0][4]["parameters"]["k1"].tobytes() == results[1][4]["parameters"]["k1"].tobytes()
    for env in (second, third):
        ended = env.get_state()
        assert all(array.tobytes() == ended[name].tobytes() for name, array in first.get_state().items())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rows": np.zeros((1, 2, 3))}, "rows is float64 of shape"),
        ({"ended": np.zeros(3)}, "ended is float64"),
        ({"more": np.zeros(3)}, "more missing or unknown"),
        ({"starts.generators": np.full((3, 6), 2)}, "PCG64"),
        ({"starts.generators": np.zeros((3, 6), dtype=np.int64)}, "generators"),
        ({"starts.taken": np.full(3, 1000)}, "starts taken"),
    ],
)
def test_a_state_of_something_else_is_refused(change: dict[str, Any], words: str) -> None:
    env: Any = gym.make_vec(DAMPING, num_envs=3).unwrapped
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(ValueError, match=words):
        env.set_state(before | change)
    assert all(array.tobytes() == before[name].tobytes() for name, array in env.get_state().items())
    del before["rows"]
    with pytest.raises(ValueError, match="rows missing or unknown"):
        env.set_state(before)


def test_a_batch_gives_up_with_its_first_pendulum_that_takes_too_many_steps() -> None:
    """No step is longer than 0.02 s, so 30,000 s are more than a million; each of them takes seconds."""
    env = gym.make_vec(IDS[0], num_envs=100, control_period=30_000.0, tolerance=1e-6)
    env.reset(seed=0)
    before = env.unwrapped.states  # type: ignore[attr-defined]
    with pytest.raises(FloatingPointError, match=r"rows 0: .*more than 1000000 steps"):
        env.step(np.zeros((100, *env.single_action_space.shape)))  # type: ignore[misc]
    after = env.unwrapped.states  # type: ignore[attr-defined]
    assert (after[1:] == before[1:]).all()


def test_huge_actions_are_clipped_without_a_warning() -> None:
    first, second = (gym.make_vec(DAMPING, num_envs=70) for _ in range(2))
    first.reset(seed=0)
    second.reset(seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        huge = first.step(np.full((70, 3), 1.7e308))[0]
    np.testing.assert_array_equal(huge, second.step(np.ones((70, 3)))[0])


def test_number_of_rows_may_be_of_any_integer_type() -> None:
    assert gym.make_vec(DAMPING, num_envs=np.int8(2)).reset(seed=0)[0].shape == (2, 18)


def test_rows_that_ended_still_have_after_a_reset_that_overflows() -> None:
    """So the next step starts them anew."""
    env = gym.make_vec(DAMPING, num_envs=3, max_episode_steps=1)
    env.reset(seed=0)
    assert env.step(np.zeros((3, 3)))[3].all()
    with pytest.raises(FloatingPointError):
        env.reset(options={"state": np.full(18, 1e160)})
    assert np.isfinite(env.step(np.zeros((3, 3)))[0]).all()


@pytest.mark.skipif(DISABLED, reason="nothing is compiled")
def test_actions_of_any_kind_of_array_mean_the_same_and_compile_no_other_step() -> None:
    env = gym.make_vec(DAMPING, num_envs=70)
    numbers = np.random.default_rng(0).uniform(-1.0, 1.0, (70, 3)).astype(np.float32)
    read_only = numbers.astype(np.float64)
    read_only.flags.writeable = False
    kinds = (
        numbers,
        read_only,
        np.asfortranarray(numbers),
        numbers[::-1][::-1],
        numbers.tolist(),
        numbers.astype(">f4"),
    )
    env.reset(seed=0)
    expected = env.step(numbers)
    known = len(batch.step_batch.signatures)
    for actions in kinds:
        env.reset(seed=0)
        for one, other in zip(env.step(actions), expected, strict=True):
            assert_same_bits(one, other)
    assert len(batch.step_batch.signatures) == known


def test_rows_run_out_of_starts_at_different_times() -> None:
    """Else one step in many would have to draw for all of them."""
    env: Any = gym.make_vec(DAMPING, num_envs=4 * MOST_AHEAD, max_episode_steps=1)
    env.reset(seed=0)
    drawn = []
    for _ in range(3 * MOST_AHEAD):
        before = env._starts.taken.copy()
        env.step(np.zeros((4 * MOST_AHEAD, 3)))
        drawn.append(np.count_nonzero(env._starts.taken < before))
    assert sum(drawn) > 4 * MOST_AHEAD
    assert max(drawn) <= 8


@pytest.mark.parametrize("mode", AutoresetMode)
def test_rows_that_end_in_a_step_that_fails_for_others_have_ended(mode: AutoresetMode) -> None:
    """The next step starts them anew, or says that they must be reset."""
    env: Any = gym.make_vec(PASSIVE, num_envs=2, max_episode_steps=1, autoreset_mode=mode, tolerance=None)
    env.reset(seed=0)
    overflows = {"parameters": {"k1": [100.0, 0.0], "k2": [100.0, 0.0], "g": [9.81, 1e300]}}
    env.reset(options=overflows)
    with pytest.raises(FloatingPointError, match="rows 1"):
        env.step(None)
    if mode == AutoresetMode.DISABLED:
        with pytest.raises(gym.error.ResetNeeded, match="rows 0"):
            env.step(None)
    env.reset(options={"reset_mask": np.array([False, True])})
    if mode == AutoresetMode.NEXT_STEP:
        _, _, _, truncated, infos = env.step(None)
        assert infos["time"].tolist() == [0.0, 0.02]
        assert truncated.tolist() == [False, True]


def test_negative_zeros_of_a_start_are_zeros() -> None:
    """A single pendulum keeps the forces of its last kick for the next step; a batch computes them anew."""
    state = np.r_[np.full(5, -0.0), -1.2, 0.4, -0.0, -2.2, np.full(9, -0.0)]
    single, batched = gym.make(DAMPING), gym.make_vec(DAMPING, num_envs=2)
    observation = single.reset(options={"state": state})[0]
    assert not np.signbit(observation[observation == 0.0]).any()
    assert observation.tobytes() == batched.reset(options={"state": state})[0][1].tobytes()
    for action in ([0.3, -0.0, 0.1], [-0.0, -0.0, -0.0], [0.0, -0.0, -0.5], [0.2, 0.0, 0.2]) * 5:
        one, many = single.step(np.array(action)), batched.step(np.array([action] * 2))
        assert one[0].tobytes() == many[0][1].tobytes()
        assert one[1] == many[1][1]
