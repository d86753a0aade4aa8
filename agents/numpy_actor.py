"""A trained policy that needs NumPy alone: no torch, no Stable-Baselines3, no config.

`scripts/export.py RUN` writes its file, an .npz of plain numbers and one text. With d the observation less `reference`:

    seen   = features @ d - shift, limited to +-clip
    said   = weight.N @ a(... a(weight.0 @ seen + bias.0) ...) + bias.N, a being the activation
    action = tanh(said), or said + (gain @ d limited to +-1), limited to +-1

`gain` is LQR's, where the policy was trained as an addition to it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controller import STATE_SIZE, StateFeedback
from agents.files import read_arrays

Array = NDArray[np.float64]

ABOUT = "about"
FORMAT = "spring_pendulum_env actor 1"
FILE = "actor.npz"


class NumpyActor(StateFeedback):
    """`predict` as that of the policy that was exported; arrays as above, checked."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        about = json.loads(str(arrays[ABOUT]))
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise ValueError(f"format is not {FORMAT!r}")
        self._activation, self._squash = about["activation"], about["squash"]
        if self._activation not in ("tanh", "relu", "silu") or self._squash not in ("tanh", "clip"):
            raise ValueError(f"activation is {self._activation!r} and squash {self._squash!r}; allowed are others")
        self.reference = _array(arrays, "reference", (STATE_SIZE,))
        self._features = _array(arrays, "features", (None, STATE_SIZE))
        self._shift = _array(arrays, "shift", (len(self._features),))
        self._gain = _array(arrays, "gain", (None, STATE_SIZE))
        self._clip = float(arrays["clip"])
        self._layers: list[tuple[Array, Array]] = []
        size = len(self._features)
        for number in range(int(about["layers"])):
            weight = _array(arrays, f"weight.{number}", (None, size))
            size = len(weight)
            self._layers.append((weight, _array(arrays, f"bias.{number}", (size,))))
        if size != len(self._gain):
            raise ValueError(f"the last layer has {size} numbers and gain {len(self._gain)}; allowed are as many")

    @classmethod
    def load(cls, run_or_file: str | Path) -> NumpyActor:
        """Load an exported .npz, or that of a run folder. Raises ValueError where it is none, OSError where unread."""
        path = Path(run_or_file)
        path = path / FILE if path.is_dir() else path
        try:
            return cls(read_arrays(path))
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            raise ValueError(f"{path} is not an exported policy: {error}") from None

    def actions(self, observations: Array, deterministic: bool) -> Array:  # noqa: ARG002
        """Actions (n, axes) in [-1, 1] for raw observations (n, 18)."""
        displaced = observations - self.reference
        seen = np.clip(displaced @ self._features.T - self._shift, -self._clip, self._clip)
        value = said(self._layers, self._activation, seen)
        if self._squash == "tanh":
            return np.tanh(value)
        guided = np.clip(displaced @ self._gain.T, -1.0, 1.0)
        return np.clip(value + guided, -1.0, 1.0)


def said(layers: Sequence[tuple[Array, Array]], activation: str, seen: Array) -> Array:
    """What linear layers of (weight, bias) with an activation between them make of (n, k) numbers."""
    value = seen
    for number, (weight, bias) in enumerate(layers):
        value = (_active(activation, value) if number else value) @ weight.T + bias
    return value


def _active(name: str, values: Array) -> Array:
    """One of the three activations of a config."""
    if name == "relu":
        return np.maximum(values, 0.0)
    # The logistic function by tanh, which doesn't overflow.
    return np.tanh(values) if name == "tanh" else values * (0.5 + 0.5 * np.tanh(0.5 * values))


def _array(arrays: dict[str, NDArray[Any]], name: str, shape: tuple[int | None, ...]) -> Array:
    """An array of finite numbers of a shape, None standing for any size."""
    array = arrays[name]
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind != "f" or not np.isfinite(array).all():
        raise ValueError(f"{name} is {array.dtype} of shape {array.shape}, or not finite; allowed is {shape}")
    return array.astype(np.float64)
