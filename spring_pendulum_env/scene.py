"""What a picture of the pendulum shows, and the perspective camera that looks at it. Nothing is drawn here."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import Scenario

FloatArray = NDArray[np.float64]

FIELD_OF_VIEW = math.radians(36.0)  # of the picture's smaller side
FAR = 1e5  # pixels; positions are cut there, so that no coordinate overflows
MIDDLE = 0.47  # of the picture's height, where the centre falls: above it the read-out, below it the strip
ROOM = (0.47, 0.345)  # of the picture's width and height, on each side of the middle, that bodies may fill


@dataclasses.dataclass(frozen=True)
class Scene:
    """What one frame shows, in m and N, and the perspective camera that looks at it."""

    parameters: Parameters
    bodies: FloatArray  # anchor, m1 and m2, shape (3, 3)
    sizes: FloatArray  # half the anchor's side and the masses' radii; the volumes of these are as their masses
    targets: FloatArray  # where the task wants m1 and m2 for this place of the anchor, shape (2, 3)
    reach: float  # length of the pendulum there: the measure of all that has no size of its own
    force: FloatArray
    floor: float  # height of the ground, which is below everything
    centre: FloatArray  # where the camera looks
    axes: FloatArray  # see `camera_axes`
    distance: float  # from the eye to the centre
    focal: float  # pixels per metre at a depth of one metre
    middle: tuple[float, float]  # pixels, where the centre falls

    @property
    def view(self) -> tuple[object, ...]:
        """What the picture of the ground depends on."""
        return (self.centre.tobytes(), self.axes.tobytes(), self.distance, self.floor)

    def near(self, points: ArrayLike) -> FloatArray:
        """How much nearer than the centre points are to the eye, m; shape (n,)."""
        nearness: FloatArray = (np.asarray(points) - self.centre).reshape(-1, 3) @ self.axes[2]
        return nearness

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Where points fall in the picture, pixels, shape (n, 2), and pixels per metre there, shape (n,)."""
        right, up, near = self.axes @ (np.asarray(points) - self.centre).reshape(-1, 3).T
        # What is beside or behind the eye falls far outside the picture; it only mustn't divide by zero.
        scale = self.focal / np.maximum(self.distance - near, 0.05 * self.distance)
        pixels = np.empty((len(scale), 2))
        pixels[:, 0], pixels[:, 1] = self.middle[0] + right * scale, self.middle[1] - up * scale
        return np.minimum(np.maximum(pixels, -FAR), FAR), scale


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The vector product, shape (3,); NumPy's own takes ten times as long for so few numbers."""
    return a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]


def camera_axes(azimuth: float, elevation: float) -> FloatArray:
    """Unit vectors to the picture's right, to its top and towards the eye, one per row; shape (3, 3).

    Args:
        azimuth: of the eye about the vertical, degrees; 0 looks from +x, -90 from -y.
        elevation: of the eye over the horizontal, degrees.
    """
    a, e = math.radians(azimuth), math.radians(elevation)
    right = np.array([-math.sin(a), math.cos(a), 0.0])
    eye = np.array([math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)])
    return np.stack([right, cross(eye, right), eye])


def tension_share(parameters: Parameters, along: ArrayLike, k: float, L: float) -> float:
    """How hard a spring pulls (or, below zero, pushes), 1 being twice the weight of both masses.

    Args:
        parameters: the constants in force.
        along: from the spring's near end to its far end, m; shape (3,).
        k: its stiffness, N/m.
        L: its unstretched length, m.
    """
    p, (dx, dy, dz) = parameters, np.asarray(along, dtype=np.float64).tolist()
    fx, fy, fz = physics.spring_force(dx, dy, dz, k, L)
    length = physics.length(dx, dy, dz)
    if length == 0.0:
        return 0.0
    full: float = 2.0 * physics.static_load(p.m1, p.m2, p.g) or k * L or k
    return float(-(fx * dx + fy * dy + fz * dz) / length / full)


def look(
    scenario: Scenario,
    parameters: Parameters,
    bodies: FloatArray,
    force: FloatArray,
    *,
    axes: FloatArray,
    zoom: float,
    size: tuple[int, int],
) -> Scene:
    """Sets the camera so that everything is in the picture.

    Args:
        scenario: the task and its arguments.
        parameters: the constants in force.
        bodies: anchor, m1 and m2, m; shape (3, 3).
        force: on the anchor, N; shape (3,).
        axes: of the camera.
        zoom: magnification.
        size: width and height, pixels.
    """
    p, (width, height) = parameters, size
    heights = scenario.spring_heights(p)
    reach = abs(heights[0]) + abs(heights[1]) or 1.0
    rest = np.outer([0.0, heights[0], heights[0] + heights[1]], [0.0, 0.0, 1.0])
    targets = bodies[0] + rest[1:]
    spread = 0.5 * reach * np.vstack([np.eye(3), -np.eye(3)]) * [1.0, 1.0, 0.5]
    if p.k1 > 0.0 or scenario.task.actuated:
        start = np.outer(np.cumsum([0.0, *scenario.start_heights(p)]), [0.0, 0.0, 1.0])
        usual, seen = np.vstack([rest, start]), np.vstack([bodies, targets])
    else:
        usual, seen = bodies[1:].mean(axis=0, keepdims=True), bodies[1:]
    points = np.vstack([(usual[:, None] + spread).reshape(-1, 3), (seen[:, None] + 0.25 * spread).reshape(-1, 3)])
    floor = float(points[:, 2].min())
    points = np.vstack([points, seen * [1.0, 1.0, 0.0] + [0.0, 0.0, floor]])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    focal = min(width, height) / 2 / math.tan(FIELD_OF_VIEW / 2)
    x, y, near = axes @ (points - centre).T
    distance = (near + focal * np.maximum(abs(x) / (ROOM[0] * width), abs(y) / (ROOM[1] * height))).max()
    sizes = reach * np.array([0.055, *(0.09 * (m / (p.m1 + p.m2)) ** (1 / 3) for m in (p.m1, p.m2))])
    view = (centre, axes, float(distance) / zoom, focal, (0.5 * width, MIDDLE * height))
    return Scene(p, bodies, sizes, targets, reach, force, floor, *view)
