"""Results that take too long to be found anew each time: NMPC's episodes and the open-loop optimum.

One JSON file for each, which holds for each trial a list for each column, one number for each start; it is written
after every start, so an interrupted search goes on where it stopped. Starts are counted from the protocol's first one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.files import write_text
from agents.runs import provenance

Array = NDArray[np.float64]

RESULTS = Path(__file__).resolve().parent / "results"
START = "start"


def read(path: Path) -> dict[str, Any]:
    """{"about": mapping, "trials": {trial: {column: list}}}, empty where there is no file yet.

    Raises ValueError where the file is something else.
    """
    if not path.is_file():
        return {"about": {}, "trials": {}}
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if not isinstance(data, dict) or set(data) != {"about", "trials"}:
        raise ValueError(f"{path} is not a file of saved results; allowed are the keys about and trials")
    return data


def columns(path: Path, trial: str) -> dict[str, Array] | None:
    """What is saved of a trial, an array for each column, in the order of the starts; None where nothing is."""
    found = read(path)["trials"].get(trial)
    if not found or not found[START]:
        return None
    order = np.argsort(found[START])
    return {name: np.array([math.inf if v is None else v for v in values])[order] for name, values in found.items()}


def missing(path: Path, trial: str, starts: Sequence[int]) -> list[int]:
    """The starts that are not saved yet."""
    done = set(read(path)["trials"].get(trial, {}).get(START, []))
    return [start for start in starts if start not in done]


def add(path: Path, trial: str, start: int, row: Mapping[str, float], about: Mapping[str, Any]) -> None:
    """Save the row of a start; `about` and where the numbers come from are those of the last one."""
    data = read(path)
    table = data["trials"].setdefault(trial, {name: [] for name in (START, *row)})
    if set(table) != {START, *row}:
        raise ValueError(f"{path} has the columns {sorted(table)} for {trial}; allowed are those of {sorted(row)}")
    for name, value in ({START: start} | dict(row)).items():
        table[name].append(_short(value))
    data["about"] = dict(about) | {key: provenance()[key] for key in ("commit", "versions")}
    write_text(path, _compact(data))


def fill(
    path: Path,
    trial: str,
    starts: Sequence[int],
    find: Callable[[int], Mapping[str, float]],
    about: Mapping[str, Any],
    told: Callable[[int, Mapping[str, float]], None],
) -> None:
    """Call `find` for each start that is not saved yet, and save what it returns."""
    for start in missing(path, trial, starts):
        row = find(start)
        add(path, trial, start, row, about)
        told(start, row)


def _short(value: float) -> float | int | None:
    """Five digits are enough; JSON knows no infinity, so a time that was not reached is null."""
    if not math.isfinite(value):
        return None
    return int(value) if float(value).is_integer() else float(f"{value:.5g}")


def _compact(data: Mapping[str, Any]) -> str:
    """JSON with a line for each column."""
    trials = []
    for trial, table in data["trials"].items():
        lines = ",\n".join(f"      {json.dumps(name)}: {json.dumps(values)}" for name, values in table.items())
        trials.append(f"    {json.dumps(trial)}: {{\n{lines}\n    }}")
    about, tables = json.dumps(data["about"]), ",\n".join(trials)
    return f'{{\n  "about": {about},\n  "trials": {{\n{tables}\n  }}\n}}\n'
