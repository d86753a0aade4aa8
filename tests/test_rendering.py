"""Pictures of a state: the same bits for the same history, readable colours, and everything in the frame."""

from __future__ import annotations

import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from spring_pendulum_env import Parameters, equilibrium
from spring_pendulum_env.canvas import import_pygame
from spring_pendulum_env.colours import MASSES, tension_colour
from spring_pendulum_env.readout import round_number
from spring_pendulum_env.rendering import Renderer
from spring_pendulum_env.scenario import Scenario
from spring_pendulum_env.tasks import TASKS

pytest.importorskip("pygame")

Picture = NDArray[np.uint8]
NO_FORCE = np.zeros(3)


def scenario(task: str = "Passive", **arguments: Any) -> Scenario:
    return Scenario.of(TASKS[f"SpringPendulum{task}-v0"], **arguments)


def renderer(task: str = "Passive", **arguments: Any) -> Renderer:
    return Renderer("rgb_array", 50, scenario(task), **arguments)


def drawn(
    shown: Renderer, state: Any, p: Parameters | None = None, force: Any = NO_FORCE, time: float = 0.0
) -> Picture:
    picture = shown.draw(state, p or Parameters(), force, time)
    assert picture is not None
    return picture


def hanging(length1: float = 1.2, length2: float = 1.1) -> NDArray[np.float64]:
    state = np.zeros(18)
    state[5], state[8] = -length1, -length1 - length2
    return state


def swing(n: int) -> list[NDArray[np.float64]]:
    t = 0.02 * np.arange(n)
    states = np.tile(equilibrium(None, "hanging-hanging"), (n, 1))
    states[:, 3], states[:, 6] = 0.5 * np.sin(3 * t), 0.9 * np.sin(3 * t)
    return list(states)


def pixels_of_hue(picture: Picture, colour: tuple[int, int, int], within: float = 0.02) -> NDArray[np.intp]:
    """Rows and columns of the pixels whose channels are in about the same ratio as the colour's, and not dark."""
    bright = picture.astype(float)
    total = bright.sum(axis=-1, keepdims=True)
    close = np.abs(bright / np.maximum(total, 1.0) - np.array(colour) / sum(colour)).max(axis=-1) < within
    return np.argwhere(close & (total[..., 0] > 150))


@pytest.mark.parametrize("task", ["Passive", "Damping", "Stabilisation", "SwingUp"])
@pytest.mark.parametrize("size", [(600, 600), (320, 240), (200, 500)])
def test_shape_and_type(task: str, size: tuple[int, int]) -> None:
    picture = drawn(renderer(task, size=size), hanging(), force=[10.0, -5.0, 3.0])
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8
    assert picture.flags.c_contiguous and picture.flags.owndata
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


def test_same_history_gives_same_bits() -> None:
    one, other = renderer(), renderer()
    for number, state in enumerate(swing(30)):
        picture = drawn(one, state, time=0.02 * number)
        assert np.array_equal(picture, drawn(other, state, time=0.02 * number))
    assert np.array_equal(picture, drawn(one, state, time=0.02 * number))  # drawing has no effect of its own


def test_ground_that_is_kept_is_the_ground_that_is_drawn() -> None:
    near, far = hanging(), hanging(4.0)
    shown = renderer(trail=0.0)
    for state in (far, near, near, far, near):  # the camera moves, stands still, and comes back
        shown.forget()
        assert np.array_equal(drawn(shown, state), drawn(renderer(trail=0.0), state))
    shown.turn(30.0, 10.0)
    shown.forget()
    turned = renderer(trail=0.0, azimuth=shown.azimuth, elevation=shown.elevation)
    assert np.array_equal(drawn(shown, near), drawn(turned, near))


def test_each_frame_is_its_own_array() -> None:
    shown = renderer()
    first = drawn(shown, hanging())
    kept = first.copy()
    drawn(shown, hanging(1.5), time=1.0)
    assert np.array_equal(first, kept)


