"""Taylor series of the motion, from the equations of physics.py themselves.

The functions of physics.py run on any kind of number; here they run on power series in time. A series knows how each of
its coefficients follows from those of the series it was made from, so that one pass through the graph gives one more
coefficient of everything, and the slopes' coefficients are the positions' and velocities' next ones (A. Jorba and
M. Zou, "A software package for the numerical integration of ODEs by means of high-order Taylor methods", Experimental
Mathematics 14 (2005) 99-117, sections 2 and 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpmath import mp, mpf

from spring_pendulum_env import Parameters, physics

ORDER = 44
DIGITS = 34
"""Of the largest relative error in a step."""


class Series:
    """A power series in time: its coefficients so far, and the rule for the next one.

    Args:
        graph: all series in the order in which they are to be extended; this one joins it.
        rule: from n to the coefficient of time to the power n; None where it is set from outside.
    """

    def __init__(self, graph: list[Series], rule: Callable[[int], Any] | None = None) -> None:
        self.graph = graph
        self.rule = rule
        self.c: list[Any] = []
        graph.append(self)

    def __add__(self, other: Any) -> Series:
        if isinstance(other, Series):
            return Series(self.graph, lambda n: self.c[n] + other.c[n])
        return Series(self.graph, lambda n: self.c[n] + (other if n == 0 else 0))

    __radd__ = __add__

    def __neg__(self) -> Series:
        return Series(self.graph, lambda n: -self.c[n])

    def __sub__(self, other: Any) -> Series:
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> Series:
        return self.__neg__().__add__(other)

    def __mul__(self, other: Any) -> Series:
        if isinstance(other, Series):
            return Series(self.graph, lambda n: mp.fdot(self.c[: n + 1], other.c[n::-1]))
        return Series(self.graph, lambda n: self.c[n] * other)

    __rmul__ = __mul__

    def __rtruediv__(self, number: Any) -> Series:
        quotient = Series(self.graph)
        quotient.rule = lambda n: ((number if n == 0 else 0) - mp.fdot(self.c[1 : n + 1], quotient.c[::-1])) / self.c[0]
        return quotient

    def __pow__(self, exponent: float) -> Series:
        if exponent != 0.5:
            raise ValueError(f"exponent = {exponent}: only square roots are needed, 0.5")
        root = Series(self.graph)
        root.rule = lambda n: (
            (self.c[n] - mp.fdot(root.c[1:], root.c[:0:-1])) / (2 * root.c[0]) if n else mp.sqrt(self.c[0])
        )
        return root

    def __eq__(self, other: object) -> bool:
        """physics.py asks this of a spring's length alone, and no case has a spring of zero length."""
        return False

    __hash__ = None  # type: ignore[assignment]


class Motion:
    """One pendulum.

    Args:
        parameters: the constants.
        actuated_axes: those along which the anchor moves.
        state: 18 numbers.
    """

    def __init__(self, parameters: Parameters, actuated_axes: str, state: Sequence[float]) -> None:
        exact: Any = Exact(parameters)
        constants = Parameters.constants(exact, actuated_axes)
        drag = Parameters.drag_rates(exact)
        self.graph: list[Series] = []
        self.variables = [Series(self.graph) for _ in range(18)]
        self.force = [Series(self.graph) for _ in range(3)]
        numbers: Any = (*self.variables, *self.force, *constants, *drag)
        slopes = physics.derivatives(*numbers)
        self.slopes = [slope if isinstance(slope, Series) else slope + 0 * self.variables[0] for slope in slopes]
        self.state = [mpf(number) for number in state]

    def advance(self, duration: Any, force: Sequence[Any]) -> None:
        """Moves the state by a duration in s under a force in N that is held."""
        left = duration
        while left > 0:
            self._expand(force)
            step = min(left, self._step())
            self.state = [mp.polyval(variable.c[::-1], step) for variable in self.variables]
            left -= step

    def _expand(self, force: Sequence[Any]) -> None:
        for series in self.graph:
            series.c = []
        for variable, number in zip(self.variables, self.state, strict=True):
            variable.c.append(number)
        for n in range(ORDER):
            for component, newton in zip(self.force, force, strict=True):
                component.c.append(mpf(newton) if n == 0 else mpf(0))
            for series in self.graph:
                if series.rule is not None:
                    series.c.append(series.rule(n))
            for variable, slope in zip(self.variables, self.slopes, strict=True):
                variable.c.append(slope.c[n] / (n + 1))

    def _step(self) -> Any:
        """How far the series may be trusted: where its last two terms fall below the tolerance."""
        size = max(abs(variable.c[0]) for variable in self.variables) + 1
        steps = []
        for n in (ORDER - 1, ORDER):
            last = max(abs(variable.c[n]) for variable in self.variables)
            if last > 0:
                steps.append((size * mpf(10) ** -DIGITS / last) ** (mpf(1) / n))
        return min(steps, default=mpf(1))


class Exact:
    """A record of parameters as exact numbers, for the methods of `Parameters` that only do arithmetic on them."""

    def __init__(self, parameters: Parameters) -> None:
        for name, value in parameters.as_dict().items():
            setattr(self, name, mpf(value))
