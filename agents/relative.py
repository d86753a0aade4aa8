"""Coordinates in which both LQR's weights and the learned policies see the pendulum.

A policy has to know where the anchor is on its track and how each spring differs from rest. In the environment's
absolute coordinates the second is a small difference of large numbers; here each is a coordinate of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_DIFFERENCES = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])

TRANSFORM = np.kron(np.eye(2), np.kron(_DIFFERENCES, np.eye(3))).astype(np.float64)
"""(18, 18): takes (q0, q1, q2, q0', q1', q2') to (q0, q1 - q0, q2 - q1, and their rates), three axes each."""


def relative(observation: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Anchor, spring 1 and spring 2 vectors (m) less those of `reference`, and their rates (m/s).

    `observation` has shape (18,) or (n, 18), `reference` (18,): the equilibrium that the task is about.
    """
    return (observation - reference) @ TRANSFORM.T
