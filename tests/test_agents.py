"""Configs, training, run folders and the measures of an evaluation."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import agents
import spring_pendulum_env
from agents import runs
from agents.config import Config, check_config, default_path, read_config
from agents.evaluation import FIRST_SEED
from agents.files import read_csv, write_atomically, write_text
from agents.relative import relative
from spring_pendulum_env import Parameters

ROOT = Path(__file__).resolve().parent.parent
DAMPING = "SpringPendulumDamping-v0"
TINY = [
    "training.steps=2048",
    "training.environments=8",
    "training.checkpoint_every=512",
    "network.layers=[8, 8]",
    "ppo.n_steps=64",
    "ppo.batch_size=256",
    "ppo.n_epochs=2",
]


def tiny_config(*changes: str, task: str = "damping") -> Config:
    return read_config(default_path(task, "ppo"), [*TINY, *changes])


# Configs


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*-*.yaml")), ids=lambda path: path.stem)
def test_every_config_is_valid_and_survives_a_round_trip(path: Path, tmp_path: Path) -> None:
    config = read_config(path)
    equilibrium = config.environment.equilibrium
    own = default_path(config.task, config.algorithm, equilibrium) == path
    assert own or path.stem == f"{config.task}-{config.algorithm}"
    copy = tmp_path / "config.yaml"
    copy.write_text(config.to_yaml())
    assert read_config(copy) == config


def test_numbers_that_yaml_reads_as_text_are_numbers() -> None:
    config = tiny_config("training.steps=1e6", "ppo.learning_rate=3e-4", "environment.parameters={m1: 2e0}")
    assert config.training.steps == 1_000_000
    assert config.ppo.learning_rate == 3e-4
    assert config.environment.arguments() == {"parameters": {"m1": 2.0}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("training.sede=3", ["training.sede", "allowed", "seed"]),
        ("colour=red", ["colour", "allowed", "task"]),
        ("environment.spread=0.1", ["environment.spread", "allowed", "start_scale"]),
        ("training.steps=many", ["training.steps", "'many'", "number"]),
        ("training.steps=0", ["training.steps", "0", "greater than 0"]),
        ("training.steps=10.5", ["training.steps", "10.5", "integer"]),
        ("training.seed=true", ["training.seed", "True", "number"]),
        ("training.seed=-1", ["training.seed", "-1", "greater than or equal to 0"]),
        ("ppo.gamma=1.5", ["ppo.gamma", "1.5", "less than or equal to 1"]),
        ("ppo.learning_rate=.nan", ["ppo.learning_rate", "nan"]),
        ("observation.scales=[0.1]", ["observation.scales", "1"]),
        ("observation.scales=[0.1, 0]", ["observation.scales.1", "0", "greater than 0"]),
        ("network.activation=sine", ["network.activation", "'sine'", "tanh"]),
        ("task=swinging", ["task", "'swinging'", "damping"]),
        ("ppo=3", ["ppo", "3"]),
        ("training.seed", ["training.seed", "section.key=value"]),
        ("training.seed.deep=1", ["training.seed.deep=1", "no keys"]),
        ("training.seed=[", ["training.seed=[", "YAML"]),
    ],
)
def test_wrong_settings_are_named(change: str, words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        tiny_config(change)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_missing_or_broken_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"nowhere.yaml cannot be read"):
        read_config(tmp_path / "nowhere.yaml")
    broken = tmp_path / "broken.yaml"
    broken.write_text("task: [")
    with pytest.raises(ValueError, match=r"broken.yaml is not YAML"):
        read_config(broken)
    broken.write_text("- task")
    with pytest.raises(ValueError, match=r"broken.yaml holds list"):
        read_config(broken)
    with pytest.raises(ValueError, match="task is missing"):
        check_config({})
    with pytest.raises(ValueError, match=r"damping-magic; allowed are .*damping-ppo"):
        default_path("damping", "magic")


# Training and run folders


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, agents.policy.LearnedPolicy]:  # type: ignore[name-defined]
    from agents.training import train

    folder = tmp_path_factory.mktemp("runs") / "run"
    return folder, train(tiny_config(), folder, progress=False)


def test_run_folder_is_complete(finished) -> None:  # type: ignore[no-untyped-def]
    import torch

    folder, _ = finished
    present = {path.name for path in folder.iterdir()}
    assert {runs.CONFIG, runs.RECORD, runs.CURVE, runs.POLICY, runs.NORMALISATION} <= present
    assert runs.CHECKPOINT not in present
    assert runs.read_run_config(folder) == tiny_config()
    record = json.loads((folder / runs.RECORD).read_text())
    assert record["finished"]
    assert record["seed"] == 0
    assert record["steps"] == 2048
    assert record["versions"]["torch"] == torch.__version__
    assert {"commit", "command", "seconds"} <= set(record)
    assert [int(row["steps"]) for row in read_csv(folder / runs.CURVE)] == [512, 1024, 1536, 2048]
    weights = torch.load(folder / runs.POLICY, weights_only=True)
    assert all(isinstance(value, torch.Tensor) for value in weights.values())


def test_loaded_policy_acts_as_the_trained_one(finished) -> None:  # type: ignore[no-untyped-def]
    folder, trained = finished
    loaded = agents.load(folder)
    rest = spring_pendulum_env.equilibrium(Parameters(), "hanging-hanging")
    observations = rest + 0.3 * np.random.default_rng(0).standard_normal((20, 18))
    actions, state = loaded.predict(observations)
    assert state is None
    assert actions.shape == (20, 3)
    assert np.abs(actions).max() <= 1
    assert np.abs(actions).max() > 0
    assert np.array_equal(actions, trained.predict(observations)[0])
    for observation, action in zip(observations, actions, strict=True):
        assert loaded.predict(observation)[0] == pytest.approx(action, abs=1e-6)


def test_policy_sees_what_the_algorithm_saw(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Raw observation in, the same action as SB3's model gives for its own normalised observation."""
    from agents import training

    models = []
    record = training.ALGORITHMS["ppo"]

    def make_model(*arguments):  # type: ignore[no-untyped-def]
        models.append(record.make_model(*arguments))
        return models[-1]

    monkeypatch.setitem(training.ALGORITHMS, "ppo", dataclasses.replace(record, make_model=make_model))
    policy = training.train(tiny_config("training.steps=1024"), tmp_path / "run", progress=False)
    normalised = models[0].get_vec_normalize_env()
    raw = policy.reference + 0.3 * np.random.default_rng(0).standard_normal((20, 18))
    seen = normalised.normalize_obs(relative(raw, policy.reference).astype(np.float32))
    assert np.abs(seen).max() > 0.5
    assert np.array_equal(policy.predict(raw)[0], models[0].predict(seen, deterministic=True)[0].astype(float))


