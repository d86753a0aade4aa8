"""The adapter gives Stable-Baselines3 what DummyVecEnv over monitored single environments gives."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize, VecVideoRecorder

from agents.sb3 import SpringPendulumVecEnv

DAMPING = "SpringPendulumDamping-v0"
ARGUMENTS: dict[str, Any] = {"start_scale": 2.0, "anchor_travel": 1.2, "randomise": {"k1": (80.0, 120.0)}}


def ours(rows: int, limit: int = 30, name: str = DAMPING) -> VecEnv:
    return SpringPendulumVecEnv(name, rows, max_episode_steps=limit, **ARGUMENTS)


def theirs(rows: int, limit: int = 30, name: str = DAMPING) -> VecEnv:
    return DummyVecEnv([lambda: Monitor(gym.make(name, max_episode_steps=limit, **ARGUMENTS))] * rows)


@pytest.mark.parametrize("name", [DAMPING, "SpringPendulumSwingUp-v0"])
def test_steps_equal_dummy_vec_env(name: str) -> None:
    pair = ours(5, name=name), theirs(5, name=name)
    for env in pair:
        env.seed(7)
    first, second = (env.reset() for env in pair)
    assert np.asarray(first).tobytes() == np.asarray(second).tobytes()
    random = np.random.default_rng(0)
    kinds = set()
    for _ in range(120):
        actions = random.uniform(-1, 1, (5, 3)).astype(np.float32) + np.array([0.6, 0, 0], dtype=np.float32)
        results = [env.step(actions) for env in pair]
        for one, other in zip(results[0][:3], results[1][:3], strict=True):
            assert one.dtype == other.dtype
            assert one.tobytes() == other.tobytes()
        for one, other in zip(results[0][3], results[1][3], strict=True):
            assert one["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert ("terminal_observation" in one) == ("terminal_observation" in other)
            if "terminal_observation" in one:
                kinds.add(one["TimeLimit.truncated"])
                assert one["terminal_observation"].tobytes() == other["terminal_observation"].tobytes()
                assert {k: one["episode"][k] for k in "rl"} == {k: other["episode"][k] for k in "rl"}
                assert set(one["episode"]) == set(other["episode"])
                assert one["energy"] == other["energy"]
                assert one["parameters"] == other["parameters"]
    assert kinds == {True, False}  # both time-outs and failures were seen


class _Buffers(BaseCallback):
    """Keeps a copy of each rollout buffer."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: list[dict[str, np.ndarray]] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        buffer = self.model.rollout_buffer  # type: ignore[attr-defined]
        names = ("observations", "actions", "rewards", "episode_starts", "values", "advantages", "returns")
        self.kept.append({name: getattr(buffer, name).copy() for name in names})


def test_rollout_buffers_equal_with_time_outs_bootstrapped() -> None:
    buffers = []
    for env in (ours(4, limit=25), theirs(4, limit=25)):
        recorder = _Buffers()
        # A learning rate of zero keeps the policy fixed.
        model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, n_epochs=1, learning_rate=0.0, seed=3)
        model.learn(512, callback=recorder)
        buffers.append(recorder.kept)
    assert len(buffers[0]) == len(buffers[1]) == 2
    for one, other in zip(*buffers, strict=True):
        for name in one:
            assert one[name].tobytes() == other[name].tobytes(), name
        assert other["episode_starts"].sum() > 8
    # The comparison would fail if time-outs were not bootstrapped: then some rewards would be the raw ones, at most 1.
    assert buffers[0][0]["rewards"].dtype == np.float32


def test_first_episodes_are_cut_at_their_own_lengths() -> None:
    env = SpringPendulumVecEnv(DAMPING, 3, first_lengths=np.array([2, 5, 100]), start_scale=0.5)
    plain = SpringPendulumVecEnv(DAMPING, 3, start_scale=0.5)
    for one in (env, plain):
        one.seed(0)
        one.reset()
    lengths: list[list[int]] = [[], [], []]
    for step in range(1, 9):
        observations, _, dones, infos = env.step(np.zeros((3, 3)))
        uncut, *_ = plain.step(np.zeros((3, 3)))
        for row, (done, info) in enumerate(zip(dones, infos, strict=True)):
            assert done == ("episode" in info)
            if done:
                lengths[row].append(info["episode"]["l"])
                assert info["TimeLimit.truncated"]
                assert info["time"] == pytest.approx(0.02 * step)
                assert info["terminal_observation"].tobytes() == np.asarray(uncut)[row].tobytes()
                assert np.abs(np.asarray(observations)[row, :3]).max() == 0.0  # the anchor of a new start
    assert lengths == [[2], [5], []]


def test_infos_are_new_objects_for_each_row_and_step() -> None:
    env = ours(3)
    env.reset()
    _, _, _, first = env.step(np.zeros((3, 3)))
    _, _, _, second = env.step(np.zeros((3, 3)))
    assert len({id(info) for info in [*first, *second]}) == 6


def test_works_under_sb3_s_wrappers_and_evaluation() -> None:
    env = VecNormalize(ours(2))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=16)
    model.learn(64)
    mean, _ = evaluate_policy(model, ours(2, limit=20), n_eval_episodes=4, warn=True)
    assert 0.0 < mean < 20.0


def test_monitor_is_reported_and_attributes_are_per_row() -> None:
    env = ours(3)
    assert env.env_is_wrapped(Monitor) == [True] * 3
    assert env.env_is_wrapped(gym.wrappers.TimeLimit, indices=[0]) == [False]
    assert env.get_attr("render_mode") == [None] * 3
    assert env.get_attr("max_episode_steps", indices=1) == [30]
    with pytest.raises(AttributeError, match="share"):
        env.set_attr("max_force", 1.0)
    with pytest.raises(AttributeError, match="share"):
        env.env_method("reset")


def test_options_reach_the_environment() -> None:
    env = ours(2)
    env.set_options({"parameters": {"m2": 2.0}})
    env.reset()
    assert [info["parameters"]["m2"] for info in env.reset_infos] == [2.0, 2.0]
    env.reset()
    assert [info["parameters"]["m2"] for info in env.reset_infos] == [1.0, 1.0]


def test_video_recorder_gets_frames(tmp_path: Any) -> None:
    pytest.importorskip("pygame")
    pytest.importorskip("moviepy")
    env = SpringPendulumVecEnv(DAMPING, 2, render_mode="rgb_array")
    recorder = VecVideoRecorder(env, str(tmp_path), lambda step: step == 0, video_length=5)
    recorder.reset()
    for _ in range(7):
        recorder.step(np.zeros((2, 3)))
    recorder.close()
    assert list(tmp_path.glob("*.mp4"))
