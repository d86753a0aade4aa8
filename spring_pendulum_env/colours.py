"""The colours of the pictures, told apart with any colour vision where they must be."""

from __future__ import annotations

from spring_pendulum_env.canvas import Colour, mix

GRID, SHADOW, INK, DIM = (112, 130, 158), (9, 12, 18), (232, 236, 243), (150, 161, 180)
PUSH, SLACK, PULL = (64, 150, 255), (222, 226, 233), (255, 76, 58)
ANCHOR, MASSES = (176, 186, 202), ((245, 184, 61), (45, 200, 165))
FORCE, KINETIC = (226, 132, 205), (126, 146, 214)


def tension_colour(tension: float) -> Colour:
    """Of a spring: full red where it pulls with 1 or more, full blue where it pushes with 1 or more."""
    return mix(SLACK, PULL if tension > 0.0 else PUSH, min(abs(tension), 1.0) ** 0.8)


TENSION_SCALE = tuple(tension_colour(step / 7.5 - 1.0) for step in range(16))
"""From pushing to pulling."""
