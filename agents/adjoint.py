"""One control period of many pendulums, and its gradient: the environments' step, and the same step taken backwards.

An algorithm that learns by gradients through the motion needs, for a step x -> x', the product of a row vector with the
step's Jacobian. The splitting is a chain of kicks and drifts, so its adjoint is the chain of their adjoints in reverse
order. The only derivative in it is that of a spring's force by the spring's vector, a symmetric matrix; so its product
with a row vector is the force's directional derivative, which `physics.spring_force` itself gives on dual numbers, as
in `spring_pendulum_env.dynamics.tangents`. It holds no formula of its own.

The step is the environments' splitting, without their guard: where a spring comes close to zero length the numbers are
less exact, which is of no account in training.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.dynamics.tangents import dual
from spring_pendulum_env.integrators import DRIFTS, KICKS
from spring_pendulum_env.jit import cache_folder

STAGES = len(KICKS)
WIDTH = 64
"""Pendulums that are stepped together."""

CONSTANTS = 11
"""Numbers of `Parameters.constants()`: inverse masses (anchor by axis, m1, m2), k1, k2, L1, L2, g, static load."""

# Forced into the loops: as calls they would keep them from vectorising.
_spring_force = numba.njit(error_model="numpy", forceinline=True)(physics.spring_force)
_accelerations_under = numba.njit(error_model="numpy", forceinline=True)(physics.accelerations_under)


def schedule(period: float, steps: int, drag_rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each stage of a step does, shape (STAGES, 7, n), for drag rates (n, 3) of the three bodies, 1/s.

    The length of the kick, s; then for each body the time for which it drifts with its velocity, s, and the share of
    that which drag leaves. `steps` equal steps make up the `period`, s.
    """
    step = period / steps
    table = np.empty((STAGES, 7, len(drag_rates)))
    for stage in range(STAGES):
        drift = DRIFTS[stage] * step
        table[stage, 0] = KICKS[stage] * step
        for body in range(3):
            rate = drag_rates[:, body]
            lost = -np.expm1(-rate * drift)
            table[stage, 1 + body] = np.where(rate != 0, lost / np.where(rate != 0, rate, 1.0), drift)
            table[stage, 4 + body] = 1.0 - lost
    return table


def _compiled(function: Any) -> Any:
    return numba.njit(error_model="numpy", nogil=True)(function)


@_compiled
def _load(b, c, t, states, forces, constants, table, first, count):
    for j in range(count):
        for i in range(18):
            b[i, j] = states[first + j, i]
        for i in range(3):
            b[18 + i, j] = forces[first + j, i]
        for i in range(11):
            c[i, j] = constants[first + j, i]
    for s in range(STAGES):
        for i in range(7):
            for j in range(count):
                t[s, i, j] = table[s, i, first + j]


@_compiled
def _stage(b, c, t, s, count):
    """Kick and drift of stage s."""
    for j in range(count):
        f1x, f1y, f1z = _spring_force(b[3, j] - b[0, j], b[4, j] - b[1, j], b[5, j] - b[2, j], c[5, j], c[7, j])
        f2x, f2y, f2z = _spring_force(b[6, j] - b[3, j], b[7, j] - b[4, j], b[8, j] - b[5, j], c[6, j], c[8, j])
        a = _accelerations_under(
            f1x, f1y, f1z, f2x, f2y, f2z, b[18, j], b[19, j], b[20, j],
            c[0, j], c[1, j], c[2, j], c[3, j], c[4, j], c[9, j], c[10, j],
        )  # fmt: skip
        kick = t[s, 0, j]
        v0 = b[9, j] + kick * a[0]
        v1 = b[10, j] + kick * a[1]
        v2 = b[11, j] + kick * a[2]
        v3 = b[12, j] + kick * a[3]
        v4 = b[13, j] + kick * a[4]
        v5 = b[14, j] + kick * a[5]
        v6 = b[15, j] + kick * a[6]
        v7 = b[16, j] + kick * a[7]
        v8 = b[17, j] + kick * a[8]
        b[0, j] += t[s, 1, j] * v0
        b[1, j] += t[s, 1, j] * v1
        b[2, j] += t[s, 1, j] * v2
        b[3, j] += t[s, 2, j] * v3
        b[4, j] += t[s, 2, j] * v4
        b[5, j] += t[s, 2, j] * v5
        b[6, j] += t[s, 3, j] * v6
        b[7, j] += t[s, 3, j] * v7
        b[8, j] += t[s, 3, j] * v8
        b[9, j] = t[s, 4, j] * v0
        b[10, j] = t[s, 4, j] * v1
        b[11, j] = t[s, 4, j] * v2
        b[12, j] = t[s, 5, j] * v3
        b[13, j] = t[s, 5, j] * v4
        b[14, j] = t[s, 5, j] * v5
        b[15, j] = t[s, 6, j] * v6
        b[16, j] = t[s, 6, j] * v7
        b[17, j] = t[s, 6, j] * v8


