"""Periodic orbits by shooting against the reference and closed forms, and what is kept along a motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference_data import VIOLENT, load

from spring_pendulum_env import Parameters, energy, equilibrium, normal_modes, simulate
from spring_pendulum_env.dynamics import NotPeriodicError, monodromy_matrix, periodic_orbit, quantities

FloatArray = NDArray[np.float64]

ORBITS: dict[str, Any] = load("periodic")
BODIES = np.r_[3:9, 12:18]


def reference(name: str) -> tuple[Parameters, FloatArray, float]:
    orbit = ORBITS[name]
    return Parameters.of(orbit["params"]), np.array(orbit["initial_state"], dtype=float), float(orbit["period"])


def bound(parameters: Parameters) -> FloatArray:
    """Which numbers of the state belong to a mass that a spring holds."""
    return np.r_[0:3, 6:9] if parameters.k2 == 0 else np.arange(12)


@pytest.mark.parametrize("name", ORBITS)
def test_motion_closes_on_the_reference(name: str) -> None:
    parameters, state, period = reference(name)
    end, _ = monodromy_matrix(parameters, state, period)
    assert np.abs(end - state)[bound(parameters)].max() < 1e-10


@pytest.mark.parametrize("name", ORBITS)
def test_found_from_a_rough_guess(name: str) -> None:
    """The orbit that is found closes for another integrator too, and has the guess's energy."""
    parameters, state, period = reference(name)
    kept = bound(parameters)
    guess = state.copy()
    guess[kept] += 0.01 * np.random.default_rng(0).standard_normal(len(kept))
    found = periodic_orbit(parameters, guess, 1.003 * period)
    assert found.closure < 1e-10
    assert 0 < found.iterations < 10
    assert found.period == pytest.approx(period, rel=5e-3)
    assert np.abs(found.state - state).max() < 0.3
    run = simulate(parameters, found.state, [0.0, found.period], rtol=1e-13, atol=1e-13)
    assert np.abs(run.states[1] - found.state)[kept].max() < 1e-10
    if len(kept) == 12:
        assert energy(parameters, found.state) == pytest.approx(float(energy(parameters, guess)), abs=1e-9)
    assert found.multipliers.shape == (len(kept),)
    assert found.stable


def test_exact_orbit_needs_no_correction() -> None:
    parameters, state, period = reference("full_conical")
    found = periodic_orbit(parameters, state, period, tolerance=1e-10)
    assert found.iterations == 0
    np.testing.assert_array_equal(found.state, state)
    assert found.period == period


def test_period_can_be_held() -> None:
    parameters, state, period = reference("full_planar_swing_mode")
    found = periodic_orbit(parameters, state, 1.01 * period, hold="period")
    assert found.period == pytest.approx(1.01 * period, rel=1e-12)
    assert found.closure < 1e-10
    assert energy(parameters, found.state) > energy(parameters, state) + 0.1  # wider swings take longer


def test_multipliers_of_a_vertical_mode_are_those_of_small_motions() -> None:
    """A vertical mode of small amplitude: the other modes turn by their frequencies times its period."""
    modes = normal_modes(None, "hanging-hanging")
    frequencies = np.sqrt(modes.omega_squared)
    number = int(np.argmin(np.abs(frequencies - 6.1803)))
    state = equilibrium(None, "hanging-hanging")[BODIES]
    state[:6] += 1e-4 * modes.shapes[:, number]
    period = 2 * np.pi / frequencies[number]
    found = periodic_orbit(None, state, period)
    angles = np.sort(np.abs(np.angle(found.multipliers)))
    turns = np.concatenate([frequencies, frequencies]) * period
    expected = np.sort(np.abs((turns + np.pi) % (2 * np.pi) - np.pi))
    np.testing.assert_allclose(angles, expected, rtol=0, atol=1e-3)
    assert found.period == pytest.approx(period, rel=1e-10)


def test_multipliers_come_in_pairs() -> None:
    parameters, state, period = reference("full_planar_swing_mode")
    found = periodic_orbit(parameters, state, period, tolerance=1e-10)
    products = np.array([np.abs(found.multipliers * other - 1).min() for other in found.multipliers])
    assert products.max() < 1e-6
    assert (np.abs(found.multipliers - 1) < 1e-5).sum() == 4  # time and energy, turn and angular momentum
    assert np.linalg.det(found.monodromy) == pytest.approx(1.0, abs=1e-9)