@pytest.mark.parametrize("scales", ["[0.2, 0.4]", "null"])
def test_observations_are_scaled_as_the_config_says(scales: str, tmp_path: Path) -> None:
    from agents.training import train

    config = tiny_config("training.steps=512", f"observation.scales={scales}")
    policy = train(config, tmp_path / "run", progress=False)
    given = np.repeat([0.04, 0.16], 9)
    assert np.allclose(policy.variance, given) == (scales != "null")
    assert np.allclose(policy.mean, 0.0) == (scales != "null")


def test_an_unfinished_run_is_said_to_be_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from agents import torch_file, training
    from agents.checkpoints import Checkpoints

    class Interrupted(Exception):
        pass

    write = Checkpoints._write

    def write_second_and_stop(self: Checkpoints, steps: int) -> None:
        write(self, steps)
        if steps >= 1024:
            raise Interrupted

    folder = tmp_path / "run"
    monkeypatch.setattr(Checkpoints, "_write", write_second_and_stop)
    with pytest.raises(Interrupted):
        training.train(tiny_config(), folder, progress=False)
    checkpoint = torch_file.read(folder / runs.CHECKPOINT)
    assert checkpoint["steps"] == 1024
    assert not runs.read_record(folder)["finished"]
    with pytest.raises(ValueError, match="unfinished"):
        agents.load(folder)

    monkeypatch.setattr(Checkpoints, "_write", write)
    training.train(tiny_config(), folder, progress=False)
    assert [int(row["steps"]) for row in read_csv(folder / runs.CURVE)] == [512, 1024, 1536, 2048]
    assert runs.read_record(folder)["finished"]
    assert runs.read_record(folder)["seconds"] > checkpoint["seconds"][0]


