"""The compiled step, for one pendulum and for many, by the adaptive scheme."""

from __future__ import annotations

import math

import numpy as np

from spring_pendulum_env.jit import compiled_entry
from spring_pendulum_env.kernels.batch import is_block
from spring_pendulum_env.kernels.dormand_prince import adapt
from spring_pendulum_env.kernels.lanes import floats_at, keep, many_in, numbers_from, one_at
from spring_pendulum_env.kernels.report import prepare, report, settle
from spring_pendulum_env.kernels.rows import addresses, load, set_again, store
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
    pendulums, axes = actions.shape
    size = observations.shape[1]
    kept, chosen = numbers_from(rows, 0), numbers_from(wanted, 0)
    asked, common = numbers_from(actions, 0), numbers_from(settings, 0)
    told = addresses(observations, outcomes, forces, rewards, terminated, truncated, ended)
    buffer, places = np.empty((BUFFER, WIDTH)), np.empty(WIDTH, dtype=np.int64)
    b, indices = many_in(buffer), numbers_from(places, 0)
    limit = common[TIME_LIMIT]
    worst = FINE
    for begin in range(0, wanted.size, WIDTH):
        count = min(WIDTH, wanted.size - begin)
        for j in range(WIDTH):
            indices[j] = chosen[begin + min(j, count - 1)]
        lanes = (count + 3) & -4
        whole = is_block(indices)
        load(kept, indices, lanes, whole, FIELDS, common, axes, asked, b)
        prepare(b, lanes)
        adapt(b, count, common[PERIOD], common[TOLERANCE])
        for j in range(count, lanes):
            for i in range(BUFFER):
                b[i, j] = b[i, count - 1]
        settle(b, lanes)
        set_again(kept, indices, lanes, b)
        report(b, lanes, common)
        store(kept, indices, lanes, whole, b, limit, size, pendulums, told)
        for j in range(count):
            if b[STATUS, j] != UNFINISHED:
                worst = max(worst, int(b[STATUS, j]))
        if worst == TOO_MANY_STEPS:
            break
    keep(buffer)
    keep(places)
    return worst


advance_adaptively = compiled_entry(_advance_adaptively)
step_batch_adaptively = compiled_entry(_step_batch_adaptively)
