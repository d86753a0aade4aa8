"""What an episode can be made harder by, beyond its start: a controller is robust that does its task even so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Disturbance:
    """Arguments:
    parameters: constants of each episode by name, arrays (n,), unknown to the controller.
    noise: standard deviation of what is added to each observation, m and m/s.
    delay: control periods by which an action comes late; until the first one comes there is no force.
    kick: impulse on each mass, N s, in a random direction, once.
    kick_time: when, s.
    seed: of noise and kicks.

    Raises ValueError for a negative number.
    """

    parameters: Mapping[str, Array] = field(default_factory=dict)
    noise: float = 0.0
    delay: int = 0
    kick: float = 0.0
    kick_time: float = 2.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("noise", "delay", "kick", "kick_time", "seed"):
            value = getattr(self, name)
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} is {value!r}; allowed is a finite number from 0 on")

    def kicks(self, n: int) -> Array:
        """Impulses (n, 2, 3), N s: one direction for each mass of each episode, evenly over the sphere."""
        directions = np.random.default_rng([self.seed, 1]).standard_normal((n, 2, 3))
        scaled: Array = self.kick * directions / np.linalg.norm(directions, axis=2, keepdims=True)
        return scaled


CALM = Disturbance()
