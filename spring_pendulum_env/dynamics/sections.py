"""Poincare sections: where a motion passes through a plane of the state space.

The integrator's steps bracket a passage, and Brent's method closes in on it, each trial a step of the integrator of its
own: M. Henon's idea (Physica D 5 (1982) 412), with a root finder in place of his change of variables.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from spring_pendulum_env.dynamics.checks import checked_state, finite_number
from spring_pendulum_env.dynamics.flow import Flow
from spring_pendulum_env.dynamics.progress import Progress
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]

COORDINATES = ("X1", "Y1", "Z1", "X2", "Y2", "Z2", "VX1", "VY1", "VZ1", "VX2", "VY2", "VZ2")
"""Names of the state's numbers, in order; V stands for their rates."""

PIECE = 500
"""Steps that are taken and looked at together."""


@dataclasses.dataclass(frozen=True)
class Section:
    """The plane coefficients . state = value. `Section.at("X1")` is a short way to write one.

    Raises:
        ValueError: not twelve finite coefficients, all of them zero, or a direction other than -1, 0, 1.
    """

    coefficients: tuple[float, ...]
    """One for each number of the state."""
    value: float = 0.0
    direction: int = 1
    """1: crossings with coefficients . state rising; -1: falling; 0: both."""

    def __post_init__(self) -> None:
        normal = checked_state(self.coefficients, "coefficients")
        if not normal.any():
            raise ValueError(f"coefficients = {self.coefficients!r}: must not all be 0")
        if finite_number("direction", self.direction) not in (-1, 0, 1):
            raise ValueError(f"direction = {self.direction!r}: must be 1 (rising), -1 (falling) or 0 (both)")
        object.__setattr__(self, "direction", int(self.direction))
        object.__setattr__(self, "coefficients", tuple(float(number) for number in normal))
        object.__setattr__(self, "value", finite_number("value", self.value))

    @classmethod
    def at(cls, coordinate: str, value: float = 0.0, direction: int = 1) -> Section:
        """Where one coordinate, by its name in COORDINATES, has a value (m or m/s).

        Raises:
            ValueError: no such coordinate, or as the class.
        """
        if not isinstance(coordinate, str) or coordinate not in COORDINATES:
            raise ValueError(f"coordinate = {coordinate!r}: must be one of {', '.join(COORDINATES)}")
        return cls(tuple(float(name == coordinate) for name in COORDINATES), value, direction)

    def __str__(self) -> str:
        terms = [
            name if factor == 1 else f"{factor:g} {name}"
            for name, factor in zip(COORDINATES, self.coefficients, strict=True)
            if factor != 0
        ]
        return f"{' + '.join(terms)} = {self.value:g}"


class NotCrossedError(ArithmeticError):
    """A motion doesn't pass through a section in the time that it was followed."""


@dataclasses.dataclass(frozen=True)
class Crossings:
    """Where a motion passes through a section, in order."""

    times: FloatArray
    """s since the start; shape (n,)."""
    states: FloatArray
    """Positions in m, then velocities in m/s; shape (n, 12)."""
    directions: NDArray[np.int64]
    """1 where coefficients . state rises, -1 where it falls; shape (n,)."""


