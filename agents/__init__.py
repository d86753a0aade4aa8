"""Controllers for the actuated tasks: classical ones, learned ones, and what trains and compares them.

`import agents` is light; torch and Stable-Baselines3 are imported by what needs them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from agents.policy import LearnedPolicy


def load(name_or_folder: str | Path) -> LearnedPolicy:
    """Load a learned policy, whose `predict` takes the environment's raw observations, (18,) or (n, 18).

    `name_or_folder` is a shipped policy ("damping", "hanging-hanging", "hanging-inverted", "inverted-hanging",
    "inverted-inverted"; with "-randomised" behind the first, third and last, trained on randomised parameters) or the
    folder of a run. Raises ValueError where it is neither.
    """
    from agents.policy import LearnedPolicy

    return LearnedPolicy.load(name_or_folder)


__all__ = ["load"]
