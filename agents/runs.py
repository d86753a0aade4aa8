"""A run folder: what a training leaves behind, and all that later stages read.

config.yaml         every setting, defaults too
run.json            seed, commit, versions, command line, wall time, steps, whether it is finished
curve.csv           progress, one row for each rollout
policy.pth          weights, a torch state_dict
normalisation.npz   mean and variance of the relative observations, and the equilibrium that they are relative to
checkpoint.pth      while it is unfinished: all that is needed to go on
tensorboard/        where TensorBoard is installed
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from agents.config import Config, read_config
from agents.files import write_json

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
    shipped = is_shipped(str(name_or_folder))
    folder = shipped_folder(str(name_or_folder)) if shipped else Path(name_or_folder)
    if not folder.is_dir():
        available = available_names()
        raise ValueError(
            f"{'policy' if shipped else 'run'} is {str(name_or_folder)!r}, which is not there; allowed are the folder "
            f"of a run made by scripts/train.py and the shipped policies ({', '.join(available) or 'none so far'})"
        )
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
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
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


def seed_of_stretch(config: Config, steps_before: int) -> int:
    """Seed of a stretch of training: one that is taken up again must not see its first starts a second time."""
    if steps_before == 0:
        return config.training.seed
    return int(np.random.SeedSequence((config.training.seed, steps_before)).generate_state(1)[0])


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
