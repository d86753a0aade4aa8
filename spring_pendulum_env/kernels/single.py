"""The compiled step of a single pendulum, which lives in a cell (see layout.py), by the splitting."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from spring_pendulum_env import tasks
from spring_pendulum_env.equilibria import BODY_STATE
from spring_pendulum_env.integrators import FINEST, REFINEMENT
from spring_pendulum_env.jit import DISABLED, compiled, compiled_entry
from spring_pendulum_env.kernels.lanes import floats_at, one_at
from spring_pendulum_env.kernels.report import prepare, report, settle
from spring_pendulum_env.kernels.splitting import split, split_with_drag
from spring_pendulum_env.layout import (
    BAD_ACTION,
    CELL_SETTINGS,
    DISPLACED,
    ENDED,
    ENERGY,
    ERROR,
    EXCESS,
    FORCE,
    FRESH,
    GUARDED,
    KEPT,
    KNOWN,
    LOST_TO_DRAG,
    MAX_FORCE,
    MOVED,
    NOISE,
    PERIOD,
    REWARD,
    SPREAD,
    STATUS,
    TERMS,
    TIME,
    UNFINISHED,
    WORK_DONE,
)
from spring_pendulum_env.scenario import START_NUMBERS

SETTINGS_AT = 8.0 * CELL_SETTINGS
"""Where the settings begin in a cell, bytes."""


@compiled
def enter(b, x, y, z):
    """The force of the action, none for a pendulum that was just placed, which may have to be displaced; keeps the
    state."""
    if b[FRESH, 0] == DISPLACED:
        for i in range(START_NUMBERS):
            place = BODY_STATE[i]
            b[place, 0] = tasks.displaced(b[place, 0], b[SPREAD + i, 0], b[NOISE + i, 0])
        b[FRESH, 0] = 1.0
    if b[FRESH, 0] != 0.0:
        b[KNOWN, 0] = 0.0
    scale = b[CELL_SETTINGS + MAX_FORCE, 0] if b[FRESH, 0] == 0.0 else 0.0
    b[FORCE, 0] = scale * min(max(x, -1.0), 1.0)
    b[FORCE + 1, 0] = scale * min(max(y, -1.0), 1.0)
    b[FORCE + 2, 0] = scale * min(max(z, -1.0), 1.0)
    for i in range(18):
        b[KEPT + i, 0] = b[i, 0]


@compiled
def told(b, status):
    """What the environment tells of a step; a STATUS of another type than int64 would have it compiled once more."""
    return (
        status,
        b[TIME, 0],
        b[ENERGY, 0],
        b[EXCESS, 0],
        b[ERROR, 0],
        b[WORK_DONE, 0],
        b[LOST_TO_DRAG, 0],
        b[REWARD, 0],
        b[ENDED, 0] != 0.0,
        b[TERMS, 0],
        b[TERMS + 1, 0],
        b[TERMS + 2, 0],
        b[TERMS + 3, 0],
        b[TERMS + 4, 0],
    )


@compiled
def set_back(b):
    """The state before the step, at which no forces are known."""
    b[KNOWN, 0] = 0.0
    for i in range(18):
        b[i, 0] = b[KEPT + i, 0]


@compiled
def leave(b, settings):
    """Ends a step: the state of one that hasn't moved, and what is told.

    Args:
        settings: those of the cell, from its first on.
    """
    if b[MOVED, 0] == 0.0:
        set_back(b)
    report(b, np.int64(1), settings)
    return told(b, np.int64(b[STATUS, 0]))


@compiled
def period(b):
    """A control period without drag, in steps as fine as it needs; whether it came to an end. If not, it is left to the
    adaptive scheme, and the state is as before."""
    one = np.int64(1)  # of a plain 1 numba would compile what is handed it a second time
    refinement = one
    while refinement <= FINEST:
        prepare(b, one)
        split(b, one, refinement, b[CELL_SETTINGS + PERIOD, 0], b[KNOWN, 0] != 0.0)
        settle(b, one)
        if b[GUARDED, 0] == 0.0:
            b[KNOWN, 0] = b[MOVED, 0]
            return True
        set_back(b)
        refinement *= REFINEMENT
    return False


@compiled
def period_with_drag(b):
    """As `period`, with drag. It repeats its lines: numba can't cache a function that is handed the scheme."""
    one = np.int64(1)
    refinement = one
    while refinement <= FINEST:
        prepare(b, one)
        split_with_drag(b, one, refinement, b[CELL_SETTINGS + PERIOD, 0])
        settle(b, one)
        if b[GUARDED, 0] == 0.0:
            return True
        set_back(b)
        refinement *= REFINEMENT
    return False


def _advance(address, x, y, z):
    """One control period of a single pendulum under the action (x, y, z), in units of max_force, by the splitting.

    One that was just placed is only reported. The pendulum's state is as before where the STATUS is BAD_ACTION (the
    action isn't finite) or UNFINISHED. Any drag is left out.

    Args:
        address: of a cell, in which the step works, as a float: that is handed over in a fraction of the time that an
            array takes.

    Returns:
        STATUS; time, energy, excess energy, energy error, work, dissipated; reward, whether it ended; the reward terms.
    """
    b = one_at(address)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return told(b, np.int64(BAD_ACTION))
    enter(b, x, y, z)
    if period(b):
        return leave(b, floats_at(address + SETTINGS_AT))
    return told(b, np.int64(UNFINISHED))


def _advance_with_drag(address, x, y, z):
    """As `_advance`, with drag."""
    b = one_at(address)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return told(b, np.int64(BAD_ACTION))
    enter(b, x, y, z)
    if period_with_drag(b):
        return leave(b, floats_at(address + SETTINGS_AT))
    return told(b, np.int64(UNFINISHED))


# Too short for letting go of Python's lock to pay.
advance = compiled_entry(_advance, nogil=False)
advance_with_drag = compiled_entry(_advance_with_drag, nogil=False)


def _in_python(function: Any, address: float, *action: Any) -> Any:
    """What a compiled call does to its arguments and results, where nothing is compiled."""
    told = function(address, *map(float, action))
    return tuple(part.item() if isinstance(part, np.generic) else part for part in told)


Told = tuple[int, float, float, float, float, float, float, float, bool, float, float, float, float, float]
Advance = Callable[[float, float, float, float], Told]


def entry(function: Any) -> Advance:
    """One of the compiled steps without numba's look at its arguments' types, a good part of a short call.

    Numbers are converted to float as Python's `float` does.

    Raises (the function that is returned):
        TypeError, ValueError: an action isn't three numbers.
    """
    if DISABLED:
        return lambda address, x, y, z: _in_python(function, address, x, y, z)
    signature = (numba.float64, numba.float64, numba.float64, numba.float64)
    function.compile(signature)
    result: Advance = function.overloads[signature].entry_point
    return result
