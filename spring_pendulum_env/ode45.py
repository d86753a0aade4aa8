"""MATLAB's ode45 as a solver for SciPy's solve_ivp: the pair is that of SciPy's RK45, the control of the step is not.

Sources: L. F. Shampine and M. W. Reichelt, "The MATLAB ODE Suite", SIAM J. Sci. Comput. 18 (1997) 1-22; MATLAB's
documentation of ode45 and odeset; and, for the finer rules of the control, what is known of ode45 itself, which comes
as readable text with MATLAB. We had no MATLAB to compare with: the tests compare with an independent model of the same
rules, and each rule with its own prediction. GNU Octave's ode45 is another program with other rules.

- The pair is the one of J. R. Dormand and P. J. Prince, "A family of embedded Runge-Kutta formulae", J. Comput. Appl.
  Math. 6 (1980) 19-26. The formula of order 5 is continued; the one of order 4 beside it estimates the error.
- Of all components the largest relative error counts (infinity norm), each relative to the larger size of the component
  at both ends of the step, or to the threshold AbsTol / RelTol where that is larger.
- A step whose error exceeds RelTol is tried again: the first time 0.8 (RelTol / error)^(1/5) as long, but not below a
  tenth; after that half as long each time. The step after such a one doesn't grow.
- Otherwise the next step is 0.8 (RelTol / error)^(1/5) as long, at most five times.
- Along the first slope, the first step would change no component by more than 0.8 RelTol^(1/5) of its size (or of the
  threshold); and it isn't longer than the gap between the first two instants asked for.
- No step is longer than a tenth of the interval, or shorter than 16 spacings of the floating-point numbers at t. A step
  that would leave less than a tenth of itself goes to the end.
- RelTol is 1e-3 and AbsTol 1e-6 where nothing is said.
- Where only the ends of the interval are given, the output has four points for each step (Refine): its end, and three
  from the interpolant of order 4 that costs no further slope.

SciPy's RK45 makes other steps, and at loose tolerances other errors: its norm is a root mean square, its tolerance the
sum AbsTol + RelTol |y|, its safety factor 0.9, and its steps may grow tenfold.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import RK45, DenseOutput, OdeSolver

from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]
Slope = Callable[[float, FloatArray], ArrayLike]

RELATIVE_TOLERANCE = 1e-3
ABSOLUTE_TOLERANCE = 1e-6
REFINE = 4
"""Points of output for each step."""

SAFETY = 0.8
EXPONENT = 1.0 / 5.0
LARGEST_GROWTH = 5.0
SMALLEST_SHRINKAGE = 0.1  # of a step that failed once
FURTHER_SHRINKAGE = 0.5  # of one that failed again
LARGEST_SHARE = 0.1  # of the interval, in one step
SPACINGS = 16  # of floating-point numbers, in the smallest step
STRETCH = 1.1  # a step that would leave less than this of itself goes to the end

INTERPOLANT: FloatArray = np.array(
    [
        [1, -183 / 64, 37 / 12, -145 / 128],
        [0, 0, 0, 0],
        [0, 1500 / 371, -1000 / 159, 1000 / 371],
        [0, -125 / 32, 125 / 12, -375 / 64],
        [0, 9477 / 3392, -729 / 106, 25515 / 6784],
        [0, -11 / 7, 11 / 3, -55 / 28],
        [0, 3 / 2, -4, 5 / 2],
    ]
)
"""Row s holds the coefficients of x, x^2, x^3, x^4 in the weight of slope s at the fraction x of a step. Of order 4,
with the slopes of both ends; the tests check the conditions for that."""


class ODE45(OdeSolver):  # type: ignore[misc] # SciPy is untyped
    """MATLAB's ode45, for `scipy.integrate.solve_ivp(..., method=ODE45)`.

    Args:
        fun: slope(t, y), shape (n,).
        t0: the first instant.
        y0: the state there, shape (n,).
        t_bound: the last instant.
        rtol: relative tolerance, at least 100 times the machine's precision.
        atol: absolute tolerance, one number or one for each component.
        first_gap: gap between the first two instants of output, which the first step doesn't exceed.
        vectorized: as for SciPy's solvers.

    Attributes:
        steps: steps made.
        failures: steps tried in vain.

    Raises:
        ValueError: an instant isn't finite, a tolerance or the gap isn't positive and finite, or `atol` has another
            shape than the state.
    """

    t: float
    y: FloatArray

    def __init__(
        self,
        fun: Slope,
        t0: float,
        y0: ArrayLike,
        t_bound: float,
        rtol: float = RELATIVE_TOLERANCE,
        atol: ArrayLike = ABSOLUTE_TOLERANCE,
        first_gap: float | None = None,
        vectorized: bool = False,
    ) -> None:
        for name, instant in (("t0", t0), ("t_bound", t_bound)):
            if not np.isfinite(instant):
                raise ValueError(f"{name} = {instant!r}: must be a finite number")
        super().__init__(fun, t0, y0, t_bound, vectorized)
        self.rtol = max(positive_number("rtol", rtol), 100.0 * float(np.finfo(float).eps))
        for tolerance in np.ravel(np.asarray(atol, dtype=object)):
            positive_number("atol", tolerance)
        self.threshold = np.asarray(atol, dtype=np.float64) / self.rtol
        if self.threshold.shape not in ((), (self.n,)):
            raise ValueError(f"atol of shape {self.threshold.shape}: must be one number or have shape ({self.n},)")
        self.steps = 0
        self.failures = 0
        self.slopes = np.empty((7, self.n))
        self.slopes[0] = self.fun(self.t, self.y)
        self.y_old = self.y
        interval = abs(t_bound - t0)
        self.longest = LARGEST_SHARE * interval
        gap = interval if first_gap is None else positive_number("first_gap", first_gap)
        self.next_step = self._first_step(min(self.longest, gap))

    def _first_step(self, longest: float) -> float:
        sizes = np.maximum(np.abs(self.y), self.threshold)
        rate = float(np.max(np.abs(self.slopes[0]) / sizes, initial=0.0)) / (SAFETY * self.rtol**EXPONENT)
        return max(1.0 / rate if longest * rate > 1.0 else longest, self._shortest())

    def _shortest(self) -> float:
        return float(SPACINGS * np.spacing(abs(self.t)))

    def _stages(self, t_new: float) -> tuple[FloatArray, float]:
        """The state at `t_new`, and the largest relative error in it."""
        step = t_new - self.t
        for stage in range(1, 6):
            change = step * (RK45.A[stage, :stage] @ self.slopes[:stage])
            self.slopes[stage] = self.fun(self.t + step * RK45.C[stage], self.y + change)
        y_new: FloatArray = self.y + step * (RK45.B @ self.slopes[:6])
        self.slopes[6] = self.fun(t_new, y_new)
        sizes = np.maximum(np.maximum(np.abs(self.y), np.abs(y_new)), self.threshold)
        return y_new, abs(step) * float(np.max(np.abs(RK45.E @ self.slopes) / sizes))

    def _step_impl(self) -> tuple[bool, str | None]:
        """One step, of a length whose error is small enough; the interface of SciPy's solvers."""
        if self.steps:
            self.slopes[0] = self.slopes[6]
        shortest = self._shortest()
        length = min(self.longest, max(shortest, self.next_step))
        left = abs(self.t_bound - self.t)
        last = STRETCH * length >= left
        if last:
            length = left
        failed = False
        while True:
            t_new = self.t_bound if last else self.t + self.direction * length
            with np.errstate(over="ignore", invalid="ignore"):  # a step that runs away is tried again, shorter
                y_new, error = self._stages(t_new)
            if error <= self.rtol:
                break
            self.failures += 1
            last = False
            if length <= shortest:
                return False, f"a step of {length:.3g} s is the shortest allowed, and its error still too large"
            shrinkage = FURTHER_SHRINKAGE
            if not failed:
                shrinkage = max(SMALLEST_SHRINKAGE, SAFETY * (self.rtol / error) ** EXPONENT)
            length = max(shortest, shrinkage * length)
            failed = True
        if not failed:
            shortfall = (error / self.rtol) ** EXPONENT / SAFETY
            length = length / shortfall if shortfall > 1.0 / LARGEST_GROWTH else length * LARGEST_GROWTH
        self.next_step = length
        self.steps += 1
        self.y_old = self.y
        self.t = t_new
        self.y = y_new
        return True, None

    def _dense_output_impl(self) -> Interpolant:
        return Interpolant(self.t_old, self.t, self.y_old, self.slopes.T @ INTERPOLANT)