@pytest.mark.parametrize("index", [3, 4, 5, 6, 7, 8])
def test_another_state_is_another_picture(index: int) -> None:
    moved = hanging()
    moved[index] += 0.05
    assert not np.array_equal(drawn(renderer(), hanging()), drawn(renderer(), moved))


def test_force_and_anchor_show() -> None:
    rest = drawn(renderer("Damping"), hanging())
    moved = hanging() + np.r_[0.2, 0, 0, 0.2, 0, 0, 0.2, np.zeros(11)]
    assert not np.array_equal(rest, drawn(renderer("Damping"), moved))
    assert not np.array_equal(rest, drawn(renderer("Damping"), hanging(), force=[0.0, 20.0, 0.0]))


def test_tension_goes_from_blue_over_grey_to_red() -> None:
    push, slack, pull = (np.array(tension_colour(tension)) for tension in (-1.0, 0.0, 1.0))
    assert push[2] - push[0] > 100 and pull[0] - pull[2] > 100
    assert np.ptp(slack) < 20
    assert tension_colour(-7.0) == tuple(push) and tension_colour(7.0) == tuple(pull)


@pytest.mark.parametrize("spring", [0, 1])
def test_colour_of_each_spring_follows_its_own_tension(spring: int) -> None:
    found = {}
    for name, stretched in (("slack", 1.0), ("pulled", 1.4), ("pushed", 0.75)):
        lengths = [1.0, 1.0]
        lengths[spring] = stretched
        picture = drawn(renderer(), hanging(*lengths)).astype(int)[70:500, 200:400]  # legend and strip left out
        found[name] = (
            int((picture[..., 0] - picture[..., 1] > 100).sum()),
            int((picture[..., 2] - picture[..., 0] > 100).sum()),
        )
    assert found["pulled"][0] > found["slack"][0] + 100
    assert found["pushed"][1] > found["slack"][1] + 100


def test_a_stretched_spring_is_thinner() -> None:
    """Both states pull spring 1 to full red and have their lowest mass in the same place, so the camera too."""
    widths = []
    for length in (1.5, 2.2):
        picture = drawn(renderer(), hanging(length, 2.6 - length)).astype(int)[70:500]
        widths.append(np.ptp(np.argwhere(picture[..., 0] - picture[..., 1] > 120)[:, 1]))
    assert 0 < widths[1] < 0.85 * widths[0]


def test_trails_grow_and_are_forgotten() -> None:
    shown = renderer()
    states = swing(40)
    fresh = drawn(shown, states[-1], time=0.78)
    shown.forget()
    for number, state in enumerate(states):
        trailed = drawn(shown, state, time=0.02 * number)
    assert not np.array_equal(fresh[:500], trailed[:500])
    shown.forget()
    assert np.array_equal(fresh, drawn(shown, states[-1], time=0.78))


def test_states_between_two_frames_smooth_the_trails() -> None:
    states = swing(40)
    all_drawn, noted = renderer(), renderer()
    for number, state in enumerate(states[:-1]):
        drawn(all_drawn, state, time=0.02 * number)
        noted.remember(state, Parameters(), 0.02 * number)
    last = drawn(all_drawn, states[-1], time=0.78)
    assert np.array_equal(last, drawn(noted, states[-1], time=0.78))
    assert not np.array_equal(last, drawn(renderer(), states[-1], time=0.78))


def test_an_earlier_time_starts_the_trails_anew() -> None:
    """A row of a vector environment begins its next episode without a word to the renderer."""
    shown = renderer()
    fresh = drawn(shown, hanging())
    for number, state in enumerate(swing(20)):
        drawn(shown, state, time=0.02 * number)
    assert np.array_equal(fresh, drawn(shown, hanging()))


@pytest.mark.parametrize("constants", [{}, {"k1": 0.0}, {"k2": 0.0}, {"k1": 0.0, "k2": 0.0}])
@pytest.mark.parametrize("distance", [5.0, 500.0, 1e7])
def test_masses_far_away_stay_in_the_frame(constants: dict[str, float], distance: float) -> None:
    state = hanging()
    state[3:9] += distance * np.array([0.3, -0.5, -1.0, 0.6, 0.2, -0.8])
    picture = drawn(renderer(trail=0.0), state, Parameters(**constants))
    for colour in MASSES:
        where = pixels_of_hue(picture, colour)
        where = where[(where[:, 0] > 70) & (where[:, 0] < 505)]  # between the legend and the strip
        assert len(where) > 15
        assert where[:, 1].min() > 0 and where[:, 1].max() < 599


