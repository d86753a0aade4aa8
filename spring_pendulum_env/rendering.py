"""Draws a state: a perspective picture of the pendulum in its space, with a read-out and the history of its energy.

Colours tell apart what they must for colour-blind eyes too: springs go from blue (pushing) over pale grey to red
(pulling), m1 is amber and m2 teal. `scene.py` says what is seen, `canvas.py` has the shapes, `readout.py` the numbers,
and pygame is imported by the first `Renderer`, since nothing else of the package needs it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.canvas import SKY, Canvas, mix, open_window
from spring_pendulum_env.colours import ANCHOR, DIM, FORCE, GRID, MASSES, SHADOW, tension_colour
from spring_pendulum_env.equilibria import energy, vertical_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.readout import STRIP_HEIGHT, STRIP_SECONDS, draw_strip, round_number, write
from spring_pendulum_env.scenario import Scenario, positive_number
from spring_pendulum_env.scene import FIELD_OF_VIEW, Scene, camera_axes, cross, look, tension_share

if TYPE_CHECKING:
    import pygame

FloatArray = NDArray[np.float64]

HISTORY_GAP = 0.02  # s; a shorter control period leaves no denser history
TRAIL_GAP = 3.0  # pixels between the points of a trail that are drawn
COILS, COIL_POINTS = 10, 12
STEEPEST = 85.0  # degrees, up or down


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
        self._view: tuple[object, ...] = ()  # of the ground that was drawn last
        self._kept_view: tuple[object, ...] = ()  # of the one that the canvas keeps
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
        rest = vertical_state(*self._scenario.spring_heights(p))
        total, least = np.asarray(energy(p, np.stack([numbers, rest]))).tolist()
        excess = total - least
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
        draw_strip(self._canvas, self._history)
        write(
            self._canvas,
            scene,
            time=time,
            energy=total,
            excess=excess,
            actuated=self._scenario.task.actuated,
            spacing=self._spacing,
            title=self.title,
        )
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
        """A grid that fades into the distance, kept while the camera stands still."""
        self._spacing = round_number(scene.distance * math.tan(FIELD_OF_VIEW / 2) / 3.5)
        if scene.view == self._kept_view:
            self._canvas.restore()
            return
        self._canvas.clear()
        ticks = self._spacing * np.arange(-5, 6)
        x, y = self._spacing * np.round(scene.centre[:2] / self._spacing)
        nodes = np.empty((11, 11, 3))
        nodes[..., 0], nodes[..., 1], nodes[..., 2] = (x + ticks)[:, None], y + ticks, scene.floor
        fading = 1.0 - np.hypot(nodes[..., 0] - scene.centre[0], nodes[..., 1] - scene.centre[1]) / ticks[-1]
        pixels = scene.project(nodes)[0].reshape(11, 11, 2)
        starts = np.concatenate([pixels[:, :-1].reshape(-1, 2), pixels[:-1].reshape(-1, 2)])
        ends = np.concatenate([pixels[:, 1:].reshape(-1, 2), pixels[1:].reshape(-1, 2)])
        shares = [np.minimum(fading[:, :-1], fading[:, 1:]).ravel(), np.minimum(fading[:-1], fading[1:]).ravel()]
        opacity = 0.6 * np.concatenate(shares)
        low, high = np.minimum(starts, ends), np.maximum(starts, ends)
        inside = (high > 0.0).all(axis=1) & (low < [self._width, (1.0 - STRIP_HEIGHT) * self._height + 1.0]).all(axis=1)
        seen = inside & (opacity > 0.04)
        starts, ends = starts[seen], ends[seen]
        self._canvas.lines(self._canvas.over(GRID, starts[:, 1], opacity[seen]), starts.tolist(), ends.tolist())
        if scene.view == self._view:  # it stands still for the second time
            self._canvas.keep()
            self._kept_view = scene.view
        self._view = scene.view

    def _draw_shadows(self, scene: Scene) -> None:
        """On the ground: they show how near the bodies are."""
        feet = scene.bodies.copy()
        feet[:, 2] = scene.floor
        discs = feet[1:, None] + scene.sizes[1:, None, None] * DISC
        pixels = scene.project(np.concatenate([feet, discs.reshape(-1, 3)]))[0]
        ends = pixels[:3].tolist()
        for number, k in enumerate((scene.parameters.k1, scene.parameters.k2)):
            if k > 0.0:
                self._canvas.lines([SHADOW], ends[number : number + 1], ends[number + 1 : number + 2], 2.0)
        for disc in pixels[3:].reshape(2, -1, 2).tolist():
            self._canvas.shape(SHADOW, disc)

    def _draw_trails(self, scene: Scene) -> None:
        age = self._history[-1, 0] - self._history[:, 0]
        rows, age = self._history[age <= self._trail], age[age <= self._trail]
        opacity = 0.8 * (1.0 - age / (self._trail or 1.0)) ** 1.5
        pixels = scene.project(rows[:, 3:].reshape(-1, 3))[0].reshape(-1, 2, 2)
        for number, colour in enumerate(MASSES):
            path = pixels[:, number]
            # Where it is slow its points are closer than can be seen.
            along = np.cumsum(np.hypot(*np.diff(path, axis=0, prepend=path[:1]).T)) // TRAIL_GAP
            drawn = np.flatnonzero(np.diff(along, append=np.inf))
            path, shares = path[drawn], opacity[drawn[1:]]
            points = path.tolist()
            self._canvas.lines(self._canvas.over(colour, path[1:, 1], shares), points[:-1], points[1:], 2.0)

    def _draw_task(self, scene: Scene) -> None:
        """The rails along which the anchor may move, and rings where the masses are wanted."""
        canvas, unit = self._canvas, self._canvas.unit
        axes = self._scenario.actuated_axes
        if axes:
            ends = np.tile(scene.bodies[0], (len(axes), 2, 1))
            for number, axis in enumerate(axes):
                ends[number, :, physics.AXES.index(axis)] = -self._scenario.anchor_travel, self._scenario.anchor_travel
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
        length = math.dist(start, end)
        if length < 3.0:
            return
        head = (end - start) / length * min(12.0 * self._canvas.unit, length)
        side = 0.45 * np.array([-head[1], head[0]])
        self._canvas.lines([FORCE], [start.tolist()], [(end - 0.7 * head).tolist()], 3.0)
        self._canvas.shape(FORCE, [end.tolist(), (end - head + side).tolist(), (end - head - side).tolist()])

    def _draw_anchor(self, scene: Scene) -> None:
        """A carriage where a force moves it, a plate where it is held."""
        form = [1.0, 1.0, 1.0] if self._scenario.task.actuated else [2.2, 2.2, 0.25]
        seen = FACES.copy()
        for axis in range(3):
            seen[axis, :, axis] = math.copysign(1.0, scene.axes[2, axis])  # the face on the side of the eye
        faces = scene.project(scene.bodies[0] + scene.sizes[0] * np.array(form) * seen)[0].reshape(3, 4, 2)
        for face, light in zip(faces.tolist(), (0.6, 0.45, 0.95), strict=True):
            self._canvas.shape(mix(SKY, ANCHOR, light), face)

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
        aside = physics.length(*side.tolist())
        side = side / aside if aside > 1e-9 else scene.axes[0]
        first, last = (min(0.85 * size, 0.4 * length) for size in scene.sizes[end - 1 : end + 1].tolist())
        radius = 0.048 * scene.reach * slimness
        frame = np.stack([(length - first - last) * direction, radius * side, radius * cross(side, direction)])
        pixels, scale = scene.project(scene.bodies[end - 1] + first * direction + COIL @ frame)
        width = min(0.013 * scene.reach * float(scale.mean()) / self._canvas.unit * slimness**0.5, 5.0)
        for half, shade in ((~FRONT, mix(SKY, colour, 0.5)), (FRONT, colour)):
            starts, ends = pixels[:-1][half].tolist(), pixels[1:][half].tolist()
            self._canvas.lines([shade] * len(starts), starts, ends, width)

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
