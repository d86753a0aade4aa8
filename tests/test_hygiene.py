"""The package and the agents run no text, start no shell, unpickle nothing and open no connection."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = sorted(file for folder in ("spring_pendulum_env", "agents") for file in (ROOT / folder).rglob("*.py"))

NETWORK = {
    "aiohttp", "asyncio", "ftplib", "http", "httpx", "imaplib", "poplib", "requests", "smtplib", "socket",
    "socketserver", "ssl", "telnetlib", "urllib", "urllib3", "webbrowser", "websockets", "xmlrpc",
}  # fmt: skip
UNPICKLERS = {"cloudpickle", "dill", "joblib", "jsonpickle", "marshal", "pickle", "shelve"}
TEXT_RUNNERS = {"__import__", "compile", "eval", "exec"}
SHELLS = {"os.popen", "os.system", "subprocess.getoutput", "subprocess.getstatusoutput"}
STARTERS = {"subprocess.Popen", "subprocess.call", "subprocess.check_call", "subprocess.check_output", "subprocess.run"}
SAFE_YAML = {"dump", "safe_dump", "safe_load", "safe_load_all"}

ALLOWED = {
    ("agents/runs.py", "subprocess.run"): "asks git for the commit: a list of constant arguments, no shell",
}
"""File and finding: the reason."""


def full_name(node: ast.expr, imported: dict[str, str]) -> str:
    """`np.load` as numpy.load, whatever numpy was imported as; "" where it is no plain name."""
    if isinstance(node, ast.Name):
        return imported.get(node.id, node.id)
    if isinstance(node, ast.Attribute):
        before = full_name(node.value, imported)
        return f"{before}.{node.attr}" if before else ""
    return ""


def constant(call: ast.Call, argument: str) -> object:
    """The value of a keyword argument, if it is a constant."""
    for keyword in call.keywords:
        if keyword.arg == argument and isinstance(keyword.value, ast.Constant):
            return keyword.value.value
    return None


def findings(source: str) -> Iterator[str]:
    """What in a source could run what it reads, start a process or open a connection."""
    tree = ast.parse(source)
    imported: dict[str, str] = {}
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [(alias.name, alias.asname or alias.name.split(".")[0], alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [(node.module, alias.asname or alias.name, f"{node.module}.{alias.name}") for alias in node.names]
        for module, local, full in names:
            imported[local] = full if local != full.split(".")[0] else local
            if module.split(".")[0] in NETWORK | UNPICKLERS:
                yield f"import {module.split('.')[0]}"
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = full_name(node.func, imported)
        if name in TEXT_RUNNERS | SHELLS | STARTERS or name.startswith(("os.exec", "os.spawn")):
            yield name
        if constant(node, "shell"):
            yield "shell=True"
        if name == "torch.load" and constant(node, "weights_only") is not True:
            yield "torch.load without weights_only=True"
        if name == "numpy.load" and constant(node, "allow_pickle") is not False:
            yield "numpy.load without allow_pickle=False"
        if name.startswith("yaml.") and not name.endswith("Error") and name.split(".")[1] not in SAFE_YAML:
            yield name


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_source_runs_nothing_that_it_reads(file: Path) -> None:
    name = file.relative_to(ROOT).as_posix()
    wrong = {finding for finding in findings(file.read_text(encoding="utf-8")) if (name, finding) not in ALLOWED}
    assert not wrong, f"{wrong}: do without, or give the reason in ALLOWED"


def test_exceptions_are_still_needed() -> None:
    for name, finding in ALLOWED:
        assert finding in findings((ROOT / name).read_text(encoding="utf-8")), (name, finding)


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("eval(text)", "eval"),
        ("exec(compile(text, '', 'exec'))", "compile"),
        ("__import__(name)", "__import__"),
        ("import subprocess\nsubprocess.run(text, shell=True)", "shell=True"),
        ("from subprocess import run as go\ngo(['ls'])", "subprocess.run"),
        ("import os\nos.system(text)", "os.system"),
        ("import os\nos.execv(path, [])", "os.execv"),
        ("import pickle as p", "import pickle"),
        ("from cloudpickle import loads", "import cloudpickle"),
        ("import torch\ntorch.load(path)", "torch.load without weights_only=True"),
        ("import torch\ntorch.load(path, weights_only=False)", "torch.load without weights_only=True"),
        ("import numpy as np\nnp.load(path)", "numpy.load without allow_pickle=False"),
        ("from numpy import load\nload(path, allow_pickle=True)", "numpy.load without allow_pickle=False"),
        ("import yaml\nyaml.load(text, Loader=yaml.Loader)", "yaml.load"),
        ("import yaml\nyaml.unsafe_load(text)", "yaml.unsafe_load"),
        ("import urllib.request", "import urllib"),
        ("from socket import create_connection", "import socket"),
        ("def f():\n    import http.client", "import http"),
    ],
)
def test_what_must_not_be_is_found(source: str, found: str) -> None:
    assert found in list(findings(source))


@pytest.mark.parametrize(
    "source",
    [
        "import torch\ntorch.load(path, map_location='cpu', weights_only=True)",
        "import numpy as np\nnp.load(path, allow_pickle=False)",
        "import yaml\nyaml.safe_load(text)",
        "import re\nre.compile(text)",
        "model.eval()",
    ],
)
def test_what_may_be_is_not_found(source: str) -> None:
    assert list(findings(source)) == []


WATCHED = """
import sys
import gymnasium as gym
import numpy as np
import spring_pendulum_env
FORBIDDEN = ("socket.", "subprocess.", "os.system", "os.exec", "os.posix_spawn", "os.fork", "urllib.", "webbrowser.")
seen = []
more = []
sys.addaudithook(lambda event, args: seen.append((event, args)) if event.startswith((*FORBIDDEN, *more)) else None)
for name in spring_pendulum_env.TASKS:
    env = gym.make(name)
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape))
    many = gym.make_vec(name, num_envs=3, threads=2)
    many.reset(seed=0)
    many.step(np.zeros(many.action_space.shape))
assert not seen, seen
import agents
agents.load("damping").predict(np.zeros(18))  # imports what it needs
seen.clear()
more.append("pickle.")
agents.load("damping").predict(np.zeros(18))
agents.load("inverted-inverted").predict(np.zeros(18))
assert not seen, seen
import pickle
pickle.loads(pickle.dumps(agents.load))
assert seen, "the hook sees nothing"
print("nothing seen")
"""


def test_running_starts_nothing_and_connects_to_nothing() -> None:
    """Python's own audit events tell; pickle's too, by which numba's cache is read, but no policy."""
    done = subprocess.run([sys.executable, "-c", WATCHED], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "nothing seen" in done.stdout, done.stderr
