"""Long accurate runs of the passive pendulum, by SciPy's integrators."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.equilibria import energy
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

FloatArray = NDArray[np.float64]

METHODS = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA", "ode45")
"""SciPy's methods, and MATLAB's ode45, which the paper uses. RK45 is the same pair with another step control."""

TOLERANCE = 1e-12
"""Default of both tolerances; ode45 has its own."""


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """A run of the passive pendulum."""

    parameters: Parameters
    times: FloatArray
    """Instants, s; shape (n,)."""
    states: FloatArray
    """Positions in m, then velocities in m/s; shape (n, 12)."""
    energy: FloatArray
    """Kinetic plus potential energy at each instant, J; shape (n,)."""

    @property
    def energy_error(self) -> float:
        """Equation (42), between the first and the last instant; absolute where the energy starts at 0."""
        return float(physics.energy_error(self.energy[-1] - self.energy[0], self.energy[0]))

    @property
    def mean_energy_error(self) -> float:
        """The paper's mean error, signed: (sum(Energy)/n - Energy(1)) / Energy(1); absolute where that is 0."""
        start = self.energy[0]
        return float((self.energy.mean() - start) / (start if start != 0.0 else 1.0))


def simulate(
    parameters: Parameters | Mapping[str, float] | None,
    state: ArrayLike,
    times: ArrayLike,
    method: str | type[OdeSolver] = "DOP853",
    rtol: float | None = None,
    atol: float | None = None,
) -> Trajectory:
    """The passive pendulum from a state at times[0], at given instants.

    Under "ode45", as in MATLAB, two instants are the ends of an interval, and the trajectory has the solver's own
    points in between, four for each step: the paper's mean error is one over these points. More than two instants are
    the ones asked for, whatever the method.

    Args:
        parameters: the constants, or a mapping of some of them.
        state: positions X1 Y1 Z1 X2 Y2 Z2 in m, then their rates in m/s; shape (12,).
        times: increasing instants, s; the first is that of `state`.
        method: ode45 (MATLAB's, with which the paper was made; see ode45.py), or one of SciPy's: RK45 (the same pair),
            RK23, DOP853, Radau, BDF, LSODA; or a class of SciPy's OdeSolver.
        rtol: relative tolerance; None is 1e-12, and under ode45 its default, 1e-3. Those below 2.3e-14 are raised to
            that.
        atol: absolute tolerance, m and m/s; None is 1e-12, and under ode45 its default, 1e-6.

    Raises:
        ValueError: a wrong argument.
        ArithmeticError: the integrator gave up; the message says when and why.
    """
    from scipy.integrate import OdeSolver, solve_ivp  # here since importing it takes longer than importing the rest

    from spring_pendulum_env import ode45

    p = Parameters.of(parameters)
    start = _numbers("state", state)
    instants = _numbers("times", times)
    if start.shape != (12,):
        raise ValueError(f"state of shape {start.shape}: must have shape (12,)")
    if not np.isfinite(start).all():
        raise ValueError(f"state = {start}: must be finite")
    if instants.ndim != 1 or instants.size < 1 or not np.isfinite(instants).all() or (np.diff(instants) <= 0).any():
        raise ValueError(f"times = {times!r}: must be finite, increasing instants, at least one")
    if method not in METHODS and not (isinstance(method, type) and issubclass(method, OdeSolver)):
        raise ValueError(f"method = {method!r}: must be one of {', '.join(METHODS)}, or a class of SciPy's OdeSolver")
    relative, absolute = TOLERANCE, TOLERANCE
    if method == "ode45":
        relative, absolute = ode45.RELATIVE_TOLERANCE, ode45.ABSOLUTE_TOLERANCE
    rtol = relative if rtol is None else positive_number("rtol", rtol)
    atol = absolute if atol is None else positive_number("atol", atol)

    if instants.size == 1:
        states = start[None, :]
    elif method == "ode45" and instants.size == 2:
        solver = ode45.ODE45(right_hand_side(p), instants[0], start, instants[1], rtol, atol)
        instants, states = ode45.refined(solver)
    else:
        options: dict[str, Any] = {"method": method}
        if method == "ode45":
            options = {"method": ode45.ODE45, "first_gap": instants[1] - instants[0]}
        solution = solve_ivp(
            right_hand_side(p), (instants[0], instants[-1]), start, t_eval=instants, rtol=rtol, atol=atol, **options
        )
        if not solution.success:
            name, end = getattr(method, "__name__", method), solution.t[-1] if len(solution.t) else instants[0]
            raise ArithmeticError(f"{name} stopped at t = {end} s: {solution.message}")
        states = solution.y.T.copy()
    return Trajectory(p, instants, states, np.asarray(energy(p, states)))


def right_hand_side(parameters: Parameters | Mapping[str, float] | None) -> Callable[[float, FloatArray], list[float]]:
    """The right-hand side that `simulate` integrates, for other solvers of SciPy's interface: slope(t, state).

    Args:
        parameters: the constants, or a mapping of some of them.

    Returns:
        A function of the time, which doesn't matter, and the 12 numbers of a state, m and m/s, that gives their 12
        rates: equations (25) to (30).

    Raises:
        ValueError: a wrong parameter.
    """
    p = Parameters.of(parameters)
    still = [0.0] * 3
    constants = (*still, *p.constants(actuated_axes=""), *p.drag_rates())

    def rates(_time: float, state: FloatArray) -> list[float]:
        numbers = state.tolist()
        full = physics.derivatives(*still, *numbers[:6], *still, *numbers[6:], *constants)
        return [*full[3:9], *full[12:18]]

    return rates


def _numbers(name: str, value: ArrayLike) -> FloatArray:
    """`value` as an array.

    Raises:
        ValueError: it isn't made of numbers.
    """
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {value!r}: must be numbers") from None
