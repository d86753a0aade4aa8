"""From the options of scripts/watch.py to a window, a film, a page or figures."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import Any

from spring_pendulum_env.rendering import Renderer
from spring_pendulum_env.tasks import TASKS
from watching import film, output
from watching.cast import HANDS, Cast, choose
from watching.episode import Episode

RANGES = {"speed": (0.01, 100.0), "fps": (1.0, 200.0)}  # beyond them a window hangs, and a film is a still


def watch(options: argparse.Namespace) -> None:
    """Do what the options of scripts/watch.py say.

    Raises:
        ValueError: an option is wrong; the message names it, and what is allowed.
        DependencyNotInstalled: what an option needs isn't there.
        OSError: a file can't be written.
    """
    _check(options)
    constants = _constants(options.parameters)
    cast = choose(options.who, options.task, options.equilibrium, constants, options.start_scale, trust=options.trust)
    episodes = [Episode(cast, number, beyond_end=options.beyond_end) for number in range(len(cast.players))]
    try:
        if not (options.video or options.html or options.figures):
            _live(cast, episodes, options)
        if options.figures and options.seconds and options.seconds < cast.scenario.control_period:
            raise ValueError(
                f"--seconds {options.seconds:g}: must be at least a control period for --figures, "
                f"{cast.scenario.control_period:g}"
            )
        seconds = options.seconds or TASKS[cast.environment_id].max_episode_steps * cast.scenario.control_period
        if options.video:
            _film(cast, episodes, options, seconds)
        if options.html or options.figures:
            from watching.record import record

            records = [record(episode, options.seed, seconds) for episode in episodes]
            if options.html:
                from watching import page

                page.write(options.html, records)
                print(f"page: {options.html}")
            if options.figures:
                from watching import figures

                for path in figures.draw(options.figures, records):
                    print(f"figure: {path}")
    finally:
        for episode in episodes:
            episode.close()


def _check(options: argparse.Namespace) -> None:
    """All that can be wrong before anything is made."""
    if options.seconds is not None and not 0.0 < options.seconds < math.inf:
        raise ValueError(f"--seconds {options.seconds:g}: must be a finite number > 0")
    for name, (least, most) in RANGES.items():
        value = getattr(options, name)
        if value is not None and not least <= value <= most:
            raise ValueError(f"--{name} {value:g}: must be from {least:g} to {most:g}")
    if options.seed < 0:
        raise ValueError(f"--seed {options.seed}: must be a whole number >= 0")
    if options.video:
        output.check_file("--video", options.video, film.TYPES)
    if options.html:
        output.check_file("--html", options.html, (".html", ".htm"))
    if options.figures:
        output.check_folder("--figures", options.figures)
    hands = [name for name in options.who if name in HANDS]
    if hands and (options.video or options.html or options.figures):
        raise ValueError(f"{hands[0]!r} needs the window: leave out --video, --html and --figures")


def _constants(pairs: Sequence[str]) -> Mapping[str, float]:
    constants = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        try:
            constants[name] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise ValueError(f"--parameters {pair}: must be NAME=VALUE with a number, as k1=150")
    return constants


def _renderers(cast: Cast, options: argparse.Namespace, size: int) -> list[Renderer]:
    camera: Any = {name: getattr(options, name) for name in ("azimuth", "elevation", "zoom", "trail")}
    fps = 1.0 / cast.scenario.control_period
    return [Renderer("rgb_array", fps, cast.scenario, size=(size, size), **camera) for _ in cast.players]


def _live(cast: Cast, episodes: Sequence[Episode], options: argparse.Namespace) -> None:
    from watching.live import Stage

    size = options.size or 600
    renderers = _renderers(cast, options, size)
    times: Any = {"seed": options.seed, "speed": options.speed, "seconds": options.seconds}
    try:
        stage = Stage(episodes, renderers, (size, size), **times)
    except RuntimeError as error:
        raise ValueError(f"a window needs a display ({error}): --video FILE and --html FILE need none") from None
    stage.run()


def _film(cast: Cast, episodes: Sequence[Episode], options: argparse.Namespace, seconds: float) -> None:
    kind = options.video.suffix.lower()
    renderers = _renderers(cast, options, options.size or (400 if kind == ".gif" else 600))
    most = options.fps or film.FRAMES_PER_SECOND[kind]
    stride, fps = film.timing(cast.scenario.control_period, options.speed, most)
    for episode in episodes:
        episode.reset(options.seed)
    count = int(seconds / (stride * cast.scenario.control_period)) + 1
    film.write(options.video, film.frames(episodes, renderers, seconds, stride), fps, count)
    print(f"film: {options.video}, {options.video.stat().st_size / 1e6:.2f} MB")
