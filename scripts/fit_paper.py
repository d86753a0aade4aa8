"""How constants and starts of configs/paper.yaml were found: a search for the energy errors that the paper prints."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("motion", choices=("spinning", "chaotic"), help="Figures 3, 4 and 7, or 5 and 6")
    parser.add_argument("--best", type=int, default=5, help="how many are shown (%(default)s)")
    options = parser.parse_args()
    if options.best < 1:
        raise ValueError(f"--best {options.best}: must be at least 1")

    from paper import fitting  # slow to import: after the checks above
    from paper.printed import PRINTED
    from paper.report import markdown

    found = sorted(getattr(fitting, options.motion)(), key=lambda fit: fit.misfit)[: options.best]
    lines = [
        (
            " ".join(f"{name}={value:g}" for name, value in fit.parameters.items()),
            " ".join(f"{number:g}" for number in fit.start),
            f"{fit.duration:g}",
            ", ".join(f"{error:.4g}" for error in fit.errors.values()),
        )
        for fit in found
    ]
    names = list(found[0].errors) if found else []
    print(markdown(("constants", "start", "s", "errors (%): " + "; ".join(names)), lines))
    print("printed: " + ", ".join(f"{PRINTED[name]:g}" for name in names))


if __name__ == "__main__":
    commands.run(main)
