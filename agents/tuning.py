"""Tuning the classical controllers by a search, so that what is learned is compared with the best of its kind.

Differential evolution (Storn and Price, J. Global Optim. 11, 1997; SciPy's) over the logarithms of the weights, on
starts of its own. The whole population plays its episodes side by side, so a generation costs one roll-out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from agents.baselines import Damper
from agents.config import ENVIRONMENT_IDS
from agents.controller import StateFeedback
from agents.evaluation import TUNING_SEED, Trial
from agents.lqr import EFFORT_WEIGHT, LQR, STATE_WEIGHTS
from agents.measures import measures_of
from agents.rollout import roll_out, scenario_for
from spring_pendulum_env.scenario import Scenario

Array = NDArray[np.float64]

SPAN = 1.7  # decades by which a weight may differ from where the search begins


class Stack(StateFeedback):
    """Several controllers as one: the rows of a stack are shared out among them in equal runs."""

    def __init__(self, controllers: Sequence[StateFeedback]) -> None:
        self.controllers = controllers

    def actions(self, observations: NDArray[np.float64], deterministic: bool) -> NDArray[np.float64]:
        """(n, axes) for observations (n, 18); n is a multiple of the number of controllers."""
        shares = np.split(observations, len(self.controllers))
        pairs = zip(self.controllers, shares, strict=True)
        return np.concatenate([controller.actions(share, deterministic) for controller, share in pairs])


@dataclass(frozen=True)
class Search:
    """What is searched: `make(scenario, logarithms)` gives a controller, or None where there is none."""

    make: Callable[[Scenario, Array], StateFeedback | None]
    centre: Array
    """Decadic logarithms of the settings with which the search begins."""
    settings: Callable[[Array], dict[str, Any]]
    """Logarithms as the settings that are written down."""


def _lqr(scenario: Scenario, logarithms: Array) -> StateFeedback | None:
    try:
        return LQR(
            scenario.parameters,
            scenario.equilibrium,
            control_period=scenario.control_period,
            max_force=scenario.max_force,
            actuated_axes=scenario.actuated_axes,
            **_lqr_settings(logarithms),
        )
    except ValueError:  # weights so far apart that the Riccati equation has no numerical solution
        return None


def _lqr_settings(logarithms: Array) -> dict[str, Any]:
    """The scale of all weights is free: what is written is the effort's weight as it always was."""
    weights = [float(f"{10.0**logarithm:.4g}") for logarithm in logarithms]
    return {"state_weights": weights, "effort_weight": EFFORT_WEIGHT}


def _damper(scenario: Scenario, logarithms: Array) -> StateFeedback:
    settings = _damper_settings(logarithms)
    return Damper(**settings, max_force=scenario.max_force, actuated_axes=scenario.actuated_axes)


def _damper_settings(logarithms: Array) -> dict[str, Any]:
    return {
        name: float(f"{10.0**logarithm:.4g}") for name, logarithm in zip(("brake", "centring"), logarithms, strict=True)
    }


SEARCHES = {
    "lqr": Search(_lqr, np.log10(STATE_WEIGHTS), _lqr_settings),
    "damper": Search(_damper, np.log10([10.0, 1.0]), _damper_settings),
}
"""By name of the controller."""


def cost(values: dict[str, Array], trial: Trial, duration: float) -> Array:
    """What the search makes small, (n,) for each episode: between 0 and 1 for stabilisation.

    Damping: settling time, an unsettled start counting as the whole episode, plus the integral of excess energy over
    its start, both in s. Stabilisation: 1 for a start that is lost, else a little for the time it took.
    """
    time = np.minimum(values[measures_of(trial.environment_id).time], duration)
    if trial.environment_id == ENVIRONMENT_IDS["damping"]:
        return np.asarray(time + values["energy_integral"])
    return np.asarray(1.0 - values["recovered"] * (1.0 - 0.1 * time / duration))


def population_costs(controllers: Sequence[StateFeedback], trial: Trial, starts: int) -> Array:
    """The mean cost (n,) of each controller over the first so many starts for tuning."""
    seeds = [TUNING_SEED + start for start in range(starts)] * len(controllers)
    episodes = roll_out(Stack(controllers), trial.environment_id, trial.arguments, seeds)
    values = measures_of(trial.environment_id).compute(episodes)
    return np.asarray(cost(values, trial, float(episodes.times[-1])).reshape(len(controllers), starts).mean(axis=1))


def tune(
    trial: Trial,
    controller: str,
    *,
    starts: int = 200,
    generations: int = 40,
    population: int = 5,
    seed: int = 0,
    progress: Callable[[int, float], None] | None = None,
) -> dict[str, Any]:
    """Settings of "lqr" or "damper" for a trial, with what is to be known about how they were found.

    `population` is the number of candidates for each setting; `progress` hears of each generation and the lowest cost.
    Raises ValueError for another controller.
    """
    if controller not in SEARCHES:
        raise ValueError(f"controller is {controller!r}; allowed are {', '.join(SEARCHES)}")
    search = SEARCHES[controller]
    scenario = scenario_for(trial.environment_id, trial.arguments)
    lowest = np.inf
    generation = 0

    def costs(columns: Array) -> Array:
        nonlocal lowest, generation
        made = [search.make(scenario, column) for column in np.atleast_2d(columns.T)]
        found = np.full(len(made), np.inf)
        stabilising = [number for number, each in enumerate(made) if each is not None]
        if stabilising:
            found[stabilising] = population_costs([each for each in made if each is not None], trial, starts)
        lowest = min(lowest, float(found.min()))
        if progress is not None:
            progress(generation, lowest)
        generation += 1
        return found

    result = differential_evolution(
        costs,
        [(value - SPAN, value + SPAN) for value in search.centre],
        x0=search.centre,
        maxiter=generations,
        popsize=population,
        tol=0.0,
        rng=seed,
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    found_by = {"starts": starts, "generations": generations, "population": population, "seed": seed}
    return search.settings(result.x) | {"cost": round(float(result.fun), 5), "search": found_by}
