"""Score a trained policy beside doing nothing and LQR, on starts that no training has seen."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands, runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", help="run folder, or name of a shipped policy")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--folder", type=Path, help="where the results go (default: evaluation/ in the run folder)")
    parser.add_argument("--animation", action="store_true", help="write a GIF too")
    options = parser.parse_args()
    source = runs.find_run(options.run)

    from agents import load  # slow to import: after the check above
    from agents.comparison import compare

    policy = load(source)
    folder = options.folder or source / "evaluation"
    print(compare(policy, policy.config, folder, episodes=options.episodes, animation=options.animation))
    print(f"\ntable, numbers and pictures: {folder}")


if __name__ == "__main__":
    commands.run(main)
