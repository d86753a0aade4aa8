"""The versions that pyproject.toml allows, each combination really installed and tested in an environment of its own.

For each Python from the oldest allowed on that is found on this machine: the core alone from its wheel, with the oldest
and with the newest releases that its requirements allow and that have wheels; and on one Python the training with the
oldest and the newest Gymnasium and Stable-Baselines3. uv resolves and installs; it is told what pip is told by
PIP_FIND_LINKS and PIP_EXTRA_INDEX_URL. A combination that was tested isn't tested again (--again does); the table goes
to build/matrix/matrix.md, the logs beside it. Ends with a status of 1 if one failed.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from agents import commands
from agents.files import write_json, write_text
from agents.tables import markdown

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
CORE = ("gymnasium", "numpy", "scipy", "numba")
TRAINING = ("gymnasium", "stable-baselines3", "sb3-contrib", "torch", "numpy", "numba")

CORE_TESTS = (
    "test_environments", "test_vector_env", "test_properties", "test_processes", "test_tasks", "test_equilibria",
    "test_simulation",
)  # fmt: skip
TRAINING_TESTS = ("test_environments", "test_processes", "test_sb3", "test_policies", "test_agents")
TOOLS = ("pytest>=8", "hypothesis>=6.100")

WHICH = "import sys; print(*sys.version_info[:2], sep='.'); print(sys.executable)"

TRAINED_ON = "3.11"
"""The Python of the combinations with torch, of which one environment takes a gigabyte."""


@dataclass(frozen=True)
class Combination:
    """What is installed, and which tests it must pass."""

    name: str
    python: str
    extra: str  # "" for the core alone
    resolution: str  # of uv: "highest" or "lowest-direct"
    tests: tuple[str, ...]
    shown: tuple[str, ...]
    """Packages whose versions the table names."""
    held: tuple[str, ...] = ()
    """Requirements besides."""


def combinations() -> list[Combination]:
    """All of the matrix, whether there is such a Python or not."""
    every = []
    for python in PYTHONS:
        for word, resolution in (("oldest", "lowest-direct"), ("newest", "highest")):
            every.append(Combination(f"core-{python}-{word}", python, "", resolution, CORE_TESTS, CORE))
    torch = next(line for line in (ROOT / "constraints.txt").read_text().splitlines() if line.startswith("torch=="))
    oldest = tuple(f"{name}=={oldest_allowed(name)}" for name in ("gymnasium", "stable-baselines3", "sb3-contrib"))
    for word, held in (("oldest", oldest), ("newest", ())):
        name = f"training-{TRAINED_ON}-{word}"
        tests = TRAINING_TESTS
        every.append(Combination(name, TRAINED_ON, "[train]", "highest", tests, TRAINING, (torch, *held)))
    return every


def oldest_allowed(package: str) -> str:
    """The lower bound of pyproject.toml."""
    found = re.search(rf'"{package}>=([0-9.]+)', (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    if found is None:
        raise ValueError(f"pyproject.toml has no lower bound for {package}")
    return found[1]


def interpreter(version: str) -> str | None:
    """A Python of that version on this machine: on the PATH, or one of pyenv's, whose own commands may not be set."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    candidates = [f"python{version}", *map(str, sorted(pyenv.glob(f"{version}.*/bin/python"), reverse=True))]
    for python in candidates:
        try:
            said = subprocess.run([python, "-c", WHICH], capture_output=True, text=True, check=False).stdout.split("\n")
        except OSError:
            continue
        if said[0] == version:
            return said[1]
    return None


