"""What the shipped policies are to reach on unseen starts, and whether they do.

A goal counts as reached where the whole 95 % interval is on its side. Against tuned LQR the interval is that of the
paired difference, start by start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.entries import kind_of
from agents.evaluation import TRIALS, Trial
from agents.leaderboard import RIVAL, Row
from agents.measures import Measure, measures_of
from agents.statistics import estimate, paired_difference
from agents.tables import estimate_text, markdown, title

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Verdict:
    """A goal in words, what was found, and whether that reaches it."""

    trial: str
    goal: str
    found: str
    reached: bool


@dataclass(frozen=True)
class Scores:
    """The rows of a trial by kind: "policy", "optimum", or the name of a classical entry."""

    trial: Trial
    rows: Mapping[str, Row]

    def verdict(self, goal: str, found: str, reached: bool) -> Verdict:
        """Of this trial."""
        return Verdict(self.trial.name, goal, found, reached)


Goal = Callable[[Scores], Verdict]


def share(least: float) -> Goal:
    """The share of starts settled or recovered."""

    def judge(scores: Scores) -> Verdict:
        success = measures_of(scores.trial.environment_id).each[0]
        found = estimate(scores.rows["policy"].values[success.name], "share")
        return scores.verdict(f"{success.title} at least {least:g}", estimate_text(found, "share"), found.low >= least)

    return judge


def share_of_optimum(factor: float, kind: str = "") -> Goal:
    """The same beside that of the open-loop optimum, whose starts are the policy's first: on those it must hold too."""

    def judge(scores: Scores) -> Verdict:
        success = measures_of(scores.trial.environment_id).each[0]
        mine, its = (scores.rows[name].values[success.name] for name in ("policy", "optimum"))
        found, least, same = estimate(mine, "share"), factor * its.mean(), mine[:, : its.shape[1]].mean()
        goal = f"{kind}{success.title} at least {least:.3f}, {factor:.0%} of the optimum's {its.mean():.2f}"
        words = f"{estimate_text(found, 'share')}; on the optimum's {its.shape[1]} starts {same:.3f}"
        return scores.verdict(goal, words, min(found.low, same) >= least)

    return judge


def more_than_tuned_lqr(factor: float = 1.0) -> Goal:
    """The share beside that of tuned LQR."""

    def judge(scores: Scores) -> Verdict:
        success = measures_of(scores.trial.environment_id).each[0]
        mine, its = (scores.rows[name].values[success.name] for name in ("policy", RIVAL))
        found = paired_difference(mine, factor * its, "mean")
        times = f"{factor:g} times " if factor != 1.0 else ""
        goal = f"{success.title} more than {times}tuned LQR's {its.mean():.3f}"
        words = f"{estimate_text(estimate(mine, 'share'), 'share')}: more by {estimate_text(found, 'share')}"
        words += _beyond(factor, its, scores.rows.get("optimum"), success.name)
        return scores.verdict(goal, words, found.low > 0.0)

    return judge


def _beyond(factor: float, shares: Array, optimum: Row | None, success: str) -> str:
    """In words, whether a multiple of a share is more than there is, or than the optimum finds on its own starts."""
    if factor * shares.mean() >= 1.0:
        return "; all starts would not do"
    if optimum is None:
        return ""
    best = optimum.values[success]
    wanted = factor * shares[:, : best.shape[1]].mean()
    if wanted <= best.mean():
        return ""
    return f"; on the optimum's {best.shape[1]} starts it would take {wanted:.2f}, and it finds {best.mean():.2f}"


def below_tuned_lqr(name: str) -> Goal:
    """A measure of which little is good, beside tuned LQR's: the median of the difference."""

    def judge(scores: Scores) -> Verdict:
        measure: Measure = next(one for one in measures_of(scores.trial.environment_id).each if one.name == name)
        mine, its = (scores.rows[row].values[name] for row in ("policy", RIVAL))
        found = paired_difference(mine, its)
        words = f"{title(measure)} below tuned LQR's"
        return scores.verdict(words, f"median difference {estimate_text(found)}", found.high < 0.0)

    return judge


GOALS: Mapping[str, Sequence[Goal]] = {
    "damping": (share(0.99), below_tuned_lqr("settling_time"), below_tuned_lqr("energy_integral")),
    "hanging-hanging-0.05": (share(0.995),),
    "hanging-hanging-0.1": (share(0.995),),
    "hanging-inverted-0.05": (share_of_optimum(0.97), more_than_tuned_lqr()),
    "hanging-inverted-0.1": (share(0.75),),
    "inverted-hanging-0.05": (share(0.99),),
    "inverted-hanging-0.1": (share(0.99),),
    "inverted-hanging-0.3": (more_than_tuned_lqr(),),
    "inverted-inverted-0.05": (share_of_optimum(0.8), more_than_tuned_lqr(2.0), share_of_optimum(0.95, "hoped for: ")),
    "inverted-inverted-0.1": (share_of_optimum(0.5), more_than_tuned_lqr(3.0)),
}
"""By trial."""
assert set(GOALS) == set(TRIALS)


def verdicts(rows_of: Mapping[Trial, Sequence[Row]]) -> list[Verdict]:
    """All that can be judged: the policy's row and those that it is measured by must be there."""
    found = []
    for trial, rows in rows_of.items():
        scores = Scores(trial, {kind_of(row.name): row for row in rows})
        for goal in GOALS[trial.name]:
            try:
                found.append(goal(scores))
            except KeyError:  # a row is missing: nothing to judge
                continue
    return found


def table(found: Sequence[Verdict]) -> str:
    """Markdown, a line for each goal."""
    return markdown(
        [
            ["trial", "goal", "found", ""],
            *([one.trial, one.goal, one.found, "reached" if one.reached else "**not reached**"] for one in found),
        ]
    )
