"""A task with its arguments, checked once: shared by the single and the vector environment.

A scenario knows which parameters and which start an episode gets; it never integrates.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any, Literal, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import tasks
from spring_pendulum_env.equilibria import spring_lengths, vertical_state
from spring_pendulum_env.physics import AXES, Parameters
from spring_pendulum_env.tasks import Task

FloatArray = NDArray[np.float64]
Tolerance = float | None | Literal["default"]

START_NUMBERS = 12
"""Normal random numbers that a start takes: displacements and velocities of the two masses."""

SMALLEST_TOLERANCE = 1e-14
"""Below this, rounding alone would keep the adaptive scheme from ever being content."""


SMALLEST_SIZE, LARGEST_SIZE = 1e-100, 1e100
"""Of arguments whose squares and inverses must stay within the range of floating-point numbers."""


def positive_number(name: str, value: Any, *, zero: bool = False) -> float:
    """`value` as a float.

    Raises:
        ValueError: it isn't a finite number above zero (or zero, where that is allowed).
    """
    try:
        number = math.nan if isinstance(value, (str, bytes, bool)) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number) or number < 0 or (number == 0 and not zero):
        raise ValueError(f"{name} = {value!r}: must be a finite number {'>= 0' if zero else '> 0'}")
    return number


def _moderate_number(name: str, value: Any) -> float:
    """A positive number between SMALLEST_SIZE and LARGEST_SIZE; raises like `positive_number`."""
    number = positive_number(name, value)
    if not SMALLEST_SIZE <= number <= LARGEST_SIZE:
        raise ValueError(f"{name} = {value!r}: must be a number from {SMALLEST_SIZE} to {LARGEST_SIZE}")
    return number


def real_numbers(value: Any) -> FloatArray:
    """`value` as an array of float64; neither text nor complex numbers are taken for numbers.

    Raises:
        TypeError, ValueError, OverflowError: it isn't one.
    """
    array = np.asarray(value)
    if array.dtype.kind == "O":  # fractions and the like
        return np.array([_real(entry) for entry in array.flat], dtype=np.float64).reshape(array.shape)
    return array.astype(np.float64, order="C", casting="same_kind", copy=False)


def _real(value: Any) -> float:
    if isinstance(value, (str, bytes)):
        raise TypeError(f"{value!r} is text")
    return float(value)


def _tolerance(value: Tolerance, task: Task) -> float | None:
    if isinstance(value, str) and value == "default":
        return task.tolerance
    if value is None:
        return None
    number = positive_number("tolerance", value)
    if number < SMALLEST_TOLERANCE:
        raise ValueError(f"tolerance = {value!r}: must be None or a number >= {SMALLEST_TOLERANCE}")
    return number


def _axes(value: Any) -> str:
    if not isinstance(value, str) or any(axis not in AXES for axis in value) or len(set(value)) != len(value):
        raise ValueError(f"actuated_axes = {value!r}: must name each of x, y, z at most once, for example 'xz'")
    return "".join(axis for axis in AXES if axis in value)


def _ranges(value: Any) -> dict[str, tuple[float, float]]:
    """The ranges of `randomise`, in the order of the parameters so that draws don't depend on the mapping's order."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ValueError(f"randomise = {value!r}: must be a mapping of parameter names to (low, high)")
    for name in value:
        if name not in Parameters.names():
            raise ValueError(f"randomise: unknown parameter {name!r}: must be one of {', '.join(Parameters.names())}")
    ranges = {}
    for name in Parameters.names():
        if name not in value:
            continue
        bounds = value[name]
        try:
            low, high = bounds
            for bound in (low, high):
                Parameters.of({name: bound})
        except (TypeError, ValueError) as error:
            raise ValueError(f"randomise[{name!r}] = {bounds!r}: must be two values (low, high); {error}") from None
        if low > high:
            raise ValueError(f"randomise[{name!r}] = {bounds!r}: low must not exceed high")
        ranges[name] = (float(low), float(high))
    return ranges


