"""The four equilibria, small motions about them, and the energy of a state, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference_data import load, passive, steps

from spring_pendulum_env import (
    EQUILIBRIA,
    NormalModes,
    Parameters,
    energy,
    equilibrium,
    linearise,
    normal_modes,
    physics,
)

FloatArray = NDArray[np.float64]

CLOSED = load("closed_forms")
UNEVEN = Parameters(m0=1.7, m1=0.9, m2=1.3, k1=120.0, k2=70.0, L1=0.8, L2=1.1, R0=0.4, R1=0.3, R2=0.2, g=9.7)
NAMES = pytest.mark.parametrize("name", EQUILIBRIA)
HOLDS = pytest.mark.parametrize("pinned", [True, False], ids=["pinned", "free"])


def closed_form(name: str) -> Any:
    return CLOSED["equilibria"][name.replace("-", "_")]


def derivative(p: Parameters, numbers: FloatArray, axes: str = "xyz") -> FloatArray:
    """Time derivative of a state of 18 numbers under a force of 3."""
    return np.array(physics.derivatives(*numbers, *p.constants(axes), *p.drag_rates()))


def test_names() -> None:
    assert EQUILIBRIA == ("hanging-hanging", "hanging-inverted", "inverted-hanging", "inverted-inverted")
    assert {name.replace("-", "_") for name in EQUILIBRIA} == set(CLOSED["equilibria"])


@NAMES
def test_equilibrium_is_the_closed_form(name: str) -> None:
    expected = np.zeros(18)
    expected[5], expected[8] = float(closed_form(name)["z1"]), float(closed_form(name)["z2"])
    np.testing.assert_allclose(equilibrium(None, name), expected, rtol=0, atol=1e-14)
    assert energy(None, equilibrium(None, name)) == pytest.approx(float(closed_form(name)["energy"]), abs=1e-13)


@NAMES
@pytest.mark.parametrize("p", [Parameters(), UNEVEN, Parameters(g=0.0)], ids=["default", "uneven", "weightless"])
def test_nothing_accelerates_at_an_equilibrium(name: str, p: Parameters) -> None:
    """Pinned or free: the gantry bears the load."""
    at_rest = np.r_[equilibrium(p, name), np.zeros(3)]
    for axes in ("", "xyz"):
        assert np.abs(derivative(p, at_rest, axes)).max() < 1e-13 * max(p.k1, p.k2)
    spring1, spring2 = equilibrium(p, name)[5], equilibrium(p, name)[8] - equilibrium(p, name)[5]
    for height, way in zip((spring1, spring2), name.split("-"), strict=True):
        assert (height < 0) == (way == "hanging")


@NAMES
@pytest.mark.parametrize("tolerance", [None, 1e-13])
def test_environment_rests_at_an_equilibrium(name: str, tolerance: float | None) -> None:
    state = np.delete(equilibrium(UNEVEN, name), [0, 1, 2, 9, 10, 11])
    after, _ = steps(passive(state, UNEVEN, 0.02, tolerance), 10)
    np.testing.assert_allclose(after, state, rtol=0, atol=1e-13)


@NAMES
@HOLDS
def test_linearisation_is_that_of_finite_differences(name: str, pinned: bool) -> None:
    """A and B, column by column, of the equations themselves."""
    at = np.r_[equilibrium(UNEVEN, name), np.zeros(3)]
    columns = []
    for column in range(21):
        forth, back = at.copy(), at.copy()
        forth[column] += 1e-5
        back[column] -= 1e-5
        axes = "" if pinned else "xyz"
        columns.append((derivative(UNEVEN, forth, axes) - derivative(UNEVEN, back, axes)) / 2e-5)
    expected = np.array(columns).T
    if pinned:
        bodies = [*range(3, 9), *range(12, 18)]
        A = linearise(UNEVEN, name, pinned=True)
        assert A.shape == (12, 12)
        np.testing.assert_allclose(A, expected[np.ix_(bodies, bodies)], rtol=0, atol=1e-6)
    else:
        A, B = linearise(UNEVEN, name)
        assert (A.shape, B.shape) == ((18, 18), (18, 3))
        np.testing.assert_allclose(A, expected[:, :18], rtol=0, atol=1e-6)
        np.testing.assert_allclose(B, expected[:, 18:], rtol=0, atol=1e-9)
        per_newton = np.zeros((18, 3))
        per_newton[9:12] = np.eye(3) / UNEVEN.m0
        np.testing.assert_array_equal(B, per_newton)


def closed_omega_squared(name: str, pinned: bool) -> list[float]:
    """Squared frequencies from the closed forms, ascending, each lateral one twice."""
    modes = closed_form(name)["pinned" if pinned else "free_anchor_m0_1"]
    lateral = [float(mode["omega2"]) for mode in modes["lateral_x_and_y_each"]]
    return sorted([*lateral, *lateral, *(float(mode["omega2"]) for mode in modes["vertical_z"])])


@NAMES
@HOLDS
def test_normal_modes_are_the_closed_forms(name: str, pinned: bool) -> None:
    modes = normal_modes(None, name, pinned=pinned)
    assert isinstance(modes, NormalModes)
    np.testing.assert_allclose(modes.omega_squared, closed_omega_squared(name, pinned), rtol=1e-12, atol=1e-11)
    size = 6 if pinned else 9
    assert modes.shapes.shape == (size, size)


@NAMES
@HOLDS
def test_eigenvalues_of_the_linearisation_are_the_closed_forms(name: str, pinned: bool) -> None:
    matrix = linearise(None, name, pinned=True) if pinned else linearise(None, name)[0]
    squares = np.sort(-(np.linalg.eigvals(matrix) ** 2).real)
    expected = np.sort(np.repeat(closed_omega_squared(name, pinned), 2))
    np.testing.assert_allclose(squares, expected, rtol=1e-10, atol=1e-6)  # free drifts are defective: root of rounding


@HOLDS
@NAMES
def test_modes_diagonalise_the_system(name: str, pinned: bool) -> None:
    """Normalised by the masses, and each shape swings on its own, for masses that differ."""
    modes = normal_modes(UNEVEN, name, pinned=pinned)
    masses = np.repeat([UNEVEN.m1, UNEVEN.m2] if pinned else [UNEVEN.m0, UNEVEN.m1, UNEVEN.m2], 3)
    np.testing.assert_allclose(modes.shapes.T @ (masses[:, None] * modes.shapes), np.eye(len(masses)), atol=1e-12)
    undamped = UNEVEN.replace({"R0": 0.0, "R1": 0.0, "R2": 0.0})
    matrix = linearise(undamped, name, pinned=True) if pinned else linearise(undamped, name)[0]
    size = len(masses)
    np.testing.assert_allclose(matrix[size:, :size] @ modes.shapes, -modes.shapes * modes.omega_squared, atol=1e-10)
    assert (np.diff(modes.omega_squared) >= 0).all()


def test_frequencies_of_the_defaults() -> None:
    """Lateral 2.2378 and 5.4094 rad/s, twice each; vertical ten over and ten times the golden ratio."""
    phi = (1 + math.sqrt(5)) / 2
    omega = normal_modes(None, "hanging-hanging").frequencies
    np.testing.assert_allclose(omega, [2.2378, 2.2378, 5.4094, 5.4094, 10 / phi, 10 * phi], rtol=0, atol=5e-5)
    np.testing.assert_allclose(omega[4:], [10 / phi, 10 * phi], rtol=1e-13)
    fastest = normal_modes(None, "inverted-inverted", pinned=False).frequencies[0]
    assert fastest.real == 0
    assert fastest.imag == pytest.approx(7.514, abs=5e-4)


@pytest.mark.parametrize("direction", ["lateral", "vertical"])
def test_mode_shapes_of_the_defaults(direction: str) -> None:
    modes = normal_modes(None, "hanging-hanging")
    for expected in CLOSED["hanging_pinned_mode_shapes"][direction]:
        near = np.abs(np.sqrt(modes.omega_squared) - float(expected["omega"])) < 1e-9
        assert near.sum() == (2 if direction == "lateral" else 1)
        for shape in modes.shapes.T[near]:
            axis = np.abs(shape[:3]).argmax()
            assert (axis == 2) == (direction == "vertical")
            assert shape[3 + axis] / shape[axis] == pytest.approx(float(expected["ratio_m2_over_m1"]), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "rate"), [("hanging-inverted", 4.273), ("inverted-hanging", 6.736), ("inverted-inverted", 7.514)]
)
def test_fastest_growth_with_a_free_anchor(name: str, rate: float) -> None:
    A, _ = linearise(None, name)
    assert np.linalg.eigvals(A).real.max() == pytest.approx(rate, abs=5e-4)
    assert math.sqrt(-normal_modes(None, name, pinned=False).omega_squared[0]) == pytest.approx(rate, abs=5e-4)


def test_damped_modes_are_the_closed_forms() -> None:
    """R1 = R2 = 0.05 kg/s and equal masses: eigenvalues -R/2 +- i sqrt(omega^2 - R^2/4)."""
    matrix = linearise({"R1": 0.05, "R2": 0.05}, "hanging-hanging", pinned=True)
    eigenvalues = np.linalg.eigvals(matrix)
    expected = []
    for number, mode in enumerate(CLOSED["damped_modes_R_0.05_equal_masses"]["modes"]):
        expected += [float(mode["omega_d"])] * (2 if number < 2 else 1)
    np.testing.assert_allclose(np.sort(eigenvalues.imag[eigenvalues.imag > 0]), expected, rtol=1e-11)
    np.testing.assert_allclose(eigenvalues.real, -0.025, rtol=1e-9)


def test_drag_ends_every_motion_hanging_at_rest() -> None:
    rest = CLOSED["rest_state_with_drag"]
    start = np.delete(equilibrium(None, "inverted-inverted"), [0, 1, 2, 9, 10, 11])
    start[0] += 0.1
    start[4] -= 0.2
    state, info = steps(passive(start, {"R1": 2.0, "R2": 2.0}, 1.0), 60)
    np.testing.assert_allclose(state, [0, 0, float(rest["z1"]), 0, 0, float(rest["z2"]), *[0] * 6], rtol=0, atol=1e-12)
    assert info["energy"] == pytest.approx(float(rest["energy"]), abs=1e-12)
    assert info["excess_energy"] == pytest.approx(0.0, abs=1e-12)


# Errors.


@pytest.mark.parametrize("function", [equilibrium, linearise, normal_modes])
def test_unknown_equilibrium_is_named(function: Any) -> None:
    for unknown in ("hanging", "hanging_hanging", "", None):
        with pytest.raises(ValueError) as caught:
            function(None, unknown)
        assert repr(unknown) in str(caught.value)
        for name in EQUILIBRIA:
            assert name in str(caught.value)


@NAMES
@pytest.mark.parametrize("spring", ["k1", "k2"])
@pytest.mark.parametrize("function", [equilibrium, linearise, normal_modes])
def test_missing_spring_is_named(function: Any, spring: str, name: str) -> None:
    with pytest.raises(ValueError, match=rf"{spring} = 0.*must have {spring} > 0") as caught:
        function({spring: 0.0}, name)
    assert repr(name) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "changed", "spring"),
    [
        ("inverted-hanging", {"k1": 10.0}, "1"),
        ("inverted-inverted", {"k1": 10.0}, "1"),
        ("hanging-inverted", {"k2": 5.0}, "2"),
        ("inverted-inverted", {"k2": 5.0}, "2"),
        ("inverted-hanging", {"L1": 0.0}, "1"),
        ("hanging-inverted", {"L2": 0.0, "g": 0.0}, "2"),  # to exactly nothing
        ("hanging-inverted", {"m2": 1000.0}, "2"),
    ],
)
def test_spring_compressed_to_nothing_is_named(name: str, changed: dict[str, float], spring: str) -> None:
    p = Parameters.of(changed)
    with pytest.raises(ValueError, match=rf"spring {spring}\b.*compressed") as caught:
        equilibrium(p, name)
    message = str(caught.value)
    assert repr(name) in message
    assert str(getattr(p, f"k{spring}")) in message
    assert str(getattr(p, f"L{spring}")) in message
    equilibrium(p, "hanging-hanging")  # which the same springs hold


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("changes", "named"), [({"k1": 1e308, "m1": 1e-9}, "k1=1e.308"), ({"k1": 1e-308}, "k1 = 1e-308")]
)
def test_constants_beyond_floating_point_are_named(changes: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        normal_modes(changes, "hanging-hanging")


@pytest.mark.parametrize("function", [equilibrium, linearise, normal_modes])
def test_wrong_parameter_is_named(function: Any) -> None:
    with pytest.raises(ValueError, match=r"m1 = -1"):
        function({"m1": -1.0}, "hanging-hanging")
    with pytest.raises(ValueError, match=r"'mass'"):
        function({"mass": 1.0}, "hanging-hanging")


# Energy of a state.


def test_energy_by_hand() -> None:
    """m1 one metre above the anchor, m2 a metre beside it: springs at 1 m and sqrt(2) m."""
    state = np.zeros(18)
    state[5], state[6] = 1.0, 1.0
    state[9:] = [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0]
    p = Parameters(m0=2.0, m1=3.0, m2=4.0, k1=10.0, k2=20.0, L1=0.5, L2=0.25, g=8.0)
    moving = 0.5 * (2.0 * 1.0 + 3.0 * 4.0 + 4.0 * 9.0)
    stored = 0.5 * 10.0 * 0.25 + 0.5 * 20.0 * (math.sqrt(2.0) - 0.25) ** 2 + 3.0 * 8.0
    assert energy(p, state) == pytest.approx(moving + stored, rel=1e-14)
    raised = state.copy()
    raised[[2, 5, 8]] += 7.0  # the gantry bears the load: moving the whole costs nothing
    assert energy(p, raised) == pytest.approx(moving + stored, rel=1e-14)


@pytest.mark.parametrize("size", [12, 18])
@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3), (0,)])
def test_energy_of_a_stack_is_that_of_each(size: int, shape: tuple[int, ...]) -> None:
    states = np.random.default_rng(3).normal(size=(*shape, size))
    energies = energy(UNEVEN, states)
    assert np.shape(energies) == shape
    for index in np.ndindex(shape):
        numbers = states[index]
        whole = numbers if size == 18 else np.r_[np.zeros(3), numbers[:6], np.zeros(3), numbers[6:]]
        assert energies[index] == pytest.approx(energy(UNEVEN, whole.tolist()), rel=1e-14)
    if shape == ():
        assert isinstance(energies, float)


@pytest.mark.parametrize("shape", [(), (0,), (6,), (13,), (18, 1), (12, 3)])
def test_energy_of_a_wrong_shape_says_so(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError) as caught:
        energy(None, np.zeros(shape))
    assert str(shape) in str(caught.value)
    assert "12 or 18" in str(caught.value)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (np.full(12, np.nan), "state = .*nan.*must be finite"),
        (np.r_[np.inf, np.zeros(17)], "state = .*inf.*must be finite"),
        (np.full(12, 1e200), "state = .*1.e.200.*so must its energy"),
        (np.zeros(12) + 1j, "state = .*must be real numbers"),
        ("here", "state = 'here': must be real numbers"),
        (["1"] * 12, "state = .*must be real numbers"),
        ([[0.0] * 12, [0.0] * 11], "state = .*must be real numbers"),
    ],
)
def test_energy_of_what_is_no_state_says_so(state: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"(?s){message}"):
        energy(None, state)


def test_energy_with_a_wrong_parameter_says_so() -> None:
    with pytest.raises(ValueError, match="k1 = -5"):
        energy({"k1": -5.0}, np.zeros(12))
