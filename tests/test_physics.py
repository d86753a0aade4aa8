"""The equations of physics.py against the paper and its Lagrangian, and on every kind of number they must run on."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import casadi
import numba
import numpy as np
import pytest
import sympy
import torch
from numpy.typing import NDArray

import spring_pendulum_env.jit  # noqa: F401  (marks the functions of physics.py for numba)
from spring_pendulum_env import Parameters, energy, linearise, physics, simulate

FloatArray = NDArray[np.float64]

UNEVEN = Parameters(m0=1.7, m1=0.9, m2=2.3, k1=120.0, k2=70.0, L1=0.8, L2=1.1, R0=0.4, R1=0.3, R2=0.2, g=9.7)
HELD = UNEVEN.constants("") + UNEVEN.drag_rates()
FREE = UNEVEN.constants("xyz") + UNEVEN.drag_rates()
RANDOM = np.random.default_rng(20).normal(size=(40, 21)) * ([1.0] * 9 + [3.0] * 9 + [10.0] * 3)
"""States and forces on the anchor, one in each row."""


# The Lagrangian, in symbols.

M0, M1, M2 = MASSES = sympy.symbols("m0 m1 m2", positive=True)
K1, K2, L1, L2, R0, R1, R2, G = CONSTANTS = sympy.symbols("k1 k2 L1 L2 R0 R1 R2 g", positive=True)
Q = sympy.symbols("X0 Y0 Z0 X1 Y1 Z1 X2 Y2 Z2", real=True)
V = sympy.symbols("VX0 VY0 VZ0 VX1 VY1 VZ1 VX2 VY2 VZ2", real=True)
U = sympy.symbols("UX UY UZ", real=True)
MASS_OF = [M0] * 3 + [M1] * 3 + [M2] * 3
DRAG_OF = [R0] * 3 + [R1] * 3 + [R2] * 3


def squared(vector: Sequence[Any]) -> Any:
    return sum(component**2 for component in vector)


def kinetic_33() -> Any:
    """Equation (33), written out."""
    return M1 * squared(V[3:6]) / 2 + M2 * squared(V[6:9]) / 2


def potential_34() -> Any:
    """Equation (34), written out."""
    _, _, _, x1, y1, z1, x2, y2, z2 = Q
    return (
        K1 * (sympy.sqrt(x1**2 + y1**2 + z1**2) - L1) ** 2 / 2
        + K2 * (sympy.sqrt((x1 - x2) ** 2 + (y1 - y2) ** 2 + (z1 - z2) ** 2) - L2) ** 2 / 2
        + M1 * G * z1
        + M2 * G * z2
    )


def moving_anchor() -> dict[Any, Any]:
    """Replaces the masses' positions by those relative to the anchor."""
    return {Q[i]: Q[i] - Q[i % 3] for i in range(3, 9)}


def euler_lagrange(T: Any, potential: Any, number: int, force: Any) -> Any:
    """The acceleration of one coordinate from d/dt(dL/dq') - dL/dq = force, equation (31)."""
    lagrangian = T - potential
    A = sympy.Symbol("A")
    momentum = sympy.diff(lagrangian, V[number])
    rate = sympy.diff(momentum, V[number]) * A
    rate += sum(sympy.diff(momentum, q) * v for q, v in zip(Q, V, strict=True))
    (solution,) = sympy.solve(rate - sympy.diff(lagrangian, Q[number]) - force, A)
    return solution


def symbolic_slope(axes: str) -> list[Any]:
    """`physics.derivatives` on symbols, the anchor moving along `axes`."""
    inverse = [1 / M0 if axis in axes else sympy.Integer(0) for axis in "xyz"]
    load = physics.static_load(M1, M2, G)
    slope = physics.derivatives(
        *Q, *V, *U, *inverse, 1 / M1, 1 / M2, K1, K2, L1, L2, G, load, R0 / M0, R1 / M1, R2 / M2
    )
    return [sympy.nsimplify(component, rational=True) for component in slope]


@pytest.mark.parametrize("number", range(3, 9), ids=[str(q) for q in Q[3:]])
def test_pinned_equations_are_those_of_the_lagrangian(number: int) -> None:
    """The paper's system: energies (33) and (34), anchor at the origin, drag as a generalised force."""
    at_origin = dict.fromkeys((*Q[:3], *V[:3], *U), 0)
    expected = euler_lagrange(kinetic_33(), potential_34(), number, -DRAG_OF[number] * V[number])
    got = symbolic_slope("")[9 + number].subs(at_origin)
    assert sympy.simplify(got - expected) == 0


