"""ode45: its step counts and errors against another implementation's, its rules one by one, its interpolant's order."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference_data import VIOLENT, load
from scipy.integrate import RK45, solve_ivp

from spring_pendulum_env import simulate
from spring_pendulum_env.ode45 import INTERPOLANT, ODE45, refined
from spring_pendulum_env.simulation import right_hand_side

FloatArray = NDArray[np.float64]

FITS = load("paper_fits")["cases"]
RUNS = [
    pytest.param(name, run, id=f"{name}-{run['rtol']:g}")
    for name, case in FITS.items()
    for run in case["runs"]
    if run["matlab_ode45_model"]["spread_percent_under_1e-12_noise"] < 0.02  # else it is an accident of rounding
]


@pytest.mark.parametrize(("name", "run"), RUNS)
def test_makes_the_steps_and_the_errors_of_another_implementation(name: str, run: dict[str, Any]) -> None:
    """Of the same published rules, written independently: to within what noise of 1e-12 in the start does to it."""
    case = FITS[name]
    expected = run["matlab_ode45_model"]
    ends = (0.0, case["t_end"])
    ours = simulate(case["parameters"], case["initial_state"], ends, "ode45", run["rtol"], run["atol"])
    allowed = 1e-9 + expected["spread_percent_under_1e-12_noise"]
    assert (len(ours.times) - 1) / 4 == expected["steps"]
    assert 100 * ours.energy_error == pytest.approx(abs(expected["final_error_percent"]), abs=allowed)
    assert 100 * ours.mean_energy_error == pytest.approx(expected["mean_error_percent"], abs=allowed)


def test_enough_runs_are_told_from_rounding() -> None:
    assert len(RUNS) >= 18
    assert {run.values[1]["rtol"] for run in RUNS} == {1e-3, 1e-4, 1e-7}


def test_defaults_are_matlabs() -> None:
    run = simulate(None, VIOLENT, (0.0, 5.0), "ode45")
    same = simulate(None, VIOLENT, (0.0, 5.0), "ode45", 1e-3, 1e-6)
    np.testing.assert_array_equal(run.states, same.states)
    other = simulate(None, VIOLENT, (0.0, 5.0), "ode45", atol=1e-2)
    assert len(other.times) < len(run.times)
    assert 1e-4 < run.energy_error < 1.0


def test_two_instants_give_the_solvers_points_and_more_give_themselves() -> None:
    run = simulate(None, VIOLENT, (1.0, 4.0), "ode45", 1e-5)
    assert (run.times[0], run.times[-1]) == (1.0, 4.0)
    assert (np.diff(run.times) > 0).all()
    steps = run.times[::4]
    parts = np.diff(run.times).reshape(-1, 4)
    np.testing.assert_allclose(parts, np.repeat(np.diff(steps)[:, None] / 4, 4, axis=1), rtol=1e-9)
    assert run.states.shape == (len(run.times), 12)
    np.testing.assert_array_equal(run.states[0], VIOLENT)

    times = [1.0, 2.0, 2.5, 4.0]
    asked = simulate(None, VIOLENT, times, "ode45", 1e-5)
    np.testing.assert_array_equal(asked.times, times)
    exact = simulate(None, VIOLENT, times)
    assert 1e-9 < np.abs(asked.states - exact.states).max() < 1e-2


def test_requested_points_lie_on_the_steps_of_the_run_without_them() -> None:
    """Where the first gap is longer than the first step."""
    ends = simulate(None, VIOLENT, (0.0, 3.0), "ode45")
    asked = simulate(None, VIOLENT, [0.0, ends.times[40], ends.times[41], ends.times[42], 3.0], "ode45")
    np.testing.assert_allclose(asked.states[1:4], ends.states[40:43], rtol=0, atol=1e-12)
    np.testing.assert_allclose(asked.states[-1], ends.states[-1], rtol=0, atol=1e-12)


def test_refine_one_keeps_the_steps() -> None:
    slope = right_hand_side(None)
    times, states = refined(ODE45(slope, 0.0, VIOLENT, 2.0), refine=1)
    fine_times, fine_states = refined(ODE45(slope, 0.0, VIOLENT, 2.0))
    np.testing.assert_array_equal(times, fine_times[::4])
    np.testing.assert_array_equal(states, fine_states[::4])


# The rules, on slopes made for them.


def step_lengths(solver: ODE45) -> FloatArray:
    return np.diff(refined(solver, refine=1)[0])


@pytest.mark.parametrize(
    ("y0", "slope", "rtol", "atol"), [(2.0, 3.0, 1e-3, 1e-6), (0.0, 3.0, 1e-3, 1e-6), (-5.0, 0.2, 1e-5, 1e-2)]
)
def test_first_step(y0: float, slope: float, rtol: float, atol: float) -> None:
    """It changes the state by 0.8 rtol^(1/5) of its size or of atol / rtol, whichever is larger."""
    solver = ODE45(lambda _t, _y: [slope], 0.0, [y0], 1e6, rtol, atol)
    solver.step()
    assert solver.t * slope == pytest.approx(0.8 * rtol**0.2 * max(abs(y0), atol / rtol), rel=1e-12)


def test_largest_component_sets_the_first_step() -> None:
    solver = ODE45(lambda _t, _y: [1.0, -50.0, 2.0], 0.0, [1.0, 1.0, 1.0], 1e6)
    solver.step()
    assert solver.t == pytest.approx(0.8 * 1e-3**0.2 / 50.0, rel=1e-12)


def test_steps_grow_fivefold_up_to_a_tenth_of_the_interval() -> None:
    lengths = step_lengths(ODE45(lambda _t, _y: [1.0], 0.0, [1e-3], 1.0))  # no error at all
    first = 0.8 * 1e-3**0.2 * 1e-3
    np.testing.assert_allclose(lengths[:5], [first, 5 * first, 25 * first, 125 * first, 0.1], rtol=1e-12)
    np.testing.assert_allclose(lengths[4:-1], 0.1, rtol=1e-12)
    assert lengths[-1] <= 0.11


def test_first_step_keeps_to_the_first_gap() -> None:
    solver = ODE45(lambda _t, _y: [0.0], 0.0, [1.0], 1.0, first_gap=0.003)
    solver.step()
    assert solver.t == 0.003
    solver.step()
    assert solver.t == pytest.approx(0.018, rel=1e-12)


def test_last_step_is_stretched_to_the_end() -> None:
    """Ten steps of a tenth and no crumb; and the end is met exactly."""
    for end in (1.0, 0.7, math.pi):
        times, _ = refined(ODE45(lambda _t, _y: [0.0], 0.0, [1.0], end), refine=1)
        assert len(times) == 11
        assert times[-1] == end


def test_next_step_is_what_the_error_allows() -> None:
    """y' = 5 t^4: the pair's two formulas differ by a multiple of h^5, so the error is known beforehand."""
    solver = ODE45(lambda t, _y: [5.0 * t**4], 0.0, [1.0], 20.0, rtol=1e-6, first_gap=0.1)
    solver.step()
    error = abs(0.1 * (RK45.E @ (5.0 * (0.1 * np.r_[RK45.C, 1.0]) ** 4))) / solver.y[0]
    solver.step()
    grown = 0.1 * min(5.0, 0.8 * (1e-6 / error) ** 0.2)
    assert solver.t - 0.1 == pytest.approx(grown, rel=1e-9)
    assert 0.11 < grown < 0.5


def test_failed_step_shrinks_by_its_error_then_by_halves_and_does_not_grow() -> None:
    """A bump in the slope that the first tries step into; each try's length is seen from its last evaluation."""
    seen: list[float] = []

    def slope(t: float, _y: FloatArray) -> list[float]:
        seen.append(t)
        return [1e4 if t > 0.02 else 0.0]

    solver = ODE45(slope, 0.0, [1.0], 10.0, rtol=1e-12, first_gap=1.0)
    solver.step()
    tries = [max(seen[6 * n + 1 : 6 * n + 7]) for n in range(solver.failures + 1)]
    np.testing.assert_allclose(tries, [1.0, 0.1, 0.05, 0.025, 0.0125], rtol=1e-12)  # first as short as it may be
    assert solver.t == tries[-1]
    assert solver.next_step == pytest.approx(tries[-1], rel=1e-12)


