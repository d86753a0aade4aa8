"""A manual page for each environment id, made from the one docstring of the class that they share.

In a page `<!-- manual: ID -->` stands for the facts of an id and its share of the docstring: rows and columns
of its tables that are marked there as another mode's or another task's are left out. Nothing is worded here.
"""

from __future__ import annotations

import inspect
import re
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from spring_pendulum_env import SpringPendulumEnv
from spring_pendulum_env.tasks import TASKS, Task

if TYPE_CHECKING:  # so that the tests can do without Sphinx
    from sphinx.application import Sphinx

MARK = re.compile(r"<!-- manual: (\S+) -->")
MODES = ("passive", "actuated")


def manual(environment_id: str) -> str:
    """Markdown of the manual of an id.

    Raises:
        ValueError: an id that isn't registered.
    """
    if environment_id not in TASKS:
        raise ValueError(f"manual: {environment_id!r}: must be one of {', '.join(TASKS)}")
    task = TASKS[environment_id]
    text = inspect.cleandoc(SpringPendulumEnv.__doc__ or "")
    blocks = [_of(block, task) for block in text.split("\n\n")]
    return _fenced("\n\n".join([_facts(environment_id), *(block for block in blocks if block)]))


def others(task: Task) -> set[str]:
    """Words by which the docstring marks what isn't for this task."""
    names = {other.name for other in TASKS.values()} | set(MODES)
    return names - {task.name, "actuated" if task.actuated else "passive"}


def _facts(environment_id: str) -> str:
    """What Gymnasium's manual pages begin with."""
    env = gym.make(environment_id)
    spec = env.spec
    assert spec is not None
    rows = {
        "Action space": f"`{env.action_space}`",
        "Observation space": f"`{env.observation_space}`",
        "Time limit": f"{spec.max_episode_steps:,} steps",
        "Make it": f'`gym.make("{environment_id}")`',
    }
    env.close()
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())])


def _of(block: str, task: Task) -> str:
    """A paragraph or table of the docstring as far as it is about a task; nothing where it isn't."""
    if block.startswith("|"):
        return _table(block, task)
    return block


def _table(block: str, task: Task) -> str:
    """A table without other tasks' columns and rows."""
    rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))] for line in block.splitlines()]
    head, wrong = rows[0], others(task)
    columns = [number for number, name in enumerate(head) if name not in wrong]
    kept = [rows[0], rows[1]]
    for row in rows[2:]:
        first = row[0].strip("`")
        if first in wrong:
            continue
        marked = re.search(r"\((\w+)\)$", row[-1])
        if marked and marked[1] in wrong:
            continue
        if task.name in head and row[head.index(task.name)] == "-":
            continue
        kept.append(row)
    if len(kept) == 2 or (set(head) & {t.name for t in TASKS.values()} and task.name not in head):
        return ""
    return "\n".join(f"| {' | '.join(row[number] for number in columns)} |" for row in kept)


def _fenced(text: str) -> str:
    """Examples as blocks of code."""
    parts = []
    for block in text.split("\n\n"):
        parts.append(f"```pycon\n{block}\n```" if block.startswith(">>>") else block)
    return "\n\n".join(parts)


def fill(_app: Sphinx, _page: str, source: list[str]) -> None:
    source[0] = MARK.sub(lambda mark: manual(mark[1]), source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", fill)
    return {"parallel_read_safe": True}
