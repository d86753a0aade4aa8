"""MEGNO against exponents, theory and motions that are known to be regular; starts, maps and the study of shares."""

from __future__ import annotations

import importlib
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference_data import VIOLENT, load
from scipy.integrate import quad

from spring_pendulum_env import Parameters, energy, equilibrium, normal_modes
from spring_pendulum_env.dynamics import (
    chaos_indicators,
    chaos_map,
    lowest_state,
    mean_megno,
    megno,
    microcanonical_starts,
    thrown_straight,
)

FloatArray = NDArray[np.float64]

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))
config: Any = importlib.import_module("chaos.config")
study: Any = importlib.import_module("chaos.study")
map_script: Any = importlib.import_module("chaos_map")
share_script: Any = importlib.import_module("order_chaos_order")

REFERENCE: dict[str, Any] = load("lyapunov")["cases"]
UNEVEN = Parameters(m1=0.9, m2=2.3, k1=120.0, k2=70.0, L1=0.8, L2=1.1, g=9.7)
FIELDS = ("megno", "megno_halfway", "exponent", "energy_error")


def some_starts(count: int, scale: float = 0.4) -> FloatArray:
    random = np.random.default_rng(3)
    starts: FloatArray = lowest_state(None) + scale * random.standard_normal((count, 12))
    return starts


def assert_same(found: Any, expected: Any, rows: Any = slice(None)) -> None:
    """Bit for bit."""
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name)[rows])


# The indicator.


