"""Several trainings of one config side by side, and the environment of RLlib's runners; none of it needs Ray."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import gymnasium as gym

from agents import runs
from agents.config import default_path, read_config
from agents.files import read_arrays, read_csv, write_text
from agents.policy import LearnedPolicy
from agents.rllib_env import RunnerEnv, env_settings, fixed_variance, make_runner_env
from agents.sweep import SCORES, Member, grid, members_of, run_in_processes, train_and_score, write_table

ROOT = Path(__file__).resolve().parent.parent
CONFIG = ROOT / "configs" / "damping-ppo.yaml"
TINY = [
    "training.steps=1024",
    "training.environments=8",
    "network.layers=[8, 8]",
    "ppo.n_steps=64",
    "ppo.batch_size=256",
    "ppo.n_epochs=2",
]


def test_members_are_all_combinations_each_with_its_own_folder(tmp_path: Path) -> None:
    values = grid([["ppo.gamma=0.9", "0.95"], ["network.layers=[8, 8]", "[4]"]], [3, 5])
    members = members_of(CONFIG, TINY, values, tmp_path)
    assert len(members) == len({member.folder for member in members}) == 8
    told = {(m.config.ppo.gamma, m.config.network.layers, m.config.training.seed) for m in members}
    assert told == {(gamma, layers, seed) for gamma in (0.9, 0.95) for layers in ((8, 8), (4,)) for seed in (3, 5)}
    assert all(tmp_path in member.folder.parents for member in members)
    assert {m.variant for m in members if m.config.ppo.gamma == 0.9} == {
        "ppo.gamma=0.9, network.layers=[8, 8]",
        "ppo.gamma=0.9, network.layers=[4]",
    }


@pytest.mark.parametrize(
    ("tries", "seeds", "words"),
    [
        ([["ppo.gamma"]], [0], r"try is 'ppo.gamma'; allowed is section.key=value"),
        ([["training.seed=1"]], [0], "but not training.seed"),
        ([["ppo.gamma=0.9", "0.9"]], [0], "ppo.gamma is to be 0.9, 0.9; allowed are values that differ"),
        ([["ppo.gamma=0.9"], ["ppo.gamma=0.8"]], [0], "try has ppo.gamma twice"),
        ([], [1, 1], "training.seed is to be 1, 1"),
    ],
)
def test_a_sweep_that_makes_no_sense_is_refused(tries: list[list[str]], seeds: list[int], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        grid(tries, seeds)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Member], Path, str]:
    """Two settings with two seeds; a fifth training fails, since its folder is somebody else's."""
    folder = tmp_path_factory.mktemp("sweep")
    members = members_of(CONFIG, TINY, grid([["ppo.gamma=0.9", "0.99"]], [0, 1]), folder)
    (barred,) = members_of(CONFIG, TINY, grid([], [7]), folder)
    write_text(barred.folder / "letter.txt", "mine")
    with pytest.raises(ValueError, match=r"1 of 5 trainings failed: .*seed7: .*holds files but no run"):
        run_in_processes([barred, *members], processes=2, starts=4, progress=False)
    return members, folder, write_table(members, folder)


def test_seeds_are_trained_in_processes_into_folders_of_their_own(sweep: tuple[list[Member], Path, str]) -> None:
    members, _, _ = sweep
    for member in members:
        assert runs.read_run_config(member.folder) == member.config
        assert runs.read_record(member.folder)["finished"]
    weights = [LearnedPolicy.load(member.folder).predict(np.ones(18))[0] for member in members]
    assert len({tuple(action) for action in weights}) == 4


def test_table_has_the_interval_over_seeds(sweep: tuple[list[Member], Path, str]) -> None:
    members, folder, text = sweep
    assert (folder / "table.md").read_text() == text + "\n"
    assert [line.split("|")[1].strip() for line in text.splitlines()[2:]] == [
        "ppo.gamma=0.9 (2 seeds)",
        "ppo.gamma=0.99 (2 seeds)",
    ]
    those = [member for member in members if "0.99" in member.variant]
    rewards = np.stack([read_arrays(member.folder / SCORES)["mean_reward"] for member in those])
    row = next(
        row
        for row in read_csv(folder / "summary.csv")
        if (row["controller"], row["measure"], row["statistic"])
        == ("ppo.gamma=0.99 (2 seeds)", "mean_reward", "median")
    )
    assert (row["trainings"], row["episodes"]) == ("2", "4")
    assert float(row["low"]) <= float(np.median(rewards)) <= float(row["high"])
    assert rewards.min() <= float(row["low"]) < float(row["high"]) <= rewards.max()


