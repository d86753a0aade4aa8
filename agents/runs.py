"""A run folder: what a training leaves behind, and all that later stages read.

config.yaml         every setting, defaults too
run.json            seed, commit, versions, command line, wall time, steps, whether it is finished
curve.csv           progress, one row for each rollout
policy.pth          weights, a torch state_dict
normalisation.npz   mean and variance of the relative observations, and the equilibrium that they are relative to
checkpoint.pth      while it is unfinished: all that is needed to go on
actor.npz           where scripts/export.py was asked: the policy for NumPy ...
policy.onnx         ... and for ONNX
tensorboard/        where TensorBoard is installed
"""

from __future__ import annotations

import contextlib
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from agents.config import Config, read_config
from agents.files import read_json, write_json

if os.name == "posix":
    import fcntl

CONFIG = "config.yaml"
RECORD = "run.json"
CURVE = "curve.csv"
POLICY = "policy.pth"
NORMALISATION = "normalisation.npz"
CHECKPOINT = "checkpoint.pth"
TENSORBOARD = "tensorboard"

ROOT = Path(__file__).resolve().parent.parent
SHIPPED = Path(__file__).resolve().parent / "policies"
SHIPPED_NAMES = ("damping", "hanging-hanging", "hanging-inverted", "inverted-hanging", "inverted-inverted")
RANDOMISED_NAMES = ("damping-randomised", "hanging-inverted-randomised", "inverted-inverted-randomised")
"""Policies of the same tasks that were trained on randomised parameters."""
PACKAGES = ("gymnasium", "numpy", "scipy", "numba", "torch", "stable_baselines3")


def find_run(name_or_folder: str | Path) -> Path:
    """Folder of a shipped policy or of a finished run.

    Raises ValueError where there is neither, or where the folder lacks a file that a run leaves.
    """
    if str(name_or_folder).endswith(".zip"):
        raise ValueError(
            f"run is {str(name_or_folder)!r}, an archive of Stable-Baselines3, which can run code when it is loaded: "
            "scripts/evaluate.py and scripts/watch.py take it with --trust; allowed are also our own run folders"
        )
    shipped = is_shipped(str(name_or_folder))
    folder = shipped_folder(str(name_or_folder)) if shipped else Path(name_or_folder)
    if not folder.is_dir():
        available = available_names()
        raise ValueError(
            f"{'policy' if shipped else 'run'} is {str(name_or_folder)!r}, which is not there; allowed are the folder "
            f"of a run made by scripts/train.py and the shipped policies ({', '.join(available) or 'none so far'})"
        )
    for name in (CONFIG, POLICY, NORMALISATION):
        if is_there(folder / name):
            check_inside(folder / name, folder)
    missing = [name for name in (CONFIG, POLICY, NORMALISATION) if not (folder / name).is_file()]
    if missing:
        unfinished = ", an unfinished one: take it up again with scripts/train.py" if is_unfinished(folder) else ""
        raise ValueError(
            f"run is {str(folder)!r}, which lacks {', '.join(missing)}{unfinished}; "
            "allowed is the folder of a finished run made by scripts/train.py"
        )
    return folder


def is_shipped(name: str) -> bool:
    """Whether this is the name of a shipped policy."""
    return name in SHIPPED_NAMES or name in RANDOMISED_NAMES


def shipped_folder(name: str) -> Path:
    """Where a shipped policy lies; those of the same training with other seeds are in `seeds` beside it."""
    task = name.removesuffix("-randomised")
    return SHIPPED / "randomised" / task if name in RANDOMISED_NAMES else SHIPPED / task


def available_names() -> list[str]:
    """The shipped policies that are there."""
    return [name for name in (*SHIPPED_NAMES, *RANDOMISED_NAMES) if shipped_folder(name).is_dir()]


def is_unfinished(folder: Path) -> bool:
    """Whether a training was begun here and has not come to its end."""
    return (folder / CONFIG).is_file() and not (folder / POLICY).is_file()


def read_run_config(folder: Path) -> Config:
    """Config of a run; raises ValueError where it cannot be read."""
    return read_config(folder / CONFIG)


def read_record(folder: Path) -> dict[str, Any]:
    """run.json, or nothing where there is none yet."""
    path = folder / RECORD
    if not path.is_file():
        return {}
    check_inside(path, folder)
    record = read_json(path)
    if not isinstance(record, dict):
        raise ValueError(f"{path} holds {type(record).__name__}; allowed is a mapping")
    return record


def write_record(
    config: Config, folder: Path, steps: int, seconds: float, *, finished: bool, processor_seconds: float | None = None
) -> None:
    """Write run.json of a training that has done so many environment steps in so many seconds.

    `processor_seconds` are those of one core: what `seconds` would be on a machine with nothing else to do.
    """
    record = {
        "task": config.environment_id,
        "algorithm": config.algorithm,
        "seed": config.training.seed,
        "steps": steps,
        "seconds": round(seconds, 1),
        "finished": finished,
    }
    if processor_seconds is not None:
        record["processor_seconds"] = round(processor_seconds, 1)
    write_json(folder / RECORD, record | provenance())


def is_there(path: Path) -> bool:
    """Whether there is anything of this name, be it a link to nowhere."""
    return path.is_symlink() or path.exists()


def check_inside(path: Path, folder: Path) -> None:
    """Raises ValueError where a file of a run folder is a link to somewhere else, or no file."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{path} is a link out of its folder, to {path.resolve()}; allowed is a file")
    if not path.is_file():
        raise ValueError(f"{path} is no file; allowed is a file")


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a run folder, and keep other trainings out of it as long as this one lives.

    Raises ValueError where another one is in it or it is a file, OSError where it can't be made.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder is {str(folder)!r}, which is a file; allowed is a new folder or that of the same run")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"{folder} can't be made: {error.strerror}") from error
    if os.name != "posix":  # where there is no fcntl
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise ValueError(f"folder is {str(folder)!r}, in which another training is at work") from None
    except OSError:
        pass  # a file system that knows no locks
    try:
        yield
    finally:
        os.close(handle)  # the system does it too when a process is killed


def provenance() -> dict[str, Any]:
    """Where numbers come from: commit, versions, machine and command line."""
    return {
        "commit": _commit(),
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
        "machine": platform.platform(),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
    }


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Commit of the checkout, with "+" where files differ from it; None outside of git."""
    try:
        commit = _git("rev-parse", "HEAD")
        return commit + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
