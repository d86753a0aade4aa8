"""What is booked before and after a step, and what it reports: energies, reward and end."""

from __future__ import annotations

from spring_pendulum_env import physics, tasks
from spring_pendulum_env.jit import compiled
from spring_pendulum_env.kernels.lanes import in_use
from spring_pendulum_env.layout import (
    AXIS_COUNT,
    BEFORE,
    CENTRING_SCALE,
    CLOCK,
    DEVIATION,
    DISSIPATED,
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
    LOST_TO_DRAG,
    MASSES,
    MAX_FORCE,
    MOVED,
    NOT_FINITE,
    PERIOD,
    PHYSICS,
    POSTURE_SCALE,
    REST_ENERGY,
    REWARD,
    START_ENERGY,
    STATUS,
    TERMS,
    TIME,
    TRAVEL,
    VELOCITY_SCALE,
    WEIGHTS,
    WORK,
    WORK_DONE,
)


@compiled
def prepare(b, lanes):
    """Before a step."""
    lanes = in_use(b, lanes)
    for j in range(lanes):
        b[BEFORE, j] = b[0, j]
        b[BEFORE + 1, j] = b[1, j]
        b[BEFORE + 2, j] = b[2, j]
        b[GUARDED, j] = 0.0
        b[LOST, j] = 0.0
        b[STATUS, j] = FINE


@compiled
def settle(b, lanes):
    """After a step: which pendulums have MOVED. The others must be set again.

    Returns:
        Whether one of them hasn't MOVED; whether one was GUARDED.
    """
    lanes = in_use(b, lanes)
    stayed = False
    near = False
    for j in range(lanes):
        total = (  # in pairs, which takes less time than one after the other
            ((b[0, j] + b[1, j]) + (b[2, j] + b[3, j])) + ((b[4, j] + b[5, j]) + (b[6, j] + b[7, j]))
            + (((b[8, j] + b[9, j]) + (b[10, j] + b[11, j])) + ((b[12, j] + b[13, j]) + (b[14, j] + b[15, j])))
            + (b[16, j] + b[17, j])
        )  # fmt: skip
        finite = total - total == 0.0
        fresh = b[FRESH, j] != 0.0
        guarded = (b[GUARDED, j] != 0.0) & (not fresh)
        wrong = (not finite) & (not fresh) & (not guarded) & (b[STATUS, j] == FINE)
        status = b[STATUS, j] + (NOT_FINITE if wrong else 0.0)  # of one that is wrong so far FINE, which is 0
        moved = (not fresh) & (not guarded) & (status == FINE)
        b[GUARDED, j] = 1.0 if guarded else 0.0
        b[STATUS, j] = status
        b[MOVED, j] = 1.0 if moved else 0.0
        b[LOST, j] = b[LOST, j] if moved else 0.0
        stayed |= not moved
        near |= guarded
    return stayed, near


@compiled
def report(b, lanes, settings):
    """Books work, dissipation and time; energies, reward and end, from the state."""
    lanes = in_use(b, lanes)
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