@pytest.mark.parametrize("number", range(9), ids=[str(q) for q in Q])
def test_free_equations_are_those_of_the_lagrangian(number: int) -> None:
    """The moving anchor: its kinetic energy, heights from the anchor, the force u and drag as generalised forces."""
    T = kinetic_33() + M0 * squared(V[:3]) / 2
    potential = potential_34().subs(moving_anchor(), simultaneous=True)
    push = U[number] if number < 3 else 0
    expected = euler_lagrange(T, potential, number, push - DRAG_OF[number] * V[number])
    assert sympy.simplify(symbolic_slope("xyz")[9 + number] - expected) == 0


@pytest.mark.parametrize("axes", ["", "x", "xz", "yz"])
def test_held_axis_stands_still_and_the_rest_does_not_notice(axes: str) -> None:
    some, every = symbolic_slope(axes), symbolic_slope("xyz")
    for number in range(9):
        held = number < 3 and "xyz"[number] not in axes
        assert some[number] == V[number]
        if held:
            assert some[9 + number] == -R0 / M0 * V[number]  # which is zero, since a held axis starts with none
        else:
            assert some[9 + number] == every[9 + number]


def test_energies_are_33_and_34() -> None:
    at_origin = dict.fromkeys((*Q[:3], *V[:3]), 0)
    T = sympy.nsimplify(physics.kinetic_energy(*V, *MASSES), rational=True)
    potential = sympy.nsimplify(physics.potential_energy(*Q, M1, M2, K1, K2, L1, L2, G), rational=True)
    assert sympy.simplify(T.subs(at_origin) - kinetic_33()) == 0
    assert sympy.simplify(potential.subs(at_origin) - potential_34()) == 0
    # With an anchor that moves: its own kinetic energy, and heights from it.
    assert sympy.simplify(T - kinetic_33() - M0 * squared(V[:3]) / 2) == 0
    assert sympy.simplify(potential - potential_34().subs(moving_anchor(), simultaneous=True)) == 0
    total = physics.total_energy(*Q, *V, *MASSES, K1, K2, L1, L2, G)
    assert sympy.simplify(sympy.nsimplify(total, rational=True) - T - potential) == 0


def test_energy_changes_by_the_work_of_the_force_less_drag() -> None:
    """dE/dt = u . q0' - sum of R |q'|^2, along the equations of motion."""
    total = sympy.nsimplify(physics.total_energy(*Q, *V, *MASSES, K1, K2, L1, L2, G), rational=True)
    rate = sum(
        sympy.diff(total, variable) * slope for variable, slope in zip((*Q, *V), symbolic_slope("xyz"), strict=True)
    )
    work = sum(u * v for u, v in zip(U, V[:3], strict=True))
    drag = physics.weighted_squares(*V, R0, R1, R2)
    assert sympy.expand(rate - work + drag) == 0


# The paper's equations, as printed.


def equations_25_to_30(state: Sequence[Any], p: Parameters, root: Callable[[Any], Any] = math.sqrt) -> list[Any]:
    """The paper's six accelerations with its own letters, term by term as it prints them."""
    X1, Y1, Z1, X2, Y2, Z2, dX1, dY1, dZ1, dX2, dY2, dZ2 = state
    r1 = root(X1**2 + Y1**2 + Z1**2)
    r2 = root((X1 - X2) ** 2 + (Y1 - Y2) ** 2 + (Z1 - Z2) ** 2)
    r3 = root((X2 - X1) ** 2 + (Y2 - Y1) ** 2 + (Z2 - Z1) ** 2)
    a, b, c = p.k1 / p.m1, p.k2 / p.m1, p.k2 / p.m2
    return [
        a * X1 * (p.L1 / r1 - 1) + b * (X1 - X2) * (p.L2 / r2 - 1) - p.R1 / p.m1 * dX1,
        a * Y1 * (p.L1 / r1 - 1) + b * (Y1 - Y2) * (p.L2 / r2 - 1) - p.R1 / p.m1 * dY1,
        a * Z1 * (p.L1 / r1 - 1) + b * (Z1 - Z2) * (p.L2 / r2 - 1) - p.R1 / p.m1 * dZ1 - p.g,
        c * (X2 - X1) * (p.L2 / r3 - 1) - p.R2 / p.m2 * dX2,
        c * (Y2 - Y1) * (p.L2 / r3 - 1) - p.R2 / p.m2 * dY2,
        c * (Z2 - Z1) * (p.L2 / r3 - 1) - p.R2 / p.m2 * dZ2 - p.g,
    ]


