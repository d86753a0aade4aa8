"""The package's compiled step without the environment around it. Of the package's inside, all is imported here."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.measuring import FloatArray, SkippedError

MISSING = ""
"""What of the package's inside isn't there any more."""
try:
    from spring_pendulum_env import tasks
    from spring_pendulum_env.kernels import advance, step_batch
    from spring_pendulum_env.layout import CHUNK, CLOCK, FIELDS, STATUS, WIDTH, fill, settings_of, steps_in, template
    from spring_pendulum_env.scenario import Scenario
except ImportError as error:
    MISSING = f"the package's inside has changed ({error})"

CALM = 0.1
"""A spread of the start with which no spring comes close to zero length."""


def require(what: str) -> None:
    """Looks whether the package's inside is as this module expects.

    Raises:
        SkippedError: it isn't, so `what` can't be measured.
    """
    if MISSING:
        raise SkippedError(f"{what}: {MISSING}, skipped")


def integration_steps(control_period: float, constants: tuple[float, ...]) -> int:
    """Steps of the splitting in a control period of a pendulum with these `Parameters.constants()`."""
    require("integration steps")
    steps: int = steps_in(control_period, constants)
    return steps


def placed(size: int, control_period: float = 0.02, start_scale: float = 1.0) -> tuple[FloatArray, FloatArray, int]:
    """Rows for the compiled step, started as the damping task starts them, its settings, and the number of rows."""
    scenario = Scenario.of(tasks.task_named("damping"), control_period=control_period, start_scale=start_scale)
    width = min(size, WIDTH)
    rows = np.zeros((-(-size // width), FIELDS, width))
    random = np.random.default_rng(0)
    for index in range(size):
        parameters, state = scenario.draw(random, None)
        fill(rows, index, template(scenario, parameters), state)
    settings = settings_of(scenario)
    advanced(rows, settings, size)  # only reports what was just placed
    return rows, settings, size


def advanced(rows: FloatArray, settings: FloatArray, size: int) -> None:
    """The compiled step, on as many rows at a time as the vector environment takes."""
    for first in range(0, size, CHUNK):
        advance(rows, first, min(CHUNK, size - first), settings)


def stepping(rows: FloatArray, settings: FloatArray, size: int) -> Callable[[], None]:
    """The one compiled call of a vector step: actions in, the step, all that it reports out."""
    actions = np.random.default_rng(0).uniform(-1, 1, (size, 3))
    outcomes = np.empty((STATUS - CLOCK, size))
    outputs = (np.empty((size, 18)), outcomes, np.empty((size, 3)), np.empty(size, dtype=np.bool_))
    return partial(step_batch, rows, 0, size, settings, actions, *outputs)
