"""Mutation testing of the equations, the equilibria and the tasks: which changes to the code does no test notice?

The mutants are cosmic-ray's: each operator, number, comparison, branch and decorator changed in turn, in a copy of the
sources under build/mutants. Its own runner would start the tests afresh for each of them, ten seconds of imports, and
mutmut's replaces functions by dispatchers, which numba can't compile; so here one process imports the libraries once
and forks for each mutant, and the tests that killed most so far go first. Of the dozen replacements for an arithmetical
operator one is tried (--all: all of them, mostly ones that raise a TypeError).

What was done is kept: the same command goes on where it stopped. Ends with a table and a diff of each survivor that
isn't in tests/equivalent_mutants.txt, and with a status of 1 if there is one. Linux and macOS only.
"""

from __future__ import annotations

import argparse
import difflib
import gc
import hashlib
import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands
from agents.files import write_json, write_text
from agents.tables import markdown

ROOT = Path(__file__).resolve().parent.parent

MODULES = {
    "physics": ("tests/test_physics.py", "tests/test_equilibria.py"),
    "equilibria": ("tests/test_equilibria.py", "tests/test_physics.py"),
    "tasks": ("tests/test_tasks.py",),
}
"""What is mutated, and the tests that are tried on it."""

SLOW = ("environment", "compiled", "ends_every_motion")
"""Parts of the names of tests that compile the step, which takes ten seconds for each mutant: they are left out."""

LIBRARIES = ("numpy", "scipy.integrate", "sympy", "casadi", "torch", "numba", "gymnasium", "mpmath", "pytest")
"""Imported once, before the first fork."""

OPPOSITES = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "Mod_Mul", "FloorDiv_Mul")
"""The one replacement of each arithmetical operator. | is none: it stands in annotations alone, which nothing runs."""

PYTEST = ("-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:unraisableexception")
"""Nothing that a process which lives for a second has no use for."""

LIMIT = 120
"""Seconds after which the tests of a mutant hang, which kills it."""

EQUIVALENT = ROOT / "tests" / "equivalent_mutants.txt"


@dataclass(frozen=True)
class Mutant:
    """A change to a module: the source after it, and what changed."""

    module: str
    operator: str
    source: str
    diff: str

    @property
    def key(self) -> str:
        """Of the changed lines alone, so that a change elsewhere keeps what is known of this mutant."""
        return hashlib.sha256(f"{self.module}\n{self.operator}\n{self.diff}".encode()).hexdigest()[:16]


def operators(everything: bool) -> list[str]:
    """Names of cosmic-ray's operators that are used."""
    from cosmic_ray import plugins

    names = []
    for name in plugins.operator_names():
        arithmetical = "ReplaceBinaryOperator_" in name
        if plugins.get_operator(name).arguments():
            continue  # those that need to be told names
        if everything or not arithmetical or name.split("_", 1)[1] in OPPOSITES:
            names.append(name)
    return names


def mutants(module: str, everything: bool) -> Iterator[Mutant]:
    """All of one module, each distinct source once."""
    from cosmic_ray import plugins
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code

    source = (ROOT / "spring_pendulum_env" / f"{module}.py").read_text(encoding="utf-8")
    seen = {source}
    nodes = list(ast_nodes(get_ast(source)))
    for name in operators(everything):
        operator = plugins.get_operator(name)()
        for occurrence in range(sum(len(list(operator.mutation_positions(node))) for node in nodes)):
            changed = mutate_code(source, operator, occurrence)
            if changed is None or changed in seen:
                continue
            seen.add(changed)
            lines = difflib.unified_diff(source.splitlines(), changed.splitlines(), lineterm="", n=0)
            diff = "\n".join(line for line in lines if not line.startswith(("---", "+++", "@@")))
            yield Mutant(module, name.split("/")[1], changed, diff)


class Order:
    """A pytest plugin: the tests that kill most in the least time go first, without those that compile.

    Tells which one failed, and how long each took.
    """

    def __init__(self, kills: Mapping[str, int], durations: Mapping[str, float]) -> None:
        self.kills, self.known = kills, durations
        self.failed = ""
        self.durations: dict[str, float] = {}

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if not any(part in item.name for part in SLOW)]
        items.sort(key=lambda item: -(1 + self.kills.get(item.nodeid, 0)) / (0.005 + self.known.get(item.nodeid, 0.0)))

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call":
            self.durations[report.nodeid] = report.duration
        if report.failed:
            self.failed = report.nodeid


