"""The compiled step, for one pendulum and for many. It holds no formula of its own.

Both run the same functions on a local buffer of constant shape with the pendulums side by side, one or WIDTH of them:
the loops over pendulums are innermost, and root and division vectorise (where there is one pendulum, the loops
vanish). Without any fastmath flag the arithmetic is IEEE's in either case, so that a pendulum gets the same bits alone
and among others. Places that nobody uses are filled with another pendulum, so that no loop has a remainder.

Each comes in two forms, by the splitting and by the adaptive scheme, so that whoever uses one of them needn't wait for
the other to be compiled; what the splitting can't do is UNFINISHED after it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba.misc.special import literally

from spring_pendulum_env import physics, tasks
from spring_pendulum_env.equilibria import BODY_STATE
from spring_pendulum_env.integrators import FINEST, REFINEMENT
from spring_pendulum_env.jit import DISABLED, cache_folder, carray, compiled, compiled_for_width, floats_at
from spring_pendulum_env.layout import (
    ALIKE,
    AXIS_COUNT,
    AXIS_SLOTS,
    BAD_ACTION,
    BEFORE,
    BUFFER,
    CELL,
    CELL_SETTINGS,
    CENTRING_SCALE,
    CHUNK,
    CLOCK,
    DEVIATION,
    DISSIPATED,
    ENDED,
    ENERGY,
    ENERGY_SCALE,
    ERROR,
    EXCESS,
    FIELDS,
    FINE,
    FORCE,
    FRESH,
    GUARDED,
    HEIGHTS,
    KEPT,
    LOST,
    LOST_TO_DRAG,
    MASSES,
    MAX_FORCE,
    MOVED,
    NOT_FINITE,
    OUTCOMES,
    PERIOD,
    PHYSICS,
    POSTURE_SCALE,
    REST_ENERGY,
    REWARD,
    START_ENERGY,
    STATUS,
    STEPS,
    TERMS,
    TIME,
    TIME_LIMIT,
    TOLERANCE,
    TOO_MANY_STEPS,
    TRAVEL,
    UNFINISHED,
    VELOCITY_SCALE,
    WEIGHTS,
    WIDTH,
    WORK,
    WORK_DONE,
)
from spring_pendulum_env.scenario import START_NUMBERS
from spring_pendulum_env.schemes import adapt, split


@compiled_for_width
def _begin(b, width, lanes):
    """Before a step."""
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    for j in range(lanes):
        b[BEFORE, j] = b[0, j]
        b[BEFORE + 1, j] = b[1, j]
        b[BEFORE + 2, j] = b[2, j]
        b[GUARDED, j] = 0.0
        b[LOST, j] = 0.0
        b[STATUS, j] = FINE


@compiled_for_width
def _settle(b, width, lanes):
    """After a step: which pendulums have MOVED. The others must be set again."""
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    for j in range(lanes):
        total = (
            b[0, j] + b[1, j] + b[2, j] + b[3, j] + b[4, j] + b[5, j] + b[6, j] + b[7, j] + b[8, j]
            + b[9, j] + b[10, j] + b[11, j] + b[12, j] + b[13, j] + b[14, j] + b[15, j] + b[16, j] + b[17, j]
        )  # fmt: skip
        finite = total - total == 0.0
        fresh = b[FRESH, j] != 0.0
        guarded = (b[GUARDED, j] != 0.0) & (not fresh)
        wrong = (not finite) & (not fresh) & (not guarded) & (b[STATUS, j] == FINE)
        status = NOT_FINITE if wrong else b[STATUS, j]
        moved = (not fresh) & (not guarded) & (status == FINE)
        b[GUARDED, j] = 1.0 if guarded else 0.0
        b[STATUS, j] = status
        b[MOVED, j] = 1.0 if moved else 0.0
        b[LOST, j] = b[LOST, j] if moved else 0.0


@compiled_for_width
def _report(b, width, lanes, settings):
    """Books work, dissipation and time; energies, reward and end, from the state."""
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    limit = settings[DEVIATION] * settings[DEVIATION]
    travel = settings[TRAVEL]
    period = settings[PERIOD]
    force_scale = 1.0 / (max(settings[AXIS_COUNT], 1.0) * settings[MAX_FORCE] * settings[MAX_FORCE])
    energy_scale = settings[ENERGY_SCALE]
    posture_scale = settings[POSTURE_SCALE]
    velocity_scale = settings[VELOCITY_SCALE]
    centring_scale = settings[CENTRING_SCALE]
    weight0 = settings[WEIGHTS]
    weight1 = settings[WEIGHTS + 1]
    weight2 = settings[WEIGHTS + 2]
    weight3 = settings[WEIGHTS + 3]
    weight4 = settings[WEIGHTS + 4]
    for j in range(lanes):
        work = b[WORK, j]
        work += b[FORCE, j] * (b[0, j] - b[BEFORE, j])
        work += b[FORCE + 1, j] * (b[1, j] - b[BEFORE + 1, j])
        work += b[FORCE + 2, j] * (b[2, j] - b[BEFORE + 2, j])
        dissipated = b[DISSIPATED, j] + b[LOST, j]
        clock = b[CLOCK, j] + b[MOVED, j]
        b[WORK, j] = work
        b[WORK_DONE, j] = work
        b[DISSIPATED, j] = dissipated
        b[LOST_TO_DRAG, j] = dissipated
        b[CLOCK, j] = clock
        b[TIME, j] = clock * period
        energy = physics.total_energy(
            b[0, j], b[1, j], b[2, j], b[3, j], b[4, j], b[5, j], b[6, j], b[7, j], b[8, j],
            b[9, j], b[10, j], b[11, j], b[12, j], b[13, j], b[14, j], b[15, j], b[16, j], b[17, j],
            b[MASSES, j], b[MASSES + 1, j], b[MASSES + 2, j],
            b[PHYSICS + 5, j], b[PHYSICS + 6, j], b[PHYSICS + 7, j], b[PHYSICS + 8, j], b[PHYSICS + 9, j],
        )  # fmt: skip
        start = energy if clock == 0.0 else b[START_ENERGY, j]
        b[START_ENERGY, j] = start
        b[ENERGY, j] = energy
        b[EXCESS, j] = energy - b[REST_ENERGY, j]
        b[ERROR, j] = physics.energy_error(energy - start - work + dissipated, start)
        b[STATUS, j] = NOT_FINITE if energy - energy != 0.0 else b[STATUS, j]
    for j in range(lanes):
        # How far each mass is from its place relative to the anchor.
        x1 = b[3, j] - b[0, j]
        y1 = b[4, j] - b[1, j]
        z1 = b[5, j] - b[2, j] - b[HEIGHTS, j]
        x2 = b[6, j] - b[0, j]
        y2 = b[7, j] - b[1, j]
        z2 = b[8, j] - b[2, j] - b[HEIGHTS, j] - b[HEIGHTS + 1, j]
        away1 = x1 * x1 + y1 * y1 + z1 * z1
        away2 = x2 * x2 + y2 * y2 + z2 * z2
        beyond = (abs(b[0, j]) > travel) | (abs(b[1, j]) > travel) | (abs(b[2, j]) > travel)
        b[ENDED, j] = 1.0 if beyond | (away1 > limit) | (away2 > limit) else 0.0
        terms = tasks.reward_terms(
            b[EXCESS, j],
            away1 + (x2 - x1) * (x2 - x1) + (y2 - y1) * (y2 - y1) + (z2 - z1) * (z2 - z1),
            physics.weighted_squares(
                b[9, j], b[10, j], b[11, j], b[12, j], b[13, j], b[14, j], b[15, j], b[16, j], b[17, j], 1.0, 1.0, 1.0
            ),
            b[0, j] * b[0, j] + b[1, j] * b[1, j] + b[2, j] * b[2, j],
            (b[FORCE, j] * b[FORCE, j] + b[FORCE + 1, j] * b[FORCE + 1, j] + b[FORCE + 2, j] * b[FORCE + 2, j])
            * force_scale,
            energy_scale,
            posture_scale,
            velocity_scale,
            centring_scale,
        )
        term0 = weight0 * terms[0]
        term1 = weight1 * terms[1]
        term2 = weight2 * terms[2]
        term3 = weight3 * terms[3]
        term4 = weight4 * terms[4]
        b[TERMS, j] = term0
        b[TERMS + 1, j] = term1
        b[TERMS + 2, j] = term2
        b[TERMS + 3, j] = term3
        b[TERMS + 4, j] = term4
        b[REWARD, j] = min(max(term0 + term1 + term2 + term3 + term4, 0.0), 1.0)
        b[FRESH, j] = 0.0


@compiled
def _enter(b, x, y, z):
    """The force of the action, none for a pendulum that was just placed; keeps the state."""
    scale = b[CELL_SETTINGS + MAX_FORCE, 0] if b[FRESH, 0] == 0.0 else 0.0
    b[FORCE, 0] = scale * min(max(x, -1.0), 1.0)
    b[FORCE + 1, 0] = scale * min(max(y, -1.0), 1.0)
    b[FORCE + 2, 0] = scale * min(max(z, -1.0), 1.0)
    for i in range(18):
        b[KEPT + i, 0] = b[i, 0]


@compiled
def _told(b, status):
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
def _leave(b, settings):
    """Ends a step: the state of one that hasn't moved, and what is told."""
    if b[MOVED, 0] == 0.0:
        for i in range(18):
            b[i, 0] = b[KEPT + i, 0]
    _report(b, 1, np.int64(1), settings)
    return _told(b, np.int64(b[STATUS, 0]))


