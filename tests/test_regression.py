"""The regression command finds what it should, and its data are what their makers say."""

from __future__ import annotations

import copy
import importlib
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from mpmath import mp, mpf
from reference_data import CASES

from spring_pendulum_env import Parameters, equilibrium, linearise, regression

sys.path.insert(0, str(Path(__file__).parent.parent / "scripts"))
maker: Any = importlib.import_module("make_regression_cases")
references: Any = importlib.import_module("references.cases")

CONTENT = regression.load()
ABOUT = CONTENT["about"]
SHIPPED = {case["name"]: case for case in CONTENT["cases"]}


def test_every_case_is_within_its_limits(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert regression.main(["--json", str(tmp_path / "result.json")]) == 0
    table = capsys.readouterr().out.splitlines()
    written = json.loads((tmp_path / "result.json").read_text())
    assert all(row["passed"] and row["error"] <= row["limit"] for row in written["rows"])
    assert {row["case"] for row in written["rows"]} == set(SHIPPED)
    assert {row["scheme"] for row in written["rows"]} == {"environment", "simulate", "splitting", "its energy"}
    assert written["versions"]["numpy"] == np.__version__
    assert len([line for line in table if line.endswith(" ok")]) == len(written["rows"])


@pytest.mark.parametrize(
    ("name", "scheme"),
    [
        ("regular", regression.adaptive_environment),
        ("regular", regression.simulated),
        ("regular", regression.splitting),
        ("driven", regression.adaptive_environment),
        ("driven", regression.splitting),
    ],
)
def test_a_slightly_wrong_constant_fails(name: str, scheme: Any) -> None:
    """Stiffness off by 1e-6, as a wrong formula or a bad compiler might have it: no scheme hides that."""
    case = copy.deepcopy(SHIPPED[name])
    assert all(row.passed for row in scheme(case, ABOUT))
    case["parameters"]["k1"] *= 1 + 1e-6
    assert not all(row.passed for row in scheme(case, ABOUT))


def test_failure_is_said_and_sets_the_exit_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = copy.deepcopy(CONTENT)
    (case,) = (case for case in broken["cases"] if case["name"] == "regular")
    case["records"][2][2][4] += 1e-6
    monkeypatch.setattr(regression, "load", lambda: broken)
    assert regression.main(["--case", "regular"]) == 1
    said = capsys.readouterr().out
    assert said.count("FAILED") == 3  # the environment, simulate, and the last line


def test_integrator_that_gives_up_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def gives_up(*_: Any, **__: Any) -> Any:
        raise ArithmeticError("DOP853 stopped at t = 0 s")

    monkeypatch.setattr(regression, "simulate", gives_up)
    assert regression.main(["--case", "regular"]) == 1
    assert "DOP853 stopped at t = 0 s" in capsys.readouterr().out


def test_not_a_number_is_never_within_a_limit() -> None:
    assert not regression.Row("", "", 0.0, math.nan, None, None, 1.0).passed
    states = [np.full(12, np.nan)] * len(SHIPPED["regular"]["records"])
    assert not regression._nearest_to_limit(SHIPPED["regular"], ABOUT, "", states, 1e-3).passed


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--case", "swing"], "'swing'"),
        (["--json", "no/such/folder/result.json"], "no/such/folder"),
        (["--tolerance", "1"], "--tolerance"),
    ],
)
def test_wrong_argument_is_named(arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        regression.main(arguments)
    assert stopped.value.code == 2
    assert named in capsys.readouterr().err


def test_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "spring_pendulum_env.regression", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Exit status" in done.stdout


# The data.


def test_every_kind_of_pendulum_is_there() -> None:
    parameters = {name: Parameters.of(case["parameters"]) for name, case in SHIPPED.items()}
    assert len(SHIPPED) >= 10
    for constant in ("k1", "k2", "L1", "g"):
        assert any(getattr(p, constant) == 0 for p in parameters.values()), constant
    assert any(p.R1 > 0 and not SHIPPED[name]["actuated_axes"] for name, p in parameters.items())
    assert any(p.m1 / p.m2 > 500 for p in parameters.values())
    assert any(p.k1 > 1e4 for p in parameters.values())
    assert {len(case["actions"]) > 1 for case in SHIPPED.values() if case["actuated_axes"]} == {False, True}
    growth = {name: case["records"][-1][1] for name, case in SHIPPED.items()}
    assert growth["chaotic"] > 1e4 > 1e2 > growth["regular"]
    assert np.any(np.array(SHIPPED["planar"]["records"][-1][2])[:6])
    assert not np.any(np.array(SHIPPED["planar"]["records"][-1][2])[1::3])


def test_cases_are_our_own_and_those_of_the_script() -> None:
    ours = {tuple(case["start"]) for case in SHIPPED.values()}
    assert ours.isdisjoint(tuple(case["initial_state"]) for case in CASES.values())
    for case in references.cases():
        shipped = SHIPPED[case.name]
        assert {name: shipped[name] for name in case.as_dict()} == case.as_dict()
        assert shipped["apart"] <= maker.AGREEMENT
    assert (ABOUT["control_period"], ABOUT["max_force"]) == (references.PERIOD, references.MAX_FORCE)


@pytest.mark.parametrize("method", list(maker.METHODS))
@pytest.mark.parametrize("name", ["no-gravity", "driven"])
def test_both_methods_find_the_shipped_record_again(name: str, method: str) -> None:
    """Its first, 0.2 s after the start, to its last digit."""
    (case,) = (case for case in references.cases() if case.name == name)
    count, _, expected = SHIPPED[name]["records"][0]
    with mp.workdps(maker.DIGITS):
        at = maker.METHODS[method](Parameters(**case.parameters), case.actuated_axes, case.whole_start)
        for force in case.forces[:count]:
            at.advance(mpf(references.PERIOD), force)
        state = np.array([float(x) for x in at.state])
    np.testing.assert_array_equal(state if case.actuated_axes else state.reshape(2, 9)[:, 3:].ravel(), expected)


def test_springs_without_length_move_as_the_matrix_exponential_says() -> None:
    """A linear system: a closed form that neither method knows of."""
    case = SHIPPED["no-lengths"]
    A = linearise(case["parameters"], "hanging-hanging", pinned=True)
    rest = equilibrium(case["parameters"], "hanging-hanging").reshape(2, 9)[:, 3:].ravel()
    for count, growth, expected in case["records"]:
        moved = rest + scipy.linalg.expm(A * count * ABOUT["control_period"]) @ (np.array(case["start"]) - rest)
        assert np.abs(moved - expected).max() < 1e-13 * growth * (1 + np.abs(expected).max())
