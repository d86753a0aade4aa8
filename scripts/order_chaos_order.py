"""How large a share of the double spring pendulum's motions is chaotic, against energy and against stiffness.

Starts are drawn evenly from each surface of constant energy (Liouville's measure), and each is called orderly or
chaotic by its mean MEGNO. The same command goes on with a run that was interrupted.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from chaos.config import DEFAULT, read_study
from chaos.study import convergence, run, table

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=DEFAULT, help="settings (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="few starts and a short time, for a first look")
    parser.add_argument("--folder", type=Path, help="where the results go (default: runs/order-chaos-order[-quick])")
    options = parser.parse_args()
    study = read_study(options.config, options.quick)
    folder = options.folder or Path("runs") / f"order-chaos-order{'-quick' if options.quick else ''}"

    from chaos.pictures import draw_study  # slow to import: after the checks above

    rows = run(study, folder)
    files = draw_study(study, rows, folder / "order-chaos-order")
    print(table(rows))
    print(f"\n{convergence(study, rows)}\n\ntable and pictures: {folder / 'table.csv'}, {', '.join(map(str, files))}")


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