@_compiled
def _stage_back(g, springs, c, t, s, count):
    """The adjoint of stage s: g holds the gradient by the state after it, and becomes that by the state before."""
    for i in range(9):
        for j in range(count):
            g[9 + i, j] = t[s, 1 + i // 3, j] * g[i, j] + t[s, 4 + i // 3, j] * g[9 + i, j]
    for j in range(count):
        kick = t[s, 0, j]
        # The kicks' gradients by the forces of the springs ...
        p0 = kick * c[0, j] * g[9, j]
        p1 = kick * c[1, j] * g[10, j]
        p2 = kick * c[2, j] * g[11, j]
        p3 = kick * c[3, j] * g[12, j]
        p4 = kick * c[3, j] * g[13, j]
        p5 = kick * c[3, j] * g[14, j]
        # ... and by their vectors.
        r1 = _spring_force(
            dual(springs[0, j], p3 - p0), dual(springs[1, j], p4 - p1), dual(springs[2, j], p5 - p2), c[5, j], c[7, j]
        )
        r2 = _spring_force(
            dual(springs[3, j], kick * c[4, j] * g[15, j] - p3),
            dual(springs[4, j], kick * c[4, j] * g[16, j] - p4),
            dual(springs[5, j], kick * c[4, j] * g[17, j] - p5),
            c[6, j], c[8, j],
        )  # fmt: skip
        g[18, j] += p0
        g[19, j] += p1
        g[20, j] += p2
        g[0, j] -= r1[0].rate
        g[1, j] -= r1[1].rate
        g[2, j] -= r1[2].rate
        g[3, j] += r1[0].rate - r2[0].rate
        g[4, j] += r1[1].rate - r2[1].rate
        g[5, j] += r1[2].rate - r2[2].rate
        g[6, j] += r2[0].rate
        g[7, j] += r2[1].rate
        g[8, j] += r2[2].rate


def _forward(states, forces, constants, table, steps, new):
    """States (n, 18) under forces (n, 3), N, one control period on, into `new` (n, 18).

    Args:
        constants: shape (n, CONSTANTS).
        table: `schedule`.
        steps: in a control period.
    """
    b = np.empty((21, WIDTH))
    c = np.empty((11, WIDTH))
    t = np.empty((STAGES, 7, WIDTH))
    for first in range(0, states.shape[0], WIDTH):
        count = min(WIDTH, states.shape[0] - first)
        _load(b, c, t, states, forces, constants, table, first, count)
        for _ in range(steps):
            for s in range(STAGES):
                _stage(b, c, t, s, count)
        for j in range(count):
            for i in range(18):
                new[first + j, i] = b[i, j]


def _backward(states, forces, constants, table, steps, gradients, by_states, by_forces):
    """The adjoint of `_forward`: from gradients (n, 18) by what it gave to those by what it took.

    Args:
        by_states, by_forces: shapes (n, 18) and (n, 3), written.
    """
    b = np.empty((21, WIDTH))
    c = np.empty((11, WIDTH))
    t = np.empty((STAGES, 7, WIDTH))
    g = np.empty((21, WIDTH))
    springs = np.empty((steps * STAGES, 6, WIDTH))
    for first in range(0, states.shape[0], WIDTH):
        count = min(WIDTH, states.shape[0] - first)
        _load(b, c, t, states, forces, constants, table, first, count)
        for n in range(steps):
            for s in range(STAGES):
                for i in range(6):
                    for j in range(count):
                        springs[n * STAGES + s, i, j] = b[3 + i, j] - b[i, j]
                _stage(b, c, t, s, count)
        for j in range(count):
            for i in range(18):
                g[i, j] = gradients[first + j, i]
            g[18, j] = 0.0
            g[19, j] = 0.0
            g[20, j] = 0.0
        for n in range(steps * STAGES - 1, -1, -1):
            _stage_back(g, springs[n], c, t, n % STAGES, count)
        for j in range(count):
            for i in range(18):
                by_states[first + j, i] = g[i, j]
            for i in range(3):
                by_forces[first + j, i] = g[18 + i, j]


with cache_folder() as _cached:
    forward = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_forward)
    backward = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_backward)
