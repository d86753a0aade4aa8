"""What a picture tells in numbers and colours: the read-out, the legend, and the history of the energy below."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.canvas import SKY, Canvas, mix
from spring_pendulum_env.colours import DIM, FORCE, GRID, INK, KINETIC, MASSES, PULL, PUSH, TENSION_SCALE
from spring_pendulum_env.scene import Scene

FloatArray = NDArray[np.float64]

STRIP_HEIGHT, STRIP_SECONDS = 0.15, 10.0  # of the picture, and what it shows
STRIP_GAP = 0.04  # s between the points that it shows


def round_number(value: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is no smaller than a positive value."""
    power: float = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0, 20.0) if step * power >= value)


def quantity(value: float, unit: str) -> str:
    """A number for the read-out."""
    digits = f"{round(value, 2) + 0.0:.2f}" if abs(value) < 1e6 else f"{value:.3e}"
    return f"{with_minus(digits)} {unit}"


def with_minus(number: str) -> str:
    """A number with the minus sign of print, which is as wide as a plus."""
    return number.replace("-", "\N{MINUS SIGN}")


def draw_strip(canvas: Canvas, history: FloatArray) -> None:
    """The excess energy of the last seconds, now at the right; filled: the kinetic part of it.

    Args:
        canvas: to draw on.
        history: time in s, kinetic and excess energy in J, and what else there may be, one row for each instant.
    """
    unit, width = canvas.unit, canvas.width
    gap, right = 10.0 * unit, width - 10.0 * unit
    top, bottom = (1.0 - STRIP_HEIGHT) * canvas.height, canvas.height - gap
    canvas.box(SKY, 0, round(top), width, canvas.height)
    times, kinetic, excess = history[history[:, 0] >= history[-1, 0] - STRIP_SECONDS, :3].T
    most, least = float(excess.max()), float(excess.min())
    highest = round_number(max(1e-6, float(kinetic.max()), most))
    lowest = -round_number(-least) if least < -0.02 * highest else 0.0
    slope = (bottom - top - 26.0 * unit) / (highest - lowest)
    zero = bottom + slope * lowest
    drawn = np.flatnonzero(np.diff(times // STRIP_GAP, append=np.inf))  # the last of each gap
    x = right - (times[-1] - times[drawn]) * ((right - gap) / STRIP_SECONDS)
    moving, above = (np.column_stack([x, zero - slope * energy[drawn]]) for energy in (kinetic, excess))
    area = [(float(x[0]), zero), *moving.tolist(), (right, zero)]
    canvas.shape(mix(SKY, KINETIC, 0.5), area)
    canvas.curve(KINETIC, area[1:])
    for shift in (0.0, 0.8):  # twice, to be thicker than the other
        curve = (above - [0.0, shift]).tolist()
        canvas.curve(INK, [*curve, curve[-1]])
    canvas.lines([mix(SKY, GRID, 0.6)] * 2, [(0.0, top), (gap, zero)], [(width, top), (right, zero)])
    line = top + 0.7 * gap
    canvas.text("excess energy", gap, line, INK)
    canvas.text("kinetic", gap + 105.0 * unit, line, KINETIC)
    span = with_minus(f"{highest:g} J" if lowest == 0.0 else f"{lowest:g} to {highest:g} J")
    canvas.text(f"{span}, last {STRIP_SECONDS:g} s", right, line, DIM, right=True)


def write(
    canvas: Canvas,
    scene: Scene,
    *,
    time: float,
    energy: float,
    excess: float,
    actuated: bool,
    spacing: float,
    title: str,
) -> None:
    """The read-out on the left, what the colours mean on the right, and the title and the grid's measure below.

    Args:
        canvas: to draw on.
        scene: what the picture shows.
        time: since the start of the episode, s.
        energy: J.
        excess: energy above the equilibrium, J.
        actuated: whether there can be a force.
        spacing: of the ground's grid, m.
        title: for the lower left corner.
    """
    unit, p = canvas.unit, scene.parameters
    edge, row, right = 12.0 * unit, 20.0 * unit, canvas.width - 12.0 * unit
    rows = [("time", quantity(time, "s")), ("energy", quantity(energy, "J")), ("excess", quantity(excess, "J"))]
    if actuated:
        rows.append(("force", quantity(physics.length(*scene.force.tolist()), "N")))
    for number, (name, value) in enumerate(rows):
        canvas.text(name, edge, edge + number * row, DIM)
        canvas.text(value, edge + 58.0 * unit, edge + number * row, FORCE if name == "force" else INK, lasting=False)
    canvas.text(f"m1  {p.m1:.3g} kg", right, edge, MASSES[0], right=True)
    canvas.text(f"m2  {p.m2:.3g} kg", right, edge + row, MASSES[1], right=True)
    canvas.text("push", right - 104.0 * unit, edge + 2 * row, PUSH, right=True)
    canvas.text("pull", right, edge + 2 * row, PULL, right=True)
    for step, colour in enumerate(TENSION_SCALE):
        left, top = right - (98.0 - 4.0 * step) * unit, edge + 2 * row + 4.0 * unit
        canvas.box(colour, left, top, 4.0 * unit + 1.0, 6.0 * unit)
    bottom = canvas.height * (1.0 - STRIP_HEIGHT) - row
    canvas.text(f"grid {spacing:g} m", right, bottom, DIM, right=True)
    canvas.text(title, edge, bottom, INK)