@pytest.mark.parametrize("name", ["hanging-hanging", "hanging-inverted", "inverted-hanging", "inverted-inverted"])
def test_every_task_is_drawn_anywhere_on_its_travel(name: str) -> None:
    shown = Renderer("rgb_array", 50, scenario("Stabilisation", equilibrium=name, actuated_axes="xz"))
    for corner in ([2.0, 0.0, 2.0], [-2.0, 0.0, -2.0]):
        state = equilibrium(None, name)
        state[:9] += np.tile(corner, 3)
        picture = drawn(shown, state)
        assert all(len(pixels_of_hue(picture[70:505], colour)) > 50 for colour in MASSES)


def test_swing_up_shows_where_the_masses_are_wanted_and_its_camera_rests() -> None:
    """The rings stand where the masses of a pendulum that is up are drawn."""
    shown = renderer("SwingUp", trail=0.0)
    up = [pixels_of_hue(drawn(shown, equilibrium(None, "inverted-inverted"))[70:505], colour) for colour in MASSES]
    below = drawn(shown, equilibrium(None, "hanging-hanging"))[70:505]
    for colour, ball in zip(MASSES, up, strict=True):
        middle = ball.mean(axis=0)
        distance = np.linalg.norm(np.argwhere(below.max(axis=2) >= 0) - middle, axis=1).reshape(below.shape[:2])
        ring = np.abs(below / below.sum(axis=2, keepdims=True) - np.array(colour) / sum(colour)).max(axis=2) < 0.06
        assert (ring & (distance < 20)).sum() > 30


def test_degenerate_states_are_drawn() -> None:
    for constants in ({}, {"L1": 0.0, "L2": 0.0, "g": 0.0}, {"m1": 1e-3, "m2": 1e3, "k1": 1e4}):
        drawn(renderer(), np.zeros(18), Parameters(**constants))  # all bodies in one point
        drawn(renderer(azimuth=0.0, elevation=0.0), equilibrium(None, "hanging-hanging"), Parameters(**constants))


@pytest.mark.parametrize(
    "argument",
    [
        {"size": (600, 10)},
        {"size": (600.5, 600)},
        {"elevation": 90.0},
        {"azimuth": np.nan},
        {"zoom": 0.0},
        {"trail": -1.0},
    ],
)
def test_a_wrong_argument_is_named(argument: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(argument))):
        renderer(**argument)


def test_round_number() -> None:
    assert [round_number(value) for value in (0.03, 1.0, 1.1, 20.0, 51.0)] == [0.05, 1.0, 2.0, 20.0, 100.0]


def test_missing_pygame_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r'pip install "spring-pendulum-env\[render\]"'):
        renderer()


def test_no_display_is_touched_for_pictures() -> None:
    pygame = import_pygame()
    drawn(renderer(), hanging())
    assert not pygame.display.get_init()
    assert pygame.mixer.get_init() is None


def test_human_without_a_display_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "none_such")
    with pytest.raises(RuntimeError, match="needs a display") as caught:
        Renderer("human", 50, scenario())
    assert "\n" not in str(caught.value) and caught.value.__suppress_context__


def test_closing_the_window_ends_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = import_pygame()
    shown = Renderer("human", 1000, scenario())
    assert shown.draw(hanging(), Parameters(), NO_FORCE, 0.0) is None
    turned, zoomed = shown.azimuth, shown.zoom
    pygame.event.post(pygame.event.Event(pygame.MOUSEMOTION, pos=(9, 9), rel=(5, 5), buttons=(1, 0, 0)))
    pygame.event.post(pygame.event.Event(pygame.MOUSEWHEEL, x=0, y=1))
    shown.draw(hanging(), Parameters(), NO_FORCE, 0.02)
    assert shown.azimuth != turned and shown.zoom > zoomed and not shown.closed
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    shown.draw(hanging(), Parameters(), NO_FORCE, 0.04)
    assert shown.closed and not pygame.display.get_init()
    assert shown.draw(hanging(), Parameters(), NO_FORCE, 0.06) is None
    shown.close()


