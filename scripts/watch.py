"""Watch the pendulum: in a window, as a film, as a page for the browser, or as figures.

WHO is one or more of nothing, lqr, keyboard, mouse (your own force on the anchor), a shipped policy (damping,
hanging-hanging, hanging-inverted, inverted-hanging, inverted-inverted) or the folder of a run. Several play side by
side from the same start.

    scripts/watch.py inverted-inverted nothing
    scripts/watch.py keyboard --task damping
    scripts/watch.py nothing --task passive --parameters k2=30 L1=0.6
    scripts/watch.py damping lqr --video film.mp4 --speed 0.5
    scripts/watch.py damping nothing --html page.html
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands


def main() -> None:
    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("who", nargs="*", default=["inverted-inverted"], metavar="WHO", help="(default: inverted-inverted)")
    add(
        "--trust",
        action="store_true",
        help="let WHO be the .zip of a policy of Stable-Baselines3, which may run anything",
    )
    add(
        "--task",
        help="passive, damping, stabilisation or swing-up (default: what the first policy was trained for, or damping)",
    )
    add("--equilibrium", help="of the stabilisation task; spring 1 named first")
    add("--seed", type=int, default=0, help="of the start (default: %(default)s)")
    add("--start-scale", type=float, help="multiplies the spread of the start")
    add("--parameters", nargs="+", default=[], metavar="NAME=VALUE", help="constants of the pendulum, as k1=150")
    add("--beyond-end", action="store_true", help="go on where the task would end an episode")
    add("--seconds", type=float, help="how long (default: the task's time limit; the window: until it is closed)")
    add("--speed", type=float, default=1.0, help="1 is as fast as it happens (default: %(default)g)")
    add("--video", type=Path, metavar="FILE", help="write a film, .mp4 or .gif, and open no window")
    add("--html", type=Path, metavar="FILE", help="write a page to play with in a browser, and open no window")
    add("--figures", type=Path, metavar="FOLDER", help="write figures, PNG and SVG, and open no window")
    add("--fps", type=float, help="of a film, at most (default: 50, for a .gif 25)")
    add("--size", type=int, help="of a picture, pixels (default: 600, for a .gif 400)")
    add("--azimuth", type=float, default=-62.0, help="of the eye, degrees (default: %(default)g)")
    add("--elevation", type=float, default=14.0, help="of the eye, degrees (default: %(default)g)")
    add("--zoom", type=float, default=1.0, help="(default: %(default)g)")
    add("--trail", type=float, default=2.0, help="length of the trails, s (default: %(default)g)")
    options = parser.parse_args()

    from watching import show  # slow to import: after the check of the command line

    show.watch(options)


if __name__ == "__main__":
    commands.run(main)