def _advance(address, x, y, z):
    """One control period of a single pendulum under the action (x, y, z), in units of max_force, by the splitting.

    One that was just placed is only reported. The pendulum's state is as before where the STATUS is BAD_ACTION (the
    action isn't finite) or UNFINISHED.

    Args:
        address: of a cell, in which the step works, as a float: that is handed over in a fraction of the time that an
            array takes.

    Returns:
        STATUS; time, energy, excess energy, energy error, work, dissipated; reward, whether it ended; the reward terms.
    """
    cell = carray(floats_at(address), (CELL,))
    b = carray(floats_at(address), (CELL, 1))
    if not math.isfinite(x + y + z):
        return _told(b, np.int64(BAD_ACTION))
    one = np.int64(1)  # of a plain 1 numba would compile what is handed it a second time
    refinement = one
    _enter(b, x, y, z)
    while refinement <= FINEST:
        _begin(b, 1, one)
        split(b, 1, one, refinement, b[CELL_SETTINGS + PERIOD, 0])
        _settle(b, 1, one)
        if b[GUARDED, 0] == 0.0:
            return _leave(b, cell[CELL_SETTINGS:])
        for i in range(18):
            b[i, 0] = b[KEPT + i, 0]
        refinement *= REFINEMENT
    return _told(b, np.int64(UNFINISHED))


