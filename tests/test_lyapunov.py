"""The flow with its tangent map, and Lyapunov exponents, against the reference data, theory and closed forms.

`python tests/test_lyapunov.py` compares all exponents with the reference, over its own times.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference_data import CASES, PASSIVE, VIOLENT, allowed_error, load

from spring_pendulum_env import Parameters, energy, equilibrium, normal_modes, simulate
from spring_pendulum_env.dynamics import (
    LyapunovExponent,
    lyapunov_exponent,
    lyapunov_exponents,
    lyapunov_spectrum,
)
from spring_pendulum_env.dynamics.flow import Flow

FloatArray = NDArray[np.float64]

REFERENCE: dict[str, Any] = load("lyapunov")["cases"]
UNEVEN = Parameters(m1=0.9, m2=2.3, k1=120.0, k2=70.0, L1=0.8, L2=1.1, R1=0.3, R2=0.2, g=9.7)
START = np.array([0.4, 0.1, -0.9, 1.1, 0.3, -1.2, 0.3, -0.5, 0.2, 0.1, 0.4, -0.6])
SINGLE = {"k1": 50.0, "k2": 0.0}
"""One spring: mass 2 falls freely."""
SINGLE_START = np.array([0.4, -0.7, 1.3, 0.0, 0.0, -1.0, 0, 0, 0, 0, 0, 0])


def flown(
    parameters: Any, state: FloatArray, duration: float, displacements: Any = None, step: Any = None
) -> FloatArray:
    """A state after a duration, or what becomes of displacements, shape (12, n), from it."""
    given = np.zeros((12, 1)) if displacements is None else displacements
    points = np.concatenate([np.repeat(state[:, None], given.shape[1], axis=1), given])
    Flow(parameters, step).advance(points, duration)
    return points[:12, 0] if displacements is None else points[12:]


# The flow.


@pytest.mark.parametrize("name", PASSIVE)
def test_flow_meets_the_reference(name: str) -> None:
    """At a quarter of the usual step; those with drag, near zero length and without a spring included."""
    case = CASES[name]
    points = np.zeros((24, 1))
    points[:12, 0] = case["initial_state"]
    flow = Flow(case["params"], Flow(case["params"]).longest_step / 4)
    time = 0.0
    for number, (until, expected) in enumerate(zip(case["times"], case["states"], strict=True)):
        flow.advance(points, until - time)
        time = until
        assert np.abs(points[:12, 0] - expected).max() < 10 * allowed_error(name, number)


@pytest.mark.parametrize("parameters", [Parameters(), UNEVEN], ids=["default", "uneven"])
def test_displacements_are_carried_as_differences_are(parameters: Parameters) -> None:
    tiny = 1e-5
    times = [0.0, 2.0]
    columns = []
    for axis in np.eye(12):
        ends = [simulate(parameters, START + sign * tiny * axis, times).states[-1] for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * tiny))
    expected = np.array(columns).T
    found = flown(parameters, START, 2.0, np.eye(12), 0.005)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_tangent_map_is_symplectic() -> None:
    """To rounding, at any step: it is the exact derivative of a symplectic step, not of the motion."""
    parameters = UNEVEN.replace({"R1": 0.0, "R2": 0.0})
    masses = np.diag([parameters.m1] * 3 + [parameters.m2] * 3)
    zero = np.zeros((6, 6))
    form = np.block([[zero, masses], [-masses, zero]])
    matrix = flown(parameters, START, 2.0, np.eye(12))
    np.testing.assert_allclose(matrix.T @ form @ matrix, form, rtol=0, atol=1e-13 * np.abs(matrix).max() ** 2)
    crude = flown(parameters, START, 2.0, np.eye(12), 0.01)
    assert np.abs(crude - matrix).max() > 1e-11  # so steps did differ


def test_flow_keeps_the_energy_near_zero_length() -> None:
    """In the plane, with both springs often nearly of zero length."""
    random = np.random.default_rng(0)
    states = np.zeros((16, 12))
    states[:, [0, 2, 3, 5]] = 1.2 * random.standard_normal((16, 4))
    points = np.zeros((24, 16))
    points[:12] = states.T
    before = np.asarray(energy(None, states))
    Flow(None).advance(points, 100.0)
    assert np.abs(energy(None, points[:12].T) / before - 1).max() < 1e-7


def test_zero_length_is_an_error() -> None:
    """A mass that falls through the anchor: the force has no derivative there."""
    above = np.zeros(12)
    above[[2, 5]] = 1.2, 3.0
    above[8] = -10.0
    with pytest.raises(ArithmeticError, match="zero length"):
        flown({"k2": 0.0}, above, 1.0)


def test_motions_do_not_touch_each_other() -> None:
    """The same bits alone and among others."""
    random = np.random.default_rng(1)
    points = random.standard_normal((24, 70))
    alone = points[:, 66:67].copy()
    Flow(None).advance(points, 3.0)
    Flow(None).advance(alone, 3.0)
    np.testing.assert_array_equal(points[:, 66], alone[:, 0])


# Exponents.


def in_joint_errors(found: LyapunovExponent, reference: float, error: float) -> float:
    return abs(found.exponent - reference) / float(np.hypot(found.standard_error, error))


@pytest.mark.parametrize("name", [name for name, case in REFERENCE.items() if case["kind"] == "chaotic"])
def test_chaotic_exponents_meet_the_reference(name: str) -> None:
    case = REFERENCE[name]
    found = lyapunov_exponent(case["params"], case["initial_state"], 6_000.0)
    assert found.standard_error < 0.03 * found.exponent
    assert in_joint_errors(found, case["lambda_max"], case["sem"]) < 2
    assert found.energy_error < 1e-6
    assert found.convergence[-1] == pytest.approx(found.exponent, rel=1e-12)
    assert found.times[-1] == pytest.approx(6_000.0, rel=1e-12)


@pytest.mark.parametrize("name", [name for name, case in REFERENCE.items() if case["kind"] == "regular"])
def test_regular_exponents_vanish(name: str) -> None:
    """As ln(T) / T does."""
    case = REFERENCE[name]
    found = lyapunov_exponent(case["params"], case["initial_state"], 4_000.0)
    assert abs(found.exponent) < 2 * found.resolution
    assert found.resolution == pytest.approx(np.log(4_001.0) / 4_000.0)


def test_resolution_of_a_short_run_is_positive_and_worse() -> None:
    """ln(T) / T would be below zero before 1 s, and least at 1 s."""
    found = [lyapunov_exponent(None, START, time, transient=0.0, batches=2).resolution for time in (0.1, 1.0, 3.0, 9.0)]
    assert all(short > long > 0.2 for short, long in itertools.pairwise(found))


def test_single_spring_can_be_chaotic() -> None:
    """The paper says that it is always periodic. 0.523 +- 0.009 1/s is the reference's exponent."""
    found = lyapunov_exponent(SINGLE, SINGLE_START, 10_000.0)
    assert found.exponent > 20 * found.standard_error
    assert in_joint_errors(found, 0.523, 0.009) < 2
    assert found.energy_error < 1e-6


