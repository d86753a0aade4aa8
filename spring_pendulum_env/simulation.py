"""Long accurate runs of the passive pendulum, by SciPy's integrators or the compiled splitting."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env import integrators, physics
from spring_pendulum_env.equilibria import energy
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import LARGEST_SIZE, positive_number, real_numbers

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

FloatArray = NDArray[np.float64]

METHODS = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA", "ode45", "splitting")
"""SciPy's methods; MATLAB's ode45, which the paper uses (RK45 is the same pair with another step control); and the
environments' own symplectic splitting, hundreds of times as fast."""

TOLERANCE = 1e-12
"""Default of both tolerances; ode45 has its own."""

STEPS_AT_ONCE = 100_000
"""Steps of the splitting in a call that can't be interrupted: some hundredths of a second."""

LEAST_EVALUATIONS = 50_000
EVALUATIONS_PER_RADIAN = 20_000
"""A run may take so many evaluations of the right-hand side: the first, and the second for each radian of the fastest
oscillation of the springs; ten times as many under RK23, which needs many for a small tolerance."""


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
    step: float | None = None,
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
            RK23, DOP853, Radau, BDF, LSODA; or a class of SciPy's OdeSolver; or splitting (of order 6 by Blanes and
            Moan), which takes equal steps and gives the bits of an environment with `tolerance=None` and control
            periods of that length: finer ones, or the adaptive scheme, only where a spring comes close to zero length.
        rtol: relative tolerance; None is 1e-12, and under ode45 its default, 1e-3. Those below 2.3e-14 are raised to
            that.
        atol: absolute tolerance, m and m/s; None is 1e-12, and under ode45 its default, 1e-6. The splitting has none.
        step: longest step of the splitting, s; None is 0.02, or less where the springs are stiff.

    Raises:
        ValueError: a wrong argument.
        ArithmeticError: the integrator gave up, or took more evaluations than any motion should need
            (EVALUATIONS_PER_RADIAN); the message says when and why.
    """
    from scipy.integrate import OdeSolver  # here since importing it takes longer than importing the rest

    from spring_pendulum_env import ode45

    p = Parameters.of(parameters)
    start = _numbers("state", state)
    instants = _numbers("times", times)
    if start.shape != (12,):
        raise ValueError(f"state of shape {start.shape}: must have shape (12,)")
    if not (np.abs(start) <= LARGEST_SIZE).all():
        raise ValueError(f"state = {start}: must be finite, no number larger than {LARGEST_SIZE:g}")
    if instants.ndim != 1 or instants.size < 1 or not np.isfinite(instants).all() or (np.diff(instants) <= 0).any():
        raise ValueError(f"times = {times!r}: must be finite, increasing instants, at least one")
    if method not in METHODS and not (isinstance(method, type) and issubclass(method, OdeSolver)):
        raise ValueError(f"method = {method!r}: must be one of {', '.join(METHODS)}, or a class of SciPy's OdeSolver")
    relative, absolute = TOLERANCE, TOLERANCE
    if method == "ode45":
        relative, absolute = ode45.RELATIVE_TOLERANCE, ode45.ABSOLUTE_TOLERANCE
    if method == "splitting":
        if (rtol, atol) != (None, None):
            raise ValueError(f"rtol = {rtol!r}, atol = {atol!r}: must be None for the splitting, which takes a step")
    elif step is not None:
        raise ValueError(f"step = {step!r}: must be None but for the splitting; method is {method!r}")
    rtol = relative if rtol is None else positive_number("rtol", rtol)
    atol = absolute if atol is None else positive_number("atol", atol)

    if instants.size == 1:
        return Trajectory(p, instants, start[None, :], np.asarray(energy(p, start[None, :])))
    name = method if isinstance(method, str) else method.__name__
    if method == "splitting":
        states = _split(p, start, instants, step)
    else:
        instants, states = _solve(p, start, instants, method, name, rtol, atol)
    if not (np.abs(states) <= LARGEST_SIZE).all():
        raise ArithmeticError(f"{name}: the motion is too violent, its numbers grow beyond {LARGEST_SIZE:g}")
    return Trajectory(p, instants, states, np.asarray(energy(p, states)))


def _solve(
    p: Parameters,
    start: FloatArray,
    instants: FloatArray,
    method: str | type[OdeSolver],
    name: str,
    rtol: float,
    atol: float,
) -> tuple[FloatArray, FloatArray]:
    """The instants and the states there, shapes (n,) and (n, 12), by SciPy's solvers or ode45.

    Raises:
        ArithmeticError: the integrator gave up.
    """
    from scipy.integrate import solve_ivp  # here since importing it takes longer than importing the rest

    from spring_pendulum_env import ode45

    slope = _bounded(right_hand_side(p), name, _most_evaluations(p, name, float(instants[-1] - instants[0])))
    with np.errstate(all="ignore"):  # a step that runs away is tried again; what can't be helped is said by `simulate`
        if method == "ode45" and instants.size == 2:
            return ode45.refined(ode45.ODE45(slope, instants[0], start, instants[1], rtol, atol))
        options: dict[str, Any] = {"method": method}
        if method == "ode45":
            options = {"method": ode45.ODE45, "first_gap": instants[1] - instants[0]}
        solution = solve_ivp(
            slope, (instants[0], instants[-1]), start, t_eval=instants, rtol=rtol, atol=atol, **options
        )
    if not solution.success:
        stopped = solution.t[-1] if len(solution.t) else instants[0]
        raise ArithmeticError(f"{name} stopped at t = {stopped} s: {solution.message}")
    return instants, solution.y.T.copy()


def _split(p: Parameters, start: FloatArray, instants: FloatArray, step: float | None) -> FloatArray:
    """The states at the instants by the splitting, shape (n, 12).

    Raises:
        ValueError: a wrong step.
        ArithmeticError: the motion leaves the range of numbers.
    """
    from spring_pendulum_env import layout, tasks
    from spring_pendulum_env.env import failure
    from spring_pendulum_env.kernels import adaptive, run, single
    from spring_pendulum_env.scenario import Scenario

    finest = layout.steps_in(integrators.LONGEST_STEP, p.constants(actuated_axes=""))
    longest = integrators.LONGEST_STEP / finest if step is None else positive_number("step", step)
    scenario = Scenario.of(tasks.PASSIVE, parameters=p, tolerance=None, control_period=longest)
    cell = layout.cell(scenario, scenario.checked_state(start))
    cell[layout.STEPS] = 1.0
    address = float(cell.ctypes.data)
    states = np.empty((instants.size, 12))
    states[0] = start
    for place, interval in enumerate(np.diff(instants).tolist(), start=1):
        left = max(1, math.ceil(interval / longest - 1e-9))
        cell[layout.CELL_SETTINGS + layout.PERIOD] = interval / left
        while left > 0:
            asked = min(left, STEPS_AT_ONCE)
            done = run.run(address, asked)
            left -= done
            if done < asked:
                status = single.entry(adaptive.advance_adaptively)(address, 0.0, 0.0, 0.0)[0]
                if status != layout.FINE:
                    raise ArithmeticError(f"splitting, before t = {instants[place]} s: {failure(status)}")
                left -= 1
        states[place] = cell[layout.STATE : layout.STATE + 18].reshape(2, 9)[:, 3:].reshape(12)
    return states


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


def _most_evaluations(p: Parameters, method: str, duration: float) -> float:
    fastest = float(physics.fastest_frequency(0.0, 1.0 / p.m1, 1.0 / p.m2, p.k1, p.k2))
    return (LEAST_EVALUATIONS + EVALUATIONS_PER_RADIAN * fastest * duration) * (10 if method == "RK23" else 1)


def _bounded(
    slope: Callable[[float, FloatArray], list[float]], method: str, most: float
) -> Callable[[float, FloatArray], list[float]]:
    """A right-hand side that can't be evaluated for ever.

    Raises, when it is called:
        ArithmeticError: more than `most` times.
    """
    count = 0

    def counted(time: float, state: FloatArray) -> list[float]:
        nonlocal count
        count += 1
        if count > most:
            raise ArithmeticError(
                f"{method} stopped at t = {time} s after {most:,.0f} evaluations, more than any motion should need: "
                "the state is too large for its small parts to be told from rounding, or the tolerance too small for "
                "the method"
            )
        return slope(time, state)

    return counted


def _numbers(name: str, value: ArrayLike) -> FloatArray:
    """`value` as an array.

    Raises:
        ValueError: it isn't made of numbers.
    """
    try:
        return real_numbers(value).copy()
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {value!r}: must be real numbers") from None