def _advance_adaptively(address, x, y, z):
    """As `_advance`, by the adaptive scheme; never UNFINISHED."""
    cell = carray(floats_at(address), (CELL,))
    b = carray(floats_at(address), (CELL, 1))
    if not math.isfinite(x + y + z):
        return _told(b, np.int64(BAD_ACTION))
    one = np.int64(1)
    _enter(b, x, y, z)
    _begin(b, 1, one)
    adapt(b, one, b[CELL_SETTINGS + PERIOD, 0], b[CELL_SETTINGS + TOLERANCE, 0])
    _settle(b, 1, one)
    return _leave(b, cell[CELL_SETTINGS:])


@compiled
def _take(rows, alike, queue, done, waiting, indices):
    """The next pendulums of a queue that can be done together, those that need as many steps: how many.

    Args:
        alike: whether all of them do.
        queue: of pendulums; those from `done` on to before `waiting` are left, and change places.
        indices: shape (WIDTH,), written: which pendulums; beyond their number the first one again.
    """
    block = queue[done] // WIDTH
    steps = rows[block, STEPS, queue[done] % WIDTH]
    if done + WIDTH <= waiting:
        whole = True
        for j in range(WIDTH):
            whole &= (queue[done + j] == block * WIDTH + j) & (alike | (rows[block, STEPS, j] == steps))
        if whole:
            for j in range(WIDTH):
                indices[j] = queue[done + j]
            return WIDTH
    count = 0
    for n in range(done, waiting):
        index = queue[n]
        if alike or rows[index // WIDTH, STEPS, index % WIDTH] == steps:
            queue[n] = queue[done + count]
            queue[done + count] = index
            indices[count] = index
            count += 1
            if count == WIDTH:
                break
    for j in range(count, WIDTH):
        indices[j] = indices[0]
    return count


@compiled
def _is_block(indices):
    """Whether they are the pendulums of a block in their order, which are copied fast."""
    same = indices[0] % WIDTH == 0
    for j in range(WIDTH):
        same &= indices[j] == indices[0] + j
    return same


@compiled
def _load_constants(rows, index, b):
    """Into the buffer, the constants of one pendulum for all."""
    for i in range(PHYSICS, FIELDS):
        for j in range(WIDTH):
            b[i, j] = rows[index // WIDTH, i, index % WIDTH]


@compiled
def _load(rows, indices, lanes, fields, settings, actions, b):
    """Into the buffer: so many fields, and the force of the action, none for those that were just placed."""
    if b.shape[1] != WIDTH:
        return
    if _is_block(indices):
        whole = rows[indices[0] // WIDTH].reshape(FIELDS * WIDTH)
        flat = b.reshape(b.size)
        for n in range(fields * WIDTH):
            flat[n] = whole[n]
    else:
        for j in range(lanes):
            for i in range(fields):
                b[i, j] = rows[indices[j] // WIDTH, i, indices[j] % WIDTH]
    for i in range(3):
        slot = int(settings[AXIS_SLOTS + i])
        for j in range(lanes):
            action = actions[indices[j], slot] if slot >= 0 else 0.0
            b[FORCE + i, j] = settings[MAX_FORCE] * min(max(action, -1.0), 1.0) if b[FRESH, j] == 0.0 else 0.0


@compiled
def _store(rows, indices, lanes, b, limit, observations, outcomes, forces, rewards, terminated, truncated):
    """From the buffer: what a step changed, and what it reports."""
    if b.shape[1] != WIDTH:
        return
    if _is_block(indices):
        whole = rows[indices[0] // WIDTH].reshape(FIELDS * WIDTH)
        flat = b.reshape(b.size)
        for n in range(PHYSICS * WIDTH):
            whole[n] = flat[n]
        for i in range(OUTCOMES):
            outcome = outcomes[i, indices[0] : indices[0] + WIDTH]
            for j in range(WIDTH):
                outcome[j] = b[FIELDS + i, j]
    else:
        for j in range(lanes):
            for i in range(PHYSICS):
                rows[indices[j] // WIDTH, i, indices[j] % WIDTH] = b[i, j]
            for i in range(OUTCOMES):
                outcomes[i, indices[j]] = b[FIELDS + i, j]
    # Loops of constant length, which are fast: all numbers of the state, or those of the two masses.
    if observations.shape[1] == 18:
        for j in range(lanes):
            observation = observations[indices[j]]
            for i in range(18):
                observation[i] = b[i, j]
    else:
        for j in range(lanes):
            observation = observations[indices[j]]
            for i in range(6):
                observation[i] = b[3 + i, j]
                observation[6 + i] = b[12 + i, j]
    for j in range(lanes):
        force = forces[indices[j]]
        for i in range(3):
            force[i] = b[FORCE + i, j]
    # A pendulum that was just placed has made no step: no reward, and no end.
    for j in range(lanes):
        moved = b[MOVED, j] != 0.0
        rewards[indices[j]] = b[REWARD, j] if moved else 0.0
        terminated[indices[j]] = moved & (b[ENDED, j] != 0.0)
        truncated[indices[j]] = moved & (b[CLOCK, j] >= limit)


@compiled
def _set_again(rows, indices, lanes, b):
    """The states of those that haven't moved."""
    stayed = False
    for j in range(lanes):
        stayed |= b[MOVED, j] == 0.0
    if stayed:
        for j in range(lanes):
            if b[MOVED, j] == 0.0:
                for i in range(18):
                    b[i, j] = rows[indices[j] // WIDTH, i, indices[j] % WIDTH]


def _place(rows, wanted, template, rest, spread, numbers, taken):
    """Gives pendulums that are as usual the next of their starts.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), written.
        wanted: which pendulums, shape (n,).
        template: `layout.template` of them all, shape (FIELDS,).
        rest, spread: the start's means, shape (18,), and standard deviations, shape (START_NUMBERS,).
        numbers, taken: as `starts.Starts` has them; one more is taken of each.
    """
    for index in wanted:
        row = rows[index // WIDTH]
        j = index % WIDTH
        for i in range(FIELDS):
            row[i, j] = template[i]
        for i in range(18):
            row[i, j] = rest[i]
        for i in range(START_NUMBERS):
            place = BODY_STATE[i]
            row[place, j] = tasks.displaced(rest[place], spread[i], numbers[index, taken[index], i])
        taken[index] += 1


def _step_batch(rows, wanted, settings, actions, observations, outcomes, forces, rewards, terminated, truncated):
    """One control period of many pendulums by the splitting, and their reports. Returns the largest STATUS.

    Those that were just placed are only reported; those that are UNFINISHED haven't changed.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), read and written.
        wanted: which pendulums, shape (n,).
        settings: shape (SETTINGS,).
        actions: shape (pendulums, actuated axes), finite.
        observations: shape (pendulums, 12 or 18), written.
        outcomes: shape (OUTCOMES, pendulums), written: what a step reports.
        forces: shape (pendulums, 3), written.
        rewards, terminated, truncated: shape (pendulums,), written.
    """
    b = np.empty((BUFFER, WIDTH))
    indices = np.empty(WIDTH, dtype=np.int64)
    limit = settings[TIME_LIMIT]
    alike = settings[ALIKE] != 0.0
    fields = PHYSICS if alike else FIELDS
    if alike and wanted.size > 0:
        _load_constants(rows, wanted[0], b)
    queue = np.empty(CHUNK, dtype=np.int64)
    worst = FINE
    for begin in range(0, wanted.size, CHUNK):
        waiting = min(CHUNK, wanted.size - begin)
        for n in range(waiting):
            queue[n] = wanted[begin + n]
        refinement = np.int64(1)
        while waiting > 0:
            again = 0  # those that were guarded go back to the front of the queue, to be done finer
            done = np.int64(0)
            while done < waiting:
                count = _take(rows, alike, queue, done, waiting, indices)
                done += count
                lanes = (count + 7) & -8
                _load(rows, indices, lanes, fields, settings, actions, b)
                _begin(b, WIDTH, lanes)
                split(b, WIDTH, lanes, refinement, settings[PERIOD])
                _settle(b, WIDTH, lanes)
                _set_again(rows, indices, lanes, b)
                _report(b, WIDTH, lanes, settings)
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
                _store(rows, indices, lanes, b, limit, observations, outcomes, forces, rewards, terminated, truncated)
            refinement *= REFINEMENT
            waiting = again if refinement <= FINEST else 0
    return worst


def _step_batch_adaptively(
    rows, wanted, settings, actions, observations, outcomes, forces, rewards, terminated, truncated
):
    """As `_step_batch`, by the adaptive scheme; after TOO_MANY_STEPS of one, the others are as they were."""
    b = np.empty((BUFFER, WIDTH))
    indices = np.empty(WIDTH, dtype=np.int64)
    limit = settings[TIME_LIMIT]
    worst = FINE
    for begin in range(0, wanted.size, WIDTH):
        count = min(WIDTH, wanted.size - begin)
        for j in range(WIDTH):
            indices[j] = wanted[begin + min(j, count - 1)]
        lanes = (count + 7) & -8
        _load(rows, indices, lanes, FIELDS, settings, actions, b)
        _begin(b, WIDTH, lanes)
        adapt(b, count, settings[PERIOD], settings[TOLERANCE])
        for j in range(count, lanes):
            for i in range(BUFFER):
                b[i, j] = b[i, count - 1]
        _settle(b, WIDTH, lanes)
        _set_again(rows, indices, lanes, b)
        _report(b, WIDTH, lanes, settings)
        _store(rows, indices, lanes, b, limit, observations, outcomes, forces, rewards, terminated, truncated)
        for j in range(count):
            if b[STATUS, j] != UNFINISHED:
                worst = max(worst, int(b[STATUS, j]))
        if worst == TOO_MANY_STEPS:
            break
    return worst


with cache_folder() as _cached:
    # A single pendulum's step is too short for letting go of Python's lock to pay.
    advance = numba.njit(error_model="numpy", cache=_cached)(_advance)
    advance_adaptively = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_advance_adaptively)
    place = numba.njit(error_model="numpy", cache=_cached)(_place)
    step_batch = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_step_batch)
    step_batch_adaptively = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_step_batch_adaptively)


def _in_python(function: Any, address: float, *action: Any) -> Any:
    """What a compiled call does to its arguments and results, where nothing is compiled."""
    told = function(address, *map(float, action))
    return tuple(part.item() if isinstance(part, np.generic) else part for part in told)


Told = tuple[int, float, float, float, float, float, float, float, bool, float, float, float, float, float]
Advance = Callable[[float, float, float, float], Told]


def entry(function: Any) -> Advance:
    """`advance` or `advance_adaptively` without numba's look at its arguments' types, a good part of a short call.

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
