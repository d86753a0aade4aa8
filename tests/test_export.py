"""Exported policies act as what they are made from; archives of Stable-Baselines3 are loaded for --trust alone."""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import agents
from agents import runs, trusted
from agents.algorithms import make_network
from agents.config import default_path, read_config
from agents.export import describe, write_numpy, write_onnx
from agents.files import read_arrays, write_arrays
from agents.numpy_actor import NumpyActor
from agents.policy import LearnedPolicy
from agents.rollout import roll_out

ROOT = Path(__file__).resolve().parent.parent


def policy_of(name: str) -> LearnedPolicy:
    """A shipped policy, or one that nothing has trained, with all weights random: ALGORITHM-ACTIVATION."""
    if name in runs.SHIPPED_NAMES:
        return agents.load(name)
    algorithm, activation = name.split("-")
    torch.manual_seed(3)
    random = np.random.default_rng(3)
    config = read_config(default_path("damping", algorithm), [f"network.activation={activation}"])
    reference = agents.load("damping").reference
    mean, variance = random.standard_normal(18), random.uniform(0.01, 1.0, 18)
    return LearnedPolicy(config, make_network(config, 3), reference, mean, variance)


def numpy_actions(policy: LearnedPolicy, folder: Path) -> Callable[[Any], Any]:
    write_numpy(policy, folder / "actor.npz")
    actor = NumpyActor.load(folder)
    return lambda observations: actor.predict(observations)[0]


def onnx_actions(policy: LearnedPolicy, folder: Path) -> Callable[[Any], Any]:
    pytest.importorskip("onnx")
    write_onnx(policy, folder / "policy.onnx")
    if importlib.util.find_spec("onnxruntime"):
        import onnxruntime

        session = onnxruntime.InferenceSession(folder / "policy.onnx")
        return lambda observations: session.run(["action"], {"observation": observations})[0]
    from onnx.reference import ReferenceEvaluator

    evaluator = ReferenceEvaluator(str(folder / "policy.onnx"))
    return lambda observations: evaluator.run(["action"], {"observation": observations})[0]


@pytest.mark.parametrize("export", [numpy_actions, onnx_actions])
@pytest.mark.parametrize("name", [*runs.SHIPPED_NAMES, "ppo-tanh", "ppo-relu", "sac-silu", "tqc-relu"])
def test_an_exported_policy_acts_alike(name: str, export: Any, tmp_path: Path) -> None:
    policy = policy_of(name)
    actions = export(policy, tmp_path)
    for scale in (0.05, 0.3, 1.0, 3.0):
        observations = policy.reference + scale * np.random.default_rng(0).standard_normal((2000, 18))
        expected = policy.predict(observations)[0]
        assert (np.abs(expected) < 1.0).any()
        assert np.ptp(expected) > 0.01
        found = actions(observations)
        assert found.shape == expected.shape
        assert found.dtype == np.float64
        assert np.abs(found - expected).max() < 1e-6
        one = actions(observations[:1])
        assert np.abs(one - policy.predict(observations[0])[0]).max() < 1e-6


@pytest.mark.parametrize("name", ["damping", "inverted-inverted"])
def test_it_acts_alike_wherever_episodes_lead(name: str, tmp_path: Path) -> None:
    policy = agents.load(name)
    arguments = policy.config.environment.arguments()
    states = roll_out(policy, policy.config.environment_id, arguments, range(20)).states
    visited = states[np.isfinite(states).all(axis=-1)]
    assert len(visited) > 1000
    found = numpy_actions(policy, tmp_path)(visited)
    assert np.abs(found - policy.predict(visited)[0]).max() < 1e-6


def test_both_exports_compute_the_same(tmp_path: Path) -> None:
    policy = agents.load("inverted-inverted")
    observations = policy.reference + 3.0 * np.random.default_rng(1).standard_normal((2000, 18))
    first, second = (export(policy, tmp_path)(observations) for export in (numpy_actions, onnx_actions))
    assert np.abs(first - second).max() < 1e-11


