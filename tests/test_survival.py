"""Trainings that are killed, stopped, or run out of disk go on as if nothing had been, to the last bit.

Each training here is a process of its own: a fork, which has everything imported already. More kills than the few of
`make test`: python -m pytest tests/test_survival.py --kills 20 -s
"""

from __future__ import annotations

import errno
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from agents import commands, runs, torch_file
from agents.config import Config, default_path, read_config
from agents.files import TEMPORARY, read_arrays, read_csv
from agents.training import train

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

ROOT = Path(__file__).resolve().parent.parent
HINT = "the same command goes on"
COMMON = ["training.environments=8", "training.checkpoint_every=256", "network.layers=[8, 8]"]
REPLAY = ("learning_starts=600", "batch_size=32", "gradient_steps=1", "buffer_size=1000")
SETTINGS = {
    "ppo": ["training.steps=4096", "ppo.n_steps=32", "ppo.batch_size=64", "ppo.n_epochs=2", "observation.scales=null"],
    "sac": ["training.steps=1536", *(f"sac.{setting}" for setting in REPLAY)],
    "tqc": ["training.steps=768", *(f"tqc.{setting}" for setting in REPLAY)],
    "shac": [
        "training.steps=4096",
        "shac.horizon=16",
        "shac.batch_size=64",
        "training.start_scales=[0.5, 1.5]",
        "environment.randomise={m2: [0.5, 1.5], k1: [50, 200]}",
    ],
}


def config_of(algorithm: str, *changes: str) -> Config:
    return read_config(default_path("damping", algorithm), [*COMMON, *SETTINGS[algorithm], *changes])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, float]]:
    """The folder of a training that nothing has interrupted, and how long it took, s."""
    done: dict[str, tuple[Path, float]] = {}

    def of(algorithm: str) -> tuple[Path, float]:
        if algorithm not in done:
            folder = tmp_path_factory.mktemp("whole") / algorithm
            train(config_of(algorithm, "training.steps=64"), folder.with_name("warm"), progress=False)  # compiles
            began = time.monotonic()
            train(config_of(algorithm), folder, progress=False)
            done[algorithm] = folder, time.monotonic() - began
        return done[algorithm]

    return of


class Child:
    """A training in a process of its own, as scripts/train.py runs it; what it says goes into a file."""

    def __init__(
        self, config: Config, folder: Path, prepare: Callable[[], Any] = lambda: None, says: Path | None = None
    ) -> None:
        self.says = says or folder.with_name(f"{folder.name}.txt")
        self.process = multiprocessing.get_context("fork").Process(target=self._work, args=(config, folder, prepare))
        self.process.start()

    def _work(self, config: Config, folder: Path, prepare: Callable[[], Any]) -> None:
        with self.says.open("w") as file:
            os.dup2(file.fileno(), 2)
            sys.stderr = file
            prepare()
            torch.manual_seed(time.time_ns())  # whatever the numbers are that it begins with, they are restored
            commands.run(lambda: train(config, folder, progress=False) and None, HINT)

    def end(self, number: int | None = None) -> tuple[int | None, str]:
        """Send it a signal, wait for its end, and return its status and what it said."""
        if number is not None and self.process.pid is not None:
            os.kill(self.process.pid, number)
        self.process.join()
        return self.process.exitcode, self.says.read_text()


def assert_same(there: Path, here: Path) -> None:
    """Policies, statistics and curves of two run folders have the same bits, but for the seconds."""
    first, second = (torch.load(folder / runs.POLICY, weights_only=True) for folder in (there, here))
    assert list(first) == list(second)
    for name, weights in first.items():
        assert torch.equal(weights, second[name]), name
    first, second = (read_arrays(folder / runs.NORMALISATION) for folder in (there, here))
    for name, values in first.items():
        assert values.tobytes() == second[name].tobytes(), name
    first, second = (
        [{name: text for name, text in row.items() if name != "seconds"} for row in read_csv(folder / runs.CURVE)]
        for folder in (there, here)
    )
    assert first == second
    assert runs.read_record(here)["finished"]
    assert not (here / runs.CHECKPOINT).exists()
    assert not list(here.glob(f".*{TEMPORARY}"))


def checkpoint_steps(folder: Path) -> int:
    return int(torch_file.read(folder / runs.CHECKPOINT)["steps"])


def age_of(path: Path) -> int:
    """When a file was written, ns; 0 where there is none."""
    return path.stat().st_mtime_ns if path.exists() else 0


def wait_for(path: Path, newer_than: int = 0) -> None:
    """Until a file is there that was written after a time."""
    until = time.monotonic() + 120.0
    while age_of(path) <= newer_than:
        assert time.monotonic() < until, f"{path.name} does not come"
        time.sleep(0.001)


