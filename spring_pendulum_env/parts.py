"""What stands in the picture besides ground and trails: shadows, rails and rings, bodies, springs, and the force."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.canvas import SKY, Canvas, mix
from spring_pendulum_env.colours import ANCHOR, DIM, FORCE, MASSES, SHADOW, tension_colour
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.scene import Scene, cross, tension_share

if TYPE_CHECKING:
    import pygame

FloatArray = NDArray[np.float64]

COILS, COIL_POINTS = 10, 12


def _coil() -> tuple[FloatArray, NDArray[np.bool_]]:
    """How far along, to the side and to the front each point of a coil is, shape (n, 3), and which parts are in front.

    It begins and ends on the axis.
    """
    share = np.linspace(0.0, 1.0, COILS * COIL_POINTS + 1)
    turn = 2.0 * math.pi * COILS * share
    radius = np.clip(9.0 * np.minimum(share, 1.0 - share), 0.0, 1.0)
    front = np.cos((turn[1:] + turn[:-1]) / 2) > 0.0
    return np.column_stack([share, radius * np.sin(turn), radius * np.cos(turn)]), front


def _faces() -> FloatArray:
    """Corners of a cube's faces on the positive side of x, y and z, shape (3, 4, 3), from -1 to 1."""
    square = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    return np.stack([np.insert(square, axis, 1.0, axis=1) for axis in range(3)])


COIL, FRONT = _coil()
FACES = _faces()
DISC = np.array([[math.cos(turn), math.sin(turn), 0.0] for turn in np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)])


def draw_shadows(canvas: Canvas, scene: Scene) -> None:
    """On the ground: they show how near the bodies are."""
    feet = scene.bodies.copy()
    feet[:, 2] = scene.floor
    discs = feet[1:, None] + scene.sizes[1:, None, None] * DISC
    pixels = scene.project(np.concatenate([feet, discs.reshape(-1, 3)]))[0]
    ends = pixels[:3].tolist()
    for number, k in enumerate((scene.parameters.k1, scene.parameters.k2)):
        if k > 0.0:
            canvas.lines([SHADOW], ends[number : number + 1], ends[number + 1 : number + 2], 2.0)
    for disc in pixels[3:].reshape(2, -1, 2).tolist():
        canvas.shape(SHADOW, disc)


def draw_task(canvas: Canvas, scene: Scene, scenario: Scenario) -> None:
    """The rails along which the anchor may move, and rings where the masses are wanted."""
    unit = canvas.unit
    axes = scenario.actuated_axes
    if axes:
        ends = np.tile(scene.bodies[0], (len(axes), 2, 1))
        for number, axis in enumerate(axes):
            ends[number, :, physics.AXES.index(axis)] = -scenario.anchor_travel, scenario.anchor_travel
        near = scene.near(ends).reshape(-1, 2).max(axis=1)
        pixels = scene.project(ends)[0].reshape(-1, 2, 2)
        rails = canvas.over(ANCHOR, pixels[:, 1, 1], [0.3] * len(axes))
        for axis, nearness, rail, (start, end) in zip(axes, near.tolist(), rails, pixels.tolist(), strict=True):
            if nearness < 0.8 * scene.distance:
                canvas.lines([rail], [start], [end])
                for x, y in (start, end):
                    canvas.circle(rail, x, y, 3.0 * unit)
                canvas.text(axis, end[0] + 6.0 * unit, end[1] - 6.0 * unit, DIM)
    if 0.0 in (scene.parameters.k1, scene.parameters.k2):
        return  # no place of rest
    places, scale = scene.project(scene.targets)
    radii, width = 1.45 * scale * scene.sizes[1:], max(1, round(1.5 * unit))
    for (across, down), radius, colour in zip(places.tolist(), radii.tolist(), MASSES, strict=True):
        canvas.circle(canvas.over(colour, down, 0.55)[0], across, down, max(radius, 6.0 * unit), width)


