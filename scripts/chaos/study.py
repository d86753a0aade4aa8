"""The share of chaotic starts on a surface of constant energy, against energy and against stiffness."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.files import write_csv, write_text
from agents.statistics import estimate
from chaos.config import Study
from spring_pendulum_env import Parameters, physics
from spring_pendulum_env.dynamics import Indicators, chaos_indicators, microcanonical_starts
from spring_pendulum_env.dynamics.flow import Flow
from spring_pendulum_env.dynamics.progress import Progress

MOTIONS = {"plane": True, "space": False}
"""Names of the two kinds of motion, and whether they stay in a vertical plane."""

NEAR_MISS_PHASE = 0.08
"""Where the energy could squeeze spring 1 to nothing, near misses of zero length are many, and a step is no longer than
this part of the fastest mode, rad: with usual steps, most would have to be done again in finer ones, one motion at a
time. (At 1,000 J and 100 N/m that takes twice as long, measured.)"""


@dataclasses.dataclass(frozen=True)
class Point:
    """One energy surface."""

    motion: str
    stiffness: float  # N/m, of both springs
    energy: float  # J above hanging rest

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.motion}-k{self.stiffness:g}-E{self.energy:g}"

    def seed(self, seed: int) -> int:
        """Of its starts: another for each point, whatever other points there are."""
        bits = np.array([self.stiffness, self.energy]).view(np.uint32).tolist()
        return int(np.random.SeedSequence([seed, MOTIONS[self.motion], *bits]).generate_state(1)[0])


@dataclasses.dataclass(frozen=True)
class Row:
    """What was found at a point: a line of the table."""

    panel: str
    motion: str
    stiffness: float
    energy: float
    starts: int
    unknown: int  # came too near a spring's zero length to be followed
    chaotic: int
    share: float
    low: float  # Wilson's 95 % interval
    high: float
    share_halfway: float
    agreement: float  # share of starts for which half the duration says the same
    median_exponent: float  # 1/s, of all starts
    largest_energy_error: float


def points(study: Study) -> Iterator[tuple[str, Point]]:
    """All points with their panel, in the order of the table."""
    for motion in MOTIONS:
        for energy in study.energy_panel.energies:
            yield "energy", Point(motion, study.energy_panel.stiffness, energy)
        for stiffness in study.stiffness_panel.stiffnesses:
            yield "stiffness", Point(motion, stiffness, study.stiffness_panel.energy)


def run(study: Study, folder: Path, progress: bool = True) -> list[Row]:
    """Follow all starts and write table.csv and config.yaml; goes on with what a run before has left in the folder.

    Raises:
        ValueError: a wrong parameter, or a folder of another study.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = list(points(study))
    unique = sorted({point for _, point in wanted}, key=lambda point: (point.stiffness, point.energy, point.motion))
    for point in unique:
        Parameters.of({**study.parameters, "k1": point.stiffness, "k2": point.stiffness})
    write_text(folder / "config.yaml", study.to_yaml())
    found: dict[Point, Indicators] = {}
    files = {point: folder / "points" / f"{point.name}.npz" for point in unique}
    there = [point for point in unique if files[point].exists()]
    with Progress("order and chaos", len(unique), done=len(there), show=progress) as bar:
        for point in [*there, *(point for point in unique if point not in there)]:
            found[point] = follow(study, point, files[point])
            bar.add(point not in there)
    rows = [row(panel, point, found[point]) for panel, point in wanted]
    write_csv(folder / "table.csv", [dataclasses.asdict(row) for row in rows])
    return rows


def follow(study: Study, point: Point, file: Path | None = None) -> Indicators:
    """The indicators of the starts at a point."""
    p = Parameters.of({**study.parameters, "k1": point.stiffness, "k2": point.stiffness})
    plane = MOTIONS[point.motion]
    states = microcanonical_starts(p, point.energy, study.starts, plane=plane, seed=point.seed(study.seed))
    step = Flow(p).longest_step
    if point.energy > squeezing_energy(p):
        _, _, _, w1, w2, k1, k2, *_ = p.constants("")
        step = min(step, NEAR_MISS_PHASE / float(physics.fastest_frequency(0.0, w1, w2, k1, k2)))
    return chaos_indicators(p, states, study.duration, plane=plane, longest_step=step, seed=study.seed, file=file)


def squeezing_energy(p: Parameters) -> float:
    """Energy that squeezes spring 1 to no length, J."""
    return float(physics.spring_energy(0.0, 0.0, 0.0, p.k1, p.L1))


def row(panel: str, point: Point, found: Indicators) -> Row:
    """The line of the table for a point."""
    known = found.known
    if not known.any():
        raise ArithmeticError(f"{point.name}: no motion could be followed to the end")
    chaotic = found.chaotic[known]
    share = estimate(chaotic.astype(float), "share")
    return Row(
        panel=panel,
        motion=point.motion,
        stiffness=point.stiffness,
        energy=point.energy,
        starts=len(known),
        unknown=int((~known).sum()),
        chaotic=int(chaotic.sum()),
        share=share.value,
        low=share.low,
        high=share.high,
        share_halfway=float(found.chaotic_halfway[known].mean()),
        agreement=float((chaotic == found.chaotic_halfway[known]).mean()),
        median_exponent=float(np.median(found.exponent[known])),
        largest_energy_error=float(found.energy_error[known].max()),
    )


def table(rows: Sequence[Row]) -> str:
    """Markdown."""
    lines = [
        "| motion | k (N/m) | energy (J) | chaotic | 95 % interval | after half the time | median exponent (1/s) |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.motion} | {row.stiffness:g} | {row.energy:g} | {row.share:.3f} | {row.low:.3f} to {row.high:.3f} "
        f"| {row.share_halfway:.3f} | {row.median_exponent:.2g} |"
        for row in rows
    ]
    return "\n".join(lines)


def convergence(study: Study, rows: Sequence[Row]) -> str:
    """How far the duration is long enough, in words."""
    known = np.array([row.starts - row.unknown for row in rows])
    agreement = float(np.average([row.agreement for row in rows], weights=known))
    worst: Any = min(rows, key=lambda row: row.agreement)
    reached = "reached" if agreement >= study.least_agreement else "NOT reached"
    return (
        f"{study.duration / 2:g} s and {study.duration:g} s say the same for {100 * agreement:.1f} % of the starts "
        f"(at least {100 * study.least_agreement:g} % wanted: {reached});\n"
        f"worst at {Point(worst.motion, worst.stiffness, worst.energy).name}: {100 * worst.agreement:.1f} %. "
        f"{sum(row.unknown for row in rows)} of {sum(row.starts for row in rows)} starts came too near a spring's zero "
        f"length to be followed.\nLargest energy error: {max(row.largest_energy_error for row in rows):.1e}."
    )
