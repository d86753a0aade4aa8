"""The figures: what is drawn is what was given, and files are the same each time."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from spring_pendulum_env import Parameters, plots, simulate
from spring_pendulum_env.physics import length
from spring_pendulum_env.plots.trainings import millions

matplotlib = pytest.importorskip("matplotlib")

START = np.array([0.4, 0.1, -0.9, 1.1, 0.3, -1.2, 0.3, -0.5, 0.2, 0.1, 0.4, -0.6])


def motion(name: str = "one", **options: Any) -> plots.Motion:
    run = simulate({"m2": 1.4}, START, np.linspace(0.0, 2.0, 401), **options)
    return plots.Motion(name, run.parameters, run.times, run.states)


def drawn(axes: Any) -> dict[str, Any]:
    """By label, the y of each line."""
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}


def test_energy_and_error_are_those_of_the_run() -> None:
    coarse = simulate({"m2": 1.4}, START, np.linspace(0.0, 2.0, 401), method="RK45", rtol=1e-4, atol=1e-6)
    one = plots.Motion("coarse", coarse.parameters, coarse.times, coarse.states)
    above, below = plots.energy([one, motion("fine")]).axes
    assert np.array_equal(drawn(above)["coarse"], coarse.energy)
    error = next(iter(drawn(below).values()))
    assert error[-1] == pytest.approx(coarse.energy_error, rel=1e-12)
    assert below.get_yscale() == "log"
    for line in (*above.get_lines(), *below.get_lines()):
        assert np.array_equal(line.get_xdata(), coarse.times[-len(line.get_xdata()) :])
    labels = (above.get_ylabel(), below.get_ylabel(), below.get_xlabel())
    assert labels == ("energy (J)", "energy error (42)", "time (s)")  # a share, not per cent


def test_errors_that_are_given_are_drawn() -> None:
    one = motion()
    given = plots.Motion("given", one.parameters, one.times, one.states, np.full(401, 1e-5))
    assert (next(iter(drawn(plots.energy([given]).axes[1]).values())) == 1e-5).all()


def test_spring_lengths() -> None:
    one = motion()
    for axes, first in zip(plots.spring_lengths([one]).axes, (0, 3), strict=True):
        near = one.states[:, :3] if first else np.zeros((401, 3))
        assert np.allclose(drawn(axes)["one"], length(*(one.states[:, first : first + 3] - near).T), rtol=1e-14)
        assert np.array_equal(axes.get_lines()[0].get_xdata(), one.times)
    uneven = plots.Motion("uneven", Parameters(L1=0.7, L2=1.6), one.times, one.states)
    panels = plots.spring_lengths([uneven]).axes
    assert [axes.get_lines()[1].get_ydata()[0] for axes in panels] == [0.7, 1.6]
    assert [axes.get_ylabel() for axes in panels] == ["spring 1 (m)", "spring 2 (m)"]


def test_views_of_the_paths_are_the_named_axes_of_the_named_masses() -> None:
    one = motion()
    figure = plots.paths(one)
    space, *flat = figure.axes
    for number in range(2):
        track = one.states[:, 3 * number : 3 * number + 3]
        for axes in flat:
            across, up = ("xyz".index(label()[0]) for label in (axes.get_xlabel, axes.get_ylabel))
            line, first, final = axes.get_lines()[3 * number : 3 * number + 3]
            assert np.array_equal(line.get_xdata(), track[:, across])
            assert np.array_equal(line.get_ydata(), track[:, up])
            for end, row in ((first, 0), (final, -1)):
                assert (end.get_xdata()[0], end.get_ydata()[0]) == (track[row, across], track[row, up])
            assert first.get_markerfacecolor() == "white" != final.get_markerfacecolor()
            assert line.get_color() == plots.MASSES[number]
        assert np.array_equal(np.array(space.get_lines()[number].get_data_3d()), track.T)
    assert {axes.get_xlabel()[0] + axes.get_ylabel()[0] for axes in flat} == {"xz", "yz", "xy"}
    assert (space.get_xlabel(), space.get_ylabel(), space.get_zlabel()) == ("x (m)", "y (m)", "z (m)")


def test_paths_have_one_scale_and_hold_everything() -> None:
    figure = plots.paths(motion())
    flat = [axes for axes in figure.axes if axes.name != "3d"]
    assert len(flat) == 3 and len(figure.axes) == 4
    spans = [np.ptp(limits) for axes in flat for limits in (axes.get_xlim(), axes.get_ylim())]
    assert np.allclose(spans, spans[0])
    for axes in flat:
        for line in axes.get_lines():
            assert axes.get_xlim()[0] < np.min(line.get_xdata()) and np.max(line.get_xdata()) < axes.get_xlim()[1]
            assert axes.get_ylim()[0] < np.min(line.get_ydata()) and np.max(line.get_ydata()) < axes.get_ylim()[1]


def test_an_anchor_that_moves_is_drawn_too() -> None:
    one = motion()
    states = np.zeros((401, 18))
    states[:, 3:9], states[:, 12:18] = one.states[:, :6], one.states[:, 6:]
    still = plots.paths(plots.Motion("still", one.parameters, one.times, states))
    states[:, 0] = one.times
    moving = plots.paths(plots.Motion("moving", one.parameters, one.times, states))
    names = [[text.get_text() for text in figure.legends[0].get_texts()] for figure in (still, moving)]
    assert names == [["mass 1", "mass 2"], ["anchor", "mass 1", "mass 2"]]


def test_rates_of_the_phase_portraits_are_the_derivatives() -> None:
    one = motion()
    panels = plots.phase_portraits(one).axes
    springs = (one.states[:, :3], one.states[:, 3:6] - one.states[:, :3])
    for spring, above, below in zip(springs, panels[:2], panels[2:], strict=True):
        assert np.allclose(above.get_lines()[0].get_xdata(), np.linalg.norm(spring, axis=1))
        angle = np.arccos(-spring[:, 2] / np.linalg.norm(spring, axis=1))  # 0 is hanging, in rad
        assert np.allclose(below.get_lines()[0].get_xdata(), angle)
    for axes in panels:
        line = axes.get_lines()[0]
        x, rate = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        slope = np.gradient(x, one.times)
        smooth = np.abs(np.gradient(slope, one.times)) < 60.0  # away from where the angle turns round near zero
        assert smooth.mean() > 0.8
        assert np.abs(slope - rate)[smooth][1:-1].max() < 0.02 * np.abs(rate).max()


def test_learning_curves_mean_and_interval() -> None:
    steps = np.linspace(0.0, 1e6, 11)
    assert [millions(count, 0) for count in (0, 5e4, 1e6, 2.5e6)] == ["0", "50 k", "1 M", "2.5 M"]
    seeds = [(steps, level + np.zeros(11)) for level in (1.0, 2.0, 3.0)]
    axes = plots.learning_curves({"PPO": seeds, "SAC": seeds[:1]}).axes[0]
    assert np.allclose(drawn(axes)["PPO, 3 seeds"], 2.0) and np.allclose(drawn(axes)["SAC"], 1.0)
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    half = 4.302652729911275 / 3**0.5  # Student's t of two degrees of freedom, a deviation of 1
    assert (band.min(), band.max()) == pytest.approx((2.0 - half, 2.0 + half))


def test_comparison_shows_values_and_what_was_not_reached() -> None:
    rows = {
        "time (s)": {"a": (2.0, 1.5, 3.0), "b": (np.inf, np.inf, np.inf)},
        "share": {"a": (1.0, 0.9, 1.0), "b": (0.0, 0.0, 0.1)},
        "effort": {"a": (5.0, 4.0, 6.0)},
        "more": {"a": (5.0, 4.0, np.inf)},
    }
    figure = plots.comparison(rows)
    assert [text.get_text() for text in figure.axes[0].texts] == ["not reached"]
    assert [axes.get_xlabel() for axes in figure.axes[:4]] == list(rows)
    assert np.asarray(figure.axes[0].get_lines()[0].get_xdata()) == [2.0]
    # The bars are the intervals, and an open one is an arrow.
    bars = [axes.collections[0].get_segments()[0] for axes in figure.axes[:4]]
    ends = [(bar[0][0], bar[1][0]) for bar in bars]
    assert ends == [pytest.approx(end) for end in ((1.5, 3.0), (0.9, 1.0), (4.0, 6.0), (4.0, 5.0))]
    assert [len(axes.texts) for axes in figure.axes[:4]] == [1, 0, 0, 1]
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["a", "b"]
    names = dict.fromkeys("abcdefg", (1.0, 0.5, 2.0))
    markers = plots.comparison({"share": names}).axes[0].containers
    looks = [(bar[0].get_color(), bar[0].get_marker()) for bar in markers]
    assert len(set(looks[:6])) == 6 and [colour for colour, _ in looks[:6]] == list(plots.COLOURS)


def test_files_are_the_same_each_time_and_matplotlib_is_left_as_it_was(tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    first = plots.save(plots.energy([motion(), motion("other", method="RK45")]), tmp_path / "a" / "energy")
    second = plots.save(plots.energy([motion(), motion("other", method="RK45")]), tmp_path / "b" / "energy")
    assert [path.name for path in first] == ["energy.png", "energy.svg"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert dict(matplotlib.rcParams) == before
    assert "energy error (42)" in first[1].read_text()  # letters stay letters


def test_lines_differ_without_colour_too() -> None:
    figure = plots.energy([motion(name) for name in "abc"])
    lines = figure.axes[0].get_lines()
    assert len({line.get_linestyle() for line in lines}) == 3
    assert [line.get_color() for line in lines] == list(plots.COLOURS[:3])
    many = plots.energy([motion(str(number)) for number in range(8)]).axes[0].get_lines()
    assert len({(line.get_color(), line.get_linestyle()) for line in many}) == 8
    assert all(re.fullmatch("#[0-9A-F]{6}", colour) for colour in plots.COLOURS)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: plots.Motion("one", Parameters(), np.arange(3.0), np.zeros((3, 6))), r"states of shape \(3, 6\)"),
        (lambda: plots.Motion("one", Parameters(), np.arange(3.0), np.zeros((3, 12)), np.zeros(2)), "errors of shape"),
        (lambda: plots.energy([]), "motions is empty"),
        (lambda: plots.comparison({}), "measures is empty"),
        (lambda: plots.learning_curves({"PPO": []}), r"curves\['PPO'\]: must hold at least one seed"),
        (lambda: plots.learning_curves({"PPO": [([2.0, 1.0], [0.0, 0.0])]}), "steps increasing"),
    ],
)
def test_a_wrong_argument_is_named(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_missing_matplotlib_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    one = motion()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r'pip install "spring-pendulum-env\[plot\]"'):
        plots.energy([one])
