"""Doctored files: each is refused with a clear error, and nothing that it holds is run."""

from __future__ import annotations

import io
import json
import os
import pickle
import shutil
import tracemalloc
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import agents
from agents import runs, torch_file
from agents.checkpoints import Checkpoints
from agents.config import default_path, read_config
from agents.files import read_arrays, write_arrays
from agents.stopping import Stop, Stopped
from agents.training import train

MOST_MEMORY = 50_000_000
"""Bytes that refusing a file may take; the bombs below stand for more."""

TINY = ["training.steps=256", "training.environments=8", "network.layers=[8, 8]"]
CONFIGS = {
    "ppo": read_config(default_path("damping", "ppo"), [*TINY, "ppo.n_steps=16", "ppo.batch_size=64"]),
    "shac": read_config(default_path("damping", "shac"), [*TINY, "shac.horizon=16"]),
}


class Bomb:
    """Runs when it is unpickled: makes a folder of the name BOOM."""

    def __reduce__(self) -> Any:
        return os.mkdir, ("BOOM",)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Finished runs, ppo and shac, and one that was stopped, stopped-ppo and stopped-shac."""
    folder = tmp_path_factory.mktemp("kept")
    ask = pytest.MonkeyPatch()
    for name, config in CONFIGS.items():
        train(config, folder / name, progress=False)
        between = Checkpoints.between

        def stop_in_the_middle(self: Checkpoints, steps: int, between: Any = between) -> None:
            if steps >= 128:
                self._stop.asked = 2
            between(self, steps)

        ask.setattr(Checkpoints, "between", stop_in_the_middle)
        with pytest.raises(Stopped):
            train(config, folder / f"stopped-{name}", progress=False)
        ask.undo()
    return folder


@pytest.fixture
def run(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of a finished run, to be doctored. All kinds of policies are loaded by the same lines."""
    monkeypatch.chdir(tmp_path)  # where a bomb would go off
    return Path(shutil.copytree(kept / "shac", tmp_path / "run"))


