"""Poincare sections against accurate runs and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from reference_data import CASES, VIOLENT

from spring_pendulum_env import simulate
from spring_pendulum_env.dynamics import COORDINATES, Crossings, NotCrossedError, Section, poincare_section

REGULAR = CASES["regular_a"]
OBLIQUE = Section((1.0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0.1, 0), 0.02, 0)


def heights(crossings: Crossings, section: Section) -> Any:
    return crossings.states @ np.array(section.coefficients) - section.value


@pytest.mark.parametrize("section", [Section.at("X1"), Section.at("VZ2", 0.01, -1), OBLIQUE], ids=str)
def test_crossings_lie_in_the_plane_on_the_motion(section: Section) -> None:
    found = poincare_section(REGULAR["params"], REGULAR["initial_state"], section, 20.0, longest_step=0.005)
    assert len(found.times) > 5
    assert np.abs(heights(found, section)).max() < 1e-15
    run = simulate(REGULAR["params"], REGULAR["initial_state"], np.r_[0.0, found.times])
    assert np.abs(run.states[1:] - found.states).max() < 1e-9  # between its steps DOP853 interpolates


@pytest.mark.parametrize("name", ["X1", "Y2", "VX1", "Z2"])
def test_no_crossing_is_missed(name: str) -> None:
    """Their number, and their times, from a run that is looked at 50 times more often."""
    start = REGULAR["initial_state"]
    column = COORDINATES.index(name)
    times = np.arange(0.0, 20.0, 4e-4)
    states = simulate(REGULAR["params"], start, times).states
    level = float(states[:, column].mean())
    signs = np.sign(states[:, column] - level)
    changes = np.flatnonzero(signs[:-1] != signs[1:])
    found = poincare_section(REGULAR["params"], start, Section.at(name, level, 0), times[-1])
    assert len(found.times) == len(changes)
    assert (np.abs(found.times - times[changes]) < 4.1e-4).all()
    np.testing.assert_array_equal(found.directions, signs[changes + 1])
    rising = poincare_section(REGULAR["params"], start, Section.at(name, level, 1), times[-1])
    np.testing.assert_array_equal(rising.times, found.times[found.directions == 1])


def test_pair_of_crossings_within_a_step() -> None:
    """A body that is thrown up and is above a height for less than a step."""
    parameters = {"k1": 0.0, "k2": 0.0, "g": 10.0}
    start = np.zeros(12)
    start[[3, 8]] = 1.0, 10.0  # highest, 5 m, after a second
    section = Section.at("Z1", 5.0 - 5e-5, 0)
    found = poincare_section(parameters, start, section, 2.0, longest_step=0.018)
    half = np.sqrt(2 * 5e-5 / 10.0)
    np.testing.assert_allclose(found.times, [1 - half, 1 + half], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(found.directions, [1, -1])


def test_start_in_the_plane_is_no_crossing() -> None:
    parameters = {"k1": 100.0, "k2": 0.0, "L1": 0.0, "g": 0.0, "m1": 1.0}  # harmonic, 10 rad/s
    start = np.zeros(12)
    start[6] = 1.0
    found = poincare_section(parameters, start, Section.at("X1", 0.0, 0), 1.0)
    np.testing.assert_allclose(found.times, np.pi / 10 * np.arange(1, 4), rtol=0, atol=1e-9)


def test_transient_is_left_out() -> None:
    whole = poincare_section(None, VIOLENT, Section.at("X1"), 20.0)
    later = poincare_section(None, VIOLENT, Section.at("X1"), 10.0, transient=10.0)
    expected = whole.times[whole.times > 10.0] - 10.0
    np.testing.assert_allclose(later.times, expected, rtol=0, atol=1e-5)


def test_plane_that_is_never_crossed() -> None:
    with pytest.raises(NotCrossedError, match=r"X1 = 5 isn't crossed .* between -.* and "):
        poincare_section(None, VIOLENT, Section.at("X1", 5.0), 20.0)
    with pytest.raises(NotCrossedError, match="falling"):
        poincare_section({"k1": 0.0, "k2": 0.0, "g": 0.0}, START_MOVING, Section.at("X1", 1.0, -1), 5.0)


START_MOVING = np.r_[0, 0, 0, 1, 0, 0, 1.0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Section.at("x1"), "coordinate = 'x1'"),
        (lambda: Section((0.0,) * 12), "must not all be 0"),
        (lambda: Section((1.0,) * 6), r"coefficients of shape \(6,\)"),
        (lambda: Section.at("X1", np.nan), "value = nan"),
        (lambda: Section.at("X1", None), "value = None"),  # type: ignore[arg-type]
        (lambda: Section.at("X1", 0.0, 2), "direction = 2"),
        (lambda: Section.at("X1", 0.0, np.array([1, 0])), "direction = array"),  # type: ignore[arg-type]
        (lambda: Section.at("X1", 0.0, "up"), "direction = 'up'"),  # type: ignore[arg-type]
        (lambda: Section.at(["X1"]), "coordinate = "),  # type: ignore[arg-type]
        (lambda: poincare_section(None, VIOLENT + 0j, Section.at("X1")), "(?s)state = .*must be real numbers"),
        (lambda: poincare_section(None, VIOLENT, Section.at("X1"), longest_step=1.0), "longest_step = 1.0 s: .*most"),
        (lambda: poincare_section(None, VIOLENT, "X1"), "section = 'X1'"),  # type: ignore[arg-type]
        (lambda: poincare_section(None, VIOLENT[:6], Section.at("X1")), r"state of shape \(6,\)"),
        (lambda: poincare_section(None, VIOLENT, Section.at("X1"), -1.0), "duration = -1.0"),
        (lambda: poincare_section(None, VIOLENT, Section.at("X1"), transient=np.inf), "transient = inf"),
        (lambda: poincare_section(None, VIOLENT, Section.at("X1"), longest_step=0), "longest_step = 0"),
    ],
)
def test_wrong_arguments(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
