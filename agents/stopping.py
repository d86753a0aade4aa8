"""Ctrl-C and SIGTERM during a training: it ends where it can be taken up again, not where the signal meets it."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any, Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(KeyboardInterrupt):
    """A training has ended early, and its checkpoint is written; `status` is what a command ends with."""

    def __init__(self, number: int, when: str) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name} {when}")
        self.status = 128 + number


class Stop:
    """While it is open, the first SIGINT or SIGTERM is only noted; a second one does what it did before.

    Python gives signals to the main thread alone; opened in another one, nothing is noted.
    """

    def __init__(self) -> None:
        self.asked: int | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._give_back()
        if kind is None:
            self.raise_if_asked("when all was done")

    def raise_if_asked(self, when: str) -> None:
        """Raises Stopped after a signal; `when` says how far the training has come."""
        if self.asked is not None:
            raise Stopped(self.asked, when)

    def _note(self, number: int, _: FrameType | None) -> None:
        self.asked = number
        self._give_back()

    def _give_back(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()
