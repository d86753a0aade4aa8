"""The leaderboard as text: what is printed, and what stands in the documentation and the README."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents import goals, leaderboard, pages, runs
from agents.evaluation import Trial
from agents.files import write_csv
from agents.leaderboard import Row
from agents.leaderboard_plots import plot_damping, plot_shares

DOCS = runs.ROOT / "docs" / "control"
README = runs.ROOT / "README.md"
PAGE = DOCS / "leaderboard.md"
NUMBERS = "leaderboard.csv"
OF_README = ("lqr", "lqr-tuned", "nmpc", "policy", "optimum")
"""The columns of the summary there."""


def parts(rows_of: Mapping[Trial, Sequence[Row]]) -> dict[str, str]:
    """Markdown by the name that its place in the documentation has."""
    trials = []
    for trial, rows in rows_of.items():
        trials += [leaderboard.heading(trial), leaderboard.table(trial, rows), *leaderboard.differences(trial, rows)]
    return {
        "trials": "\n\n".join(trials),
        "shares": leaderboard.summary(rows_of),
        "goals": goals.table(goals.verdicts(rows_of)),
        "trainings": leaderboard.trainings(),
        "retrained": leaderboard.retrained(rows_of),
        "versions": versions(),
    }


def versions() -> str:
    """A sentence about the versions in use."""
    found: Mapping[str, Any] = runs.provenance()["versions"]
    return ", ".join(f"{name.replace('_', '-')} {version}" for name, version in found.items()) + "."


def whole(of_name: Mapping[str, str]) -> str:
    """All of it, as it is printed."""
    titles = {
        "shares": "Share of starts recovered or settled",
        "goals": "Goals",
        "trainings": "Trainings",
        "retrained": "Trained once more",
        "versions": "Versions",
    }
    return "\n\n".join([of_name["trials"], *(f"### {words}\n\n{of_name[name]}" for name, words in titles.items())])


def write_figures(rows_of: Mapping[Trial, Sequence[Row]], folder: Path) -> None:
    """All numbers and both pictures."""
    numbers = [line for trial, rows in rows_of.items() for line in leaderboard.statistics_rows(trial, rows)]
    write_csv(folder / NUMBERS, numbers)
    plot_shares(rows_of, folder / "shares.png")
    plot_damping(rows_of, folder / "damping.png")


def write_docs(rows_of: Mapping[Trial, Sequence[Row]], of_name: Mapping[str, str]) -> None:
    """Bring the documentation's page and the README's tables up to date."""
    write_figures(rows_of, DOCS)
    for name, text in of_name.items():
        pages.put(PAGE, name, text)
    pages.put(README, "shares", leaderboard.summary(rows_of, OF_README))
    missed = [verdict for verdict in goals.verdicts(rows_of) if not verdict.reached]
    pages.put(README, "not reached", goals.table(missed) if missed else "All goals are reached.")
