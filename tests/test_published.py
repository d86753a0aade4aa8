"""Motions of one spring and one mass that others have published: a number from a course, and the resonant spring.

One spring, one mass is k2 = 0; the second mass then falls freely, and is so light here that its energy doesn't count.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from mpmath import ellipk, ellippi
from numpy.typing import NDArray
from reference_data import passive
from scipy.signal import find_peaks

from spring_pendulum_env import Parameters

FloatArray = NDArray[np.float64]

ALONE = Parameters(m1=1.0, m2=1e-9, k2=0.0)


def start_of(position: tuple[float, float, float], velocity: tuple[float, float, float]) -> FloatArray:
    """A state with the first mass there, and the second one far from it at rest."""
    return np.array([*position, 5.0, 0.0, 0.0, *velocity, 0.0, 0.0, 0.0])


# The course PHYD57, "Advanced Computing in Physics", of the University of Toronto Scarborough: l0 = 0.1 m,
# k/m = 33 / s2, g = 9.81 m/s2, from r = (-0.1, 0.2, 0.1) m with v = (0, 0, -0.1) m/s, for 1,000 s.
PUBLISHED = np.array([-0.0497, 0.0995, 0.0747])
HANDOUT = ALONE.replace({"k1": 33.0, "L1": 0.1, "g": 9.81})


def after_a_thousand_seconds(up: float, tolerance: float | None) -> tuple[FloatArray, float]:
    """Where the mass is, with its height counted along `up`, and the energy error."""
    env = passive(start_of((-0.1, 0.2, 0.1 * up), (0.0, 0.0, -0.1 * up)), HANDOUT, 1.0, tolerance)
    for _ in range(1000):
        state, _, _, _, info = env.step(None)
    return state[:3] * [1.0, 1.0, up], info["energy_error"]


@pytest.mark.parametrize("tolerance", [None, 1e-13], ids=["splitting", "adaptive"])
def test_course_number(tolerance: float | None) -> None:
    """The published z is upwards, like ours: the mass starts above the anchor, and moves downwards."""
    position, energy_error = after_a_thousand_seconds(1.0, tolerance)
    assert energy_error < 1e-9
    assert np.abs(position - PUBLISHED).max() < 3e-3
    assert position[1] / position[0] == pytest.approx(-2.0, abs=1e-9)  # it never leaves its vertical plane


def test_course_number_tells_up_from_down() -> None:
    position, _ = after_a_thousand_seconds(-1.0, None)
    assert np.abs(position - PUBLISHED).max() > 0.1


# The resonant swinging spring: D. D. Holm and P. Lynch, "Stepwise precession of the resonant swinging spring", SIAM J.
# Appl. Dyn. Syst. 1 (2002) 44-64, and P. Lynch and C. Houghton, "Pulsation and precession of the resonant swinging
# spring", Physica D 190 (2004) 38-62. Their pendulum: m = 1 kg, length at rest under load l = 1 m, g = pi^2 m/s2,
# k = 4 pi^2 N/m, so that it swings with pi rad/s and bounces with 2 pi rad/s. The figures it is compared with are not
# theirs but derived here.

SWING = math.pi
LENGTH = 1.0
RESONANT = ALONE.replace({"k1": (2 * SWING) ** 2, "L1": 0.75 * LENGTH, "g": SWING**2 * LENGTH})
COUPLING = (2 * SWING) ** 2 * 0.75 / LENGTH  # of the cubic term (x^2 + y^2) z / 2 in the Lagrangian, per kg
PERIOD = 0.05  # s between two samples


@dataclasses.dataclass(frozen=True)
class Pulsation:
    """Energy goes from bouncing to swinging and back; each swing is in another direction."""

    period: float
    """s."""
    precession: float
    """Azimuth of one swing's major axis from the one before, rad."""