def test_what_is_done_is_not_done_again(sweep: tuple[list[Member], Path, str]) -> None:
    member = sweep[0][0]
    times = [(member.folder / name).stat().st_mtime_ns for name in (runs.POLICY, SCORES)]
    train_and_score(member.config.model_dump(mode="json"), str(member.folder), starts=4)
    assert [(member.folder / name).stat().st_mtime_ns for name in (runs.POLICY, SCORES)] == times


def test_the_script_says_in_one_line_what_is_wrong() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "sweep.py"), str(CONFIG), "--processes", "0"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert result.stderr == "error: processes is 0; allowed is a number from 1 on\n"


# The environment of RLlib's runners


def runner_env(*changes: str, seeds: tuple[int, ...] = (0,)) -> RunnerEnv:
    config = read_config(default_path("damping", "ppo"), [*TINY, *changes])
    return RunnerEnv(config, config.training.environments, list(seeds))


def test_runners_step_the_native_environment_and_reset_in_the_next_step() -> None:
    from spring_pendulum_env import SpringPendulumVectorEnv

    config = read_config(default_path("damping", "ppo"), TINY)
    env = make_runner_env(json.loads(json.dumps(dict(env_settings(config, 0)))) | {"num_envs": 8})
    assert isinstance(env.unwrapped, SpringPendulumVectorEnv)
    assert env.num_envs == env.unwrapped.num_envs == 8
    assert env.metadata["autoreset_mode"] == gym.vector.AutoresetMode.NEXT_STEP
    assert env.single_observation_space.dtype == np.float32


def test_observations_are_what_the_policy_sees() -> None:
    """A network that hands its input on shows it."""
    env = runner_env()

    class Shows:
        def train(self, _: bool) -> None: ...

        def predict(self, scaled, deterministic):  # type: ignore[no-untyped-def]  # noqa: ARG002
            return scaled, None

    config = read_config(default_path("damping", "ppo"), TINY)
    policy = LearnedPolicy(config, Shows(), env.reference, np.zeros(18), fixed_variance(config))
    seen, infos = env.reset(seed=1)
    assert infos == {}
    assert seen.dtype == np.float32
    assert np.array_equal(policy.predict(env.unwrapped.states)[0], seen)
    seen, *_ = env.step(np.zeros((8, 3)))
    assert np.array_equal(policy.predict(env.unwrapped.states)[0], seen)
    assert np.abs(seen).max() > 0.5


def test_no_two_runners_meet_the_same_start() -> None:
    """RLlib gives neighbouring runners neighbouring seeds, and a vector environment gives them to neighbouring rows."""
    starts = [runner_env().reset(seed=seed)[0] for seed in (1, 2)]
    starts.append(runner_env(seeds=(0, 7)).reset(seed=1)[0])  # a runner that was started again
    assert len(np.unique(np.concatenate(starts), axis=0)) == 24
    assert np.array_equal(runner_env().reset(seed=1)[0], starts[0])


def test_first_episodes_are_cut_at_staggered_lengths_and_reset_in_the_next_step() -> None:
    env = runner_env("environment.start_scale=0")  # at rest, nothing else ends an episode
    env.reset(seed=0)
    force = np.zeros((8, 3))
    force[:, 0] = 0.01
    ends: list[tuple[int, int]] = []
    before = np.zeros(8, dtype=bool)
    for step in range(1, 1100):
        force = -force  # to and fro, and never beyond the track
        observations, rewards, terminated, truncated, _ = env.step(force)
        assert not terminated.any()
        assert not (before & truncated).any()
        assert np.all((np.abs(observations).max(axis=1) == 0) == before)  # at the start again, and only then
        assert np.all(rewards[before] == 0)
        ends += [(row, step) for row in np.flatnonzero(truncated).tolist()]
        before = truncated
    limit = gym.spec("SpringPendulumDamping-v0").max_episode_steps
    assert limit is not None
    lengths = [[step for row, step in ends if row == of] for of in range(8)]
    assert [steps[0] for steps in lengths] == [1 + row * limit // 8 for row in range(8)]
    assert all(b - a == limit + 1 for steps in lengths for a, b in itertools.pairwise(steps))


def test_observations_without_scales_are_refused() -> None:
    with pytest.raises(ValueError, match=r"observation.scales is null.*allowed are two numbers"):
        runner_env("observation.scales=null")
