"""The compiled step, for one pendulum and for many, by the adaptive scheme."""

from __future__ import annotations

import math

import numpy as np

from spring_pendulum_env.jit import compiled_entry
from spring_pendulum_env.kernels.batch import is_block, load, set_again, store
from spring_pendulum_env.kernels.dormand_prince import adapt
from spring_pendulum_env.kernels.lanes import floats_at, keep, many_in, one_at
from spring_pendulum_env.kernels.report import prepare, report, settle
from spring_pendulum_env.kernels.single import SETTINGS_AT, enter, leave, told
from spring_pendulum_env.layout import (
    BAD_ACTION,
    BUFFER,
    CELL_SETTINGS,
    FIELDS,
    FINE,
    PERIOD,
    STATUS,
    TIME_LIMIT,
    TOLERANCE,
    TOO_MANY_STEPS,
    UNFINISHED,
    WIDTH,
)


def _advance_adaptively(address, x, y, z):
    """As `_advance`, by the adaptive scheme; never UNFINISHED."""
    b = one_at(address)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return told(b, np.int64(BAD_ACTION))
    one = np.int64(1)
    enter(b, x, y, z)
    prepare(b, one)
    adapt(b, one, b[CELL_SETTINGS + PERIOD, 0], b[CELL_SETTINGS + TOLERANCE, 0])
    settle(b, one)
    return leave(b, floats_at(address + SETTINGS_AT))


def _step_batch_adaptively(
    rows, wanted, ended, settings, actions, observations, outcomes, forces, rewards, terminated, truncated
):
    """As `_step_batch`, by the adaptive scheme; after TOO_MANY_STEPS of one, the others are as they were."""
    buffer = np.empty((BUFFER, WIDTH))
    b = many_in(buffer)
    indices = np.empty(WIDTH, dtype=np.int64)
    limit = settings[TIME_LIMIT]
    worst = FINE
    for begin in range(0, wanted.size, WIDTH):
        count = min(WIDTH, wanted.size - begin)
        for j in range(WIDTH):
            indices[j] = wanted[begin + min(j, count - 1)]
        lanes = (count + 3) & -4
        whole = is_block(indices)
        load(rows, indices, lanes, whole, FIELDS, settings, actions, b)
        prepare(b, lanes)
        adapt(b, count, settings[PERIOD], settings[TOLERANCE])
        for j in range(count, lanes):
            for i in range(BUFFER):
                b[i, j] = b[i, count - 1]
        settle(b, lanes)
        set_again(rows, indices, lanes, b)
        report(b, lanes, settings)
        store(
            rows, indices, lanes, whole, b, limit, ended, observations, outcomes, forces, rewards, terminated, truncated
        )
        for j in range(count):
            if b[STATUS, j] != UNFINISHED:
                worst = max(worst, int(b[STATUS, j]))
        if worst == TOO_MANY_STEPS:
            break
    keep(buffer)
    return worst


advance_adaptively = compiled_entry(_advance_adaptively)
step_batch_adaptively = compiled_entry(_step_batch_adaptively)
