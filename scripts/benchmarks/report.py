"""What the benchmark found: its table and its files."""

from __future__ import annotations

import csv
import dataclasses
import importlib.metadata
import io
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

PACKAGES = (
    "spring-pendulum-env gymnasium numpy numba scipy mujoco envpool gymnax jax heyoka".split()  # noqa: SIM905
)
HEADINGS = ("section", "what", "beside", "value", "quartiles", "must reach", "reached", "how")


@dataclasses.dataclass(frozen=True)
class Record:
    """One figure: a median over rounds with its quartiles."""

    section: str
    what: str
    beside: str
    """What it is compared with; empty for a figure of its own."""
    value: float
    low: float
    high: float
    unit: str
    """"x": a ratio; else the unit."""
    bound: str = ""
    """"at least" or "at most"; empty where nothing must be reached."""
    target: float = 0.0
    how: str = ""

    @property
    def reached(self) -> bool | None:
        """Whether the median is on the right side of the target; None without a target."""
        if not self.bound:
            return None
        return self.value >= self.target if self.bound == "at least" else self.value <= self.target

    def cells(self) -> tuple[str, ...]:
        """What stands in its row of the table."""
        unit = "" if self.unit == "x" else f" {self.unit}"
        target = f"{self.bound} {self.target:g}{unit}" if self.bound else ""
        reached = {True: "yes", False: "NO", None: ""}[self.reached]
        spread = f"{number(self.low)} to {number(self.high)}"
        value = f"{number(self.value)}{unit}"
        return (self.section, self.what, self.beside, value, spread, target, reached, self.how)


def number(value: float) -> str:
    """Three significant digits, without an exponent where it can be helped."""
    if value != value:
        return "-"
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        digits = 3 - len(f"{abs(value):.0f}") if abs(value) >= 1 else 3
        return f"{value:,.{max(0, digits)}f}"
    return f"{value:.2e}"


def table(records: Iterable[Record]) -> str:
    """The records as a table of Markdown."""
    rows = [HEADINGS, *(record.cells() for record in records)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADINGS))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def machine() -> dict[str, Any]:
    """What the figures depend on: processor, cores in use, system, versions."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    return {
        "cpu": _cpu(),
        "cores of the machine": os.cpu_count(),
        "pinned to core": cores if len(cores) == 1 else "not pinned",
        "load when it began": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else "unknown",
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "versions": versions,
    }


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def headline(about: Mapping[str, Any]) -> str:
    """The machine in a few lines."""
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    pinned = about["pinned to core"]
    where = f"core {pinned[0]} of {about['cores of the machine']}" if isinstance(pinned, list) else pinned
    if about.get("share of the core") is not None:
        where += f" ({about['share of the core']:.0%} of its time)"
    return f"{about['cpu']}, {where}; {about['system']}, Python {about['python']}\n{versions}"


def save(folder: Path, about: Mapping[str, Any], records: Sequence[Record], curves: Mapping[str, Any]) -> None:
    """Write benchmark.json and benchmark.csv, and the pictures if matplotlib is installed."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [{**dataclasses.asdict(record), "reached": record.reached} for record in records]
    (folder / "benchmark.json").write_text(
        json.dumps({"machine": about, "records": rows, "curves": curves}, indent=1) + "\n", encoding="utf-8"
    )
    text = io.StringIO()
    writer = csv.DictWriter(
        text, [*(field.name for field in dataclasses.fields(Record)), "reached"], lineterminator="\n"
    )
    writer.writeheader()
    writer.writerows(rows)
    (folder / "benchmark.csv").write_text(text.getvalue(), encoding="utf-8")
