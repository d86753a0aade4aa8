"""A progress bar on the terminal, of nothing but the standard library."""

from __future__ import annotations

import sys
import time
from types import TracebackType


class Progress:
    """A bar with the time that is left, redrawn twice a second; on no terminal, a line each tenth of the way.

    Args:
        name: what is being done.
        total: how many pieces there are.
        done: how many of them were there already.
        show: draw it at all.
    """

    def __init__(self, name: str, total: int, *, done: int = 0, show: bool = True) -> None:
        self._name, self._total, self._done, self._first = name, total, done, done
        self._show = show
        self._begin = self._drawn = time.monotonic()
        self._tenth = 10 * done // max(total, 1)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._show and sys.stderr.isatty():
            self._draw()
            print(file=sys.stderr)

    def add(self, pieces: int) -> None:
        """So many more are done."""
        self._done += pieces
        if not self._show:
            return
        if sys.stderr.isatty():
            if time.monotonic() - self._drawn > 0.5:
                self._drawn = time.monotonic()
                self._draw()
        elif (tenth := 10 * self._done // self._total) > self._tenth:
            self._tenth = tenth
            print(f"{self._name}: {10 * tenth} %, {time.monotonic() - self._begin:.0f} s", file=sys.stderr, flush=True)

    def _draw(self) -> None:
        share = self._done / max(self._total, 1)
        spent = time.monotonic() - self._begin
        fresh = self._done - self._first
        left = f"{spent / fresh * (self._total - self._done):.0f} s left" if fresh else "..."
        bar = "=" * round(30 * share)
        print(f"\r{self._name} [{bar:30}] {100 * share:3.0f} %  {left}   ", end="", file=sys.stderr, flush=True)
