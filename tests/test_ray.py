"""RLlib trains in two runners, loses one, is interrupted, and leaves a run folder like any other; Ray Tune sweeps.

Ray needs a virtual environment of its own (`make ray`, which runs this file in it); elsewhere this skips.
"""

from __future__ import annotations

import copy
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ray", reason="Ray is not installed: make ray")

import gymnasium as gym
import psutil
import torch
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import agents
from agents import runs
from agents.config import Config, default_path, read_config
from agents.files import read_csv
from agents.policy import LearnedPolicy
from agents.ray_start import ray_running
from agents.rllib_config import algorithm_config, refuse_what_cannot_be
from agents.rllib_env import NAME, RunnerEnv, fixed_variance, make_runner_env
from agents.rllib_learners import ScaleRewards
from agents.rllib_train import RECORD, train

ROOT = Path(__file__).resolve().parent.parent
SHAPE = ["training.environments=8", "network.layers=[8, 8]"]
TINY = {
    "ppo": [*SHAPE, "ppo.n_steps=32", "ppo.batch_size=128", "ppo.n_epochs=2"],
    "sac": [*SHAPE, "sac.learning_starts=256", "sac.batch_size=32", "sac.gradient_steps=2"],
}


def tiny_config(algorithm: str, *changes: str) -> Config:
    return read_config(default_path("damping", algorithm), [*TINY[algorithm], *changes])


# What needs no process of Ray's


@pytest.mark.parametrize(
    ("algorithm", "changes", "runners", "words"),
    [
        ("shac", [], 2, r"algorithm is 'shac', which RLlib doesn't have; allowed are ppo, sac"),
        ("tqc", [], 2, "algorithm is 'tqc'"),
        ("ppo", ["observation.scales=null"], 2, "observation.scales is null"),
        ("ppo", ["training.environments=9"], 2, "training.environments is 9; allowed is a multiple of the 2 runners"),
        ("ppo", ["ppo.n_steps=2"], 2, "ppo.batch_size is 1024; allowed is at most a rollout, 256 steps"),
        ("sac", ["training.normalise_reward=true"], 2, "training.normalise_reward is true"),
        ("ppo", [], -1, "runners is -1"),
    ],
)
def test_what_rllib_cannot_do_is_refused(
    algorithm: str, changes: list[str], runners: int, words: str, tmp_path: Path
) -> None:
    config = read_config(default_path("damping", algorithm), changes)
    with pytest.raises(ValueError, match=words):
        train(config, tmp_path / "run", runners=runners, progress=False)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("algorithm", TINY)
