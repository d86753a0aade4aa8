"""The adaptive scheme: Dormand-Prince 8(5,3), the explicit Runge-Kutta pair of Hairer, Norsett and Wanner, "Solving
Ordinary Differential Equations I", section II.10. The coefficients are SciPy's.

It takes one pendulum at a time, since each has its own steps. It is a module of its own since importing the
coefficients takes longer than all that the splitting needs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from spring_pendulum_env import physics
from spring_pendulum_env.integrators import ERROR_MARGIN, GUARD_TOLERANCE, LONGEST_STEP, MOST_STEPS
from spring_pendulum_env.jit import compiled
from spring_pendulum_env.layout import (
    DRAG,
    FIELDS,
    FINE,
    FORCE,
    FRESH,
    LOST,
    MASSES,
    PHYSICS,
    STATUS,
    STEPS,
    TOO_MANY_STEPS,
    UNFINISHED,
)

RK_STAGES: NDArray[np.float64] = np.vstack([DOP853.A, DOP853.B])
"""Row s holds the weights of the slopes before stage s; the last stage is the new state itself."""

RK_E3: NDArray[np.float64] = np.ascontiguousarray(DOP853.E3)
RK_E5: NDArray[np.float64] = np.ascontiguousarray(DOP853.E5)
RK_ORDER = 8


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
