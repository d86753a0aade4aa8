"""The loops of the integration schemes, on a buffer of pendulums side by side.

Integrators.py has the coefficients, physics.py the formulas. In the splitting the loops over pendulums are innermost,
so that root and division vectorise; the adaptive scheme takes one pendulum at a time, since each has its own steps.
"""

from __future__ import annotations

import math

import numpy as np
from numba.misc.special import literally

from spring_pendulum_env import integrators, physics
from spring_pendulum_env.integrators import (
    DRIFTS,
    ERROR_MARGIN,
    GUARD_TOLERANCE,
    KICKS,
    LONGEST_STEP,
    MOST_STEPS,
    RK_E3,
    RK_E5,
    RK_ORDER,
    RK_STAGES,
)
from spring_pendulum_env.jit import compiled, compiled_for_width
from spring_pendulum_env.layout import (
    DRAG,
    FIELDS,
    FINE,
    FORCE,
    FRESH,
    GUARDED,
    HALF,
    LOST,
    MASSES,
    PHYSICS,
    SHARE,
    SHORT,
    SPRINGS,
    STAGES,
    STATUS,
    STEPS,
    TOO_MANY_STEPS,
    UNFINISHED,
)


@compiled_for_width
def _stages(b, width, lanes, first, last, step, known):
    """The stages from `first` on to before `last` of a step, s, without drag.

    Nothing else happens in these loops, so that the compiler can keep a single pendulum's state in registers.

    Args:
        known: whether the forces of the first of them are those of the stage before it.
    """
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
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


@compiled_for_width
def _brake(b, width, lanes, s):
    """What drag does in the drift of stage s, which was made without it."""
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    table = 3 * min(s, STAGES - 2 - s)
    for i in range(9):
        body = i // 3
        for j in range(lanes):
            v = b[9 + i, j]
            share = b[SHARE + table + body, j]
            b[i, j] -= b[SHORT + table + body, j] * v
            b[9 + i, j] = v - share * v
            b[LOST, j] += 0.5 * b[MASSES + body, j] * v * v * share * (2.0 - share)


@compiled_for_width
def split(b, width, lanes, refinement, period):
    """A period, s, by the symplectic splitting, in steps `refinement` times finer than usual.

    The pendulums need as many steps. Those of which a spring is too close to zero length before or after a step are
    GUARDED then.
    """
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    steps = int(b[STEPS, 0]) * refinement
    step = period / steps
    dragged = False
    for j in range(lanes):
        dragged |= b[DRAG, j] + b[DRAG + 1, j] + b[DRAG + 2, j] != 0.0
    if dragged:
        _drag(b, width, lanes, step)
    for n in range(steps + 1):
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
            b[GUARDED, j] = 1.0 if close1 | close2 else b[GUARDED, j]
        if n == steps:
            break
        # The last drift is none, so the forces of the last kick in a step are those of the first in the next.
        if not dragged:
            _stages(b, width, lanes, 0, STAGES, step, n > 0)
            continue
        for s in range(STAGES):
            _stages(b, width, lanes, s, s + 1, step, s == 0 and n > 0)
            if s < STAGES - 1:
                _brake(b, width, lanes, s)


@compiled_for_width
def _drag(b, width, lanes, step):
    """What drag does in each drift: it takes a SHARE of each body's velocity, and the body falls SHORT of where it
    would have come, s for each m/s. The drifts are symmetric, so half of them say all."""
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
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


@compiled
def _slope(y, c, k, s):
    """Derivative of the state y, and the power that drag dissipates, into k[s]; c has the fields before HEIGHTS."""
    d = physics.derivatives(
        y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7], y[8],
        y[9], y[10], y[11], y[12], y[13], y[14], y[15], y[16], y[17],
        c[FORCE], c[FORCE + 1], c[FORCE + 2],
        c[PHYSICS], c[PHYSICS + 1], c[PHYSICS + 2], c[PHYSICS + 3], c[PHYSICS + 4], c[PHYSICS + 5],
        c[PHYSICS + 6], c[PHYSICS + 7], c[PHYSICS + 8], c[PHYSICS + 9], c[PHYSICS + 10],
        c[DRAG], c[DRAG + 1], c[DRAG + 2],
    )  # fmt: skip
    for i in range(18):
        k[s, i] = d[i]
    k[s, 18] = physics.weighted_squares(
        y[9], y[10], y[11], y[12], y[13], y[14], y[15], y[16], y[17],
        c[DRAG] * c[MASSES], c[DRAG + 1] * c[MASSES + 1], c[DRAG + 2] * c[MASSES + 2],
    )  # fmt: skip


