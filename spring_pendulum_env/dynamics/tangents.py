"""The motion of the passive pendulum and of a tiny displacement from it, compiled. It holds no formula of its own.

`physics.accelerations` runs here on dual numbers: a value, and the rate at which it changes along a displacement of the
state. So one evaluation gives the acceleration and its exact directional derivative, and a step of the splitting
carries the displacement by the exact derivative of that step: its tangent map, symplectic as the step is.
(Complex-step derivatives give the same numbers, but a complex root is a call into the mathematics library: 25 times
slower, measured.)

The duals and the steps stand in one file since numba's cache only notices edits in the file of a compiled function and,
by the folder that jit.py chooses, in those that it names.
"""

from __future__ import annotations

import operator
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, make_attribute_wrapper, models, overload, register_model

from spring_pendulum_env import physics
from spring_pendulum_env.integrators import KICKS, approaches_zero
from spring_pendulum_env.jit import cache_folder

STAGES = len(KICKS)
LEVELS = 22
"""Where a spring is too close to zero length for a step, the step is done again in halves, and these in halves where
they are too long still, down to the level before this number: 2 million times shorter. (Halves take half the time that
eighths take, the environments' refinement, with the same errors of the energy.)"""

WIDTH = 64
"""Motions that are stepped together."""

FINE, TOO_CLOSE = 0, 1
"""What `advance` returns: all is well, or a spring passes through zero length, where the force has no derivative."""

_NUMPY_ERRORS: Any = {"error_model": "numpy"}  # division by zero gives inf or nan; else no loop would vectorise


class DualType(types.Type):
    """A number and its rate of change along a displacement, within compiled code."""

    def __init__(self) -> None:
        super().__init__(name="Dual")


_dual_type = DualType()


@register_model(DualType)
class _DualModel(models.StructModel):
    def __init__(self, manager, dual):
        super().__init__(manager, dual, [("value", types.float64), ("rate", types.float64)])


make_attribute_wrapper(DualType, "value", "value")
make_attribute_wrapper(DualType, "rate", "rate")


def _dual(_context, _value, _rate):
    """The dual number of a value and its rate."""

    def build(context, builder, _signature, arguments):
        number = cgutils.create_struct_proxy(_dual_type)(context, builder)
        number.value, number.rate = arguments
        return number._getvalue()

    return _dual_type(types.float64, types.float64), build


dual: Any = intrinsic(_dual)


def _rule(operation, of_duals, of_dual_and_number, of_number_and_dual):
    """Teaches numba an operation on duals, and on a dual and a plain number."""

    @overload(operation, jit_options=_NUMPY_ERRORS)
    def choose(a, b):
        return {
            (True, True): of_duals,
            (True, False): of_dual_and_number,
            (False, True): of_number_and_dual,
        }.get((isinstance(a, DualType), isinstance(b, DualType)))


def _quotient(a, b):
    """A plain number over a dual."""
    ratio = a / b.value
    return dual(ratio, -ratio * b.rate / b.value)


def _power(a, b):
    """A dual to the power of a number; its rate at 0, where a root has none, is 0, as the spring's force is there."""
    power = a.value**b
    return dual(power, b * power / (a.value + (a.value == 0.0)) * a.rate)


_rule(
    operator.add,
    lambda a, b: dual(a.value + b.value, a.rate + b.rate),
    lambda a, b: dual(a.value + b, a.rate),
    lambda a, b: dual(a + b.value, b.rate),
)
_rule(
    operator.sub,
    lambda a, b: dual(a.value - b.value, a.rate - b.rate),
    lambda a, b: dual(a.value - b, a.rate),
    lambda a, b: dual(a - b.value, -b.rate),
)
_rule(
    operator.mul,
    lambda a, b: dual(a.value * b.value, a.rate * b.value + a.value * b.rate),
    lambda a, b: dual(a.value * b, a.rate * b),
    lambda a, b: dual(a * b.value, a * b.rate),
)
_rule(operator.truediv, None, None, _quotient)
_rule(operator.pow, None, _power, None)
_rule(operator.eq, None, lambda a, b: a.value == b, None)


def _compiled(function):
    """What `advance` calls; compiled with it and cached with it."""
    return numba.njit(error_model="numpy", nogil=True)(function)


# Forced into the loop: as a call it would keep the loop from vectorising, which makes it four times faster.
# (Importing `jit` is what lets numba compile the functions of physics.py that this one calls.)
_accelerations = numba.njit(error_model="numpy", forceinline=True)(physics.accelerations)


