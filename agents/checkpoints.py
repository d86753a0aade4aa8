"""What lets a training that was killed go on as if nothing had been: one file, replaced at once, that holds all of it.

The file is written between two rounds of learning and holds the learner (weights, optimisers, whatever it remembers),
the environments, the episodes that are not over, all random numbers, and the counters. The training that is taken up
from it does what the other would have done, to the last bit, on the same machine.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from agents import runs, torch_file
from agents.config import Config
from agents.stopping import Stop


class Stateful(Protocol):
    """A part of a training that remembers something from one round to the next."""

    def state(self) -> dict[str, Any]:
        """All that it remembers: plain data, arrays and tensors."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state()`, whose arrays are tensors now. Raises ValueError where it is of something else."""
        ...


class Checkpoints:
    """checkpoint.pth of a run folder.

    Arguments:
        config: of the run.
        folder: of the run.
        parts: all that remembers something, by name, but for the random numbers that torch, NumPy and Python share.
        stop: says whether the training is to end.
    """

    def __init__(self, config: Config, folder: Path, parts: Mapping[str, Stateful], stop: Stop) -> None:
        self.config = config
        self.folder = folder
        self.path = folder / runs.CHECKPOINT
        self.parts = parts
        self.clock = Clock()
        self._stop = stop
        self._saved_at = 0

    def resume(self) -> int:
        """Restore all parts, if there is a checkpoint; the environment steps that are done.

        Raises ValueError where the file is no checkpoint of this run.
        """
        if not runs.is_there(self.path):
            return 0
        runs.check_inside(self.path, self.folder)
        content = torch_file.read(self.path)
        try:
            for name, part in self.parts.items():
                part.restore(content["parts"][name])
            steps, seconds = content["steps"], content["seconds"]
            if not isinstance(steps, int) or steps < 0:
                raise ValueError(f"steps is {steps!r}; allowed is an integer >= 0")
            self.clock = Clock(*(float(value) for value in seconds))
            restore_random_numbers(content["random"])  # last, since making things may draw some
        except (ValueError, TypeError, LookupError, AttributeError, RuntimeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(
                f"{self.path} is no checkpoint of this run by this version: {reason}; without it training begins anew"
            ) from None
        self._saved_at = steps
        return steps

    def between(self, steps: int) -> None:
        """To be called between two rounds, after so many environment steps: writes the checkpoint when it is time.

        Raises Stopped, after writing it, when the training is to end.
        """
        if steps - self._saved_at >= self.config.training.checkpoint_every or self._stop.asked is not None:
            self._write(steps)
            self._saved_at = steps
        self._stop.raise_if_asked(f"after {steps:,} steps, which are kept in {self.folder}")

    def finish(self, steps: int) -> None:
        """The policy is saved: say so, and remove what isn't needed any more."""
        self._record(steps, finished=True)
        self.path.unlink(missing_ok=True)

    def _write(self, steps: int) -> None:
        content = {
            "parts": {name: part.state() for name, part in self.parts.items()},
            "random": random_numbers(),
            "steps": steps,
            "seconds": self.clock.read(),
        }
        torch_file.write(self.path, content)
        self._record(steps, finished=False)

    def _record(self, steps: int, *, finished: bool) -> None:
        seconds, processor_seconds = self.clock.read()
        runs.write_record(
            self.config, self.folder, steps, seconds, finished=finished, processor_seconds=processor_seconds
        )


class Clock:
    """Seconds that a training has taken, interruptions apart: of the wall's clock and of the processor."""

    def __init__(self, wall_before: float = 0.0, processor_before: float = 0.0) -> None:
        self._offsets = wall_before - time.monotonic(), processor_before - time.process_time()

    def read(self) -> tuple[float, float]:
        return self._offsets[0] + time.monotonic(), self._offsets[1] + time.process_time()


def random_numbers() -> dict[str, Any]:
    """Where the generators are that Python, NumPy and torch share among all."""
    legacy: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    legacy["state"]["key"] = legacy["state"]["key"].astype(np.int64)
    return {"python": random.getstate(), "numpy": legacy, "torch": torch.get_rng_state()}


def restore_random_numbers(state: Mapping[str, Any]) -> None:
    """Make them go on from `random_numbers()`."""
    random.setstate(state["python"])
    numpy = dict(state["numpy"])
    numpy["state"] = numpy["state"] | {"key": np.asarray(numpy["state"]["key"]).astype(np.uint32)}
    np.random.set_state(numpy)  # noqa: NPY002
    torch.set_rng_state(state["torch"])


def fitting(name: str, given: Any, own: NDArray[Any]) -> NDArray[Any]:
    """A copy of an array that was saved. Raises ValueError where it hasn't the shape and kind of our `own`."""
    values = np.array(given)
    if (values.shape, values.dtype) != (own.shape, own.dtype):
        raise ValueError(f"{name} is {values.dtype} of shape {values.shape}; allowed is {own.dtype} of {own.shape}")
    return values


def check_learnt(weights: Iterable[torch.Tensor], optimisers: Iterable[torch.optim.Optimizer]) -> None:
    """Raises ValueError where restored weights are not finite, or an optimiser remembers what doesn't fit its own."""
    for optimiser in optimisers:
        for group in optimiser.param_groups:
            for weight in group["params"]:
                for name, value in optimiser.state[weight].items():
                    if torch.is_tensor(value) and (value.shape not in ((), weight.shape) or not value.isfinite().all()):
                        raise ValueError(f"an optimiser's {name} is of shape {tuple(value.shape)} or not finite")
    if not all(weight.isfinite().all() for weight in weights):
        raise ValueError("weights are not finite")
