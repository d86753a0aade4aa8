"""Configs: wrong ones are refused with file, line and a suggestion, and each that is shipped can be trained with."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import yaml

from agents.config import FOLDER, read_config
from spring_pendulum_env import Parameters, equilibrium

NOT_TRAININGS = {"classical", "dynamics", "zoo"}
SHIPPED = sorted(
    path
    for path in FOLDER.rglob("*.yaml")
    if path.parent.name not in NOT_TRAININGS and "algorithm" in yaml.safe_load(path.read_text(encoding="utf-8"))
)

RIGHT = """\
task: stabilisation
algorithm: shac
environment:
  equilibrium: hanging-inverted
  parameters: {k1: 120}
training:
  steps: 1e6          # YAML takes it for a text
observation:
  scales:
    - 0.1
    - 0.3
shac:
  learning_rate: 3e-4
"""


def write(tmp_path: Path, old: str, new: str) -> Path:
    path = tmp_path / "mine.yaml"
    assert old in RIGHT
    path.write_text(RIGHT.replace(old, new))
    return path


def test_all_is_right_before_it_is_made_wrong(tmp_path: Path) -> None:
    config = read_config(write(tmp_path, "", ""))
    assert (config.training.steps, config.shac.learning_rate) == (1_000_000, 3e-4)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        (
            "steps: 1e6",
            "stepps: 1e6",
            7,
            ["training.stepps is not", "did you mean steps?", "allowed are seed"],
        ),
        ("shac:", "sac:\n  horizon: 3\nshac:", 13, ["sac.horizon", "did you mean shac.horizon?"]),
        ("training:", "train:", 6, ["train is not a setting", "did you mean training?"]),
        ("algorithm: shac", "algorithm: shak", 2, ["algorithm is 'shak'", "did you mean shac?"]),
        ("hanging-inverted", "hanging-invertd", 4, ["equilibrium", "did you mean hanging-inverted?"]),
        ("{k1: 120}", "{k11: 120}", 5, ["'k11'", "did you mean k1?"]),
        ("{k1: 120}", "{k1: stiff}", 5, ["environment.parameters.k1", "'stiff'", "must be a number"]),
        ("{k1: 120}", "{k1: -1}", 5, ["k1", "-1", "must be"]),
        ("{k1: 120}", "{k1: 0}", 4, ["must have k1 > 0 to hold the masses"]),
        ("steps: 1e6", "steps: 1e6\n  normalise_reward: 1", 8, ["training.normalise_reward is 1", "boolean"]),
        ("steps: 1e6", "steps: 0", 7, ["training.steps is 0", "greater than 0"]),
        ("steps: 1e6", "steps: [1, 2]", 7, ["training.steps is [1, 2]", "integer"]),
        ("steps: 1e6", "steps: 1e6\n  start_scales: [2, 1]", 8, ["start_scales", "first must not be larger"]),
        ("    - 0.3", "    - -0.3", 11, ["observation.scales.1 is -0.3", "greater than 0"]),
        ("learning_rate: 3e-4", "learning_rate: .inf", 13, ["shac.learning_rate", "finite"]),
        ("learning_rate: 3e-4", "gamma: 1", 13, ["shac.gamma is 1", "less than 1"]),
        ("learning_rate: 3e-4", "horizon: 32\n  horizon: 16", 14, ["horizon is there twice", "line 13"]),
        ("learning_rate: 3e-4", "gamma: 0.9\n gamma: 0.8", 14, ["not YAML"]),
        ("learning_rate: 3e-4", "horizon: &same 3\n  batch_size: *same", 14, ["alias *same"]),
        ("learning_rate: 3e-4", "horizon: !!python/name:os.system", 13, ["tag:yaml.org,2002:python/name"]),
        ("shac:", "network: {layers: [100000]}\nshac:", 12, ["network.layers.0 is 100000", "4096"]),
    ],
)
def test_file_line_and_suggestion_are_given(old: str, new: str, line: int, words: list[str], tmp_path: Path) -> None:
    path = write(tmp_path, old, new)
    with pytest.raises(ValueError) as caught:
        read_config(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in (str(path), f"line {line}", *words):
        assert word in message


def test_a_change_is_named_instead_of_the_line_that_it_replaces(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^change 'training.steps=many': training.steps is 'many'"):
        read_config(write(tmp_path, "", ""), ["training.steps=many"])


def test_what_explodes_or_is_no_text_is_refused(tmp_path: Path) -> None:
    levels = "\n".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in itertools.pairwise("abcdefghij"))
    for text, words in (
        (f"a: &a [1]\n{levels}\n", "alias"),
        ("[" * 100_000, "nested too deep"),
        ("task: " + "9" * 5000, "not YAML"),
        ("task: 2024-99-99", "month"),
        ("# " + "x" * 1_000_000, "no file of at most"),
        ("task: \x00", "not YAML"),
    ):
        path = tmp_path / "bomb.yaml"
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_config(path)
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ValueError, match="not YAML"):
        read_config(path)
    with pytest.raises(ValueError, match="no file of at most"):
        read_config(tmp_path)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: str(path.relative_to(FOLDER).with_suffix("")))
def test_each_shipped_config_trains(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from agents.training import train

    monkeypatch.chdir(FOLDER.parent)  # from where paths in configs count
    given = read_config(path)
    changes = ["training.environments=16", "training.checkpoint_every=256"]
    if given.algorithm == "ppo":
        changes += ["ppo.n_steps=16", "ppo.batch_size=128", "training.steps=512"]
    elif given.algorithm == "shac":
        changes += [f"training.steps={16 * 2 * given.shac.horizon}"]
        if given.training.starts_along and not Path(given.training.starts_along).exists():  # another command writes it
            np.savez(tmp_path / "plans.npz", states=np.tile(equilibrium(Parameters(), "inverted-hanging"), (3, 1)))
            changes += [f"training.starts_along={tmp_path / 'plans.npz'}"]
    else:
        changes += [f"{given.algorithm}.{change}" for change in ("learning_starts=64", "batch_size=64")]
        changes += [f"{given.algorithm}.gradient_steps=1", "training.steps=160"]
    policy = train(read_config(path, changes), tmp_path / "run", progress=False)
    actions = policy.predict(policy.reference + 0.01 * np.ones((3, 18)))[0]
    assert actions.shape == (3, 3)
    assert np.isfinite(actions).all()
