"""Train a config with several seeds, and settings to try, by Ray Tune: scripts/sweep_ray.py configs/damping-ppo.yaml.

As scripts/sweep.py does, but on any number of machines (--address); needs Ray, in an environment of its own: make ray.
The same command goes on after an interruption.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    from agents.sweep import add_options, members_from, write_table
    from agents.tune_sweep import run_by_tune

    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    parser.add_argument("--address", help='of a Ray cluster, or "auto" on one of its machines (default: none)')
    options = parser.parse_args()
    members, folder = members_from(options)
    run_by_tune(members, folder, options.starts, processes=options.processes, address=options.address)
    print(write_table(members, folder))
    print(f"\nrun folders, table and numbers: {folder}")


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on")