@pytest.mark.parametrize("equation", range(25, 31))
def test_equation_as_printed(equation: int) -> None:
    for row in RANDOM:
        row = row.tolist()
        got = physics.derivatives(0.0, 0.0, 0.0, *row[3:9], 0.0, 0.0, 0.0, *row[12:18], *row[18:], *HELD)
        expected = equations_25_to_30([*row[3:9], *row[12:18]], UNEVEN)
        assert got[12 + equation - 25] == pytest.approx(expected[equation - 25], rel=1e-12, abs=1e-11)


def test_spring_forces_as_printed() -> None:
    """Equations (14) with its misprint mended, (16) and (18): force on m1, force on m1, force on m2."""
    for row in RANDOM[:, 3:9]:
        q1, q2 = row[:3], row[3:]
        r1, r2 = np.linalg.norm(q1), np.linalg.norm(q1 - q2)
        np.testing.assert_allclose(
            physics.spring_force(*q1, UNEVEN.k1, UNEVEN.L1), UNEVEN.k1 * (UNEVEN.L1 / r1 - 1) * q1, rtol=1e-12
        )
        on_m2 = np.array(physics.spring_force(*(q2 - q1), UNEVEN.k2, UNEVEN.L2))
        np.testing.assert_allclose(on_m2, UNEVEN.k2 * (UNEVEN.L2 / r2 - 1) * (q2 - q1), rtol=1e-12)
        np.testing.assert_allclose(-on_m2, UNEVEN.k2 * (UNEVEN.L2 / r2 - 1) * (q1 - q2), rtol=1e-12)


@pytest.mark.parametrize(
    ("T_F", "V_F", "T_I", "V_I"), [(3.0, 1.0, 2.0, 3.0), (0.5, -9.0, 0.25, -8.5), (2.0, 7.5, 4.0, 5.0)]
)
def test_equation_42_as_printed(T_F: float, V_F: float, T_I: float, V_I: float) -> None:
    expected = abs(((T_F + V_F) - (T_I + V_I)) / (T_I + V_I))
    assert physics.energy_error((T_F + V_F) - (T_I + V_I), T_I + V_I) == pytest.approx(expected, rel=1e-15)


def test_equation_42_is_absolute_where_the_energy_starts_at_zero() -> None:
    assert physics.energy_error(-0.25, 0.0) == 0.25
    np.testing.assert_array_equal(physics.energy_error(np.array([0.5, -3.0]), np.array([-2.0, 0.0])), [0.25, 3.0])


def test_model_without_spring_1_is_two_masses_of_their_own() -> None:
    """k1 = 0: nothing depends on the anchor, and the two masses pull on each other alone."""
    slope = [component.subs(K1, 0) for component in symbolic_slope("xyz")]
    for number in range(3, 9):
        assert not slope[9 + number].free_symbols & {*Q[:3], *V[:3], M0, L1}
    for axis in range(3):
        weight = (M1 + M2) * G if axis == 2 else 0
        drag = R1 * V[3 + axis] + R2 * V[6 + axis]
        assert sympy.simplify(M1 * slope[12 + axis] + M2 * slope[15 + axis] + weight + drag) == 0


def test_model_without_spring_2_is_one_mass_and_one_that_falls() -> None:
    """k2 = 0: the first mass knows nothing of the second, which falls."""
    slope = [component.subs(K2, 0) for component in symbolic_slope("")]
    for axis in range(3):
        assert not slope[12 + axis].free_symbols & {*Q[6:], *V[6:], M2, L2}
        assert sympy.simplify(slope[15 + axis] + (G if axis == 2 else 0) + R2 / M2 * V[6 + axis]) == 0
    assert slope[12].has(L1)


def test_model_with_both_springs_couples_all() -> None:
    for component in symbolic_slope("xyz")[12:15]:
        assert component.free_symbols >= {*Q, K1, K2, L1, L2}


# Every kind of number.


