"""The main job in one go: train a damping policy, compare it with doing nothing and with LQR, and show it at work."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands
from agents.config import default_path, read_config

STEPS = 2_000_000
"""A quarter of what configs/damping-shac.yaml has: a minute or two, and beyond LQR already."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="where everything goes (default: runs/demo-DATE-TIME)")
    parser.add_argument("--episodes", type=int, default=100, help="unseen starts to evaluate on")
    commands.add_changes(parser)
    options = parser.parse_args()
    config = read_config(default_path("damping", "shac"), [f"training.steps={STEPS}", *options.changes])
    folder = options.folder or Path("runs") / time.strftime("demo-%Y%m%d-%H%M%S")

    from agents.comparison import compare  # slow to import: after the checks above
    from agents.training import train

    print(
        f"Training a policy that damps the pendulum: {config.training.steps:,} steps of SHAC, added to LQR, in {folder}"
    )
    policy = train(config, folder)
    print(f"Evaluating it on {options.episodes} starts that it has never seen, beside LQR and doing nothing")
    print()
    print(compare(policy, config, folder / "evaluation", episodes=options.episodes, animation=True))
    print()
    print("Shares and medians with 95 % intervals; a dash is a time that was not reached.")
    print(f"Table, numbers, pictures and animation: {(folder / 'evaluation').resolve()}")


if __name__ == "__main__":
    commands.run(main, "--folder with the folder that was named goes on from there")