class Interpolant(DenseOutput):  # type: ignore[misc] # SciPy is untyped
    """The state within a step, of order 4."""

    def __init__(self, t_old: float, t: float, y_old: FloatArray, coefficients: FloatArray) -> None:
        super().__init__(t_old, t)
        self.y_old = y_old
        self.coefficients = coefficients

    def _call_impl(self, t: FloatArray) -> FloatArray:
        step = self.t - self.t_old
        fraction = (t - self.t_old) / step
        powers = fraction ** np.arange(1, 5).reshape(4, *[1] * np.ndim(t))
        start = self.y_old.reshape(-1, *[1] * np.ndim(t))
        state: FloatArray = start + step * (self.coefficients @ powers)
        return state if np.ndim(t) else state.reshape(-1)


def refined(solver: ODE45, refine: int = REFINE) -> tuple[FloatArray, FloatArray]:
    """Run a solver to its end and keep what ode45 puts out where only the ends of the interval are given.

    Args:
        solver: a fresh one.
        refine: points for each step, its end among them; 1 keeps the steps alone.

    Returns:
        The instants, shape (refine * steps + 1,), and the states there, shape (refine * steps + 1, n).

    Raises:
        ArithmeticError: no step is short enough; the message says when.
        ValueError: `refine` isn't a whole number above zero.
    """
    if isinstance(refine, bool) or not isinstance(refine, (int, np.integer)) or refine < 1:
        raise ValueError(f"refine = {refine!r}: must be a whole number > 0")
    fractions = np.arange(1, refine) / refine
    times: list[Any] = [[solver.t]]
    states: list[Any] = [solver.y[None, :]]
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed" or not math.isfinite(solver.t):
            raise ArithmeticError(f"ode45 stopped at t = {solver.t} s: {message}")
        between = solver.t_old + (solver.t - solver.t_old) * fractions
        times += [between, [solver.t]]
        states += [solver.dense_output()(between).T, solver.y[None, :]]
    return np.concatenate(times), np.concatenate(states)