def complex_step_jacobian(state: FloatArray, constants: tuple[float, ...]) -> FloatArray:
    columns = []
    for column in range(21):
        stepped = state.astype(complex)
        stepped[column] += 1e-30j
        columns.append(np.imag(physics.derivatives(*stepped, *constants)) / 1e-30)
    return np.array(columns).T


def autograd_jacobian(state: FloatArray, constants: tuple[float, ...]) -> FloatArray:
    def slope(x: torch.Tensor) -> torch.Tensor:
        return torch.stack(physics.derivatives(*x, *constants))

    return torch.autograd.functional.jacobian(slope, torch.tensor(state, dtype=torch.float64)).numpy()


def casadi_jacobian(state: FloatArray, constants: tuple[float, ...], symbol: Any = casadi.SX) -> FloatArray:
    x = symbol.sym("x", 21)
    slope = casadi.vertcat(*physics.derivatives(*casadi.vertsplit(x), *constants))
    return np.array(casadi.Function("jacobian", [x], [casadi.jacobian(slope, x)])(state))


@pytest.mark.parametrize("constants", [HELD, FREE], ids=["held", "free"])
@pytest.mark.parametrize("row", range(3))
def test_jacobians_agree(row: int, constants: tuple[float, ...]) -> None:
    """Automatic, symbolic and complex-step derivatives of the same lines, and finite differences as a witness."""
    state = RANDOM[row]
    exact = complex_step_jacobian(state, constants)
    scale = np.abs(exact).max()
    assert np.abs(autograd_jacobian(state, constants) - exact).max() < 1e-14 * scale
    assert np.abs(casadi_jacobian(state, constants) - exact).max() < 1e-14 * scale
    assert np.abs(casadi_jacobian(state, constants, casadi.MX) - exact).max() < 1e-14 * scale
    h = 1e-6
    for column in range(21):
        forth, back = state.copy(), state.copy()
        forth[column] += h
        back[column] -= h
        difference = (np.array(physics.derivatives(*forth, *constants)) - physics.derivatives(*back, *constants)) / (
            2 * h
        )
        np.testing.assert_allclose(exact[:, column], difference, atol=1e-6 * scale)


@pytest.mark.parametrize("constants", [HELD, FREE], ids=["held", "free"])
def test_every_kind_of_number_gives_the_same_values(constants: tuple[float, ...]) -> None:
    stack = np.array(physics.derivatives(*RANDOM.T, *constants))
    tensors = torch.stack(physics.derivatives(*torch.tensor(RANDOM.T), *constants)).numpy()
    np.testing.assert_allclose(tensors, stack, rtol=1e-14, atol=1e-12)
    for row, expected in zip(RANDOM, stack.T, strict=True):
        values = {
            "float": physics.derivatives(*row.tolist(), *constants),
            "numpy scalar": physics.derivatives(*row, *constants),
            "complex": physics.derivatives(*row.astype(complex), *constants),
        }
        for symbol in (casadi.SX, casadi.MX):
            x = symbol.sym("x", 21)
            slope = casadi.vertcat(*physics.derivatives(*casadi.vertsplit(x), *constants))
            values[symbol.__name__] = np.array(casadi.Function("slope", [x], [slope])(row))[:, 0]
        for kind, value in values.items():
            np.testing.assert_allclose(np.real(value), expected, rtol=1e-14, atol=1e-12, err_msg=kind)
            assert np.abs(np.imag(value)).max() == 0.0
    x = sympy.symbols("x0:21", real=True)
    exact = [component.subs(dict(zip(x, RANDOM[0], strict=True))) for component in physics.derivatives(*x, *constants)]
    np.testing.assert_allclose(np.array(exact, dtype=float), stack[:, 0], rtol=1e-14, atol=1e-12)


def test_an_array_gives_the_bits_of_its_elements() -> None:
    """Elementwise arithmetic and a correctly rounded root: neighbours don't matter."""
    stack = np.array(physics.derivatives(*RANDOM.T, *FREE))
    for j in range(len(RANDOM)):
        alone = np.array(physics.derivatives(*RANDOM.T[:, j : j + 1], *FREE))
        np.testing.assert_array_equal(stack[:, j], alone[:, 0])


