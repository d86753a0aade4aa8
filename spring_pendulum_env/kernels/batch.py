"""The compiled step of many pendulums, which live in blocks (see layout.py), by the splitting.

Places of a block that nobody uses are filled with another pendulum, so that no loop has a remainder. Arrays are handed
on as the addresses of their numbers: of an array compiled code counts at every call who uses it, and looks at every
access whether the index is counted from the end.
"""

from __future__ import annotations

import numpy as np

from spring_pendulum_env.integrators import FINEST, REFINEMENT
from spring_pendulum_env.jit import compiled, compiled_entry
from spring_pendulum_env.kernels.lanes import block_of, keep, many_in, numbers_from
from spring_pendulum_env.kernels.report import prepare, report, settle
from spring_pendulum_env.kernels.rows import addresses, load, load_constants, set_again, start, store
from spring_pendulum_env.kernels.splitting import any_drag, split, split_with_drag
from spring_pendulum_env.layout import (
    ALIKE,
    BUFFER,
    CHUNK,
    FIELDS,
    FINE,
    GUARDED,
    PERIOD,
    STATUS,
    STEPS,
    TIME_LIMIT,
    UNFINISHED,
    WIDTH,
)


@compiled
def is_block(indices):
    """Whether WIDTH pendulums are those of a block in their order, which are copied fast."""
    first = indices[0]
    same = first % WIDTH == 0
    for j in range(WIDTH):
        same &= indices[j] == first + j
    return same