def draw_bodies(canvas: Canvas, scene: Scene, balls: Sequence[pygame.Surface], *, carriage: bool) -> None:
    """Anchor, springs and masses, the farthest first.

    Args:
        canvas: to draw on.
        scene: what the picture shows.
        balls: pictures of both masses.
        carriage: whether the anchor is one that a force moves, or a plate that is held.
    """
    p, near = scene.parameters, scene.near(scene.bodies)
    parts: list[tuple[float, Callable[[], None]]] = [(near[0], partial(_draw_anchor, canvas, scene, carriage))]
    parts += [(near[mass], partial(_draw_mass, canvas, scene, balls[mass - 1], mass)) for mass in (1, 2)]
    for end, k, L in ((1, p.k1, p.L1), (2, p.k2, p.L2)):
        if k > 0.0:
            parts.append(((near[end - 1] + near[end]) / 2, partial(_draw_spring, canvas, scene, end, k, L)))
    for _, draw in sorted(parts, key=lambda part: part[0]):
        draw()


def draw_force(canvas: Canvas, scene: Scene, scenario: Scenario) -> None:
    """An arrow, a third as long as the pendulum for an axis's greatest force."""
    tip = scene.bodies[0] + 0.35 * scene.reach / scenario.max_force * scene.force
    start, end = scene.project([scene.bodies[0], tip])[0]
    length = math.dist(start, end)
    if length < 3.0:
        return
    head = (end - start) / length * min(12.0 * canvas.unit, length)
    side = 0.45 * np.array([-head[1], head[0]])
    canvas.lines([FORCE], [start.tolist()], [(end - 0.7 * head).tolist()], 3.0)
    canvas.shape(FORCE, [end.tolist(), (end - head + side).tolist(), (end - head - side).tolist()])


def _draw_anchor(canvas: Canvas, scene: Scene, carriage: bool) -> None:
    """A carriage where a force moves it, a plate where it is held."""
    form = [1.0, 1.0, 1.0] if carriage else [2.2, 2.2, 0.25]
    seen = FACES.copy()
    for axis in range(3):
        seen[axis, :, axis] = math.copysign(1.0, scene.axes[2, axis])  # the face on the side of the eye
    faces = scene.project(scene.bodies[0] + scene.sizes[0] * np.array(form) * seen)[0].reshape(3, 4, 2)
    for face, light in zip(faces.tolist(), (0.6, 0.45, 0.95), strict=True):
        canvas.shape(mix(SKY, ANCHOR, light), face)


def _draw_mass(canvas: Canvas, scene: Scene, ball: pygame.Surface, mass: int) -> None:
    pixels, scale = scene.project(scene.bodies[mass])
    side = 2.0 * max(scene.sizes[mass] * float(scale[0]), 4.0 * canvas.unit)
    x, y = pixels[0].tolist()
    canvas.stamp(ball, x, y, side)


def _draw_spring(canvas: Canvas, scene: Scene, end: int, k: float, L: float) -> None:
    """A coil that gets thinner with its length and takes its colour from its tension."""
    along = scene.bodies[end] - scene.bodies[end - 1]
    dx, dy, dz = along.tolist()
    length = physics.length(dx, dy, dz)
    if length == 0.0:
        return
    direction = along / length
    colour = tension_colour(tension_share(scene.parameters, along, k, L))
    slimness = min(max(L / length, 0.3), 1.4)
    side = cross(direction, scene.axes[2])
    aside = physics.length(*side.tolist())
    side = side / aside if aside > 1e-9 else scene.axes[0]
    first, last = (min(0.85 * size, 0.4 * length) for size in scene.sizes[end - 1 : end + 1].tolist())
    radius = 0.048 * scene.reach * slimness
    frame = np.stack([(length - first - last) * direction, radius * side, radius * cross(side, direction)])
    pixels, scale = scene.project(scene.bodies[end - 1] + first * direction + COIL @ frame)
    width = min(0.013 * scene.reach * float(scale.mean()) / canvas.unit * slimness**0.5, 5.0)
    for half, shade in ((~FRONT, mix(SKY, colour, 0.5)), (FRONT, colour)):
        starts, ends = pixels[:-1][half].tolist(), pixels[1:][half].tolist()
        canvas.lines([shade] * len(starts), starts, ends, width)
