"""Lyapunov exponents: how fast nearby motions part.

A tiny displacement from the motion is carried along exactly (`flow`) and shortened again at intervals; the mean rate
at which it grew is the largest exponent: G. Benettin, L. Galgani, A. Giorgilli and J.-M. Strelcyn, "Lyapunov
characteristic exponents for smooth dynamical systems and for Hamiltonian systems; a method for computing all of them",
Meccanica 15 (1980) 9-30. For the whole spectrum twelve displacements are made orthogonal at each interval by QR, and
the diagonal of R has their growth: J.-P. Eckmann and D. Ruelle, Rev. Mod. Phys. 57 (1985) 617-656, section V.

Standard errors are those of batch means: the run is cut into equal batches, whose mean rates are taken as independent
(G. S. Fishman, "Discrete-Event Simulation", 2001, section 6.6). They hold where the motion fills its part of the energy
shell evenly in a time shorter than a batch. A regular motion has an exponent of zero, of which a run of T seconds can
only say that it is below a few times ln(1 + T) / T: `resolution`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env.dynamics.checks import checked_state, checked_states, whole_number
from spring_pendulum_env.dynamics.flow import Flow, energy_errors
from spring_pendulum_env.dynamics.progress import Progress
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]

SPREAD = 1e-12
"""Smallest growth in an interval over the largest, below which rounding hides the smallest of a spectrum."""


@dataclasses.dataclass(frozen=True)
class LyapunovExponent:
    """Largest Lyapunov exponent of one motion."""

    exponent: float
    """Mean rate at which a displacement grows after the transient, 1/s."""
    standard_error: float
    """Of the mean of the batches, 1/s."""
    times: FloatArray
    """Ends of the intervals, s since the end of the transient; shape (n,)."""
    convergence: FloatArray
    """Exponent as it is known at each of these instants, 1/s; shape (n,)."""
    energy_error: float
    """Equation (42) over the whole run: what the integration got wrong, and what drag took."""

    @property
    def resolution(self) -> float:
        """ln(1 + T) / T, 1/s: a displacement in a regular motion grows in proportion to time, say as 1 + t with t in s,
        so that at least this much is found. A smaller exponent than a few times this can't be told from zero by a run
        so long."""
        return float(np.log1p(self.times[-1]) / self.times[-1])


@dataclasses.dataclass(frozen=True)
class LyapunovSpectrum:
    """All twelve Lyapunov exponents of one motion, largest first."""

    exponents: FloatArray
    """1/s; shape (12,)."""
    standard_errors: FloatArray
    """Of the means of the batches, 1/s; shape (12,)."""
    times: FloatArray
    """Ends of the intervals, s since the end of the transient; shape (n,)."""
    convergence: FloatArray
    """Exponents as they are known at each of these instants, 1/s; shape (n, 12)."""
    energy_error: float
    """Equation (42) over the whole run: what the integration got wrong, and what drag took."""


def lyapunov_exponent(
    parameters: Parameters | Mapping[str, float] | None,
    state: ArrayLike,
    duration: float = 10_000.0,
    *,
    transient: float = 200.0,
    interval: float = 2.0,
    batches: int = 20,
    longest_step: float | None = None,
    seed: int = 0,
    progress: bool = False,
) -> LyapunovExponent:
    """Largest Lyapunov exponent of the passive pendulum's motion from a state.

    Args:
        parameters: the constants, or a mapping of some of them.
        state: positions X1 Y1 Z1 X2 Y2 Z2 in m, then their rates in m/s; shape (12,).
        duration: over which growth is averaged, s.
        transient: time before that, in which the displacement turns to where it grows fastest, s.
        interval: after which the displacement is shortened again, s (adjusted so that batches hold a whole number).
        batches: equal parts of the duration of which the standard error is made.
        longest_step: of the integration, s, as for `Flow`; None: as the environments'.
        seed: of the displacement's first direction.
        progress: draw a progress bar.

    Raises:
        ValueError: a wrong argument.
        ArithmeticError: a spring passes through zero length, or the motion is beyond what floats can hold.
    """
    start = checked_state(state)
    flow = Flow(parameters, longest_step)
    directions = np.random.default_rng(whole_number("seed", seed, 0)).standard_normal((12, 1))
    rates, times, end = _growth(
        flow, start[None, :], directions, duration, transient, interval, batches, progress, together=False
    )
    return LyapunovExponent(
        exponent=float(rates.mean()),
        standard_error=float(batch_error(rates, batches)[0]),
        times=times,
        convergence=_running_mean(rates)[:, 0],
        energy_error=float(energy_errors(flow.parameters, start, end[0])),
    )


def lyapunov_spectrum(
    parameters: Parameters | Mapping[str, float] | None,
    state: ArrayLike,
    duration: float = 10_000.0,
    *,
    transient: float = 200.0,
    interval: float = 1.0,
    batches: int = 20,
    longest_step: float | None = None,
    seed: int = 0,
    progress: bool = False,
) -> LyapunovSpectrum:
    """All Lyapunov exponents of the passive pendulum's motion from a state.

    Without drag they come in pairs of opposite sign, and four are zero in general: one pair for time and energy, one
    for the turn about the vertical and the angular momentum about it. With drag they add up to minus three times the
    sum of R / m over the masses.

    Args and raises: as `lyapunov_exponent`.
    """
    start = checked_state(state)
    flow = Flow(parameters, longest_step)
    directions = np.linalg.qr(np.random.default_rng(whole_number("seed", seed, 0)).standard_normal((12, 12)))[0]
    rates, times, end = _growth(
        flow, np.tile(start, (12, 1)), directions, duration, transient, interval, batches, progress, together=True
    )
    order = np.argsort(-rates.mean(axis=0), kind="stable")
    rates = rates[:, order]
    return LyapunovSpectrum(
        exponents=rates.mean(axis=0),
        standard_errors=batch_error(rates, batches),
        times=times,
        convergence=_running_mean(rates),
        energy_error=float(energy_errors(flow.parameters, start, end[0])),
    )


def lyapunov_exponents(
    parameters: Parameters | Mapping[str, float] | None,
    states: ArrayLike,
    duration: float = 1_000.0,
    *,
    transient: float = 0.0,
    interval: float = 2.0,
    batches: int = 2,
    longest_step: float | None = None,
    seed: int = 0,
    progress: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Largest Lyapunov exponents of many motions, side by side: several times faster than one after the other.

    Args: as `lyapunov_exponent`, but for
        states: shape (n, 12).

    Returns:
        Exponents and their standard errors, 1/s; each of shape (n,).

    Raises: as `lyapunov_exponent`.
    """
    starts = checked_states(states)
    directions = np.random.default_rng(whole_number("seed", seed, 0)).standard_normal((12, len(starts)))
    rates, _, _ = _growth(
        Flow(parameters, longest_step),
        starts, directions, duration, transient, interval, batches, progress, together=False,
    )  # fmt: skip
    return rates.mean(axis=0), batch_error(rates, batches)


