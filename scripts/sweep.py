"""Train a config with several seeds, and settings to try, side by side: scripts/sweep.py configs/damping-ppo.yaml.

Each training has a process and a run folder of its own. The same command goes on after an interruption. It ends with a
table on unseen starts, with intervals over seeds and starts.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    from agents.sweep import add_options, members_from, run_in_processes, write_table

    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    options = parser.parse_args()
    members, folder = members_from(options)
    run_in_processes(members, options.processes, options.starts)
    print(write_table(members, folder))
    print(f"\nrun folders, table and numbers: {folder}")


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on from the last checkpoints")
