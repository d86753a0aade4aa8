"""The compiled step, for one pendulum and for many. It holds no formula of its own.

Pendulums stand in `rows` as layout.py says. The loops over pendulums are innermost and run on local buffers of constant
shape, so that root and division vectorise; without any fastmath flag the arithmetic is IEEE's in either case, so that
a pendulum gets the same bits alone and among others.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np
from numba.extending import register_jitable

from spring_pendulum_env import integrators, layout, physics, tasks
from spring_pendulum_env.integrators import (
    DRIFTS,
    ERROR_MARGIN,
    GUARD_TOLERANCE,
    KICKS,
    LONGEST_STEP,
    MOST_STEPS,
    REFINEMENT,
    RK_E3,
    RK_E5,
    RK_ORDER,
    RK_STAGES,
)
from spring_pendulum_env.layout import (
    ACTION,
    AXIS_COUNT,
    AXIS_SLOTS,
    BAD_ACTION,
    CENTRING_SCALE,
    CHUNK,
    CLOCK,
    DEVIATION,
    DISSIPATED,
    DRAG,
    ENDED,
    ENERGY,
    ENERGY_SCALE,
    ERROR,
    EXCESS,
    FINE,
    FORCE,
    FRESH,
    GUARDED,
    HEIGHTS,
    LOST,
    MASSES,
    MAX_FORCE,
    NEXT,
    NOT_FINITE,
    PERIOD,
    PHYSICS,
    POSTURE_SCALE,
    REST_ENERGY,
    REWARD,
    START_ENERGY,
    STATE,
    STATUS,
    STEP,
    STEPS,
    TERMS,
    TIME,
    TOLERANCE,
    TOO_MANY_STEPS,
    TRAVEL,
    VELOCITY_SCALE,
    WEIGHTS,
    WIDTH,
    WORK,
)

STAGES = len(KICKS)


def _source_hash() -> str:
    """Changes with any source that is compiled: numba's own cache key doesn't see edits in other files."""
    sources = (Path(module.__file__ or "") for module in (physics, integrators, layout, tasks))
    text = b"".join(path.read_bytes() for path in (*sources, Path(__file__)))
    return hashlib.sha256(text).hexdigest()[:16]


@contextlib.contextmanager
def _cache_folder() -> Iterator[bool]:
    """Sets numba's cache folder while functions are declared; yields whether there is one that can be written.

    It is NUMBA_CACHE_DIR, or else a folder of this version of the sources beside the package's other compiled files,
    in place of those of versions before.
    """
    own = Path(__file__).parent / "__pycache__"
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or own) / f"kernels-{_source_hash()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    for old in own.glob("kernels-*"):
        if old.name != folder.name:
            shutil.rmtree(old, ignore_errors=True)
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    if writable:
        numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    try:
        yield writable
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


def _compiled(function):
    """What `advance` calls; compiled with it and cached with it."""
    return numba.njit(error_model="numpy", nogil=True)(function)


for _function in (
    physics.length,
    physics.spring_force,
    physics.accelerations,
    physics.derivatives,
    physics.weighted_squares,
    physics.spring_energy,
    physics.kinetic_energy,
    physics.potential_energy,
    physics.total_energy,
    physics.energy_error,
    tasks.reward_terms,
    integrators.approaches_zero,
):
    register_jitable(error_model="numpy")(_function)


@_compiled
def _apply_actions(rows, block, first, count, max_force):
    """Force from the clipped action; a STATUS for an action that isn't finite."""
    for j in range(first, first + count):
        rows[block, STATUS, j] = FINE
    for i in range(3):
        for j in range(first, first + count):
            action = rows[block, ACTION + i, j]
            if not math.isfinite(action):
                rows[block, STATUS, j] = BAD_ACTION
            force = max_force * min(max(action, -1.0), 1.0)
            rows[block, FORCE + i, j] = force if rows[block, FRESH, j] == 0.0 else 0.0


