"""The compiled step, for one pendulum and for many. It holds no formula of its own.

Both run the same functions on a local buffer of constant shape with the pendulums side by side, one or WIDTH of them:
the loops over pendulums are innermost, and root and division vectorise (where there is one pendulum, the loops
vanish). Without any fastmath flag the arithmetic is IEEE's in either case, so that a pendulum gets the same bits alone
and among others. Places that nobody uses are filled with another pendulum, so that no loop has a remainder.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable
from numba.misc.special import literally
from numpy.typing import NDArray

from spring_pendulum_env import integrators, layout, physics, tasks
from spring_pendulum_env.integrators import (
    DRIFTS,
    ERROR_MARGIN,
    FINEST,
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
    AXIS_COUNT,
    AXIS_SLOTS,
    BAD_ACTION,
    CENTRING_SCALE,
    CHUNK,
    CLOCK,
    DEVIATION,
    DISSIPATED,
    DRAG,
    ELAPSED,
    ENDED,
    ENERGY,
    ENERGY_SCALE,
    ERROR,
    EXCESS,
    FIELDS,
    FINE,
    FORCE,
    FRESH,
    HEIGHTS,
    LOST_TO_DRAG,
    MASSES,
    MAX_FORCE,
    NOT_FINITE,
    PERIOD,
    PHYSICS,
    POSTURE_SCALE,
    REPORTED,
    REST_ENERGY,
    REWARD,
    START_ENERGY,
    STATUS,
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
    WORK_DONE,
)

STAGES = len(KICKS)
HALF = STAGES // 2  # of the drifts

# What a buffer holds after the fields and the reports.
SPRINGS = REPORTED  # 6: forces of both springs, N
BEFORE = SPRINGS + 6  # 3: where the anchor was before the step
GUARDED = BEFORE + 3  # 1 where a spring came too close to zero length for the splitting
LOST = GUARDED + 1  # what drag took in this step, J
MOVED = LOST + 1  # 1 where the step counts
SHARE = MOVED + 1  # 3 for each of half the drifts: what drag does, see _drag
SHORT = SHARE + 3 * HALF
BUFFER = SHORT + 3 * HALF


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
    """Compiled by itself, with the entries that call it, and cached with them."""
    return numba.njit(error_model="numpy", nogil=True)(function)


def _compiled_for_width(function):
    """As `_compiled`, for functions of a buffer, its width, and how many lanes of it are in use.

    They begin with `literally(width)` and a test of the buffer's width that never fails: these tell the compiler the
    distances between the buffer's fields, without which it would not vectorise. The lanes are one, or a multiple of
    eight, so that no loop has a remainder. Written into one big function instead, the parts would take numba several
    times as long.
    """
    return _compiled(function)


for _function in (
    physics.length,
    physics.spring_force,
    physics.accelerations_under,
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


@_compiled_for_width
def _split(b, width, lanes, steps, step):
    """So many steps of the symplectic splitting, each so long, s.

    Marks the pendulums of which a spring is too close to zero length, before or after one of them.
    """
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    dragged = False
    for j in range(lanes):
        dragged |= b[DRAG, j] + b[DRAG + 1, j] + b[DRAG + 2, j] != 0.0
    if dragged:
        _drag(b, width, lanes, step)
    for n in range(steps + 1):
        for j in range(lanes):
            close1 = integrators.approaches_zero(
                b[3, j] - b[0, j], b[4, j] - b[1, j], b[5, j] - b[2, j],
                b[12, j] - b[9, j], b[13, j] - b[10, j], b[14, j] - b[11, j],
                b[PHYSICS + 5, j], b[PHYSICS + 7, j], step,
            )  # fmt: skip
            close2 = integrators.approaches_zero(
                b[6, j] - b[3, j], b[7, j] - b[4, j], b[8, j] - b[5, j],
                b[15, j] - b[12, j], b[16, j] - b[13, j], b[17, j] - b[14, j],
                b[PHYSICS + 6, j], b[PHYSICS + 8, j], step,
            )  # fmt: skip
            b[GUARDED, j] = 1.0 if close1 | close2 else b[GUARDED, j]
        if n == steps:
            break
        for s in range(STAGES):
            # Springs, then kicks and drifts: in loops of their own, so that the roots and divisions of several
            # pendulums are in flight at once. The last drift is none, so the forces of the last kick in a step are
            # those of the first in the next.
            if s > 0 or n == 0:
                for j in range(lanes):
                    force1 = physics.spring_force(
                        b[3, j] - b[0, j], b[4, j] - b[1, j], b[5, j] - b[2, j], b[PHYSICS + 5, j], b[PHYSICS + 7, j]
                    )
                    force2 = physics.spring_force(
                        b[6, j] - b[3, j], b[7, j] - b[4, j], b[8, j] - b[5, j], b[PHYSICS + 6, j], b[PHYSICS + 8, j]
                    )
                    b[SPRINGS, j] = force1[0]
                    b[SPRINGS + 1, j] = force1[1]
                    b[SPRINGS + 2, j] = force1[2]
                    b[SPRINGS + 3, j] = force2[0]
                    b[SPRINGS + 4, j] = force2[1]
                    b[SPRINGS + 5, j] = force2[2]
            kick = KICKS[s] * step
            drift = DRIFTS[s] * step
            for j in range(lanes):
                a = physics.accelerations_under(
                    b[SPRINGS, j], b[SPRINGS + 1, j], b[SPRINGS + 2, j],
                    b[SPRINGS + 3, j], b[SPRINGS + 4, j], b[SPRINGS + 5, j],
                    b[FORCE, j], b[FORCE + 1, j], b[FORCE + 2, j],
                    b[PHYSICS, j], b[PHYSICS + 1, j], b[PHYSICS + 2, j], b[PHYSICS + 3, j], b[PHYSICS + 4, j],
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
            if dragged and s < STAGES - 1:
                table = 3 * min(s, STAGES - 2 - s)
                for i in range(9):
                    body = i // 3
                    for j in range(lanes):
                        v = b[9 + i, j]
                        share = b[SHARE + table + body, j]
                        b[i, j] -= b[SHORT + table + body, j] * v
                        b[9 + i, j] = v - share * v
                        b[LOST, j] += 0.5 * b[MASSES + body, j] * v * v * share * (2.0 - share)


@_compiled_for_width
def _drag(b, width, lanes, step):
    """What drag does in each drift: it takes a SHARE of each body's velocity, and the body falls SHORT of where it
    would have come, s for each m/s. The drifts are symmetric, so half of them say all."""
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    for s in range(HALF):
        drift = DRIFTS[s] * step
        for body in range(3):
            for j in range(lanes):
                rate = b[DRAG + body, j]
                if j > 0 and rate == b[DRAG + body, j - 1]:
                    share = b[SHARE + 3 * s + body, j - 1]
                    short = b[SHORT + 3 * s + body, j - 1]
                else:
                    share = -math.expm1(-rate * drift)
                    short = drift - share / rate if rate != 0.0 else 0.0
                b[SHARE + 3 * s + body, j] = share
                b[SHORT + 3 * s + body, j] = short


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
def _adaptive(b, j, period, tolerance):
    """One control period of pendulum j of a buffer by Dormand-Prince 8(5,3); a STATUS if it takes too many steps.

    The error norm is the largest component's, each relative to 1 + |y|. Nothing but the state decides the
    steps, so that a state that is set again is continued with the same bits.
    """
    c = np.empty(FIELDS)
    y = np.empty(19)  # the state, and what drag dissipates
    new = np.empty(19)
    k = np.empty((13, 19))
    for i in range(FIELDS):
        c[i] = b[i, j]
    for i in range(18):
        y[i] = b[i, j]
    y[18] = 0.0
    time = 0.0
    step = period / c[STEPS]
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
        b[i, j] = y[i]
    b[LOST, j] = y[18]
    b[STATUS, j] = status


@_compiled_for_width
def _move(b, width, lanes, refinement, settings):
    """One control period of the states in the buffer; those that aren't MOVED after it must be set again.

    By the splitting, its steps `refinement` times finer; or, where a tolerance is set or they would be finer than
    FINEST, by the adaptive scheme.
    """
    literally(width)
    if b.shape[1] != width:
        return
    lanes = 1 if width == 1 else lanes & -8
    period = settings[PERIOD]
    tolerance = settings[TOLERANCE]
    for j in range(lanes):
        b[BEFORE, j] = b[0, j]
        b[BEFORE + 1, j] = b[1, j]
        b[BEFORE + 2, j] = b[2, j]
        b[GUARDED, j] = 0.0
        b[LOST, j] = 0.0
        b[STATUS, j] = FINE
    if tolerance == 0.0 and refinement <= FINEST:
        steps = int(b[STEPS, 0]) * refinement
        _split(b, width, lanes, steps, period / steps)
    else:
        for j in range(lanes):
            if b[FRESH, j] == 0.0:
                _adaptive(b, j, period, GUARD_TOLERANCE if tolerance == 0.0 else tolerance)
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


@_compiled_for_width
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
        b[ELAPSED, j] = clock
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


def _advance(cell, x, y, z):
    """One control period of a single pendulum under the action (x, y, z), in units of max_force, and its report.

    One that was just placed is only reported. Returns its STATUS; where an action isn't finite nothing changes.

    Args:
        cell: shape (CELL,), read and written.
    """
    if not math.isfinite(x + y + z):
        return BAD_ACTION
    settings = cell[REPORTED:]
    b = np.empty((BUFFER, 1))
    for i in range(FIELDS):
        b[i, 0] = cell[i]
    fresh = b[FRESH, 0] != 0.0
    scale = 0.0 if fresh else settings[MAX_FORCE]
    b[FORCE, 0] = scale * min(max(x, -1.0), 1.0)
    b[FORCE + 1, 0] = scale * min(max(y, -1.0), 1.0)
    b[FORCE + 2, 0] = scale * min(max(z, -1.0), 1.0)
    refinement = np.int64(1)  # of a plain 1 numba would compile what is handed it a second time
    while True:
        _move(b, 1, np.int64(1), refinement, settings)
        if b[MOVED, 0] == 0.0:
            for i in range(18):
                b[i, 0] = cell[i]
        if b[GUARDED, 0] == 0.0:
            break
        refinement *= REFINEMENT
    _report(b, 1, np.int64(1), settings)
    for i in range(REPORTED):
        cell[i] = b[i, 0]
    return int(b[STATUS, 0])


@_compiled
def _take(rows, queue, done, waiting, indices):
    """The next pendulums of a queue that can be done together, those that need as many steps: how many.

    Args:
        queue: of pendulums; those from `done` on to before `waiting` are left, and change places.
        indices: shape (WIDTH,), written: which pendulums; beyond their number the first one again.
    """
    block = queue[done] // WIDTH
    steps = rows[block, STEPS, queue[done] % WIDTH]
    if done + WIDTH <= waiting:
        whole = True
        for j in range(WIDTH):
            whole &= (queue[done + j] == block * WIDTH + j) & (rows[block, STEPS, j] == steps)
        if whole:
            for j in range(WIDTH):
                indices[j] = queue[done + j]
            return WIDTH
    count = 0
    for n in range(done, waiting):
        index = queue[n]
        if rows[index // WIDTH, STEPS, index % WIDTH] == steps:
            queue[n] = queue[done + count]
            queue[done + count] = index
            indices[count] = index
            count += 1
            if count == WIDTH:
                break
    for j in range(count, WIDTH):
        indices[j] = indices[0]
    return count


@_compiled
def _is_block(indices):
    """Whether they are the pendulums of a block in their order, which are copied fast."""
    same = indices[0] % WIDTH == 0
    for j in range(WIDTH):
        same &= indices[j] == indices[0] + j
    return same


@_compiled
def _load(rows, indices, lanes, settings, actions, b):
    """Into the buffer: the fields, and the force of the action, none for those that were just placed."""
    if b.shape[1] != WIDTH:
        return
    if _is_block(indices):
        whole = rows[indices[0] // WIDTH].reshape(FIELDS * WIDTH)
        flat = b.reshape(b.size)
        for n in range(FIELDS * WIDTH):
            flat[n] = whole[n]
    else:
        for j in range(lanes):
            for i in range(FIELDS):
                b[i, j] = rows[indices[j] // WIDTH, i, indices[j] % WIDTH]
    for i in range(3):
        slot = int(settings[AXIS_SLOTS + i])
        for j in range(lanes):
            action = actions[indices[j], slot] if slot >= 0 else 0.0
            b[FORCE + i, j] = settings[MAX_FORCE] * min(max(action, -1.0), 1.0) if b[FRESH, j] == 0.0 else 0.0


@_compiled
def _store(rows, indices, lanes, b, observations, outcomes, forces, ended):
    """From the buffer: what a step changed, and what it reports."""
    if b.shape[1] != WIDTH:
        return
    if _is_block(indices):
        whole = rows[indices[0] // WIDTH].reshape(FIELDS * WIDTH)
        flat = b.reshape(b.size)
        for n in range(PHYSICS * WIDTH):
            whole[n] = flat[n]
        for i in range(REPORTED - FIELDS):
            outcome = outcomes[i, indices[0] : indices[0] + WIDTH]
            for j in range(WIDTH):
                outcome[j] = b[FIELDS + i, j]
    else:
        for j in range(lanes):
            for i in range(PHYSICS):
                rows[indices[j] // WIDTH, i, indices[j] % WIDTH] = b[i, j]
            for i in range(REPORTED - FIELDS):
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
        ended[indices[j]] = b[ENDED, j] != 0.0


def _step_batch(rows, wanted, settings, actions, observations, outcomes, forces, ended):
    """One control period of many pendulums, and their reports. Returns the largest STATUS.

    Those that were just placed are only reported.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), read and written.
        wanted: which pendulums, shape (n,).
        settings: shape (SETTINGS,).
        actions: shape (pendulums, actuated axes), finite.
        observations: shape (pendulums, 12 or 18), written.
        outcomes: shape (REPORTED - FIELDS, pendulums), written: what a step reports.
        forces: shape (pendulums, 3), written.
        ended: shape (pendulums,), written.
    """
    b = np.empty((BUFFER, WIDTH))
    indices = np.empty(WIDTH, dtype=np.int64)
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
                count = _take(rows, queue, done, waiting, indices)
                done += count
                lanes = (count + 7) & -8
                _load(rows, indices, lanes, settings, actions, b)
                _move(b, WIDTH, lanes, refinement, settings)
                stayed = False
                for j in range(lanes):
                    stayed |= b[MOVED, j] == 0.0
                if stayed:
                    for j in range(lanes):
                        if b[MOVED, j] == 0.0:
                            for i in range(18):
                                b[i, j] = rows[indices[j] // WIDTH, i, indices[j] % WIDTH]
                _report(b, WIDTH, lanes, settings)
                _store(rows, indices, lanes, b, observations, outcomes, forces, ended)
                for j in range(lanes):
                    stayed |= b[STATUS, j] != FINE
                if stayed:
                    for j in range(count):
                        worst = max(worst, int(b[STATUS, j]))
                        if b[GUARDED, j] != 0.0:
                            queue[again] = indices[j]
                            again += 1
            waiting = again
            refinement *= REFINEMENT
    return worst


with _cache_folder() as _cached:
    # A single pendulum's step is too short for letting go of Python's lock to pay.
    advance = numba.njit(error_model="numpy", cache=_cached)(_advance)
    step_batch = numba.njit(error_model="numpy", nogil=True, cache=_cached)(_step_batch)


def advance_entry() -> Callable[[NDArray[np.float64], float, float, float], int]:
    """`advance` without numba's look at the types of its arguments, which takes a good part of a short call.

    Numbers are converted to float as Python's `float` does.

    Raises (the function that it returns):
        TypeError, ValueError: an action isn't three numbers.
    """
    signature = numba.int64(numba.float64[::1], numba.float64, numba.float64, numba.float64)
    advance.compile(signature)
    compiled: Any = advance.overloads[signature.args]
    entry: Callable[[NDArray[np.float64], float, float, float], int] = compiled.entry_point
    return entry
