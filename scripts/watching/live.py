"""The window: episodes side by side as they happen, keys to hold and slow them, and the watcher's own force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env.canvas import SKY, open_window
from spring_pendulum_env.colours import DIM, INK
from spring_pendulum_env.rendering import Renderer
from spring_pendulum_env.scene import camera_axes
from watching.cast import Hand
from watching.episode import Episode

FloatArray = NDArray[np.float64]

BAR = 52  # pixels below the pictures
FULL_FORCE_AT = 0.25  # of a picture's side: how far from the anchor the mouse pulls with all force
KEY_SHARE = 0.3  # of all force, by a key without shift: with all of it the anchor is out of bounds in a second or two
SLOWEST, FASTEST = 1 / 16, 8.0
HELP = (
    "space pause   . step   - + slower, faster   R random start   B back to this start   drag turn   wheel zoom   Q end"
)
HAND_HELP = {
    "keyboard": "force: arrows sideways, up and down; W S away and near; with shift all of it",
    "mouse": "force: hold the left button, the anchor is pulled there (the right button turns)",
}


class Stage:
    """A window with episodes in it, all from the same start and under the same camera.

    Arguments:
        episodes: what is shown, from left to right.
        renderers: of the pictures, one for each, in mode "rgb_array".
        size: width and height of one picture, pixels.
        seed: of the first start.
        speed: 1 is as fast as it happens.
        seconds: after which it ends by itself; None: never.

    Raises RuntimeError where there is no display.
    """

    def __init__(
        self,
        episodes: Sequence[Episode],
        renderers: Sequence[Renderer],
        size: tuple[int, int],
        *,
        seed: int,
        speed: float = 1.0,
        seconds: float | None = None,
    ) -> None:
        self.episodes, self.renderers = episodes, renderers
        self.seed, self.speed, self.seconds = seed, speed, seconds
        self.paused = False
        self.open = True
        self._size = size
        self._owed = 0.0  # control periods that are due
        self._hands = [episode.controller for episode in episodes if isinstance(episode.controller, Hand)]
        self._held: set[int] = set()  # keys
        self._seeds = np.random.default_rng(seed)
        self._window, self._pygame = open_window((size[0] * len(episodes), size[1] + BAR), "Spring pendulum")
        self._font = self._pygame.font.Font(None, 20)
        self._clock = self._pygame.time.Clock()
        self._start()

    def run(self) -> None:
        """Show until the window is closed."""
        try:
            while self.open:
                self.frame()
                self._clock.tick(60)
        finally:
            self._pygame.display.quit()

    def frame(self) -> None:
        """One picture, after what the watcher did and the time that has passed."""
        for event in self._pygame.event.get():
            self._answer(event)
        self._push()
        if not self.paused:
            passed = min(self._clock.get_time() / 1000.0, 0.1)  # after a halt of the whole machine nothing leaps
            self._owed += self.speed * passed / self.episodes[0].period
            for _ in range(int(self._owed)):
                self.step()
            self._owed %= 1.0
        self._show()
        if self.seconds is not None and self._steps * self.episodes[0].period >= self.seconds - 1e-9:
            self.open = False

    def step(self) -> None:
        """One control period of all that haven't ended."""
        self._steps += 1
        for episode, renderer in zip(self.episodes, self.renderers, strict=True):
            episode.step()
            episode.note(renderer)

    def _start(self) -> None:
        for episode, renderer in zip(self.episodes, self.renderers, strict=True):
            episode.reset(self.seed)
            renderer.forget()
        self._owed, self._steps = 0.0, 0

    def _answer(self, event: Any) -> None:
        pygame = self._pygame
        if event.type == pygame.QUIT:
            self.open = False
        elif event.type == pygame.KEYDOWN:
            self._held.add(event.key)
            self._key(event.key)
        elif event.type == pygame.KEYUP:
            self._held.discard(event.key)
        elif event.type == pygame.MOUSEMOTION:
            left, _, right = event.buttons
            pulls = any(hand.device == "mouse" for hand in self._hands)
            if right or (left and not pulls):
                for renderer in self.renderers:
                    renderer.turn(*event.rel)
        elif event.type == pygame.MOUSEWHEEL:
            for renderer in self.renderers:
                renderer.magnify(event.y)

    def _key(self, key: int) -> None:
        pygame = self._pygame
        if key in (pygame.K_q, pygame.K_ESCAPE):
            self.open = False
        elif key == pygame.K_SPACE:
            self.paused = not self.paused
        elif key == pygame.K_PERIOD:
            self.paused = True
            self._push()
            self.step()
        elif key in (pygame.K_MINUS, pygame.K_KP_MINUS):
            self.speed = max(self.speed / 2.0, SLOWEST)
        elif key in (pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS):
            self.speed = min(self.speed * 2.0, FASTEST)
        elif key == pygame.K_r:
            self.seed = int(self._seeds.integers(2**31))
            self._start()
        elif key == pygame.K_b:
            self._start()

    def _push(self) -> None:
        """Lets the watcher's hands act."""
        for episode, renderer in zip(self.episodes, self.renderers, strict=True):
            if isinstance(episode.controller, Hand):
                by_keys = episode.controller.device == "keyboard"
                episode.controller.force = self._keys_force(renderer) if by_keys else self._mouse_force(renderer)

    def _keys_force(self, renderer: Renderer) -> FloatArray:
        """Along the picture's horizontal, the vertical, and away from the eye."""
        pygame = self._pygame
        pairs = ((pygame.K_RIGHT, pygame.K_LEFT), (pygame.K_UP, pygame.K_DOWN), (pygame.K_w, pygame.K_s))
        shares = np.array([(one in self._held) - (other in self._held) for one, other in pairs], dtype=np.float64)
        right, up, near = camera_axes(renderer.azimuth, 0.0)
        full = bool(self._held & {pygame.K_LSHIFT, pygame.K_RSHIFT})
        force: FloatArray = (1.0 if full else KEY_SHARE) * shares @ np.stack([right, up, -near])
        return force / max(1.0, float(abs(force).max()))

    def _mouse_force(self, renderer: Renderer) -> FloatArray:
        """Towards the pointer, in the plane of the picture."""
        if renderer.scene is None or not self._pygame.mouse.get_pressed()[0]:
            return np.zeros(3)
        left = self._size[0] * list(self.renderers).index(renderer)
        anchor = renderer.scene.project(renderer.scene.bodies[0])[0][0]
        away = (np.array(self._pygame.mouse.get_pos()) - [left, 0] - anchor) / (FULL_FORCE_AT * min(self._size))
        right, up, _ = renderer.scene.axes
        force: FloatArray = away[0] * right - away[1] * up
        return force / max(1.0, float(abs(force).max()))

    def _show(self) -> None:
        self._window.fill(SKY)
        for number, (episode, renderer) in enumerate(zip(self.episodes, self.renderers, strict=True)):
            picture = self._pygame.image.frombuffer(episode.draw(renderer).tobytes(), self._size, "RGB")
            self._window.blit(picture, (number * self._size[0], 0))
        state = f"{'paused, speed' if self.paused else 'speed'} {self.speed:g}   start {self.seed}"
        if all(episode.ended for episode in self.episodes):
            state = f"ended   start {self.seed}: R for another one, B for the same, or --beyond-end to go on"
        hands = "   ".join(HAND_HELP[device] for device in sorted({hand.device for hand in self._hands}))
        self._write(f"{state}   {hands}", self._size[1] + 8, INK)
        self._write(HELP, self._size[1] + 30, DIM)
        self._pygame.display.flip()

    def _write(self, text: str, top: int, colour: tuple[int, int, int]) -> None:
        """A line in the bar, as small as it must be to fit."""
        line = self._font.render(text, True, colour)
        room = self._window.get_width() - 20
        if line.get_width() > room:
            line = self._pygame.transform.smoothscale(line, (room, round(line.get_height() * room / line.get_width())))
        self._window.blit(line, (10, top))
