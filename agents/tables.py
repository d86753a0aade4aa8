"""Tables in Markdown, with as many digits as mean something."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from agents.measures import Measure
from agents.statistics import Estimate, estimate

Array = NDArray[np.float64]


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """A table whose first row is the head; columns are padded to one width."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    head, *lines = (_row(cells, widths) for cells in rows)
    return "\n".join([head, "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines])


def _row(cells: Sequence[str], widths: Sequence[int]) -> str:
    return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) + " |"


def score_table(
    values: Mapping[str, Mapping[str, Array]], measures: Sequence[Measure], statistic: str = "median"
) -> str:
    """One row for each controller, each entry a share or a statistic with its 95 % interval."""
    return markdown(
        [
            ["", *(title(measure) for measure in measures)],
            *([name, *(entry(of[m.name], m.kind, statistic) for m in measures)] for name, of in values.items()),
        ]
    )


def title(measure: Measure) -> str:
    """With its unit in brackets."""
    return f"{measure.title} ({measure.unit})" if measure.unit else measure.title


def entry(values: Array, kind: str, statistic: str = "median") -> str:
    """An estimate of values (starts,) or (seeds, starts) as text."""
    return estimate_text(estimate(values, kind, statistic), kind)


def estimate_text(found: Estimate, kind: str = "amount") -> str:
    """Value and interval: 0.987 [0.978, 0.992]."""
    numbers = (found.value, found.low, found.high)
    value, low, high = (f"{number:.3f}" if kind == "share" else digits(number) for number in numbers)
    return f"{value} [{low}, {high}]"


def digits(number: float) -> str:
    """Three significant digits; a time that was not reached is a dash."""
    if not math.isfinite(number):
        return "-"
    return f"{number:.0f}" if abs(number) >= 100 else f"{number:#.3g}"