def amplitudes(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Complex amplitudes, m, of the circular swings to either side and, twice, of the bounce; they still turn with
    pi and 2 pi rad/s. `state`: shape (12,) or (n, 12)."""
    s = np.moveaxis(state, -1, 0)
    a, b = s[0] - 1j * s[6] / SWING, s[1] - 1j * s[7] / SWING
    c = s[2] + LENGTH - 1j * s[8] / (2 * SWING)
    return a + 1j * b, a - 1j * b, 2 * c


def three_wave(start: FloatArray) -> Pulsation:
    """From the averaged equations, in elliptic integrals.

    To cubic order the Lagrangian per kg is that of three oscillators plus COUPLING (x^2 + y^2) z / 2. With the
    amplitudes A, B and C of `amplitudes`, turned back to rest, averaging over a swing leaves the three-wave equations

        i A' = K B* C / 2,   i B' = K A* C / 2,   i C' = K A B / 2,   K = COUPLING / (4 SWING).

    They keep M = |A|^2 + |C|^2, N = |B|^2 + |C|^2 and H = Re(A* B* C). So u = |C|^2 obeys
    u'^2 = K^2 (u (M - u) (N - u) - H^2), and goes to and fro between the two smaller roots u1 < u2 < u3 of the cubic.
    The azimuth of the ellipse's major axis is (arg A - arg B) / 2, whose rate is -K H (1/|A|^2 - 1/|B|^2) / 4. With
    u = u1 + (u2 - u1) sin^2 both integrals over a period become complete elliptic ones.
    """
    A, B, C = amplitudes(start)
    K = COUPLING / (4 * SWING)
    M, N = abs(A) ** 2 + abs(C) ** 2, abs(B) ** 2 + abs(C) ** 2
    H = float((np.conj(A * B) * C).real)
    u1, u2, u3 = np.sort(np.roots([1.0, -(M + N), M * N, -(H**2)]).real)
    m, width = (u2 - u1) / (u3 - u1), math.sqrt(u3 - u1)

    def swept(total: float) -> float:
        return float(ellippi((u2 - u1) / (total - u1), m)) / (total - u1)

    return Pulsation(4 * float(ellipk(m)) / (K * width), float(-H / width * (swept(M) - swept(N))))


def averaged(values: FloatArray) -> FloatArray:
    """Over a period of the swing, 2 s."""
    window = round(2 * math.pi / SWING / PERIOD)
    return np.convolve(values, np.full(window, 1 / window), "valid")


def simulated(start: FloatArray, expected: Pulsation) -> tuple[Pulsation, float]:
    """From one largest swing to the next, and what share of the turn is made in the middle half of the time between."""
    env = passive(start, RESONANT, PERIOD)
    states = np.array([start, *(env.step(None)[0] for _ in range(round(2.7 * expected.period / PERIOD)))])
    A, B, _ = amplitudes(states)
    azimuth = averaged(np.unwrap(np.angle(A) - np.angle(B)) / 2)
    swing = averaged(abs(A) ** 2 + abs(B) ** 2)
    instants = PERIOD * np.arange(len(swing))
    near = round(expected.period / 16 / PERIOD)
    largest = []
    for peak in find_peaks(swing, distance=8 * near)[0]:
        if near <= peak < len(swing) - near:
            around = slice(peak - near, peak + near + 1)
            bend, slope, _ = np.polyfit(instants[around] - instants[peak], swing[around], 2)
            largest.append(instants[peak] - slope / (2 * bend))
    one, other = largest[:2]
    quarter = (other - one) / 4
    turned = np.interp([one, one + quarter, other - quarter, other], instants, azimuth)
    whole = float(turned[3] - turned[0])
    return Pulsation(float(other - one), whole), float(turned[2] - turned[1]) / whole


STARTS = {  # horizontal displacement 1, then speed across it and vertical displacement in the same unit
    "wide ellipse": (0.857, 2.0),
    "narrow ellipse": (0.4, 2.5),
    "mostly swinging": (1.2, 0.7),
}


@pytest.mark.parametrize(("speed", "height"), STARTS.values(), ids=STARTS)
def test_stepwise_precession(speed: float, height: float) -> None:
    """Period and precession are those of the three-wave equations, to the first order in the amplitude."""
    sizes = np.array([0.04, 0.02, 0.01])
    errors = []
    for size in sizes:
        start = start_of((size, 0.0, -LENGTH + height * size), (0.0, speed * size, 0.0))
        expected = three_wave(start)
        found, share = simulated(start, expected)
        assert share > 0.75  # steps: an even turn would make half of it in half of the time
        errors.append([found.period / expected.period - 1, found.precession / expected.precession - 1])
    assert np.abs(errors[-1]).max() < 0.02
    orders = np.polyfit(np.log(sizes), np.log(np.abs(errors)), 1)[0]
    np.testing.assert_allclose(orders, 1.0, atol=0.15)
