"""The policies that are shipped: each is a finished run, and does what it is for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import agents
from agents import runs
from agents.config import FOLDER, default_path, read_config
from agents.controller import Controller
from agents.entries import find
from agents.evaluation import FIRST_SEED, TRIALS
from agents.files import read_csv
from agents.lqr import LQR
from agents.measures import MEASURES
from agents.rollout import roll_out

STARTS = range(FIRST_SEED, FIRST_SEED + 60)


@pytest.mark.parametrize("name", runs.SHIPPED_NAMES)
def test_shipped_policy_is_a_finished_run_of_its_config(name: str) -> None:
    folder = runs.SHIPPED / name
    record = json.loads((folder / runs.RECORD).read_text())
    assert record["finished"]
    config = runs.read_run_config(folder)
    task = "damping" if name == "damping" else "stabilisation"
    assert (config.task, config.environment.equilibrium) == (task, None if name == "damping" else name)
    own = default_path(task, config.algorithm, config.environment.equilibrium)
    assert read_config(own, [f"training.seed={config.training.seed}"]) == config  # it can be trained anew
    curve = read_csv(folder / runs.CURVE)
    assert int(curve[-1]["steps"]) == record["steps"] >= config.training.steps
    assert sum(path.stat().st_size for path in folder.iterdir()) < 500_000


@pytest.mark.parametrize("name", runs.SHIPPED_NAMES)
def test_shipped_policy_rests_at_its_equilibrium(name: str) -> None:
    policy = agents.load(name)
    assert np.abs(policy.predict(policy.reference)[0]).max() < 1e-6
    assert policy.predict(np.tile(policy.reference, (2, 1)))[0].shape == (2, 3)


def values(controller: Controller, environment_id: str, arguments: dict[str, object]) -> dict[str, np.ndarray]:
    return MEASURES[environment_id].compute(roll_out(controller, environment_id, arguments, STARTS))


# Shares of 1,000 starts are in each policy's table; here a few starts show that it isn't far from them.
@pytest.mark.parametrize(
    ("name", "start_scale", "recovered"),
    [
        ("hanging-hanging", 1.0, 59),
        ("hanging-inverted", 1.0, 57),
        ("inverted-hanging", 2.0, 59),
        ("inverted-inverted", 1.0, 52),
    ],
)
def test_shipped_policy_recovers(name: str, start_scale: float, recovered: int) -> None:
    arguments = {"equilibrium": name, "start_scale": start_scale}
    found = values(agents.load(name), "SpringPendulumStabilisation-v0", arguments)
    assert found["recovered"].sum() >= recovered


def test_shipped_damping_is_faster_than_lqr() -> None:
    policy, lqr = (
        values(controller, "SpringPendulumDamping-v0", {})
        for controller in (agents.load("damping"), LQR({}, "hanging-hanging"))
    )
    assert policy["settled"].mean() > 0.95
    assert np.median(policy["settling_time"] - lqr["settling_time"]) < 0
    assert np.median(policy["energy_integral"] - lqr["energy_integral"]) < 0


FURTHER = sorted(path for path in runs.SHIPPED.glob("**/seeds/*") if path.is_dir())


@pytest.mark.parametrize("folder", FURTHER, ids=lambda folder: str(folder.relative_to(runs.SHIPPED)))
def test_further_seeds_differ_from_the_shipped_policy_by_the_seed_alone(folder: Path) -> None:
    name, _, seed = folder.name.rpartition("-")
    first = folder.parent.parent / name
    shipped = runs.read_run_config(first)
    config = runs.read_run_config(folder)
    assert config.training.seed == int(seed) != shipped.training.seed
    assert config.model_copy(update={"training": shipped.training}) == shipped
    assert runs.read_record(folder)["finished"]
    states = agents.load(first).reference + 0.1 * np.random.default_rng(0).standard_normal((10, 18))
    assert not np.allclose(agents.load(folder).predict(states)[0], agents.load(first).predict(states)[0], atol=1e-3)


@pytest.mark.parametrize("name", runs.RANDOMISED_NAMES)
def test_policies_of_randomised_parameters_are_entries_of_their_own(name: str) -> None:
    policy = agents.load(name)
    equilibrium = policy.config.environment.equilibrium
    task = f"stabilisation-{equilibrium}" if equilibrium else "damping"
    own = FOLDER / "randomised" / f"{task}-shac.yaml"
    assert read_config(own, [f"training.seed={policy.config.training.seed}"]) == policy.config
    assert policy.config.environment.randomise
    assert len(find(name).folders) >= 3
    trials = [trial for trial in TRIALS.values() if trial.equilibrium == (equilibrium or "hanging-hanging")]
    plain = find(name.removesuffix("-randomised"))
    assert [bool(find(name).controllers(t)) for t in trials] == [bool(plain.controllers(t)) for t in trials]


@pytest.mark.parametrize("name", ["damping", "inverted-inverted"])
def test_at_least_five_trainings_where_it_matters_most(name: str) -> None:
    assert len(find(name).folders) >= 5
    assert all(len(find(other).folders) >= 3 for other in runs.SHIPPED_NAMES)
