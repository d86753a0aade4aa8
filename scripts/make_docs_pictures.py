"""Write the documentation's moving pictures, docs/pictures/TASK.gif: each task with what does it best, or alone."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import gymnasium as gym
import numpy as np
from PIL import Image

import agents
from agents.controller import Controller
from agents.evaluation import scenario_of
from agents.swing_up import PlannedSwingUp
from spring_pendulum_env.rendering import Renderer
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.tasks import TASKS

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "pictures"
SIZE = 300  # px
EVERY = 3  # steps of the environment for each picture
COLOURS = 40
SEED = 3
SECONDS = 4.5


def frames(environment_id: str) -> list[Image.Image]:
    """Pictures of one episode from the task's own start."""
    env = gym.make(environment_id)
    scenario = scenario_of(env)
    base: Any = env.unwrapped
    renderer = Renderer("rgb_array", 1.0 / scenario.control_period, scenario, size=(SIZE, SIZE))
    controller, memory = best(scenario), None
    observation, info = env.reset(seed=SEED)
    pictures = []
    for step in range(round(SECONDS / scenario.control_period)):
        force = info.get("force", np.zeros(3))
        picture = renderer.draw(base.state, base.parameters, force, info["time"])
        if step % EVERY == 0 and picture is not None:
            pictures.append(Image.fromarray(picture))
        action = None
        if controller:
            action, memory = controller.predict(observation, memory)
        observation, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    env.close()
    return pictures


def best(scenario: Scenario) -> Controller | None:
    """What does a task best: a shipped policy, or a plan where the task is to get somewhere; nothing if passive."""
    task = scenario.task
    if not task.actuated:
        return None
    if task.start_equilibrium:
        return PlannedSwingUp(scenario)
    return agents.load(scenario.equilibrium if task.chooses_equilibrium else task.name)


def write(file: Path, pictures: list[Image.Image], milliseconds: int) -> None:
    """A GIF that repeats, with one palette for all its pictures so that what is still stays the same bits."""
    some = pictures[:: max(1, len(pictures) // 8)]
    together = Image.new("RGB", (SIZE, SIZE * len(some)))
    for place, picture in enumerate(some):
        together.paste(picture, (0, SIZE * place))
    # The colours of most pixels, for the sky, and those that differ most, for the few pixels of springs and letters.
    ways = (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE)
    chosen = [together.quantize(COLOURS, method=way).getpalette() or [] for way in ways]
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colours in chosen for value in colours[: 3 * COLOURS]])
    flat = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    flat[0].save(file, save_all=True, append_images=flat[1:], duration=milliseconds, loop=0, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where they go (default: docs/pictures)")
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for environment_id, task in TASKS.items():
        file = folder / f"{task.name}.gif"
        write(file, frames(environment_id), 20 * EVERY)
        print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
