"""Train a policy by RLlib: scripts/train_ray.py damping --runners 2, on this machine or with --address on a cluster.

The same command goes on with a training that was interrupted. Needs Ray, in an environment of its own: make ray.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands, runs
from agents.config import ENVIRONMENT_IDS, default_path, read_config


def main() -> None:
    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=ENVIRONMENT_IDS)
    parser.add_argument("--algo", default="ppo", help="ppo or sac (default: ppo)")
    parser.add_argument("--config", type=Path, help="config file (default: configs/TASK-ALGO.yaml)")
    parser.add_argument("--runners", type=int, default=2, help="processes that step environments (default: 2)")
    parser.add_argument("--address", help='of a Ray cluster, or "auto" on one of its machines (default: none)')
    parser.add_argument("--folder", type=Path, help="run folder (default: runs/TASK-[EQUILIBRIUM-]ALGO-ray-SEED)")
    commands.add_changes(parser)
    options = parser.parse_args()
    config = read_config(options.config or default_path(options.task, options.algo), options.changes)
    if config.task != options.task or config.algorithm != options.algo:
        raise ValueError(f"{options.config} is for {config.task} and {config.algorithm}, not for what was asked for")
    names = (config.task, config.environment.equilibrium, config.algorithm, "ray", f"seed{config.training.seed}")
    folder = options.folder or Path("runs") / "-".join(name for name in names if name)

    from agents.rllib_train import RECORD, train  # slow to import: after the checks above

    train(config, folder, runners=options.runners, address=options.address)
    record, more = runs.read_record(folder), json.loads((folder / RECORD).read_text(encoding="utf-8"))
    print(f"trained for {record['steps']:,} steps in {record['seconds']:.0f} s: {folder}")
    print(f"{more['steps_per_second']:,} steps/s with {more['runners']} runners, restarts: {more['runners_restarted']}")
    print(f"to see how good it is: scripts/evaluate.py {folder}")


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on from the last checkpoint")
