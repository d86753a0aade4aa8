"""Robustness sweeps: each makes things worse in the way that it says, and what was played is not played again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import spring_pendulum_env
from agents import robustness
from agents.entries import CLASSICAL
from agents.evaluation import TRIALS
from agents.robustness import BASES, SWEEPS, collect, rows, sweep_named, tables, wrong_parameters
from agents.rollout import scenario_for
from spring_pendulum_env import Parameters


def test_parameter_errors_are_joint_and_bounded() -> None:
    trial = TRIALS["inverted-inverted-0.05"]
    drawn = wrong_parameters(0.3, trial, 500).parameters
    usual = Parameters()
    for name in ("m0", "m1", "m2", "k1", "k2", "L1", "L2", "g"):
        factors = drawn[name] / getattr(usual, name)
        assert 0.7 <= factors.min() < 0.71
        assert 1.29 < factors.max() <= 1.3
    assert abs(np.corrcoef(drawn["k1"], drawn["k2"])[0, 1]) < 0.15
    for row in range(500):  # every equilibrium can still be held
        parameters = {name: values[row] for name, values in drawn.items()}
        assert spring_pendulum_env.equilibrium(parameters, trial.equilibrium)[5] > 0


def test_delays_are_whole_control_periods() -> None:
    sweep = SWEEPS["delay"]
    assert [sweep.disturbance(value, BASES[0], 1).delay for value in sweep.values] == [0, 1, 2, 3]


def test_spreads_are_those_of_the_starts() -> None:
    sweep = SWEEPS["spread"]
    for value in sweep.values:
        trial = sweep.trial(BASES[1], value)
        scenario = scenario_for(trial.environment_id, trial.arguments)
        assert scenario.start_scale * scenario.task.start_displacement == pytest.approx(value)


def test_sweeps_fall_are_told_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played, told = [], []
    rolling = robustness.roll_out
    monkeypatch.setattr(robustness, "roll_out", lambda *a: (played.append(1), rolling(*a))[1])
    base = next(base for base in BASES if base.equilibrium == "hanging-inverted")
    entries = [CLASSICAL["lqr"], CLASSICAL["damper"]]
    chosen = [SWEEPS["kick"], SWEEPS["spread"]]
    results = collect(entries, tmp_path, bases=[base, BASES[0]], sweeps=chosen, starts=12, told=told.append)
    kicks = [one.value for one in results["kick"]["hanging-inverted"]["LQR"]]
    assert kicks[0] == 1.0
    assert kicks[-1] < 0.5, kicks
    assert set(results["kick"]["damping"]) == {"LQR", "damper, tuned"}  # the damper is for damping alone
    assert set(results["spread"]) == {"hanging-inverted"}
    assert results["spread"]["hanging-inverted"]["LQR"][0].value == 1.0
    before = len(played)
    assert before == 3 * 6 + 7
    again = collect(entries, tmp_path, bases=[base, BASES[0]], sweeps=chosen, starts=12, told=told.append)
    assert again == results
    assert len(played) == before
    text = tables(results)
    assert "### Success against the kick to each mass after 2 s" in text
    assert "| hanging-inverted | LQR" in text
    assert len(rows(results)) == before
    with pytest.raises(ValueError, match=r"sweep is 'wind'; allowed are parameters"):
        sweep_named("wind")


def test_pictures_are_drawn(tmp_path: Path) -> None:
    from agents.robustness_plots import plot_region, plot_sweeps
    from agents.statistics import wilson

    found = {name: [wilson(np.r_[np.ones(8), np.zeros(2)])] * len(SWEEPS[name].values) for name in SWEEPS}
    results = {name: {"hanging-inverted": {"LQR": found[name]}} for name in SWEEPS}
    plot_sweeps(results, tmp_path / "sweeps.png")
    plot_region(results, tmp_path / "region.png")
    assert {path.name for path in tmp_path.iterdir()} == {"sweeps.png", "region.png"}