@_compiled
def _splitting(rows, work, done, count, refinement):
    """One control period by the symplectic splitting, from STATE to NEXT, of `count` of the pendulums in `work`.

    Those from number `done` on; all of them need as many steps, which are taken `refinement` times finer.
    """
    # One buffer for all that the loops touch: between its fields the compiler knows the distance, so it vectorises.
    b = np.empty((HEIGHTS + 2, WIDTH))
    lost = HEIGHTS
    guarded = HEIGHTS + 1
    dragged = False
    width = rows.shape[2]
    block, first = divmod(work[done], width)
    together = work[done + count - 1] - work[done] == count - 1 and first + count <= width
    if together:  # neighbours in a block are copied many at a time
        for i in range(HEIGHTS):
            for j in range(count):
                b[i, j] = rows[block, i, first + j]
    else:
        for j in range(count):
            from_block, column = divmod(work[done + j], width)
            for i in range(HEIGHTS):
                b[i, j] = rows[from_block, i, column]
    steps = int(rows[block, STEPS, first]) * refinement
    for j in range(count):
        b[STEP, j] /= refinement
        b[lost, j] = 0.0
        b[guarded, j] = 0.0
        dragged |= b[DRAG, j] + b[DRAG + 1, j] + b[DRAG + 2, j] != 0.0
    _guard(b, count)
    # In each drift drag takes a share of each body's velocity, and the body falls short of where it would have come.
    share = np.empty((3 * STAGES if dragged else 0, WIDTH))
    short = np.empty((3 * STAGES if dragged else 0, WIDTH))  # per velocity, s
    if dragged:
        for s in range(3 * STAGES):
            for j in range(count):
                rate = b[DRAG + s % 3, j]
                drift = DRIFTS[s // 3] * b[STEP, j]
                share[s, j] = -math.expm1(-rate * drift)
                short[s, j] = drift - share[s, j] / rate if rate != 0.0 else 0.0
    for _ in range(steps):
        for s in range(STAGES):
            for j in range(count):
                kick = KICKS[s] * b[STEP, j]
                drift = DRIFTS[s] * b[STEP, j]
                a = physics.accelerations(
                    b[0, j], b[1, j], b[2, j], b[3, j], b[4, j], b[5, j], b[6, j], b[7, j], b[8, j],
                    b[FORCE, j], b[FORCE + 1, j], b[FORCE + 2, j],
                    b[PHYSICS, j], b[PHYSICS + 1, j], b[PHYSICS + 2, j], b[PHYSICS + 3, j], b[PHYSICS + 4, j],
                    b[PHYSICS + 5, j], b[PHYSICS + 6, j], b[PHYSICS + 7, j], b[PHYSICS + 8, j],
                    b[PHYSICS + 9, j], b[PHYSICS + 10, j],
                )  # fmt: skip
                v0 = b[9, j] + kick * a[0]
                v1 = b[10, j] + kick * a[1]
                v2 = b[11, j] + kick * a[2]
                v3 = b[12, j] + kick * a[3]
                v4 = b[13, j] + kick * a[4]
                v5 = b[14, j] + kick * a[5]
                v6 = b[15, j] + kick * a[6]
                v7 = b[16, j] + kick * a[7]
                v8 = b[17, j] + kick * a[8]
                b[9, j] = v0
                b[0, j] += drift * v0
                b[10, j] = v1
                b[1, j] += drift * v1
                b[11, j] = v2
                b[2, j] += drift * v2
                b[12, j] = v3
                b[3, j] += drift * v3
                b[13, j] = v4
                b[4, j] += drift * v4
                b[14, j] = v5
                b[5, j] += drift * v5
                b[15, j] = v6
                b[6, j] += drift * v6
                b[16, j] = v7
                b[7, j] += drift * v7
                b[17, j] = v8
                b[8, j] += drift * v8
            if dragged:
                for i in range(9):
                    body = 3 * s + i // 3
                    for j in range(count):
                        v = b[9 + i, j]
                        b[i, j] -= short[body, j] * v
                        b[9 + i, j] = v - share[body, j] * v
                        b[lost, j] += 0.5 * b[MASSES + i // 3, j] * v * v * share[body, j] * (2.0 - share[body, j])
        _guard(b, count)
    if together:
        for i in range(18):
            for j in range(count):
                rows[block, NEXT + i, first + j] = b[i, j]
        for i in range(2):
            for j in range(count):
                rows[block, LOST + i, first + j] = b[lost + i, j]
    else:
        for j in range(count):
            to_block, column = divmod(work[done + j], width)
            for i in range(18):
                rows[to_block, NEXT + i, column] = b[i, j]
            for i in range(2):
                rows[to_block, LOST + i, column] = b[lost + i, j]


@_compiled
def _guard(b, count):
    """Marks the pendulums of a buffer of which a spring is too close to zero length for a step of the splitting."""
    guarded = HEIGHTS + 1
    for j in range(count):
        close1 = integrators.approaches_zero(
            b[3, j] - b[0, j], b[4, j] - b[1, j], b[5, j] - b[2, j],
            b[12, j] - b[9, j], b[13, j] - b[10, j], b[14, j] - b[11, j],
            b[PHYSICS + 5, j], b[PHYSICS + 7, j], b[STEP, j],
        )  # fmt: skip
        close2 = integrators.approaches_zero(
            b[6, j] - b[3, j], b[7, j] - b[4, j], b[8, j] - b[5, j],
            b[15, j] - b[12, j], b[16, j] - b[13, j], b[17, j] - b[14, j],
            b[PHYSICS + 6, j], b[PHYSICS + 8, j], b[STEP, j],
        )  # fmt: skip
        b[guarded, j] = 1.0 if close1 | close2 else b[guarded, j]


@_compiled
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


@_compiled
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


@_compiled
def _adaptive(rows, block, j, period, tolerance):
    """One control period by Dormand-Prince 8(5,3), from STATE to NEXT; a STATUS if it takes too many steps.

    The error norm is the largest component's, each relative to 1 + |y|. Nothing but the state decides the
    steps, so that a state that is set again is continued with the same bits.
    """
    c = np.empty(HEIGHTS)  # the fields before HEIGHTS
    y = np.empty(19)  # the state, and what drag dissipates
    new = np.empty(19)
    k = np.empty((13, 19))
    for i in range(HEIGHTS):
        c[i] = rows[block, i, j]
    for i in range(18):
        y[i] = rows[block, STATE + i, j]
    y[18] = 0.0
    time = 0.0
    step = c[STEP]
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
        rows[block, NEXT + i, j] = y[i]
    rows[block, LOST, j] = y[18]
    rows[block, STATUS, j] = status


@_compiled
def _arrive(rows, block, first, count):
    """Makes NEXT the state, and books work, dissipation and time.

    Pendulums that were just placed, or whose STATUS isn't FINE, stay as they are.
    """
    total = np.zeros(WIDTH)
    moved = np.zeros(WIDTH)
    for i in range(18):
        for j in range(count):
            total[j] += rows[block, NEXT + i, first + j]
    for j in range(count):
        fresh = rows[block, FRESH, first + j] != 0.0
        rows[block, FRESH, first + j] = 0.0
        if not fresh and rows[block, STATUS, first + j] == FINE and not math.isfinite(total[j]):
            rows[block, STATUS, first + j] = NOT_FINITE
        moved[j] = 1.0 if not fresh and rows[block, STATUS, first + j] == FINE else 0.0
    for i in range(3):
        for j in range(count):
            if moved[j] != 0.0:
                change = rows[block, NEXT + i, first + j] - rows[block, STATE + i, first + j]
                rows[block, WORK, first + j] += rows[block, FORCE + i, first + j] * change
    for i in range(18):
        for j in range(count):
            if moved[j] != 0.0:
                rows[block, STATE + i, first + j] = rows[block, NEXT + i, first + j]
    for j in range(count):
        if moved[j] != 0.0:
            rows[block, DISSIPATED, first + j] += rows[block, LOST, first + j]
            rows[block, CLOCK, first + j] += 1.0


@_compiled
def _report(rows, block, first, count, settings):
    """Energies, reward and end, from the state."""
    b = np.empty((STATUS + 1, WIDTH))
    for i in range(TIME):
        for j in range(count):
            b[i, j] = rows[block, i, first + j]
    for j in range(count):
        b[STATUS, j] = rows[block, STATUS, first + j]
    limit = settings[DEVIATION] * settings[DEVIATION]
    travel = settings[TRAVEL]
    force_scale = 1.0 / (max(settings[AXIS_COUNT], 1.0) * settings[MAX_FORCE] * settings[MAX_FORCE])
    for j in range(count):
        energy = physics.total_energy(
            b[0, j], b[1, j], b[2, j], b[3, j], b[4, j], b[5, j], b[6, j], b[7, j], b[8, j],
            b[9, j], b[10, j], b[11, j], b[12, j], b[13, j], b[14, j], b[15, j], b[16, j], b[17, j],
            b[MASSES, j], b[MASSES + 1, j], b[MASSES + 2, j],
            b[PHYSICS + 5, j], b[PHYSICS + 6, j], b[PHYSICS + 7, j], b[PHYSICS + 8, j], b[PHYSICS + 9, j],
        )  # fmt: skip
        start = energy if b[CLOCK, j] == 0.0 else b[START_ENERGY, j]
        b[START_ENERGY, j] = start
        b[TIME, j] = b[CLOCK, j] * settings[PERIOD]
        b[ENERGY, j] = energy
        b[EXCESS, j] = energy - b[REST_ENERGY, j]
        b[ERROR, j] = physics.energy_error(energy - start - b[WORK, j] + b[DISSIPATED, j], start)
        b[STATUS, j] = NOT_FINITE if energy - energy != 0.0 else b[STATUS, j]

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
            settings[ENERGY_SCALE],
            settings[POSTURE_SCALE],
            settings[VELOCITY_SCALE],
            settings[CENTRING_SCALE],
        )
        b[TERMS, j] = settings[WEIGHTS] * terms[0]
        b[TERMS + 1, j] = settings[WEIGHTS + 1] * terms[1]
        b[TERMS + 2, j] = settings[WEIGHTS + 2] * terms[2]
        b[TERMS + 3, j] = settings[WEIGHTS + 3] * terms[3]
        b[TERMS + 4, j] = settings[WEIGHTS + 4] * terms[4]
        reward = b[TERMS, j] + b[TERMS + 1, j] + b[TERMS + 2, j] + b[TERMS + 3, j] + b[TERMS + 4, j]
        b[REWARD, j] = min(max(reward, 0.0), 1.0)
    for i in range(START_ENERGY, STATUS + 1):
        for j in range(count):
            rows[block, i, first + j] = b[i, j]


def _advance(rows, first, count, settings):
    """One control period and the report of the pendulums from `first` to before `first + count`.

    Pendulums that were just placed are only reported. Returns the largest STATUS.
    """
    width = rows.shape[2]
    tolerance = settings[TOLERANCE]
    end = first + count
    blocks = range(first // width, (end - 1) // width + 1)
    for block in blocks:
        low = max(first - block * width, 0)
        high = min(end - block * width, width)
        _apply_actions(rows, block, low, high - low, settings[MAX_FORCE])
    if tolerance == 0.0:
        # As they are; then those again, finer, of which a spring came too close to zero length.
        work = np.empty(count, dtype=np.int64)
        steps = np.empty(count)
        for refinement in (1, REFINEMENT):
            wanted = 0
            for block in blocks:
                for column in range(max(first - block * width, 0), min(end - block * width, width)):
                    if refinement == 1 or rows[block, GUARDED, column] != 0.0:
                        work[wanted] = block * width + column
                        steps[wanted] = rows[block, STEPS, column]
                        wanted += 1
            # Of a plain 0 or 1 numba would compile what is handed it a second time.
            done = np.int64(0)
            while done < wanted:
                room = width - work[done] % width if refinement == 1 else WIDTH  # neighbours of a block are copied fast
                size = np.int64(1)
                while size < room and done + size < wanted and steps[done + size] == steps[done]:
                    size += 1
                _splitting(rows, work, done, size, refinement)
                done += size
    worst = FINE
    for block in blocks:
        low = max(first - block * width, 0)
        high = min(end - block * width, width)
        for j in range(low, high):
            wrong = tolerance != 0.0 or rows[block, GUARDED, j] != 0.0
            if wrong and rows[block, STATUS, j] == FINE and rows[block, FRESH, j] == 0.0:
                _adaptive(rows, block, j, settings[PERIOD], GUARD_TOLERANCE if tolerance == 0.0 else tolerance)
        _arrive(rows, block, low, high - low)
        _report(rows, block, low, high - low, settings)
        for j in range(low, high):
            worst = max(worst, int(rows[block, STATUS, j]))
    return worst


# Its body goes into `_step_batch` instead of being called, which would compile all that it calls once more.
_advance_here = numba.njit(error_model="numpy", nogil=True, inline="always")(_advance)


@_compiled
def _collect(rows, first, count, observations, outcomes, forces, ended):
    """Copies what the pendulums from `first` to before `first + count` report into arrays.

    Args:
        observations: shape (pendulums, 12 or 18), written.
        outcomes: shape (STATUS - CLOCK, pendulums), written: the fields from CLOCK to before STATUS.
        forces: shape (pendulums, 3), written.
        ended: shape (pendulums,), written.
    """
    width = rows.shape[2]
    shown = observations.shape[1] // 2
    hidden = 9 - shown  # positions of the anchor that the observation leaves out
    index = first
    while index < first + count:
        block, column = divmod(index, width)
        run = min(width - column, first + count - index)
        for j in range(run):
            for i in range(shown):
                observations[index + j, i] = rows[block, STATE + hidden + i, column + j]
                observations[index + j, shown + i] = rows[block, STATE + 9 + hidden + i, column + j]
            for i in range(3):
                forces[index + j, i] = rows[block, FORCE + i, column + j]
            ended[index + j] = rows[block, ENDED, column + j] != 0.0
        for i in range(STATUS - CLOCK):
            for j in range(run):
                outcomes[i, index + j] = rows[block, CLOCK + i, column + j]
        index += run


def _step_batch(rows, first, count, settings, actions, observations, outcomes, forces, ended):
    """`advance` with actions, shape (pendulums, actuated axes), and the results as `_collect` describes them."""
    width = rows.shape[2]
    worst = FINE
    for start in range(first, first + count, CHUNK):
        size = min(CHUNK, first + count - start)
        for index in range(start, start + size):
            block, column = divmod(index, width)
            for axis in range(actions.shape[1]):
                rows[block, ACTION + int(settings[AXIS_SLOTS + axis]), column] = actions[index, axis]
        status = _advance_here(rows, start, size, settings)
        worst = max(worst, status)
        _collect(rows, start, size, observations, outcomes, forces, ended)
    return worst


with _cache_folder() as _cached:
    _entry = numba.njit(error_model="numpy", nogil=True, cache=_cached)
    advance = _entry(_advance)
    step_batch = _entry(_step_batch)
    collect = _entry(_collect.py_func)
