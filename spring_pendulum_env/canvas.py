"""A pygame surface with a background, and the few shapes, all anti-aliased, of which pictures are made.

Lines are anti-aliased as they are drawn, which costs less than shrinking a larger picture.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import pygame

FloatArray = NDArray[np.float64]
Colour = tuple[int, int, int]

Points = Sequence[Sequence[float]]  # x and y of each, pixels

SKY, GROUND = (13, 17, 26), (33, 41, 56)  # the background at the top and at the bottom
_SKY, _SLOPE = np.array(SKY, dtype=np.float64), np.array(GROUND, dtype=np.float64) - SKY


def mix(a: Colour, b: Colour, share: float) -> Colour:
    """The colour between two, `share` of it the second."""
    return tuple(round(x + (y - x) * share) for x, y in zip(a, b, strict=True))  # type: ignore[return-value]


def import_pygame() -> ModuleType:
    """pygame-ce, or a DependencyNotInstalled that says how to get it."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # its greeting would mix with a program's own output
    try:
        import pygame
    except ImportError:
        hint = 'rendering needs pygame-ce: pip install "spring-pendulum-env[render]"'
        raise gym.error.DependencyNotInstalled(hint) from None
    return pygame


def open_window(size: tuple[int, int], caption: str) -> tuple[pygame.Surface, ModuleType]:
    """A window, and pygame.

    Raises:
        DependencyNotInstalled: pygame isn't there.
        RuntimeError: there is no display; the message says no more than why.
    """
    module = import_pygame()
    display = module.display
    try:
        # Asked without a screen, SDL's libraries complain on stderr by themselves.
        if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"))):
            raise module.error("neither DISPLAY nor WAYLAND_DISPLAY is set")
        display.init()
        # Without a screen SDL draws into nothing and says no word; who wants that names the driver.
        if display.get_driver() == "offscreen" and "SDL_VIDEODRIVER" not in os.environ:
            raise module.error("no screen found")
        window: pygame.Surface = display.set_mode(size)
    except module.error as error:
        display.quit()
        raise RuntimeError(str(error)) from None
    display.set_caption(caption)
    module.font.init()
    return window, module


class Canvas:
    """A picture that is being drawn; positions and widths in pixels.

    `unit` is what widths and letters are multiplied by: 1 in a picture of 600 x 600, and never too small to read.
    Raises DependencyNotInstalled where pygame isn't there.
    """

    def __init__(self, width: int, height: int) -> None:
        self.pygame = import_pygame()
        self.width, self.height = width, height
        self.unit = max(min(width, height) / 600.0, 0.75)
        # Red, green and blue in this order in memory: a frame is then a plain copy.
        masks = (0x0000FF, 0x00FF00, 0xFF0000, 0)
        self.surface: pygame.Surface = self.pygame.Surface((width, height), 0, 24, masks)
        for y, colour in enumerate(self.over(SKY, np.arange(height), np.zeros(height))):
            self.surface.fill(colour, (0, y, width, 1))
        self._sky, self._kept = self.surface.copy(), self.surface.copy()
        self.pygame.font.init()
        self._render = self.pygame.font.Font(None, round(20 * self.unit)).render
        self._rendered = lru_cache(64)(self._render)

    def clear(self) -> None:
        """Leaves nothing but the background."""
        self.surface.blit(self._sky, (0, 0))

    def keep(self) -> None:
        """Remembers the picture as it is now."""
        self._kept.blit(self.surface, (0, 0))

    def restore(self) -> None:
        """Goes back to the picture that was remembered last."""
        self.surface.blit(self._kept, (0, 0))

    def picture(self) -> NDArray[np.uint8]:
        """A copy as an array, shape (height, width, 3)."""
        return np.array(self.pygame.surfarray.pixels3d(self.surface).swapaxes(0, 1), order="C")

    def over(self, colour: Colour, y: ArrayLike, opacity: ArrayLike) -> list[Colour]:
        """A colour laid over the background at heights in the picture, with given opacities."""
        share = np.minimum(np.maximum(np.asarray(y, dtype=np.float64) / self.height, 0.0), 1.0).reshape(-1, 1)
        ground = _SKY + _SLOPE * share
        laid = ground + (np.array(colour, dtype=np.float64) - ground) * np.asarray(opacity).reshape(-1, 1)
        return list(map(tuple, (laid + 0.5).astype(int).tolist()))

    def lines(self, colours: Sequence[Colour], starts: Points, ends: Points, width: float = 1.0) -> None:
        """Lines, each of its colour, from starts to ends."""
        line, surface, pixels = self.pygame.draw.aaline, self.surface, max(1, round(width * self.unit))
        for colour, start, end in zip(colours, starts, ends, strict=True):
            line(surface, colour, start, end, pixels)

    def curve(self, colour: Colour, points: Points) -> None:
        """A thin line through two points or more."""
        self.pygame.draw.aalines(self.surface, colour, False, points)

    def shape(self, colour: Colour, corners: Points) -> None:
        """A filled polygon."""
        self.pygame.draw.polygon(self.surface, colour, corners)
        self.pygame.draw.aalines(self.surface, colour, True, corners)

    def circle(self, colour: Colour, x: float, y: float, radius: float, width: int = 0) -> None:
        """A disc, or with a width a ring."""
        self.pygame.draw.aacircle(self.surface, colour, (x, y), radius, width)

    def box(self, colour: Colour, left: float, top: float, width: float, height: float) -> None:
        """An upright rectangle, filled."""
        self.surface.fill(colour, (left, top, width, height))

    def text(self, text: str, x: float, y: float, colour: Colour, right: bool = False, lasting: bool = True) -> None:
        """Letters with their upper left corner, or with `right` their upper right one, in a place.

        The pictures of the words are kept, but for those that aren't `lasting`.
        """
        drawn = (self._rendered if lasting else self._render)(text, True, colour)
        self.surface.blit(drawn, (round(x) - (drawn.get_width() if right else 0), round(y)))

    def stamp(self, picture: pygame.Surface, x: float, y: float, side: float) -> None:
        """A picture, shrunk to a square of that side, about a place."""
        small = self.pygame.transform.smoothscale(picture, (round(side), round(side)))
        self.surface.blit(small, (round(x - side / 2), round(y - side / 2)))

    def ball(self, colour: Colour) -> pygame.Surface:
        """A picture of a lit ball, to be stamped."""
        side = 128
        x, y = (np.indices((side, side)) + 0.5) * 2.0 / side - 1.0
        z = np.sqrt(np.clip(1.0 - x * x - y * y, 0.0, None))
        light = np.clip((-x - 1.3 * y + 1.5 * z) / 2.22, 0.0, 1.0)[..., None]
        shaded = np.array(colour) * (0.3 + 0.7 * light) + (255.0 - np.array(colour)) * 0.75 * light**24
        ball: pygame.Surface = self.pygame.Surface((side, side), self.pygame.SRCALPHA, 32)
        self.pygame.surfarray.pixels3d(ball)[:] = np.rint(shaded)
        self.pygame.surfarray.pixels_alpha(ball)[:] = np.clip((1.0 - np.hypot(x, y)) * side / 4, 0.0, 1.0) * 255.0
        return ball
