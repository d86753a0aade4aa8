"""All motions that figures and claims are about, each computed once, when it is first asked for."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paper import measures
from paper.config import Config, Motion, Orbit
from spring_pendulum_env import Parameters, simulate
from spring_pendulum_env.dynamics import (
    Crossings,
    LyapunovExponent,
    PeriodicOrbit,
    Section,
    lyapunov_exponent,
    periodic_orbit,
    poincare_section,
)
from spring_pendulum_env.dynamics.progress import Progress
from spring_pendulum_env.simulation import Trajectory

FloatArray = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Start:
    """One start of the elastic pendulum in its plane."""

    state: FloatArray
    exponent: LyapunovExponent
    crossings: Crossings
    """Of X1 = 0 to the right."""

    @property
    def chaotic(self) -> bool:
        return is_chaotic(self.exponent)


def is_chaotic(found: LyapunovExponent) -> bool:
    """Whether an exponent is told from zero: by five standard errors, and from what a regular motion shows."""
    return found.exponent > max(5 * found.standard_error, 4 * found.resolution)


class Runs:
    """The motions of a config; with `progress`, what takes long draws a bar."""

    def __init__(self, config: Config, progress: bool = False) -> None:
        self.config = config
        self.progress = progress

    def ode45(self, motion: Motion, duration: float, rtol: float | None = None) -> Trajectory:
        """A motion by MATLAB's rules, at the solver's own points."""
        return simulate(
            motion.constants, motion.start, (0.0, duration), "ode45", motion.rtol if rtol is None else rtol, motion.atol
        )

    @cached_property
    def spinning(self) -> Trajectory:
        return self.ode45(self.config.spinning, self.config.spinning.duration)

    @cached_property
    def spinning_finer(self) -> Trajectory:
        return self.ode45(self.config.spinning, self.config.spinning.duration, self.config.spinning.finer_rtol)

    @cached_property
    def spinning_extremes(self) -> measures.Extremes:
        motion = self.config.spinning
        return measures.extremes(motion.constants, motion.start, motion.duration, spring=2)

    @cached_property
    def chaotic(self) -> Trajectory:
        return self.ode45(self.config.chaotic, self.config.chaotic.duration)

    @cached_property
    def chaotic_exponent(self) -> LyapunovExponent:
        return self.exponent(self.config.chaotic.constants, np.array(self.config.chaotic.start))

    @cached_property
    def periodic_orbit(self) -> PeriodicOrbit:
        return self._closed(self.config.periodic)

    @cached_property
    def periodic(self) -> Trajectory:
        return self._around(self.config.periodic, self.periodic_orbit)

    @cached_property
    def single_orbit(self) -> PeriodicOrbit:
        return self._closed(self.config.single)

    @cached_property
    def single(self) -> Trajectory:
        return self._around(self.config.single, self.single_orbit)

    @cached_property
    def pendulum_starts(self) -> list[Start]:
        pendulum = self.config.elastic_pendulum
        found = []
        with Progress("sections and exponents", len(pendulum.starts), show=self.progress) as bar:
            for height, rise in pendulum.starts:
                state = measures.on_energy(pendulum.constants, height, rise, pendulum.energy)
                crossings = poincare_section(pendulum.constants, state, Section.at("X1"), pendulum.section_duration)
                found.append(Start(state, self.exponent(pendulum.constants, state), crossings))
                bar.add(1)
        return found

    @cached_property
    def in_space_exponent(self) -> LyapunovExponent:
        pendulum = self.config.elastic_pendulum
        return self.exponent(pendulum.constants, np.array(pendulum.in_space))

    @cached_property
    def vertical_orbit(self) -> PeriodicOrbit:
        """One spring's oscillation on the vertical, under the anchor."""
        pendulum = self.config.elastic_pendulum
        p = pendulum.constants
        state = np.zeros(12)
        state[2] = -(p.L1 + p.m1 * p.g / p.k1) + pendulum.vertical_amplitude
        return periodic_orbit(p, state, 2 * np.pi * (p.m1 / p.k1) ** 0.5)

    @cached_property
    def no_gravity(self) -> list[tuple[float, measures.Extremes]]:
        """Speeds sideways, and the extremes of the motions."""
        gravity = self.config.no_gravity
        duration = 6 * 2 * np.pi * (gravity.constants.m1 / gravity.constants.k1) ** 0.5
        return [
            (speed, measures.extremes(gravity.constants, measures.sideways(gravity.distance, speed), duration))
            for speed in gravity.speeds
        ]

    def exponent(self, parameters: Parameters, state: FloatArray) -> LyapunovExponent:
        """Largest Lyapunov exponent, for as long as the config says."""
        lyapunov = self.config.lyapunov
        return lyapunov_exponent(parameters, state, lyapunov.duration, transient=lyapunov.transient)

    def _closed(self, motion: Orbit) -> PeriodicOrbit:
        return periodic_orbit(motion.constants, motion.start, motion.period)

    def _around(self, motion: Orbit, orbit: PeriodicOrbit) -> Trajectory:
        duration = motion.periods * orbit.period
        return simulate(orbit.parameters, orbit.state, (0.0, duration), "ode45", motion.rtol, motion.atol)
