"""What callers hand to the vector environment, looked at."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from spring_pendulum_env.physics import Parameters
from spring_pendulum_env.scenario import real_numbers


def positive_integer(name: str, value: Any) -> int:
    """An integer >= 1 of any integer type. Raises ValueError, with the name, for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} = {value!r}: must be an integer >= 1")
    return int(value)


def rows_of(value: Any, num_envs: int) -> list[int]:
    """`render_rows` as row numbers. Raises ValueError for what is no sequence of rows in 0 to num_envs - 1."""
    try:
        rows = [operator.index(row) for row in value]
    except TypeError:
        raise ValueError(f"render_rows = {value!r}: must be a sequence of row numbers") from None
    for row in rows:
        if not 0 <= row < num_envs:
            raise ValueError(f"render_rows = {value!r}: {row} must be in 0 to {num_envs - 1}")
    return rows


def mode_of(value: AutoresetMode | str) -> AutoresetMode:
    """The mode of that name or value. Raises ValueError where there is none."""
    for mode in AutoresetMode:
        if isinstance(value, (str, AutoresetMode)) and value in (mode, mode.value, mode.name):
            return mode
    raise ValueError(f"autoreset_mode = {value!r}: must be one of {', '.join(mode.name for mode in AutoresetMode)}")


def seeds_of(seed: int | Sequence[int | None] | None, num_envs: int) -> list[int | None]:
    """A seed for each row: seed + i, or the i-th of a sequence. Raises ValueError for any but non-negative integers."""
    if seed is None:
        return [None] * num_envs
    try:
        if np.ndim(seed) == 0:  # type: ignore[arg-type]
            first = operator.index(seed)  # type: ignore[arg-type]
            seeds: list[int | None] = [first + row for row in range(num_envs)]
        else:
            seeds = [None if one is None else operator.index(one) for one in seed]  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise ValueError(f"seed = {seed!r}: must be an integer, or one (or None) for each row") from None
    if len(seeds) != num_envs:
        raise ValueError(f"seed of {len(seeds)} numbers: must be one number, or one for each of the {num_envs} rows")
    for one in seeds:
        if one is not None and one < 0:
            raise ValueError(f"seed = {seed!r}: must not be negative")
    return seeds


def checked_options(options: Any, num_envs: int, state_size: int) -> dict[str, Any]:
    """The options with arrays whose length is right, scalars made into arrays of one number for each row.

    Raises:
        ValueError: they are no mapping, or one has a wrong shape or kind; `Scenario.draw` looks at the rest.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ValueError(f"options = {options!r}: must be a mapping of 'state', 'parameters' and 'reset_mask'")
    checked = dict(options)
    if checked.get("reset_mask") is None:
        checked.pop("reset_mask", None)
    else:
        mask = np.asarray(checked["reset_mask"])
        if mask.shape != (num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(f"reset_mask = {mask}: must be booleans of shape ({num_envs},), at least one of them true")
        checked["reset_mask"] = mask
    if checked.get("state") is not None:
        try:
            state = real_numbers(checked["state"])
            checked["state"] = np.broadcast_to(state, (num_envs, state_size))
        except (TypeError, ValueError, OverflowError):
            raise ValueError(
                f"state = {checked['state']!r}: must be numbers of shape ({state_size},) or ({num_envs}, {state_size})"
            ) from None
    if isinstance(checked.get("parameters"), Parameters):
        checked["parameters"] = checked["parameters"].as_dict()
    if isinstance(checked.get("parameters"), Mapping):
        for name, value in checked["parameters"].items():
            if np.shape(value) not in ((), (num_envs,)):
                raise ValueError(
                    f"parameter {name} of shape {np.shape(value)}: must be a number, or {num_envs} numbers"
                )
    return checked


def of_row(name: str, value: Any, row: int) -> Any:
    """What an option with one value for each row says about one of them."""
    if name == "state":
        return None if value is None else value[row]
    if name == "parameters" and isinstance(value, Mapping):
        return {key: np.asarray(number)[row] if np.ndim(number) else number for key, number in value.items()}
    return value


def some(rows: NDArray[np.intp]) -> str:
    """The first few of some row numbers, for a message."""
    shown = ", ".join(map(str, rows[:10].tolist()))
    return f"{shown}, ... ({rows.size} in all)" if rows.size > 10 else shown
