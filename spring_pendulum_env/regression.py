"""Checks an installation: integrates reference cases that ship with the package, and says how far off they end.

    python -m spring_pendulum_env.regression [--case NAME] [--json FILE]

The references (data/regression_cases.json, made by scripts/make_regression_cases.py) are known to all their digits. How
large an error may be depends on the motion: nothing reckoned in double precision is better than

    rounding = 2.2e-16 x growth x (1 + largest number of the state),

growth being the factor by which a tiny error made at any time before can have grown. Errors are given in units of that.
The limit of an adaptive scheme has its tolerance in place of the 2.2e-16, and a factor for how its errors add up. The
splitting has no tolerance: its own error is looked at after a short time, and its energy error at the end, against
limits that hold for its steps of at most 0.02 s. Exits with 0 if all is within its limit, 1 if something isn't, 2 if
called wrongly.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import importlib.resources
import json
import math
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import spring_pendulum_env
from spring_pendulum_env.simulation import TOLERANCE, simulate

FloatArray = NDArray[np.float64]
Case = dict[str, Any]

ROUNDING = float(np.finfo(np.float64).eps)
ADAPTIVE = 1e-13
"""Tolerance of the environment's adaptive scheme; that of `simulate` is its default."""
ENVIRONMENT_MARGIN = 1.0
"""Tolerances that the environment may be off where nothing grows. It errs far less: no step is longer than 0.02 s."""
SIMULATE_MARGIN = 10.0
"""The same of `simulate`, whose steps are as long as its tolerance lets them be, and which errs in each of them."""
SHORT_ERROR = 1e-8
"""Of the splitting after its first record, 0.2 s, relative to 1 + |state|."""
ENERGY_ERROR = 1e-7
"""Of the splitting at the end, relative to the energy at the start."""


@dataclasses.dataclass(frozen=True)
class Row:
    """How one way of integrating fared on one case."""

    case: str
    scheme: str
    time: float
    """Of the record that is nearest to its limit, s."""
    error: float
    """Largest of all components there, m or m/s; of an energy, relative."""
    growth: float | None
    """Of errors until then; None where the scheme's own error counts, and nothing that has grown."""
    conditioning: float | None
    """The error in units of what rounding may have made of itself by then."""
    limit: float
    """What the error may be at most."""

    @property
    def passed(self) -> bool:
        return self.error <= self.limit  # not so for a NaN


def load() -> dict[str, Any]:
    """The content of data/regression_cases.json."""
    file = importlib.resources.files(spring_pendulum_env) / "data" / "regression_cases.json"
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content


def environment_run(case: Case, about: dict[str, Any], tolerance: float | None) -> Iterator[tuple[FloatArray, float]]:
    """The observation and the energy error at each record of a case, through gym.make."""
    arguments: dict[str, Any] = {
        "parameters": case["parameters"],
        "control_period": about["control_period"],
        "tolerance": tolerance,
        "max_episode_steps": case["records"][-1][0] + 1,
    }
    name = "SpringPendulumPassive-v0"
    if case["actuated_axes"]:
        name = "SpringPendulumDamping-v0"
        arguments |= {"max_force": about["max_force"], "actuated_axes": case["actuated_axes"], "anchor_travel": 1e9}
    env = gym.make(name, **arguments)
    env.reset(options={"state": case["start"]})
    actions: list[Any] = [np.array(action) for action in case["actions"]] or [None]
    done = 0
    for count, *_ in case["records"]:
        for i in range(done, count):
            observation, _, _, _, info = env.step(actions[i % len(actions)])
        done = count
        yield observation, info["energy_error"]
    env.close()


def _nearest_to_limit(case: Case, about: dict[str, Any], scheme: str, states: Any, allowed: float) -> Row:
    """The record of a case at which an adaptive scheme uses most of `allowed` x growth x (1 + |state|)."""
    rows = []
    for (count, growth, expected), state in zip(case["records"], states, strict=True):
        error = float(np.abs(state - np.array(expected)).max())
        unit = growth * (1.0 + float(np.abs(expected).max()))
        time = count * about["control_period"]
        limit = allowed * unit
        rows.append(Row(case["name"], scheme, time, error, growth, error / (ROUNDING * unit), limit))
    # A NaN is further off than any number.
    return max(rows, key=lambda row: np.inf if np.isnan(row.error) else row.error / row.limit)


def adaptive_environment(case: Case, about: dict[str, Any]) -> list[Row]:
    """Dormand-Prince 8(5,3) in the environment."""
    states = [state for state, _ in environment_run(case, about, ADAPTIVE)]
    return [_nearest_to_limit(case, about, "environment", states, ENVIRONMENT_MARGIN * ADAPTIVE)]