@compiled
def _step_error(y, new, k, h, allowed):
    """Estimated error of a Dormand-Prince step from y to new, as a multiple of allowed (1 + |y|) in the component that
    is worst; infinite where it is no number."""
    worst3 = 0.0
    worst5 = 0.0
    for i in range(19):
        error3 = 0.0
        error5 = 0.0
        for r in range(13):
            error3 += RK_E3[r] * k[r, i]
            error5 += RK_E5[r] * k[r, i]
        scale = allowed * (1.0 + max(abs(y[i]), abs(new[i])))
        if not math.isfinite(error3 + error5 + scale):
            return math.inf
        worst3 = max(worst3, abs(error3) / scale)
        worst5 = max(worst5, abs(error5) / scale)
    if worst5 == 0.0:
        return 0.0
    return h * worst5 * worst5 / math.sqrt(worst5 * worst5 + 0.01 * worst3 * worst3)


@compiled
def _adaptive(b, j, period, tolerance):
    """One control period of pendulum j of a buffer by Dormand-Prince 8(5,3); a STATUS if it takes too many steps.

    The error norm is the largest component's, each relative to 1 + |y|. Nothing but the state decides the
    steps, so that a state that is set again is continued with the same bits.
    """
    c = np.empty(FIELDS)
    y = np.empty(19)  # the state, and what drag dissipates
    new = np.empty(19)
    k = np.empty((13, 19))
    for i in range(FIELDS):
        c[i] = b[i, j]
    for i in range(18):
        y[i] = b[i, j]
    y[18] = 0.0
    time = 0.0
    step = period / c[STEPS]
    smallest = 1e-15 * period
    allowed = ERROR_MARGIN * tolerance
    rejected = False
    status = TOO_MANY_STEPS
    begin = 0  # the first stage's slope is the last one's of the step before
    for _ in range(MOST_STEPS):
        last = time + step >= period * (1.0 - 1e-14)
        h = period - time if last else step
        for s in range(begin, 13):
            for i in range(19):
                change = 0.0
                for r in range(s):
                    change += RK_STAGES[s, r] * k[r, i]
                new[i] = y[i] + h * change
            _slope(new, c, k, s)
        begin = 1
        error = _step_error(y, new, k, h, allowed)
        factor = 10.0 if error == 0.0 else min(10.0, max(0.2, 0.9 * error ** (-1.0 / RK_ORDER)))
        if error < 1.0 or h <= smallest:
            time += h
            for i in range(19):
                y[i] = new[i]
                k[0, i] = k[12, i]
            if last:
                status = FINE
                break
            step = min(h * (min(1.0, factor) if rejected else factor), LONGEST_STEP)
            rejected = False
        else:
            step = max(h * min(0.9, factor), smallest)
            rejected = True
    for i in range(18):
        b[i, j] = y[i]
    b[LOST, j] = y[18]
    b[STATUS, j] = status


@compiled
def adapt(b, lanes, period, tolerance):
    """A period, s, of each pendulum by the adaptive scheme; without a tolerance, by that of the guard.

    After one that takes TOO_MANY_STEPS the others are left UNFINISHED: a million tries are enough for one call.
    """
    given_up = False
    for j in range(lanes):
        if b[FRESH, j] != 0.0:
            continue
        if given_up:
            b[STATUS, j] = UNFINISHED
        else:
            _adaptive(b, j, period, GUARD_TOLERANCE if tolerance == 0.0 else tolerance)
            given_up = b[STATUS, j] == TOO_MANY_STEPS
