"""Map of order and chaos over start angle and energy, of the straight pendulum thrown like a rigid body.

The same command goes on with a map that was interrupted. Example: the default map, thrown half sideways,
scripts/chaos_map.py --heading 45 --folder runs/chaos-map-45
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands
from agents.files import write_arrays, write_csv
from spring_pendulum_env import Parameters
from spring_pendulum_env.dynamics import ChaosMap, chaos_map


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    axis: dict[str, Any] = {"nargs": 3, "type": float, "metavar": ("FROM", "TO", "COUNT")}
    parser.add_argument("--angles", **axis, default=[-45, 45, 91], help="degrees (default: %(default)s)")
    parser.add_argument("--energies", **axis, default=[0.1, 10, 75], help="J above rest (default: %(default)s)")
    parser.add_argument("--heading", type=float, default=0.0, help="of the throw, degrees; 90: sideways (default: 0)")
    parser.add_argument("--duration", type=float, default=500.0, help="s (default: %(default)s)")
    parser.add_argument(
        "--set", nargs=2, action="append", default=[], metavar=("PARAMETER", "VALUE"), dest="parameters"
    )
    parser.add_argument("--folder", type=Path, default=Path("runs") / "chaos-map", help="(default: %(default)s)")
    options = parser.parse_args()
    parameters = Parameters.of({name: _number(name, value) for name, value in options.parameters})
    angles, energies = (_axis(name, *getattr(options, name)) for name in ("angles", "energies"))
    chart = chaos_map(
        parameters, np.radians(angles), energies, options.duration, heading=float(np.radians(options.heading)),
        file=options.folder / "progress.npz", progress=True,
    )  # fmt: skip

    from chaos.pictures import draw_map  # slow to import: after the checks above

    write(chart, options.folder)
    where = "in the plane" if options.heading == 0 else f"{options.heading:g}° out of the plane of the angle"
    title = f"Straight pendulum thrown like a rigid body, {where}; {options.duration:g} s each"
    files = draw_map(chart, title, options.folder / "chaos-map", duration=options.duration)
    known = np.isfinite(chart.megno)
    print(
        f"{known.sum()} of {known.size} starts followed ({(chart.possible & ~known).sum()} lost near zero length); "
        f"chaotic: {100 * chart.chaotic[known].mean():.1f} %\n"
        f"half the time says the same for {100 * chart.agreement:.1f} %; "
        f"largest energy error {np.nanmax(chart.energy_error):.1e}\n"
        f"results: {', '.join(map(str, [*files, options.folder / 'chaos-map.npz', options.folder / 'chaos-map.csv']))}"
    )


def write(chart: ChaosMap, folder: Path) -> None:
    """Write the map as chaos-map.npz and chaos-map.csv, a line for each start."""
    arrays = {field.name: getattr(chart, field.name) for field in dataclasses.fields(chart)}
    write_arrays(folder / "chaos-map.npz", arrays)
    grids = [name for name, array in arrays.items() if array.ndim == 2 and name != "possible"]
    rows = (
        {"angle": angle, "energy": energy, "possible": int(chart.possible[i, j])}
        | {name: arrays[name][i, j] for name in grids}
        | {"chaotic": int(chart.chaotic[i, j])}
        for i, energy in enumerate(chart.energies)
        for j, angle in enumerate(chart.angles)
    )
    write_csv(folder / "chaos-map.csv", rows)


def _axis(name: str, low: float, high: float, count: float) -> NDArray[np.float64]:
    if not math.isfinite(high - low) or not count.is_integer() or count < 1 or (count > 1 and not low < high):
        raise ValueError(f"--{name} {low:g} {high:g} {count:g}: must be FROM TO COUNT, FROM below TO, COUNT from 1 on")
    return np.linspace(low, high, int(count))


def _number(name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"--set {name} {value}: must be a number") from None


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
