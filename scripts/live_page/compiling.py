"""The package's formulas, coefficients and policies as JavaScript.

No formula is written here: physics.py's own functions run on SymPy symbols, and SymPy's printer writes what comes out.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import sympy
from scipy.integrate import DOP853, RK45

from agents import load
from agents.evaluation import scenario_of
from agents.residual import ResidualPolicy
from spring_pendulum_env import Parameters, integrators, physics

BODIES = [f"{axis}{body}" for body in "012" for axis in physics.AXES]
STATE = [*BODIES, *(f"v{name}" for name in BODIES)]
FORCE = ["ux", "uy", "uz"]
CONSTANTS = ["w0x", "w0y", "w0z", "w1", "w2", "k1", "k2", "L1", "L2", "g", "load"]
RATES = ["c0", "c1", "c2"]


def function(name: str, arguments: Mapping[str, Sequence[str] | None], results: Any) -> str:
    """A JavaScript function of SymPy expressions, what they have in common computed once.

    Args:
        name: of the function.
        arguments: name of each, and of the numbers that it holds if it is an array; None: a plain number. The argument
            "p" is an object whose fields bear the names.
        results: one expression, which is returned, or several, which are put into an array `out`.
    """
    several = isinstance(results, (tuple, list))
    shared, reduced = sympy.cse(
        [sympy.sympify(result) for result in (results if several else [results])], sympy.numbered_symbols("t")
    )
    used = set().union(*(expression.free_symbols for _, expression in shared), *(e.free_symbols for e in reduced))
    lines = []
    for argument, names in arguments.items():
        if names is None:
            continue
        needed = [(place, name) for place, name in enumerate(names) if sympy.Symbol(name) in used]
        if argument == "p":
            lines.append(f"const {{{', '.join(name for _, name in needed)}}} = p;")
        else:
            lines.append(f"const {', '.join(f'{name} = {argument}[{place}]' for place, name in needed)};")
    lines += [f"const {symbol} = {sympy.jscode(expression)};" for symbol, expression in shared]
    if several:
        lines += [f"out[{place}] = {sympy.jscode(expression)};" for place, expression in enumerate(reduced)]
        lines.append("return out;")
    else:
        lines.append(f"return {sympy.jscode(reduced[0])};")
    listed = ", ".join([*arguments, *(["out"] if several else [])])
    return f"function {name}({listed}) {{\n  " + "\n  ".join(lines) + "\n}\n"


def formulas() -> str:
    """The equations that the page needs, from physics.py."""
    symbols = {name: sympy.Symbol(name) for name in [*STATE, *FORCE, *CONSTANTS, *RATES, *Parameters.names()]}

    def of(names: Sequence[str]) -> list[Any]:
        return [symbols[name] for name in names]

    record: Any = SimpleNamespace(**{name: symbols[name] for name in Parameters.names()})
    p = Parameters.names()
    change, start = sympy.symbols("change start")
    spring = ["dx", "dy", "dz", "k", "L"]
    parts = [
        function("constantsFree", {"p": p}, Parameters.constants(record, physics.AXES)),
        function("constantsHeld", {"p": p}, Parameters.constants(record, "")),
        function("dragRates", {"p": p}, Parameters.drag_rates(record)),
        function(
            "derivatives",
            {"y": STATE, "u": FORCE, "c": CONSTANTS, "r": RATES},
            physics.derivatives(*of(STATE), *of(FORCE), *of(CONSTANTS), *of(RATES)),
        ),
        function(
            "accelerations",
            {"y": STATE, "u": FORCE, "c": CONSTANTS},
            physics.accelerations(*of(BODIES), *of(FORCE), *of(CONSTANTS)),
        ),
        function(
            "totalEnergy",
            {"y": STATE, "p": p},
            physics.total_energy(*of(STATE), *of(["m0", "m1", "m2", "k1", "k2", "L1", "L2", "g"])),
        ),
        function(
            "kineticEnergy", {"y": STATE, "p": p}, physics.kinetic_energy(*of(STATE[9:]), *of(["m0", "m1", "m2"]))
        ),
        function("dragPower", {"y": STATE, "p": p}, physics.weighted_squares(*of(STATE[9:]), *of(["R0", "R1", "R2"]))),
        function("springLength", dict.fromkeys(spring[:3]), physics.length(*sympy.symbols(spring[:3]))),
        # The comparison with zero is settled while Python runs, so both of its outcomes are written out.
        function("relativeError", {"change": None, "start": None}, physics.energy_error(change, start)),
        function("absoluteError", {"change": None}, physics.energy_error(change, sympy.Integer(0))),
    ]
    return "\n".join(parts)


def coefficients() -> str:
    """The schemes' tables: those of SciPy, and the splitting of integrators.py."""
    tables = {
        "RK45": {
            "A": RK45.A.tolist(),
            "B": RK45.B.tolist(),
            "errors": [RK45.E.tolist()],
            "errorOrder": RK45.error_estimator_order,
        },
        "DOP853": {
            "A": DOP853.A.tolist(),
            "B": DOP853.B.tolist(),
            "errors": [DOP853.E5.tolist(), DOP853.E3.tolist()],
            "errorOrder": DOP853.error_estimator_order,
        },
        "splitting": {"kicks": integrators.KICKS.tolist(), "drifts": integrators.DRIFTS.tolist()},
    }
    return f"const TABLES = {json.dumps(tables, separators=(',', ':'))};\n"


def policy(name: str) -> dict[str, Any]:
    """A shipped policy as JSON, its numbers as base64.

    They are 32-bit floats, little end first, but for the network's weights: those are rounded to whole multiples, -127
    to 127, of a step for each row, which makes the page a quarter as long and changes an action by less than 0.01.

    Args:
        name: of the policy.

    Raises:
        ValueError: it is no network beside LQR.
    """
    learned = load(name)
    if not isinstance(learned, ResidualPolicy):
        raise ValueError(f"name = {name!r}: must be a policy made by shac, whose network stands beside LQR")
    arrays = {key: value.numpy() for key, value in learned.network.state_dict().items()}

    def coded(array: Any, kind: str) -> str:
        return base64.b64encode(np.asarray(array, dtype=kind).tobytes()).decode()

    def floats(array: Any) -> dict[str, Any]:
        return {"shape": list(array.shape), "data": coded(array, "<f4")}

    def rounded(array: Any) -> dict[str, Any]:
        steps = np.abs(array).max(axis=1) / 127
        return {
            "shape": list(array.shape),
            "data": coded(np.round(array / steps[:, None]), "i1"),
            "steps": coded(steps, "<f4"),
        }

    layers = [key.removesuffix(".weight") for key in arrays if key.endswith(".weight")]
    env = gym.make(learned.config.environment_id, **learned.config.environment.arguments())
    scenario = scenario_of(env)
    env.close()
    return {
        "name": name,
        "activation": learned.config.network.activation,
        "maxForce": scenario.max_force,
        "controlPeriod": scenario.control_period,
        "reference": learned.reference.tolist(),
        "features": floats(arrays["features"]),
        "gain": floats(arrays["gain"]),
        "layers": [[rounded(arrays[f"{key}.weight"]), floats(arrays[f"{key}.bias"])] for key in layers],
    }