def test_a_finished_run_is_not_trained_again(finished, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    from agents import training

    folder, trained = finished
    monkeypatch.setattr(training, "make_training_env", None)
    again = training.train(tiny_config(), folder, progress=False)
    assert np.array_equal(again.predict(np.ones(18))[0], trained.predict(np.ones(18))[0])


def test_a_folder_that_is_no_place_for_this_run_is_refused(finished, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    from agents.training import train

    folder, _ = finished
    with pytest.raises(ValueError, match=r"another config \(ppo.gamma is 0.9\d* there and 0.5 here\)"):
        train(tiny_config("ppo.gamma=0.5"), folder, progress=False)
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(ValueError, match="holds files but no run"):
        train(tiny_config(), tmp_path, progress=False)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_what_the_environment_refuses_leaves_nothing_behind(tmp_path: Path) -> None:
    from agents.training import train

    with pytest.raises(ValueError, match="sideways"):
        config = tiny_config("environment.equilibrium=sideways", task="stabilisation")
        train(config, tmp_path / "run", progress=False)
    assert not (tmp_path / "run").exists()


def test_what_is_not_a_run_is_refused(finished, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match=r"'.*nowhere', which is not there; allowed"):
        agents.load(tmp_path / "nowhere")
    with pytest.raises(ValueError, match=r"lacks config.yaml.*allowed"):
        agents.load(tmp_path)
    folder, _ = finished
    for name in (runs.CONFIG, runs.NORMALISATION):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / runs.POLICY).write_bytes(b"no weights")
    with pytest.raises(ValueError, match=r"policy.pth does not hold the weights"):
        agents.load(tmp_path)
    (tmp_path / runs.NORMALISATION).write_bytes(b"no statistics")
    with pytest.raises(ValueError, match=r"normalisation.npz is not the statistics"):
        agents.load(tmp_path)


@pytest.mark.parametrize("name", runs.SHIPPED_NAMES)
def test_a_policy_that_is_not_there_is_named(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(runs, "SHIPPED", tmp_path)
    with pytest.raises(ValueError, match=rf"'{name}', which is not there; allowed .*\(none so far\)"):
        agents.load(name)


def test_seeds_of_training_never_reach_those_of_evaluation() -> None:
    with pytest.raises(ValueError, match=r"training.seed is 4294967296"):
        tiny_config(f"training.seed={2**32}")
    assert FIRST_SEED > 2 * 2**32


def test_importing_agents_is_light() -> None:
    code = "import sys, agents, agents.config, agents.runs; print('torch' in sys.modules or 'numba' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["train.py", "damping", "--steps", "many"], ["training.steps", "'many'"]),
        (["train.py", "damping", "--set", "ppo.gama=1"], ["ppo.gama", "allowed"]),
        (["train.py", "damping", "--algo", "magic"], ["damping-magic", "damping-ppo"]),
        (["evaluate.py", "nowhere"], ["'nowhere'", "allowed"]),
    ],
)
def test_scripts_say_in_one_line_what_is_wrong(command: list[str], words: list[str]) -> None:
    script, *arguments = command
    result = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / script), *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr


def test_writing_fails_without_a_trace(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_text(path, "old")

    def fail(file) -> None:  # type: ignore[no-untyped-def]
        file.write(b"half")
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write_atomically(path, fail)
    assert path.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


# Comparisons


def test_table_and_comparison(finished, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    from agents.comparison import compare

    _, policy = finished
    text = compare(policy, policy.config, tmp_path, episodes=4)
    assert [line.split("|")[1].strip() for line in text.splitlines()[2:]] == ["policy", "LQR", "nothing"]
    for name in (
        "table.md",
        "summary.csv",
        "episodes.csv",
        "evaluation.json",
        "energy.png",
        "paths.png",
        "comparison.svg",
    ):
        assert (tmp_path / name).stat().st_size > 0
    assert len(read_csv(tmp_path / "episodes.csv")) == 12
    rows = {(row["controller"], row["measure"]): row for row in read_csv(tmp_path / "summary.csv")}
    assert rows["nothing", "settled"]["value"] == "0.0"
    assert rows["nothing", "settling_time"]["value"] == "inf"
    assert float(rows["LQR", "effort"]["value"]) > 0
    record = json.loads((tmp_path / "evaluation.json").read_text())
    assert record["first_seed"] == FIRST_SEED
    assert record["config"]["training"]["seed"] == 0
    assert "versions" in record


def test_stabilisation_trains_and_compares(tmp_path: Path) -> None:
    from agents.comparison import compare
    from agents.training import train

    config = tiny_config(
        "environment.equilibrium=hanging-inverted", "environment.actuated_axes=xz", task="stabilisation"
    )
    policy = train(config, tmp_path / "run", progress=False)
    assert np.array_equal(policy.reference, spring_pendulum_env.equilibrium(Parameters(), "hanging-inverted"))
    assert agents.load(tmp_path / "run").predict(policy.reference)[0].shape == (2,)
    text = compare(policy, config, tmp_path / "evaluation", episodes=3)
    assert "recovered" in text
    assert (tmp_path / "evaluation" / "paths.png").stat().st_size > 0
