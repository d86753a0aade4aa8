"""What controllers bear: success against wrong parameters, noise, delay, kicks and wilder starts.

Entries are those of scripts/evaluate.py; without any, LQR, tuned LQR, the damper and the shipped policies. NMPC, which
takes seconds for an episode, is only played at inverted-inverted and on as many starts as --nmpc-starts says. Tables,
numbers and figures go to runs/robustness; what was played before isn't played again.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", nargs="*", metavar="ENTRY")
    parser.add_argument("--task", action="append", help="damping or an equilibrium; may be given many times")
    parser.add_argument("--sweep", action="append", help="parameters, noise, delay, kick or spread; many times")
    parser.add_argument("--starts", type=int, help="of each point (default: 300)")
    parser.add_argument("--nmpc-starts", type=int, default=0, help="of NMPC (default: 0; 20 take about an hour)")
    parser.add_argument("--folder", type=Path, default=Path("runs/robustness"))
    parser.add_argument("--docs", action="store_true", help="put tables and figures into docs/control too")
    options = parser.parse_args()

    from agents import pages, robustness  # slow to import: after the arguments were read
    from agents.entries import CLASSICAL, find_all
    from agents.files import write_csv, write_text
    from agents.leaderboard import shipped_entries
    from agents.leaderboard_pages import DOCS
    from agents.robustness_plots import plot_region, plot_sweeps

    known = {robustness.label(base): base for base in robustness.BASES}
    for task in options.task or []:
        if task not in known:
            raise ValueError(f"task is {task!r}; allowed are {', '.join(known)}")
    for name in ("starts", "nmpc_starts"):
        value = getattr(options, name)
        if value is not None and value < (name == "starts"):
            raise ValueError(
                f"--{name.replace('_', '-')} is {value}; allowed is a number from {int(name == 'starts')} on"
            )
    if options.docs and (options.entries or options.task or options.sweep or options.starts):
        raise ValueError("--docs is for all entries, tasks, sweeps and starts; allowed beside it is --nmpc-starts")
    usual = [*(CLASSICAL[name] for name in ("lqr", "lqr-tuned", "damper", "nmpc")), *shipped_entries()[0]]
    chosen = find_all(options.entries) or usual
    results = robustness.collect(
        chosen,
        options.folder / "played",
        bases=[known[task] for task in options.task or known],
        sweeps=[robustness.sweep_named(name) for name in options.sweep or robustness.SWEEPS],
        starts=options.starts or robustness.STARTS,
        slow_starts=options.nmpc_starts,
        told=lambda text: print(text, file=sys.stderr, flush=True),
    )
    text = robustness.tables(results)
    print(text)
    write_text(options.folder / "robustness.md", text)
    for folder in (options.folder, *((DOCS,) if options.docs else ())):
        write_csv(folder / "robustness.csv", robustness.rows(results))
        plot_sweeps(results, folder / "robustness.png")
        plot_region(results, folder / "region.png")
    if options.docs:
        pages.put(DOCS / "robustness.md", "tables", text)
    print(f"tables, numbers and figures: {options.folder}", file=sys.stderr)


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
