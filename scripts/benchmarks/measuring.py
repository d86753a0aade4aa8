"""How the figures are taken: subjects that run in interleaved rounds, and what was found of them."""

from __future__ import annotations

import gc
import importlib
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Record, number

FloatArray = NDArray[np.float64]
clock = time.process_time
"""Seconds that the processor spent on this process and its threads: on one core those of a clock on the wall, but for
what other processes do there meanwhile."""
Target = tuple[str, float]
"""What a figure must reach: "at least" or "at most", and the number."""


class SkippedError(Exception):
    """Something can't be measured here; says why."""


@dataclass(frozen=True)
class Subject:
    """Something whose speed is measured."""

    name: str
    run: Callable[[int], float]
    """Makes so many calls; returns the seconds by `clock` that went into resets, where these are taken apart, or 0."""
    steps: float = 1.0
    """Environment steps in a call: the number of environments of a batch."""


def peer(name: str) -> Any:
    """The module of that name.

    Raises:
        SkippedError: it isn't installed, or something that it needs isn't.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or name
        own = missing.split(".")[0] == name.split(".")[0]
        raise SkippedError(f"{name}: {'not installed' if own else f'needs {missing}'}, skipped") from None


def installed(makers: Sequence[Callable[[], Subject]], say: Callable[[str], None]) -> list[Subject]:
    """The subjects whose packages are installed; one line for each that isn't."""
    subjects = []
    for make in makers:
        try:
            subjects.append(make())
        except SkippedError as error:
            say(str(error))
    return subjects


@dataclass(frozen=True)
class Effort:
    """How much is measured."""

    rounds: int = 15
    chunk: float = 0.05
    """Least time that a subject runs in a round, s."""
    warm_up: int = 600
    """Steps after which the rows of a batch end at different times."""
    sizes: tuple[int, ...] = (64, 1024, 16384)
    counts: tuple[int, ...] = tuple(4**power for power in range(9))
    horizon: int = 1000
    """Length of a passive run, s."""
    slow_rounds: int = 3
    """Rounds of what takes minutes."""
    passive_rows: int = 256
    starts: int = 7


QUICK = Effort(rounds=3, warm_up=30, horizon=100, slow_rounds=2, passive_rows=64, starts=2)


@dataclass(frozen=True)
class Timing:
    """Seconds for one step of one environment, one value for each round."""

    whole: FloatArray
    without_resets: FloatArray


@dataclass
class Bench:
    """What was found so far."""

    effort: Effort
    records: list[Record] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)
    said: set[str] = field(default_factory=set)
    spent: float = 0.0
    """Seconds by `clock` that timed subjects took."""
    passed: float = 0.0
    """Seconds that meanwhile passed on the wall."""

    def say(self, line: str) -> None:
        """One line for whoever waits, once."""
        if line not in self.said:
            print(line, file=sys.stderr, flush=True)
        self.said.add(line)

    def timings(self, subjects: Sequence[Subject], rounds: int | None = None) -> list[Timing]:
        """Times every subject once in each round, each time for at least `effort.chunk` seconds.

        Each round begins with another subject, so that none always finds the caches as the same one left them.
        """
        rounds = rounds or self.effort.rounds
        calls = [_calls_for(subject, self.effort.chunk) for subject in subjects]
        whole, alone = np.empty((len(subjects), rounds)), np.empty((len(subjects), rounds))
        order = list(enumerate(subjects))
        gc.collect()
        gc.freeze()  # what is there by now isn't looked through again, by whatever peer's modules it may be
        for turn in range(rounds):
            first = turn % len(order)
            for place, subject in order[first:] + order[:first]:
                gc.collect()
                entered, begin = time.perf_counter(), clock()
                resets = subject.run(calls[place])
                spent = clock() - begin
                self.spent += spent
                self.passed += time.perf_counter() - entered
                whole[place, turn] = spent / (calls[place] * subject.steps)
                alone[place, turn] = (spent - resets) / (calls[place] * subject.steps)
        gc.unfreeze()
        return [Timing(*pair) for pair in zip(whole, alone, strict=True)]

    def add(
        self, section: str, what: str, beside: str, values: Any, unit: str, target: Target | None = None, how: str = ""
    ) -> None:
        """Notes the median of one value for each round."""
        low, median, high = np.percentile(values, [25, 50, 75]).tolist()
        bound, aim = target or ("", 0.0)
        self.records.append(Record(section, what, beside, median, low, high, unit, bound, aim, how))

    def compare(
        self,
        section: str,
        what: str,
        ours: FloatArray,
        beside: str,
        theirs: FloatArray,
        target: Target | None,
        more: str = "",
    ) -> None:
        """Notes a ratio: how many times longer theirs takes, or ours where the target is a highest ratio."""
        turned = target is not None and target[0] == "at most"
        ratio = ours / theirs if turned else theirs / ours
        how = f"{duration(ours)} beside {duration(theirs)}{more}"
        self.add(section, what, beside, ratio, "x", target, how)


def duration(seconds: Any) -> str:
    middle = float(np.median(seconds))
    if middle < 1e-2:
        return f"{number(middle * 1e6)} µs"
    return f"{number(middle)} s"


SLOW = 5.0
"""Seconds of a call after which nothing need be repeated or warmed up."""


def _calls_for(subject: Subject, chunk: float) -> int:
    """How many calls take that long; making them also warms the subject up, and the first compiles."""
    begin = clock()
    subject.run(1)
    if clock() - begin > SLOW:
        return 1
    calls = 1
    while True:
        begin = clock()
        subject.run(calls)
        spent = clock() - begin
        if spent >= chunk:
            return max(1, math.ceil(calls * chunk / spent))
        calls *= 2 if spent < 0.1 * chunk else max(2, math.ceil(chunk / spent))


def repeated(function: Callable[[], Any]) -> Callable[[int], float]:
    def run(calls: int) -> float:
        for _ in range(calls):
            function()
        return 0.0

    return run


def printed_number(program: str, **environment: str) -> float | None:
    """The number that a program prints in a process of its own; None if it fails."""
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    return float(done.stdout) if done.returncode == 0 else None
