"""How pendulums are laid out in memory for the compiled step, and how one is put there.

Many pendulums are kept in `rows`, an array of shape (blocks, FIELDS, WIDTH): each block holds WIDTH pendulums side by
side, one field after the other. A single one is kept in a `cell`, an array of shape (CELL,), in which the compiled step
works too: its fields, what its last step reported, what the step needs while it works, and the settings.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import integrators, physics, tasks
from spring_pendulum_env.equilibria import unchecked_energy, vertical_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import START_NUMBERS, Scenario

FloatArray = NDArray[np.float64]

WIDTH = 64
"""Pendulums in a block: enough to hide what a loop costs, few enough for all that a step touches to stay in cache."""

# The fields of a pendulum, and where each begins. First what a step changes ...
STATE = 0  # 18: positions of anchor, m1, m2, then their velocities
START_ENERGY = 18
CLOCK = 19  # control periods since the start
WORK = 20
DISSIPATED = 21
FRESH = 22  # 1 where it was just placed: the next step only reports it; DISPLACED in a cell
# ... of which the next step needs no more ...
STATUS = 23  # what went wrong in the step
FORCE = 24  # 3, newtons
# ... then what stays as long as an episode.
PHYSICS = 27  # 11: Parameters.constants()
DRAG = 38  # 3: Parameters.drag_rates()
MASSES = 41  # 3
HEIGHTS = 44  # 2: where the springs' far ends belong
REST_ENERGY = 46
STEPS = 47  # steps of the splitting in a control period
FIELDS = 48

# What a step reports of a pendulum besides, after the fields.
TIME, ENERGY, EXCESS, ERROR, WORK_DONE, LOST_TO_DRAG, TERMS = range(FIELDS, FIELDS + 7)
REWARD = TERMS + len(tasks.REWARD_TERMS)  # TERMS: the weighted reward terms
OUTCOMES = REWARD - FIELDS  # how many there are before the reward
ENDED = REWARD + 1  # 1 where the task's condition to end is met
REPORTED = ENDED + 1

# What the compiled step keeps of a pendulum while it works, after that.
STAGES = len(integrators.KICKS)
HALF = STAGES // 2  # of the drifts
SPRINGS = REPORTED  # 6: forces of both springs, N
BEFORE = SPRINGS + 6  # 3: where the anchor was before the step
GUARDED = BEFORE + 3  # 1 where a spring came too close to zero length for the splitting
LOST = GUARDED + 1  # what drag took in this step, J
MOVED = LOST + 1  # 1 where the step counts
SHARE = MOVED + 1  # 3 for each of half the drifts: what drag does, see schemes.py
SHORT = SHARE + 3 * HALF
BUFFER = SHORT + 3 * HALF

CHUNK = 2048
"""Pendulums that are done before the next ones, to stay in the processor's cache."""

FINE, BAD_ACTION, NOT_FINITE, TOO_MANY_STEPS, UNFINISHED = range(5)  # the last: left to the adaptive scheme

# The numbers that all pendulums of an environment share, in `settings`, in the order of `settings_of`.
(
    PERIOD,
    TOLERANCE,
    MAX_FORCE,
    TRAVEL,
    DEVIATION,
    AXIS_COUNT,
    ENERGY_SCALE,
    POSTURE_SCALE,
    VELOCITY_SCALE,
    CENTRING_SCALE,
    TIME_LIMIT,  # control periods until an episode is truncated; a single environment leaves that to a wrapper
    WEIGHTS,  # 5, one for each reward term
) = range(12)
AXIS_SLOTS = WEIGHTS + len(tasks.REWARD_TERMS)  # 3: which number of an action belongs to x, y and z; -1: none
ALIKE = AXIS_SLOTS + 3  # 1 where all pendulums have the same constants, which then need not be read of each
SETTINGS = ALIKE + 1

KEPT = BUFFER  # 18: in a cell, the state before the step
KNOWN = KEPT + 18
"""1 in a cell whose SPRINGS hold the forces at its state, from the last kick of the step before. They have the bits of
those that a batch computes anew, unless a coordinate is a negative zero, which no start has."""
CELL_SETTINGS = KNOWN + 1
SPREAD = CELL_SETTINGS + SETTINGS  # START_NUMBERS: standard deviations of the start ...
NOISE = SPREAD + START_NUMBERS  # ... and as many normal numbers, by which one that is FRESH is displaced if it is
DISPLACED = 2.0  # instead of 1
CELL = NOISE + START_NUMBERS


