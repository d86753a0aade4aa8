"""Many steps of a single pendulum that nothing drives, by the splitting, in one call."""

from __future__ import annotations

import numpy as np

from spring_pendulum_env.integrators import FINEST, REFINEMENT
from spring_pendulum_env.jit import compiled_entry
from spring_pendulum_env.kernels.lanes import one_at
from spring_pendulum_env.kernels.report import prepare, settle
from spring_pendulum_env.kernels.single import enter, set_back
from spring_pendulum_env.kernels.splitting import any_drag, split, split_with_drag
from spring_pendulum_env.layout import CELL_SETTINGS, GUARDED, KNOWN, MOVED, PERIOD


def _run(address, periods):
    """So many control periods of the pendulum in a cell, each with the bits of `single.advance`.

    Args:
        address: of the cell, as a float.
        periods: how many.

    Returns:
        How many were made: fewer where the next one is left to the adaptive scheme, or leaves the range of numbers.
    """
    b = one_at(address)
    one = np.int64(1)
    dragged = any_drag(b, one)
    for done in range(periods):
        enter(b, 0.0, 0.0, 0.0)
        refinement = one
        while True:
            prepare(b, one)
            if dragged:
                split_with_drag(b, one, refinement, b[CELL_SETTINGS + PERIOD, 0])
            else:
                split(b, one, refinement, b[CELL_SETTINGS + PERIOD, 0], b[KNOWN, 0] != 0.0)
            settle(b, one)
            if b[GUARDED, 0] == 0.0:
                break
            set_back(b)
            refinement *= REFINEMENT
            if refinement > FINEST:
                return done
        if b[MOVED, 0] == 0.0:
            set_back(b)
            return done
        b[KNOWN, 0] = 1.0
    return periods


run = compiled_entry(_run)