@pytest.mark.parametrize("growth", [lambda t: 1 + t * t, lambda t: np.exp(0.3 * t) * (1 + 0.5 * np.sin(2 * t))])
def test_mean_megno_is_what_its_definition_says(growth: Any) -> None:
    """Cincotta and Simo's double integral, by quadrature of the derivative."""
    end = 10.0

    def y(t: float) -> float:
        tiny = 1e-5
        return quad(lambda s: s * np.log(growth(s + tiny) / growth(s - tiny)) / (2 * tiny), 0, t)[0] * 2 / t  # type: ignore[no-any-return]

    expected = quad(y, 1e-9, end, limit=200)[0] / end
    times = np.linspace(0, end, 2001)
    assert mean_megno(np.log(growth(times) / growth(0.0))[:, None])[0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", list(REFERENCE))
def test_indicators_meet_the_reference(name: str) -> None:
    case = REFERENCE[name]
    duration = 2_000.0
    found = chaos_indicators(case["params"], [case["initial_state"]], duration, plane="planar" in name)
    assert found.known.all()
    assert found.energy_error[0] < 1e-7
    if case["kind"] == "regular":
        assert not found.chaotic[0]
        assert found.megno[0] < 2.0
        assert abs(found.exponent[0]) < 4 * np.log(2) / duration
    else:
        error = case["sem"] * np.sqrt(case["T"] / (duration / 2))
        assert found.exponent[0] == pytest.approx(case["lambda_max"], abs=4 * error)
        assert found.megno[0] == pytest.approx(case["lambda_max"] * duration / 2, rel=0.15)
        assert found.chaotic[0]
        assert found.chaotic_halfway[0]


def test_integrable_single_spring_is_regular() -> None:
    """Without gravity: energy and angular momentum are kept. Mass 2 flies freely."""
    random = np.random.default_rng(0)
    starts = np.zeros((64, 12))
    starts[:, :3], starts[:, 6:9] = random.standard_normal((2, 64, 3))
    starts[:, 3] = 3.0
    found = chaos_indicators({"k2": 0.0, "g": 0.0}, starts, 2_000.0)
    assert (np.abs(found.megno - megno.REGULAR) < 0.1).all()


def test_single_spring_with_gravity_can_be_chaotic() -> None:
    """0.523 +- 0.009 1/s is the reference's exponent of this start."""
    start = np.r_[0.4, -0.7, 1.3, 0, 0, -1.0, np.zeros(6)]
    found = chaos_indicators({"k1": 50.0, "k2": 0.0}, [start], 4_000.0)
    assert found.chaotic[0]
    assert found.exponent[0] == pytest.approx(0.523, rel=0.15)
    assert found.energy_error[0] < 1e-6


def test_small_motions_are_regular() -> None:
    found = chaos_indicators(None, some_starts(32, 0.02), 1_000.0)
    assert (found.megno < megno.REGULAR).all()
    assert not found.chaotic.any()


def test_nothing_grows_in_a_linear_system() -> None:
    found = chaos_indicators({"L1": 0.0, "L2": 0.0}, some_starts(8), 1_000.0)
    assert (np.abs(found.megno) < 0.05).all()


def test_growth_at_an_unstable_rest_is_that_of_its_mode() -> None:
    """On the vertical the motion stays there; in the plane as in space the pendulum would fall over."""
    start = equilibrium(None, "hanging-inverted")[np.r_[3:9, 12:18]]
    rate = np.sqrt(-normal_modes(None, "hanging-inverted").omega_squared[0])
    for plane in (True, False):
        found = chaos_indicators(None, [start], 100.0, plane=plane)
        assert found.exponent[0] == pytest.approx(rate, rel=1e-3)
        assert found.megno[0] == pytest.approx(rate * 100.0 / 2, rel=0.05)
    with pytest.raises(ValueError, match="Y1 = Y2"):
        chaos_indicators(None, some_starts(1), 100.0, plane=True)


# Rows, blocks and files.


def test_rows_are_single_runs_whatever_the_block() -> None:
    starts = some_starts(70)
    whole = chaos_indicators(None, starts, 40.0)
    for block in (1, 33):
        rows = slice(60, 70) if block == 1 else slice(None)
        assert_same(chaos_indicators(None, starts[rows], 40.0, block=block), whole, rows)
    assert_same(chaos_indicators(None, starts[66:67], 40.0), whole, slice(66, 67))


def test_motion_through_zero_length_is_left_out_alone() -> None:
    parameters = {"k2": 0.0}
    through = np.r_[0, 0, 1.2, 0, 0, 3.0, 0, 0, -10.0, np.zeros(3)]
    others = some_starts(3)
    found = chaos_indicators(parameters, [others[0], through, *others[1:]], 10.0)
    np.testing.assert_array_equal(found.known, [True, False, True, True])
    assert not found.chaotic[1]
    assert_same(chaos_indicators(parameters, others, 10.0), found, found.known)


KILLED = """
import os, signal, sys
import numpy as np
from spring_pendulum_env.dynamics import chaos_indicators, megno
follow, calls = megno._followed, []
def follow_or_die(*arguments):
    calls.append(1)
    if len(calls) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return follow(*arguments)
megno._followed = follow_or_die
chaos_indicators(None, np.load(sys.argv[1]), 20.0, block=4, file=sys.argv[2])
"""


def test_killed_run_is_taken_up_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    starts, file = some_starts(14), tmp_path / "map.npz"
    np.save(tmp_path / "starts.npy", starts)
    command = [sys.executable, "-c", KILLED, str(tmp_path / "starts.npy"), str(file)]
    assert subprocess.run(command, check=False, cwd=ROOT).returncode == -signal.SIGKILL
    with np.load(file) as archive:
        assert archive["done"].sum() == 8
    followed = []
    original = megno._followed

    def follow(flow: Any, rows: FloatArray, *others: Any) -> FloatArray:
        followed.append(len(rows))
        return original(flow, rows, *others)

    monkeypatch.setattr(megno, "_followed", follow)
    found = chaos_indicators(None, starts, 20.0, block=4, file=file)
    assert followed == [4, 2]
    assert_same(chaos_indicators(None, starts, 20.0, block=4, file=file), found)
    assert followed == [4, 2]  # all was there
    assert_same(chaos_indicators(None, starts, 20.0), found)


def test_file_of_other_motions_is_refused(tmp_path: Path) -> None:
    starts, file = some_starts(2), tmp_path / "map.npz"
    chaos_indicators(None, starts, 10.0, file=file)
    with pytest.raises(ValueError, match="other states"):
        chaos_indicators(None, starts[:1], 10.0, file=file)
    with pytest.raises(ValueError, match=r"other parameters, duration, intervals"):
        chaos_indicators({"g": 9.0}, starts, 20.0, file=file)
    file.write_text("no archive")
    with pytest.raises(ValueError, match="isn't one that chaos_indicators wrote"):
        chaos_indicators(None, starts, 10.0, file=file)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"states": VIOLENT}, r"states of shape \(12,\)"),
        ({"states": [VIOLENT * np.nan]}, "must be finite"),
        ({"duration": 0.01}, "duration = 0.01"),
        ({"duration": -1.0}, "duration = -1.0"),
        ({"interval": 0.0}, "interval = 0.0"),
        ({"block": 0}, "block = 0"),
        ({"seed": -1}, "seed = -1"),
        ({"longest_step": np.inf}, "longest_step = inf"),
        ({"parameters": {"R2": 0.1}}, r"R2 = 0.1.*must be 0"),
        ({"parameters": {"k3": 1.0}}, "unknown parameter 'k3'"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        chaos_indicators(**{"parameters": None, "states": [VIOLENT], **arguments})


# Starts.


@pytest.mark.parametrize("plane", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("excess", [3.0, 300.0])
def test_starts_have_the_liouville_measure(plane: bool, excess: float) -> None:
    """Equipartition: on an energy surface every q dH/dq and every p dH/dp has the same mean, and others vanish."""
    count = 8_000
    starts = microcanonical_starts(UNEVEN, excess, count, plane=plane, seed=1)
    rest = float(energy(UNEVEN, lowest_state(UNEVEN)))
    np.testing.assert_allclose(np.asarray(energy(UNEVEN, starts)) - rest, excess, rtol=1e-10)
    axes = [0, 2, 3, 5, 6, 8, 9, 11] if plane else list(range(12))
    assert (np.delete(starts, axes, axis=1) == 0).all()
    slopes = np.zeros((count, 12))
    for axis in axes:
        step = np.zeros(12)
        step[axis] = 1e-6
        slopes[:, axis] = (np.asarray(energy(UNEVEN, starts + step)) - np.asarray(energy(UNEVEN, starts - step))) / 2e-6
    products = (starts - lowest_state(UNEVEN))[:, :, None] * slopes[:, None, :]
    products = products[:, axes][:, :, axes]
    means, errors = products.mean(axis=0), products.std(axis=0) / np.sqrt(count)
    shared = np.diag(means).mean()
    assert (np.abs(means - shared * np.eye(len(axes))) < 4.5 * errors + 1e-9 * excess).all()
    assert shared > 0.05 * excess / len(axes)


def test_seed_of_starts() -> None:
    starts = microcanonical_starts(None, 10.0, 5, seed=1)
    np.testing.assert_array_equal(starts, microcanonical_starts(None, 10.0, 5, seed=1))
    assert not np.isin(starts[:, 0], microcanonical_starts(None, 10.0, 5, seed=2)[:, 0]).any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"excess_energy": 0.0}, "excess_energy = 0.0"),
        ({"excess_energy": np.nan}, "excess_energy = nan"),
        ({"count": 0}, "count = 0"),
        ({"seed": 0.5}, "seed = 0.5"),
        ({"parameters": {"k2": 0.0}}, "k2 = 0.0"),
    ],
)
def test_wrong_arguments_of_starts(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        microcanonical_starts(**{"parameters": None, "excess_energy": 1.0, "count": 1, **arguments})


@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi / 2])
def test_thrown_straight(heading: float) -> None:
    angle = 0.3
    state = thrown_straight(UNEVEN, [angle], [25.0], heading)[0]
    rest = lowest_state(UNEVEN)
    q1, q2, v1, v2 = state.reshape(4, 3)
    np.testing.assert_allclose(q1, rest[2] * -np.array([np.sin(angle), 0, -np.cos(angle)]), rtol=1e-14)
    np.testing.assert_allclose(q2, q1 * rest[5] / rest[2], rtol=1e-14)
    np.testing.assert_allclose(v2, v1 * rest[5] / rest[2], rtol=1e-14, atol=1e-15)
    assert v1 @ q1 == pytest.approx(0.0, abs=1e-14)
    assert np.arctan2(v1[1], v1[0] / np.cos(angle)) == pytest.approx(heading)
    assert float(energy(UNEVEN, state)) - float(energy(UNEVEN, rest)) == pytest.approx(25.0, rel=1e-13)


