"""simulate() against the reference trajectories, and its figures of error against their definitions."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference_data import CASES, PASSIVE, VIOLENT, allowed_error, passive, steps
from scipy.integrate import solve_ivp

from spring_pendulum_env import Parameters, Trajectory, energy, simulate, simulation

FloatArray = NDArray[np.float64]

TIMES = np.linspace(0.0, 2.0, 11)
METHODS = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA", "ode45")


def worst_ratio(name: str, tolerance: float) -> float:
    """The largest error of a passive case over what is allowed there."""
    case = CASES[name]
    run = simulate(case["params"], case["initial_state"], [0.0, *case["times"]], rtol=tolerance, atol=tolerance)
    return max(
        float(np.abs(state - expected).max()) / allowed_error(name, number)
        for number, (state, expected) in enumerate(zip(run.states[1:], case["states"], strict=True))
    )


@pytest.mark.parametrize("name", PASSIVE)
def test_meets_the_reference(name: str) -> None:
    """At 1e-13, near enough: the worst, stiff_a, is at 0.96 of what is allowed. SciPy's pair holds each step to its
    tolerance, and errors add up."""
    assert worst_ratio(name, 1e-13) < 1.5


@pytest.mark.parametrize("name", ["regular_a", "chaotic_a", "nearzero_b", "stiff_a", "lzero_b"])
def test_default_tolerance_is_ten_times_as_loose(name: str) -> None:
    assert worst_ratio(name, 1e-12) < 12.0
    case = CASES[name]
    run = simulate(case["params"], case["initial_state"], [0.0, *case["times"][:3]])
    same = simulate(case["params"], case["initial_state"], [0.0, *case["times"][:3]], "DOP853", 1e-12, 1e-12)
    np.testing.assert_array_equal(run.states, same.states)


@pytest.mark.parametrize(
    ("method", "tolerance", "allowed"),
    [
        ("RK45", 1e-9, 1e-6),
        ("RK23", 1e-7, 1e-4),
        ("DOP853", 1e-10, 1e-7),
        ("Radau", 1e-8, 1e-5),
        ("BDF", 1e-8, 1e-4),
        ("LSODA", 1e-10, 1e-6),
        ("ode45", 1e-9, 1e-6),
    ],
)
def test_every_method_finds_the_same_motion(method: str, tolerance: float, allowed: float) -> None:
    times = TIMES[:6]
    exact = simulate(None, VIOLENT, times, rtol=1e-13, atol=1e-13).states
    states = simulate(None, VIOLENT, times, method, tolerance, tolerance).states
    error = np.abs(states - exact).max()
    assert 1e-12 < error < allowed


def test_methods_and_tolerances_are_really_used() -> None:
    runs = [simulate(None, VIOLENT, TIMES, method, 1e-6, 1e-6).states for method in METHODS]
    assert len({run.tobytes() for run in runs}) == len(METHODS)
    errors = [simulate(None, VIOLENT, TIMES, "RK45", 10.0**-n, 1e-12).energy_error for n in (3, 5, 7, 9)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 1e3 * errors[-1]
    loose = simulate(None, VIOLENT, TIMES, "RK45", 1e-9, 1e-3).energy_error
    assert loose > 10 * simulate(None, VIOLENT, TIMES, "RK45", 1e-9, 1e-9).energy_error


def test_agrees_with_the_passive_environment() -> None:
    """Drag and all: two statements of the same system."""
    p = Parameters(m1=0.9, m2=1.3, k1=120.0, k2=70.0, L1=0.8, L2=1.1, R1=0.3, R2=0.2, g=9.7, m0=3.0, R0=5.0)
    run = simulate(p, VIOLENT, [0.0, 2.0])
    state, info = steps(passive(VIOLENT, p, 0.02, 1e-13), 100)
    np.testing.assert_allclose(run.states[-1], state, rtol=0, atol=1e-9)
    assert run.energy[-1] == pytest.approx(info["energy"], abs=1e-9)


def test_trajectory_holds_what_was_asked_for() -> None:
    state = VIOLENT.copy()
    run = simulate({"m2": 2.0}, state.tolist(), TIMES.tolist())
    assert isinstance(run, Trajectory)
    assert run.parameters == Parameters(m2=2.0)
    np.testing.assert_array_equal(run.times, TIMES)
    assert run.states.shape == (11, 12)
    np.testing.assert_array_equal(run.states[0], VIOLENT)
    np.testing.assert_array_equal(run.energy, energy(run.parameters, run.states))
    assert run.energy_error < 1e-10
    with pytest.raises(dataclasses.FrozenInstanceError):
        run.times = TIMES  # type: ignore[misc]
    state[:] = 0.0
    np.testing.assert_array_equal(run.states[0], VIOLENT)


def test_time_starts_where_it_is_told() -> None:
    """Nothing depends on the time itself, and a run of one instant is its start."""
    later = simulate(None, VIOLENT, TIMES + 5.0)
    np.testing.assert_allclose(later.states, simulate(None, VIOLENT, TIMES).states, rtol=0, atol=1e-9)
    alone = simulate(None, VIOLENT, [3.0])
    assert alone.states.shape == (1, 12)
    np.testing.assert_array_equal(alone.states[0], VIOLENT)
    assert (alone.energy_error, alone.mean_energy_error) == (0.0, 0.0)


def made_by_hand(energies: list[float]) -> Trajectory:
    count = len(energies)
    return Trajectory(Parameters(), np.arange(float(count)), np.zeros((count, 12)), np.array(energies))


@pytest.mark.parametrize("energies", [[2.0, 3.0, 2.5], [-4.0, -5.0, 1.0, -3.0], [10.0, 10.0], [1.0]])
def test_figures_of_error_are_the_papers(energies: list[float]) -> None:
    """Equation (42) between first and last instant, and (sum(Energy)/ErrorSize-Energy(1))/Energy(1)."""
    run = made_by_hand(energies)
    first, last = energies[0], energies[-1]
    assert run.energy_error == pytest.approx(abs((last - first) / first), rel=1e-15, abs=1e-16)
    mean = (sum(energies) / len(energies) - first) / first
    assert run.mean_energy_error == pytest.approx(mean, rel=1e-14, abs=1e-16)
    assert isinstance(run.energy_error, float)
    assert isinstance(run.mean_energy_error, float)


def test_figures_of_error_have_their_signs() -> None:
    assert made_by_hand([2.0, 3.0, 1.0]).energy_error == 0.5
    assert made_by_hand([2.0, 1.0, 0.0]).mean_energy_error == -0.5
    assert made_by_hand([-2.0, -1.0, 0.0]).mean_energy_error == -0.5
    assert made_by_hand([-2.0, -3.0, -4.0]).mean_energy_error == 0.5


def test_figures_of_error_are_absolute_where_the_energy_starts_at_zero() -> None:
    run = made_by_hand([0.0, 0.5, -2.5])
    assert run.energy_error == 2.5
    assert run.mean_energy_error == pytest.approx(-2.0 / 3.0, rel=1e-15)


@pytest.mark.parametrize("start", ["up through the anchor", "in the anchor", "in one point"])
def test_straight_through_stays_finite(start: str) -> None:
    """The force jumps where a mass passes through the anchor."""
    state = {
        "up through the anchor": [0, 0, -0.6, 0, 0, -2, 0, 0, 14, 0, 0, 3],
        "in the anchor": [0, 0, 0, 0, 0, -1, 1, 2, -3, 0, 0, 0],
        "in one point": [0] * 12,
    }[start]
    run = simulate(None, state, np.linspace(0.0, 1.0, 21), rtol=1e-9, atol=1e-9)
    assert np.isfinite(run.states).all()
    assert run.energy_error < 1e-5


WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("state", {"state": np.zeros(18)}, r"\(18,\).*\(12,\)"),
    ("state", {"state": np.zeros((1, 12))}, r"\(1, 12\).*\(12,\)"),
    ("state", {"state": 1.0}, r"\(\).*\(12,\)"),
    ("state", {"state": [math.nan] + [0.0] * 11}, "nan.*finite"),
    ("state", {"state": [0.0] * 11 + [math.inf]}, "inf.*finite"),
    ("times", {"times": []}, r"\[\].*increasing"),
    ("times", {"times": 1.0}, "1.0.*increasing"),
    ("times", {"times": [0.0, 1.0, 1.0]}, r"\[0.0, 1.0, 1.0\].*increasing"),
    ("times", {"times": [1.0, 0.0]}, r"\[1.0, 0.0\].*increasing"),
    ("times", {"times": [0.0, math.nan]}, "nan.*finite"),
    ("times", {"times": [0.0, math.inf]}, "inf.*finite"),
    ("times", {"times": [[0.0, 1.0]]}, r"\[\[0.0, 1.0\]\].*increasing"),
    ("method", {"method": "rk45"}, "'rk45'.*RK45.*RK23.*DOP853.*Radau.*BDF.*LSODA.*ode45"),
    ("method", {"method": "ODE45"}, "'ODE45'.*ode45"),
    ("method", {"method": None}, "None.*RK45"),
    ("method", {"method": int}, "class 'int'.*OdeSolver"),
    ("rtol", {"rtol": 0.0}, "0.0.*> 0"),
    ("rtol", {"rtol": -1e-9}, "-1e-09.*> 0"),
    ("rtol", {"rtol": math.nan}, "nan.*> 0"),
    ("atol", {"atol": 0.0}, "0.0.*> 0"),
    ("atol", {"atol": math.inf}, "inf.*> 0"),
    ("m1", {"parameters": {"m1": 0.0}}, "0.0.*> 0"),
    ("mass", {"parameters": {"mass": 1.0}}, "m1"),
    # What is no number at all.
    ("state", {"state": "here"}, "'here'"),
    ("state", {"state": np.array(VIOLENT) + 1j}, "j.*real numbers"),
    ("state", {"state": np.array(VIOLENT) * 1e200, "method": "ode45"}, r"no number larger than 1e\+100"),
    ("state", {"state": [1.0, [2.0, 3.0]]}, r"\[1.0, \[2.0, 3.0\]\]"),
    ("times", {"times": "soon"}, "'soon'"),
    ("rtol", {"rtol": "1e-9"}, "'1e-9'.*> 0"),
    ("atol", {"atol": [1e-9]}, r"\[1e-09\].*> 0"),
]


@pytest.mark.parametrize(("name", "argument", "pattern"), WRONG)
def test_wrong_argument_is_named(name: str, argument: dict[str, Any], pattern: str) -> None:
    """With its value and what is allowed."""
    right: dict[str, Any] = {"parameters": None, "state": VIOLENT, "times": TIMES}
    with pytest.raises(ValueError, match=rf"(?s)\b{name}\b.*{pattern}"):
        simulate(**{**right, **argument})


@pytest.mark.filterwarnings("error")
def test_giving_up_says_when() -> None:
    """A motion that no step can follow: an error with the time, not half a trajectory, nor a warning of NumPy's."""
    with pytest.raises(ArithmeticError, match="DOP853 stopped at t ="):
        simulate({"k1": 1e300, "k2": 1e300, "L1": 0.0}, VIOLENT, TIMES)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("method", "times"), [("ode45", [0.0, 1.0]), ("ode45", [0.0, 0.5, 1.0]), ("DOP853", [0.0, 1.0])]
)
def test_steps_have_a_ceiling(method: str, times: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside 1e90 m the small numbers of a state are rounding, to which no tolerance can be held."""
    monkeypatch.setattr(simulation, "LEAST_EVALUATIONS", 2_000)
    monkeypatch.setattr(simulation, "EVALUATIONS_PER_RADIAN", 0)
    state = [0, 0, -1e90, 0, 0, -2e90, 1, 1, 1, 0, 0, 0]
    with pytest.raises(ArithmeticError, match=f"{method} stopped at t = .* after 2,000 evaluations"):
        simulate(None, state, times, method)


def test_ceiling_is_far_above_what_the_default_takes() -> None:
    """A hundredth of it would do, for a violent motion and the method that takes most too."""
    for method, tolerance, share in (("DOP853", 1e-12, 100), ("RK23", 1e-9, 100)):
        most = simulation._most_evaluations(Parameters(), method, 1.0)
        found = solve_ivp(simulation.right_hand_side(None), (0.0, 1.0), VIOLENT, method, rtol=tolerance, atol=tolerance)
        assert share * found.nfev < most