@numba.njit(error_model="numpy")
def compiled(rows, constants, slopes, energies, m0, m1, m2):  # type: ignore[no-untyped-def]
    for j in range(rows.shape[0]):
        r, c = rows[j], constants
        slope = physics.derivatives(
            r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16],
            r[17], r[18], r[19], r[20], c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12],
            c[13],
        )  # fmt: skip
        for i in range(18):
            slopes[j, i] = slope[i]
        energies[j] = physics.total_energy(
            r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16],
            r[17], m0, m1, m2, c[5], c[6], c[7], c[8], c[9],
        )  # fmt: skip


def test_compiled_gives_the_bits_of_the_source() -> None:
    """Numba does the arithmetic that is written. (Python's own float ** 0.5 may round the root the other way.)"""
    rows = np.random.default_rng(21).normal(size=(5000, 21))
    slopes, energies = np.empty((len(rows), 18)), np.empty(len(rows))
    compiled(rows, np.array(FREE), slopes, energies, UNEVEN.m0, UNEVEN.m1, UNEVEN.m2)
    np.testing.assert_array_equal(slopes, np.array(physics.derivatives(*rows.T, *FREE)).T)
    np.testing.assert_array_equal(energies, energy(UNEVEN, rows[:, :18]))


# A spring of zero length.


@pytest.mark.parametrize("kind", ["float", "array", "complex", "torch", "casadi"])
def test_spring_of_zero_length_pulls_in_no_direction(kind: str) -> None:
    zero: Any = {
        "float": 0.0,
        "array": np.zeros(2),
        "complex": 0j,
        "torch": torch.zeros(2, dtype=torch.float64),
        "casadi": casadi.DM(0.0),
    }[kind]
    for component in physics.spring_force(zero, zero, zero, 100.0, 1.0):
        assert np.all(np.array(component) == 0.0)


def test_spring_of_almost_zero_length_pushes_with_all_its_force() -> None:
    """The exception is for exactly zero alone."""
    np.testing.assert_allclose(physics.spring_force(1e-150, 0.0, 0.0, 100.0, 2.0), [200.0, 0.0, 0.0])


def test_masses_in_one_point_stay_finite() -> None:
    accelerations = physics.accelerations(*[0.0] * 12, *UNEVEN.constants())
    g = UNEVEN.g
    load = physics.static_load(UNEVEN.m1, UNEVEN.m2, g)
    np.testing.assert_allclose(accelerations, [0.0, 0.0, load / UNEVEN.m0, 0.0, 0.0, -g, 0.0, 0.0, -g])


# Momentum.


def test_momentum_is_the_sum_of_mass_times_velocity() -> None:
    masses = np.array([1.7, 0.9, 2.3])
    for row in RANDOM:
        velocities = row[9:18].reshape(3, 3)
        np.testing.assert_allclose(physics.momentum(*row[9:18], *masses), masses @ velocities, rtol=1e-12, atol=1e-12)


def test_angular_momentum_is_the_sum_of_mass_times_cross_product() -> None:
    masses = np.array([1.7, 0.9, 2.3])
    for row in RANDOM:
        positions, velocities = row[:9].reshape(3, 3), row[9:18].reshape(3, 3)
        expected = masses @ np.cross(positions, velocities)
        np.testing.assert_allclose(physics.angular_momentum(*row[:18], *masses), expected, rtol=1e-12, atol=1e-11)


# Frequencies.


@pytest.mark.parametrize("pinned", [True, False])
@pytest.mark.parametrize("p", [Parameters(), UNEVEN, Parameters(m1=0.01, m2=10.0, k1=1e3, k2=1e3)])
def test_fastest_frequency_is_that_of_the_linearised_system(p: Parameters, pinned: bool) -> None:
    undamped = p.replace({"R0": 0.0, "R1": 0.0, "R2": 0.0})
    matrix = (
        linearise(undamped, "hanging-hanging", pinned=True) if pinned else linearise(undamped, "hanging-hanging")[0]
    )
    eigenvalues = np.linalg.eigvals(matrix)
    w0 = 0.0 if pinned else 1.0 / p.m0
    fastest = physics.fastest_frequency(w0, 1.0 / p.m1, 1.0 / p.m2, p.k1, p.k2)
    assert fastest == pytest.approx(np.abs(eigenvalues.imag).max(), rel=1e-9)


def test_fastest_frequency_of_the_defaults_is_ten_golden_ratios() -> None:
    assert physics.fastest_frequency(0.0, 1.0, 1.0, 100.0, 100.0) == pytest.approx(5 * (1 + math.sqrt(5)), rel=1e-15)


