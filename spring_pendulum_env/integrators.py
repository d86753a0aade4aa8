"""The splitting, as a table of coefficients, and the numbers that hold both schemes within bounds. The loops are in the
package `kernels`, and there the adaptive scheme's coefficients too.

Splitting: kicks (velocities change by the acceleration) and drifts (positions move by the velocities, drag acting) in
turn; symmetric. The 6th-order Runge-Kutta-Nystrom splitting SRKN 11 b of S. Blanes and P. C. Moan, "Practical
symplectic partitioned Runge-Kutta and Runge-Kutta-Nystrom methods", J. Comput. Appl. Math. 142 (2002) 313-330. It needs
that the kicks commute with their own threefold bracket with the drift, which holds for a drift that is linear in the
velocities: so drag, solved exactly inside the drift, costs no order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LONGEST_STEP = 0.02
"""No scheme takes a longer step than this, s."""

LARGEST_PHASE = 0.5
"""No step of the splitting turns the fastest mode of the springs further than this, rad. With the defaults it turns
0.35; the error of a step grows with the seventh power."""

LARGEST_APPROACH = 0.3
"""Where a spring's length could change by more than this fraction in a step, at its start or its end, the step isn't to
be trusted: near zero length the force turns too fast."""

REFINEMENT = 4
"""Such a step is done again by so many smaller ones, and where these can't be trusted either, each of them again ..."""

FINEST = 16
"""... up to so many; then by the adaptive scheme."""

ERROR_MARGIN = 0.1
"""The adaptive scheme holds its estimated error in each step to this share of the tolerance, since errors add up over a
run. Over the reference cases it makes the error ten times smaller and takes a third more steps."""

GUARD_TOLERANCE = 1e-13
"""Tolerance of the adaptive scheme where it takes over."""

MOST_STEPS = 1_000_000
"""The adaptive scheme gives up after so many tries in one control period ..."""

MOST_FIXED_STEPS = MOST_STEPS // FINEST
"""... and the splitting is refused where it would need more than so many: as many again after the last refinement."""


def _splitting(b: list[float], a: list[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Kick and drift coefficients of a symmetric splitting from the free ones; the last drift is zero."""
    b_half = [*b, 0.5 - sum(b)]
    a_half = [*a, 1.0 - 2.0 * sum(a)]
    return np.array([*b_half, *b_half[::-1]]), np.array([*a_half, *a_half[-2::-1], 0.0])


KICKS, DRIFTS = _splitting(
    b=[0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879],
    a=[0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928],
)
SPLITTING_ORDER = 6


def approaches_zero(
    dx: float, dy: float, dz: float, vx: float, vy: float, vz: float, k: float, L: float, step: float
) -> bool:
    """Whether a spring is too close to zero length for a fixed step: step |d'| > LARGEST_APPROACH |d|, or not finite.

    Args: the spring vector, m; its rate, m/s; stiffness and unstretched length; length of the step, s. A spring
    without stiffness or without unstretched length is linear and is never too close.
    """
    moved = step * step * (vx * vx + vy * vy + vz * vz)
    allowed = LARGEST_APPROACH * LARGEST_APPROACH * (dx * dx + dy * dy + dz * dz)
    return k * L > 0.0 and not moved <= allowed