def run(command: Sequence[str | Path], log: Path, cwd: Path, **more: str) -> bool:
    """Whether a command succeeds; what it says goes to the log."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    told = {"UV_FIND_LINKS": "PIP_FIND_LINKS", "UV_EXTRA_INDEX_URL": "PIP_EXTRA_INDEX_URL"}
    environment |= {ours: os.environ[pip] for ours, pip in told.items() if pip in os.environ} | more
    with log.open("a", encoding="utf-8") as file:
        file.write(f"$ {' '.join(map(str, command))}\n")
        file.flush()
        done = subprocess.run(
            list(map(str, command)), cwd=cwd, stdout=file, stderr=subprocess.STDOUT, env=environment, check=False
        )
    return done.returncode == 0


def copy_without_the_package(folder: Path) -> None:
    """The tests and all else that they need, so that they import the package that is installed."""
    shutil.rmtree(folder, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in listed.stdout.splitlines():
        if not name.startswith(("spring_pendulum_env/", "docs/")) and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def test(combination: Combination, python: str, wheel: Path, folder: Path) -> dict[str, str]:
    """Installs and tests one combination; what the table says of it."""
    log = folder / f"{combination.name}.log"
    log.unlink(missing_ok=True)
    place = folder / combination.name
    shutil.rmtree(place, ignore_errors=True)
    copy_without_the_package(place)
    inside = place / ".venv" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    package = f"spring-pendulum-env{combination.extra} @ {wheel.as_uri()}"
    install: list[str | Path] = ["uv", "pip", "install", "--python", inside, "--only-binary", ":all:"]
    # uv takes the lowest of what is named outright, so the requirements of the core stand here beside the wheel.
    named = [*requirements(), *combination.held] if combination.resolution != "highest" else combination.held
    passed = (
        run(["uv", "venv", "--python", python, place / ".venv"], log, place)
        and run([*install, "--resolution", combination.resolution, package, *named], log, place)
        and run([*install, *TOOLS], log, place)
        and run(
            [
                inside,
                "-m",
                "pytest",
                "-q",
                "-p",
                "no:cacheprovider",
                *(f"tests/{name}.py" for name in combination.tests),
            ],
            log,
            place,
            NUMBA_CACHE_DIR=str(place / "numba"),
        )
    )
    text = log.read_text(encoding="utf-8")
    counted = re.findall(r"^=*\s*(\d+ (?:passed|failed)[^=\n]*?)(?: in [\d.:]+s.*)?=*$", text, re.MULTILINE)
    versions = installed(inside, combination.shown)
    if passed:
        shutil.rmtree(place)
    return {"result": "passed" if passed else "FAILED", "tests": counted[-1].strip() if counted else "-", **versions}


def requirements() -> list[str]:
    """Those of the core, as pyproject.toml has them."""
    import tomllib

    with (ROOT / "pyproject.toml").open("rb") as file:
        needed: list[str] = tomllib.load(file)["project"]["dependencies"]
    return needed


def installed(python: Path, packages: Sequence[str]) -> dict[str, str]:
    """Versions of packages in an environment."""
    code = "import sys, importlib.metadata as m; print(*(m.version(name) for name in sys.argv[1:]))"
    done = subprocess.run([str(python), "-c", code, *packages], capture_output=True, text=True, check=False)
    return dict(zip(packages, done.stdout.split(), strict=False))


def table(results: dict[str, dict[str, str]], skipped: dict[str, str]) -> str:
    """One row for each combination."""
    rows = [["combination", "versions", "result", "tests"]]
    for name, told in results.items():
        versions = ", ".join(f"{key} {value}" for key, value in told.items() if key not in ("result", "tests"))
        rows.append([name, versions, told["result"], told["tests"]])
    rows += [[name, "", "skipped", why] for name, why in skipped.items()]
    return markdown(rows)


def main() -> None:
    parser = commands.Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("only", nargs="*", metavar="COMBINATION", help="for example core-3.12-oldest (default: all)")
    parser.add_argument("--again", action="store_true", help="test again what was tested before")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "matrix")
    options = parser.parse_args()
    if shutil.which("uv") is None:
        raise ValueError("uv is needed and isn't there: pip install uv")
    every = {combination.name: combination for combination in combinations()}
    for name in options.only:
        if name not in every:
            raise ValueError(f"combination {name!r}: must be one of {', '.join(every)}")
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "results.json"
    results: dict[str, dict[str, str]] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    skipped: dict[str, str] = {}
    wheels = folder / "wheel"
    shutil.rmtree(wheels, ignore_errors=True)
    if not run(["uv", "build", "--wheel", "--out-dir", wheels, ROOT], folder / "wheel.log", folder):
        raise ValueError(f"the wheel can't be built: {folder / 'wheel.log'}")
    (wheel,) = wheels.glob("*.whl")
    for name in options.only or every:
        python = interpreter(every[name].python)
        if python is None:
            skipped[name] = f"no Python {every[name].python} on this machine"
        elif options.again or results.get(name, {}).get("result") != "passed":
            print(f"{name} ...", end=" ", file=sys.stderr, flush=True)
            began = time.monotonic()
            results[name] = test(every[name], python, wheel, folder)
            print(f"{results[name]['result']} after {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
            write_json(path, results)
    text = table({name: results[name] for name in every if name in results}, skipped)
    print(text)
    write_text(folder / "matrix.md", text + "\n")
    if failed := [name for name, told in results.items() if told["result"] != "passed"]:
        print(f"failed: {', '.join(failed)}; their logs are in {folder}", file=sys.stderr)
        raise SystemExit(1)


if __name__ == "__main__":
    commands.run(main, "interrupted: the same command goes on where it stopped")
