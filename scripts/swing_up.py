"""Swing both springs up: plans, NMPC, LQR, nothing and learned policies on the same unseen starts.

What a plan needs is found anew from each start and saved as it comes, so the same command goes on where it stopped.
Entries are run folders of `scripts/train.py swing-up`, or patterns of several. Tables and picture go to runs/swing-up.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", nargs="*", metavar="ENTRY", help="run folder of a training")
    parser.add_argument("--starts", type=int, default=100, help="starts for all but NMPC (default: 100)")
    parser.add_argument("--nmpc-starts", type=int, default=0, help="for NMPC, about a minute each (default: 0)")
    parser.add_argument("--limits", action="store_true", help="in how little time and with how little force it can be")
    parser.add_argument("--for-training", action="store_true", help="only write states along plans, plans.npz")
    parser.add_argument("--folder", type=Path, default=Path("runs/swing-up"))
    options = parser.parse_args()
    for name, value, least in (("starts", options.starts, 1), ("nmpc-starts", options.nmpc_starts, 0)):
        if value < least:
            raise ValueError(f"--{name} is {value}; allowed is a number from {least} on")

    from agents import swing_up_results as results  # slow to import: after the arguments were read
    from agents.entries import find_all
    from agents.files import write_text
    from agents.swing_up_plots import plot_swing_ups

    def told(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    if options.for_training:
        path = options.folder / "plans.npz"
        print(f"{results.states_along_plans(path)} states along plans: {path}")
        return
    entries = find_all(options.entries)
    values = results.scores(entries, options.folder, options.starts)
    values |= results.fill(options.folder, options.starts, options.nmpc_starts, told)
    text = results.table(values)
    if options.limits:
        text += "\n\nEffort (N2 s) of plans from hanging rest, by their length and the force allowed; -: none found\n\n"
        text += results.limits(options.folder, told)
    print(text)
    write_text(options.folder / "swing-up.md", text + "\n")
    learned = {entry.title: entry.controllers(results.TRIAL)[0] for entry in entries}
    plot_swing_ups(results.play({"plan": results.planner()} | learned), options.folder / "swing-up.png")
    print(f"tables and picture: {options.folder}", file=sys.stderr)


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