def test_half_the_steps_give_the_same_exponent() -> None:
    usual = lyapunov_exponent(None, VIOLENT, 4_000.0)
    fine = lyapunov_exponent(None, VIOLENT, 4_000.0, longest_step=0.01)
    assert in_joint_errors(usual, fine.exponent, fine.standard_error) < 2
    assert usual.exponent != fine.exponent


@pytest.mark.parametrize("name", ["hanging-hanging", "hanging-inverted", "inverted-hanging", "inverted-inverted"])
def test_spectrum_at_an_equilibrium_is_its_growth_rates(name: str) -> None:
    """On the vertical the motion stays at the equilibrium, however unstable it is."""
    growth = np.sqrt(np.maximum(-normal_modes(None, name).omega_squared, 0.0))
    expected = np.sort(np.concatenate([growth, -growth]))[::-1]
    state = equilibrium(None, name)[np.r_[3:9, 12:18]]
    found = lyapunov_spectrum(None, state, 100.0, transient=10.0)
    np.testing.assert_allclose(found.exponents, expected, rtol=0, atol=0.03)
    unstable = np.flatnonzero(expected > 0)
    np.testing.assert_allclose(found.exponents[unstable], expected[unstable], rtol=0, atol=1e-6)


def test_spectrum_of_a_chaotic_motion() -> None:
    """Pairs of opposite sign, and two pairs of zeros: for time and energy, and for the turn about the vertical."""
    case = REFERENCE["chaotic_1_3d_rest"]
    found = lyapunov_spectrum(case["params"], case["initial_state"], 3_000.0)
    np.testing.assert_allclose(found.exponents[:4], -found.exponents[:7:-1], rtol=0, atol=1e-9)
    assert np.abs(found.exponents[4:8]).max() < 5e-3
    assert (found.exponents[:4] > 10 * found.standard_errors[:4]).all()
    error = np.hypot(found.standard_errors[0], case["sem"])
    assert abs(found.exponents[0] - case["lambda_max"]) < 2 * error
    np.testing.assert_allclose(found.convergence[-1], found.exponents, rtol=0, atol=1e-12)


