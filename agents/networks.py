"""The parts that the policies' networks are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import nn

ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU, "silu": nn.SiLU}
"""By their names in a config."""


def multilayer(inputs: int, layers: Sequence[int], outputs: int, activation: str) -> nn.Sequential:
    """Hidden `layers`, each with its activation, and a linear last one."""
    parts: list[nn.Module] = []
    for width in layers:
        parts += [nn.Linear(inputs, width), ACTIVATIONS[activation]()]
        inputs = width
    return nn.Sequential(*parts, nn.Linear(inputs, outputs))


class _Limited(torch.autograd.Function):
    """See `limited`."""

    @staticmethod
    def forward(ctx: Any, values: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(values)
        return values.clamp(-1.0, 1.0)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> torch.Tensor:
        (values,) = ctx.saved_tensors
        further = ((values > 1.0) & (gradient < 0.0)) | ((values < -1.0) & (gradient > 0.0))
        return gradient.masked_fill(further, 0.0)


def limited(values: torch.Tensor) -> torch.Tensor:
    """Numbers limited to [-1, 1], whose gradient still says that they should come back from beyond.

    The true derivative there is zero, from which nothing could ever learn to push less.
    """
    result: torch.Tensor = _Limited.apply(values)  # type: ignore[no-untyped-call]
    return result