# Parameters.

NAMES = ("m0", "m1", "m2", "k1", "k2", "L1", "L2", "R0", "R1", "R2", "g")
DEFAULTS = dict(zip(NAMES, (1.0, 1.0, 1.0, 100.0, 100.0, 1.0, 1.0, 0.0, 0.0, 0.0, 9.81), strict=True))
NEVER_ALLOWED = (-1.0, -1e-300, math.nan, math.inf, -math.inf, "1.0", True, None, [1.0], 1j, 10**400)


def test_defaults() -> None:
    assert Parameters.names() == NAMES
    assert Parameters().as_dict() == DEFAULTS
    assert Parameters.of(None) == Parameters.of({}) == Parameters()


@pytest.mark.parametrize("value", NEVER_ALLOWED, ids=lambda value: repr(value)[:12])
@pytest.mark.parametrize("name", NAMES)
def test_wrong_value_is_named(name: str, value: Any) -> None:
    allowed = "a finite number > 0" if name[0] == "m" else "a finite number >= 0"
    for attempt in (lambda: Parameters(**{name: value}), lambda: Parameters.of({name: value})):
        with pytest.raises(ValueError) as caught:
            attempt()
        message = str(caught.value)
        assert name in message.replace("=", " ").split()
        assert repr(value) in message
        assert message.endswith(allowed)


@pytest.mark.parametrize("name", NAMES)
def test_zero_is_allowed_but_for_a_mass(name: str) -> None:
    if name[0] == "m":
        with pytest.raises(ValueError, match=rf"{name} = 0.0: must be a finite number > 0"):
            Parameters(**{name: 0.0})
    else:
        assert getattr(Parameters(**{name: 0.0}), name) == 0.0


@pytest.mark.parametrize("value", [2, np.float64(2), np.int64(2), np.float32(2), Fraction(2)])
def test_any_real_number_becomes_a_float(value: Any) -> None:
    p = Parameters(m1=value)
    assert type(p.m1) is float
    assert p.m1 == 2.0


@pytest.mark.parametrize("unknown", ["m3", "K1", "", "mass", 3])
def test_unknown_name_is_named_and_the_known_ones_listed(unknown: Any) -> None:
    with pytest.raises(ValueError) as caught:
        Parameters.of({"m1": 2.0, unknown: 1.0})
    assert repr(unknown) in str(caught.value)
    for name in NAMES:
        assert name in str(caught.value)


@pytest.mark.parametrize("value", [3.0, "m1", [("m1", 2.0)], ("m1",)])
def test_what_is_no_mapping_is_refused(value: Any) -> None:
    with pytest.raises(ValueError) as caught:
        Parameters.of(value)
    assert repr(value) in str(caught.value)
    assert "mapping" in str(caught.value)


def test_parameters_are_immutable() -> None:
    p = Parameters()
    with pytest.raises(dataclasses.FrozenInstanceError):
        p.m1 = 2.0  # type: ignore[misc]
    changes = {"m1": 2.0}
    changed = p.replace(changes)
    changes["m1"] = 3.0
    changed.as_dict()["m2"] = 7.0
    assert (p.m1, changed.m1, changed.m2) == (1.0, 2.0, 1.0)


def test_replace_of_and_as_dict() -> None:
    p = Parameters.of({"m1": 2.0, "g": 0.0})
    assert p.as_dict() == {**DEFAULTS, "m1": 2.0, "g": 0.0}
    assert p.replace({"m1": 3.0}).as_dict() == {**DEFAULTS, "m1": 3.0, "g": 0.0}
    assert p.replace(None) == p
    assert p.replace(UNEVEN) == UNEVEN
    assert Parameters.of(UNEVEN.as_dict()) == Parameters.of(UNEVEN) == UNEVEN
    assert len({p, Parameters.of(p.as_dict())}) == 1


def test_constants_in_their_order() -> None:
    assert UNEVEN.constants("xz") == (
        1 / 1.7, 0.0, 1 / 1.7, 1 / 0.9, 1 / 2.3, 120.0, 70.0, 0.8, 1.1, 9.7, (0.9 + 2.3) * 9.7,
    )  # fmt: skip
    assert UNEVEN.drag_rates() == (0.4 / 1.7, 0.3 / 0.9, 0.2 / 2.3)
    assert simulate(UNEVEN, np.ones(12), [0.0]).parameters is UNEVEN