@pytest.mark.parametrize("algorithm", SETTINGS)
def test_killed_at_any_moment_it_goes_on_with_the_same_bits(
    algorithm: str, whole: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    kills, seed = request.config.getoption("--kills"), request.config.getoption("--kill-seed")
    there, seconds = whole(algorithm)
    moments = np.random.default_rng([seed, len(algorithm), kills])
    folder = tmp_path / "run"
    killed = while_writing = runs_compared = resumed = 0
    while True:
        resumed += (folder / runs.CHECKPOINT).exists()
        child = Child(config_of(algorithm), folder)
        if killed == kills:
            assert child.end() == (0, "")
            break
        time.sleep(moments.uniform(0.0, 0.5 * seconds))
        status, said = child.end(signal.SIGKILL)
        if status == -signal.SIGKILL:
            killed += 1
            while_writing += bool(list(folder.glob(f".*{TEMPORARY}")))
        else:  # it was done before, and here is the next one
            assert (status, said) == (0, "")
            assert_same(there, folder)
            runs_compared += 1
            shutil.rmtree(folder)
    assert_same(there, folder)
    print(
        f"\n{algorithm}: {killed} of {kills} kills survived, {while_writing} of them in the midst of writing a file; "
        f"{resumed} times taken up from a checkpoint; {runs_compared + 1} policies have the bits of the one that was "
        "never interrupted"
    )


@pytest.mark.parametrize(("algorithm", "number"), [("ppo", signal.SIGTERM), ("shac", signal.SIGINT)])
def test_signals_end_it_at_a_checkpoint(algorithm: str, number: int, whole: Any, tmp_path: Path) -> None:
    there, _ = whole(algorithm)
    folder = tmp_path / "run"
    for _ in range(2 if algorithm == "shac" else 1):
        before = age_of(folder / runs.CURVE)
        child = Child(config_of(algorithm, "training.checkpoint_every=1000000"), folder)
        wait_for(folder / runs.CURVE, before)  # it is at work
        status, said = child.end(number)
        assert status == 128 + number
        steps = checkpoint_steps(folder)
        name = signal.Signals(number).name
        assert said == f"\nstopped by {name} after {steps:,} steps, which are kept in {folder}: {HINT}\n"
        assert not runs.read_record(folder)["finished"]
    (folder / runs.CONFIG).write_text(config_of(algorithm).to_yaml())
    assert Child(config_of(algorithm), folder).end() == (0, "")
    assert_same(there, folder)


def test_the_command_says_how_to_go_on(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    command = [sys.executable, ROOT / "scripts" / "train.py", "damping", "--algo", "shac", "--folder", folder]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    wait_for(folder / runs.CURVE)
    process.terminate()
    _, said = process.communicate()
    assert process.returncode == 143
    assert "Traceback" not in said
    assert said.splitlines()[-1].startswith("stopped by SIGTERM after ")
    assert said.endswith("the same command goes on from there\n")
    assert checkpoint_steps(folder) == int(read_csv(folder / runs.CURVE)[-1]["steps"])


def test_a_full_disk_is_said_in_one_line_and_the_last_checkpoint_is_whole(whole: Any, tmp_path: Path) -> None:
    there, _ = whole("sac")
    folder = tmp_path / "run"
    # The checkpoint grows with the replay buffer until it is larger than a file may be.
    limit = 170_000
    status, said = Child(
        config_of("sac"), folder, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    ).end()
    assert status == 2
    assert said == f"error: {folder / runs.CHECKPOINT} can't be written: File too large; what was there is kept\n"
    assert 0 < checkpoint_steps(folder) < 1000
    assert not list(folder.glob(f".*{TEMPORARY}"))
    assert Child(config_of("sac"), folder).end() == (0, "")
    assert_same(there, folder)


@pytest.mark.parametrize("moment", [1, 3, 12])
def test_no_space_at_any_file_keeps_the_others(
    moment: int, whole: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    there, _ = whole("shac")
    folder = tmp_path / "run"
    real, calls = os.fsync, []

    def fsync(handle: int) -> None:
        calls.append(handle)
        if len(calls) == moment:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(OSError, match=rf"^{folder}/[a-z.]* can't be written: No space left on device; what was there"):
        train(config_of("shac"), folder, progress=False)
    monkeypatch.undo()
    train(config_of("shac"), folder, progress=False)
    assert_same(there, folder)


@pytest.fixture
def unwritable() -> Iterator[Path]:
    """A folder that can be read and not written; root, who can write anywhere, has to be somebody else meanwhile."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o555)
    try:
        yield folder
    finally:
        folder.chmod(0o755)
        shutil.rmtree(folder)


def test_an_unwritable_folder_is_said_in_one_line(unwritable: Path, tmp_path: Path) -> None:
    def become_somebody_else() -> None:
        if os.geteuid() == 0:
            os.seteuid(65534)

    for name, words in ((".", "config.yaml can't be written"), ("new", "new can't be made")):
        child = Child(config_of("shac"), unwritable / name, become_somebody_else, tmp_path / "said.txt")
        status, said = child.end()
        assert status == 2
        assert said.startswith(f"error: {unwritable}/{words}: Permission denied")
        assert said.count("\n") == 1
        assert not list(unwritable.iterdir())


def test_two_trainings_keep_out_of_each_other_s_folder(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with (
        runs.locked(folder),
        pytest.raises(ValueError, match="in which another training is at work"),
    ):
        train(config_of("shac"), folder, progress=False)
    assert not list(folder.iterdir())
