"""Tune LQR's weights for each trial, and the damper's gains for damping, into configs/classical/lqr.yaml.

Saved after each, and what the file already holds isn't tuned again (--anew does).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="*", help="names of trials (default: all)")
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--population", type=int, default=5, help="candidates for each setting")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--anew", action="store_true", help="tune again what has been tuned")
    parser.add_argument("--file", type=Path, help="where the settings go (default: configs/classical/lqr.yaml)")
    options = parser.parse_args()

    from agents.evaluation import TRIALS, trial_named  # slow to import: after the arguments were read
    from agents.tuned import SETTINGS, read_settings, write_settings
    from agents.tuning import tune

    file = options.file or SETTINGS
    trials = [trial_named(name) for name in options.trials or TRIALS]
    for trial in trials:
        for controller in ("lqr", "damper") if trial.name == "damping" else ("lqr",):
            settings = read_settings(file)
            if controller in settings.get(trial.name, {}) and not options.anew:
                print(f"{trial.name}, {controller}: tuned before")
                continue
            began = time.monotonic()

            def told(generation: int, cost: float, name: str = f"{trial.name}, {controller}") -> None:
                print(f"\r{name}: generation {generation}, cost {cost:.4f} ", end="", flush=True)

            found = tune(
                trial,
                controller,
                starts=options.starts,
                generations=options.generations,
                population=options.population,
                seed=options.seed,
                progress=told,
            )
            print(f"in {time.monotonic() - began:.0f} s")
            settings.setdefault(trial.name, {})[controller] = found
            write_settings({name: settings[name] for name in TRIALS if name in settings}, file)


if __name__ == "__main__":
    commands.run(main)
