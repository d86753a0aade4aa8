"""The documentation: its examples run, its manuals are the docstring, its commands are there, its links lead on."""

from __future__ import annotations

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from spring_pendulum_env import SpringPendulumEnv
from spring_pendulum_env.tasks import TASKS

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)

pytest.importorskip("torch", reason="the pages train and load policies")


@pytest.fixture(autouse=True)
def _as_it_was(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A page may register what it likes: it is gone afterwards."""
    tasks, ids = dict(TASKS), set(gym.registry)
    monkeypatch.chdir(ROOT)
    yield
    TASKS.clear()
    TASKS.update(tasks)
    for name in set(gym.registry) - ids:
        del gym.registry[name]


@pytest.mark.parametrize("page", [page for page in PAGES if BLOCK.search(page.read_text())], ids=lambda page: page.stem)
def test_examples_of_a_page_run(page: Path) -> None:
    names: dict[str, Any] = {"__name__": "example"}
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        line = text.count("\n", 0, block.start(1))
        exec(compile("\n" * line + block[1], str(page), "exec"), names)


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.stem)
def test_commands_of_a_page_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"(?:^ {4}|`)make ([a-z-]+)", text, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"make {target}"
    for script in re.findall(r"scripts/\w+\.py", text):
        assert (ROOT / script).is_file(), script


@pytest.fixture
def extension(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imports one of the documentation's own extensions."""
    monkeypatch.syspath_prepend(str(DOCS))
    return lambda name: importlib.import_module(f"extensions.{name}")


def test_manuals_hold_the_whole_docstring_between_them_and_nothing_else(extension: Any) -> None:
    manual = extension("manual").manual
    pages = {environment_id: manual(environment_id) for environment_id in TASKS}
    docstring = inspect.cleandoc(SpringPendulumEnv.__doc__ or "")
    everything = "\n".join(pages.values())
    for line in docstring.splitlines():
        if line.startswith("|"):
            first = line.split("|")[1].strip()
            assert re.search(rf"^\| {re.escape(first)} \|", everything, re.MULTILINE) or set(first) == {"-"}, line
        else:
            assert all(line in page for page in pages.values()), line
    passive, damping, stabilisation, swing_up = pages.values()
    assert "max_force` | 20" in damping and "max_force` | 20" not in passive
    assert "| posture |" in stabilisation and "| posture |" not in damping + passive
    assert "(18,) | X0" in damping and "(18,) | X0" not in passive
    assert "| `equilibrium` |" in stabilisation and "| `equilibrium` |" not in damping + swing_up
    assert "| 0.5, e1 = 0.5 m |" in swing_up and "| 0.6, e1 = 0.3 m |" not in swing_up
    with pytest.raises(ValueError, match="Nope-v0"):
        manual("Nope-v0")


def test_links_that_lead_nowhere_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    check = importlib.import_module("check_links").check
    (tmp_path / "a.html").write_text('<a href="b.html#here">1</a><a href="b.html#not">2</a><img src="c.png">')
    (tmp_path / "b.html").write_text('<p id="here"></p><a href="https://example.org/x">3</a><a href="#">4</a>')
    faults, elsewhere = check(tmp_path)
    assert [fault.split(": ")[1] for fault in faults] == ["b.html#not", "c.png"]
    assert elsewhere == {"https://example.org/x": ["b.html"]}
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="empty"):
        check(tmp_path / "empty")


def test_moving_pictures_are_small_and_move() -> None:
    image = pytest.importorskip("PIL.Image")
    for task in TASKS.values():
        file = DOCS / "pictures" / f"{task.name}.gif"
        assert file.stat().st_size < 600_000
        with image.open(file) as picture:
            assert picture.n_frames > 50


def test_site_builds_without_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx", reason="Sphinx is not installed: pip install '.[docs]'")
    pytest.importorskip("furo", reason="Sphinx is not installed: pip install '.[docs]'")
    site = tmp_path / "site"
    # In a process of its own: autodoc changes the defaults of the functions that it documents.
    command = [sys.executable, "-m", "sphinx", "--quiet", "--fail-on-warning", "-d", tmp_path / "doctrees", DOCS, site]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    faults, _ = importlib.import_module("check_links").check(site)
    assert faults == []
    physics = (site / "physics.html").read_text()
    assert physics.count("<math") > 20
    assert 'id="equation-paper-30"' in physics
    assert not re.search(r"<script[^>]*src=\"https?:", physics)
