"""Draws a state: a perspective picture of the pendulum in its space, with a read-out and the history of its energy.

Colours tell apart what they must for colour-blind eyes too: springs go from blue (pushing) over pale grey to red
(pulling), m1 is amber and m2 teal. Lines are anti-aliased as they are drawn, which costs less than shrinking a larger
picture. pygame is imported by the first `Renderer`, since nothing else of the package needs it.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable
from types import ModuleType
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.equilibria import energy, vertical_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import Scenario, positive_number

if TYPE_CHECKING:
    import pygame

FloatArray = NDArray[np.float64]
Colour = tuple[int, int, int]

SKY, GROUND = (13, 17, 26), (33, 41, 56)  # the background's colours at the top and at the bottom
GRID, INK, DIM = (112, 130, 158), (232, 236, 243), (150, 161, 180)
PUSH, SLACK, PULL = (64, 150, 255), (222, 226, 233), (255, 76, 58)
ANCHOR, MASS1, MASS2, FORCE = (176, 186, 202), (245, 184, 61), (45, 200, 165), (226, 132, 205)

FIELD_OF_VIEW = math.radians(36.0)  # of the picture's smaller side
STRIP_SECONDS = 10.0  # what the energy strip shows
HISTORY_GAP = 0.02  # s; a shorter control period leaves no denser history
COILS, COIL_POINTS = 11, 16
FAR = 1e5  # pixels; lines are cut there, so that no coordinate overflows


@dataclasses.dataclass(frozen=True)
class View:
    """A perspective camera."""

    centre: FloatArray
    """Where it looks, m; shape (3,)."""
    axes: FloatArray
    """Unit vectors to the picture's right, its top and towards the eye; shape (3, 3), one per row."""
    distance: float
    """From the eye to the centre, m."""
    focal: float
    """Pixels per metre at a depth of one metre."""
    middle: tuple[float, float]
    """Where the centre falls in the picture, pixels."""

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pixels of points in m, shapes (n, 2) and (n,): where they fall, and pixels per metre there."""
        right, up, near = self.axes @ (np.asarray(points, dtype=np.float64).reshape(-1, 3) - self.centre).T
        # What is beside or behind the eye is far outside the picture; it is only kept from dividing by zero.
        scale = self.focal / np.maximum(self.distance - near, 0.05 * self.distance)
        pixels = np.stack([self.middle[0] + right * scale, self.middle[1] - up * scale], axis=1)
        return np.clip(pixels, -FAR, FAR), scale


def mix(a: Colour, b: Colour, share: float) -> Colour:
    """The colour between two, `share` of it the second."""
    return tuple(round(x + (y - x) * share) for x, y in zip(a, b, strict=True))  # type: ignore[return-value]


def tension_colour(tension: float) -> Colour:
    """Of a spring: full red where it pulls with 1 or more, full blue where it pushes with 1 or more."""
    return mix(SLACK, PULL if tension > 0.0 else PUSH, min(abs(tension), 1.0) ** 0.8)


def round_number(value: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is no smaller than a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next((step * power for step in (1.0, 2.0, 5.0) if step * power >= value), 10.0 * power)


def number_text(value: float, unit: str) -> str:
    """A quantity for the read-out, with a true minus sign and never "-0.00"."""
    text = f"{value:.2f}" if abs(value) < 1e5 else f"{value:.3e}"
    return f"{'0.00' if text == '-0.00' else text} {unit}".replace("-", "\N{MINUS SIGN}")


def import_pygame() -> ModuleType:
    """pygame-ce.

    Raises:
        DependencyNotInstalled: it isn't there.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # its greeting would mix with a program's own output
    try:
        import pygame
    except ImportError:
        hint = 'rendering needs pygame-ce: pip install "spring-pendulum-env[render]"'
        raise gym.error.DependencyNotInstalled(hint) from None
    return pygame