class Random(Protocol):
    """What a scenario needs of a random number generator; NumPy's has it."""

    def uniform(self, low: float, high: float) -> float: ...
    def standard_normal(self, size: int) -> FloatArray: ...


class Arguments(TypedDict, total=False):
    """The arguments of `gym.make` that a scenario is made of; the manual of `SpringPendulumEnv` describes them."""

    parameters: Parameters | Mapping[str, float] | None
    control_period: float
    tolerance: Tolerance
    randomise: Mapping[str, tuple[float, float]] | None
    start_scale: float
    max_force: float | None
    anchor_travel: float | None
    actuated_axes: str | None
    equilibrium: str | None


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A task and its arguments, all valid. Build it with `Scenario.of`."""

    task: Task
    parameters: Parameters
    control_period: float
    tolerance: float | None
    randomise: Mapping[str, tuple[float, float]]
    start_scale: float
    max_force: float
    anchor_travel: float
    actuated_axes: str
    equilibrium: str

    @classmethod
    def of(cls, task: Task, **arguments: Unpack[Arguments]) -> Scenario:
        """A scenario from the arguments of `gym.make`, None standing for the task's default.

        Raises:
            ValueError: an argument is wrong, or doesn't apply to the task.
            TypeError: there is no argument of that name.
        """
        for name in arguments:
            if name not in Arguments.__annotations__:
                allowed = ", ".join(Arguments.__annotations__)
                raise TypeError(f"unknown argument {name!r}: must be one of {allowed}")
        max_force = arguments.get("max_force")
        anchor_travel = arguments.get("anchor_travel")
        actuated_axes = arguments.get("actuated_axes")
        equilibrium = arguments.get("equilibrium")
        if not task.actuated:
            actuation = {"max_force": max_force, "anchor_travel": anchor_travel, "actuated_axes": actuated_axes}
            for name, value in actuation.items():
                if value is not None:
                    raise ValueError(f"{name} = {value!r}: the task {task.name!r} takes no such argument")
            max_force, anchor_travel, actuated_axes = 1.0, math.inf, ""
        else:
            max_force = _moderate_number("max_force", 20.0 if max_force is None else max_force)
            anchor_travel = positive_number("anchor_travel", 2.0 if anchor_travel is None else anchor_travel)
            actuated_axes = _axes(AXES if actuated_axes is None else actuated_axes)
        if equilibrium is not None and not task.chooses_equilibrium:
            raise ValueError(f"equilibrium = {equilibrium!r}: the task {task.name!r} takes no such argument")
        scenario = cls(
            task=task,
            parameters=Parameters.of(arguments.get("parameters")),
            control_period=_moderate_number("control_period", arguments.get("control_period", 0.02)),
            tolerance=_tolerance(arguments.get("tolerance", "default"), task),
            randomise=_ranges(arguments.get("randomise")),
            start_scale=positive_number("start_scale", arguments.get("start_scale", 1.0), zero=True),
            max_force=max_force,
            anchor_travel=anchor_travel,
            actuated_axes=actuated_axes,
            equilibrium=task.equilibrium if equilibrium is None else equilibrium,
        )
        # The worst case that can be drawn must have its equilibrium too: a long heavy chain on short soft springs.
        worst = {name: low if name[0] in "kL" else high for name, (low, high) in scenario.randomise.items()}
        for parameters in (scenario.parameters, scenario.parameters.replace(worst)):
            scenario.spring_heights(parameters)
            scenario.start_heights(parameters)
        return scenario

    @property
    def state_size(self) -> int:
        """Numbers in an observation: 18 where the anchor moves, else 12."""
        return 18 if self.task.actuated else 12

    @functools.cached_property
    def rest(self) -> FloatArray:
        """The state, shape (18,), that the task is about, with the usual parameters."""
        return vertical_state(*self.spring_heights(self.parameters))

    @functools.cached_property
    def start(self) -> FloatArray:
        """The state, shape (18,), about which episodes with the usual parameters start."""
        return vertical_state(*self.start_heights(self.parameters))

    @functools.cached_property
    def spread(self) -> FloatArray:
        """Standard deviations of the masses' start positions, m, and velocities, m/s, shape (START_NUMBERS,)."""
        displacements = [self.start_scale * self.task.start_displacement] * 6
        velocities = [self.start_scale * self.task.start_velocity] * 6
        return np.array(displacements + velocities)

    def spring_heights(self, parameters: Parameters) -> tuple[float, float]:
        """Where the far end of each spring belongs, relative to its near end, m on the z axis.

        The passive task without one of its springs has no rest; there they are the unstretched lengths, hanging.
        """
        return self._heights(parameters, self.equilibrium)

    def start_heights(self, parameters: Parameters) -> tuple[float, float]:
        """The same at the state about which episodes start: where they belong, unless the task is to get there."""
        return self._heights(parameters, self.task.start_equilibrium or self.equilibrium)

    def _heights(self, parameters: Parameters, equilibrium: str) -> tuple[float, float]:
        if not self.task.actuated and 0.0 in (parameters.k1, parameters.k2):
            return -parameters.L1, -parameters.L2
        return spring_lengths(parameters, equilibrium)

    def draw(self, random: Random, options: Mapping[str, Any] | None) -> tuple[Parameters, FloatArray]:
        """Parameters and start of an episode: drawn, or as the options of `reset` say.

        Returns:
            The parameters, and a state of shape (18,).

        Raises:
            ValueError: an unknown option, or a wrong state or parameter in the options.
        """
        options = {} if options is None else options
        if not isinstance(options, Mapping):
            raise ValueError(f"options = {options!r}: must be a mapping of 'state' and 'parameters', or None")
        for option in options:
            if option not in ("state", "parameters"):
                raise ValueError(f"unknown option {option!r}: must be 'state' or 'parameters'")
        drawn = {name: float(random.uniform(low, high)) for name, (low, high) in self.randomise.items()}
        parameters = self.parameters.replace(drawn).replace(options.get("parameters"))
        about = self.start if parameters is self.parameters else vertical_state(*self.start_heights(parameters))
        if options.get("state") is not None:
            return parameters, self.checked_state(options["state"])
        return parameters, self.start_from(about, random.standard_normal(START_NUMBERS))

    def start_from(self, about: FloatArray, noise: FloatArray) -> FloatArray:
        """A state of shape (18,) about the state `about` from START_NUMBERS normal random numbers."""
        start = about.copy()
        masses = start.reshape(2, 9)[:, 3:]  # positions, then velocities
        masses[...] = tasks.displaced(masses, self.spread.reshape(2, 6), noise.reshape(2, 6))
        return start

    def checked_state(self, state: Any) -> FloatArray:
        """A state in the observation's layout as 18 numbers.

        Raises:
            ValueError: wrong shape, not finite, or a held axis of the anchor that moves.
        """
        try:
            given = real_numbers(state) + 0.0  # a copy without negative zeros, see layout.KNOWN
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"state = {state!r}: must be {self.state_size} numbers") from None
        if given.shape != (self.state_size,):
            raise ValueError(f"state of shape {given.shape}: must have shape ({self.state_size},)")
        if not np.isfinite(given).all():
            raise ValueError(f"state = {given}: must be finite")
        if self.state_size == 12:
            full = np.zeros(18)
            full[3:9], full[12:18] = given[:6], given[6:]
            return full
        for number, axis in enumerate(AXES):
            if axis not in self.actuated_axes and given[9 + number] != 0.0:
                raise ValueError(
                    f"state[{9 + number}] = {given[9 + number]}: the anchor is held along {axis}, so its velocity "
                    f"there must be 0 (actuated_axes = {self.actuated_axes!r})"
                )
        return given
