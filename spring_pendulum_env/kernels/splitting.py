"""The loops of the splitting, on pendulums side by side.

Integrators.py has the coefficients, physics.py the formulas. The loops over pendulums are innermost, so that root and
division vectorise.
"""

from __future__ import annotations

import math

from spring_pendulum_env import integrators, physics
from spring_pendulum_env.integrators import DRIFTS, KICKS
from spring_pendulum_env.jit import compiled
from spring_pendulum_env.kernels.lanes import in_use
from spring_pendulum_env.layout import (
    DRAG,
    FORCE,
    GUARDED,
    HALF,
    LOST,
    MASSES,
    PHYSICS,
    SHARE,
    SHORT,
    SPRINGS,
    STAGES,
    STEPS,
)


@compiled
def _stages(b, lanes, first, last, step, known):
    """The stages from `first` on to before `last` of a step, s, without drag.

    Nothing else happens in these loops, so that the compiler can keep a single pendulum's state in registers.

    Args:
        known: whether the forces of the first of them are those of the stage before it.
    """
    lanes = in_use(b, lanes)
    for s in range(first, last):
        # Springs, then kicks and drifts: in loops of their own, so that the roots and divisions of several
        # pendulums are in flight at once.
        if s > first or not known:
            for j in range(lanes):
                force1 = physics.spring_force(
                    b[3, j] - b[0, j], b[4, j] - b[1, j], b[5, j] - b[2, j], b[PHYSICS + 5, j], b[PHYSICS + 7, j]
                )
                force2 = physics.spring_force(
                    b[6, j] - b[3, j], b[7, j] - b[4, j], b[8, j] - b[5, j], b[PHYSICS + 6, j], b[PHYSICS + 8, j]
                )
                b[SPRINGS, j] = force1[0]
                b[SPRINGS + 1, j] = force1[1]
                b[SPRINGS + 2, j] = force1[2]
                b[SPRINGS + 3, j] = force2[0]
                b[SPRINGS + 4, j] = force2[1]
                b[SPRINGS + 5, j] = force2[2]
        kick = KICKS[s] * step
        drift = DRIFTS[s] * step
        for j in range(lanes):
            a = physics.accelerations_under(
                b[SPRINGS, j], b[SPRINGS + 1, j], b[SPRINGS + 2, j],
                b[SPRINGS + 3, j], b[SPRINGS + 4, j], b[SPRINGS + 5, j],
                b[FORCE, j], b[FORCE + 1, j], b[FORCE + 2, j],
                b[PHYSICS, j], b[PHYSICS + 1, j], b[PHYSICS + 2, j], b[PHYSICS + 3, j], b[PHYSICS + 4, j],
                b[PHYSICS + 9, j], b[PHYSICS + 10, j],
            )  # fmt: skip
            v0 = b[9, j] + kick * a[0]
            v1 = b[10, j] + kick * a[1]
            v2 = b[11, j] + kick * a[2]
            v3 = b[12, j] + kick * a[3]
            v4 = b[13, j] + kick * a[4]
            v5 = b[14, j] + kick * a[5]
            v6 = b[15, j] + kick * a[6]
            v7 = b[16, j] + kick * a[7]
            v8 = b[17, j] + kick * a[8]
            b[9, j] = v0
            b[0, j] += drift * v0
            b[10, j] = v1
            b[1, j] += drift * v1
            b[11, j] = v2
            b[2, j] += drift * v2
            b[12, j] = v3
            b[3, j] += drift * v3
            b[13, j] = v4
            b[4, j] += drift * v4
            b[14, j] = v5
            b[5, j] += drift * v5
            b[15, j] = v6
            b[6, j] += drift * v6
            b[16, j] = v7
            b[7, j] += drift * v7
            b[17, j] = v8
            b[8, j] += drift * v8


