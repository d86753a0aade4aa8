"""How pendulums are laid out in memory for the compiled step, and how one is put there.

Pendulums are kept in `rows`, an array of shape (blocks, FIELDS, width): each block holds `width` pendulums side by
side, one field after the other. A single environment is one block of width one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import integrators, physics, tasks
from spring_pendulum_env.equilibria import energy, vertical_state
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import Scenario

FloatArray = NDArray[np.float64]

WIDTH = 64
"""Pendulums in a block."""

# The fields of a pendulum in `rows`, and where each begins.
STATE = 0  # 18: positions of anchor, m1, m2, then their velocities
FORCE = 18  # 3, newtons
PHYSICS = 21  # 11: Parameters.constants()
STEP = 32  # length of a step of the splitting, s
DRAG = 33  # 3: Parameters.drag_rates()
MASSES = 36  # 3
HEIGHTS = 39  # 2: where the springs' far ends belong
REST_ENERGY = 41
START_ENERGY = 42
CLOCK = 43  # control periods since the start
WORK = 44
DISSIPATED = 45
TIME = 46
ENERGY = 47
EXCESS = 48
ERROR = 49
REWARD = 50
ENDED = 51  # 1 where the task's condition to end is met
TERMS = 52  # 5: the weighted reward terms
STATUS = 57  # what went wrong in the step
ACTION = 58  # 3: in units of max_force, zero on held axes
STEPS = 61  # steps of the splitting in a control period
NEXT = 62  # 18: the state that a scheme arrived at
LOST = 80  # what drag took on the way
GUARDED = 81  # 1 where the splitting came too close to zero length
FRESH = 82  # 1 where it was just placed: the next step only reports it
FIELDS = 83

CHUNK = 512
"""Pendulums that are taken through all parts of a step before the next ones, to stay in the processor's cache."""

FINE, BAD_ACTION, NOT_FINITE, TOO_MANY_STEPS = range(4)

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
    WEIGHTS,  # 5, one for each reward term
) = range(11)
AXIS_SLOTS = WEIGHTS + len(tasks.REWARD_TERMS)  # 3: which axis each number of an action belongs to


def action_slice(actuated_axes: str) -> slice:
    """Where the numbers of an action stand among the fields; the axes in the order x, y, z."""
    if not actuated_axes:
        return slice(0, 0)
    first, last = (ACTION + physics.AXES.index(axis) for axis in (actuated_axes[0], actuated_axes[-1]))
    return slice(first, last + 1, 2 if actuated_axes == "xz" else 1)


def settings_of(scenario: Scenario) -> FloatArray:
    """The numbers that all pendulums of an environment share."""
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
            *(task.weights.get(term, 0.0) for term in tasks.REWARD_TERMS),
            *(physics.AXES.index(axis) for axis in scenario.actuated_axes),
        ]
    )


def steps_in(control_period: float, constants: tuple[float, ...]) -> int:
    """How many equal steps of the splitting a control period needs: no step longer than LONGEST_STEP, none in which
    the fastest mode of the springs turns further than LARGEST_PHASE."""
    w0x, w0y, w0z, w1, w2, k1, k2 = constants[:7]
    fastest: float = physics.fastest_frequency(max(w0x, w0y, w0z), w1, w2, k1, k2)
    needed = control_period * max(1.0 / integrators.LONGEST_STEP, fastest / integrators.LARGEST_PHASE)
    return max(1, math.ceil(needed - 1e-9))


def template(scenario: Scenario, parameters: Parameters) -> FloatArray:
    """All fields of a pendulum with these parameters that was just placed, but for its state; shape (FIELDS,)."""
    fields = np.zeros(FIELDS)
    constants = parameters.constants(scenario.actuated_axes)
    heights = scenario.spring_heights(parameters)
    steps = steps_in(scenario.control_period, constants)
    fields[PHYSICS : PHYSICS + 11] = constants
    fields[DRAG : DRAG + 3] = parameters.drag_rates()
    fields[MASSES : MASSES + 3] = parameters.m0, parameters.m1, parameters.m2
    fields[HEIGHTS : HEIGHTS + 2] = heights
    fields[STEP] = scenario.control_period / steps
    fields[STEPS] = steps
    fields[REST_ENERGY] = energy(parameters, vertical_state(*heights))
    fields[FRESH] = 1.0
    return fields


def fill(rows: FloatArray, index: int, fields: FloatArray, state: FloatArray) -> None:
    """Puts a pendulum in its place: the fields of its `template`, and its state of 18 numbers."""
    block, column = divmod(index, rows.shape[2])
    rows[block, :, column] = fields
    rows[block, STATE : STATE + 18, column] = state
