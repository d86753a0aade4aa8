"""The pendulums of the regression suite: every kind that the equations allow, each from a start of its own."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import Parameters
from spring_pendulum_env.physics import AXES

FloatArray = NDArray[np.float64]

SEED = 20240607
PERIOD = 0.02
"""Control period, s."""
MAX_FORCE = 16.0
"""N; a power of two, so that an action times it is exact."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One motion: everything that an integrator needs to know."""

    name: str
    parameters: dict[str, float]
    actuated_axes: str
    """Axes along which the anchor moves; none: the passive pendulum."""
    start: list[float]
    """12 numbers, or 18 with the anchor; m, then m/s."""
    counts: list[int]
    """Control periods until each record."""
    actions: list[list[float]]
    """Force on the anchor in units of MAX_FORCE, repeated in turn, one for each control period; empty: none."""

    @property
    def whole_start(self) -> list[float]:
        """18 numbers, the anchor's first."""
        still = [0.0] * 3
        return self.start if len(self.start) == 18 else [*still, *self.start[:6], *still, *self.start[6:]]

    @property
    def forces(self) -> FloatArray:
        """N along x, y and z in each control period; shape (periods, 3)."""
        forces = np.zeros((self.counts[-1], 3))
        for i, action in enumerate(self.actions):
            for axis, share in zip(self.actuated_axes, action, strict=True):
                forces[i :: len(self.actions), AXES.index(axis)] = MAX_FORCE * share
        return forces

    def as_dict(self) -> dict[str, Any]:
        """What identifies the case, JSON-able."""
        return dataclasses.asdict(self)


def _start(random: np.random.Generator, p: Parameters, angle: float, speed: float) -> list[float]:
    """Springs about their lengths under load, turned away from the vertical by about `angle` rad, and speeds of about
    `speed` m/s; three decimals."""
    load1 = (p.m1 + p.m2) * p.g / p.k1 if p.k1 > 0 else 0.0
    load2 = p.m2 * p.g / p.k2 if p.k2 > 0 else 0.0
    places = []
    end = np.zeros(3)
    for rest in (p.L1 + load1, p.L2 + load2):
        polar = angle * random.uniform(0.8, 1.2)
        turn = random.uniform(0, 2 * np.pi)
        direction = [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)]
        end = end + rest * random.uniform(0.95, 1.1) * np.array(direction)
        places.append(end)
    return [round(float(number), 3) + 0.0 for number in (*places[0], *places[1], *random.normal(0, speed, 6))]


def cases() -> list[Case]:
    """All of them; the same ones at every call."""
    random = np.random.default_rng(SEED)
    made = []

    def passive(name: str, angle: float, speed: float, seconds: float, **parameters: float) -> None:
        start = _start(random, Parameters(**parameters), angle, speed)
        if name == "planar":
            start[1::3] = [0.0] * 4
        made.append(Case(name, parameters, "", start, _records(seconds), []))

    def actuated(name: str, axes: str, actions: list[list[float]], seconds: float, **parameters: float) -> None:
        hung = _start(random, Parameters(**parameters), 0.5, 0.3)
        anchor = [round(float(x), 3) for x in random.normal(0, 0.2, 3)]
        moved = [round(x + anchor[i % 3], 3) for i, x in enumerate(hung[:6])]
        speed = [
            round(float(v), 3) if axis in axes else 0.0 for axis, v in zip(AXES, random.normal(0, 0.3, 3), strict=True)
        ]
        start = [*anchor, *moved, *speed, *hung[6:]]
        made.append(Case(name, parameters, axes, start, _records(seconds), actions))

    passive("regular", 0.15, 0.2, 20, m1=1.3, m2=0.6, k1=110.0, k2=45.0, L1=0.9, L2=1.1)
    passive("chaotic", 1.9, 0.5, 12, m1=0.8, m2=1.2, k1=130.0, k2=85.0, L1=1.1, L2=0.8)
    passive("planar", 1.3, 0.5, 12, m1=1.1, m2=0.9, k1=95.0, k2=120.0)
    passive("stiff", 0.9, 0.5, 6, m1=0.9, m2=1.4, k1=2.5e4, k2=6e3, L1=0.7, L2=1.2)
    passive("mass-ratio", 0.8, 0.3, 10, m1=400.0, m2=0.5, k1=1.5e4, k2=60.0)
    passive("no-spring-1", 0.9, 1.5, 10, m1=1.6, m2=0.7, k1=0.0, k2=75.0, L2=1.3)
    passive("no-spring-2", 1.0, 0.7, 12, m1=0.7, m2=1.0, k1=55.0, k2=0.0, L1=1.2)
    passive("no-lengths", 0.8, 0.8, 12, m1=1.2, m2=0.8, k1=60.0, k2=40.0, L1=0.0, L2=0.0)
    passive("no-gravity", 1.2, 1.0, 12, m1=1.5, m2=0.9, k1=70.0, k2=110.0, L1=0.8, L2=1.1, g=0.0)
    passive("drag", 1.6, 0.8, 12, m1=1.1, m2=0.7, k1=80.0, k2=90.0, R1=0.25, R2=0.12)
    wave = [[round(float(np.sin(0.1 * i)), 3), round(0.5 * float(np.cos(0.2 * i)), 3)] for i in range(0, 63)]
    actuated("pushed", "xyz", [[0.125, -0.25, 0.0625]], 10, m0=1.4, m1=0.8, m2=1.1, k1=120.0, k2=80.0, R0=0.9, R1=0.2)
    actuated("driven", "xz", wave, 10, m0=0.8, m1=1.1, m2=0.7, k1=90.0, k2=100.0, L1=1.1, L2=0.9)
    return made


def _records(seconds: float) -> list[int]:
    """Periods until the records: a short time, then four equally spaced ones."""
    return [round(0.2 / PERIOD), *(round(seconds * share / PERIOD) for share in (0.25, 0.5, 0.75, 1.0))]
