"""The tasks: what each starts from, rewards and ends on. A task is a record of numbers; a new task is a new record.

The reward is a weighted sum of terms, each in [0, 1], with weights that sum to 1, so it lies in [0, 1]. The terms stand
in `reward_terms` for all tasks, in plain arithmetic like physics.py, since they run inside the compiled step. They are
rational functions: their tails still tell a bad state from a worse one, where a Gaussian's are flat.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from spring_pendulum_env.physics import Scalar

REWARD_TERMS = ("energy", "posture", "stillness", "centring", "effort")
"""Names of what `reward_terms` returns, in its order."""


@dataclasses.dataclass(frozen=True)
class Task:
    """What a registered environment asks for."""

    name: str
    actuated: bool
    """Whether a force acts on the anchor; if not, it is held at the origin and observations have 12 numbers, not 18."""
    max_episode_steps: int
    equilibrium: str
    """Where the masses are wanted: the default of the argument of that name, or the fixed one."""
    chooses_equilibrium: bool
    """Whether `equilibrium` is an argument of this task."""
    start_displacement: float
    """Standard deviation of each mass's start about the equilibrium that it starts from, m on each axis."""
    start_velocity: float
    """Standard deviation of each mass's velocity at the start, m/s on each axis."""
    tolerance: float | None
    """Default of the argument of that name: None for the splitting, a number for the adaptive scheme."""
    start_equilibrium: str | None = None
    """The equilibrium about which episodes start, if it isn't the one where the masses are wanted."""
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Weight of each reward term; those that aren't named weigh nothing."""
    energy_scale: float = 1.0
    """Excess energy at which the term `energy` is one half, J."""
    posture_scale: float = 0.3
    """Error of the spring vectors (both together) at which the term `posture` is one half, m."""
    velocity_scale: float = 1.0
    """Speed (all bodies together) at which the term `stillness` is one half, m/s."""
    centring_scale: float = 1.0
    """Distance of the anchor from the origin at which the term `centring` is one half, m."""
    largest_deviation: float = math.inf
    """The episode ends when a mass is further than this from its place relative to the anchor, m."""

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the reward terms in use."""
        return tuple(term for term in REWARD_TERMS if self.weights.get(term, 0.0) > 0.0)


def reward_terms(
    excess_energy: Scalar,
    posture_error: Scalar,
    speed: Scalar,
    anchor_distance: Scalar,
    effort: Scalar,
    energy_scale: Scalar,
    posture_scale: Scalar,
    velocity_scale: Scalar,
    centring_scale: Scalar,
) -> tuple[Scalar, ...]:
    """Each reward term, unweighted, in [0, 1]; the arguments up to `effort` are squares but for the energy.

    Args:
        excess_energy: above the task's equilibrium, J; its absolute value counts.
        posture_error: squared error of both spring vectors, m2.
        speed: sum of the squared velocities of the three bodies, m2/s2.
        anchor_distance: squared distance of the anchor from the origin, m2.
        effort: mean of the squared action over the actuated axes, at most 1.
    """
    return (
        1.0 / (1.0 + abs(excess_energy) / energy_scale),
        1.0 / (1.0 + posture_error / (posture_scale * posture_scale)),
        1.0 / (1.0 + speed / (velocity_scale * velocity_scale)),
        1.0 / (1.0 + anchor_distance / (centring_scale * centring_scale)),
        1.0 - effort,
    )


def displaced(rest: Scalar, spread: Scalar, noise: Scalar) -> Scalar:
    """A number of the state at the start, from its value at rest, its standard deviation, and a normal number."""
    return rest + spread * noise


PASSIVE = Task(
    name="passive",
    actuated=False,
    max_episode_steps=1000,
    equilibrium="hanging-hanging",
    chooses_equilibrium=False,
    start_displacement=0.4,
    start_velocity=1.0,
    tolerance=1e-13,
)

DAMPING = Task(
    name="damping",
    actuated=True,
    max_episode_steps=500,
    equilibrium="hanging-hanging",
    chooses_equilibrium=False,
    start_displacement=0.4,
    start_velocity=1.0,
    tolerance=None,
    weights={"energy": 0.8, "centring": 0.15, "effort": 0.05},
)

STABILISATION = Task(
    name="stabilisation",
    actuated=True,
    max_episode_steps=500,
    equilibrium="inverted-inverted",
    chooses_equilibrium=True,
    start_displacement=0.05,
    start_velocity=0.05,
    tolerance=None,
    weights={"posture": 0.6, "stillness": 0.15, "centring": 0.2, "effort": 0.05},
    largest_deviation=1.5,
)

SWING_UP = Task(
    name="swing-up",
    actuated=True,
    max_episode_steps=500,
    equilibrium="inverted-inverted",
    chooses_equilibrium=False,
    start_equilibrium="hanging-hanging",
    start_displacement=0.05,
    start_velocity=0.05,
    tolerance=None,
    # No stillness: hanging at rest has it for nothing, and upright with no energy to spare is at rest.
    weights={"energy": 0.3, "posture": 0.5, "centring": 0.15, "effort": 0.05},
    energy_scale=10.0,
    posture_scale=0.5,
)

TASKS = {
    "SpringPendulumPassive-v0": PASSIVE,
    "SpringPendulumDamping-v0": DAMPING,
    "SpringPendulumStabilisation-v0": STABILISATION,
    "SpringPendulumSwingUp-v0": SWING_UP,
}
"""The registered ids."""


def task_named(name: str) -> Task:
    """The task of that name.

    Raises:
        ValueError: there is none.
    """
    for task in TASKS.values():
        if task.name == name:
            return task
    raise ValueError(f"task = {name!r}: must be one of {', '.join(task.name for task in TASKS.values())}")