def simulated(case: Case, about: dict[str, Any]) -> list[Row]:
    """`simulate` as it is called without options; it knows the passive pendulum only."""
    if case["actuated_axes"]:
        return []
    times = [0.0, *(count * about["control_period"] for count, *_ in case["records"])]
    states = simulate(case["parameters"], case["start"], times).states[1:]
    return [_nearest_to_limit(case, about, "simulate", states, SIMULATE_MARGIN * TOLERANCE)]


def splitting(case: Case, about: dict[str, Any]) -> list[Row]:
    """The splitting in the environment: a short time, and the energy."""
    found = list(environment_run(case, about, None))
    count, _, expected = case["records"][0]
    last = case["records"][-1][0] * about["control_period"]
    error = float(np.abs(found[0][0] - np.array(expected)).max())
    limit = SHORT_ERROR * (1.0 + float(np.abs(expected).max()))
    short = Row(case["name"], "splitting", count * about["control_period"], error, None, None, limit)
    return [short, Row(case["name"], "its energy", last, found[-1][1], None, None, ENERGY_ERROR)]


Scheme = Callable[[Case, dict[str, Any]], list[Row]]
SCHEMES: tuple[Scheme, ...] = (adaptive_environment, simulated, splitting)


def _attempted(scheme: Scheme, case: Case, about: dict[str, Any]) -> list[Row]:
    """What a scheme finds; where it gives up, why is printed, and a row that fails."""
    try:
        return scheme(case, about)
    except ArithmeticError as error:
        print(f"{case['name']}: {error}")
        return [Row(case["name"], scheme.__name__, 0.0, math.nan, None, None, 0.0)]


HEADER = f"{'case':12} {'scheme':12} {'t (s)':>6} {'error':>9} {'growth':>9} {'/ rounding':>11} {'limit':>9}"


def line(row: Row) -> str:
    """A row of the table."""
    growth = "" if row.growth is None else f"{row.growth:.1e}"
    conditioning = ""
    if row.conditioning is not None:
        conditioning = f"{row.conditioning:,.{0 if row.conditioning >= 100 else 1}f}"
    verdict = "ok" if row.passed else "FAILED"
    return (
        f"{row.case:12} {row.scheme:12} {row.time:6.1f} {row.error:9.1e} {growth:>9} {conditioning:>11} "
        f"{row.limit:9.1e}  {verdict}"
    )


def versions() -> dict[str, str]:
    """What the result may depend on."""
    packages = {name: importlib.metadata.version(name) for name in ("gymnasium", "numpy", "scipy", "numba")}
    ours = {"spring_pendulum_env": spring_pendulum_env.__version__, "python": platform.python_version()}
    return {**ours, **packages, "machine": f"{platform.system()} {platform.machine()}"}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    content = load()
    about, cases = content["about"], content["cases"]
    names = [case["name"] for case in cases]
    parser = argparse.ArgumentParser(
        prog="python -m spring_pendulum_env.regression",
        description="Integrate reference cases that ship with the package, and compare: a check of an installation.",
        epilog="Exit status: 0 if all errors are within their limits, 1 if one isn't, 2 if called wrongly.",
    )
    parser.add_argument(
        "--case", action="append", choices=names, metavar="NAME", help=f"only this one, repeatable: {', '.join(names)}"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows and the versions there too")
    options = parser.parse_args(arguments)
    if options.json is not None and (options.json.is_dir() or not options.json.absolute().parent.is_dir()):
        parser.error(f"argument --json: {options.json}: must be a file in a folder that exists")

    used = versions()
    print(", ".join(f"{name} {version}" for name, version in used.items()))
    print(HEADER)
    rows: list[Row] = []
    for case in cases:
        if options.case is None or case["name"] in options.case:
            for scheme in SCHEMES:
                for row in _attempted(scheme, case, about):
                    rows.append(row)
                    print(line(row), flush=True)
    failed = [row for row in rows if not row.passed]
    print(f"{len(rows) - len(failed)} of {len(rows)} within their limits" + (": FAILED" if failed else ""))
    print(
        "error: m or m/s, of an energy relative; / rounding: error in units of 2.2e-16 x growth x (1 + |state|),\n"
        "to which rounding a number once may have grown by then."
    )
    if options.json is not None:
        result = [{**dataclasses.asdict(row), "passed": row.passed} for row in rows]
        options.json.write_text(json.dumps({"versions": used, "rows": result}, indent=1) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
