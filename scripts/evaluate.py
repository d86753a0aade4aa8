"""Score controllers on starts that no training has seen: scripts/evaluate.py runs/NAME, or several at once by name.

One run folder or shipped policy alone is played in the environment of its config, beside LQR and doing nothing, and
drawn. With --trial, entries are scored by the protocol: 1,000 starts each, saved as they come in runs/scores. Entries
are nothing, drag, damper, lqr, lqr-tuned, nmpc, a shipped policy, a run folder, or a pattern of run folders (the seeds
of one training).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands, runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", nargs="+", metavar="ENTRY", help="run folder, shipped policy, or another entry")
    parser.add_argument("--trial", action="append", help='such as damping or inverted-inverted-0.05; "all"; many times')
    parser.add_argument("--episodes", type=int, help="starts (default: 100, with --trial 1,000)")
    parser.add_argument("--folder", type=Path, help="where the results go")
    parser.add_argument("--animation", action="store_true", help="write a GIF too (of one run without --trial)")
    options = parser.parse_args()
    if options.trial:
        score(options)
    elif len(options.entries) == 1:
        compare(options)
    else:
        raise ValueError(f"--trial is missing for the entries {', '.join(options.entries)}; allowed is also one run")


def compare(options: argparse.Namespace) -> None:
    """One run in its own environment, with pictures."""
    source = runs.find_run(options.entries[0])

    from agents import load  # slow to import: after the check above
    from agents.comparison import compare

    policy = load(source)
    folder = options.folder or source / "evaluation"
    print(compare(policy, policy.config, folder, episodes=options.episodes or 100, animation=options.animation))
    print(f"\ntable, numbers and pictures: {folder}")


def score(options: argparse.Namespace) -> None:
    """Entries by the protocol."""
    from agents.entries import find_all
    from agents.evaluation import STARTS, TRIALS, trial_named
    from agents.leaderboard import trial_table

    entries = find_all(options.entries)
    trials = [trial_named(name) for name in (TRIALS if "all" in options.trial else options.trial)]
    for trial in trials:
        print(trial_table(trial, entries, options.folder or Path("runs/scores"), options.episodes or STARTS))


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