def poincare_section(
    parameters: Parameters | Mapping[str, float] | None,
    state: ArrayLike,
    section: Section,
    duration: float = 1_000.0,
    *,
    transient: float = 0.0,
    longest_step: float | None = None,
    progress: bool = False,
) -> Crossings:
    """Follows a motion and locates where it passes through a plane.

    Where the sign changes within a step of the integration, the length of the step that ends in the plane is found by
    Brent's method, so that each crossing lies in it to rounding, on the very motion that is integrated. (To step onto
    the plane instead of interpolating: M. Henon, "On the numerical computation of Poincare maps", Physica D 5 (1982)
    412-414; his change of the independent variable isn't needed where a step may have any length.) Where the motion
    turns back within a step, the point where it turns is looked at too, so no pair of crossings is lost, unless it
    turns more than once in a step.

    Args:
        parameters: the constants, or a mapping of some of them.
        state: positions X1 Y1 Z1 X2 Y2 Z2 in m, then their rates in m/s; shape (12,). A start in the plane is no
            crossing.
        section: the plane, and which crossings count.
        duration: for how long the motion is followed, s.
        transient: time before that, s.
        longest_step: of the integration, s, as for `Flow`; None: as the environments'.
        progress: draw a progress bar.

    Raises:
        ValueError: a wrong argument.
        NotCrossedError: there is no such crossing; the message says how close the motion comes.
        ArithmeticError: a spring passes through zero length, or the motion is beyond what floats can hold.
    """
    start = checked_state(state)
    flow = Flow(parameters, longest_step)
    if not isinstance(section, Section):
        raise ValueError(f"section = {section!r}: must be a Section, for example Section.at('X1')")
    positive_number("duration", duration)
    positive_number("transient", transient, zero=True)
    points = np.zeros((24, 1))
    points[:12, 0] = start
    if transient > 0:
        flow.advance(points, transient)
    watched = _Watched(flow, section)
    pieces = max(1, round(flow.steps(duration) / PIECE))
    with Progress("section", pieces, show=progress) as bar:
        for number in range(pieces):
            watched.follow(points, number * duration / pieces, duration / pieces)
            bar.add(1)
    if not watched.found:
        way = {1: " with its left side rising", -1: " with its left side falling", 0: ""}[section.direction]
        raise NotCrossedError(
            f"the section {section} isn't crossed{way} in {duration:g} s: "
            f"that side lies between {watched.lowest:.6g} and {watched.highest:.6g}"
        )
    times, states, directions = zip(*watched.found, strict=True)
    return Crossings(np.array(times), np.array(states), np.array(directions, dtype=np.int64))


class _Watched:
    """A motion whose height over a section is watched."""

    def __init__(self, flow: Flow, section: Section) -> None:
        self._flow = flow
        self._section = section
        self._normal = np.array(section.coefficients)
        self.found: list[tuple[float, FloatArray, int]] = []
        self.lowest, self.highest = np.inf, -np.inf

    def follow(self, points: FloatArray, time: float, duration: float) -> None:
        """Moves a state on and notes the crossings on the way."""
        before = points[:12, 0].copy()
        record = self._flow.advance(points, duration, record=True)[:, :12, 0]
        states = np.concatenate([before[None], record])
        heights = self._along(states)
        self.lowest, self.highest = min(self.lowest, heights.min()), max(self.highest, heights.max())
        heights -= self._section.value
        rates = self._along(self._flow.slope(states))
        step = duration / len(record)
        # A step that ends in the plane has crossed it; one that starts there hasn't.
        crossed = (heights[:-1] * heights[1:] < 0) | ((heights[1:] == 0) & (heights[:-1] != 0))
        turned = (heights[:-1] * heights[1:] > 0) & (heights[:-1] * rates[:-1] < 0) & (heights[1:] * rates[1:] > 0)
        for number in np.flatnonzero(crossed | turned):
            state = states[number]
            moments = [0.0, step]
            if turned[number]:
                moments.insert(1, self._root(state, self._rate, 0.0, step))
            ends = [self._height(state, moment) for moment in moments]
            for k in range(len(moments) - 1):
                direction = int(np.sign(ends[k + 1]) or -np.sign(ends[k]))
                if ends[k] * direction < 0 and self._section.direction in (0, direction):
                    moment = self._root(state, self._height, moments[k], moments[k + 1])
                    self.found.append((time + number * step + moment, self._stepped(state, moment), direction))

    def _root(self, state: FloatArray, of: Callable[[FloatArray, float], float], low: float, high: float) -> float:
        """How long after a state a quantity that has opposite signs at two times is zero."""
        return float(brentq(lambda moment: of(state, moment), low, high, xtol=1e-18, rtol=1e-15))

    def _height(self, state: FloatArray, moment: float) -> float:
        return float(self._along(self._stepped(state, moment)[None])[0]) - self._section.value

    def _rate(self, state: FloatArray, moment: float) -> float:
        return float(self._along(self._flow.slope(self._stepped(state, moment)[None]))[0])

    def _along(self, vectors: FloatArray) -> FloatArray:
        """Components along the plane's normal, with the same bits for one vector and for many; shape (n,)."""
        components: FloatArray = (vectors * self._normal).sum(axis=-1)
        return components

    def _stepped(self, state: FloatArray, duration: float) -> FloatArray:
        """The state after part of a step, by a step of that length."""
        if duration == 0.0:
            return state
        points = np.zeros((24, 1))
        points[:12, 0] = state
        self._flow.advance(points, duration)
        return points[:12, 0].copy()
