"""The leaderboard: for each trial a table of all entries on the same starts, and one picture of all shares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import runs, saved
from agents.config import ENVIRONMENT_IDS
from agents.entries import CLASSICAL, KINDS, Entry, action_times, find, kind_of, score_entry
from agents.evaluation import STARTS, TRIALS, Trial, summary_rows
from agents.measures import Measure, measures_of
from agents.statistics import estimate, paired_difference
from agents.tables import digits, estimate_text, markdown, title
from agents.tables import entry as entry_text

Array = NDArray[np.float64]

NMPC_FILE = saved.RESULTS / "nmpc.json"
OPTIMUM_FILE = saved.RESULTS / "optimum.json"
RIVAL = "lqr-tuned"
"""The entry that learned ones are compared with, start by start."""


@dataclass(frozen=True)
class Row:
    """An entry's scores in a trial: arrays (trainings, starts) by name of the measure; an action's time, s, or None."""

    name: str
    title: str
    values: Mapping[str, Array]
    action_time: float | None


def classical_entries(trial: Trial) -> list[Entry]:
    """Those that are scored anew each time, since they are quick."""
    braking = ["drag", "damper"] if trial.environment_id == ENVIRONMENT_IDS["damping"] else []
    return [CLASSICAL[name] for name in ("nothing", *braking, "lqr", "lqr-tuned")]


def shipped_entries() -> tuple[list[Entry], list[str]]:
    """Entries of the shipped policies, and the names of those that are not there yet."""
    there = runs.available_names()
    absent = [name for name in (*runs.SHIPPED_NAMES, *runs.RANDOMISED_NAMES) if name not in there]
    return [find(name) for name in there], absent


def scored_rows(trial: Trial, entries: Sequence[Entry], folder: Path, starts: int = STARTS) -> list[Row]:
    """Scores of the entries that are for this trial, from `folder` where they were measured before."""
    rows = []
    for entry in entries:
        values = score_entry(entry, trial, folder, starts)
        if values is not None:
            rows.append(Row(entry.name, entry.title, values, action_times(values)))
    return rows


def saved_rows(trial: Trial, nmpc_file: Path = NMPC_FILE, optimum_file: Path = OPTIMUM_FILE) -> list[Row]:
    """NMPC's episodes and the open-loop optimum, as they are saved."""
    rows = []
    nmpc = saved.columns(nmpc_file, trial.name)
    if nmpc is not None:
        solves, failures = (float(nmpc[name].sum()) for name in ("solves", "failures"))
        timed = np.isfinite(nmpc["seconds"]) & (nmpc["solves"] > 0)
        time = float((nmpc["seconds"][timed] / nmpc["solves"][timed]).mean()) if timed.any() else None
        told = f"NMPC ({failures / max(solves, 1.0):.1%} of {solves:,.0f} solves failed)"
        values = {measure.name: nmpc[measure.name][None] for measure in measures_of(trial.environment_id).each}
        rows.append(Row("nmpc", told, values, time))
    optimum = saved.columns(optimum_file, trial.name)
    if optimum is not None:
        share = {measures_of(trial.environment_id).success: optimum["recovered"][None]}
        rows.append(Row("optimum", "open-loop optimum (at least)", share, None))
    return rows


def trial_table(trial: Trial, entries: Sequence[Entry], folder: Path, starts: int = STARTS) -> str:
    """The table of a trial for some entries, under its name."""
    return f"{heading(trial)}\n\n{table(trial, scored_rows(trial, entries, folder, starts))}\n"


def heading(trial: Trial) -> str:
    """A line of Markdown."""
    if trial.environment_id == ENVIRONMENT_IDS["damping"]:
        return "### Damping"
    return f"### Stabilisation, {trial.equilibrium}, spread {trial.spread:g} m"


def table(trial: Trial, rows: Sequence[Row], statistic: str = "median") -> str:
    """Shares and medians (or interquartile means) with 95 % intervals; a dash: not reached, or of no use."""
    measures = measures_of(trial.environment_id).each
    lines = [["", "starts", *(title(measure) for measure in measures), "time of an action (ms)"]]
    for row in rows:
        trainings, starts = next(iter(row.values.values())).shape
        count = f"{trainings} x {starts:,}" if trainings > 1 else f"{starts:,}"
        cells = [_cell(row, measure, statistic) for measure in measures]
        time = "-" if row.action_time is None else f"{1e3 * row.action_time:.2g}"
        lines.append([row.title, count, *cells, time])
    return markdown(lines)


def _cell(row: Row, measure: Measure, statistic: str) -> str:
    values = row.values.get(measure.name)
    return "-" if values is None else entry_text(values, measure.kind, statistic)


