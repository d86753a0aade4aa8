"""Many steps of a single pendulum that nothing drives, by the splitting, in one call."""

from __future__ import annotations

import numpy as np

from spring_pendulum_env.jit import compiled_entry
from spring_pendulum_env.kernels.lanes import one_at
from spring_pendulum_env.kernels.single import enter, period, period_with_drag, set_back
from spring_pendulum_env.kernels.splitting import any_drag
from spring_pendulum_env.layout import MOVED


def _run(address, periods):
    """So many control periods of the pendulum in a cell, each with the bits of `single.advance`.

    Args:
        address: of the cell, as a float.
        periods: how many.

    Returns:
        How many were made: fewer where the next one is left to the adaptive scheme, or leaves the range of numbers.
    """
    b = one_at(address)
    dragged = any_drag(b, np.int64(1))
    for done in range(periods):
        enter(b, 0.0, 0.0, 0.0)
        ended = period_with_drag(b) if dragged else period(b)
        if ended and b[MOVED, 0] == 0.0:
            set_back(b)
            ended = False
        if not ended:
            return done
    return periods


run = compiled_entry(_run)
