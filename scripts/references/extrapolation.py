"""The same motion by another method from other equations: Gragg's extrapolation, on Hamilton's equations.

The forces are the gradient of the potential energy, equation (34), taken by SymPy; nothing of the forces or
accelerations of physics.py is used. The integrator is the modified midpoint rule, whose error has even powers of the
step alone, extrapolated to a step of zero: E. Hairer, S. P. Norsett and G. Wanner, "Solving Ordinary Differential
Equations I", section II.9. Beside it the Jacobian of the same equations, for how fast errors grow.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import sympy
from mpmath import mpf
from numpy.typing import NDArray

from spring_pendulum_env import Parameters, physics

FloatArray = NDArray[np.float64]

COLUMNS = 14
"""Of the extrapolation table; midpoint steps 2, 4, 6, ..."""
DIGITS = 32
SAFETY = mpf("0.8")

CONSTANTS = sympy.symbols("m0 m1 m2 k1 k2 L1 L2 R0 R1 R2 g", positive=True)
FREE = sympy.symbols("free_x free_y free_z")  # 1 along an axis on which the anchor moves, 0 where it is held
FORCE = sympy.symbols("ux uy uz", real=True)
Q = sympy.symbols("x0 y0 z0 x1 y1 z1 x2 y2 z2", real=True)
P = sympy.symbols("px0 py0 pz0 px1 py1 pz1 px2 py2 pz2", real=True)


@functools.cache
def hamilton() -> list[Any]:
    """Rates of the 9 positions and the 9 momenta, on symbols: q' = dH/dp, p' = -dH/dq + force - drag."""
    m0, m1, m2, k1, k2, L1, L2, R0, R1, R2, g = CONSTANTS
    masses = [m0] * 3 + [m1] * 3 + [m2] * 3
    drags = [R0] * 3 + [R1] * 3 + [R2] * 3
    velocities = [p / m for p, m in zip(P, masses, strict=True)]
    moving: Any = (*velocities, m0, m1, m2)
    placed: Any = (*Q, m1, m2, k1, k2, L1, L2, g)
    kinetic, potential = physics.kinetic_energy(*moving), physics.potential_energy(*placed)
    H = sympy.nsimplify(kinetic + potential, rational=True)
    push = [*FORCE, *[0] * 6]
    moves = [*FREE, *[1] * 6]
    rates = [sympy.diff(H, p) * move for p, move in zip(P, moves, strict=True)]
    rates += [
        (-sympy.diff(H, q) + f - R * v) * move
        for q, f, R, v, move in zip(Q, push, drags, velocities, moves, strict=True)
    ]
    return rates


@functools.cache
def _compiled(kind: str) -> Callable[..., Any]:
    arguments = [*Q, *P, *FORCE, *FREE, *CONSTANTS]
    if kind == "jacobian":
        jacobian = sympy.Matrix(hamilton()).jacobian([*Q, *P])
        return sympy.lambdify(arguments, [hamilton(), jacobian], "numpy", cse=True)  # type: ignore[no-any-return]
    return sympy.lambdify(arguments, hamilton(), "mpmath", cse=True)  # type: ignore[no-any-return]


def _masses(parameters: Parameters) -> list[float]:
    return [parameters.m0] * 3 + [parameters.m1] * 3 + [parameters.m2] * 3


class Motion:
    """One pendulum; arguments as in taylor.py."""

    def __init__(self, parameters: Parameters, actuated_axes: str, state: Sequence[float]) -> None:
        values = [mpf(getattr(parameters, str(name))) for name in CONSTANTS]
        self._fixed = [*(mpf(axis in actuated_axes) for axis in physics.AXES), *values]
        self._masses = [mpf(mass) for mass in _masses(parameters)]
        self._canonical = [mpf(number) for number in state]
        for i, mass in enumerate(self._masses):
            self._canonical[9 + i] *= mass
        self._step = mpf("0.05")

    @property
    def state(self) -> list[Any]:
        """Positions, m, and velocities, m/s."""
        momenta = zip(self._canonical[9:], self._masses, strict=True)
        return [*self._canonical[:9], *(p / m for p, m in momenta)]

    def advance(self, duration: Any, force: Sequence[Any]) -> None:
        """Moves the state by a duration in s under a force in N that is held."""
        rates = _compiled("rates")
        push = [mpf(newton) for newton in force]

        def slope(y: list[Any]) -> list[Any]:
            return rates(*y, *push, *self._fixed)  # type: ignore[no-any-return]

        left = duration
        while left > 0:
            step = min(left, self._step)
            new, error = _extrapolated(slope, self._canonical, step)
            size = max(map(abs, new)) + 1
            ratio = error / (size * mpf(10) ** -DIGITS)
            factor = SAFETY * ratio ** (-mpf(1) / (2 * COLUMNS - 1)) if ratio > 0 else mpf(2)
            if ratio > 1:
                self._step = step * factor
                continue
            if step == self._step or factor < 1:
                self._step = step * min(factor, mpf(2))
            self._canonical = new
            left -= step


def _extrapolated(slope: Callable[[list[Any]], list[Any]], start: list[Any], step: Any) -> tuple[list[Any], Any]:
    """The state a step later, and the difference of the last two estimates in the table."""
    first = slope(start)
    row: list[list[Any]] = []
    for column in range(COLUMNS):
        count = 2 * (column + 1)
        h = step / count
        before = start
        now = [y + h * f for y, f in zip(start, first, strict=True)]
        for _ in range(count - 1):
            before, now = now, [y + 2 * h * f for y, f in zip(before, slope(now), strict=True)]
        above, row = row, [now]
        for k, coarser in enumerate(above):
            weight = 1 / (mpf(count) ** 2 / mpf(2 * (column - k)) ** 2 - 1)
            row.append([a + weight * (a - b) for a, b in zip(row[k], coarser, strict=True)])
    return row[-1], max(abs(a - b) for a, b in zip(row[-1], row[-2], strict=True))


def growth(
    parameters: Parameters,
    actuated_axes: str,
    state: Sequence[float],
    counts: Sequence[int],
    period: float,
    forces: FloatArray,
) -> list[float]:
    """By what factor a tiny error, made at any time before, can have grown at some instants.

    The variational equations give the matrix M(t) that carries an error from the start to t, so M(t) inverse(M(s))
    carries one from s; the factor is the largest 2-norm of these over s, with m and m/s counted alike.

    Args:
        counts: the instants, in control periods.
        period: s.
        forces: N, one row for each control period.
    """
    from scipy.integrate import solve_ivp

    evaluate = _compiled("jacobian")
    fixed = [float(axis in actuated_axes) for axis in physics.AXES]
    fixed += [getattr(parameters, str(name)) for name in CONSTANTS]
    scale = np.array([1.0] * 9 + _masses(parameters))  # momenta to velocities, so that errors are those of the state
    still = [i for i in range(18) if i % 9 < 3 and physics.AXES[i % 9] not in actuated_axes]
    moving = np.setdiff1d(np.arange(18), still)

    def rates(_time: float, y: FloatArray, force: FloatArray) -> FloatArray:
        slope, jacobian = evaluate(*y[:18], *force, *fixed)
        return np.concatenate([slope, (np.asarray(jacobian, dtype=float) @ y[18:].reshape(18, 18)).ravel()])

    y = np.concatenate([np.asarray(state) * scale, np.eye(18).ravel()])
    matrices = []
    every = max(1, round(0.1 / period))
    groups = [slice(i, min(i + every, counts[-1])) for i in range(0, counts[-1], every)]
    found = {}
    for group in groups:
        rows = forces[group]
        for row in rows if actuated_axes else rows[:1]:
            span = period if actuated_axes else period * len(rows)
            y = solve_ivp(rates, (0.0, span), y, "DOP853", rtol=1e-9, atol=1e-12, args=(row,)).y[:, -1]
        matrix = (y[18:].reshape(18, 18) / scale[:, None] * scale)[np.ix_(moving, moving)]
        matrices.append(matrix)
        norms = [float(np.linalg.norm(matrix, 2))]
        norms += [float(np.linalg.norm(np.linalg.solve(earlier.T, matrix.T), 2)) for earlier in matrices[:-1]]
        found[group.stop] = max(norms)
    return [found[count] for count in counts]