def test_spectrum_is_refused_where_rounding_hides_it() -> None:
    """After so long an interval all displacements are the fastest one and its rounding."""
    with pytest.raises(ArithmeticError, match="smaller interval"):
        lyapunov_spectrum(None, REFERENCE["chaotic_3_3d_high"]["initial_state"], 200.0, interval=50.0, batches=2)


def test_drag_shrinks_volumes_at_its_rate() -> None:
    found = lyapunov_spectrum(UNEVEN, START, 20.0, transient=0.0)
    assert found.exponents.sum() == pytest.approx(-3 * (UNEVEN.R1 / UNEVEN.m1 + UNEVEN.R2 / UNEVEN.m2), rel=1e-12)


def test_batch_of_motions() -> None:
    starts = np.array([REFERENCE[name]["initial_state"] for name in ("chaotic_1_3d_rest", "regular_1_3d_small")])
    exponents, errors = lyapunov_exponents(None, starts, 500.0, transient=50.0)
    assert exponents.shape == errors.shape == (2,)
    assert exponents[0] > 0.3
    assert abs(exponents[1]) < 0.03


def test_seed_is_only_a_direction() -> None:
    case = REFERENCE["chaotic_3_3d_high"]
    found = [lyapunov_exponent(None, case["initial_state"], 100.0, transient=100.0, seed=seed) for seed in (0, 1)]
    assert found[0].exponent == pytest.approx(found[1].exponent, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"state": np.zeros(18)}, r"state of shape \(18,\)"),
        ({"state": np.full(12, np.nan)}, "must be finite"),
        ({"duration": 0.0}, "duration = 0.0"),
        ({"duration": 0.1}, "duration = 0.1"),
        ({"duration": np.inf}, "duration = inf"),
        ({"transient": -1.0}, "transient = -1.0"),
        ({"interval": 0}, "interval = 0"),
        ({"batches": 1}, "batches = 1"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": "a"}, "seed = 'a'"),
        ({"longest_step": 0.0}, "longest_step = 0.0"),
        ({"longest_step": 5.0}, "longest_step = 5.0 s: must be at most 0.0618 s, 1 radian of the fastest mode"),
        ({"state": START + 1j}, "(?s)state = .*must be real numbers"),
        ({"state": START * 1e101}, r"(?s)state = .*no number larger than 1e\+100"),
        ({"parameters": {"m1": 0.0}}, "m1"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], message: str) -> None:
    for function in (lyapunov_exponent, lyapunov_spectrum):
        with pytest.raises(ValueError, match=message):
            function(**{"parameters": None, "state": START, **arguments})


def test_import_of_the_package_loads_no_dynamics() -> None:
    unwanted = "{'numba', 'spring_pendulum_env.dynamics'} & set(sys.modules)"
    code = f"import sys, spring_pendulum_env; sys.exit(bool({unwanted}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def compare() -> None:
    """Prints our exponents beside the reference's."""
    print(f"{'':24} {'ours, 1/s':>24} {'reference, 1/s':>24}   apart, in joint errors")
    for name, case in REFERENCE.items():
        found = lyapunov_exponent(case["params"], case["initial_state"], case["T"], transient=case["burn"])
        apart = in_joint_errors(found, case["lambda_max"], case["sem"])
        print(
            f"{name:24} {found.exponent:12.6f} +- {found.standard_error:.6f}"
            f" {case['lambda_max']:12.6f} +- {case['sem']:.6f}   {apart:.2f}"
        )


if __name__ == "__main__":
    compare()
