"""How the figures look, and how they are written."""

from __future__ import annotations

import functools
import io
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

import gymnasium as gym

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))  # one fewer, so that pairs come again only after thirty
MARKERS = ("o", "s", "^", "D", "v", "X")
MASSES = ("#0072B2", "#E69F00")  # dark and light in a grey print: paths are too tangled for dashes
INK, GREY = "#222222", "#767676"
WIDTH = 6.9  # inches: a page's text in A4

STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "svg.hashsalt": "spring_pendulum_env",  # the same file each time
    "svg.fonttype": "none",  # letters that can be searched and edited
}


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Lets a function draw in STYLE, and leaves matplotlib as it was."""

    @functools.wraps(draw)
    def draw_styled(*arguments: P.args, **options: P.kwargs) -> Figure:
        with _matplotlib().rc_context(STYLE):
            return draw(*arguments, **options)

    return draw_styled


def save(figure: Figure, path: str | Path) -> list[Path]:
    """Write a figure as PNG, 200 dots per inch, and as SVG; the same figure gives the same bits.

    Args:
        figure: from one of the functions of this package.
        path: without a suffix; its folder is made.

    Returns:
        The files.

    Raises:
        OSError: they can't be written.
    """
    matplotlib = _matplotlib()
    files = []
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        drawn = io.BytesIO()
        with matplotlib.rc_context(STYLE):
            figure.savefig(drawn, format=kind, dpi=200, metadata=metadata)
        file = Path(f"{path}.{kind}")
        file.write_bytes(drawn.getvalue())
        files.append(file)
    return files


def _matplotlib() -> Any:
    try:
        import matplotlib
        import matplotlib.figure
    except ImportError:
        hint = 'figures need matplotlib: pip install "spring-pendulum-env[plot]"'
        raise gym.error.DependencyNotInstalled(hint) from None
    return matplotlib


def empty_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure, sizes in inches; without pyplot, so that nobody has to close it."""
    figure: Figure = _matplotlib().figure.Figure(figsize=(width, height), layout="constrained")
    return figure


def all_looks() -> Iterator[dict[str, Any]]:
    """Colour and style of one line after the other."""
    for colour, style in zip(itertools.cycle(COLOURS), itertools.cycle(STYLES), strict=False):
        yield {"color": colour, "linestyle": style}
