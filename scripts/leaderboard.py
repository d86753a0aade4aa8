"""Score everything by the protocol, print the tables and draw the figures, into runs/leaderboard.

NMPC's and the open-loop optimum's rows come from their saved episodes in agents/results; --anew finds them once more,
which takes hours. Entries can be added: scripts/leaderboard.py "runs/damping-ppo-seed*".
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", nargs="*", metavar="ENTRY", help="further entries: run folders or patterns of them")
    parser.add_argument("--trial", action="append", help="only this one; may be given many times")
    parser.add_argument("--starts", type=int, help="starts of each trial (default: 1,000)")
    parser.add_argument("--folder", type=Path, default=Path("runs/leaderboard"))
    parser.add_argument("--anew", action="append", choices=("nmpc", "optimum"), default=[])
    parser.add_argument(
        "--fill", action="append", choices=("nmpc", "optimum"), default=[], help="what is not saved yet"
    )
    parser.add_argument("--slow-starts", type=int, default=100, help="starts of NMPC and the optimum (default: 100)")
    options = parser.parse_args()

    from agents import leaderboard  # slow to import: after the arguments were read
    from agents.entries import find_all
    from agents.evaluation import STARTS, TRIALS, trial_named
    from agents.files import write_csv, write_text

    trials = [trial_named(name) for name in options.trial or TRIALS]
    for name in dict.fromkeys([*options.anew, *options.fill]):
        from agents.slow import fill

        fill(name, trials, options.slow_starts, anew=name in options.anew)
    rows_of = leaderboard.collect(
        options.folder / "scores",
        trials=trials,
        more=find_all(options.entries),
        starts=options.starts or STARTS,
        told=lambda text: print(text, file=sys.stderr, flush=True),
    )
    text = []
    for trial, rows in rows_of.items():
        text += [leaderboard.heading(trial), "", leaderboard.table(trial, rows), ""]
        text += [line for sentence in leaderboard.differences(trial, rows) for line in (sentence, "")]
    text += ["### Share of starts recovered or settled", "", leaderboard.summary(rows_of)]
    print("\n".join(text))
    write_text(options.folder / "leaderboard.md", "\n".join(text) + "\n")
    numbers = [line for trial, rows in rows_of.items() for line in leaderboard.statistics_rows(trial, rows)]
    write_csv(options.folder / "leaderboard.csv", numbers)

    from agents.leaderboard_plots import plot_damping, plot_shares

    plot_shares(rows_of, options.folder / "shares.png")
    plot_damping(rows_of, options.folder / "damping.png")
    print(f"\ntables, numbers and figures: {options.folder}", file=sys.stderr)


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
