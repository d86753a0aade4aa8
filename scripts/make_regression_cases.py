"""Integrate the cases of the regression suite to 30 digits, and write the file that ships with the package.

Two methods that share no equation and no integrator must agree on every record: Taylor series of the accelerations
(scripts/references/taylor.py), and Gragg's extrapolation of Hamilton's equations, whose forces SymPy derives from the
energies (scripts/references/extrapolation.py). Cases that are in the file already are kept, so an interrupted run goes
on by the same command; the whole takes about ten minutes, half of that where gmpy2 is installed, which mpmath uses.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from mpmath import mp, mpf
from references import extrapolation, taylor
from references.cases import MAX_FORCE, PERIOD, SEED, Case, cases

from spring_pendulum_env import Parameters

FILE = Path(__file__).resolve().parent.parent / "spring_pendulum_env" / "data" / "regression_cases.json"
DIGITS = 45
"""With which is reckoned."""
AGREEMENT = 1e-28
"""How far apart the methods may be, in units of growth (1 + |state|)."""
METHODS: dict[str, Any] = {"Taylor": taylor.Motion, "extrapolation": extrapolation.Motion}

ABOUT = {
    "what": "Motions of the double spring pendulum, rounded from about 30 digits.",
    "units": "SI; positions, then velocities; passive cases X1 ... Z2, actuated ones X0 ... Z2.",
    "actions": f"Force on the anchor in units of {MAX_FORCE:g} N, one row for each control period, repeated in turn.",
    "records": "Control periods since the start, growth, state.",
    "growth": "Factor by which a tiny error made at any time before can have grown, from the variational equations.",
    "apart": f"Largest difference of the two methods, in units of growth (1 + |state|); {AGREEMENT:g} is allowed.",
    "made_by": "scripts/make_regression_cases.py",
    "seed": SEED,
    "control_period": PERIOD,
    "max_force": MAX_FORCE,
}


def motion(method: Any, case: Case) -> list[list[Any]]:
    """The states at the records of a case, 18 numbers each."""
    at = method(Parameters(**case.parameters), case.actuated_axes, case.whole_start)
    states, done = [], 0
    for count in case.counts:
        if case.actuated_axes:
            for force in case.forces[done:count]:
                at.advance(mpf(PERIOD), force)
        else:
            at.advance(mpf(PERIOD) * (count - done), [0.0] * 3)
        done = count
        states.append(at.state)
    return states


def made(case: Case) -> dict[str, Any]:
    """A case with its records.

    Raises:
        ArithmeticError: the methods disagree.
    """
    growth = extrapolation.growth(
        Parameters(**case.parameters), case.actuated_axes, case.whole_start, case.counts, PERIOD, case.forces
    )
    one, other = (motion(method, case) for method in METHODS.values())
    apart = 0.0
    for a, b, factor in zip(one, other, growth, strict=True):
        scale = factor * (1 + max(map(abs, a)))
        apart = max(apart, float(max(abs(x - y) for x, y in zip(a, b, strict=True)) / scale))
    if apart > AGREEMENT:
        raise ArithmeticError(f"{case.name}: {' and '.join(METHODS)} differ by {apart:.1e}: at most {AGREEMENT:g}")
    keep = slice(None) if case.actuated_axes else [*range(3, 9), *range(12, 18)]
    records = []
    for count, state, factor in zip(case.counts, one, growth, strict=True):
        numbers = [float(x) for x in state]
        shown = numbers if isinstance(keep, slice) else [numbers[i] for i in keep]
        records.append([count, float(f"{factor:.3g}"), shown])
    return {**case.as_dict(), "apart": float(f"{apart:.1e}"), "records": records}


def write(file: Path, done: Sequence[dict[str, Any]]) -> None:
    """The file, a record on each line."""
    texts = []
    for case in done:
        records = ",\n    ".join(json.dumps(record) for record in case["records"])
        rest = ",\n   ".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in case.items() if k != "records")
        texts.append(f'  {{{rest},\n   "records": [\n    {records}]}}')
    about = json.dumps(ABOUT, indent=1)
    file.parent.mkdir(exist_ok=True)
    file.write_text(f'{{"about": {about},\n"cases": [\n{",".join(chr(10) + text for text in texts)[1:]}\n]}}\n')


def compare_with(file: Path) -> None:
    """Both methods on the cases of another file of references, as tests/reference has one, for about a second each."""
    for known in json.loads(file.read_text())["cases"]:
        passive = known["mode"] == "passive"
        number = next(i for i, time in enumerate(known["times"]) if time >= 1.0)
        axes = "" if passive else "".join(a for a, moves in zip("xyz", known["actuated_axes"], strict=True) if moves)
        still, start = [0.0] * 3, known["initial_state"]
        start = [*still, *start[:6], *still, *start[6:]] if passive else start
        expected = known["states"][number]
        expected = [*still, *expected[:6], *still, *expected[6:]] if passive else expected
        errors = []
        for method in METHODS.values():
            at = method(Parameters(**known["params"]), axes, start)
            if passive:
                at.advance(mpf(known["times"][number]), still)
            else:
                for force in known["u"][: known["period_index"][number]]:
                    at.advance(mpf(known["control_period"]), force)
            errors.append(max(abs(float(x) - y) for x, y in zip(at.state, expected, strict=True)))
        said = ", ".join(f"{name} {error:.1e}" for name, error in zip(METHODS, errors, strict=True))
        print(f"{known['name']:16} at {known['times'][number]:g} s: {said}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--file", type=Path, default=FILE, help="what to write (default: the package's)")
    parser.add_argument("--again", action="store_true", help="make the cases anew that are in the file")
    parser.add_argument("--compare", type=Path, metavar="JSON", help="only compare with a file of other references")
    options = parser.parse_args()
    mp.dps = DIGITS
    if options.compare is not None:
        if not options.compare.is_file():
            parser.error(f"--compare {options.compare}: no such file")
        compare_with(options.compare)
        return
    kept: dict[str, dict[str, Any]] = {}
    if options.file.exists() and not options.again:
        kept = {case["name"]: case for case in json.loads(options.file.read_text())["cases"]}
    wanted = cases()
    for case in wanted:
        known = kept.get(case.name)
        if known is None or {name: known[name] for name in case.as_dict()} != case.as_dict():
            known = kept[case.name] = made(case)
            write(options.file, [kept[other.name] for other in wanted if other.name in kept])
        print(f"{case.name:12} growth {known['records'][-1][1]:8.1e}   apart {known['apart']:.1e}", flush=True)


if __name__ == "__main__":
    main()
