"""The compiled step of many pendulums, which live in blocks (see layout.py), by the splitting.

Places of a block that nobody uses are filled with another pendulum, so that no loop has a remainder.
"""

from __future__ import annotations

import numpy as np

from spring_pendulum_env import tasks
from spring_pendulum_env.equilibria import BODY_STATE
from spring_pendulum_env.integrators import FINEST, REFINEMENT
from spring_pendulum_env.jit import compiled, compiled_entry
from spring_pendulum_env.kernels.lanes import block_of, flat, in_use, keep, many_in, numbers_from, put_side_by_side
from spring_pendulum_env.kernels.report import any_stayed, prepare, report, settle
from spring_pendulum_env.kernels.splitting import any_drag, split, split_with_drag
from spring_pendulum_env.layout import (
    ALIKE,
    AXIS_SLOTS,
    BUFFER,
    CHUNK,
    CLOCK,
    ENDED,
    FIELDS,
    FINE,
    FORCE,
    FRESH,
    GUARDED,
    MAX_FORCE,
    MOVED,
    OUTCOMES,
    PERIOD,
    PHYSICS,
    REWARD,
    STATUS,
    STEPS,
    TIME_LIMIT,
    UNFINISHED,
    WIDTH,
)
from spring_pendulum_env.scenario import START_NUMBERS


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
        indices: shape (WIDTH,), written: which pendulums; beyond their number the first one again.

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
def _load_constants(rows, index, b):
    """Into the buffer, the constants of one pendulum for all."""
    block = block_of(rows, index // WIDTH)
    for i in range(PHYSICS, FIELDS):
        for j in range(WIDTH):
            b[i, j] = block[i, index % WIDTH]


@compiled
def load(rows, indices, lanes, whole, fields, settings, actions, b):
    """Into the buffer: so many fields, and the force of the action, none for those that were just placed.

    Args:
        whole: whether the pendulums are a block in its order.
    """
    lanes = in_use(b, lanes)
    axes = actions.shape[1]
    if whole:
        first = indices[0]
        copy, original = flat(b), flat(block_of(rows, first // WIDTH))
        for n in range(fields * lanes):
            copy[n] = original[n]
        taken = numbers_from(actions, axes * first)
        if axes == 3:  # in one loop, for which the compiler has a fast way
            for j in range(lanes):
                b[FORCE, j] = taken[3 * j]
                b[FORCE + 1, j] = taken[3 * j + 1]
                b[FORCE + 2, j] = taken[3 * j + 2]
        else:
            for i in range(3):
                slot = int(settings[AXIS_SLOTS + i])
                for j in range(lanes):
                    b[FORCE + i, j] = taken[axes * j + slot] if slot >= 0 else 0.0
    else:
        for j in range(lanes):
            index = indices[j]
            block = block_of(rows, index // WIDTH)
            for i in range(fields):
                b[i, j] = block[i, index % WIDTH]
            for i in range(3):
                slot = int(settings[AXIS_SLOTS + i])
                b[FORCE + i, j] = numbers_from(actions, axes * index + slot)[0] if slot >= 0 else 0.0
    most = settings[MAX_FORCE]
    for i in range(3):
        for j in range(lanes):
            force = most * min(max(b[FORCE + i, j], -1.0), 1.0)
            b[FORCE + i, j] = force if b[FRESH, j] == 0.0 else 0.0


@compiled
def _store_block(rows, first, lanes, b, limit, ended, observations, outcomes, forces, rewards, terminated, truncated):
    """As `store`, of the block that begins with the pendulum `first`."""
    lanes = in_use(b, lanes)
    copy, original = flat(b), flat(block_of(rows, first // WIDTH))
    for n in range(PHYSICS * lanes):
        original[n] = copy[n]
    for i in range(OUTCOMES):
        outcome = numbers_from(outcomes, i * outcomes.shape[1] + first)
        for j in range(lanes):
            outcome[j] = b[FIELDS + i, j]
    force = numbers_from(forces, 3 * first)
    for j in range(lanes):
        force[3 * j] = b[FORCE, j]
        force[3 * j + 1] = b[FORCE + 1, j]
        force[3 * j + 2] = b[FORCE + 2, j]
    size = observations.shape[1]
    for j in range(0, lanes, 4):
        if size == 18:
            for i in (0, 4, 8, 12, 14):
                at = numbers_from(observations, 18 * (first + j) + i)
                put_side_by_side(b, (i, i + 1, i + 2, i + 3), j, at, 18)
        else:
            put_side_by_side(b, (3, 4, 5, 6), j, numbers_from(observations, 12 * (first + j)), 12)
            put_side_by_side(b, (7, 8, 12, 13), j, numbers_from(observations, 12 * (first + j) + 4), 12)
            put_side_by_side(b, (14, 15, 16, 17), j, numbers_from(observations, 12 * (first + j) + 8), 12)
    earned = numbers_from(rewards, first)
    last = ended[first : first + WIDTH]
    over = terminated[first : first + WIDTH]
    late = truncated[first : first + WIDTH]
    for j in range(lanes):
        moved = b[MOVED, j] != 0.0
        reward = b[REWARD, j]
        earned[j] = reward if moved else 0.0
    for j in range(lanes):
        moved = b[MOVED, j] != 0.0
        done = moved & (b[ENDED, j] != 0.0)
        out_of_time = moved & (b[CLOCK, j] >= limit)
        over[j] = done
        late[j] = out_of_time
        last[j] = done | out_of_time


@compiled
def store(rows, indices, lanes, whole, b, limit, ended, observations, outcomes, forces, rewards, terminated, truncated):
    """From the buffer: what a step changed, and what it reports. A pendulum that was just placed has made no step: it
    gets no reward, and doesn't end."""
    if whole:
        _store_block(
            rows, indices[0], lanes, b, limit, ended, observations, outcomes, forces, rewards, terminated, truncated
        )
        return
    size = observations.shape[1]
    for j in range(lanes):
        index = indices[j]
        block = block_of(rows, index // WIDTH)
        for i in range(PHYSICS):
            block[i, index % WIDTH] = b[i, j]
        outcome = numbers_from(outcomes, index)
        for i in range(OUTCOMES):
            outcome[i * outcomes.shape[1]] = b[FIELDS + i, j]
        force = numbers_from(forces, 3 * index)
        for i in range(3):
            force[i] = b[FORCE + i, j]
        observation = numbers_from(observations, size * index)
        if size == 18:
            for i in range(18):
                observation[i] = b[i, j]
        else:
            for i in range(6):
                observation[i] = b[3 + i, j]
                observation[6 + i] = b[12 + i, j]
        moved = b[MOVED, j] != 0.0
        rewards[index] = b[REWARD, j] if moved else 0.0
        terminated[index] = moved & (b[ENDED, j] != 0.0)
        truncated[index] = moved & (b[CLOCK, j] >= limit)
        ended[index] = terminated[index] | truncated[index]


@compiled
def set_again(rows, indices, lanes, b):
    """The states of those that haven't moved."""
    for j in range(lanes):
        if b[MOVED, j] == 0.0:
            block = block_of(rows, indices[j] // WIDTH)
            for i in range(18):
                b[i, j] = block[i, indices[j] % WIDTH]


@compiled
def _start(rows, index, usual, numbers, taken):
    """Gives a pendulum that is as usual the next of its starts; whether that was the last of those that were drawn."""
    row = rows[index // WIDTH]
    j = index % WIDTH
    for i in range(FIELDS):
        row[i, j] = usual[i]
    for i in range(START_NUMBERS):
        place = BODY_STATE[i]
        row[place, j] = tasks.displaced(usual[place], usual[FIELDS + i], numbers[index, taken[index], i])
    taken[index] += 1
    return taken[index] == numbers.shape[1]


def _place(rows, wanted, usual, numbers, taken):
    """Gives pendulums that are as usual the next of their starts.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), written.
        wanted: which pendulums, shape (n,).
        usual: shape (FIELDS + START_NUMBERS,): the fields of each with its mean start, then the standard deviations.
        numbers, taken: as `starts.Starts` has them; one more is taken of each.
    """
    for index in wanted:
        _start(rows, index, usual, numbers, taken)


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
    emptied = False
    for index in wanted:
        if ended[index]:
            emptied |= _start(rows, index, usual, numbers, taken)
            ended[index] = False
    buffer = np.empty((BUFFER, WIDTH))  # compiled code aligns it better than NumPy would
    b = many_in(buffer)
    indices = np.empty(WIDTH, dtype=np.int64)
    limit = settings[TIME_LIMIT]
    alike = settings[ALIKE] != 0.0
    fields = STATUS if alike else FIELDS  # beyond that only what stays the same is needed
    if alike and wanted.size > 0:
        _load_constants(rows, wanted[0], b)
    queue = np.empty(CHUNK, dtype=np.int64)
    worst = FINE
    for begin in range(0, wanted.size, CHUNK):
        waiting = min(CHUNK, wanted.size - begin)
        here = numbers_from(wanted, begin)
        for n in range(waiting):
            queue[n] = here[n]
        refinement = np.int64(1)
        while waiting > 0:
            again = 0  # those that were guarded go back to the front of the queue, to be done finer
            done = np.int64(0)
            while done < waiting:
                count, whole = _take(rows, alike, queue, done, waiting, indices)
                done += count
                lanes = (count + 3) & -4
                load(rows, indices, lanes, whole, fields, settings, actions, b)
                prepare(b, lanes)
                if any_drag(b, lanes):
                    split_with_drag(b, lanes, refinement, settings[PERIOD])
                else:
                    split(b, lanes, refinement, settings[PERIOD])
                settle(b, lanes)
                if any_stayed(b, lanes):
                    set_again(rows, indices, lanes, b)
                report(b, lanes, settings)
                guarded = False
                wrong = False
                for j in range(lanes):
                    guarded |= b[GUARDED, j] != 0.0
                    wrong |= b[STATUS, j] != FINE
                if guarded:
                    wrong |= refinement == FINEST
                    for j in range(lanes):
                        if b[GUARDED, j] != 0.0:
                            b[STATUS, j] = UNFINISHED if refinement == FINEST else FINE
                            if j < count:
                                queue[again] = indices[j]
                                again += 1
                if wrong:
                    for j in range(count):
                        worst = max(worst, int(b[STATUS, j]))
                store(
                    rows, indices, lanes, whole, b, limit, ended,
                    observations, outcomes, forces, rewards, terminated, truncated,
                )  # fmt: skip
            refinement *= REFINEMENT
            waiting = again if refinement <= FINEST else 0
    keep(buffer)
    return worst, emptied


def _take_finite(numbers, kept):
    """Keeps numbers as float64; whether all of them are finite. In a fraction of the time of NumPy's functions.

    Args:
        numbers: of any float type.
        kept: of the same shape, written.
    """
    each = numbers.ravel()
    given, taken = numbers_from(each, 0), numbers_from(kept, 0)
    finite = True
    for n in range(kept.size):
        number = np.float64(given[n])
        taken[n] = number
        finite &= number - number == 0.0
    keep(each)
    return finite


take_finite = compiled_entry(_take_finite, nogil=False)
place = compiled_entry(_place, nogil=False)
step_batch = compiled_entry(_step_batch)
