"""Score controllers on starts that no training has seen: scripts/evaluate.py runs/NAME, or several at once by name.

One run folder or shipped policy alone is played in the environment of its config, beside LQR and doing nothing, and
drawn. With --trial, entries are scored by the protocol: 1,000 starts each, saved as they come in runs/scores. Entries
are nothing, drag, damper, lqr, lqr-tuned, nmpc, a shipped policy, a run folder, or a pattern of run folders (the seeds
of one training).

The .zip of a policy that Stable-Baselines3 or its Zoo has saved is played alone too, with --trust: to load it may run
whatever its author has put there.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands, runs
from agents.config import ENVIRONMENT_IDS, Config, check_config
from agents.controller import Controller
from agents.trusted import is_archive
from agents.trusted import load as load_archive


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", nargs="+", metavar="ENTRY", help="run folder, shipped policy, or another entry")
    parser.add_argument("--trial", action="append", help='such as damping or inverted-inverted-0.05; "all"; many times')
    parser.add_argument("--episodes", type=int, help="starts (default: 100, with --trial 1,000)")
    parser.add_argument("--folder", type=Path, help="where the results go")
    parser.add_argument("--animation", action="store_true", help="write a GIF too (of one run without --trial)")
    parser.add_argument("--trust", action="store_true", help="load the .zip of somebody whom you trust")
    parser.add_argument("--task", choices=ENVIRONMENT_IDS, default="damping", help="for a .zip (default: damping)")
    parser.add_argument("--equilibrium", help="for a .zip, of the stabilisation task")
    options = parser.parse_args()
    if options.trial:
        score(options)
    elif len(options.entries) == 1:
        compare(options)
    else:
        raise ValueError(f"--trial is missing for the entries {', '.join(options.entries)}; allowed is also one run")


def compare(options: argparse.Namespace) -> None:
    """One run in its own environment, with pictures."""
    if is_archive(options.entries[0]):
        return compare_archive(options)
    source = runs.find_run(options.entries[0])

    from agents import load  # slow to import: after the check above

    policy = load(source)
    folder = options.folder or source / "evaluation"
    return show(policy, policy.config, folder, options)


def compare_archive(options: argparse.Namespace) -> None:
    """The same for an archive of Stable-Baselines3."""
    path = Path(options.entries[0])
    environment = {"equilibrium": options.equilibrium} if options.equilibrium else {}
    config = check_config({"task": options.task, "environment": environment}, source=str(path))
    policy = load_archive(path, config.environment_id, "xyz", trust=options.trust)
    show(policy, config, options.folder or path.with_suffix("").with_name(f"{path.stem}-evaluation"), options)


def show(policy: Controller, config: Config, folder: Path, options: argparse.Namespace) -> None:
    """Table and pictures."""
    from agents.comparison import compare

    print(compare(policy, config, folder, episodes=options.episodes or 100, animation=options.animation))
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
