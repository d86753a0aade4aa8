"""Write docs/live.html, the pendulum in the browser, from scripts/live_page and the package's own formulas."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from live_page import compiling

from spring_pendulum_env import Parameters, equilibrium
from spring_pendulum_env.dynamics import periodic_orbit
from spring_pendulum_env.equilibria import full_state

ROOT = Path(__file__).resolve().parent.parent
PARTS = Path(__file__).resolve().parent / "live_page"
PAGE = ROOT / "docs" / "live.html"

POLICIES = ("damping", "inverted-inverted")
"""Shipped policies on the page."""

SLIDERS = (
    # names, as it is written, unit, lowest, highest, step, what it is
    (("m1",), "m<sub>1</sub>", "kg", 0.2, 5.0, 0.1, "mass 1"),
    (("m2",), "m<sub>2</sub>", "kg", 0.2, 5.0, 0.1, "mass 2"),
    (("k1",), "k<sub>1</sub>", "N/m", 10.0, 400.0, 5.0, "stiffness of spring 1"),
    (("k2",), "k<sub>2</sub>", "N/m", 10.0, 400.0, 5.0, "stiffness of spring 2"),
    (("L1",), "L<sub>1</sub>", "m", 0.0, 2.0, 0.05, "length of spring 1 at rest"),
    (("L2",), "L<sub>2</sub>", "m", 0.0, 2.0, 0.05, "length of spring 2 at rest"),
    (("g",), "gravity", "m/s²", 0.0, 25.0, 0.01, "gravity"),
    (("R1", "R2"), "air", "kg/s", 0.0, 1.0, 0.01, "air resistance on both masses"),
)


def starts() -> list[dict[str, Any]]:
    """The starts that the page offers, 18 numbers each: positions in m, then velocities in m/s."""
    guess = yaml.safe_load((ROOT / "configs" / "paper.yaml").read_text(encoding="utf-8"))["periodic"]
    periodic = periodic_orbit(guess["parameters"], guess["start"], guess["period"]).state
    offered: dict[str, tuple[Any, str]] = {
        "Chaotic": ([1.0, 0.0, 0.3, 1.7, 0.6, 0.5, 0, 0, 0, 0, 0, 0], "Held out high and let go"),
        "Periodic": (periodic, "The start of the paper's Figure 8: it comes back after 2.95 s"),
        "Circling": ([0.5, 0.0, -1.1, 1.0, 0.0, -2.1, 0, 1.6, 0, 0, 3.0, 0], "Pushed sideways"),
        "Upside down": (equilibrium({}, "inverted-inverted"), "Both springs pressed, the masses above the anchor"),
    }
    return [
        {"name": name, "about": about, "state": _rounded(full_state(state)), "nudge": name == "Upside down"}
        for name, (state, about) in offered.items()
    ]


def _rounded(state: Any) -> list[float]:
    """To a micrometre; without -0, whose sign is a matter of the machine's arithmetic."""
    numbers: list[float] = (np.round(state, 6) + 0.0).tolist()
    return numbers


def core() -> str:
    """The page's numerical part alone: formulas, tables, solver and policy."""
    parts = [compiling.formulas(), compiling.coefficients(), *(_part(name) for name in ("solver.js", "policy.js"))]
    return "\n".join(parts)


def page() -> str:
    """The whole page."""
    data = {
        "parameters": Parameters().as_dict(),
        "starts": starts(),
        "sliders": [
            dict(zip(("names", "symbol", "unit", "low", "high", "step", "about"), slider, strict=True))
            for slider in SLIDERS
        ],
        "policies": [compiling.policy(name) for name in POLICIES],
    }
    script = [core(), f"const DATA = {json.dumps(data, separators=(',', ':'))};\n"]
    script += [_part(name) for name in ("scene.js", "chart.js", "main.js")]
    text = _part("page.html").replace("/*{{style}}*/\n", _part("style.css"))
    return text.replace("//{{script}}\n", "\n".join(script))


def _part(name: str) -> str:
    return (PARTS / name).read_text(encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--file", type=Path, default=PAGE, help="where it goes (default: docs/live.html)")
    file: Path = parser.parse_args().file
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(page(), encoding="utf-8")
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB; open it in a browser")


if __name__ == "__main__":
    main()