def test_render_options_reach_every_environment() -> None:
    options = {"size": [320, 240], "azimuth": 10.0, "elevation": 40.0, "zoom": 1.3, "trail": 0.5, "title": "row"}
    single = gym.make("SpringPendulumDamping-v0", render_mode="rgb_array", render_options=options)
    single.reset(seed=4)
    rows = gym.make_vec(
        "SpringPendulumDamping-v0", num_envs=3, render_mode="rgb_array", render_rows=[1], render_options=options
    )
    rows.reset(seed=3)
    (frame,) = rows.render() or ()
    assert frame.shape == (240, 320, 3) and np.array_equal(frame, single.render())
    plain = gym.make("SpringPendulumDamping-v0", render_mode="rgb_array", render_options={"size": [320, 240]})
    plain.reset(seed=4)
    assert not np.array_equal(frame, plain.render())


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_an_unknown_render_option_is_named(make: Any) -> None:
    with pytest.raises(ValueError, match="render_options: unknown name 'width'"):
        make("SpringPendulumPassive-v0", render_options={"width": 3})


def test_the_title_is_drawn_as_it_is_written() -> None:
    titled, plain = renderer(title="a-b"), renderer()
    assert not np.array_equal(drawn(titled, hanging())[470:520, :200], drawn(plain, hanging())[470:520, :200])
    titled.title = ""
    assert np.array_equal(drawn(titled, hanging()), drawn(plain, hanging()))


def brightness(picture: Picture, colour: tuple[int, int, int], background: Picture) -> NDArray[np.float64]:
    """How much of a colour was laid over each pixel of a background, 0 to 1."""
    change, full = picture.astype(float) - background, np.array(colour) - background.astype(float)
    shares: NDArray[np.float64] = (change * full).sum(axis=-1) / ((full * full).sum(axis=-1) + 1e-9)
    return shares


def test_trails_fade_towards_their_end() -> None:
    """The mass goes straight to the right at one speed, so a place on its trail stands for an age."""
    shown, bare = renderer(azimuth=-90.0, elevation=0.0), renderer(azimuth=-90.0, elevation=0.0, trail=0.0)
    for number in range(101):
        state = hanging()
        state[3] = state[6] = -0.5 + 0.01 * number
        trailed, plain = drawn(shown, state, time=0.02 * number), drawn(bare, state, time=0.02 * number)
    scene = shown.scene
    assert scene is not None
    ends = np.array([[-0.5, 0.0, -2.3], [0.5, 0.0, -2.3]])
    (left, row), (right, _) = scene.project(ends)[0]
    share = brightness(trailed, MASSES[1], plain)[round(row) - 1 : round(row) + 2].max(axis=0)
    places = [round(left + part * (right - left)) for part in (0.15, 0.4, 0.6, 0.8)]
    seen = [float(share[place - 3 : place + 4].mean()) for place in places]
    expected = [0.8 * part**1.5 for part in (0.15, 0.4, 0.6, 0.8)]
    assert seen == pytest.approx(expected, abs=0.1) and seen == sorted(seen)


@pytest.mark.parametrize("later", [2.0, 5.0, 8.5, 11.0])
def test_energy_strip_has_now_at_its_right_end_and_ten_seconds_on_it(later: float) -> None:
    """A moment of high energy moves to the left as time goes on, and out."""
    shown, still, fast = renderer(trail=0.0), hanging(), hanging()
    fast[12] = 20.0
    times = 0.02 * np.arange(round(later / 0.02) + 51)
    for time in times[:-1]:
        shown.remember(fast if 0.97 < time < 1.03 else still, Parameters(), time)
    strip = drawn(shown, still, time=times[-1])[568:584]  # between the words and the line of no energy
    columns = np.flatnonzero(strip.max(axis=(0, 2)) > 100)
    if later < 10.0:
        assert columns.mean() == pytest.approx(590.0 - 58.0 * later, abs=2.5)  # 58 pixels for each second
    else:
        assert len(columns) == 0