def tests_fail(
    tree: Path, tests: tuple[str, ...], kills: Mapping[str, int], durations: Mapping[str, float]
) -> tuple[str, dict[str, float]]:
    """In a forked process: the first test that fails in that tree, "an import" or "hangs"; "" where all pass.

    And how long each took, s.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        os.chdir(tree)
        sys.path[:] = [str(tree), *(path for path in sys.path if path != str(ROOT))]
        for name in [name for name in sys.modules if name.split(".")[0] in ("agents", "spring_pendulum_env")]:
            del sys.modules[name]  # those of the tree take their place
        sys.dont_write_bytecode = True  # a stale .pyc of the same second and size would be taken for the mutant
        import pytest

        order = Order(kills, durations)
        status = pytest.main([*PYTEST, *tests], plugins=[order])
        with os.fdopen(writer, "w") as file:
            json.dump([order.failed or ("an import" if status else ""), order.durations], file)
        os._exit(0)
    os.close(writer)
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(child, signal.SIGKILL))
    signal.alarm(LIMIT)
    try:
        with os.fdopen(reader) as file:
            said = file.read()
    finally:
        signal.alarm(0)
        _, status = os.waitpid(child, 0)
    if status != 0:
        return "hangs", {}
    failed, taken = json.loads(said)
    return failed, taken


def tree_at(folder: Path) -> Path:
    """A fresh copy of what the tests need."""
    tree = folder / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "agents", "spring_pendulum_env", "tests",
         "pyproject.toml"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in listed.stdout.split("\n"):
        if name and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
    return tree


def equivalent_mutants() -> set[str]:
    """The keys of those that change nothing that could be tested, each with its reason in the file."""
    lines = EQUIVALENT.read_text(encoding="utf-8").splitlines() if EQUIVALENT.is_file() else []
    return {line.split()[0] for line in lines if line.strip() and not line.startswith("#")}


def main() -> None:
    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=f"of {', '.join(MODULES)} (default: all)")
    parser.add_argument("--all", action="store_true", help="every replacement of each arithmetical operator")
    parser.add_argument("--again", action="store_true", help="try the survivors again, after tests were added")
    parser.add_argument("--minutes", type=float, help="stop after so many; the same command goes on")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "mutants")
    options = parser.parse_args()
    for module in options.modules:
        if module not in MODULES:
            raise ValueError(f"module {module!r}: must be one of {', '.join(MODULES)}")
    folder = options.folder.resolve()
    path = folder / "results.json"
    results: dict[str, str] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if options.again:
        results = {key: killer for key, killer in results.items() if killer}
    chosen = [mutant for module in options.modules or MODULES for mutant in mutants(module, options.all)]
    left = [mutant for mutant in chosen if mutant.key not in results]
    print(f"{len(chosen)} mutants, {len(chosen) - len(left)} of them tried before", file=sys.stderr)
    if left:
        try_all(left, results, path, tree_at(folder), options.minutes)
    text = report(chosen, results)
    print(text)
    write_text(folder / "report.md", text + "\n")
    if any(mutant.key not in results for mutant in chosen):
        print("not done: the same command goes on where it stopped", file=sys.stderr)
        raise SystemExit(3)
    if survivors(chosen, results):
        raise SystemExit(1)


def try_all(left: list[Mutant], results: dict[str, str], path: Path, tree: Path, minutes: float | None) -> None:
    """Tries mutants, saving each result."""
    for library in LIBRARIES:
        importlib.import_module(library)
    from tqdm import tqdm  # type: ignore[import-untyped]

    gc.freeze()  # else each child looks through all of it when it ends

    durations: dict[str, float] = {}
    for tests in sorted({MODULES[mutant.module] for mutant in left}):
        failed, taken = tests_fail(tree, tests, {}, {})
        durations |= taken
        if failed:
            raise ValueError(f"the tests fail without any mutation, {failed} first")
    kills = Counter(results.values())
    until = time.monotonic() + 60.0 * minutes if minutes else float("inf")
    for mutant in tqdm(left, unit="mutant"):
        if time.monotonic() > until:
            break
        file = tree / "spring_pendulum_env" / f"{mutant.module}.py"
        original = file.read_text(encoding="utf-8")
        write_text(file, mutant.source)
        try:
            results[mutant.key], _ = tests_fail(tree, MODULES[mutant.module], kills, durations)
        finally:
            write_text(file, original)
        kills[results[mutant.key]] += 1
        write_json(path, results)


def survivors(chosen: list[Mutant], results: dict[str, str]) -> list[Mutant]:
    """Those that no test noticed and that aren't listed as equivalent."""
    equivalent = equivalent_mutants()
    return [mutant for mutant in chosen if results.get(mutant.key) == "" and mutant.key not in equivalent]


def report(chosen: list[Mutant], results: dict[str, str]) -> str:
    """A table of each module, and a diff of each survivor."""
    equivalent = equivalent_mutants()
    rows = [["module", "mutants", "killed", "equivalent", "survived", "not tried"]]
    for module in dict.fromkeys(mutant.module for mutant in chosen):
        keys = [mutant.key for mutant in chosen if mutant.module == module]
        counts = [
            len(keys),
            sum(bool(results.get(key)) for key in keys),
            sum(results.get(key) == "" and key in equivalent for key in keys),
            sum(results.get(key) == "" and key not in equivalent for key in keys),
            sum(key not in results for key in keys),
        ]
        rows.append([f"{module}.py", *(f"{count:,}" for count in counts)])
    diffs = [
        f"{mutant.key} {mutant.module}.py {mutant.operator}\n{mutant.diff}" for mutant in survivors(chosen, results)
    ]
    return "\n\n".join([markdown(rows), *diffs])


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