@pytest.mark.parametrize("task", ["damping", "stabilisation"])
def test_shipped_configs_map(task: str, algorithm: str) -> None:
    config = read_config(default_path(task, algorithm))
    refuse_what_cannot_be(config, 2)
    rllib = algorithm_config(config, 2)
    own = getattr(config, config.algorithm)
    assert rllib.num_env_runners * rllib.num_envs_per_env_runner == config.training.environments
    assert rllib.gamma == own.gamma
    assert rllib.restart_failed_env_runners
    if config.algorithm == "ppo":
        assert (rllib.lambda_, rllib.clip_param, rllib.num_epochs) == (own.gae_lambda, own.clip_range, own.n_epochs)
        assert rllib.get_rollout_fragment_length() == own.n_steps
        assert rllib.lr == [[0, own.learning_rate], [config.training.steps, own.final_learning_rate]]
        half = algorithm_config(config, 2, config.training.steps // 2).lr
        assert half == [[0, pytest.approx(own.learning_rate / 2)], [config.training.steps // 2, 0]]
    else:
        from ray.rllib.algorithms.dqn.dqn import calculate_rr_weights

        assert calculate_rr_weights(rllib) == [1, own.gradient_steps]
        assert (rllib.tau, rllib.actor_lr, rllib.critic_lr) == (own.tau, own.learning_rate, own.learning_rate)


@pytest.mark.parametrize("algorithm", TINY)
def test_policy_acts_as_the_module(algorithm: str) -> None:
    config = tiny_config(algorithm, "environment.actuated_axes=xz", "network.activation=silu")
    spec = algorithm_config(config, 2).rl_module_spec
    spec.observation_space = gym.spaces.Box(-np.inf, np.inf, (18,), np.float32)
    spec.action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    module = spec.build()
    if algorithm == "sac":
        module.make_target_networks()
    env = RunnerEnv(config, 8, [0])
    seen, _ = env.reset(seed=0)
    inputs = module.forward_inference({"obs": torch.as_tensor(seen)})["action_dist_inputs"][:, :2]
    expected = inputs.clamp(-1, 1) if algorithm == "ppo" else torch.tanh(inputs)
    policy = LearnedPolicy(config, module.sb3_network(), env.reference, np.zeros(18), fixed_variance(config))
    actions = policy.predict(env.unwrapped.states)[0]
    assert actions == pytest.approx(expected.detach().numpy(), abs=1e-6)
    assert np.abs(actions).max() > 0


class _Rewards(gym.Env[Any, Any]):
    """Gives the rewards that it is told, in episodes of five steps."""

    observation_space = gym.spaces.Box(-1, 1, (1,))
    action_space = gym.spaces.Box(-1, 1, (1,))

    def __init__(self, rewards: np.ndarray) -> None:
        self.rewards, self.count = rewards, 0

    def reset(self, **_: Any) -> Any:
        return np.zeros(1, np.float32), {}

    def step(self, _: Any) -> Any:
        self.count += 1
        return np.zeros(1, np.float32), float(self.rewards[self.count - 1]), self.count % 5 == 0, False, {}


def test_rewards_are_scaled_as_by_vecnormalize() -> None:
    from ray.rllib.env.single_agent_episode import SingleAgentEpisode

    rewards = np.random.default_rng(0).normal(2.0, 3.0, 23)
    theirs = VecNormalize(DummyVecEnv([lambda: _Rewards(rewards)]), norm_obs=False, gamma=0.9)
    theirs.reset()
    for _ in rewards:
        last = theirs.step(np.zeros((1, 1)))[1]
    ours = ScaleRewards(gamma=0.9)
    episode, batches = SingleAgentEpisode(observations=[0]), []
    for count, reward in enumerate(rewards.tolist(), start=1):
        episode.add_env_step(observation=0, action=0, reward=reward, terminated=count % 5 == 0)
        if count % 3 == 0 or episode.is_done or count == len(rewards):  # parts of episodes, as runners send them
            after = SingleAgentEpisode(observations=[0]) if episode.is_done else episode.cut()
            batches.append(episode.to_numpy())
            episode = after
    for part in batches:
        ours(episodes=[part], batch={})
    assert ours.statistics.count == pytest.approx(theirs.ret_rms.count)
    assert ours.statistics.mean == pytest.approx(float(theirs.ret_rms.mean))
    assert ours.statistics.var == pytest.approx(float(theirs.ret_rms.var))
    assert batches[-1].get_rewards()[-1] == pytest.approx(last[0], rel=1e-5)


# Two runners


@pytest.fixture(scope="class")
def algorithm() -> Iterator[Any]:
    from ray.tune.registry import register_env

    with ray_running(None, 2):
        register_env(NAME, make_runner_env)
        built = algorithm_config(tiny_config("ppo"), 2).build_algo()
        yield built
        built.stop()


class TestTwoRunners:
    def test_each_runner_steps_the_native_environment(self, algorithm: Any) -> None:
        def look(runner: Any) -> Any:
            env = runner.env.unwrapped
            starts = runner.env.reset(seed=runner._seed)[0]
            return type(env).__name__, env.num_envs, str(env.metadata["autoreset_mode"].value), os.getpid(), starts

        seen = algorithm.env_runner_group.foreach_env_runner(look, local_env_runner=False)
        assert [one[:3] for one in seen] == [("SpringPendulumVectorEnv", 4, "NextStep")] * 2
        assert len({one[3] for one in seen} | {os.getpid()}) == 3
        assert len(np.unique(np.concatenate([one[4] for one in seen]), axis=0)) == 8

    def test_nothing_listens_beyond_this_machine(self, algorithm: Any) -> None:
        assert algorithm.env_runner_group.num_healthy_remote_workers() == 2
        family = [psutil.Process(), *psutil.Process().children(recursive=True)]
        listening = [
            connection.laddr.ip
            for process in family
            for connection in process.net_connections(kind="inet")
            if connection.status == psutil.CONN_LISTEN
        ]
        assert len(listening) > 3
        assert {address.removeprefix("::ffff:") for address in listening} <= {"127.0.0.1", "::1"}

    def test_what_is_sampled_is_whole_and_never_across_a_reset(self, algorithm: Any) -> None:
        """Each step of an episode leads where the physics do: a reset taken for a step would show."""
        config = tiny_config("ppo")
        reference, scale = RunnerEnv(config, 1, [0]).reference, np.sqrt(fixed_variance(config))
        sampled = algorithm.env_runner_group.foreach_env_runner(
            lambda runner: runner.sample(num_timesteps=1200, random_actions=True), local_env_runner=False
        )
        from agents.relative import TRANSFORM

        checked = ended = 0
        env = gym.make(config.environment_id, **config.environment.arguments())
        for episode in [one for of_runner in sampled for one in of_runner]:
            ended += episode.is_done
            observations, actions = episode.get_observations(), episode.get_actions()
            for here, action, there in list(zip(observations, actions, observations[1:], strict=False))[-3:]:
                if max(np.abs(here).max(), np.abs(there).max()) > 9.99:
                    continue  # clipped
                state = reference + np.linalg.solve(TRANSFORM, here.astype(float) * scale)
                env.reset(options={"state": state})
                reached = (env.step(action)[0] - reference) @ TRANSFORM.T / scale
                assert reached == pytest.approx(there, abs=2e-3)
                checked += 1
        assert checked > 20
        assert ended > 4


# The script


def command(folder: Path, steps: int, algorithm: str = "ppo") -> list[str]:
    changes = [*TINY[algorithm], f"training.steps={steps}", "training.checkpoint_every=512"]
    script = [sys.executable, str(ROOT / "scripts" / "train_ray.py"), "damping", "--algo", algorithm]
    return [*script, "--folder", str(folder), *(part for change in changes for part in ("--set", change))]


def started(folder: Path, steps: int, algorithm: str = "ppo") -> subprocess.Popen[str]:
    log = (folder.parent / "log").open("w", encoding="utf-8")
    return subprocess.Popen(command(folder, steps, algorithm), cwd=ROOT, stdout=log, stderr=log, text=True)


def wait_for(what: Any, process: subprocess.Popen[str], folder: Path, seconds: float = 240.0) -> Any:
    """The first true value of `what`, while the training runs."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        found = what()
        if found:
            return found
        assert process.poll() is None, (folder.parent / "log").read_text()
        time.sleep(0.1)
    raise AssertionError((folder.parent / "log").read_text())


def steps_told(folder: Path) -> list[int]:
    path = folder / runs.CURVE
    return [int(row["steps"]) for row in read_csv(path)] if path.is_file() else []


def runner_processes(driver: int) -> list[psutil.Process]:
    found = []
    for process in psutil.Process(driver).children(recursive=True):
        try:
            if "SingleAgentEnvRunner" in " ".join(process.cmdline()):
                found.append(process)
        except psutil.Error:
            continue
    return found


def kill(process: subprocess.Popen[str]) -> None:
    """The training and all that it started, with no time to tidy up."""
    family = [*psutil.Process(process.pid).children(recursive=True), psutil.Process(process.pid)]
    for member in family:
        try:
            member.send_signal(signal.SIGKILL)
        except psutil.Error:
            continue
    process.wait()


@pytest.fixture(scope="module")
def survivor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training of two runners that lost one, was then killed as a whole, and went on to its end."""
    folder = tmp_path_factory.mktemp("ray") / "run"
    first = started(folder, 40_000)
    wait_for(lambda: len(steps_told(folder)) >= 3, first, folder)
    before = runner_processes(first.pid)
    assert len(before) == 2
    before[0].send_signal(signal.SIGKILL)
    at = steps_told(folder)[-1]
    wait_for(lambda: {one.pid for one in runner_processes(first.pid)} - {one.pid for one in before}, first, folder)

    def restarted() -> bool:
        return bool(json.loads((folder / RECORD).read_text())["runners_restarted"])

    wait_for(restarted, first, folder)
    assert steps_told(folder)[-1] > at
    kill(first)
    reached = torch.load(folder / runs.CHECKPOINT, weights_only=True)
    (folder.parent / "reached").write_text(str(reached["steps"]))
    assert not runs.read_record(folder)["finished"]
    steps = 512 * (reached["steps"] // 512 + 4)
    config = read_config(folder / runs.CONFIG, [f"training.steps={steps}"])
    (folder / runs.CONFIG).write_text(config.to_yaml())  # so that not all of it needs to be waited for
    done = subprocess.run(command(folder, steps), cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_training_survives_the_loss_of_a_runner_and_of_all(survivor: Path) -> None:
    reached = int((survivor.parent / "reached").read_text())
    record = runs.read_record(survivor)
    told = steps_told(survivor)
    assert record["finished"]
    assert record["steps"] == told[-1] > reached > 0
    assert reached in told
    assert told == sorted(set(told))
    assert json.loads((survivor / RECORD).read_text())["runners_restarted"] == 1


def test_run_folder_is_like_any_other(survivor: Path) -> None:
    names = {path.name for path in survivor.iterdir()}
    assert names == {runs.CONFIG, runs.RECORD, runs.CURVE, runs.POLICY, runs.NORMALISATION, RECORD}
    assert all(
        isinstance(value, torch.Tensor) for value in torch.load(survivor / runs.POLICY, weights_only=True).values()
    )
    policy = agents.load(survivor)
    assert np.abs(policy.predict(policy.reference + 0.1)[0]).max() <= 1
    from agents.comparison import compare

    text = compare(policy, policy.config, survivor.parent / "evaluation", episodes=3)
    assert [line.split("|")[1].strip() for line in text.splitlines()[2:]] == ["policy", "LQR", "nothing"]


def test_a_finished_run_is_not_trained_again(survivor: Path) -> None:
    before = (survivor / runs.POLICY).stat().st_mtime_ns
    train(runs.read_run_config(survivor), survivor, progress=False)
    assert (survivor / runs.POLICY).stat().st_mtime_ns == before


def test_a_training_of_the_other_kind_is_left_alone(tmp_path: Path) -> None:
    torch.save({"steps": 1}, tmp_path / runs.CHECKPOINT)
    with pytest.raises(ValueError, match=r"checkpoint.pth is of a training by scripts/train.py"):
        train(tiny_config("ppo"), tmp_path, progress=False)


def test_sac_trains_and_goes_on_from_what_it_had_learnt(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from agents import rllib_learners, rllib_train

    config = tiny_config("sac", "training.steps=1536", "training.checkpoint_every=512")
    folder = tmp_path / "run"
    save = rllib_train._Training._save

    class Interrupted(Exception):
        pass

    def save_and_stop(training: Any) -> None:
        save(training)
        raise Interrupted

    monkeypatch.setattr(rllib_train._Training, "_save", save_and_stop)
    with pytest.raises(Interrupted):
        train(config, folder, progress=False)
    saved = torch.load(folder / runs.CHECKPOINT, weights_only=True)
    assert 512 <= saved["steps"] < 1536
    assert float(saved["learner"]["log_alpha"]) != 0.0  # it has learnt, and is kept

    restored = []
    restore = rllib_learners.restore_learner

    def restore_and_look(learner: Any, state: Any) -> None:
        restore(learner, state)
        restored.append(copy.deepcopy(rllib_learners.learner_state(learner)))

    monkeypatch.setattr(rllib_train._Training, "_save", save)
    monkeypatch.setattr(rllib_learners, "restore_learner", restore_and_look)
    policy = train(config, folder, progress=False)
    (state,) = restored
    assert float(state["log_alpha"]) == float(saved["learner"]["log_alpha"])
    assert all(torch.equal(state["module"][name], value) for name, value in saved["learner"]["module"].items())
    moments = [one["optimisers"]["policy"]["state"][0]["exp_avg"] for one in (state, saved["learner"])]
    assert torch.equal(*moments)
    assert moments[0].any()
    assert runs.read_record(folder)["steps"] >= 1536
    states = policy.reference + 0.1 * np.random.default_rng(0).standard_normal((5, 18))
    assert np.array_equal(agents.load(folder).predict(states)[0], policy.predict(states)[0])


# Tune


def test_tune_sweeps_seeds_and_settings_and_goes_on(tmp_path: Path) -> None:
    changes = [*TINY["ppo"], "training.steps=512"]
    sweep = [sys.executable, str(ROOT / "scripts" / "sweep_ray.py"), str(ROOT / "configs" / "damping-ppo.yaml")]
    sweep += ["--seeds", "0", "1", "--starts", "3", "--folder", str(tmp_path / "sweep")]
    sweep += [part for change in changes for part in ("--set", change)]
    tables = []
    for _ in range(2):
        done = subprocess.run([*sweep, "--try", "ppo.gamma=0.9", "0.99"], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        tables.append((tmp_path / "sweep" / "table.md").read_text())
    assert tables[0] == tables[1]
    names = [line.split("|")[1].strip() for line in tables[0].splitlines()[2:]]
    assert names == ["ppo.gamma=0.9 (2 seeds)", "ppo.gamma=0.99 (2 seeds)"]
    folders = sorted(path.parent for path in (tmp_path / "sweep").glob("ppo*/seed*/policy.pth"))
    assert [runs.read_run_config(folder).training.seed for folder in folders] == [0, 1, 0, 1]
    other = subprocess.run([*sweep, "--try", "ppo.gamma=0.5"], capture_output=True, text=True, check=False)
    assert other.returncode == 2
    assert "which holds another sweep" in other.stderr


def test_shipped_cluster_is_one_for_rays_launcher() -> None:
    import yaml
    from ray.autoscaler._private.util import prepare_config, validate_config

    config = prepare_config(yaml.safe_load((ROOT / "configs" / "ray" / "cluster.yaml").read_text(encoding="utf-8")))
    validate_config(config)
    assert config["max_workers"] == len(config["provider"]["worker_ips"])
