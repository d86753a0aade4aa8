"""The trainings of agents/sweep.py by Ray Tune, on this machine or all over a cluster."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.config import check_config
from agents.files import read_arrays
from agents.measures import measures_of
from agents.ray_start import ray_running
from agents.sweep import SCORES, Member, member_folder, train_and_score

TUNE = "tune"
"""Folder of Tune's own records, in that of the sweep."""
RETRIES = 3


def run_by_tune(
    members: Sequence[Member], folder: Path, starts: int, *, processes: int = 2, address: str | None = None
) -> None:
    """Train and score all members, which are all combinations of their settings' values.

    After an interruption the same call goes on. On a cluster `folder` must be one that all its machines share. A
    training whose machine is lost is taken up again, from its own last checkpoint, up to RETRIES times.

    Raises ValueError where trainings failed, or where the folder holds another sweep.
    """
    folder = folder.resolve()
    keys = list(members[0].settings)
    values = {key: list(dict.fromkeys(member.settings[key] for member in members)) for key in keys}
    jobs = {
        str(member_folder(member.settings)): {
            "config": member.config.model_dump(mode="json"),
            "folder": str(member.folder.resolve()),
            "starts": starts,
        }
        for member in members
    }
    with ray_running(address, processes):
        from ray import tune

        trainable = tune.with_resources(tune.with_parameters(_trial, jobs=jobs), {"cpu": 1})
        path = str(folder / TUNE)
        if tune.Tuner.can_restore(path):
            tuner = tune.Tuner.restore(path, trainable=trainable, resume_errored=True)
        else:
            tuner = tune.Tuner(
                trainable,
                param_space={key: tune.grid_search(texts) for key, texts in values.items()},
                run_config=tune.RunConfig(
                    name=TUNE,
                    storage_path=str(folder),
                    failure_config=tune.FailureConfig(max_failures=RETRIES),
                    verbose=1,
                ),
            )
        results = tuner.fit()
        errors = {_named(result.config): " ".join(str(result.error).split()) for result in results if result.error}
        done = {str(_named(result.config)) for result in results}
    if errors:
        told = "; ".join(f"{name}: {error}" for name, error in errors.items())
        raise ValueError(f"{len(errors)} of {len(members)} trainings failed: {told}")
    if done != set(jobs):
        raise ValueError(f"folder is {str(folder)!r}, which holds another sweep ({', '.join(sorted(done))})")


def _named(settings: Mapping[str, Any] | None) -> Path:
    return member_folder({key: str(value) for key, value in (settings or {}).items()})


def _trial(settings: Mapping[str, str], jobs: Mapping[str, Mapping[str, Any]]) -> None:
    """One training, in a process of Ray's."""
    from ray import tune

    job = jobs[str(member_folder(settings))]
    train_and_score(**job)
    measures = measures_of(check_config(job["config"]).environment_id).each
    scores = read_arrays(Path(job["folder"]) / SCORES)
    means = {measure.name: float(scores[measure.name].mean()) for measure in measures}
    tune.report({name: mean for name, mean in means.items() if math.isfinite(mean)})  # inf: not reached