def batch_error(rates: FloatArray, batches: int) -> FloatArray:
    """Standard error of the mean of each column by batch means.

    Args:
        rates: shape (n, columns); n a multiple of `batches`.
        batches: how many.

    Returns:
        Shape (columns,).
    """
    means = rates.reshape(batches, -1, rates.shape[1]).mean(axis=1)
    error: FloatArray = means.std(axis=0, ddof=1) / np.sqrt(batches)
    return error


def _growth(
    flow: Flow,
    starts: FloatArray,
    directions: FloatArray,
    duration: float,
    transient: float,
    interval: float,
    batches: int,
    progress: bool,
    *,
    together: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rates at which displacements grow in each interval after the transient.

    Args:
        starts: shape (n, 12).
        directions: first displacements, shape (12, n).
        together: the displacements belong to one motion and are made orthogonal at each interval.

    Returns:
        Rates, 1/s, shape (intervals, n); the ends of the intervals, s; the last states, shape (n, 12).

    Raises:
        ValueError: a wrong argument.
    """
    positive_number("duration", duration)
    positive_number("interval", interval)
    positive_number("transient", transient, zero=True)
    whole_number("batches", batches, 2)
    if duration < batches * flow.longest_step:
        raise ValueError(
            f"duration = {duration!r}: must be at least batches * step = {batches} * {flow.longest_step:g} s"
        )
    in_batch = max(1, round(duration / (batches * interval)))
    count = batches * in_batch
    interval = duration / count
    before = int(np.ceil(transient / interval))
    points = np.empty((24, len(starts)))
    points[:12] = starts.T
    points[12:] = directions / np.linalg.norm(directions, axis=0)
    rates = np.empty((before + count, len(starts)))
    with Progress("Lyapunov", before + count, show=progress) as bar:
        for number in range(before + count):
            flow.advance(points, interval)
            if together:
                points[12:], triangle = np.linalg.qr(points[12:])
                grown = np.abs(np.diag(triangle))
                _told_apart(grown, interval)
            else:
                grown = np.linalg.norm(points[12:], axis=0)
                points[12:] /= grown
            rates[number] = np.log(grown)
            bar.add(1)
    rates /= interval
    if not np.isfinite(rates).all():
        raise ArithmeticError(f"a displacement vanished within {interval:g} s: use a smaller interval")
    return rates[before:], interval * np.arange(1.0, count + 1), points[:12].T.copy()


def _told_apart(grown: FloatArray, interval: float) -> None:
    """Whether displacements that were orthogonal an interval ago still are more than rounding of the fastest one.

    Raises:
        ArithmeticError: they aren't, so that what is left of the slow ones says nothing.
    """
    if not grown.min() > SPREAD * grown.max():
        raise ArithmeticError(
            f"displacements can't be told apart after {interval:g} s, in which the fastest grew {grown.max():.1e}-fold "
            "and the slowest is lost in its rounding: use a smaller interval"
        )


def _running_mean(rates: FloatArray) -> FloatArray:
    mean: FloatArray = np.cumsum(rates, axis=0) / np.arange(1, len(rates) + 1)[:, None]
    return mean