@compiled
def _take(rows, alike, queue, done, waiting, indices):
    """The next pendulums of a queue that can be done together, those that need as many steps.

    Args:
        alike: whether all of them do.
        queue: of pendulums; those from `done` on to before `waiting` are left, and change places.
        indices: WIDTH of them, written: which pendulums; beyond their number the first one again.

    Returns:
        How many; whether they are a block in its order.
    """
    next_ones = numbers_from(queue, done)
    first = next_ones[0]
    block = block_of(rows, first // WIDTH)
    steps = block[STEPS, first % WIDTH]
    if done + WIDTH <= waiting and is_block(next_ones):
        whole = True
        if not alike:
            for j in range(WIDTH):
                whole &= block[STEPS, j] == steps
        if whole:
            for j in range(WIDTH):
                indices[j] = next_ones[j]
            return WIDTH, True
    count = 0
    for n in range(done, waiting):
        index = queue[n]
        if alike or block_of(rows, index // WIDTH)[STEPS, index % WIDTH] == steps:
            queue[n] = queue[done + count]
            queue[done + count] = index
            indices[count] = index
            count += 1
            if count == WIDTH:
                break
    for j in range(count, WIDTH):
        indices[j] = indices[0]
    return count, False


@compiled
def _requeue(b, lanes, count, finest, queue, again, indices):
    """Puts those that were GUARDED back into the queue, or leaves them UNFINISHED.

    Args:
        finest: whether there is no finer step for them.
        again: how many there are in the queue, written from its front on.

    Returns:
        How many there are then.
    """
    for j in range(lanes):
        if b[GUARDED, j] != 0.0:
            b[STATUS, j] = UNFINISHED if finest else FINE
            if j < count:
                queue[again] = indices[j]
                again += 1
    return again


def _place(rows, wanted, usual, numbers, taken):
    """Gives pendulums that are as usual the next of their starts.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), written.
        wanted: which pendulums, shape (n,).
        usual: shape (FIELDS + START_NUMBERS,): the fields of each with its mean start, then the standard deviations.
        numbers, taken: as `starts.Starts` has them; one more is taken of each.
    """
    kept, fields = numbers_from(rows, 0), numbers_from(usual, 0)
    drawn, number = numbers_from(numbers, 0), numbers_from(taken, 0)
    for index in wanted:
        start(kept, index, fields, drawn, numbers.shape[1], number)


def _step_batch(
    rows, wanted, ended, usual, numbers, taken,
    settings, actions, observations, outcomes, forces, rewards, terminated, truncated,
):  # fmt: skip
    """One control period of many pendulums by the splitting, and their reports.

    Those that were just placed are only reported; those that are UNFINISHED haven't changed.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), read and written.
        wanted: which pendulums, shape (n,).
        ended: which of all are to be placed first, as `place` does, and which have ended then; shape (pendulums,).
        usual, numbers, taken: as those of `place`.
        settings: shape (SETTINGS,).
        actions: shape (pendulums, actuated axes), finite.
        observations: shape (pendulums, 12 or 18), written.
        outcomes: shape (OUTCOMES, pendulums), written: what a step reports.
        forces: shape (pendulums, 3), written.
        rewards, terminated, truncated: shape (pendulums,), written.

    Returns:
        The largest STATUS; whether no start is left to one of those that were placed.
    """
    pendulums, axes = actions.shape
    size, ahead = observations.shape[1], numbers.shape[1]
    kept, chosen, over = numbers_from(rows, 0), numbers_from(wanted, 0), numbers_from(ended, 0)
    asked, common = numbers_from(actions, 0), numbers_from(settings, 0)
    told = addresses(observations, outcomes, forces, rewards, terminated, truncated, ended)
    emptied = False
    for n in range(wanted.size):
        if over[chosen[n]]:
            fields, drawn = numbers_from(usual, 0), numbers_from(numbers, 0)
            emptied |= start(kept, chosen[n], fields, drawn, ahead, numbers_from(taken, 0))
            over[chosen[n]] = False
    buffer, places, line = np.empty((BUFFER, WIDTH)), np.empty(WIDTH, dtype=np.int64), np.empty(CHUNK, dtype=np.int64)
    b, indices, queue = many_in(buffer), numbers_from(places, 0), numbers_from(line, 0)
    period, limit = common[PERIOD], common[TIME_LIMIT]
    alike = common[ALIKE] != 0.0
    fields = STATUS if alike else FIELDS  # beyond that only what stays the same is needed
    dragged = False
    if alike and wanted.size > 0:
        load_constants(kept, chosen[0], b)
        dragged = any_drag(b, WIDTH)
    worst = FINE
    for begin in range(0, wanted.size, CHUNK):
        waiting = min(CHUNK, wanted.size - begin)
        for n in range(waiting):
            queue[n] = chosen[begin + n]
        refinement = np.int64(1)
        while waiting > 0:
            again = 0  # those that were guarded go back to the front of the queue, to be done finer
            done = np.int64(0)
            while done < waiting:
                count, whole = _take(kept, alike, queue, done, waiting, indices)
                done += count
                lanes = (count + 3) & -4
                load(kept, indices, lanes, whole, fields, common, axes, asked, b)
                prepare(b, lanes)
                if dragged or (not alike and any_drag(b, lanes)):
                    split_with_drag(b, lanes, refinement, period)
                else:
                    split(b, lanes, refinement, period, False)
                stayed, guarded = settle(b, lanes)
                if stayed:
                    set_again(kept, indices, lanes, b)
                report(b, lanes, common)
                wrong = False
                for j in range(lanes):
                    wrong |= b[STATUS, j] != FINE
                if guarded:
                    finest = refinement == FINEST
                    wrong |= finest
                    again = _requeue(b, lanes, count, finest, queue, again, indices)
                if wrong:
                    for j in range(count):
                        worst = max(worst, int(b[STATUS, j]))
                store(kept, indices, lanes, whole, b, limit, size, pendulums, told)
            refinement *= REFINEMENT
            waiting = again if refinement <= FINEST else 0
    keep(buffer)
    keep(places)
    keep(line)
    return worst, emptied


def _take_finite(numbers, kept):
    """Keeps numbers as float64; whether all of them are finite. In a fraction of the time of NumPy's functions.

    Args:
        numbers: of any float type, one after the other in memory.
        kept: of the same shape, written.
    """
    given, taken = numbers_from(numbers, 0), numbers_from(kept, 0)
    finite = True
    for n in range(kept.size):
        number = np.float64(given[n])
        taken[n] = number
        finite &= number - number == 0.0
    return finite


take_finite = compiled_entry(_take_finite, nogil=False)
place = compiled_entry(_place, nogil=False)
step_batch = compiled_entry(_step_batch)