@compiled
def _brake(b, lanes, s):
    """What drag does in the drift of stage s, which was made without it."""
    lanes = in_use(b, lanes)
    table = 3 * min(s, STAGES - 2 - s)
    for i in range(9):
        body = i // 3
        for j in range(lanes):
            v = b[9 + i, j]
            share = b[SHARE + table + body, j]
            b[i, j] -= b[SHORT + table + body, j] * v
            b[9 + i, j] = v - share * v
            b[LOST, j] += 0.5 * b[MASSES + body, j] * v * v * share * (2.0 - share)


@compiled
def _guard(b, lanes, step):
    """Those of which a spring is too close to zero length for a step, s, are GUARDED."""
    lanes = in_use(b, lanes)
    for j in range(lanes):
        close1 = integrators.approaches_zero(
            b[3, j] - b[0, j], b[4, j] - b[1, j], b[5, j] - b[2, j],
            b[12, j] - b[9, j], b[13, j] - b[10, j], b[14, j] - b[11, j],
            b[PHYSICS + 5, j], b[PHYSICS + 7, j], step,
        )  # fmt: skip
        close2 = integrators.approaches_zero(
            b[6, j] - b[3, j], b[7, j] - b[4, j], b[8, j] - b[5, j],
            b[15, j] - b[12, j], b[16, j] - b[13, j], b[17, j] - b[14, j],
            b[PHYSICS + 6, j], b[PHYSICS + 8, j], step,
        )  # fmt: skip
        b[GUARDED, j] += 1.0 if close1 | close2 else 0.0  # not "if": stores under a mask are slow


@compiled
def split(b, lanes, refinement, period, known):
    """A period, s, by the symplectic splitting, in steps `refinement` times finer than usual, without drag.

    The pendulums need as many steps. Those of which a spring is too close to zero length before or after a step are
    GUARDED then.

    Args:
        known: whether SPRINGS holds the forces at the state already.
    """
    steps = int(b[STEPS, 0]) * refinement
    step = period / steps
    for n in range(steps):
        _guard(b, lanes, step)
        # The last drift is none, so the forces of the last kick in a step are those of the first in the next.
        _stages(b, lanes, 0, STAGES, step, known or n > 0)
    _guard(b, lanes, step)


@compiled
def split_with_drag(b, lanes, refinement, period):
    """As `split`, with drag, and nothing known; of those without drag the bits are the same. Two functions, since most
    need only one."""
    steps = int(b[STEPS, 0]) * refinement
    step = period / steps
    _drag(b, lanes, step)
    for n in range(steps):
        _guard(b, lanes, step)
        for s in range(STAGES):
            _stages(b, lanes, s, s + 1, step, s == 0 and n > 0)
            if s < STAGES - 1:
                _brake(b, lanes, s)
    _guard(b, lanes, step)


@compiled
def any_drag(b, lanes):
    """Whether there is drag on one of them."""
    lanes = in_use(b, lanes)
    dragged = False
    for j in range(lanes):
        dragged |= b[DRAG, j] + b[DRAG + 1, j] + b[DRAG + 2, j] != 0.0
    return dragged


@compiled
def _drag(b, lanes, step):
    """What drag does in each drift: it takes a SHARE of each body's velocity, and the body falls SHORT of where it
    would have come, s for each m/s. The drifts are symmetric, so half of them say all."""
    lanes = in_use(b, lanes)
    for s in range(HALF):
        drift = DRIFTS[s] * step
        for body in range(3):
            for j in range(lanes):
                rate = b[DRAG + body, j]
                if j > 0 and rate == b[DRAG + body, j - 1]:
                    share = b[SHARE + 3 * s + body, j - 1]
                    short = b[SHORT + 3 * s + body, j - 1]
                else:
                    share = -math.expm1(-rate * drift)
                    short = drift - share / rate if rate != 0.0 else 0.0
                b[SHARE + 3 * s + body, j] = share
                b[SHORT + 3 * s + body, j] = short
