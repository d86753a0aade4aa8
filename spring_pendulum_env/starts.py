"""Random numbers of the rows of a vector environment, drawn some starts ahead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from spring_pendulum_env.scenario import START_NUMBERS

FloatArray = NDArray[np.float64]

MOST_AHEAD = 64
"""Starts drawn at once, since asking a generator for a few numbers costs more than the numbers ..."""

NUMBERS_AHEAD = 2**21
"""... and at most so many numbers for all rows, 16 MB."""

WORDS = 6
"""Numbers that say where a generator is; int64, which every file format knows."""

_WORD = 2**64 - 1


class Starts:
    """One random number generator for each row, with the normal numbers of its next starts.

    `numbers`, shape (rows, starts, START_NUMBERS), are those drawn; `taken`, shape (rows,), how many starts of each row
    have been taken since.

    The numbers are those that the generators give one start at a time. Where parameters are randomised too their
    numbers lie between those of two starts, so then nothing is drawn ahead.
    """

    def __init__(self, rows: int, ahead: bool) -> None:
        self._ahead = ahead
        self._size = min(MOST_AHEAD, max(1, NUMBERS_AHEAD // (rows * START_NUMBERS))) if ahead else 1
        self._generators: list[np.random.Generator | None] = [None] * rows
        self.numbers = np.empty((rows, self._size, START_NUMBERS))
        self.taken = np.full(rows, self._size)

    def seed(self, row: int, seed: int | None) -> None:
        """Makes a row's random numbers start again from a seed; without one, they go on, or start anywhere."""
        if seed is not None or self._generators[row] is None:
            self._generators[row], _ = seeding.np_random(seed)
            self.taken[row] = self._size
            if self._ahead:
                self._draw(row, 1 + row % self._size)  # not as many for all, else all would run out at once

    def prepare(self, rows: NDArray[np.intp] | None = None) -> None:
        """Draws for those of some rows, or of all, of whose starts none is left."""
        empty = self.taken == self._size
        for row in (empty.nonzero()[0] if rows is None else rows[empty[rows]]).tolist():
            self._draw(row, self._size)

    def row(self, row: int) -> Row:
        """The random numbers of one row, as a `scenario.Random`."""
        return Row(self, row)

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Where all rows' random numbers are, as arrays."""
        words = np.zeros((len(self._generators), WORDS), dtype=np.int64)
        for row, generator in enumerate(self._generators):
            if generator is not None:
                words[row] = words_of(generator)
        return {"generators": words, "numbers": self.numbers.copy(), "taken": self.taken.copy()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `get_state` of as many rows, whose arrays are known to have the right shapes.

        Raises:
            ValueError: a number can be nobody's; nothing has changed then.
        """
        taken = state["taken"]
        if ((taken < 0) | (taken > self._size)).any():  # the compiled step would look for starts where none are
            raise ValueError(f"starts taken = {taken}: must be in 0 to {self._size}")
        unseeded = not state["generators"].any()
        self._generators = [None if unseeded else generator_of(words) for words in state["generators"]]
        self.numbers[:] = state["numbers"]
        self.taken[:] = state["taken"]

    def _draw(self, row: int, starts: int) -> None:
        """Draws so many starts of a row, of which none is left."""
        first = self._size - starts
        self._generator(row).standard_normal(out=self.numbers[row, first:])
        self.taken[row] = first

    def _generator(self, row: int) -> np.random.Generator:
        generator = self._generators[row]
        assert generator is not None, "a row is seeded before it is drawn from"
        return generator


def words_of(generator: np.random.Generator) -> NDArray[np.int64]:
    """Where a generator of NumPy's default kind, PCG64, is: WORDS numbers."""
    state: Any = generator.bit_generator.state
    state, increment, kept = state["state"]["state"], state["state"]["inc"], (state["has_uint32"], state["uinteger"])
    words = [state >> 64, state & _WORD, increment >> 64, increment & _WORD, *kept]
    return np.array(words, dtype=np.uint64).view(np.int64)


def generator_of(words: NDArray[np.int64]) -> np.random.Generator:
    """The generator of `words_of`. Raises ValueError where they can be none's."""
    high, low, increment_high, increment_low, has_uint32, uinteger = words.view(np.uint64).tolist()
    if not increment_low & 1 or has_uint32 > 1 or uinteger >= 2**32:  # PCG64's increment is odd
        raise ValueError(f"state of a random number generator = {words}: must be that of a PCG64")
    bits = np.random.PCG64(0)
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": high << 64 | low, "inc": increment_high << 64 | increment_low},
        "has_uint32": has_uint32,
        "uinteger": uinteger,
    }
    return np.random.Generator(bits)


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
        self._starts.prepare(np.array([self._row]))
        numbers: FloatArray = self._starts.numbers[self._row, self._starts.taken[self._row]].copy()
        self._starts.taken[self._row] += 1
        return numbers
