"""An episode as one page for the browser: everything is inside, no library, nothing is fetched.

The numbers are all from here; the page's own script (page.js) only draws them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.files import write_text
from spring_pendulum_env import colours
from spring_pendulum_env.canvas import GROUND, SKY
from spring_pendulum_env.scene import FIELD_OF_VIEW, camera_axes, look, tension_share
from watching.cast import described
from watching.record import Record

HERE = Path(__file__).resolve().parent
COLOURS = {
    "sky": SKY,
    "ground": GROUND,
    "grid": colours.GRID,
    "shadow": colours.SHADOW,
    "ink": colours.INK,
    "dim": colours.DIM,
    "push": colours.PUSH,
    "slack": colours.SLACK,
    "pull": colours.PULL,
    "anchor": colours.ANCHOR,
    "m1": colours.MASSES[0],
    "m2": colours.MASSES[1],
    "force": colours.FORCE,
    "kinetic": colours.KINETIC,
}


def write(path: Path, records: Sequence[Record]) -> None:
    """Write the page of one episode or of several from the same start, side by side.

    Raises OSError where it can't be written.
    """
    # "</" would end the script that holds the data.
    data = json.dumps(data_of(records), separators=(",", ":")).replace("</", "<\\/")
    page = (HERE / "page.html").read_text(encoding="utf-8")
    for mark, text in (
        ("/*STYLE*/", (HERE / "page.css").read_text(encoding="utf-8")),
        ("/*DATA*/", data),
        ("/*SCRIPT*/", (HERE / "page.js").read_text(encoding="utf-8")),
    ):
        page = page.replace(mark, text)
    write_text(path, page)


def data_of(records: Sequence[Record]) -> dict[str, Any]:
    """What page.js draws: lengths in m, energies in J, forces in N, colours as red, green and blue."""
    everything = np.concatenate([record.states[:, :9].reshape(-1, 3) for record in records])
    low, high = everything.min(axis=0), everything.max(axis=0)
    first = records[0]
    scene = look(
        first.scenario,
        first.parameters,
        first.states[0, :9].reshape(3, 3),
        first.forces[0],
        axes=camera_axes(-62.0, 14.0),
        zoom=1.0,
        size=(600, 600),
    )
    reach = scene.reach
    high[2] += 0.15 * reach
    low, high = np.minimum(low, -0.4 * reach), np.maximum(high, 0.4 * reach)
    floor = low[2] = min(float(low[2]) - 0.15 * reach, scene.floor)
    return {
        "task": first.scenario.task.name,
        "actuated": first.scenario.task.actuated,
        "travel": _rounded(first.scenario.anchor_travel) if first.scenario.task.actuated else None,
        "axes": first.scenario.actuated_axes,
        "maxForce": first.scenario.max_force,
        "period": first.scenario.control_period,
        "reach": reach,
        "floor": float(floor),
        "centre": _rounded((low + high) / 2),
        "radius": float(np.linalg.norm(high - low)) / 2,
        "colours": COLOURS,
        "fieldOfView": FIELD_OF_VIEW,
        "players": [_player(record) for record in records],
    }


def _player(record: Record) -> dict[str, Any]:
    p = record.parameters
    bodies = record.states[:, :9].reshape(-1, 3, 3)
    springs = ((1, p.k1, p.L1), (2, p.k2, p.L2))
    pulls = [[tension_share(p, row[end] - row[end - 1], k, L) for row in bodies] for end, k, L in springs]
    scene = look(record.scenario, p, bodies[0], record.forces[0], axes=camera_axes(0.0, 0.0), zoom=1.0, size=(600, 600))
    rest = None if 0.0 in (p.k1, p.k2) else _rounded(scene.targets - bodies[0, 0])
    return {
        "name": described(record.name),
        "ended": record.ended,
        "constants": p.as_dict(),
        "tied": [p.k1 > 0.0, p.k2 > 0.0],
        "sizes": _rounded(scene.sizes),
        "rest": rest,
        "bodies": _rounded(record.states[:, :9]),
        "force": _rounded(record.forces, 3),
        "kinetic": _rounded(record.kinetic_energy, 3),
        "excess": _rounded(record.excess_energy, 3),
        "energy": _rounded(record.energy, 3),
        "lengths": _rounded(record.lengths.T),
        "pulls": _rounded(pulls, 2),
    }


def _rounded(numbers: Any, digits: int = 4) -> Any:
    """Numbers as lists, with no more digits than can be seen."""
    return (np.round(np.asarray(numbers, dtype=np.float64), digits) + 0.0).tolist()
