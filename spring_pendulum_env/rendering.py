"""Draws a state: a perspective picture of the pendulum in its space, with a read-out and the history of its energy.

Colours tell apart what they must for colour-blind eyes too: springs go from blue (pushing) over pale grey to red
(pulling), m1 is amber and m2 teal. `scene.py` says what is seen, `canvas.py` has the shapes, `parts.py` what is made of
them, `readout.py` the numbers, and pygame is imported by the first `Renderer`, since nothing else of the package needs
it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.canvas import Canvas, open_window
from spring_pendulum_env.colours import GRID, MASSES
from spring_pendulum_env.equilibria import energy, vertical_state
from spring_pendulum_env.parts import draw_bodies, draw_force, draw_shadows, draw_task
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.readout import STRIP_HEIGHT, STRIP_SECONDS, draw_strip, round_number, write
from spring_pendulum_env.scenario import Scenario, positive_number
from spring_pendulum_env.scene import FIELD_OF_VIEW, Scene, camera_axes, look

if TYPE_CHECKING:
    import pygame

FloatArray = NDArray[np.float64]

HISTORY_GAP = 0.02  # s; a shorter control period leaves no denser history
TRAIL_GAP = 3.0  # pixels between the points of a trail that are drawn
STEEPEST = 85.0  # degrees, up or down


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
        draw_shadows(self._canvas, scene)
        self._draw_trails(scene)
        draw_task(self._canvas, scene, self._scenario)
        draw_bodies(self._canvas, scene, self._balls, carriage=self._scenario.task.actuated)
        draw_force(self._canvas, scene, self._scenario)
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
