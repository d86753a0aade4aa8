"""The same motions in other people's simulators: MuJoCo, heyoka and Octave. A test skips where its one is missing."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from numpy.typing import NDArray
from reference_data import VIOLENT, actuated, passive

from spring_pendulum_env import Parameters, physics, regression, simulate

FloatArray = NDArray[np.float64]

sys.path.insert(0, str(Path(__file__).parent.parent / "scripts"))
mujoco_peer: Any = importlib.import_module("benchmarks.mujoco_peer")
solvers: Any = importlib.import_module("benchmarks.solvers")

UNEVEN = Parameters(m0=1.5, m1=0.8, m2=1.3, k1=80.0, k2=140.0, L1=0.9, L2=1.1, R1=0.2, R2=0.1)
SEED = 11


# MuJoCo: point masses on slide joints, springs as spatial tendons, integrated by its RK4.


@pytest.mark.parametrize("mode", ["passive", "actuated"])
def test_mujoco_converges_to_ours(mode: str) -> None:
    """Its error falls with the fourth power of its step, and its limit, extrapolated from two steps, is our motion."""
    pytest.importorskip("mujoco", reason="MuJoCo isn't installed: pip install mujoco")
    random = np.random.default_rng(SEED)
    start, periods = VIOLENT, 50
    actions = np.zeros((periods, 0))
    if mode == "actuated":
        start = np.r_[0.1, -0.2, 0.1, VIOLENT[:6] + np.tile([0.1, -0.2, 0.1], 2), 0.2, 0.1, -0.3, VIOLENT[6:]]
        actions = random.uniform(-1, 1, (periods, 3))
    env = (passive if mode == "passive" else actuated)(start, UNEVEN, tolerance=1e-13)
    for action in actions:
        ours = env.step(action)[0]

    def theirs(substeps: int) -> FloatArray:
        model = mujoco_peer.mujoco_model(UNEVEN, substeps, actuated=mode == "actuated")
        run = mujoco_peer.mujoco_runner(model, substeps)
        return np.asarray(run(start, actions))

    coarse, middle, fine = theirs(20), theirs(40), theirs(80)
    own_order = np.log2(np.abs(coarse - middle).max() / np.abs(middle - fine).max())
    assert own_order == pytest.approx(4.0, abs=0.2)  # without a look at ours
    errors = [np.abs(states - ours).max() for states in (coarse, middle, fine)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.2)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.2)
    limit = fine + (fine - middle) / 15
    assert np.abs(limit - ours).max() < 0.1 * errors[2]


# heyoka: Taylor series of order 20 and more, from the same equations.


@pytest.mark.parametrize("name", ["regular", "chaotic", "drag"])
def test_heyoka_agrees_within_conditioning(name: str) -> None:
    """Both double-precision integrators end as near to each other as the growth of rounding errors lets them."""
    pytest.importorskip("heyoka", reason="heyoka isn't installed: pip install heyoka")
    content = regression.load()
    (case,) = (case for case in content["cases"] if case["name"] == name)
    times = np.array([0.0, *(count * content["about"]["control_period"] for count, *_ in case["records"])])
    theirs = solvers.heyoka_solver(Parameters.of(case["parameters"]), np.array(case["start"]), times)(1e-15)[1:]
    ours = [state for state, _ in regression.environment_run(case, content["about"], regression.ADAPTIVE)]
    for (_, growth, exact), one, other in zip(case["records"], ours, theirs, strict=True):
        rounding = regression.ROUNDING * growth * (1 + np.abs(exact).max())
        assert np.abs(other - exact).max() < 20 * rounding
        assert np.abs(one - other).max() < 200 * rounding


# Octave's ode45: the pair of MATLAB's, another control of the step, and equations printed as its own language.

PROGRAM = """\
1;
function rates = slope(t, y)
{unpacked}
{body}
end
for tolerance = [{tolerances}]
  options = odeset("RelTol", tolerance, "AbsTol", tolerance);
  [t, y] = ode45(@slope, [0, {seconds}], [{start}], options);
  printf("%.17g ", y(end, :));
  printf("\\n");
end
"""


def octave_program(parameters: Parameters, start: FloatArray, seconds: float, tolerances: list[float]) -> str:
    """physics.py's equations of the passive pendulum, printed by SymPy, and calls of ode45 on them."""
    names = sympy.symbols("x1 y1 z1 x2 y2 z2 vx1 vy1 vz1 vx2 vy2 vz2", real=True)
    still: list[Any] = [0] * 3
    constants = (*still, *parameters.constants(actuated_axes=""), *parameters.drag_rates())
    full = physics.derivatives(*still, *names[:6], *still, *names[6:], *constants)
    return PROGRAM.format(
        unpacked="\n".join(f"{name} = y({i});" for i, name in enumerate(names, 1)),
        body=sympy.octave_code(sympy.Matrix([*full[3:9], *full[12:18]]), assign_to="rates"),
        tolerances=", ".join(map(repr, tolerances)),
        seconds=seconds,
        start="; ".join(map(repr, start.tolist())),
    )


def test_octaves_ode45_converges_to_ours(tmp_path: Path) -> None:
    """Both ode45 err as their tolerance says, and alike: where it is tight, the controls of the step, which differ,
    no longer decide the result. Their steps aren't compared, being those of two algorithms."""
    octave = shutil.which("octave-cli")
    if octave is None:
        pytest.skip("octave-cli isn't on the PATH: install GNU Octave")
    seconds, tolerances = 4.0, [1e-7, 1e-10]
    file = tmp_path / "pendulum.m"
    file.write_text(octave_program(UNEVEN, VIOLENT, seconds, tolerances))
    done = subprocess.run([octave, "--norc", "--quiet", file], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    exact = simulate(UNEVEN, VIOLENT, [0.0, seconds], rtol=1e-13, atol=1e-13).states[-1]
    for tolerance, said in zip(tolerances, done.stdout.splitlines(), strict=True):
        theirs = np.array(said.split(), dtype=float)
        ours = simulate(UNEVEN, VIOLENT, [0.0, seconds], "ode45", tolerance, tolerance).states[-1]
        error = np.abs(theirs - exact).max()
        assert 1 * tolerance < error < 100 * tolerance
        assert np.abs(ours - exact).max() == pytest.approx(error, rel=0.5)
