"""The leaderboard: its goals are judged as they are written, and the tables in the documentation are of its numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import goals, leaderboard, pages, robustness
from agents.evaluation import TRIALS
from agents.files import read_csv
from agents.leaderboard import Row
from agents.leaderboard_pages import DOCS, NUMBERS, PAGE, README
from agents.measures import measures_of
from agents.statistics import Estimate
from agents.tables import estimate_text

INVERTED = TRIALS["inverted-inverted-0.05"]


def row(name: str, share: float, trainings: int = 1, starts: int = 1000) -> Row:
    """Of so many starts, of which the first are recovered."""
    recovered = np.tile((np.arange(starts) < round(share * starts)).astype(float), (trainings, 1))
    return Row(name, name, {"recovered": recovered}, None)


def reached(goal: goals.Goal, *rows: Row) -> bool:
    scores = goals.Scores(INVERTED, {"policy" if one.name == "inverted-inverted" else one.name: one for one in rows})
    return goal(scores).reached


def test_a_share_counts_by_the_lower_end_of_its_interval() -> None:
    assert reached(goals.share(0.9), row("inverted-inverted", 0.93))
    assert not reached(goals.share(0.9), row("inverted-inverted", 0.91))
    assert not reached(goals.share(0.9), row("inverted-inverted", 0.91, trainings=5))


def test_the_optimum_is_held_against_the_same_starts_too() -> None:
    optimum = row("optimum", 0.9, starts=100)
    assert reached(goals.share_of_optimum(0.5), row("inverted-inverted", 0.6), optimum)
    assert not reached(goals.share_of_optimum(0.8), row("inverted-inverted", 0.73), optimum)
    late = row("inverted-inverted", 0.95)
    late = Row(late.name, late.title, {"recovered": late.values["recovered"][:, ::-1]}, None)
    assert not reached(goals.share_of_optimum(0.8), late, optimum)  # it fails on the first 50 of the optimum's starts


def test_tuned_lqr_is_met_on_the_same_starts() -> None:
    policy, tuned = row("inverted-inverted", 0.96, trainings=3), row("lqr-tuned", 0.4)
    assert reached(goals.more_than_tuned_lqr(), policy, tuned)
    assert reached(goals.more_than_tuned_lqr(2.0), policy, tuned)
    assert not reached(goals.more_than_tuned_lqr(2.4), policy, tuned)
    assert not reached(goals.more_than_tuned_lqr(), policy, row("lqr-tuned", 0.96))
    verdict = goals.more_than_tuned_lqr(2.0)(goals.Scores(INVERTED, {"policy": policy, "lqr-tuned": row("x", 0.7)}))
    assert verdict.found.endswith("all starts would not do")
    rows = {"policy": policy, "lqr-tuned": row("x", 0.4), "optimum": row("optimum", 0.9, starts=100)}
    verdict = goals.more_than_tuned_lqr(2.0)(goals.Scores(INVERTED, rows))  # LQR recovers all of the optimum's starts
    assert verdict.found.endswith("on the optimum's 100 starts it would take 2.00, and it finds 0.90")


def test_goals_of_all_trials_are_judged_where_the_rows_are_there() -> None:
    rows = [row("inverted-inverted", 0.97, 5), row("lqr-tuned", 0.4), row("optimum", 0.99, starts=100)]
    found = goals.verdicts({INVERTED: rows})
    assert [verdict.reached for verdict in found] == [True, True, True]
    assert [verdict.reached for verdict in goals.verdicts({INVERTED: rows[:2]})] == [True]
    assert goals.verdicts({INVERTED: rows[1:]}) == []
    assert goals.table(found).count("| reached") == 3


def test_a_training_that_ends_elsewhere_is_told() -> None:
    same, other = row("inverted-inverted", 0.9, 3), row("inverted-inverted", 0.7)
    assert "within" in leaderboard.retrained({INVERTED: [same]})
    both = np.concatenate([same.values["recovered"], other.values["recovered"]])
    assert "outside" in leaderboard.retrained({INVERTED: [Row(same.name, same.title, {"recovered": both}, None)]})


def test_tables_are_put_between_their_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n<!-- a: written by x -->\nold\n<!-- end of a -->\n\nBelow.\n")
    pages.put(page, "a", "new\n")
    assert page.read_text() == "# Title\n\n<!-- a: written by x -->\n\nnew\n\n<!-- end of a -->\n\nBelow.\n"
    assert pages.read(page, "a") == "new"
    with pytest.raises(ValueError, match=r"page.md has no marks for 'b'"):
        pages.put(page, "b", "new")


# What is saved in the documentation belongs together.


def test_tables_of_the_leaderboard_are_those_of_its_numbers() -> None:
    tables = [line.split("|") for line in pages.read(PAGE, "trials").splitlines() if line.startswith("|")]
    cells = {(line[1].strip(), cell.strip()) for line in tables for cell in line[2:]}
    shares = pages.read(PAGE, "shares"), pages.read(README, "shares")
    numbers = read_csv(DOCS / NUMBERS)
    assert {line["trial"] for line in numbers} == set(TRIALS)
    for line in numbers:
        found = Estimate(*(float(line[key]) for key in ("value", "low", "high")))
        if line["statistic"] == "mean":
            assert (line["controller"], estimate_text(found, "share")) in cells
            success = measures_of(TRIALS[line["trial"]].environment_id).success
            if line["measure"] == success and line["controller"].startswith("policy ("):
                assert all(estimate_text(found, "share") in table for table in shares)
        elif line["statistic"] == "median":
            assert (line["controller"], estimate_text(found)) in cells


def test_tables_of_robustness_are_those_of_its_numbers() -> None:
    results = robustness.from_rows(read_csv(DOCS / "robustness.csv"))
    assert set(results) == set(robustness.SWEEPS)
    assert pages.read(DOCS / "robustness.md", "tables") == robustness.tables(results).strip()