@_compiled
def _step(points, new, first, last, constants, scheme):
    """One step of the motions from `first` to before `last` (WIDTH at most), from `points` to `new`."""
    w1, w2, k1, k2, L1, L2, g = constants
    b = np.empty((24, WIDTH))  # of constant shape: between its rows the compiler knows the distance, so it vectorises
    count = last - first
    for i in range(24):
        for j in range(count):
            b[i, j] = points[i, first + j]
    for s in range(STAGES):
        kick = scheme[s, 0]
        move1 = scheme[s, 1]
        keep1 = scheme[s, 2]
        move2 = scheme[s, 3]
        keep2 = scheme[s, 4]
        for j in range(count):
            a = _accelerations(
                0.0, 0.0, 0.0,
                dual(b[0, j], b[12, j]), dual(b[1, j], b[13, j]), dual(b[2, j], b[14, j]),
                dual(b[3, j], b[15, j]), dual(b[4, j], b[16, j]), dual(b[5, j], b[17, j]),
                0.0, 0.0, 0.0, 0.0, 0.0, 0.0, w1, w2, k1, k2, L1, L2, g, 0.0,
            )  # fmt: skip
            v0 = b[6, j] + kick * a[3].value
            v1 = b[7, j] + kick * a[4].value
            v2 = b[8, j] + kick * a[5].value
            v3 = b[9, j] + kick * a[6].value
            v4 = b[10, j] + kick * a[7].value
            v5 = b[11, j] + kick * a[8].value
            r0 = b[18, j] + kick * a[3].rate
            r1 = b[19, j] + kick * a[4].rate
            r2 = b[20, j] + kick * a[5].rate
            r3 = b[21, j] + kick * a[6].rate
            r4 = b[22, j] + kick * a[7].rate
            r5 = b[23, j] + kick * a[8].rate
            b[0, j] += move1 * v0
            b[1, j] += move1 * v1
            b[2, j] += move1 * v2
            b[3, j] += move2 * v3
            b[4, j] += move2 * v4
            b[5, j] += move2 * v5
            b[6, j] = keep1 * v0
            b[7, j] = keep1 * v1
            b[8, j] = keep1 * v2
            b[9, j] = keep2 * v3
            b[10, j] = keep2 * v4
            b[11, j] = keep2 * v5
            b[12, j] += move1 * r0
            b[13, j] += move1 * r1
            b[14, j] += move1 * r2
            b[15, j] += move2 * r3
            b[16, j] += move2 * r4
            b[17, j] += move2 * r5
            b[18, j] = keep1 * r0
            b[19, j] = keep1 * r1
            b[20, j] = keep1 * r2
            b[21, j] = keep2 * r3
            b[22, j] = keep2 * r4
            b[23, j] = keep2 * r5
    for i in range(24):
        for j in range(count):
            new[i, first + j] = b[i, j]


@_compiled
def _close(points, j, constants, step):
    """Whether in motion j a spring is too close to zero length for a step of this length."""
    _, _, k1, k2, L1, L2, _ = constants
    p = points
    close1 = approaches_zero(p[0, j], p[1, j], p[2, j], p[6, j], p[7, j], p[8, j], k1, L1, step)
    close2 = approaches_zero(
        p[3, j] - p[0, j], p[4, j] - p[1, j], p[5, j] - p[2, j],
        p[9, j] - p[6, j], p[10, j] - p[7, j], p[11, j] - p[8, j],
        k2, L2, step,
    )  # fmt: skip
    return close1 | close2


@_compiled
def _step_finely(points, new, j, constants, schemes, step):
    """One step of motion j by smaller ones, as small as each place asks for; TOO_CLOSE where none is small enough."""
    here = np.empty((24, 1))
    there = np.empty((24, 1))
    for i in range(24):
        here[i, 0] = points[i, j]
    whole = 2 ** (LEVELS - 1)
    done = 0
    level = 1
    only = np.int64(0)  # of a plain 0 or 1 numba would compile what is handed it a second time
    while done < whole:
        size = 2 ** (LEVELS - 1 - level)
        _step(here, there, only, only + 1, constants, schemes[level])
        short = step * size / whole
        if _close(here, only, constants, short) | _close(there, only, constants, short):
            if level == LEVELS - 1:
                return TOO_CLOSE
            level += 1
            continue
        for i in range(24):
            here[i, 0] = there[i, 0]
        done += size
        while level > 1 and done % (size * 2) == 0:
            level -= 1
            size *= 2
    for i in range(24):
        new[i, j] = here[i, 0]
    return FINE


def _advance(points, constants, schemes, step, steps, record):
    """Moves states and their displacements by `steps` steps, in place.

    Args:
        points: shape (24, n): in each column a state of 12 numbers (m, m/s) and a displacement of 12.
        constants: seven floats, as CONSTANTS names them.
        schemes: shape (LEVELS, STAGES, 5), for the step and the ever smaller ones: the length of each stage's kick;
            for each mass the time for which it drifts with its velocity, and the share of that which drag leaves.
        step: length of a step, s.
        steps: how many.
        record: shape (steps, 24, n), or (0, 24, n) for none: what stands in `points` after each step, written.

    Returns:
        FINE or TOO_CLOSE.
    """
    count = points.shape[1]
    new = np.empty_like(points)
    close = np.zeros(count, dtype=np.bool_)
    for j in range(count):
        close[j] = _close(points, j, constants, step)
    for number in range(steps):
        for first in range(np.int64(0), count, WIDTH):
            _step(points, new, first, min(first + WIDTH, count), constants, schemes[0])
        for j in range(count):
            closes = _close(new, j, constants, step)
            if closes | close[j]:
                if _step_finely(points, new, j, constants, schemes, step) == TOO_CLOSE:
                    return TOO_CLOSE
                closes = _close(new, j, constants, step)
            close[j] = closes
        for i in range(24):
            for j in range(count):
                points[i, j] = new[i, j]
        if len(record) > 0:
            for i in range(24):
                for j in range(count):
                    record[number, i, j] = new[i, j]
    return FINE


with cache_folder() as _cached:
    advance = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_advance)