def test_unstable_orbit() -> None:
    """The vertical mode about the inverted rest: it falls to the side."""
    modes = normal_modes(None, "inverted-inverted")
    state = equilibrium(None, "inverted-inverted")[BODIES]
    number = int(np.argmax(modes.omega_squared))
    state[:6] += 0.01 * modes.shapes[:, number]
    period = 2 * np.pi / float(np.sqrt(modes.omega_squared[number]))
    found = periodic_orbit(None, state, period)
    assert not found.stable
    growth = np.sqrt(-modes.omega_squared.min())
    assert np.abs(found.multipliers).max() == pytest.approx(np.exp(growth * period), rel=1e-2)


@pytest.mark.parametrize(
    ("parameters", "state", "period"),
    [
        (None, VIOLENT, 3.0),
        ({"R1": 0.5, "R2": 0.5}, equilibrium(None, "hanging-hanging")[BODIES] + 0.01, 2.8),
    ],
    ids=["chaotic", "drag"],
)
def test_search_that_does_not_converge(parameters: Any, state: FloatArray, period: float) -> None:
    with pytest.raises(NotPeriodicError, match=r"no periodic orbit found near guess = .* misses its start by"):
        periodic_orbit(parameters, state, period, max_iterations=8)


def test_period_too_short_to_move_is_no_orbit() -> None:
    with pytest.raises(NotPeriodicError, match="no time at all"):
        periodic_orbit(None, VIOLENT, 1e-13)


def test_rest_is_no_orbit() -> None:
    with pytest.raises(NotPeriodicError, match="at rest"):
        periodic_orbit(None, equilibrium(None, "hanging-hanging")[BODIES], 1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"guess": VIOLENT[:6]}, r"guess of shape \(6,\)"),
        ({"guess": VIOLENT * np.nan}, "must be finite"),
        ({"period": 0.0}, "period = 0.0"),
        ({"period": -1.0}, "period = -1.0"),
        ({"period": 1e9}, "period = 1000000000.0 s: must be at most 2500 s"),
        ({"guess": VIOLENT + 0j}, "(?s)guess = .*must be real numbers"),
        ({"tolerance": 0.0}, "tolerance = 0.0"),
        ({"max_iterations": 0}, "max_iterations = 0"),
        ({"hold": "phase"}, "hold = 'phase'"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        periodic_orbit(**{"parameters": None, "guess": VIOLENT, "period": 1.0, **arguments})


# What is kept along a motion.


@pytest.mark.parametrize(
    ("changes", "kept"),
    [
        ({}, ["energy", "Lz"]),
        ({"g": 0.0}, ["energy", "Lx", "Ly", "Lz"]),
        ({"g": 0.0, "k1": 0.0}, ["energy", "Lx", "Ly", "Lz", "Px", "Py", "Pz"]),
        ({"k1": 0.0}, ["energy", "Px", "Py", "Lz"]),
        ({"R2": 0.1}, []),
    ],
)
def test_quantities_along_a_motion(changes: dict[str, float], kept: list[str]) -> None:
    state = np.array([0.4, 0.1, -0.9, 1.1, 0.3, -1.2, 0.3, -0.5, 0.2, 0.1, 0.4, -0.6])
    run = simulate(changes, state, np.linspace(0.0, 5.0, 26))
    found = quantities(changes, run.states)
    assert found.energy.shape == (26,)
    assert found.angular_momentum.shape == found.momentum.shape == (26, 3)
    np.testing.assert_array_equal(found.energy, run.energy)
    series = {"energy": found.energy}
    series |= {f"L{axis}": found.angular_momentum[:, number] for number, axis in enumerate("xyz")}
    series |= {f"P{axis}": found.momentum[:, number] for number, axis in enumerate("xyz")}
    for name, values in series.items():
        changed = float(np.ptp(values))
        assert (changed < 1e-9) == (name in kept), (name, changed)


def test_quantities_of_one_state() -> None:
    """By hand: m1 moves along y at x = 2, m2 along z at x = 3; the anchor of an 18-number state counts too."""
    state = np.zeros(12)
    state[[0, 3]] = 2.0, 3.0
    state[7], state[11] = 5.0, 7.0
    found = quantities({"m1": 2.0, "m2": 0.5}, state)
    np.testing.assert_allclose(found.momentum, [0, 10, 3.5])
    np.testing.assert_allclose(found.angular_momentum, [0, -10.5, 20])
    full = np.zeros(18)
    full[1], full[11] = 1.0, 4.0
    with_anchor = quantities({"m0": 3.0}, full)
    np.testing.assert_allclose(with_anchor.momentum, [0, 0, 12])
    np.testing.assert_allclose(with_anchor.angular_momentum, [12, 0, 0])
    with pytest.raises(ValueError, match="must be finite"):
        quantities(None, np.full(12, np.nan))
    with pytest.raises(ValueError, match="12 or 18"):
        quantities(None, np.zeros(6))
