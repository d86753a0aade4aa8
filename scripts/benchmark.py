"""How fast the environments are beside others of their kind: ratios from one run, on one core.

In every round each subject runs once for a short while; ratios are formed within a round, so that what else the
machine does meanwhile falls on both sides, and medians and quartiles are taken over the rounds. The clock counts the
seconds that the processor gives to this process and its threads, so that a busy machine changes little.
"""

from __future__ import annotations

import os

if __name__ == "__main__":  # before NumPy and JAX are imported: one thread each, and JAX on the processor
    os.environ.update(
        dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
        JAX_PLATFORMS="cpu",
        XLA_FLAGS="--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    )

import argparse
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
from benchmarks import batch, equal_error, parts, passive, scaling, single, start
from benchmarks.measuring import QUICK, Bench, Effort, SkippedError
from benchmarks.pictures import draw
from benchmarks.report import headline, machine, save, table

SECTIONS: Mapping[str, Callable[[Bench], None]] = {
    "single": single.measure,
    "batch": batch.measure,
    "passive": passive.measure,
    "mujoco": equal_error.measure,
    "scaling": scaling.measure,
    "parts": parts.measure,
    "start": start.measure,
}


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message: str) -> Any:
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(2)


def options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line, checked."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("runs/benchmark"), help="for the files (%(default)s)")
    parser.add_argument("--only", default=",".join(SECTIONS), help="sections, by commas (%(default)s)")
    parser.add_argument("--rounds", type=int, help=f"rounds of each section ({Effort.rounds}, quick {QUICK.rounds})")
    parser.add_argument("--quick", action="store_true", help="few rounds, passive runs of 100 s: to see that it works")
    given = parser.parse_args(arguments)
    given.only = [name.strip() for name in given.only.split(",")]
    for name in given.only:
        if name not in SECTIONS:
            parser.error(f"--only: unknown section {name!r}: must be some of {','.join(SECTIONS)}")
    if given.rounds is not None and given.rounds < 1:
        parser.error(f"--rounds {given.rounds}: must be at least 1")
    if given.folder.exists() and not given.folder.is_dir():
        parser.error(f"--folder {given.folder}: is a file")
    return given


def pin_to_one_core() -> None:
    """Keeps this process and those it starts on one core, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main(arguments: Sequence[str] | None = None) -> None:
    given = options(arguments)
    effort = QUICK if given.quick else Effort()
    if given.rounds is not None:
        effort = Effort(**{**vars(effort), "rounds": given.rounds, "slow_rounds": given.rounds, "starts": given.rounds})
    warnings.filterwarnings("ignore")  # the peers' own
    gym.logger.min_level = gym.logger.ERROR
    pin_to_one_core()
    about = machine()
    bench = Bench(effort)
    for name in SECTIONS:
        if name in given.only:
            bench.say(f"measuring: {name}")
            try:
                SECTIONS[name](bench)
            except SkippedError as error:
                bench.say(str(error))
    about["share of the core"] = round(bench.spent / bench.passed, 3) if bench.passed else None
    print(headline(about))
    print(f"medians of {effort.rounds} rounds ({effort.slow_rounds} beside SciPy); x: times as fast\n")
    print(table(bench.records))
    about["effort"] = vars(effort)
    save(given.folder, about, bench.records, bench.curves)
    try:
        draw(given.folder, about, bench.records, bench.curves)
    except ModuleNotFoundError:
        bench.say("matplotlib: not installed, no pictures")
    print(f"\nTable, numbers and pictures: {given.folder}")


if __name__ == "__main__":
    try:
        main()
    except (ValueError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        raise SystemExit(130) from None
