"""The benchmark runs, its peers simulate what they say, and its table says what was measured."""

from __future__ import annotations

import csv
import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from spring_pendulum_env import Parameters, energy, integrators, simulate

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

measuring: Any = importlib.import_module("benchmarks.measuring")
passive: Any = importlib.import_module("benchmarks.passive")
parts: Any = importlib.import_module("benchmarks.parts")
inside: Any = importlib.import_module("benchmarks.inside")
report: Any = importlib.import_module("benchmarks.report")
solvers: Any = importlib.import_module("benchmarks.solvers")
sections: Any = importlib.import_module("benchmark").SECTIONS
Record = report.Record

TINY = measuring.Effort(
    rounds=1,
    chunk=0.0,
    warm_up=1,
    sizes=(3, 70),
    counts=(1, 4),
    horizon=2,
    slow_rounds=1,
    passive_rows=2,
    starts=1,
)
PARAMETERS = Parameters(m0=1.5, m1=0.8, m2=1.3, k1=80.0, k2=140.0, L1=0.9, L2=1.1, R1=0.2, R2=0.1)


def records_of(section: str) -> list[Any]:
    bench = measuring.Bench(TINY)
    sections[section](bench)
    return bench.records


@pytest.mark.filterwarnings("ignore::UserWarning")  # the peers' own
@pytest.mark.parametrize("section", ["single", "batch", "passive", "scaling", "parts"])
def test_section_measures_something(section: str) -> None:
    records = records_of(section)
    assert records
    assert {record.section for record in records} == {section}
    for record in records:
        assert np.isfinite(record.value), record
        assert record.low <= record.value <= record.high
        assert record.value > 0 or section == "parts"  # a part may vanish in the noise


def test_command_writes_table_files_and_pictures(tmp_path: Path) -> None:
    done = run("--quick", "--rounds", "1", "--only", "single", "--folder", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "CartPole-v1" in done.stdout
    assert "at least 3.5" in done.stdout
    written = json.loads((tmp_path / "out" / "benchmark.json").read_text())
    assert written["machine"]["versions"]["gymnasium"] == gym.__version__
    with (tmp_path / "out" / "benchmark.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["value"]) for row in rows] == [record["value"] for record in written["records"]]
    assert {row["section"] for row in rows} == {"single"}
    assert (tmp_path / "out" / "ratios.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(("--only", "single,fast"), "fast"), (("--rounds", "0"), "rounds"), (("--speed",), "--speed")],
)
def test_wrong_argument_is_one_line(arguments: tuple[str, ...], named: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert named in done.stderr
    assert done.stderr.count("\n") == 1


def run(*arguments: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, ROOT / "scripts" / "benchmark.py", *arguments]
    return subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True, check=False)


def test_peer_that_is_not_installed_is_skipped_with_a_line() -> None:
    said: list[str] = []

    def absent() -> Any:
        raise AssertionError(measuring.peer("no_such_package"))

    there = measuring.Subject("there", float)
    assert measuring.installed([absent, lambda: there], said.append) == [there]
    assert said == ["no_such_package: not installed, skipped"]


def test_target_is_judged_by_the_median() -> None:
    assert Record("", "", "", 2.0, 1.0, 3.0, "x", "at least", 1.9).reached
    assert not Record("", "", "", 2.0, 1.0, 3.0, "x", "at most", 1.9).reached
    assert Record("", "", "", 2.0, 1.0, 3.0, "x").reached is None
    lines = report.table(
        [Record("single", "a step", "CartPole-v1", 3.2, 3.1, 3.3, "x", "at least", 3.5, "")]
    ).splitlines()
    assert "NO" in lines[2]
    assert len({len(line) for line in lines}) == 1
    assert [report.number(value) for value in (0.01234, 1.234, 12.34, 1234.5, 1.234e-5)] == [
        "0.012",
        "1.23",
        "12.3",
        "1,234",
        "1.23e-05",
    ]


def test_roots_and_divisions_are_counted_from_the_formulas() -> None:
    """Two springs: a root and a division each in every kick, two more roots for the energy."""
    roots, divisions = parts.divider_work()
    stages = len(integrators.KICKS)
    assert roots == 2 * stages + 2
    assert divisions > 2 * stages + 4


def test_heyoka_integrates_the_same_equations() -> None:
    pytest.importorskip("heyoka")
    start = passive.MOTIONS["violent"]
    times = np.arange(4.0)
    exact = simulate(PARAMETERS, start, times, rtol=1e-13, atol=1e-13).states
    for solver in (solvers.heyoka_solver, solvers.heyoka_batch_solver):
        states = solver(PARAMETERS, start, times)(1e-15)
        assert np.abs(states - exact).max() < 1e-8


def test_all_of_ours_give_the_same_bits() -> None:
    start, times = passive.MOTIONS["violent"], np.arange(3.0)
    states = solvers.environment_solver(start, times)(60)
    assert np.array_equal(solvers.vector_solver(start, times, 3)(60), states)


def test_compiled_equations_are_those_of_simulate() -> None:
    start, times = passive.MOTIONS["violent"], np.arange(3.0)
    one = solvers.scipy_solver(PARAMETERS, start, times)(1e-10)
    other = solvers.compiled_scipy_solver(PARAMETERS, start, times)(1e-10)
    assert np.abs(one - other).max() < 1e-9


def test_violent_motion_is_far_from_rest_and_regular_is_near_it() -> None:
    rest = energy(None, np.array([0, 0, -1.1962, 0, 0, -2.2943] + [0.0] * 6))
    assert energy(None, passive.MOTIONS["violent"]) - rest > 50
    assert energy(None, passive.MOTIONS["regular"]) - rest < 3
