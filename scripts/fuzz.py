"""Fuzz the environments: random parameters from a thousandth to a thousand times the defaults, all tasks, both schemes,
alone and side by side.

Whatever comes must be finite numbers or a clear error, the same again when it is repeated. Each case is drawn from the
seed and its number, so a finding is repeated by the command that is printed with it. What was done is kept in
runs/fuzz: the same command goes on where it stopped. Ends with a table, and with a status of 1 if anything was found.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import hashlib
import json
import math
import os
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import gymnasium as gym
import numpy as np
from tqdm import tqdm  # type: ignore[import-untyped]

from agents import commands
from agents.files import write_json
from agents.tables import markdown
from spring_pendulum_env import EQUILIBRIA, Parameters
from spring_pendulum_env.tasks import TASKS

LONGEST_CASE = 0.2
"""Processor seconds after which a case ends: the stiffest take milliseconds for each step."""
SAVE_EVERY = 10.0
"""Seconds."""
REPEATED = 20
"""One case in so many is run twice, and must give the same bits."""
MEMORY_POINTS = 20
"""Of the steps, evenly spread, at which the memory is looked at."""
USUAL_DRAG = 0.1
"""kg/s, of which the drag coefficients, whose defaults are zero, are multiples."""

ERRORS = {
    "would be compressed to nothing": "make: springs that can't hold the equilibrium",
    "to hold the masses": "make: a spring that is missing where the task needs one",
    "steps of the splitting": "make: a control period of more than 62,500 steps of the splitting",
    "must leave the energy at rest": "make: numbers beyond the range",
    "the springs' frequency is beyond": "make: numbers beyond the range",
    "steps of the adaptive scheme": "step: more than a million steps of the adaptive scheme",
    "has left the range": "step: the motion has left the range of numbers",
}
"""What the clear errors say, and what the table calls them."""


@dataclass(frozen=True)
class Case:
    """An environment, and what is done with it."""

    environment_id: str
    rows: int  # 0: a single environment
    arguments: dict[str, Any]
    steps: int
    seed: int


@dataclass
class Record:
    """What was done so far."""

    seed: int
    cases: int = 0
    steps: int = 0
    by_kind: dict[str, int] = field(default_factory=dict)
    errors: dict[str, int] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    repeated: int = 0
    slowest: float = 0.0  # s, for one pendulum
    slowest_case: int = 0
    memory: list[tuple[int, float]] = field(default_factory=list)  # steps, MB; since the process began
    seconds: float = 0.0


def drawn_case(seed: int, number: int) -> Case:
    """The case of that number."""
    random = np.random.default_rng([seed, number])
    environment_id = str(random.choice(list(TASKS)))
    task = TASKS[environment_id]

    def factor() -> float:
        return float(10.0 ** random.uniform(-3, 3))

    parameters = {}
    for name, usual in Parameters().as_dict().items():
        value = (usual or USUAL_DRAG) * factor()
        if name[0] != "m" and random.random() < (0.5 if name[0] == "R" else 0.03):
            value = 0.0  # as it legally may be
        if random.random() < 0.8:
            parameters[name] = value
    adaptive = random.random() < 0.35
    arguments: dict[str, Any] = {
        "parameters": parameters,
        "tolerance": float(10.0 ** random.uniform(-13, -4)) if adaptive else None,
        "start_scale": float(10.0 ** random.uniform(-1, 1)),
    }
    if random.random() < 0.3:
        arguments["control_period"] = 0.02 * float(10.0 ** random.uniform(-3, 1))
    if random.random() < 0.2:
        name = str(random.choice(Parameters.names()))
        value = getattr(Parameters(), name) or USUAL_DRAG
        arguments["randomise"] = {name: sorted((value * factor(), value * factor()))}
    if task.actuated:
        arguments["max_force"] = 20.0 * factor()
        arguments["anchor_travel"] = 2.0 * factor()
        arguments["actuated_axes"] = str(random.choice(["xyz", "xyz", "xz", "y", ""]))
    if task.chooses_equilibrium:
        arguments["equilibrium"] = str(random.choice(EQUILIBRIA))
    rows = int(random.choice([0, 0, 3, 64, 70] if adaptive else [0, 0, 0, 3, 64, 150]))
    if rows:
        arguments["autoreset_mode"] = str(random.choice(["NEXT_STEP", "SAME_STEP"]))
    steps = int(random.integers(100, 2000) if rows == 0 else random.integers(5, 60))
    return Case(environment_id, rows, arguments, steps, int(random.integers(2**31)))


class Finding(Exception):
    """Something that must not be."""


def check(told: Any, digest: Any = None) -> None:
    """Raises a Finding where a number isn't finite; adds the bytes of all to a digest."""
    if isinstance(told, dict):
        for value in told.values():
            check(value, digest)
    elif isinstance(told, tuple) or (isinstance(told, np.ndarray) and told.dtype == object):
        for value in told:
            check(value, digest)
    elif told is not None:
        finite = math.isfinite(told) if isinstance(told, float) else np.isfinite(told).all()
        if not finite:
            raise Finding(f"a number that isn't finite without an error: {told}")
        if digest is not None:
            digest.update(np.asarray(told, dtype=np.float64).tobytes())


def error_kind(error: Exception) -> str:
    """The name of a clear error; raises a Finding of any other."""
    if isinstance(error, (ValueError, FloatingPointError)):
        for said, kind in ERRORS.items():
            if said in str(error):
                return kind
    raise Finding(f"{type(error).__name__}: {error}") from error


