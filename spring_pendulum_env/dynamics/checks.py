"""Checks of arguments that the tools for dynamics share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spring_pendulum_env.scenario import LARGEST_SIZE, real_numbers

FloatArray = NDArray[np.float64]


def checked_states(states: ArrayLike, name: str = "states") -> FloatArray:
    """States as an array of shape (n, 12).

    Raises:
        ValueError: another shape, nothing, no real numbers, or one that isn't finite or is larger than 1e100.
    """
    array = real_array(states, name)
    if array.ndim != 2 or array.shape[1] != 12 or len(array) == 0:
        raise ValueError(f"{name} of shape {array.shape}: must have shape (n, 12)")
    return _moderate(array, name)


def checked_state(state: ArrayLike, name: str = "state") -> FloatArray:
    """A state as an array of shape (12,).

    Raises:
        ValueError: another shape, no real numbers, or one that isn't finite or is larger than 1e100.
    """
    array = real_array(state, name)
    if array.shape != (12,):
        raise ValueError(f"{name} of shape {array.shape}: must have shape (12,)")
    return _moderate(array, name)


def real_array(values: ArrayLike, name: str) -> FloatArray:
    """A copy of values as an array.

    Raises:
        ValueError: they aren't real numbers.
    """
    try:
        return real_numbers(values).copy()
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {values!r}: must be real numbers") from None


def _moderate(array: FloatArray, name: str) -> FloatArray:
    if not (np.abs(array) <= LARGEST_SIZE).all():
        raise ValueError(f"{name} = {array}: must be finite, no number larger than {LARGEST_SIZE:g}")
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
