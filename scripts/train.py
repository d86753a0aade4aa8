"""Train a policy: scripts/train.py damping, or scripts/train.py stabilisation --equilibrium inverted-hanging.

The same command goes on with a training that was interrupted, in whatever way, from its last checkpoint. Ctrl-C and
SIGTERM make one and end it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands, runs
from agents.config import ENVIRONMENT_IDS, default_path, read_config


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=ENVIRONMENT_IDS)
    parser.add_argument("--algo", default="ppo", help="learning algorithm (default: ppo)")
    parser.add_argument("--config", type=Path, help="config file (default: configs/TASK-[EQUILIBRIUM-]ALGO.yaml)")
    parser.add_argument("--equilibrium", help="of the stabilisation task; spring 1 named first")
    parser.add_argument("--steps", help="environment steps in all")
    parser.add_argument("--seed")
    parser.add_argument("--folder", type=Path, help="run folder (default: runs/TASK-[EQUILIBRIUM-]ALGO-SEED)")
    commands.add_changes(parser)
    options = parser.parse_args()

    flags = {
        "environment.equilibrium": options.equilibrium,
        "training.steps": options.steps,
        "training.seed": options.seed,
    }
    changes = [*options.changes, *(f"{key}={value}" for key, value in flags.items() if value is not None)]
    config = read_config(options.config or default_path(options.task, options.algo, options.equilibrium), changes)
    if config.task != options.task or config.algorithm != options.algo:
        raise ValueError(f"{options.config} is for {config.task} and {config.algorithm}, not for what was asked for")
    names = (config.task, config.environment.equilibrium, config.algorithm, f"seed{config.training.seed}")
    folder = options.folder or Path("runs") / "-".join(name for name in names if name)

    from agents.training import train  # slow to import: after the checks above

    train(config, folder)
    record = runs.read_record(folder)
    print(f"trained for {record['steps']:,} steps in {record['seconds']:.0f} s: {folder}")
    print(f"to see how good it is: scripts/evaluate.py {folder}")


if __name__ == "__main__":
    commands.run(main, "the same command goes on from there")