def test_thrown_with_too_little() -> None:
    """At 60 degrees the straight pendulum of the defaults stands 17.1 J above rest."""
    rest = lowest_state(None)
    standing = 9.81 * (abs(rest[2]) + abs(rest[5])) / 2
    states = thrown_straight(None, np.radians([60.0, 60.0]), [standing, 0.999 * standing])
    np.testing.assert_array_equal(np.isnan(states).all(axis=1), [False, True])
    assert np.abs(states[0, 6:]).max() < 1e-5


# The map.


def test_map_is_its_starts_indicators(tmp_path: Path) -> None:
    angles, energies = np.radians([-40.0, 0.0, 10.0]), np.array([0.5, 6.0])
    chart = chaos_map(None, angles, energies, 300.0, file=tmp_path / "map.npz", block=2)
    np.testing.assert_array_equal(chart.possible, [[False, True, False], [False, True, True]])
    assert np.isnan(chart.megno[~chart.possible]).all()
    assert not chart.chaotic[~chart.possible].any()
    starts = thrown_straight(None, angles[[1, 1, 2]], energies[[0, 1, 1]])
    single = chaos_indicators(None, starts, 300.0, plane=True)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(chart, name)[chart.possible], getattr(single, name))
    np.testing.assert_array_equal(chart.chaotic, [[False, False, False], [False, True, True]])
    assert 0.0 <= chart.agreement <= 1.0
    sideways = chaos_map(None, angles, energies, 300.0, heading=np.pi / 2)
    assert (sideways.megno[chart.possible] != chart.megno[chart.possible]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"angles": []}, r"angles of shape \(0,\)"),
        ({"angles": [0.2, 0.1]}, "must be finite and increasing"),
        ({"angles": "all"}, "angles = 'all'"),
        ({"angles": [1j]}, "(?s)angles = .*must be real numbers"),
        ({"energies": [np.nan]}, "must be finite and increasing"),
        ({"energies": [-1.0, 1.0]}, "energies = -1 J"),
        ({"angles": [3.0], "energies": [1.0]}, "too little to stand still"),
        ({"heading": np.inf}, "heading = inf"),
        ({"parameters": {"k1": 0.0}}, "k1 = 0.0"),
        ({"parameters": {"R1": 0.1}}, "R1 = 0.1"),
        ({"duration": 0.0}, "duration = 0.0"),
    ],
)
def test_wrong_arguments_of_the_map(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        chaos_map(**{"parameters": None, "angles": [0.0, 0.1], "energies": [1.0], **arguments})


def test_map_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = "--angles -40 40 5 --energies 1 9 3 --duration 20 --heading 45 --set k2 90"
    monkeypatch.setattr(sys, "argv", ["chaos_map.py", *arguments.split(), "--folder", str(tmp_path)])
    map_script.main()
    assert "9 of 15 starts followed" in capsys.readouterr().out
    with np.load(tmp_path / "chaos-map.npz") as archive:
        assert archive["megno"].shape == (3, 5)
        np.testing.assert_allclose(np.degrees(archive["angles"]), np.linspace(-40, 40, 5))
        expected = chaos_map({"k2": 90.0}, archive["angles"], archive["energies"], 20.0, heading=np.radians(45))
        np.testing.assert_array_equal(archive["megno"], expected.megno)
    lines = (tmp_path / "chaos-map.csv").read_text().splitlines()
    assert lines[0] == "angle,energy,possible,megno,megno_halfway,exponent,energy_error,chaotic"
    assert len(lines) == 16
    assert (tmp_path / "chaos-map.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "chaos-map.svg").read_text()


@pytest.mark.parametrize("axis", [(0.0, 1.0, np.inf), (0.0, np.inf, 3.0), (0.0, 1.0, 2.5), (1.0, 0.0, 2.0)])
def test_wrong_axis_of_the_map_script(axis: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"--angles .*: must be FROM TO COUNT"):
        map_script._axis("angles", *axis)


# The study of shares.

TINY = """
seed: 1
starts: 5
duration: 100
least_agreement: 0.5
energy_panel: {stiffness: 100, energies: [0.5, 2.0e+2]}
stiffness_panel: {energy: 10, stiffnesses: [30, 100]}
"""


def test_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    path, folder = tmp_path / "tiny.yaml", tmp_path / "results"
    path.write_text(TINY)
    monkeypatch.setattr(sys, "argv", ["order_chaos_order.py", "--config", str(path), "--folder", str(folder)])
    share_script.main()
    printed = capsys.readouterr().out
    assert "| plane | 100 | 0.5 | 0.000 | 0.000 to 0.434 |" in printed
    assert "| space | 100 | 200 | 1.000 | 0.566 to 1.000 |" in printed
    assert "50 s and 100 s say the same for" in printed
    assert (folder / "order-chaos-order.png").read_bytes().startswith(b"\x89PNG")
    table = (folder / "table.csv").read_bytes()
    assert len(table.splitlines()) == 9
    assert config.read_study(folder / "config.yaml") == config.read_study(path)
    files = {file: file.stat().st_mtime_ns for file in (folder / "points").iterdir()}
    assert len(files) == 8
    next(iter(files)).unlink()
    settings = config.read_study(path)
    study.run(settings, folder, progress=False)
    assert (folder / "table.csv").read_bytes() == table
    assert sum(file.stat().st_mtime_ns == time for file, time in files.items()) == 7
    with pytest.raises(ValueError, match="other duration"):
        study.run(settings.model_copy(update={"duration": 90.0}), folder, progress=False)


def test_points_have_starts_of_their_own() -> None:
    settings = config.read_study()
    seeds = {point.seed(settings.seed) for _, point in study.points(settings)}
    assert len(seeds) == len({point for _, point in study.points(settings)})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("starts: 5", "starts: 0", "starts = 0: Input should be greater than 0"),
        ("starts: 5", "start: 5", "start = 5: Extra inputs"),
        ("seed: 1", "", "seed"),
        ("200", "-200", "energy_panel.energies.1"),
        ("2.0e+2", "two", "energy_panel.energies.1 = 'two'"),
        ("[30, 100]", "[]", "stiffness_panel.stiffnesses"),
        ("seed: 1", "seed: 1\nparameters: {k1: 5}", "parameters.k1 = 5.0: the panels set"),
        (TINY, "text", "holds str"),
    ],
)
def test_wrong_settings(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(TINY.replace("2.0e+2", "200").replace(old, new) if old == "200" else TINY.replace(old, new))
    with pytest.raises(ValueError, match=message):
        config.read_study(path)


def test_folder_that_cannot_be_written_is_found_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spring_pendulum_env.dynamics.megno._followed", None)
    (tmp_path / "taken").write_text("")
    with pytest.raises(OSError, match="taken"):
        chaos_indicators(None, [VIOLENT], 10.0, file=tmp_path / "taken" / "progress.npz")


def test_settings_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"study\.yaml is not YAML: .*can't decode"):
        config.read_study(tmp_path / "study.yaml")


def test_quick_and_missing_settings(tmp_path: Path) -> None:
    assert config.read_study(quick=True).starts < config.read_study().starts
    with pytest.raises(ValueError, match="cannot be read"):
        config.read_study(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(([np.nan], [1.0]), "angles"), (([0.0], [np.nan]), "energies"), (([0.0], [1.0], np.nan), "heading = nan")],
)
def test_throws_need_finite_numbers(arguments: Any, named: str) -> None:
    with pytest.raises(ValueError, match=f"{named}.*must be.*finite"):
        thrown_straight(None, *arguments)
