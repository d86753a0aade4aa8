"""Draws a state: a perspective picture of the pendulum in its space, with a read-out and the history of its energy.

Colours tell apart what they must for colour-blind eyes too: springs go from blue (pushing) over pale grey to red
(pulling), m1 is amber and m2 teal. `scene.py` says what is seen, `canvas.py` has the shapes, and pygame is imported by
the first `Renderer`, since nothing else of the package needs it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.canvas import SKY, Canvas, Colour, mix, open_window
from spring_pendulum_env.equilibria import energy, vertical_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import Scenario, positive_number
from spring_pendulum_env.scene import FIELD_OF_VIEW, Scene, camera_axes, cross, look, tension_share

if TYPE_CHECKING:
    import pygame

FloatArray = NDArray[np.float64]

GRID, SHADOW, INK, DIM = (112, 130, 158), (9, 12, 18), (232, 236, 243), (150, 161, 180)
PUSH, SLACK, PULL = (64, 150, 255), (222, 226, 233), (255, 76, 58)
ANCHOR, MASSES = (176, 186, 202), ((245, 184, 61), (45, 200, 165))
FORCE, KINETIC = (226, 132, 205), (126, 146, 214)

STRIP_HEIGHT, STRIP_SECONDS = 0.15, 10.0  # of the picture, and what it shows
HISTORY_GAP = 0.02  # s; a shorter control period leaves no denser history
COILS, COIL_POINTS = 10, 12
STEEPEST = 85.0  # degrees, up or down


def tension_colour(tension: float) -> Colour:
    """Of a spring: full red where it pulls with 1 or more, full blue where it pushes with 1 or more."""
    return mix(SLACK, PULL if tension > 0.0 else PUSH, min(abs(tension), 1.0) ** 0.8)


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


class Renderer:
    """Draws the states of one environment, one after the other.

    A picture depends on nothing but what was drawn since the last `forget`, so the same history gives the same bits.
    In mode "rgb_array" no display is touched. The camera holds the usual motion about the task's equilibrium, and
    about where its episodes start, and moves back when a body leaves that; where no spring 1 ties the masses to the
    anchor it goes with them. In mode "human" dragging turns it and the wheel zooms; `azimuth`, `elevation`, `zoom` and
    `title` may be set between frames too. What the last frame shows is in `scene`. After the window was closed
    `closed` is true and `draw` does nothing.
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
        title: str = "",
    ) -> None:
        """Opens the window in mode "human".

        Args:
            render_mode: "human" or "rgb_array".
            fps: frames per second that the window keeps to.
            scenario: the task and its arguments.
            size: width and height, whole pixels, 200 to 8192.
            azimuth: of the eye about the vertical, degrees; 0 looks from +x, -90 from -y.
            elevation: of the eye over the horizontal, degrees, -85 to 85.
            zoom: magnification.
            trail: how long the masses' trails are, s.
            title: a few words for the lower left corner.

        Raises:
            DependencyNotInstalled: pygame isn't there.
            ValueError: an argument is out of range.
            RuntimeError: "human" without a display.
        """
        if len(size) != 2 or any(int(side) != side or not 200 <= side <= 8192 for side in size):
            raise ValueError(f"size = {size!r}: must be two whole numbers of pixels from 200 to 8192")
        if not (math.isfinite(azimuth) and abs(elevation) <= STEEPEST):
            raise ValueError(f"azimuth, elevation = {azimuth!r}, {elevation!r}: must be finite, elevation in [-85, 85]")
        self.azimuth, self.elevation, self.zoom = azimuth, elevation, positive_number("zoom", zoom)
        self.title = title
        self.closed = False
        self.scene: Scene | None = None
        self.events: list[pygame.event.Event] = []  # of the window, between the last two frames: keys, mouse
        self._trail = positive_number("trail", trail, zero=True)
        self._fps = fps
        self._scenario = scenario
        self._width, self._height = int(size[0]), int(size[1])
        self._canvas = Canvas(self._width, self._height)
        self._pygame = self._canvas.pygame
        self._window = self._open() if render_mode == "human" else None
        self._view: tuple[object, ...] = ()  # of the ground that the canvas keeps
        self._balls = [self._canvas.ball(colour) for colour in MASSES]
        self.forget()

    def forget(self) -> None:
        """Starts anew: no trails, no history of the energy."""
        self._history = np.empty((0, 9))  # time, kinetic and excess energy, positions of the masses

    def turn(self, right: float, down: float) -> None:
        """Turns the camera as dragging by so many pixels does."""
        self.azimuth -= 0.4 * right
        self.elevation = min(max(self.elevation + 0.4 * down, -STEEPEST), STEEPEST)

    def magnify(self, clicks: float) -> None:
        """Zooms as so many clicks of the wheel do."""
        self.zoom = min(max(self.zoom * 1.1**clicks, 0.1), 10.0)

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._pygame.display.quit()
            self._window = None
            self.closed = True

    def remember(self, state: ArrayLike, parameters: Parameters, time: float) -> tuple[float, float]:
        """Notes a state for the trails and the strip without drawing it: for who draws fewer frames than there are
        states.

        Args:
            state: as in `draw`.
            parameters: the constants in force.
            time: since the start of the episode, s.

        Returns:
            Energy and excess energy, J.
        """
        numbers, p = np.asarray(state, dtype=np.float64), parameters
        kinetic = physics.kinetic_energy(*[*numbers[9:].tolist(), p.m0, p.m1, p.m2])
        total = float(energy(p, numbers))
        excess = total - float(energy(p, vertical_state(*self._scenario.spring_heights(p))))
        self._remember(np.array([time, kinetic, excess, *numbers[3:9]]))
        return total, excess

    def draw(self, state: ArrayLike, parameters: Parameters, force: ArrayLike, time: float) -> NDArray[np.uint8] | None:
        """Draws a state. It takes the place of states drawn before whose time isn't earlier.

        Args:
            state: positions in m, then velocities in m/s of the anchor, m1 and m2; shape (18,).
            parameters: the constants in force.
            force: on the anchor, N; shape (3,).
            time: since the start of the episode, s.

        Returns:
            The picture in mode "rgb_array", shape (height, width, 3); None in mode "human".
        """
        if self.closed:
            return None
        state, p = np.array(state, dtype=np.float64), parameters
        total, excess = self.remember(state, p, time)
        self.scene = scene = look(
            self._scenario,
            p,
            state[:9].reshape(3, 3),
            np.array(force, dtype=np.float64),
            axes=camera_axes(self.azimuth, self.elevation),
            zoom=self.zoom,
            size=(self._width, self._height),
        )
        self._draw_ground(scene)
        self._draw_shadows(scene)
        self._draw_trails(scene)
        self._draw_task(scene)
        self._draw_bodies(scene)
        self._draw_force(scene)
        self._draw_strip()
        self._write(scene, time, total, excess)
        if self._window is None:
            return self._canvas.picture()
        self._show(self._window)
        return None

    def _remember(self, row: FloatArray) -> None:
        times = self._history[:, 0]
        kept = self._history[(times < row[0]) & (times >= row[0] - max(self._trail, STRIP_SECONDS))]
        crowded = len(kept) >= 2 and row[0] - kept[-2, 0] < HISTORY_GAP
        self._history = np.vstack([kept[:-1] if crowded else kept, row])

    def _draw_ground(self, scene: Scene) -> None:
        """A grid that fades into the distance, kept for as long as the camera stands still."""
        if self._view == scene.view:
            self._canvas.restore()
            return
        self._spacing = round_number(scene.distance * math.tan(FIELD_OF_VIEW / 2) / 3.5)
        self._canvas.clear()
        ticks = self._spacing * np.arange(-5, 6)
        x, y = self._spacing * np.round(scene.centre[:2] / self._spacing)
        nodes = np.stack(np.meshgrid(x + ticks, y + ticks, [scene.floor], indexing="ij"), axis=-1)[:, :, 0]
        fading = 1.0 - np.linalg.norm((nodes - scene.centre)[..., :2], axis=-1) / ticks[-1]
        pixels = scene.project(nodes)[0].reshape(*fading.shape, 2)
        for lines, shares in ((pixels, fading), (pixels.swapaxes(0, 1), fading.T)):
            opacity = 0.6 * np.minimum(shares[:, :-1], shares[:, 1:])
            seen = opacity > 0.04
            starts, ends = lines[:, :-1][seen], lines[:, 1:][seen]
            self._canvas.lines(self._canvas.over(GRID, starts[:, 1], opacity[seen]), starts, ends)
        self._canvas.keep()
        self._view = scene.view

    def _draw_shadows(self, scene: Scene) -> None:
        """On the ground: they show how near the bodies are."""
        feet = scene.bodies * [1.0, 1.0, 0.0] + [0.0, 0.0, scene.floor]
        pixels = scene.project(feet)[0]
        tied = np.array([scene.parameters.k1, scene.parameters.k2]) > 0.0
        self._canvas.lines([SHADOW] * 2, pixels[:-1][tied], pixels[1:][tied], 2.0)
        turn = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
        disc = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(24)])
        for foot, size in zip(feet[1:], scene.sizes[1:], strict=True):
            self._canvas.shape(SHADOW, scene.project(foot + size * disc)[0])

    def _draw_trails(self, scene: Scene) -> None:
        age = self._history[-1, 0] - self._history[:, 0]
        rows, age = self._history[age <= self._trail], age[age <= self._trail]
        opacity = 0.8 * (1.0 - age[1:] / (self._trail or 1.0)) ** 1.5
        for colour, columns in zip(MASSES, (slice(3, 6), slice(6, 9)), strict=True):
            pixels = scene.project(rows[:, columns])[0]
            self._canvas.lines(self._canvas.over(colour, pixels[1:, 1], opacity), pixels[:-1], pixels[1:], 2.0)

    def _draw_task(self, scene: Scene) -> None:
        """The rails along which the anchor may move, and rings where the masses are wanted."""
        for axis in self._scenario.actuated_axes:
            ends = np.stack([scene.bodies[0], scene.bodies[0]])
            ends[:, physics.AXES.index(axis)] = np.array([-1.0, 1.0]) * self._scenario.anchor_travel
            if scene.near(ends).max() < 0.8 * scene.distance:
                pixels = scene.project(ends)[0]
                rail = self._canvas.over(ANCHOR, pixels[1, 1], 0.3)
                self._canvas.lines(rail, pixels[:1], pixels[1:])
                for x, y in pixels.tolist():
                    self._canvas.circle(rail[0], x, y, 3.0 * self._canvas.unit)
                self._canvas.text(axis, x + 6.0 * self._canvas.unit, y - 6.0 * self._canvas.unit, DIM)
        if 0.0 in (scene.parameters.k1, scene.parameters.k2):
            return  # no place of rest
        pixels, scale = scene.project(scene.targets)
        for (x, y), size, colour in zip(pixels.tolist(), 1.45 * scale * scene.sizes[1:], MASSES, strict=True):
            ring, width = self._canvas.over(colour, y, 0.55)[0], max(1, round(1.5 * self._canvas.unit))
            self._canvas.circle(ring, x, y, max(size, 6.0 * self._canvas.unit), width)

    def _draw_bodies(self, scene: Scene) -> None:
        """Anchor, springs and masses, the farthest first."""
        p, near = scene.parameters, scene.near(scene.bodies)
        parts: list[tuple[float, Callable[[], None]]] = [(near[0], partial(self._draw_anchor, scene))]
        parts += [(near[mass], partial(self._draw_mass, scene, mass)) for mass in (1, 2)]
        for end, k, L in ((1, p.k1, p.L1), (2, p.k2, p.L2)):
            if k > 0.0:
                parts.append(((near[end - 1] + near[end]) / 2, partial(self._draw_spring, scene, end, k, L)))
        for _, draw in sorted(parts, key=lambda part: part[0]):
            draw()

    def _draw_force(self, scene: Scene) -> None:
        """An arrow, a third as long as the pendulum for an axis's greatest force."""
        tip = scene.bodies[0] + 0.35 * scene.reach / self._scenario.max_force * scene.force
        start, end = scene.project([scene.bodies[0], tip])[0]
        length = float(np.hypot(*(end - start)))
        if length < 3.0:
            return
        head = (end - start) / length * min(12.0 * self._canvas.unit, length)
        side = 0.45 * np.array([-head[1], head[0]])
        self._canvas.lines([FORCE], start[None], (end - 0.7 * head)[None], 3.0)
        self._canvas.shape(FORCE, np.stack([end, end - head + side, end - head - side]))

    def _draw_anchor(self, scene: Scene) -> None:
        """A carriage where a force moves it, a plate where it is held."""
        form = [1.0, 1.0, 1.0] if self._scenario.task.actuated else [2.2, 2.2, 0.25]
        square = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
        for axis, light in enumerate((0.6, 0.45, 0.95)):
            corners = np.insert(square, axis, math.copysign(1.0, scene.axes[2, axis]), axis=1)  # the face that is seen
            pixels = scene.project(scene.bodies[0] + scene.sizes[0] * np.array(form) * corners)[0]
            self._canvas.shape(mix(SKY, ANCHOR, light), pixels)

    def _draw_mass(self, scene: Scene, mass: int) -> None:
        pixels, scale = scene.project(scene.bodies[mass])
        side = 2.0 * max(scene.sizes[mass] * float(scale[0]), 4.0 * self._canvas.unit)
        x, y = pixels[0].tolist()
        self._canvas.stamp(self._balls[mass - 1], x, y, side)

    def _draw_spring(self, scene: Scene, end: int, k: float, L: float) -> None:
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
        side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-9 else scene.axes[0]
        share = np.linspace(0.0, 1.0, COILS * COIL_POINTS + 1)
        turn = 2.0 * math.pi * COILS * share
        radius = 0.048 * scene.reach * slimness * np.clip(9.0 * np.minimum(share, 1.0 - share), 0.0, 1.0)
        first, last = (min(0.85 * size, 0.4 * length) for size in scene.sizes[end - 1 : end + 1])
        points = scene.bodies[end - 1] + np.outer(first + share * (length - first - last), direction)
        points += np.outer(radius * np.sin(turn), side) + np.outer(radius * np.cos(turn), cross(side, direction))
        pixels, scale = scene.project(points)
        width = min(0.013 * scene.reach * float(scale.mean()) / self._canvas.unit * slimness**0.5, 5.0)
        front = np.cos((turn[1:] + turn[:-1]) / 2) > 0.0
        for half, shade in ((~front, mix(SKY, colour, 0.5)), (front, colour)):
            self._canvas.lines([shade] * int(half.sum()), pixels[:-1][half], pixels[1:][half], width)

    def _draw_strip(self) -> None:
        """The excess energy of the last seconds, now at the right; filled: the kinetic part of it."""
        gap, right = 10.0 * self._canvas.unit, self._width - 10.0 * self._canvas.unit
        top, bottom = (1.0 - STRIP_HEIGHT) * self._height, self._height - gap
        self._canvas.box(SKY, 0, round(top), self._width, self._height)
        times, kinetic, excess = self._history[self._history[:, 0] >= self._history[-1, 0] - STRIP_SECONDS, :3].T
        highest = round_number(max(1e-6, kinetic.max(), excess.max()))
        lowest = -round_number(-excess.min()) if excess.min() < -0.02 * highest else 0.0
        slope = (bottom - top - 26.0 * self._canvas.unit) / (highest - lowest)
        zero = bottom + slope * lowest
        drawn = np.flatnonzero(np.diff(times // 0.04, append=np.inf))  # the last of each 0.04 s
        x = right - (times[-1] - times[drawn]) * (right - gap) / STRIP_SECONDS
        curve = np.column_stack([x, zero - slope * kinetic[drawn]]).tolist()
        area = np.array([(x[0], zero), *curve, (right, zero)])
        self._canvas.shape(mix(SKY, KINETIC, 0.5), area)
        self._canvas.curve(KINETIC, area[1:])
        for shift in (0.0, 0.8):  # twice, to be thicker than the other
            curve = np.column_stack([x, zero - slope * excess[drawn] - shift]).tolist()
            self._canvas.curve(INK, [*curve, curve[-1]])
        edges = np.array([[0.0, top], [gap, zero], [self._width, top], [right, zero]])
        self._canvas.lines([mix(SKY, GRID, 0.6)] * 2, edges[:2], edges[2:])
        self._canvas.text("excess energy", gap, top + 0.7 * gap, INK)
        self._canvas.text("kinetic", gap + 105.0 * self._canvas.unit, top + 0.7 * gap, KINETIC)
        span = with_minus(f"{highest:g} J" if lowest == 0.0 else f"{lowest:g} to {highest:g} J")
        self._canvas.text(f"{span}, last {STRIP_SECONDS:g} s", right, top + 0.7 * gap, DIM, right=True)

    def _write(self, scene: Scene, time: float, total: float, excess: float) -> None:
        """The read-out on the left, what the colours mean on the right."""
        unit, p = self._canvas.unit, scene.parameters
        edge, row, right = 12.0 * unit, 20.0 * unit, self._width - 12.0 * unit
        rows = [("time", quantity(time, "s")), ("energy", quantity(total, "J")), ("excess", quantity(excess, "J"))]
        if self._scenario.task.actuated:
            rows.append(("force", quantity(physics.length(*scene.force.tolist()), "N")))
        for number, (name, value) in enumerate(rows):
            self._canvas.text(name, edge, edge + number * row, DIM)
            self._canvas.text(value, edge + 58.0 * unit, edge + number * row, FORCE if name == "force" else INK)
        self._canvas.text(f"m1  {p.m1:.3g} kg", right, edge, MASSES[0], right=True)
        self._canvas.text(f"m2  {p.m2:.3g} kg", right, edge + row, MASSES[1], right=True)
        self._canvas.text("push", right - 104.0 * unit, edge + 2 * row, PUSH, right=True)
        self._canvas.text("pull", right, edge + 2 * row, PULL, right=True)
        for step in range(16):
            left, top = right - (98.0 - 4.0 * step) * unit, edge + 2 * row + 4.0 * unit
            self._canvas.box(tension_colour(step / 7.5 - 1.0), left, top, 4.0 * unit + 1.0, 6.0 * unit)
        bottom = self._height * (1.0 - STRIP_HEIGHT) - row
        self._canvas.text(f"grid {self._spacing:g} m", right, bottom, DIM, right=True)
        self._canvas.text(self.title, edge, bottom, INK)

    def _open(self) -> pygame.Surface:
        try:
            window, pygame = open_window((self._width, self._height), f"Spring pendulum: {self._scenario.task.name}")
        except RuntimeError as error:
            raise RuntimeError(f'render_mode = "human" needs a display ({error}); "rgb_array" needs none') from None
        self._clock = pygame.time.Clock()
        return window

    def _show(self, window: pygame.Surface) -> None:
        window.blit(self._canvas.surface, (0, 0))
        self._pygame.display.flip()
        self._clock.tick(self._fps)
        self.events = self._pygame.event.get()
        for event in self.events:
            if event.type == self._pygame.QUIT:
                self.close()
            elif event.type == self._pygame.MOUSEMOTION and event.buttons[0]:
                self.turn(*event.rel)
            elif event.type == self._pygame.MOUSEWHEEL:
                self.magnify(event.y)
