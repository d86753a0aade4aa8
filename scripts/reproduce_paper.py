"""The paper's figures 3 to 9, its printed numbers beside ours, and a report on each of its claims."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from paper.config import FOLDER, read_config

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("runs/paper"), help="folder for the files (%(default)s)")
    parser.add_argument("--config", type=Path, default=FOLDER / "paper.yaml", help="constants, starts, times, solver")
    parser.add_argument("--quick", action="store_true", help="less of everything, to see that it works")
    parser.add_argument("--no-svg", action="store_true", help="pictures as PNG alone")
    options = parser.parse_args()
    config = read_config(options.config)
    if options.output.exists() and not options.output.is_dir():
        raise ValueError(f"--output {options.output}: is a file, must be a folder")
    options.output.mkdir(parents=True, exist_ok=True)  # now, rather than find out later that it can't be

    from paper import claims_energy, claims_motion, figures, report  # slow to import: after the checks above
    from paper.runs import Runs

    begin = time.monotonic()
    pieces = len(figures.FIGURES) + 2

    def say(done: int, what: str) -> None:
        print(f"[{done}/{pieces}] {time.monotonic() - begin:3.0f} s  {what}", file=sys.stderr, flush=True)

    runs = Runs(config.quick() if options.quick else config, progress=True)
    for number, name in enumerate(figures.FIGURES, start=1):
        say(number, name)
        figures.draw(runs, name, options.output, svg=not options.no_svg)
    say(pieces - 1, "claims of sections 1 to 4")
    claims = claims_energy.claims(runs)
    say(pieces, "claims of section 5")
    claims += claims_motion.claims(runs)
    found = report.rows(runs)
    text = report.report(runs, found, claims, "make paper")
    report.save(options.output, text, found, claims, runs.config)

    print(report.numbers_table(found))
    print()
    for claim in claims:
        print(f"{claim.verdict:22}  {claim.section}: {claim.says}")
    print()
    print(f"Report, pictures, table and numbers: {options.output}")


if __name__ == "__main__":
    commands.run(main)
