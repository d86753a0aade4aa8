"""Random numbers of the rows of a vector environment, drawn some starts ahead."""

from __future__ import annotations

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from spring_pendulum_env.scenario import START_NUMBERS

FloatArray = NDArray[np.float64]

AHEAD = 4
"""Starts drawn at once, since asking a generator for a few numbers costs more than the numbers."""


class Starts:
    """One random number generator for each row, with the normal numbers of its next starts.

    The numbers are those that the generators give one start at a time. Where parameters are randomised too their
    numbers lie between those of two starts, so then nothing is drawn ahead.
    """

    def __init__(self, rows: int, ahead: bool) -> None:
        self._size = AHEAD if ahead else 1
        self._generators: list[np.random.Generator | None] = [None] * rows
        self._numbers = np.empty((rows, self._size, START_NUMBERS))
        self._taken = np.full(rows, self._size)

    def seed(self, row: int, seed: int | None) -> None:
        """Makes a row's random numbers start again from a seed; without one, they go on, or start anywhere."""
        if seed is not None or self._generators[row] is None:
            self._generators[row], _ = seeding.np_random(seed)
            self._taken[row] = self._size

    def draw(self, rows: NDArray[np.intp]) -> FloatArray:
        """The numbers of the next start of each of some rows, shape (n, START_NUMBERS)."""
        for row in rows[self._taken[rows] == self._size].tolist():
            self._generator(row).standard_normal(out=self._numbers[row])
            self._taken[row] = 0
        drawn: FloatArray = self._numbers[rows, self._taken[rows]]
        self._taken[rows] += 1
        return drawn

    def row(self, row: int) -> Row:
        """The random numbers of one row, as a `scenario.Random`."""
        return Row(self, row)

    def _generator(self, row: int) -> np.random.Generator:
        generator = self._generators[row]
        assert generator is not None, "a row is seeded before it is drawn from"
        return generator


class Row:
    """The random numbers of one row."""

    def __init__(self, starts: Starts, row: int) -> None:
        self._starts, self._row = starts, row

    def uniform(self, low: float, high: float) -> float:
        """As NumPy's."""
        return self._starts._generator(self._row).uniform(low, high)

    def standard_normal(self, size: int) -> FloatArray:
        """As NumPy's, START_NUMBERS at a time."""
        assert size == START_NUMBERS
        numbers: FloatArray = self._starts.draw(np.array([self._row]))[0]
        return numbers
