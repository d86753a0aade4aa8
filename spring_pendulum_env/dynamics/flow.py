"""Motions of the passive pendulum side by side, each with a tiny displacement that is carried along exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import physics
from spring_pendulum_env.dynamics import tangents
from spring_pendulum_env.equilibria import energy
from spring_pendulum_env.integrators import DRIFTS, KICKS, LARGEST_PHASE, LONGEST_STEP
from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import positive_number

FloatArray = NDArray[np.float64]


LARGEST_ANGLE = 1.0
"""No step may be longer than this many radians of the fastest mode of the springs. No motion about hanging rest is
faster; steps near zero length are made finer by themselves."""


class Flow:
    """Integrates columns of a state and a displacement by the 6th-order splitting of integrators.py.

    Where a spring comes near zero length, steps are made finer by themselves.

    Args:
        parameters: the constants, or a mapping of some of them.
        longest_step: no step is longer than this, s; None: as long as the environments' (0.02 s, or half a radian of
            the fastest mode of the springs). At most a radian of that mode, beyond which the splitting falls apart.

    Raises:
        ValueError: a wrong parameter or step.
    """

    def __init__(self, parameters: Parameters | Mapping[str, float] | None, longest_step: float | None = None) -> None:
        self.parameters = p = Parameters.of(parameters)
        _, _, _, w1, w2, k1, k2, L1, L2, g, _ = p.constants("")
        self._constants = (w1, w2, k1, k2, L1, L2, g)
        fastest = float(physics.fastest_frequency(0.0, w1, w2, k1, k2))
        usual = min(LONGEST_STEP, LARGEST_PHASE / fastest) if fastest > 0 else LONGEST_STEP
        self.longest_step = usual if longest_step is None else positive_number("longest_step", longest_step)
        if self.longest_step * fastest > LARGEST_ANGLE:
            raise ValueError(
                f"longest_step = {longest_step!r} s: must be at most {LARGEST_ANGLE / fastest:.4g} s, "
                f"{LARGEST_ANGLE:g} radian of the fastest mode of the springs"
            )
        """No step is longer than this, s."""
        self._schemes: dict[float, FloatArray] = {}

    def steps(self, duration: float) -> int:
        """How many equal steps a duration in s takes."""
        return max(1, math.ceil(abs(duration) / self.longest_step * (1 - 1e-12)))

    def advance(self, points: FloatArray, duration: float, record: bool = False) -> FloatArray:
        """Moves states and displacements by a duration, in place.

        Args:
            points: shape (24, n), in C order: in each column a state (m, m/s) and a displacement from it.
            duration: s; negative ones go back in time.
            record: return what stands in `points` after each step.

        Returns:
            Shape (steps, 24, n); of no steps without `record`.

        Raises:
            ArithmeticError: a spring passes through zero length, or a number grows beyond what floats can hold.
        """
        steps = self.steps(duration)
        step = duration / steps
        kept = np.empty((steps if record else 0, *points.shape))
        status = tangents.advance(points, self._constants, self._scheme(step), step, steps, kept)
        if status != tangents.FINE:
            raise ArithmeticError("a spring passes through zero length, where its force has no direction")
        if not np.isfinite(points).all():
            raise ArithmeticError("the motion is too violent: a state or displacement isn't finite any more")
        return kept

    def slope(self, states: FloatArray) -> FloatArray:
        """Time derivatives of states, shape (n, 12): equations (25) to (30)."""
        p = self.parameters
        still = [0.0] * 3
        columns = np.moveaxis(states, -1, 0)
        slopes = physics.derivatives(
            *[*still, *columns[:6], *still, *columns[6:], *still, *p.constants(""), *p.drag_rates()]
        )
        stacked: FloatArray = np.stack([*slopes[3:9], *slopes[12:18]], axis=-1)
        return stacked

    def _scheme(self, step: float) -> FloatArray:
        """The coefficients of `tangents.advance` for a step and its refinements."""
        known = self._schemes.get(step)
        if known is None:
            lengths = step / 2.0 ** np.arange(tangents.LEVELS)
            drifts = DRIFTS * lengths[:, None]
            known = np.empty((tangents.LEVELS, tangents.STAGES, 5))
            known[..., 0] = KICKS * lengths[:, None]
            for body, rate in enumerate(self.parameters.drag_rates()[1:]):
                known[..., 1 + 2 * body] = -np.expm1(-rate * drifts) / rate if rate > 0 else drifts
                known[..., 2 + 2 * body] = np.exp(-rate * drifts)
            if len(self._schemes) > 64:
                self._schemes.clear()
            self._schemes[step] = known
        return known


def energy_errors(parameters: Parameters, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Equation (42) between states of shape (..., 12); of mass 1 alone where nothing holds mass 2.

    Its long fall would hide all else.
    """
    both = np.stack([starts, ends])
    if parameters.k2 == 0:
        both[..., [3, 4, 5, 9, 10, 11]] = 0.0
    first, last = np.asarray(energy(parameters, both))
    errors: FloatArray = physics.energy_error(last - first, first)
    return errors