def test_first_failure_shrinks_by_the_error() -> None:
    seen: list[float] = []

    def slope(t: float, _y: FloatArray) -> list[float]:
        seen.append(t)
        return [5.0 * t**4]

    solver = ODE45(slope, 0.0, [1.0], 20.0, rtol=1e-6, first_gap=1.0)
    solver.step()
    y_new = 1.0 + 1.0  # exact: the order is 5
    error = abs(RK45.E @ (5.0 * np.r_[RK45.C, 1.0] ** 4)) / y_new
    assert solver.failures >= 1
    assert max(seen[7:13]) == pytest.approx(max(0.1, 0.8 * (1e-6 / error) ** 0.2), rel=1e-9)
    assert 0.1 < max(seen[7:13]) < 0.8


def test_error_is_relative_to_the_larger_end_and_the_threshold() -> None:
    """Small components don't count below atol / rtol: the same motion, a thousand times smaller, takes fewer steps."""

    def decay(_t: float, y: FloatArray) -> FloatArray:
        return -y

    counts = [len(step_lengths(ODE45(decay, 0.0, [size], 20.0, 1e-4, 1e-6))) for size in (1.0, 1e-2, 1e-4, 1e-6)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]
    alone = step_lengths(ODE45(decay, 0.0, [1.0], 20.0, 1e-4, 1e-6))
    beside = step_lengths(ODE45(decay, 0.0, [1.0, 1e-9], 20.0, 1e-4, 1e-6))
    np.testing.assert_allclose(alone, beside, rtol=1e-9)