def test_the_actor_needs_numpy_alone_and_the_script_writes_it(tmp_path: Path) -> None:
    script = [sys.executable, ROOT / "scripts" / "export.py", "damping", "--folder", tmp_path]
    said = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    assert f"for NumPy: {tmp_path / 'actor.npz'}\n" in said
    assert ("for ONNX" in said) == bool(importlib.util.find_spec("onnx"))
    code = f"""
import sys
for name in ("torch", "stable_baselines3", "yaml", "pydantic", "numba", "scipy", "gymnasium"):
    sys.modules[name] = None
from agents.numpy_actor import NumpyActor
actor = NumpyActor.load({str(tmp_path)!r})
print(*actor.predict(actor.reference + 0.1)[0])
"""
    said = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    policy = agents.load("damping")
    assert np.abs(np.array(said.split(), float) - policy.predict(policy.reference + 0.1)[0]).max() < 1e-6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gain": np.full((3, 18), np.nan)}, "gain is float64"),
        ({"gain": np.zeros((3, 17))}, "gain is float64"),
        ({"weight.1": np.zeros((3, 5))}, "weight.1 is float64"),
        ({"about": np.array("{}")}, "format is not"),
        ({"about": np.array("[" * 3000)}, "actor.npz is not an exported policy"),
        ({"about": np.array([{}], dtype=object)}, "pickled objects"),
        ({"reference": None}, "reference"),
    ],
)
def test_doctored_exports_are_refused(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    arrays = describe(agents.load("damping")) | change
    write_arrays(tmp_path / "actor.npz", {name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(ValueError, match=words):
        NumpyActor.load(tmp_path)


# Archives of Stable-Baselines3


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any, Any]:
    """An archive as the Zoo leaves it, its model and its normalising wrapper."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from agents.sb3 import SpringPendulumVecEnv

    folder = tmp_path_factory.mktemp("zoo")
    env = VecNormalize(SpringPendulumVecEnv("SpringPendulumDamping-v0", 4))
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1, seed=0)
    model.learn(256)
    model.save(folder / "SpringPendulumDamping-v0.zip")
    (folder / "SpringPendulumDamping-v0").mkdir()
    env.save(str(folder / "SpringPendulumDamping-v0" / "vecnormalize.pkl"))
    return folder / "SpringPendulumDamping-v0.zip", model, env


def test_a_trusted_archive_acts_as_its_model(archive: Any) -> None:
    path, model, env = archive
    policy = trusted.load(path, "SpringPendulumDamping-v0", "xyz", trust=True)
    raw = agents.load("damping").reference + 0.3 * np.random.default_rng(0).standard_normal((20, 18))
    expected = model.predict(env.normalize_obs(raw), deterministic=True)[0]
    assert np.ptp(expected) > 0.0
    assert np.array_equal(policy.predict(raw)[0], expected.astype(float))
    with pytest.raises(ValueError, match=r"gives \(3,\); allowed are \(18,\) and \(1,\)"):
        trusted.load(path, "SpringPendulumDamping-v0", "x", trust=True)


def test_an_archive_is_never_loaded_unasked(tmp_path: Path, archive: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    class Bomb:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(tmp_path / "BOOM"),)

    import base64

    monkeypatch.chdir(tmp_path)
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(archive[0]) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.infolist():
            content = old.read(entry)
            if entry.filename == "data":
                data = json.loads(content)
                data["policy_kwargs"] = {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(Bomb())).decode()}
                content = json.dumps(data).encode()
            new.writestr(entry.filename, content)
    for action in (
        lambda: agents.load(path),
        lambda: trusted.load(path, "SpringPendulumDamping-v0", "xyz", trust=False),
    ):
        with pytest.raises(ValueError, match="--trust"):
            action()
    for script in (["evaluate.py", path], ["watch.py", path, "--figures", tmp_path / "figures"]):
        command = [sys.executable, ROOT / "scripts" / script[0], *script[1:]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert "--trust" in done.stderr
        assert done.stderr.count("\n") == 1
    assert not (tmp_path / "BOOM").exists()
    with pytest.raises(ValueError, match="can't be loaded by Stable-Baselines3"):
        trusted.load(path, "SpringPendulumDamping-v0", "xyz", trust=True)
    assert (tmp_path / "BOOM").exists()  # which is what the word is for


@pytest.mark.parametrize("content", [b"", b"PK", None])
def test_what_is_no_archive_is_said(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "no.zip"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ValueError, match="is no archive of Stable-Baselines3"):
        trusted.load(path, "SpringPendulumDamping-v0", "xyz", trust=True)


def test_exports_are_plain(tmp_path: Path) -> None:
    write_numpy(agents.load("damping"), tmp_path / "actor.npz")
    assert all(array.dtype.kind in "fU" for array in read_arrays(tmp_path / "actor.npz").values())
