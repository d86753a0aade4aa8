"""Where pendulums are kept between steps: how they get into the lanes in which a step works, and out of them."""

from __future__ import annotations

from spring_pendulum_env import tasks
from spring_pendulum_env.equilibria import BODY_STATE
from spring_pendulum_env.jit import compiled
from spring_pendulum_env.kernels.lanes import block_of, flat, in_use, numbers_from, put_side_by_side
from spring_pendulum_env.layout import (
    AXIS_SLOTS,
    CLOCK,
    ENDED,
    FIELDS,
    FORCE,
    FRESH,
    MAX_FORCE,
    MOVED,
    OUTCOMES,
    PHYSICS,
    REWARD,
    WIDTH,
)
from spring_pendulum_env.scenario import START_NUMBERS


@compiled
def start(rows, index, usual, numbers, ahead, taken):
    """Gives a pendulum that is as usual the next of its starts; whether that was the last of those that were drawn.

    Args:
        ahead: how many starts of each are drawn at once.
    """
    block = block_of(rows, index // WIDTH)
    j = index % WIDTH
    number = taken[index]
    for i in range(FIELDS):
        block[i, j] = usual[i]
    for i in range(START_NUMBERS):
        place = BODY_STATE[i]
        noise = numbers[(index * ahead + number) * START_NUMBERS + i]
        block[place, j] = tasks.displaced(usual[place], usual[FIELDS + i], noise)
    taken[index] = number + 1
    return number + 1 == ahead


@compiled
def load_constants(rows, index, b):
    """Into the lanes, the constants of one pendulum for all."""
    block = block_of(rows, index // WIDTH)
    for i in range(PHYSICS, FIELDS):
        for j in range(WIDTH):
            b[i, j] = block[i, index % WIDTH]


@compiled
def load(rows, indices, lanes, whole, fields, settings, axes, actions, b):
    """Into the lanes: so many fields, and the force of the action, none for those that were just placed.

    Args:
        whole: whether the pendulums are a block in its order.
        axes: numbers of an action.
    """
    lanes = in_use(b, lanes)
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
                b[FORCE + i, j] = actions[axes * index + slot] if slot >= 0 else 0.0
    most = settings[MAX_FORCE]
    for i in range(3):
        for j in range(lanes):
            force = most * min(max(b[FORCE + i, j], -1.0), 1.0)
            b[FORCE + i, j] = force if b[FRESH, j] == 0.0 else 0.0


@compiled
def set_again(rows, indices, lanes, b):
    """The states of those that haven't moved."""
    for j in range(lanes):
        if b[MOVED, j] == 0.0:
            block = block_of(rows, indices[j] // WIDTH)
            for i in range(18):
                b[i, j] = block[i, indices[j] % WIDTH]


@compiled
def addresses(observations, outcomes, forces, rewards, terminated, truncated, ended):
    """Of what `store` is told to write."""
    return (
        numbers_from(observations, 0), numbers_from(outcomes, 0), numbers_from(forces, 0), numbers_from(rewards, 0),
        numbers_from(terminated, 0), numbers_from(truncated, 0), numbers_from(ended, 0),
    )  # fmt: skip


@compiled
def store(rows, indices, lanes, whole, b, limit, size, pendulums, told):
    """From the lanes: what a step changed, and what it tells. A pendulum that was just placed has made no step: it gets
    no reward, and doesn't end.

    Args:
        limit: steps after which an episode is truncated.
        size: numbers of an observation.
        pendulums: how many there are.
        told: the `addresses` of what is written: ends are those by the task, by time, and by either.
    """
    if whole:
        _store_block(rows, indices[0], lanes, b, limit, size, pendulums, told)
    else:
        _store_each(rows, indices, lanes, b, limit, size, pendulums, told)


@compiled
def _store_block(rows, first, lanes, b, limit, size, pendulums, told):
    """As `store`, of the block that begins with the pendulum `first`."""
    lanes = in_use(b, lanes)
    observations, outcomes, forces, rewards, terminated, truncated, ended = told
    copy, original = flat(b), flat(block_of(rows, first // WIDTH))
    for n in range(PHYSICS * lanes):
        original[n] = copy[n]
    for i in range(OUTCOMES):
        outcome = numbers_from(outcomes, i * pendulums + first)
        for j in range(lanes):
            outcome[j] = b[FIELDS + i, j]
    force = numbers_from(forces, 3 * first)
    for j in range(lanes):
        force[3 * j] = b[FORCE, j]
        force[3 * j + 1] = b[FORCE + 1, j]
        force[3 * j + 2] = b[FORCE + 2, j]
    for j in range(0, lanes, 4):
        four = numbers_from(observations, size * (first + j))
        if size == 18:
            for i in (0, 4, 8, 12, 14):
                put_side_by_side(b, (i, i + 1, i + 2, i + 3), j, numbers_from(four, i), 18)
        else:
            put_side_by_side(b, (3, 4, 5, 6), j, four, 12)
            put_side_by_side(b, (7, 8, 12, 13), j, numbers_from(four, 4), 12)
            put_side_by_side(b, (14, 15, 16, 17), j, numbers_from(four, 8), 12)
    earned = numbers_from(rewards, first)
    over = numbers_from(terminated, first)
    late = numbers_from(truncated, first)
    last = numbers_from(ended, first)
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
def _store_each(rows, indices, lanes, b, limit, size, pendulums, told):
    """As `store`, of pendulums that lie anywhere."""
    observations, outcomes, forces, rewards, terminated, truncated, ended = told
    for j in range(lanes):
        index = indices[j]
        block = block_of(rows, index // WIDTH)
        for i in range(PHYSICS):
            block[i, index % WIDTH] = b[i, j]
        for i in range(OUTCOMES):
            outcomes[i * pendulums + index] = b[FIELDS + i, j]
        for i in range(3):
            forces[3 * index + i] = b[FORCE + i, j]
        observation = numbers_from(observations, size * index)
        if size == 18:
            for i in range(18):
                observation[i] = b[i, j]
        else:
            for i in range(6):
                observation[i] = b[3 + i, j]
                observation[6 + i] = b[12 + i, j]
        moved = b[MOVED, j] != 0.0
        done = moved & (b[ENDED, j] != 0.0)
        out_of_time = moved & (b[CLOCK, j] >= limit)
        rewards[index] = b[REWARD, j] if moved else 0.0
        terminated[index] = done
        truncated[index] = out_of_time
        ended[index] = done | out_of_time