class Renderer:
    """Draws the states of one environment, one after the other.

    The picture depends on nothing but the states, times, forces and parameters drawn since the last `forget`, so the
    same history gives the same bits. In mode "rgb_array" no display is touched.

    The camera holds the usual motion about the task's equilibrium and moves back when a body leaves that; without
    spring 1 it goes with the masses. In mode "human" dragging turns it and the wheel zooms; `azimuth`, `elevation` and
    `zoom` may also be set between frames. After the window was closed, `closed` is true and `draw` does nothing.
    """

    def __init__(
        self,
        render_mode: str,
        fps: float,
        scenario: Scenario,
        *,
        size: tuple[int, int] = (600, 600),
        azimuth: float = -62.0,
        elevation: float = 14.0,
        zoom: float = 1.0,
        trail: float = 2.0,
    ) -> None:
        """Opens the window in mode "human".

        Args:
            render_mode: "human" or "rgb_array".
            fps: frames per second that the window keeps to.
            scenario: the task and its arguments.
            size: width and height, pixels, at least 200 each.
            azimuth: of the eye about the vertical, degrees; 0 looks from +x, -90 from -y.
            elevation: of the eye over the horizontal, degrees, from -85 to 85.
            zoom: magnification.
            trail: how long the masses' trails are, s.

        Raises:
            DependencyNotInstalled: pygame isn't there.
            ValueError: an argument is out of range.
            RuntimeError: "human" without a display.
        """
        if len(size) != 2 or any(int(side) != side or not 200 <= side <= 8192 for side in size):
            raise ValueError(f"size = {size!r}: must be two whole numbers of pixels from 200 to 8192")
        if not (math.isfinite(azimuth) and abs(elevation) <= 85.0):
            raise ValueError(f"azimuth, elevation = {azimuth!r}, {elevation!r}: must be finite, elevation in [-85, 85]")
        self.azimuth, self.elevation, self.zoom = float(azimuth), float(elevation), positive_number("zoom", zoom)
        self.closed = False
        self.events: list[pygame.event.Event] = []
        """What the window's user did since the frame before, for whoever wants keys or the mouse."""
        self._trail = positive_number("trail", trail, zero=True)
        self._fps = fps
        self._scenario = scenario
        self._size = (int(size[0]), int(size[1]))
        self._unit = min(self._size) / 600.0  # pixels of line widths and letters per pixel of the usual size
        self._pygame = import_pygame()
        self._window = self._open() if render_mode == "human" else None
        # Red, green and blue in this order in memory: a frame is then a plain copy.
        masks = (0x0000FF, 0x00FF00, 0xFF0000, 0)
        self._surface: pygame.Surface = self._pygame.Surface(self._size, 0, 24, masks)
        self._floor: pygame.Surface = self._pygame.Surface(self._size, 0, 24, masks)
        self._floor_key: tuple[float, ...] = ()
        self._pygame.font.init()
        self._font = self._pygame.font.Font(None, round(20 * self._unit))
        self.forget()

    def forget(self) -> None:
        """Starts anew: no trails, no history of the energy."""
        self._history = np.empty((0, 12))  # time, kinetic and excess energy, positions

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._pygame.display.quit()
            self._window = None
            self.closed = True

    def draw(self, state: ArrayLike, parameters: Parameters, force: ArrayLike, time: float) -> NDArray[np.uint8] | None:
        """Draws a state. One at a time not later than that of a state drawn before takes that one's place.

        Args:
            state: positions in m, velocities in m/s of the anchor, m1 and m2; shape (18,).
            parameters: the constants in force.
            force: on the anchor, N; shape (3,).
            time: since the start of the episode, s.

        Returns:
            The picture in mode "rgb_array", shape (height, width, 3); None in mode "human".
        """
        if self.closed:
            return None
        state = np.array(state, dtype=np.float64)
        force = np.array(force, dtype=np.float64)
        heights = self._scenario.spring_heights(parameters)
        kinetic = float(physics.kinetic_energy(*state[9:], parameters.m0, parameters.m1, parameters.m2))
        total = float(energy(parameters, state))
        excess = total - float(energy(parameters, vertical_state(*heights)))
        self._remember(np.concatenate([[time, kinetic, excess], state[:9]]))

        bodies = state[:9].reshape(3, 3)
        reach = abs(heights[0]) + abs(heights[1]) or 1.0
        view, floor = self._look(bodies, parameters, heights, reach)
        self._draw_floor(view, floor, bodies, reach)
        self._draw_trails(view)
        self._draw_bodies(view, bodies, parameters, heights, reach, force)
        self._draw_strip()
        self._write(time, total, excess, force)
        if self._window is None:
            return np.array(self._pygame.surfarray.pixels3d(self._surface).swapaxes(0, 1), order="C")
        self._show()
        return None

    def _remember(self, row: FloatArray) -> None:
        times = self._history[:, 0]
        kept = self._history[(times < row[0]) & (times >= row[0] - max(self._trail, STRIP_SECONDS))]
        if len(kept) >= 2 and row[0] - kept[-2, 0] < HISTORY_GAP:
            kept = kept[:-1]
        self._history = np.vstack([kept, row])

    def _look(
        self, bodies: FloatArray, parameters: Parameters, heights: tuple[float, float], reach: float
    ) -> tuple[View, float]:
        """The camera that has all in the picture, and the floor's height, m."""
        tied = parameters.k1 > 0.0 or self._scenario.task.actuated
        home = np.zeros(3) if tied else bodies[1:].mean(axis=0)
        levels = (0.0, heights[0], heights[0] + heights[1]) if tied else (-0.5 * reach, 0.5 * reach)
        low, high = min(levels) - 0.3 * reach, max(levels) + 0.2 * reach
        side = 0.55 * reach
        usual = [[side, 0, 0], [-side, 0, 0], [0, side, 0], [0, -side, 0], [0, 0, low], [0, 0, high]]
        margin = 0.08 * reach * np.concatenate([np.eye(3), -np.eye(3)])
        seen = bodies if tied else bodies[1:]
        points = np.concatenate([home + np.array(usual), (seen[:, None] + margin).reshape(-1, 3)])
        centre = (points.min(axis=0) + points.max(axis=0)) / 2

        a, e = math.radians(self.azimuth), math.radians(self.elevation)
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        eye = np.array([math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)])
        axes = np.stack([right, np.cross(eye, right), eye])
        width, height = self._size[0], self._size[1] - self._strip_height()
        focal = min(self._size) / 2 / math.tan(FIELD_OF_VIEW / 2)
        x, y, near = axes @ (points - centre).T
        distance = float((near + focal * np.maximum(abs(x) / (0.47 * width), abs(y) / (0.48 * height))).max())
        view = View(centre, axes, distance / self.zoom, focal, (width / 2, height / 2))
        return view, float(points[:, 2].min())

    def _strip_height(self) -> int:
        return round(0.13 * self._size[1])

    def _fade(self, colour: Colour, y: float, opacity: float) -> Colour:
        """A colour over the background at a height in the picture."""
        ground = mix(SKY, GROUND, min(max(y / self._size[1], 0.0), 1.0))
        return mix(ground, colour, opacity)

    def _line(self, colour: Colour, start: FloatArray, end: FloatArray, width: float = 1.0) -> None:
        self._pygame.draw.aaline(self._surface, colour, start, end, max(1, round(width * self._unit)))

    def _draw_floor(self, view: View, floor: float, bodies: FloatArray, reach: float) -> None:
        """The background with a grid under all, and the shadows on it, which show where the bodies are in depth."""
        extent = view.distance * math.tan(FIELD_OF_VIEW / 2)
        self._spacing = round_number(extent / 4.5)
        level = self._spacing * math.floor(floor / self._spacing)
        key = (*view.centre, *view.axes.ravel(), view.distance, level)
        if key != self._floor_key:  # else the one of the frame before still holds
            self._floor_key = key
            self._draw_grid(view, level, extent)
        self._surface.blit(self._floor, (0, 0))

    def _draw_grid(self, view: View, level: float, extent: float) -> None:
        for y in range(self._size[1]):
            row = self._fade(SKY, y, 0.0)
            self._pygame.draw.line(self._floor, row, (0, y), (self._size[0], y))
        cells = 7
        ticks = self._spacing * np.arange(-cells, cells + 1)
        middle = self._spacing * np.round(view.centre[:2] / self._spacing)
        across, along = np.meshgrid(ticks, ticks, indexing="ij")
        nodes = np.stack([middle[0] + across, middle[1] + along, np.full_like(across, level)], axis=-1)
        pixels = view.project(nodes)[0].reshape(*across.shape, 2)
        for lines, grid in ((pixels, nodes), (pixels.swapaxes(0, 1), nodes.swapaxes(0, 1))):
            halves = ((grid[:, 1:] + grid[:, :-1]) / 2)[..., :2] - view.centre[:2]
            opacity = np.clip(1.0 - np.hypot(halves[..., 0], halves[..., 1]) / ticks[-1], 0.0, 1.0) * 0.55
            colours = self._fades(GRID, (lines[:, 1:, 1] + lines[:, :-1, 1]).ravel() / 2, opacity.ravel())
            starts, ends = lines[:, :-1].reshape(-1, 2).tolist(), lines[:, 1:].reshape(-1, 2).tolist()
            for colour, start, end in zip(colours, starts, ends, strict=True):
                self._pygame.draw.aaline(self._floor, colour, start, end)