def run_case(case: Case, record: Record, number: int, longest: float = LONGEST_CASE) -> tuple[str, int]:
    """What the environment told, as a digest, of a case that is run twice; and how many steps it made.

    Counts steps, errors and times. Ends after the steps of the case, or so many seconds.

    Raises:
        Finding: something that must not be.
    """
    digest = hashlib.sha256() if number % REPEATED == 0 else None
    made: Any = None
    done = 0
    try:
        if case.rows:
            made = gym.make_vec(case.environment_id, num_envs=case.rows, **case.arguments)
        else:
            made = gym.make(case.environment_id, disable_env_checker=True, **case.arguments)
        random = np.random.default_rng(case.seed)
        check(made.reset(seed=case.seed), digest)
        until = time.thread_time() + longest
        while done < case.steps and time.thread_time() < until:
            action = random.uniform(-1.2, 1.2, made.action_space.shape)
            began = time.thread_time()
            told = made.step(action)
            taken = (time.thread_time() - began) / max(case.rows, 1)
            done += 1
            if taken > record.slowest:
                record.slowest, record.slowest_case = taken, number
            record.steps += max(case.rows, 1)
            check(told, digest)
            if not case.rows and (told[2] or told[3]):
                check(made.reset(), digest)
    except Finding:
        raise
    except Exception as error:
        kind = error_kind(error)
        record.errors[kind] = record.errors.get(kind, 0) + 1
        return kind, done + 1  # the next step, which fails again when it is repeated
    finally:
        if made is not None:
            made.close()
    return digest.hexdigest() if digest else "", done


def play(record: Record, number: int) -> None:
    """Runs a case, now and then a second time, and books what came."""
    case = drawn_case(record.seed, number)
    before = record.steps
    try:
        first, done = run_case(case, record, number)
        if number % REPEATED == 0:
            record.repeated += 1
            again, _ = run_case(dataclasses.replace(case, steps=done), Record(record.seed), number, longest=math.inf)
            if again != first:
                raise Finding("other bits when repeated")
    except Finding as finding:
        command = f"scripts/fuzz.py --seed {record.seed} --case {number}"
        record.findings.append(f"{finding}; again by: {command}")
        tqdm.write(record.findings[-1], file=sys.stderr)
    scheme = "splitting" if case.arguments["tolerance"] is None else "adaptive"
    kinds = Counter(record.by_kind)
    kinds[f"{case.environment_id}, {scheme}, {'batch' if case.rows else 'single'}"] += record.steps - before
    record.by_kind = dict(kinds)
    record.cases += 1


def resident() -> float:
    """Memory of this process, MB; NaN where /proc doesn't tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def fuzz(record: Record, steps: int, path: Path) -> None:
    """Plays until so many steps are done, saving as it goes."""
    began, saved = time.monotonic() - record.seconds, time.monotonic()
    record.memory = []
    gap = max(1, (steps - record.steps) // MEMORY_POINTS)
    with tqdm(total=steps, initial=record.steps, unit="step", unit_scale=True) as bar:
        while record.steps < steps:
            before = record.steps
            play(record, record.cases)
            bar.update(record.steps - before)
            if before // gap != record.steps // gap:
                gc.collect()
                record.memory.append((record.steps, resident()))
            record.seconds = time.monotonic() - began
            if time.monotonic() - saved > SAVE_EVERY or record.steps >= steps:
                write_json(path, asdict(record))
                saved = time.monotonic()


def table(record: Record) -> str:
    """What was done and what came of it."""
    rows = [["", "steps"], *([kind, f"{count:,}"] for kind, count in sorted(record.by_kind.items()))]
    rows.append(["all", f"{record.steps:,}"])
    errors = [["clear errors", "cases"], *([kind, f"{count:,}"] for kind, count in sorted(record.errors.items()))]
    memory = "not known"
    if record.memory:
        sizes = [size for _, size in record.memory]
        memory = f"{sizes[0]:.0f} MB after {record.memory[0][0]:,} steps, {sizes[-1]:.0f} MB after "
        memory += f"{record.memory[-1][0]:,}, at most {max(sizes):.0f} MB"
    facts = [
        ["", ""],
        ["cases", f"{record.cases:,}, {record.repeated:,} of them twice"],
        ["findings", f"{len(record.findings)}"],
        ["slowest step of a pendulum", f"{record.slowest:.3g} s, in case {record.slowest_case}"],
        ["memory", memory],
        ["time", f"{record.seconds:,.0f} s"],
    ]
    return "\n\n".join([markdown(rows), markdown(errors), markdown(facts), *record.findings])


def main() -> None:
    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=float, default=1e7, help="steps of a pendulum in all (default: 10 million)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", type=int, help="only this one, and what it is")
    parser.add_argument("--folder", type=Path, default=Path("runs/fuzz"))
    options = parser.parse_args()
    if options.seed < 0 or not options.steps >= 1 or (options.case or 0) < 0:
        raise ValueError("--seed and --case must not be negative, --steps at least 1")
    if options.case is not None:
        record = Record(options.seed, cases=options.case)
        print(drawn_case(options.seed, options.case))
        play(record, options.case)
    else:
        path = options.folder / f"seed{options.seed}.json"
        record = read_record(path) if path.is_file() else Record(options.seed)
        fuzz(record, int(options.steps), path)
    print(table(record))
    if record.findings:
        raise SystemExit(1)


def read_record(path: Path) -> Record:
    """What an interrupted run had done.

    Raises:
        ValueError: the file is no such record.
    """
    try:
        return Record(**json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is no record of this script: {error}; remove it to begin anew") from None


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
