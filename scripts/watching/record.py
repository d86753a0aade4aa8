"""An episode as arrays, for those that show all of it at once: the page and the figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spring_pendulum_env import Parameters, energy, physics
from spring_pendulum_env.equilibria import vertical_state
from spring_pendulum_env.scenario import Scenario
from watching.episode import Episode

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """What one controller did: n instants, the first one the start."""

    name: str
    ended: str  # why, or nothing where the time was up
    scenario: Scenario
    parameters: Parameters
    times: FloatArray  # s, (n,)
    states: FloatArray  # m and m/s, (n, 18)
    forces: FloatArray  # N, over the control period before; zero at the start; (n, 3)
    errors: FloatArray  # of the energy, as `info` has it, (n,)

    @property
    def energy(self) -> FloatArray:
        """Kinetic plus potential energy, J; (n,)."""
        return np.asarray(energy(self.parameters, self.states))

    @property
    def excess_energy(self) -> FloatArray:
        """Above that of the task's equilibrium, J; (n,)."""
        rest = vertical_state(*self.scenario.spring_heights(self.parameters))
        excess: FloatArray = self.energy - float(energy(self.parameters, rest))
        return excess

    @property
    def kinetic_energy(self) -> FloatArray:
        """J; (n,)."""
        p = self.parameters
        return np.asarray(physics.kinetic_energy(*[*self.states[:, 9:].T, p.m0, p.m1, p.m2]))

    @property
    def lengths(self) -> FloatArray:
        """Of both springs, m; (n, 2)."""
        bodies = self.states[:, :9].reshape(-1, 3, 3)
        return np.stack([physics.length(*(bodies[:, end] - bodies[:, end - 1]).T) for end in (1, 2)], axis=1)


def record(episode: Episode, seed: int, seconds: float) -> Record:
    """Run an episode from the start of a seed until it ends or the time is up."""
    episode.reset(seed)
    times, states, forces, errors = [episode.time], [episode.state], [episode.force], [episode.info["energy_error"]]
    for _ in range(round(seconds / episode.period)):
        episode.step()
        if episode.time == times[-1]:  # the step couldn't be done
            break
        times.append(episode.time)
        states.append(episode.state)
        forces.append(episode.force)
        errors.append(episode.info["energy_error"])
        if episode.ended:
            break
    arrays = (np.array(times), np.array(states), np.array(forces), np.array(errors))
    return Record(episode.name, episode.ended, episode.scenario, episode.parameters, *arrays)
