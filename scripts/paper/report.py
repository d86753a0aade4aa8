"""The table of the printed numbers beside ours, and the report."""

from __future__ import annotations

import collections
import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from agents.files import write_csv, write_json, write_text
from paper import measures
from paper.claim import Claim
from paper.config import Config
from paper.printed import FIGURE_9_X, FIGURE_9_Z, PRINTED
from paper.runs import Runs
from spring_pendulum_env import __version__, physics
from spring_pendulum_env.ode45 import REFINE
from spring_pendulum_env.simulation import Trajectory


@dataclasses.dataclass(frozen=True)
class Row:
    """A printed number and ours."""

    figure: str
    quantity: str
    paper: str
    ours: str
    motion: str
    """Section of configs/paper.yaml, with the constants and the start."""
    solver: str
    steps: int


def rows(runs: Runs) -> list[Row]:
    """What the paper prints, in its order."""

    def row(figure: str, quantity: str, paper: str, ours: str, motion: str, run: Trajectory, rtol: float) -> Row:
        return Row(figure, quantity, paper, ours, motion, f"ode45 {rtol:g}", (len(run.times) - 1) // REFINE)

    def per_cent(key: str) -> str:
        return f"{PRINTED[key]:g} %"

    config = runs.config
    spin, finer, chaos, single = runs.spinning, runs.spinning_finer, runs.chaotic, runs.single
    dive = measures.time_of_last_fall(chaos.times, chaos.energy)
    x, z = single.states[:, 0], single.states[:, 2]
    final, mean = "energy error, final (42)", "energy error, mean, signed"
    loose = ("spinning", spin, config.spinning.rtol)
    violent = ("chaotic", chaos, config.chaotic.rtol)
    free = ("single", single, config.single.rtol)
    return [
        row("3", final, per_cent("figure 3, final"), f"{100 * spin.energy_error:.2f} %", *loose),
        row("7", mean, per_cent("figure 7, mean"), f"{100 * spin.mean_energy_error:.3f} %", *loose),
        row("4", final, per_cent("figure 4, final"), f"{100 * finer.energy_error:.2f} %", "spinning", finer,
            config.spinning.finer_rtol),
        row("5, 6", final, per_cent("figure 5, final"), f"{100 * chaos.energy_error:.2f} %", *violent),
        row("5, 6", mean, per_cent("figure 5, mean"), f"{100 * chaos.mean_energy_error:.4f} %", *violent),
        row("6", "the dive", f"about {PRINTED['figure 6, dive']:g} s", f"{dive:.2f} s", *violent),
        row("9", "X1", f"within {FIGURE_9_X[1]:g}", f"{x.min():.1f} to {x.max():.1f} m", *free),
        row("9", "Z1", f"{FIGURE_9_Z[0]:g} to {FIGURE_9_Z[1]:g}", f"{z.min():.1f} to {z.max():.1f} m", *free),
    ]  # fmt: skip


def markdown(header: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table, its columns aligned for reading as plain text."""
    cells = [list(header), *map(list, lines)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(header))]
    texts = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |" for line in cells
    ]
    texts.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(texts)


def numbers_table(found: Sequence[Row]) -> str:
    """The printed numbers beside ours."""
    return markdown(
        ("figure", "quantity", "paper", "ours", "motion", "solver, RelTol", "steps"),
        [(r.figure, r.quantity, r.paper, r.ours, r.motion, r.solver, f"{r.steps:,}") for r in found],
    )


def motions_table(runs: Runs) -> str:
    """Constants, starts and times of the motions that the figures show."""
    config, lines = runs.config, []
    for name, motion, state, time in (
        ("spinning", config.spinning, config.spinning.start, f"{config.spinning.duration:g} s"),
        ("chaotic", config.chaotic, config.chaotic.start, f"{config.chaotic.duration:g} s"),
        ("periodic", config.periodic, runs.periodic_orbit.state, f"{runs.periodic.times[-1]:.4f} s"),
        ("single", config.single, runs.single_orbit.state, f"{runs.single.times[-1]:.4f} s"),
    ):
        p = motion.constants
        constants = " ".join(f"{key}={getattr(p, key):g}" for key in ("m1", "m2", "k1", "k2", "L1", "L2", "g"))
        digits = [f"{0.0 if abs(number) < 1e-12 else number:.6g}" for number in state]
        lines.append((name, constants, ", ".join(digits[:6]), ", ".join(digits[6:]), time))
    return markdown(("motion", "constants (SI)", "start: X1 Y1 Z1 X2 Y2 Z2 (m)", "rates (m/s)", "time"), lines)


def misprints() -> list[str]:
    """The paper's misprints, as physics.py lists them."""
    text = (physics.__doc__ or "").split("Misprints of the paper", 1)[1].split("\n\n")[1]
    return [" ".join(item.split()) for item in re.split(r"^- ", text, flags=re.MULTILINE) if item.strip()]


def report(runs: Runs, found: Sequence[Row], claims: Sequence[Claim], command: str) -> str:
    """All of it on a page."""
    count = collections.Counter(claim.verdict for claim in claims)
    items = [
        f"{number}. {claim.says} (Section {claim.section}.) **{claim.verdict.capitalize()}.** {claim.evidence}"
        for number, claim in enumerate(claims, start=1)
    ]
    return "\n".join(
        [
            "# The paper, reproduced",
            "",
            f"J. Pierce, *Double Spring Pendulum*, by `{command}` (spring_pendulum_env {__version__}). The paper "
            "prints no constants, starts or times: those here are fitted (configs/paper.yaml), and others would do "
            "as well. What its Figures 3 to 8 show is known to us from its text and captions alone, so the views are "
            "our choice; Figure 9's axes are the printed ones.",
            "",
            "## Its numbers beside ours",
            "",
            numbers_table(found),
            "",
            "The mean keeps its sign here, as in the paper's formula. ode45 is MATLAB's step control with AbsTol "
            f"{runs.config.spinning.atol:g} and four points of output for each step (spring_pendulum_env/ode45.py); "
            "the numbers hang on it.",
            "",
            motions_table(runs),
            "",
            f"## Its claims: {count['holds']} hold, {count['holds with a condition']} hold with a condition, "
            f"{count['fails']} fail{'s' if count['fails'] == 1 else ''}",
            "",
            "In our words:",
            "",
            *items,
            "",
            "![One spring: section, exponents, orbits without gravity](single-spring.png)",
            "",
            "Chaos of the elastic pendulum with gravity is well known: H. N. Núñez-Yépez, A. L. Salas-Brito, C. A. "
            "Vargas and L. Vicente, Phys. Lett. A 145 (1990) 101; J. P. van der Weele and E. de Kleine, Physica A "
            "228 (1996) 245. That only the inverse-square and the linear force close every bounded orbit is J. "
            "Bertrand's theorem, C. R. Acad. Sci. 77 (1873) 849. Errors of exponents are standard errors.",
            "",
            "## Its misprints",
            "",
            *(f"- {item}" for item in misprints()),
            "- The text after Figure 6 prints the mean errors in per cent and positive; its formula gives a "
            "fraction, and a negative one where energy is lost.",
            "",
            "Where they differ the code follows the Lagrangian. (12), (14) and (35) may be faults of our copy's text.",
            "",
            *_pictures(),
        ]
    )


def _pictures() -> list[str]:
    lines = ["## Its figures", ""]
    lines += [f"![Figure {number}](figure-{number}.png)" for number in range(3, 10)]
    return [*lines, "![Air resistance](air-resistance.png)", ""]


def save(folder: Path, text: str, found: Sequence[Row], claims: Sequence[Claim], config: Config) -> None:
    """The report, the table as CSV, and everything as JSON."""
    write_text(folder / "report.md", text)
    write_csv(folder / "numbers.csv", [dataclasses.asdict(row) for row in found])
    write_json(
        folder / "paper.json",
        {
            "version": __version__,
            "config": config.model_dump(mode="json"),
            "numbers": [dataclasses.asdict(row) for row in found],
            "claims": [dataclasses.asdict(claim) for claim in claims],
        },
    )