# The interpolant.


def test_interpolant_is_of_order_four_and_smooth() -> None:
    """The conditions of order 4 at every fraction x of a step; its ends and their slopes."""
    a = np.zeros((7, 7))
    a[:6, :5] = RK45.A
    a[6, :6] = RK45.B
    c = np.r_[RK45.C, 1.0]
    np.testing.assert_allclose(a.sum(axis=1), c, atol=1e-15)
    for x in np.linspace(0.0, 1.0, 9):
        b = INTERPOLANT @ x ** np.arange(1, 5)
        found = [
            b.sum(), b @ c, b @ c**2, b @ a @ c, b @ c**3, b @ (c * (a @ c)), b @ a @ c**2, b @ a @ a @ c,
        ]  # fmt: skip
        wanted = [x, x**2 / 2, x**3 / 3, x**3 / 6, x**4 / 4, x**4 / 8, x**4 / 12, x**4 / 24]
        np.testing.assert_allclose(found, wanted, rtol=0, atol=3e-15)
    np.testing.assert_allclose(INTERPOLANT.sum(axis=1), np.r_[RK45.B, 0.0], atol=3e-15)
    np.testing.assert_array_equal(INTERPOLANT[:, 0], np.eye(7)[0])
    np.testing.assert_allclose(INTERPOLANT @ np.arange(1, 5), np.eye(7)[6], atol=1e-14)


def test_interpolant_is_not_scipys() -> None:
    assert np.abs(INTERPOLANT - RK45.P).max() > 0.01


def test_dense_output_takes_one_instant_or_many() -> None:
    solver = ODE45(right_hand_side(None), 0.0, VIOLENT, 2.0)
    for _ in range(3):
        solver.step()
    dense = solver.dense_output()
    instants = np.linspace(solver.t_old, solver.t, 5)
    many = dense(instants)
    assert many.shape == (12, 5)
    for column, instant in zip(many.T, instants, strict=True):
        np.testing.assert_allclose(dense(instant), column, rtol=0, atol=1e-14)
    np.testing.assert_allclose(many[:, -1], solver.y, rtol=0, atol=1e-13)


def test_solve_ivp_takes_it_either_way_in_time() -> None:
    there = solve_ivp(right_hand_side(None), (0.0, 2.0), VIOLENT, method=ODE45, rtol=1e-9, atol=1e-9)
    back = solve_ivp(right_hand_side(None), (2.0, 0.0), there.y[:, -1], method=ODE45, rtol=1e-9, atol=1e-9)
    tries, rest = divmod(there.nfev - 1, 6)  # six slopes for each, and one at the start
    assert rest == 0
    assert tries >= len(there.t) - 1
    assert 1e-12 < np.abs(back.y[:, -1] - VIOLENT).max() < 1e-6


# What goes wrong.


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("times", [(0.0, 1.0), (0.0, 0.5, 1.0)])
def test_giving_up_says_when(times: tuple[float, ...]) -> None:
    with pytest.raises(ArithmeticError, match=r"ode45 stopped at t = 0.*shortest allowed"):
        simulate({"k1": 1e308, "m1": 0.01, "L1": 0.0}, VIOLENT, times, "ode45")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_gives_up_where_the_state_runs_away() -> None:
    """y' = y^2 from 1 is infinite at t = 1."""
    with pytest.raises(ArithmeticError, match=r"ode45 stopped at t = (0\.99|1\.00).*shortest allowed"):
        refined(ODE45(lambda _t, y: y * y, 0.0, [1.0], 2.0))


@pytest.mark.parametrize(
    ("options", "pattern"),
    [
        ({"rtol": 0.0}, "rtol = 0.0.*> 0"),
        ({"rtol": math.nan}, "rtol = nan.*> 0"),
        ({"atol": -1.0}, "atol = -1.0.*> 0"),
        ({"atol": [1e-6] * 11 + [0.0]}, "atol = 0.0.*> 0"),
        ({"atol": [1e-6] * 5}, r"atol of shape \(5,\): .*\(12,\)"),
        ({"first_gap": 0.0}, "first_gap = 0.0.*> 0"),
        ({"t0": math.nan}, "t0 = nan.*finite"),
        ({"t_bound": math.inf}, "t_bound = inf.*finite"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], pattern: str) -> None:
    with pytest.raises(ValueError, match=pattern):
        ODE45(right_hand_side(None), **{"t0": 0.0, "y0": VIOLENT, "t_bound": 1.0, **options})


def test_wrong_refine_is_named() -> None:
    for wrong in (0, -1, 1.5, "a", True):
        with pytest.raises(ValueError, match=f"refine = {wrong!r}.*whole number > 0"):
            refined(ODE45(right_hand_side(None), 0.0, VIOLENT, 1.0), wrong)  # type: ignore[arg-type]