def differences(trial: Trial, rows: Sequence[Row]) -> list[str]:
    """How each learned entry and NMPC differ from tuned LQR on the same starts, in sentences."""
    by_name = {row.name: row for row in rows}
    rival = by_name.get(RIVAL)
    if rival is None:
        return []
    sentences = []
    for row in rows:
        if row.name == "optimum" or (row.name in CLASSICAL and row.name != "nmpc"):
            continue
        told = []
        for measure in measures_of(trial.environment_id).each[:3]:
            if measure.name not in row.values or measure.name == "effort":
                continue
            starts = min(row.values[measure.name].shape[1], rival.values[measure.name].shape[1])
            mine, its = (of.values[measure.name][:, :starts] for of in (row, rival))
            if measure.kind == "share":
                told.append(f"{title(measure)} {estimate_text(paired_difference(mine, its, 'mean'), 'share')}")
                continue
            both = np.flatnonzero(np.isfinite(mine).all(axis=0) & np.isfinite(its).all(axis=0))
            if both.size:
                found = estimate_text(paired_difference(mine[:, both], its[:, both]))
                told.append(f"{title(measure)} {found}" + (" where both did" if both.size < starts else ""))
        sentences.append(f"{row.title}, less tuned LQR on the same {starts:,} starts: {'; '.join(told)}")
    return sentences


def statistics_rows(trial: Trial, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """All statistics of all rows as columns, medians and interquartile means both."""
    values = {row.title: row.values for row in rows}
    return [{"trial": trial.name} | columns for columns in summary_rows(values, trial.environment_id)]


COLUMNS = {
    "nothing": "nothing",
    "lqr": "LQR",
    "lqr-tuned": "LQR, tuned",
    "nmpc": "NMPC",
    **KINDS,
    "optimum": "optimum, at least",
}
"""Titles of the summary's columns, by kind of entry."""


def summary(rows_of: Mapping[Trial, Sequence[Row]], kinds: Sequence[str] = tuple(COLUMNS)) -> str:
    """One table of all shares: a line for each trial, a column for each kind of entry."""
    lines = [["", *(COLUMNS[kind] for kind in kinds)]]
    for trial, rows in rows_of.items():
        success = measures_of(trial.environment_id).success
        found = {kind_of(row.name): row for row in rows}
        cells = [entry_text(found[kind].values[success], "share") if kind in found else "-" for kind in kinds]
        lines.append([trial.name, *cells])
    return markdown(lines)


def trainings() -> str:
    """A table of the shipped policies' trainings, from their run.json: seeds, steps, and time."""
    lines = [["", "algorithm", "seeds", "steps", "processor time, median and longest (s)", "by the wall (s)"]]
    for name in runs.available_names():
        folders = find(name).folders
        config, records = runs.read_run_config(folders[0]), [runs.read_record(folder) for folder in folders]
        processor, wall = (np.array([record[key] for record in records]) for key in ("processor_seconds", "seconds"))
        lines.append(
            [
                name,
                config.algorithm.upper() + (" over LQR" if config.guide is not None else ""),
                ", ".join(str(record["seed"]) for record in records),
                f"{config.training.steps:,}",
                f"{np.median(processor):.0f}, {processor.max():.0f}",
                f"{np.median(wall):.0f}, {wall.max():.0f}",
            ]
        )
    return markdown(lines)


def retrained(rows_of: Mapping[Trial, Sequence[Row]]) -> str:
    """A table that holds the last training of each shipped policy against the interval of those before it."""
    lines = [["trial", "", "measure", "trainings before", "the last one", ""]]
    for trial, rows in rows_of.items():
        measures = measures_of(trial.environment_id).each
        told = measures[:3] if trial.environment_id == ENVIRONMENT_IDS["damping"] else measures[:1]
        for row in rows:
            trainings = len(row.values[told[0].name])
            if not runs.is_shipped(row.name) or trainings < 2:
                continue
            for measure in told:
                values = row.values[measure.name]
                before, last = estimate(values[:-1], measure.kind), estimate(values[-1:], measure.kind)
                number = f"{last.value:.3f}" if measure.kind == "share" else digits(last.value)
                within = "within" if before.low <= last.value <= before.high else "**outside**"
                cells = [KINDS[kind_of(row.name)], title(measure), estimate_text(before, measure.kind), number, within]
                lines.append([trial.name, *cells])
    return markdown(lines)


def collect(
    folder: Path,
    *,
    trials: Sequence[Trial] = tuple(TRIALS.values()),
    more: Sequence[Entry] = (),
    starts: int = STARTS,
    told: Callable[[str], None] = print,
) -> dict[Trial, list[Row]]:
    """All rows of all trials; `told` hears of each trial that is done, and of what is left out."""
    shipped, absent = shipped_entries()
    if absent:
        told(f"left out, since not shipped: the policies {', '.join(absent)}")
    rows_of = {}
    for trial in trials:
        found = scored_rows(trial, [*classical_entries(trial), *shipped, *more], folder, starts)
        rows_of[trial] = [*found, *saved_rows(trial)]
        told(f"scored: {trial.name}")
    return rows_of
