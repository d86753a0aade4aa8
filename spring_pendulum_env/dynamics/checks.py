"""Checks of arguments that the tools for dynamics share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def checked_states(states: ArrayLike, name: str = "states") -> FloatArray:
    """States as an array of shape (n, 12).

    Raises:
        ValueError: another shape, nothing, or a number that isn't finite.
    """
    try:
        array = np.array(states, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {states!r}: must be numbers") from None
    if array.ndim != 2 or array.shape[1] != 12 or len(array) == 0:
        raise ValueError(f"{name} of shape {array.shape}: must have shape (n, 12)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} = {array}: must be finite")
    return array


def checked_state(state: ArrayLike, name: str = "state") -> FloatArray:
    """A state as an array of shape (12,).

    Raises:
        ValueError: another shape, or a number that isn't finite.
    """
    try:
        array = np.array(state, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {state!r}: must be 12 numbers") from None
    if array.shape != (12,):
        raise ValueError(f"{name} of shape {array.shape}: must have shape (12,)")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} = {array}: must be finite")
    return array


def finite_number(name: str, value: Any) -> float:
    """`value` as a float.

    Raises:
        ValueError: it isn't a finite number.
    """
    try:
        number = math.nan if isinstance(value, (str, bool)) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} = {value!r}: must be a finite number")
    return number


def whole_number(name: str, value: int, least: int) -> int:
    """`value`, an integer.

    Raises:
        ValueError: it isn't an integer of at least `least`.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} = {value!r}: must be an integer >= {least}")
    return int(value)
