"""What a training shows while it runs: its curve as a file, and a progress bar."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Self

from tqdm import tqdm  # type: ignore[import-untyped]

from agents import runs
from agents.files import read_csv, write_csv


class Curve:
    """curve.csv of a run folder, to which rows are added; those of an interrupted stretch are dropped.

    Arguments:
        folder: of the run.
        steps_before: environment steps that are done.
        steps: in all.
        progress: whether to draw a bar.
    """

    def __init__(self, folder: Path, steps_before: int, steps: int, progress: bool) -> None:
        self.path = folder / runs.CURVE
        rows = read_csv(self.path) if self.path.is_file() else []
        self.rows: list[dict[str, Any]] = [dict(row) for row in rows if int(row["steps"]) <= steps_before]
        self.bar: tqdm[Any] | None = None
        if progress:
            self.bar = tqdm(
                desc=folder.name,
                total=steps,
                initial=steps_before,
                unit="step",
                unit_scale=True,
                mininterval=0.5 if sys.stderr.isatty() else 15.0,
            )

    def add(self, row: dict[str, Any], shown: dict[str, Any]) -> None:
        """A row, whose "steps" moves the bar, with what the bar says besides."""
        self.rows.append(row)
        write_csv(self.path, self.rows)
        if self.bar:
            self.bar.update(row["steps"] - self.bar.n)
            self.bar.set_postfix(shown, refresh=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the bar's line."""
        if self.bar:
            self.bar.close()
