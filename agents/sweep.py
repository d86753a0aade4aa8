"""Several trainings of one config, with some seeds and settings to try, and one table with intervals over the seeds.

What runs them is either a pool of processes on this machine (`run_in_processes`) or Ray Tune (agents/tune_sweep.py).
Each has a run folder of its own, goes on by itself where it stopped, and isn't done twice.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm  # type: ignore[import-untyped]

from agents import commands
from agents.config import Config, check_config, read_config
from agents.entries import file_name
from agents.evaluation import score, summary_rows
from agents.files import read_arrays, write_csv, write_text
from agents.measures import measures_of
from agents.tables import score_table

SCORES = "scores.npz"
STARTS = 100
SEED = "training.seed"


@dataclass(frozen=True)
class Member:
    """One training: its settings beside those of the config (with the seed), its config and its run folder."""

    settings: Mapping[str, str]
    config: Config
    folder: Path

    @property
    def variant(self) -> str:
        """What it has in common with the other seeds."""
        return ", ".join(f"{key}={value}" for key, value in self.settings.items() if key != SEED)


def grid(tries: Sequence[Sequence[str]], seeds: Sequence[int]) -> dict[str, list[str]]:
    """Each setting with its values, the seed last, from texts such as ["ppo.gamma=0.98", "0.99"].

    Raises ValueError for a text without a setting, or anything that is there twice.
    """
    values: dict[str, list[str]] = {}
    for first, *others in tries:
        key, equals, value = first.partition("=")
        if not equals or not key or key == SEED:
            raise ValueError(f"try is {first!r}; allowed is section.key=value and further values, but not {SEED}")
        if key in values:
            raise ValueError(f"try has {key} twice; allowed is once, with all its values")
        values[key] = [value, *others]
    values[SEED] = [str(seed) for seed in seeds]
    for key, texts in values.items():
        if len(set(texts)) < len(texts):
            raise ValueError(f"{key} is to be {', '.join(texts)}; allowed are values that differ")
    return values


def members_of(path: Path, changes: Sequence[str], values: Mapping[str, Sequence[str]], folder: Path) -> list[Member]:
    """Every combination of the values. Raises ValueError where one of them makes no config."""
    members = []
    for chosen in itertools.product(*values.values()):
        settings = dict(zip(values, chosen, strict=True))
        config = read_config(path, [*changes, *(f"{key}={value}" for key, value in settings.items())])
        members.append(Member(settings, config, folder / member_folder(settings)))
    return members


def member_folder(settings: Mapping[str, str]) -> Path:
    """Where a training lies within the folder of all."""
    names = [file_name(f"{key}={value}") for key, value in settings.items() if key != SEED]
    return Path(*names, f"seed{settings[SEED]}")


def train_and_score(config: Mapping[str, Any], folder: str, starts: int) -> None:
    """Train a config, given as plain data, and play it on unseen starts; what has been done before isn't done again."""
    from agents.training import train  # slow to import, and not needed by who only hands out work

    checked = check_config(config)
    policy = train(checked, folder, progress=False)
    score(policy, checked.environment_id, checked.environment.arguments(), Path(folder) / SCORES, starts)


def run_in_processes(members: Sequence[Member], processes: int, starts: int, *, progress: bool = True) -> None:
    """Train and score all, so many at a time, each in a process of its own.

    One that fails doesn't keep the others from being done; then ValueError says which failed, and why.
    """
    if processes < 1:
        raise ValueError(f"processes is {processes}; allowed is a number from 1 on")
    failures = []
    spawn = multiprocessing.get_context("spawn")  # a fork would copy torch's and numba's threads half alive
    with ProcessPoolExecutor(processes, mp_context=spawn) as pool:
        tasks = {
            pool.submit(train_and_score, member.config.model_dump(mode="json"), str(member.folder), starts): member
            for member in members
        }
        try:
            for task in tqdm(as_completed(tasks), "trainings", len(tasks), disable=not progress):
                error = task.exception()
                if error is not None:
                    failures.append(f"{tasks[task].folder}: {' '.join(str(error).split())}")
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    if failures:
        raise ValueError(f"{len(failures)} of {len(members)} trainings failed: {'; '.join(failures)}")


def write_table(members: Sequence[Member], folder: Path) -> str:
    """The table of all: a row for each variant, with intervals over its seeds and the starts; in files too."""
    variants: dict[str, list[dict[str, Any]]] = {}
    for member in members:
        variants.setdefault(member.variant, []).append(read_arrays(member.folder / SCORES))
    environment_id = members[0].config.environment_id
    measures = measures_of(environment_id).each
    values = {
        f"{variant or 'policy'} ({len(of_seeds)} seed{'s' if len(of_seeds) > 1 else ''})": {
            measure.name: np.stack([scores[measure.name] for scores in of_seeds]) for measure in measures
        }
        for variant, of_seeds in variants.items()
    }
    text = score_table(values, measures)
    write_text(folder / "table.md", text + "\n")
    write_csv(folder / "summary.csv", summary_rows(values, environment_id))
    return text


def add_options(parser: argparse.ArgumentParser) -> None:
    """What the scripts of both have in common."""
    parser.add_argument("config", type=Path, help="config file, such as configs/damping-ppo.yaml")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="(default: 0 1 2)")
    parser.add_argument(
        "--try",
        dest="tries",
        action="append",
        nargs="+",
        default=[],
        metavar="SECTION.KEY=VALUE",
        help="values of a setting to try, for example --try ppo.gamma=0.98 0.99; may be given many times",
    )
    parser.add_argument("--processes", type=int, default=2, help="trainings at a time on this machine (default: 2)")
    parser.add_argument("--starts", type=int, default=STARTS, help=f"unseen ones to score on (default: {STARTS})")
    parser.add_argument("--folder", type=Path, help="of all run folders (default: runs/sweep-CONFIG)")
    commands.add_changes(parser)


def members_from(options: argparse.Namespace) -> tuple[list[Member], Path]:
    """The trainings that a command line asks for, and the folder of all."""
    if options.starts < 1:
        raise ValueError(f"starts is {options.starts}; allowed is a number from 1 on")
    folder = options.folder or Path("runs") / f"sweep-{options.config.stem}"
    return members_of(options.config, options.changes, grid(options.tries, options.seeds), folder), folder