@pytest.mark.parametrize("front", [0, 1])
def test_the_nearer_mass_is_drawn_over_the_farther_one(front: int) -> None:
    state = hanging()
    state[3:9] = 0.0, -0.6, -1.2, 0.0, 0.6, -1.2
    if front == 1:
        state[4], state[7] = 0.6, -0.6
    shown = renderer(azimuth=-90.0, elevation=0.0, trail=0.0)
    picture = drawn(shown, state)
    assert shown.scene is not None
    x, y = shown.scene.project([0.0, 0.0, -1.2])[0][0].round().astype(int)
    middle = picture[y - 3 : y + 4, x - 3 : x + 4].reshape(-1, 3).astype(float).mean(axis=0)
    shares = [np.abs(middle / middle.sum() - np.array(colour) / sum(colour)).max() for colour in MASSES]
    assert np.argmin(shares) == front and shares[front] < 0.05


def test_what_is_nearer_is_larger() -> None:
    shown = renderer(azimuth=-90.0, elevation=0.0, trail=0.0)
    drawn(shown, hanging())
    scene = shown.scene
    assert scene is not None
    scale = scene.project([[0.0, y, -1.0] for y in (-0.5, 0.0, 0.5)])[1]  # the eye is at -y
    assert scale[0] > scale[1] > scale[2]
    distance = scene.distance + scene.centre[1]
    assert scale[0] / scale[2] == pytest.approx((distance + 0.5) / (distance - 0.5))


def test_volumes_are_as_the_masses() -> None:
    """Seen in the picture: the areas are as the masses to the power of two thirds."""
    shown = renderer(azimuth=-90.0, elevation=0.0, trail=0.0)
    side = hanging()
    side[3:9] = -0.7, 0.0, -1.2, 0.7, 0.0, -1.2
    for m1, m2 in ((1.0, 8.0), (4.0, 1.0)):
        picture = drawn(shown, side, Parameters(m1=m1, m2=m2, k1=1000.0, k2=1000.0))
        areas = [len(pixels_of_hue(picture[70:505], colour, 0.1)) for colour in MASSES]
        assert areas[0] / areas[1] == pytest.approx((m1 / m2) ** (2 / 3), rel=0.25)


@pytest.mark.parametrize("moved", [0.0, 0.8])
def test_the_rings_go_with_the_anchor(moved: float) -> None:
    shown = renderer("Damping", azimuth=-90.0, elevation=0.0, trail=0.0)
    state = equilibrium(None, "hanging-hanging")
    state[0] = moved
    state[3:9] = -1.0, 0.0, -1.2, -1.2, 0.0, -1.6
    picture = drawn(shown, state).astype(float)[70:505]
    scene = shown.scene
    assert scene is not None
    below = equilibrium(None, "hanging-hanging")[3:9].reshape(2, 3)
    below[:, 0] += moved
    pixels, scale = scene.project(below)
    for (x, y), radius, colour in zip(pixels, 1.45 * scale * scene.sizes[1:], MASSES, strict=True):
        rows, columns = np.indices(picture.shape[:2])
        distance = np.hypot(columns - x, rows + 70 - y)
        hue = np.abs(picture / picture.sum(axis=2, keepdims=True) - np.array(colour) / sum(colour)).max(axis=2) < 0.08
        assert (hue & (abs(distance - radius) < 2.0)).sum() > 40


def test_words_on_the_right_end_at_the_edge() -> None:
    """Whatever their length; those on the left begin there."""
    for m1 in (1.0, 1.234):
        picture = drawn(renderer(), hanging(), Parameters(m1=m1))
        columns = np.flatnonzero((picture[10:27, 300:].max(axis=2) > 120).any(axis=0)) + 300
        assert 583 <= columns.max() <= 588 and columns.min() > 500
        left = np.flatnonzero((picture[10:27, :300].max(axis=2) > 100).any(axis=0))
        assert 11 <= left.min() <= 14