def settings_of(scenario: Scenario, time_limit: float = math.inf) -> FloatArray:
    """The numbers that all pendulums of an environment share, shape (SETTINGS,)."""
    task = scenario.task
    return np.array(
        [
            scenario.control_period,
            0.0 if scenario.tolerance is None else scenario.tolerance,
            scenario.max_force,
            scenario.anchor_travel,
            task.largest_deviation,
            len(scenario.actuated_axes),
            task.energy_scale,
            task.posture_scale,
            task.velocity_scale,
            task.centring_scale,
            time_limit,
            *(task.weights.get(term, 0.0) for term in tasks.REWARD_TERMS),
            *(scenario.actuated_axes.find(axis) for axis in physics.AXES),
            0.0,
        ]
    )


def steps_in(control_period: float, constants: tuple[float, ...]) -> int:
    """How many equal steps of the splitting a control period needs: no step longer than LONGEST_STEP, none in which
    the fastest mode of the springs turns further than LARGEST_PHASE.

    Raises:
        ValueError: the frequency of that mode is beyond the range of floating-point numbers.
    """
    w0x, w0y, w0z, w1, w2, k1, k2 = constants[:7]
    fastest: float = physics.fastest_frequency(max(w0x, w0y, w0z), w1, w2, k1, k2)
    needed = control_period * max(1.0 / integrators.LONGEST_STEP, fastest / integrators.LARGEST_PHASE)
    if not math.isfinite(needed + fastest):
        raise ValueError(
            f"parameters k1 = {k1}, k2 = {k2} with these masses: the springs' frequency is beyond the range of "
            "floating-point numbers; must be softer springs or heavier masses"
        )
    return max(1, math.ceil(needed - 1e-9))


def _bounded_steps(scenario: Scenario, parameters: Parameters) -> int:
    """`steps_in`, if they are so few that a control period of this environment ends in a few seconds.

    Raises:
        ValueError: they are too many; or as `steps_in`.
    """
    steps = steps_in(scenario.control_period, parameters.constants(scenario.actuated_axes))
    if scenario.tolerance is not None:  # they are only its first guess then
        return min(steps, integrators.MOST_STEPS)
    if steps > integrators.MOST_FIXED_STEPS:
        raise ValueError(
            f"control_period = {scenario.control_period} with k1 = {parameters.k1}, k2 = {parameters.k2} and these "
            f"masses: needs {steps:.6g} steps of the splitting, must be at most {integrators.MOST_FIXED_STEPS}; take a "
            "shorter control_period, softer springs or heavier masses, or the adaptive scheme (tolerance=1e-9)"
        )
    return steps


def template(scenario: Scenario, parameters: Parameters) -> FloatArray:
    """All fields of a pendulum with these parameters that was just placed, but for its state; shape (FIELDS,).

    Raises:
        ValueError: with these parameters a control period takes too many steps, or numbers leave the range of
            floating-point numbers.
    """
    fields = np.zeros(FIELDS)
    heights = scenario.spring_heights(parameters)
    fields[FRESH] = 1.0
    with np.errstate(all="ignore"):  # what overflows is refused below
        fields[PHYSICS : PHYSICS + 11] = parameters.constants(scenario.actuated_axes)
        fields[DRAG : DRAG + 3] = parameters.drag_rates()
        fields[MASSES : MASSES + 3] = parameters.m0, parameters.m1, parameters.m2
        fields[HEIGHTS : HEIGHTS + 2] = heights
        fields[REST_ENERGY] = unchecked_energy(parameters, vertical_state(*heights))
    if not np.isfinite(fields).all():
        raise ValueError(
            f"parameters = {parameters}: must leave the energy at rest, forces over masses and drag over masses within "
            "the range of floating-point numbers"
        )
    fields[STEPS] = _bounded_steps(scenario, parameters)
    if parameters is scenario.parameters and scenario.randomise:
        fastest = {name: low if name[0] == "m" else high for name, (low, high) in scenario.randomise.items()}
        _bounded_steps(scenario, parameters.replace(fastest))
    return fields


def cell(scenario: Scenario, state: FloatArray) -> FloatArray:
    """A pendulum on its way from a state, shape (18,), in a cell, shape (CELL,)."""
    numbers = np.zeros(CELL)
    numbers[:FIELDS] = template(scenario, scenario.parameters)
    numbers[STATE : STATE + 18] = state
    numbers[FRESH] = 0.0
    numbers[CELL_SETTINGS:SPREAD] = settings_of(scenario)
    return numbers


def fill(rows: FloatArray, indices: NDArray[np.intp], fields: FloatArray, states: FloatArray) -> None:
    """Puts pendulums in their places in `rows`; those that are as usual `kernels.place` puts there faster.

    Args:
        rows: shape (blocks, FIELDS, WIDTH), written.
        indices: which pendulums, shape (n,).
        fields: their `template`s, shape (FIELDS,) or (n, FIELDS).
        states: shape (n, 18).
    """
    blocks, columns = np.divmod(indices, WIDTH)
    rows[blocks, :, columns] = fields
    rows[blocks, STATE : STATE + 18, columns] = states
