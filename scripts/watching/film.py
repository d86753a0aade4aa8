"""An episode as a film: MP4 by ffmpeg, GIF by pillow. No display is touched."""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.files import write_atomically
from spring_pendulum_env.canvas import GROUND, SKY, Colour, mix
from spring_pendulum_env.colours import (
    ANCHOR,
    FORCE,
    GRID,
    INK,
    KINETIC,
    MASSES,
    PULL,
    PUSH,
    SHADOW,
    SLACK,
    tension_colour,
)
from spring_pendulum_env.rendering import Renderer
from watching.episode import Episode

Picture = NDArray[np.uint8]

TYPES = (".mp4", ".gif")
FRAMES_PER_SECOND = {".mp4": 50.0, ".gif": 25.0}  # at most; the control period may allow fewer
BLACK = (0, 0, 0)
SHADES = 17  # of each colour in a GIF


def timing(period: float, speed: float, most: float) -> tuple[int, float]:
    """How many control periods lie between two frames, and frames per second, for a film at a speed.

    Args:
        period: of control, s.
        speed: 1 is as fast as it happens.
        most: frames per second, not to be exceeded where the speed allows it.
    """
    stride = max(1, math.ceil(speed / (most * period) - 1e-9))
    return stride, speed / (stride * period)


def frames(
    episodes: Sequence[Episode], renderers: Sequence[Renderer], seconds: float, stride: int
) -> Iterator[Picture]:
    """Pictures of episodes side by side, from their start on, until the time is up or all have ended for a second."""
    period = episodes[0].period
    left = round(1.0 / period)
    for step in range(round(seconds / period) + 1):
        if step:
            for episode, renderer in zip(episodes, renderers, strict=True):
                episode.step()
                episode.note(renderer)
        if step % stride == 0:
            yield np.hstack([episode.draw(renderer) for episode, renderer in zip(episodes, renderers, strict=True)])
        left -= all(episode.ended for episode in episodes)
        if left == 0:
            return


def write(path: Path, pictures: Iterator[Picture], fps: float, count: int) -> None:
    """Write a film of about `count` pictures, telling on stderr how far it is.

    Raises:
        DependencyNotInstalled: what writes the type of file isn't there.
        OSError: the file can't be written.
    """
    (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(path, _told(pictures, count), fps)


def _told(pictures: Iterator[Picture], count: int) -> Iterator[Picture]:
    for number, picture in enumerate(pictures):
        if number % 50 == 0:
            print(f"\rframe {number} of {count}", end="", file=sys.stderr, flush=True)
        yield picture
    print("\r" + 30 * " " + "\r", end="", file=sys.stderr)


def _write_mp4(path: Path, pictures: Iterator[Picture], fps: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        hint = "MP4 needs imageio-ffmpeg: pip install '.[video]' (a GIF doesn't)"
        raise gym.error.DependencyNotInstalled(hint) from None
    first = next(pictures)
    height, width = (side // 2 * 2 for side in first.shape[:2])  # players want even numbers
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        unfinished = Path(folder) / path.name
        options: dict[str, Any] = {"fps": fps, "macro_block_size": 2, "quality": 7}
        writer = imageio_ffmpeg.write_frames(str(unfinished), (width, height), **options)
        writer.send(None)
        for picture in (first, *pictures):
            writer.send(np.ascontiguousarray(picture[:height, :width]))
        writer.close()
        unfinished.replace(path)


def palette() -> list[Colour]:
    """The colours of a GIF, at most 255: those that are drawn with, in shades down to the background and up to white.

    One that counts the pixels would spend itself on the background. The 256th is for what stays as it was, which
    pillow then leaves out of a picture: a third less to load.
    """
    drawn = (*MASSES, PUSH, PULL, SLACK, FORCE, KINETIC, INK, GRID, ANCHOR)
    shades = np.linspace(0.0, 1.0, SHADES + 1)[1:].tolist()
    middle = mix(SKY, GROUND, 0.4)
    colours = [mix(middle, colour, shade) for colour in drawn for shade in shades]
    colours += [mix(tension_colour(0.0), colour, share / 8) for colour in (PUSH, PULL) for share in range(1, 8)]
    colours += [mix(colour, (255, 255, 255), share / 5) for colour in MASSES for share in range(1, 5)]
    colours += [mix(BLACK, colour, share / 8) for colour in MASSES for share in range(1, 8)]
    colours += [SHADOW, *(mix(SKY, GROUND, share / 40) for share in range(41))]
    return list(dict.fromkeys(colours))


def durations(count: int, fps: float) -> list[int]:
    """Milliseconds of each picture of a GIF, which counts in hundredths of a second: uneven, so that none is lost."""
    ends = np.rint(100.0 / fps * np.arange(count + 1)).astype(int)
    return [10 * int(hundredths) for hundredths in np.diff(ends)]


def _write_gif(path: Path, pictures: Iterator[Picture], fps: float) -> None:
    """One palette for all and no dithering, which would keep pillow from leaving out what stays as it is."""
    try:
        from PIL import Image
    except ImportError:
        hint = "a GIF needs pillow: pip install '.[plot]'"
        raise gym.error.DependencyNotInstalled(hint) from None
    colours = Image.new("P", (1, 1))
    colours.putpalette(np.array(palette(), dtype=np.uint8).tobytes())
    images = [Image.fromarray(picture).quantize(palette=colours, dither=Image.Dither.NONE) for picture in pictures]
    options: dict[str, Any] = {"save_all": True, "append_images": images[1:], "loop": 0, "optimize": True}
    options["duration"] = durations(len(images), fps)
    write_atomically(path, lambda file: images[0].save(file, format="GIF", **options))
