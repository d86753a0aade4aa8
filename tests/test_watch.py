"""scripts/watch.py: who may play, films, the window, and one clear line for whatever is wrong."""

from __future__ import annotations

import importlib
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pygame")

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

cast: Any = importlib.import_module("watching.cast")
film: Any = importlib.import_module("watching.film")
live: Any = importlib.import_module("watching.live")
output: Any = importlib.import_module("watching.output")
record: Any = importlib.import_module("watching.record")
Episode: Any = importlib.import_module("watching.episode").Episode
Renderer: Any = importlib.import_module("spring_pendulum_env.rendering").Renderer


def watch(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["watch.py", *arguments])
    runpy.run_path(str(ROOT / "scripts" / "watch.py"), run_name="__main__")


def error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that the script says before it ends with 2."""
    with pytest.raises(SystemExit) as ended:
        watch(monkeypatch, *arguments)
    assert ended.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


# Who plays.


def test_the_task_is_the_one_that_the_policy_was_trained_for() -> None:
    chosen = cast.choose(["nothing", "hanging-inverted", "lqr"])
    assert chosen.environment_id == "SpringPendulumStabilisation-v0"
    assert chosen.scenario.equilibrium == "hanging-inverted"
    assert [name for name, _ in chosen.players] == ["nothing", "hanging-inverted", "lqr"]
    assert cast.choose(["lqr"], None, "inverted-hanging").players[0][1].equilibrium_name == "inverted-hanging"


def test_constants_replace_those_of_the_task() -> None:
    chosen = cast.choose(["lqr"], "damping", None, {"k1": 150.0}, 0.5)
    assert chosen.scenario.parameters.k1 == chosen.players[0][1].parameters.k1 == 150.0
    assert chosen.scenario.start_scale == 0.5


def test_all_play_from_the_same_start_until_they_end() -> None:
    chosen = cast.choose(["inverted-inverted", "nothing"])
    policy, nothing = (record.record(Episode(chosen, number), 5, 3.0) for number in (0, 1))
    assert np.array_equal(policy.states[0], nothing.states[0])
    assert not policy.ended and nothing.ended.startswith("out of bounds after")
    assert len(nothing.times) < len(policy.times) == 151


def test_an_episode_goes_on_beyond_its_end_where_asked_to() -> None:
    chosen = cast.choose(["nothing"], "stabilisation")
    assert len(record.record(Episode(chosen, 0, beyond_end=True), 5, 3.0).times) == 151


def test_record_agrees_with_the_info_of_the_environment() -> None:
    episode = Episode(cast.choose(["lqr"], "damping"), 0)
    found = record.record(episode, 1, 0.4)
    assert found.energy[-1] == pytest.approx(episode.info["energy"], rel=1e-12)
    assert found.excess_energy[-1] == pytest.approx(episode.info["excess_energy"], rel=1e-9)
    assert np.array_equal(found.forces[-1], episode.info["force"])
    assert np.all(found.forces[0] == 0.0) and found.times[-1] == pytest.approx(0.4)


# Films.


@pytest.mark.parametrize("speed", [0.25, 1.0, 3.0])
@pytest.mark.parametrize("period", [0.02, 0.05, 0.005])
def test_a_film_plays_at_its_speed(speed: float, period: float) -> None:
    stride, fps = film.timing(period, speed, 50.0)
    assert stride * period * fps == pytest.approx(speed)
    assert stride >= 1 and (fps <= 50.0 + 1e-9 or stride == 1)


def test_gif(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from PIL import Image

    path = tmp_path / "made" / "film.gif"
    watch(monkeypatch, "lqr", "nothing", "--video", str(path), "--seconds", "0.6", "--size", "200", "--seed", "3")
    with Image.open(path) as gif:
        assert gif.size == (400, 200) and gif.info["duration"] == 40
        assert gif.n_frames == 16  # type: ignore[attr-defined]
        first = np.array(gif.convert("RGB")).astype(int)
        gif.seek(15)
        assert np.abs(np.array(gif.convert("RGB")).astype(int) - first).max() > 100
    for colour in ((245, 184, 61), (45, 200, 165)):  # the masses keep their colours
        assert (np.abs(first - colour).max(axis=-1) < 40).sum() > 20
    assert [file.name for file in path.parent.iterdir()] == ["film.gif"]


@pytest.mark.parametrize("fps", [50.0, 25.0, 17.5, 100.0 / 6, 7.0])
def test_a_gif_loses_no_time_to_its_hundredths_of_a_second(fps: float) -> None:
    told = film.durations(70, fps)
    assert all(one % 10 == 0 and one >= 20 for one in told)
    assert sum(told) == pytest.approx(70_000 / fps, abs=5.0)
    assert max(told) - min(told) <= 10


def test_what_stays_as_it_is_takes_no_room_in_a_gif(tmp_path: Path) -> None:
    from PIL import Image

    random = np.random.default_rng(0)
    picture = np.array(film.MASSES, dtype=np.uint8)[random.integers(2, size=(128, 128))]
    moved = [picture.copy() for _ in range(9)]
    for number, one in enumerate(moved):  # two far corners change, and all between them stays
        one[0, 0] = one[-1, -1] = film.PUSH if number % 2 else film.PULL
    film.write(tmp_path / "still.gif", iter([picture] * 1), 25.0, 1)
    film.write(tmp_path / "moving.gif", iter(moved), 25.0, 9)
    still, moving = ((tmp_path / name).stat().st_size for name in ("still.gif", "moving.gif"))
    assert moving < 2 * still
    with Image.open(tmp_path / "moving.gif") as gif:
        for number in range(9):
            gif.seek(number)
            assert np.array_equal(np.array(gif.convert("RGB")), moved[number])


def test_mp4(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "film.mp4"
    watch(monkeypatch, "nothing", "--task", "passive", "--video", str(path), "--seconds", "0.5", "--size", "201")
    assert ffmpeg.count_frames_and_secs(str(path))[0] == 26
    reader = ffmpeg.read_frames(str(path))
    meta = next(reader)
    picture = np.frombuffer(next(reader), dtype=np.uint8)
    reader.close()
    assert meta["size"] == (200, 200) and meta["fps"] == 50.0
    assert picture.max() > 200 and picture.min() < 40
    assert [file.name for file in tmp_path.iterdir()] == ["film.mp4"]


def test_the_important_colours_are_among_those_of_a_gif() -> None:
    shades: Any = importlib.import_module("spring_pendulum_env.colours")
    colours = film.palette()
    assert len(set(colours)) == len(colours) <= 255
    assert {shades.PUSH, shades.PULL, shades.FORCE, shades.INK, *shades.MASSES} <= set(colours)


# The window.


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes a window that nobody sees."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    opened = []

    def make(*names: str, **options: Any) -> Any:
        chosen = cast.choose(names, "damping")
        episodes = [Episode(chosen, number) for number in range(len(names))]
        renderers = [Renderer("rgb_array", 50, chosen.scenario, size=(200, 200)) for _ in names]
        opened.append(live.Stage(episodes, renderers, (200, 200), seed=3, **options))
        return opened[-1]

    yield make
    for one in opened:
        one._pygame.display.quit()


def press(one: Any, *keys: str) -> None:
    pygame = one._pygame
    for key in keys:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.key.key_code(key)))
    one.frame()


def release(one: Any, *keys: str) -> None:
    pygame = one._pygame
    for key in keys:
        pygame.event.post(pygame.event.Event(pygame.KEYUP, key=pygame.key.key_code(key)))
    one.frame()


def test_keys_hold_step_and_slow(stage: Any) -> None:
    one = stage("nothing")
    press(one, "space")
    held = one.episodes[0].time
    one.frame()
    assert one.paused and one.episodes[0].time == held
    press(one, ".")
    assert one.episodes[0].time == pytest.approx(held + 0.02)
    for _ in range(9):
        press(one, "-")
    assert one.speed == live.SLOWEST
    for _ in range(9):
        press(one, "=")
    assert one.speed == live.FASTEST


@pytest.mark.parametrize(("speed", "steps"), [(0.25, 1), (1.0, 4), (2.0, 8)])
def test_the_speed_is_kept(stage: Any, speed: float, steps: int) -> None:
    one = stage("nothing", speed=speed)
    one._clock = SimpleNamespace(get_time=lambda: 80)  # ms since the last picture
    one.frame()
    assert one.episodes[0].time == pytest.approx(0.02 * steps)


def test_a_random_start_and_back(stage: Any) -> None:
    one = stage("lqr", "nothing")
    press(one, "space", ".", ".")
    press(one, "r")
    first, second = (episode.state for episode in one.episodes)
    assert one.seed != 3 and np.array_equal(first, second) and one.episodes[0].time == 0.0
    press(one, ".", ".", "b")
    assert np.array_equal(one.episodes[0].state, first)


def test_keys_push_along_the_picture(stage: Any) -> None:
    one = stage("keyboard")
    one.renderers[0].azimuth = -90.0  # looking from -y: x to the right
    press(one, "space", "right", ".")
    assert one.episodes[0].force == pytest.approx([6.0, 0.0, 0.0])
    press(one, "left shift", ".")
    assert one.episodes[0].force == pytest.approx([20.0, 0.0, 0.0])
    release(one, "right", ".")
    press(one, "up", "w", ".")
    assert one.episodes[0].force == pytest.approx([0.0, 20.0, 20.0])
    release(one, "up", "w", "left shift", ".")
    press(one, ".")
    assert not one.episodes[0].force.any()


def test_the_mouse_pulls_towards_the_pointer(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    one = stage("nothing", "mouse")
    one.renderers[1].azimuth, one.renderers[1].elevation = -90.0, 0.0
    press(one, "space", ".")
    anchor = one.renderers[1].scene.project(one.renderers[1].scene.bodies[0])[0][0]
    pointer = (round(200 + anchor[0] + 25), round(anchor[1]))  # an eighth of the picture to the right of the anchor
    monkeypatch.setattr(one._pygame.mouse, "get_pressed", lambda: (True, False, False))
    monkeypatch.setattr(one._pygame.mouse, "get_pos", lambda: pointer)
    one.frame()
    release(one, ".")
    press(one, ".")
    assert one.episodes[1].force == pytest.approx([10.0, 0.0, 0.0], abs=0.5)
    assert not one.episodes[0].force.any()


def test_who_has_ended_is_told_how_to_go_on(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    one, written = stage("nothing", "lqr"), []
    monkeypatch.setattr(one, "_write", lambda text, *_: written.append(text))
    for episode, ended in ((one.episodes[0], False), (one.episodes[1], True)):
        episode.ended = "out of bounds"
        written.clear()
        one.frame()
        assert written[0].startswith("ended") == ended
    press(one, "b")
    assert written[-2].startswith("speed 1")


def test_dragging_turns_all_pictures(stage: Any) -> None:
    one = stage("lqr", "nothing")
    pygame = one._pygame
    before = one.renderers[0].azimuth
    pygame.event.post(pygame.event.Event(pygame.MOUSEMOTION, pos=(9, 9), rel=(10, 5), buttons=(1, 0, 0)))
    pygame.event.post(pygame.event.Event(pygame.MOUSEWHEEL, x=0, y=2))
    one.frame()
    assert one.renderers[0].azimuth == one.renderers[1].azimuth != before
    assert one.renderers[0].zoom == one.renderers[1].zoom > 1.0


@pytest.mark.parametrize("how", ["q", "escape", "button"])
def test_closing_the_window_ends(stage: Any, how: str) -> None:
    one = stage("nothing")
    pygame = one._pygame
    if how == "button":
        pygame.event.post(pygame.event.Event(pygame.QUIT))
    else:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.key.key_code(how)))
    one.run()
    assert not one.open and not pygame.display.get_init()


def test_the_window_ends_when_its_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    watch(monkeypatch, "nothing", "--task", "passive", "--seconds", "0.1", "--size", "200")


def test_the_window_ends_in_time_where_the_episode_ended_before(stage: Any) -> None:
    one = stage("nothing", seconds=4.0)
    while not one.episodes[0].ended:
        one.step()
    assert one.episodes[0].time < 3.9
    one.frame()
    assert one.open
    while one._steps < 200:
        one.step()
    one.frame()
    assert not one.open


# What is wrong is said in one line.


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nobody"], "controller 'nobody' is unknown: must be nothing, lqr, keyboard, mouse, damping, .* folder"),
        (["nothing", "--task", "juggling"], "task = 'juggling': must be one of passive, damping, stabilisation"),
        (["lqr", "--task", "passive"], "'lqr' can't play the passive task"),
        (["lqr", "--task", "damping", "--equilibrium", "hanging-hanging"], "equilibrium"),
        (["lqr", "--video", "film.avi"], "unknown file type '.avi': must be .mp4 or .gif"),
        (["lqr", "--html", "page.txt"], "unknown file type '.txt': must be .html"),
        (["keyboard", "--video", "film.gif"], "'keyboard' needs the window"),
        (["nothing", "--parameters", "k1"], "--parameters k1: must be NAME=VALUE"),
        (["nothing", "--parameters", "k9=1"], "unknown parameter 'k9'"),
        (["nothing", "--speed", "0"], "--speed 0: must be from 0.01 to 100"),
        (["nothing", "--speed", "1e9"], r"--speed 1e\+09: must be from 0.01 to 100"),
        (["nothing", "--speed", "nan"], "--speed nan: must be from"),
        (["nothing", "--fps", "1e-9", "--video", "film.gif"], "--fps 1e-09: must be from 1 to 200"),
        (["nothing", "--fps", "1e9", "--video", "film.gif"], r"--fps 1e\+09: must be from 1 to 200"),
        (["nothing", "--seconds", "nan"], "--seconds nan: must be"),
        (["nothing", "--seconds", "0.001", "--figures", "figures"], "--seconds 0.001: must be at least .*, 0.02"),
        (["nothing", "--seed", "-1"], "--seed -1: must be"),
        (["nothing", "--size", "10", "--video", "film.gif"], "size"),
        (["nothing", "--colour", "red"], "unrecognized arguments: --colour red"),
    ],
)
def test_bad_input(
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    said = error(monkeypatch, capsys, *arguments)
    assert re.search(message, said), said


def test_a_run_without_weights(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "config.yaml").write_text((ROOT / "configs" / "damping-ppo.yaml").read_text())
    said = error(monkeypatch, capsys, str(tmp_path))
    assert "lacks policy.pth" in said and "take it up again with scripts/train.py" in said


def test_a_run_folder_plays(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    shutil.copytree(ROOT / "agents" / "policies" / "damping", tmp_path / "run")
    own, shipped = (cast.choose([name]) for name in (str(tmp_path / "run"), "damping"))
    states = [record.record(Episode(chosen, 0), 5, 0.4).states for chosen in (own, shipped)]
    assert np.array_equal(*states)


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on the PATH")
def test_playing_without_a_browser_says_which_file_to_open(tmp_path: Path) -> None:
    make, python = shutil.which("make"), sys.executable
    command = [str(make), "--no-print-directory", "play", f"PYTHON={python}"]
    nowhere = {"PATH": f"{tmp_path}", "HOME": str(tmp_path)}
    done = subprocess.run(command, cwd=ROOT, env=nowhere, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "no browser was found" in done.stderr and "docs/live.html" in done.stderr


def test_a_folder_that_cant_be_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    said = error(monkeypatch, capsys, "nothing", "--video", str(tmp_path / "file" / "film.gif"))
    assert "can't write into" in said and "name another folder" in said


def test_no_display(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "none_such")
    said = error(monkeypatch, capsys, "nothing", "--task", "passive")
    assert "a window needs a display" in said and "--video FILE" in said


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
def test_no_screen(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    said = error(monkeypatch, capfd, "nothing", "--task", "passive")  # SDL's libraries write beside Python's stderr
    assert "a window needs a display (neither DISPLAY nor WAYLAND_DISPLAY is set)" in said