@pytest.fixture(params=CONFIGS)
def stopped(request: pytest.FixtureRequest, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of a run that was stopped."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(kept / f"stopped-{request.param}", tmp_path / "run"))


# Files of weights


def saved(content: Any, **how: Any) -> bytes:
    buffer = io.BytesIO()
    torch.save(content, buffer, **how)
    return buffer.getvalue()


def rezipped(
    data: bytes, change: Callable[[str, bytes], bytes | None], more: dict[str, bytes] | None = None, **how: Any
) -> bytes:
    """The zip with each entry changed, those left out for which nothing is returned, and some more."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(buffer, "w", **how) as new:
        for entry in old.infolist():
            changed = change(entry.filename, old.read(entry))
            if changed is not None:
                new.writestr(entry.filename, changed)
        for name, content in (more or {}).items():
            new.writestr(name, content)
    return buffer.getvalue()


def with_structure(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """With another data.pkl."""
    return rezipped(data, lambda name, content: change(content) if name.endswith("data.pkl") else content)


def weights_of(data: bytes) -> OrderedDict[str, torch.Tensor]:
    weights: OrderedDict[str, torch.Tensor] = torch.load(io.BytesIO(data), weights_only=True)
    return weights


def changed(data: bytes, change: Callable[[OrderedDict[str, torch.Tensor], str], Any]) -> bytes:
    """With the weights changed by a function of them and of the name of the last one."""
    weights = weights_of(data)
    change(weights, next(reversed(weights)))
    return saved(weights)


def declaring(data: bytes, size: int) -> bytes:
    """With a storage that says that it is larger than its entry, and a tensor that takes all of it."""
    first = next(iter(weights_of(data).values()))
    count = bytes([ord("K"), first.numel()]) if first.numel() < 256 else b"M" + first.numel().to_bytes(2, "little")
    assert count in data
    return with_structure(data, lambda content: content.replace(count, b"J" + size.to_bytes(4, "little"), 1))


WEIGHTS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "a pickle bomb": (lambda _: pickle.dumps(Bomb()), "zip"),
    "a pickle bomb in torch's old format": (
        lambda _: (buffer := io.BytesIO(), torch.save(Bomb(), buffer, _use_new_zipfile_serialization=False))[
            0
        ].getvalue(),
        "zip",
    ),
    "a pickle bomb in a zip": (lambda _: saved(Bomb()), "'(posix|nt) mkdir'"),
    "a pickle bomb beside the weights": (lambda data: saved(weights_of(data) | {"more": Bomb()}), "mkdir"),
    "a pickle bomb of protocol 4": (
        lambda data: with_structure(data, lambda _: pickle.dumps(Bomb(), 4)),
        "instruction",
    ),
    "a bytearray of a hundred gigabytes": (
        lambda data: with_structure(
            data, lambda _: b"\x80\x02c__builtin__\nbytearray\n\x8a\x05\x00\x00\x00\x00\x19\x85R."
        ),
        "bytearray",
    ),
    "a list of lists of lists": (
        lambda data: with_structure(data, lambda _: b"\x80\x02]q\x00" + b"(h\x00h\x00e" * 50 + b"."),
        "twice",
    ),
    "an endless stack": (lambda data: with_structure(data, lambda _: b"\x80\x02" + b"(" * 100_000 + b"."), "weights"),
    "a structure of many megabytes": (
        lambda data: with_structure(data, lambda _: b"N" * 5_000_000),
        "larger than 4,000",
    ),
    "no instructions": (lambda data: with_structure(data, lambda _: b""), "weights"),
    "a declared size that isn't there": (lambda data: declaring(data, 2**31 - 1), "declared"),
    "a huge shape of one number": (
        lambda data: changed(data, lambda of, last: of.update({last: torch.zeros(1).expand(10**6, 10**6)})),
        "too small|one piece",
    ),
    "another shape": (
        lambda data: changed(data, lambda of, last: of.update({last: torch.zeros(3, 3, 3)})),
        r"is torch.float32 of shape \(3, 3, 3\); allowed",
    ),
    "another kind of number": (
        lambda data: changed(data, lambda of, last: of.update({last: of[last].double()})),
        "is torch.float64",
    ),
    "no tensor": (lambda data: changed(data, lambda of, last: of.update({last: 3})), "no tensor"),
    "not a number": (lambda data: changed(data, lambda of, last: of[last].fill_(torch.nan)), "not finite"),
    "infinite": (lambda data: changed(data, lambda of, last: of[last].fill_(-torch.inf)), "not finite"),
    "a missing tensor": (lambda data: changed(data, lambda of, last: of.pop(last)), "missing or unknown"),
    "one tensor more": (
        lambda data: changed(data, lambda of, _: of.update(more=torch.zeros(1))),
        "missing or unknown: more",
    ),
    "a list": (lambda _: saved([1, 2]), "missing or unknown"),
    "a sparse tensor": (
        lambda data: changed(data, lambda of, last: of.update({last: torch.eye(3).to_sparse()})),
        "neither plain data nor a tensor",
    ),
    "an archive bomb": (
        lambda data: rezipped(
            data, lambda _, content: content, {"archive/data/99": bytes(10**8)}, compression=zipfile.ZIP_DEFLATED
        ),
        "compressed",
    ),
    "an entry that climbs out": (
        lambda data: rezipped(data, lambda _, content: content, {"../../../BOOM": b"!"}),
        "as if it were elsewhere",
    ),
    "an entry at the root": (lambda data: rezipped(data, lambda _, content: content, {"/BOOM": b"!"}), "elsewhere"),
    "two structures": (lambda data: rezipped(data, lambda _, c: c, {"other/data.pkl": b"N."}), "more than one"),
    "a missing entry": (lambda data: rezipped(data, lambda name, c: None if "/data/0" in name else c), "no item named"),
    "a flipped bit": (lambda data: data.replace(b"archive/data/0", b"archive/data/1", 1), "weights"),
    "half of it": (lambda data: data[: len(data) // 2], "zip"),
    "all but the end": (lambda data: data[:-10], "zip"),
    "nothing": (lambda _: b"", "zip"),
    "noise": (lambda _: np.random.default_rng(0).bytes(5000), "zip"),
}


def refused(action: Callable[[], Any], *words: str) -> None:
    """It raises a ValueError of one line with these words, and neither runs a bomb nor takes much memory."""
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="(?s)" + ".*".join(words)) as caught:
            action()
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < MOST_MEMORY
    assert not list(Path.cwd().rglob("BOOM"))
    assert "\n" not in str(caught.value)


def test_the_bomb_would_go_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    torch.load(io.BytesIO(saved(Bomb())), weights_only=False)
    assert (tmp_path / "BOOM").is_dir()


@pytest.mark.parametrize("kind", WEIGHTS)
def test_doctored_weights_are_refused(kind: str, run: Path) -> None:
    doctor, words = WEIGHTS[kind]
    agents.load(run)
    path = run / runs.POLICY
    path.write_bytes(doctor(path.read_bytes()))
    refused(lambda: agents.load(run), "policy.pth does not hold the weights of its config", words)


# The statistics


def npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def statistics_of(data: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(data)) as archive:
        return {name: archive[name] for name in archive.files}


def declaring_shape(shape: str) -> Callable[[str, bytes], bytes]:
    """Changes the header of one array, whose length is kept."""
    old = b"(18,), }" + b" " * (len(shape) - len("(18,)"))
    return lambda name, content: content.replace(old, f"{shape}, }}".encode()) if name == "mean.npy" else content


ARRAYS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "a pickle bomb": (lambda _: pickle.dumps(Bomb()), "zip"),
    "a pickle bomb in an array": (
        lambda data: npz(**statistics_of(data) | {"mean": np.array([Bomb()] * 18, dtype=object)}),
        "pickled objects",
    ),
    "a pickle bomb in place of an array": (
        lambda data: rezipped(data, lambda name, c: pickle.dumps(Bomb()) if name == "mean.npy" else c),
        "magic string",
    ),
    "a huge shape": (lambda data: rezipped(data, declaring_shape("(10000000000000,)")), "declares 80,000,000,000,000"),
    "a negative shape": (lambda data: rezipped(data, declaring_shape("(-18,)")), "declares -"),
    "an archive bomb": (
        lambda data: rezipped(data, lambda _, c: c, {"more.npy": bytes(10**8)}, compression=zipfile.ZIP_DEFLATED),
        "compressed",
    ),
    "an entry that climbs out": (lambda data: rezipped(data, lambda _, c: c, {"../BOOM.npy": b"!"}), "elsewhere"),
    "not a number": (lambda data: npz(**statistics_of(data) | {"mean": np.full(18, np.nan)}), "mean holds nan"),
    "infinite": (lambda data: npz(**statistics_of(data) | {"reference": np.full(18, np.inf)}), "reference holds inf"),
    "a negative variance": (lambda data: npz(**statistics_of(data) | {"variance": -np.ones(18)}), "variance holds -1"),
    "another shape": (lambda data: npz(**statistics_of(data) | {"mean": np.zeros((18, 18))}), r"shape \(18, 18\)"),
    "texts": (lambda data: npz(**statistics_of(data) | {"mean": np.array(["x"] * 18)}), "allowed are 18 numbers"),
    "a missing array": (lambda data: npz(mean=statistics_of(data)["mean"]), "reference"),
    "half of it": (lambda data: data[: len(data) // 2], "zip"),
    "a header cut short": (lambda data: rezipped(data, lambda _, c: c[:20]), "."),
    "nothing": (lambda _: b"", "zip"),
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_doctored_statistics_are_refused(kind: str, run: Path) -> None:
    doctor, words = ARRAYS[kind]
    path = run / runs.NORMALISATION
    path.write_bytes(doctor(path.read_bytes()))
    refused(lambda: agents.load(run), "normalisation.npz is not the statistics of a run", words)


def test_entries_that_overlap_are_refused(tmp_path: Path) -> None:
    """A thousand names for the same bytes."""
    path = tmp_path / "overlapping.npz"
    write_arrays(path, {"a": np.zeros(1000)})
    data = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        start = archive.start_dir
    directory = data[start : data.index(b"PK\x05\x06")]
    count, size = 1000, 1000 * len(directory)
    end = b"PK\x05\x06" + bytes(4) + count.to_bytes(2, "little") * 2 + size.to_bytes(4, "little")
    path.write_bytes(data[:start] + directory * count + end + start.to_bytes(4, "little") + bytes(2))
    with pytest.raises(ValueError, match=r"overlapping.npz is not an .npz of plain arrays"):
        read_arrays(path)


# The config and the record

CONFIG_LINES = {
    "a tag": ("task: !!python/object/apply:os.mkdir [BOOM]", "tag:yaml.org,2002:python/object/apply:os.mkdir"),
    "a tag of a new object": ("guide: !!python/object/new:os.mkdir [BOOM]", "python/object/new"),
    "aliases": ("a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]", "alias"),
    "a key of nobody": ("run_before: rm -rf", "run_before is not a setting"),
    "a network of petabytes": ("network: {layers: [100000000, 100000000]}", "4096"),
    "a network without an end": (f"network: {{layers: {[64] * 1000}}}", "at most 8 items"),
    "nesting": ("[" * 100_000, "nested too deep"),
    "zeros": ("\x00" * 100, "not YAML"),
}


@pytest.mark.parametrize("kind", CONFIG_LINES)
def test_doctored_configs_are_refused(kind: str, run: Path) -> None:
    text, words = CONFIG_LINES[kind]
    path = run / runs.CONFIG
    key = text.split(":")[0]
    kept = [] if "\n" in text or ":" not in text else path.read_text().splitlines()
    others = [line for line in kept if not line.startswith(f"{key}:") or key == "network"]
    if key == "network":  # replaces the section
        start = others.index("network:")
        stop = next(i for i in range(start + 1, len(others)) if not others[i].startswith(" "))
        del others[start:stop]
    path.write_text("\n".join([*others, text]))
    refused(lambda: agents.load(run), "config.yaml", words)


@pytest.mark.parametrize("text", ["[" * 100_000, "{", '{"finished": tru}', "[]", " " * 17_000_000])
def test_a_doctored_record_is_refused(text: str, run: Path) -> None:
    (run / runs.RECORD).write_text(text)
    config = CONFIGS[runs.read_run_config(run).algorithm]
    refused(lambda: train(config, run, progress=False), "run.json")


# Places


@pytest.mark.parametrize("name", [runs.POLICY, runs.NORMALISATION, runs.CONFIG])
def test_links_out_of_the_folder_are_refused(name: str, run: Path, tmp_path: Path) -> None:
    path = run / name
    path.rename(tmp_path / name)
    for target in (tmp_path / name, Path("..") / name, Path("/dev/zero"), tmp_path / "nowhere"):
        path.symlink_to(target)
        refused(lambda: agents.load(run), name, "is a link out of its folder")
        path.unlink()
    path.mkdir()
    refused(lambda: agents.load(run), name, "is no file")
    path.rmdir()
    os.mkfifo(path)
    refused(lambda: agents.load(run), name, "is no file")
    path.unlink()
    (run / "inside").write_bytes((tmp_path / name).read_bytes())
    path.symlink_to("inside")  # this is nobody's harm
    agents.load(run)


# Checkpoints

PARTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "nothing of it": (lambda content: content.clear(), "parts"),
    "no learner": (lambda content: content["parts"].pop("learner"), "learner"),
    "negative steps": (lambda content: content.update(steps=-1), "steps"),
    "steps in words": (lambda content: content.update(steps="many"), "steps"),
    "no random numbers": (lambda content: content.pop("random"), "random"),
    "random numbers of another kind": (lambda content: content["random"].update(python=[1, 2]), "version 1"),
    "torch's random numbers cut short": (
        lambda content: content["random"].update(torch=torch.zeros(3, dtype=torch.uint8)),
        "RNG state",
    ),
    "other pendulums": (lambda content: rows_of(content).update(rows=torch.zeros(1, 2, 3)), "rows is float64|rows is"),
    "a generator that is none": (lambda content: rows_of(content)["starts.generators"].zero_().add_(2), "PCG64"),
}


def rows_of(content: dict[str, Any]) -> dict[str, Any]:
    environments = content["parts"]["environments"]
    rows: dict[str, Any] = environments["rows"] if "rows" in environments else environments["envs"]["rows"]
    return rows


def networks_of(content: dict[str, Any]) -> dict[str, Any]:
    learner = content["parts"]["learner"]
    policy: dict[str, Any] = learner["policy"] if "policy" in learner else learner["parameters"]["policy"]
    return policy


def optimiser_of(content: dict[str, Any]) -> dict[str, Any]:
    learner = content["parts"]["learner"]
    found: dict[str, Any] = (
        learner["value_optimiser"] if "policy" in learner else learner["parameters"]["policy.optimizer"]
    )
    return found


PARTS |= {
    "weights not a number": (lambda content: list(networks_of(content).values())[-1].fill_(torch.nan), "not finite"),
    "weights of another shape": (
        lambda content: networks_of(content).update({next(iter(networks_of(content))): torch.zeros(3, 3)}),
        "size mismatch",
    ),
    "an optimiser of other weights": (
        lambda content: optimiser_of(content)["state"][0].update(exp_avg=torch.zeros(2, 2, 2)),
        "an optimiser's exp_avg",
    ),
    "an optimiser without memory": (lambda content: optimiser_of(content).update(param_groups=[]), "parameter groups"),
}


@pytest.mark.parametrize("kind", PARTS)
def test_doctored_checkpoints_are_refused(kind: str, stopped: Path) -> None:
    change, words = PARTS[kind]
    path = stopped / runs.CHECKPOINT
    content = torch_file.read(path)
    change(content)
    torch_file.write(path, content)
    doctored = path.read_bytes()
    config = CONFIGS[runs.read_run_config(stopped).algorithm]
    refused(lambda: train(config, stopped, progress=False), "checkpoint.pth is no checkpoint of this run", words)
    assert path.read_bytes() == doctored
    assert not (stopped / runs.POLICY).exists()


@pytest.mark.parametrize(
    "kind", ["a pickle bomb", "a pickle bomb in a zip", "an archive bomb", "half of it", "nothing"]
)
def test_files_that_are_no_checkpoints_are_refused(kind: str, stopped: Path) -> None:
    path = stopped / runs.CHECKPOINT
    path.write_bytes(WEIGHTS[kind][0](path.read_bytes()))
    config = CONFIGS[runs.read_run_config(stopped).algorithm]
    refused(lambda: train(config, stopped, progress=False), "checkpoint.pth is not a file of weights and plain data")


def test_a_checkpoint_elsewhere_is_refused(stopped: Path, tmp_path: Path) -> None:
    path = stopped / runs.CHECKPOINT
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    config = CONFIGS[runs.read_run_config(stopped).algorithm]
    refused(lambda: train(config, stopped, progress=False), "checkpoint.pth is a link out of its folder")


def test_what_is_not_doctored_is_taken(stopped: Path) -> None:
    with Stop():
        pass
    config = CONFIGS[runs.read_run_config(stopped).algorithm]
    train(config, stopped, progress=False)
    assert json.loads((stopped / runs.RECORD).read_text())["finished"]
