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
    parser.add_argument(
        "--docs", action="store_true", help="put tables and figures into docs/control and README.md too"
    )
    options = parser.parse_args()

    from agents import leaderboard, leaderboard_pages  # slow to import: after the arguments were read
    from agents.entries import find_all
    from agents.evaluation import STARTS, TRIALS, trial_named
    from agents.files import write_text

    trials = [trial_named(name) for name in options.trial or TRIALS]
    for name in dict.fromkeys([*options.anew, *options.fill]):
        from agents.slow import fill

        fill(name, trials, options.slow_starts, anew=name in options.anew)
    if options.docs and (options.trial or options.starts):
        raise ValueError("--docs is for all trials and starts; allowed is it without --trial and --starts")
    rows_of = leaderboard.collect(
        options.folder / "scores",
        trials=trials,
        more=find_all(options.entries),
        starts=options.starts or STARTS,
        told=lambda text: print(text, file=sys.stderr, flush=True),
    )
    parts = leaderboard_pages.parts(rows_of)
    text = leaderboard_pages.whole(parts)
    print(text)
    write_text(options.folder / "leaderboard.md", text + "\n")
    leaderboard_pages.write_figures(rows_of, options.folder)
    print(f"\ntables, numbers and figures: {options.folder}", file=sys.stderr)
    if options.docs:
        leaderboard_pages.write_docs(rows_of, parts)
        print(f"and in {leaderboard_pages.DOCS} and {leaderboard_pages.README}", file=sys.stderr)


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
