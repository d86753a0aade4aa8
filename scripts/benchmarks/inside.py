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
    from spring_pendulum_env.kernels.batch import step_batch
    from spring_pendulum_env.layout import FIELDS, OUTCOMES, WIDTH, fill, settings_of, steps_in, template
    from spring_pendulum_env.scenario import START_NUMBERS, Scenario
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
    scenario = Scenario.of(
        tasks.task_named("damping"),
        control_period=control_period,
        start_scale=start_scale,
        anchor_travel=1e9,  # so that no row ends, and none needs a start
    )
    rows = np.zeros((-(-size // WIDTH), FIELDS, WIDTH))
    random = np.random.default_rng(0)
    states = np.array([scenario.draw(random, None)[1] for _ in range(size)])
    fill(rows, np.arange(size), template(scenario, scenario.parameters), states)
    settings = settings_of(scenario)
    stepping(rows, settings, size)()  # only reports what was just placed
    return rows, settings, size


def stepping(rows: FloatArray, settings: FloatArray, size: int) -> Callable[[], None]:
    """The one compiled call of a vector step: actions in, the step, all that it reports out."""
    actions = np.random.default_rng(0).uniform(-1, 1, (size, 3))
    outcomes = np.empty((OUTCOMES, size))
    outputs = (
        np.empty((size, 18)),
        outcomes,
        np.empty((size, 3)),
        np.empty(size),
        np.empty(size, dtype=np.bool_),
        np.empty(size, dtype=np.bool_),
    )
    nobody = np.zeros(size, dtype=np.bool_)  # has ended
    starts = np.empty(FIELDS + START_NUMBERS), np.empty((size, 1, START_NUMBERS)), np.zeros(size, dtype=np.int64)
    return partial(step_batch, rows, np.arange(size), nobody, *starts, settings, actions, *outputs)
