"""The page of scripts/watch.py --html: what is in it, and that it plays in a real browser."""

from __future__ import annotations

import base64
import dataclasses
import importlib
import io
import json
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pygame")
Image = pytest.importorskip("PIL.Image")

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

cast: Any = importlib.import_module("watching.cast")
page: Any = importlib.import_module("watching.page")
record: Any = importlib.import_module("watching.record")
Episode: Any = importlib.import_module("watching.episode").Episode

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1000,900",
)


@pytest.fixture(scope="module")
def records() -> list[Any]:
    chosen = cast.choose(["lqr", "nothing"], "damping")
    return [record.record(Episode(chosen, number), 3, 4.0) for number in (0, 1)]


@pytest.fixture(scope="module")
def file(records: list[Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("page") / "page.html"
    page.write(path, records)
    return path


def data_in(path: Path) -> Any:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.DOTALL)
    assert found
    return json.loads(found[1])


def test_everything_is_inside_and_small(file: Path) -> None:
    text = file.read_text()
    assert len(text) < 1_000_000
    assert not re.search(r'(src|href)\s*=\s*"(?!data:)', text)
    assert "http" not in text and "/*" not in re.sub(r"/\*\*.*?\*/", "", text, flags=re.DOTALL)  # no mark is left


def test_the_numbers_are_those_of_the_episode(records: list[Any], file: Path) -> None:
    for player, one in zip(data_in(file)["players"], records, strict=True):
        assert np.allclose(player["bodies"], one.states[:, :9], atol=1e-4)
        assert np.allclose(player["excess"], one.excess_energy, atol=1e-3)
        assert np.allclose(player["lengths"], one.lengths.T, atol=1e-4)
        assert np.allclose(player["force"], one.forces, atol=1e-3)


def test_a_name_can_not_break_out_of_the_data(records: list[Any], tmp_path: Path) -> None:
    odd = dataclasses.replace(records[0], name="runs/</script><b>")
    page.write(tmp_path / "page.html", [odd])
    assert data_in(tmp_path / "page.html")["players"][0]["name"] == "policy runs/</script><b>"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Chromium without a window; the environment's CHROMIUM and CHROMEDRIVER say where, if not on the path."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium isn't installed: pip install selenium")
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    driver = os.environ.get("CHROMEDRIVER") or shutil.which("chromedriver")
    if not chromium or not driver:
        pytest.skip("needs Chromium and its driver (on Debian: chromium and chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield window
    window.quit()


@pytest.fixture
def shown(browser: Any, file: Path) -> Any:
    browser.get(file.as_uri())
    yield browser
    assert browser.get_log("browser") == []  # no error, no warning


def step_of(shown: Any) -> int:
    return int(shown.execute_script("return document.getElementById('time').value"))


def picture(shown: Any, number: int) -> Any:
    """Pixels of one of the page's canvases, (n, 4)."""
    script = "return document.querySelectorAll('canvas')[arguments[0]].toDataURL('image/png')"
    png = base64.b64decode(shown.execute_script(script, number).partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA")).reshape(-1, 4).astype(int)


def pause(shown: Any) -> None:
    shown.execute_script("if (clock.playing) toggle(); go(10)")


def test_it_plays_and_comes_to_its_end(shown: Any) -> None:
    first = step_of(shown)
    waited = time.monotonic() + 20.0
    while step_of(shown) <= first and time.monotonic() < waited:
        time.sleep(0.05)
    assert step_of(shown) > first
    shown.execute_script("clock.speed = 1000")
    while step_of(shown) < 200 and time.monotonic() < waited:
        time.sleep(0.05)
    assert step_of(shown) == 200 == shown.execute_script("return last")
    assert shown.find_element("id", "play").text == "play"


def test_scenes_and_plots_are_drawn(shown: Any) -> None:
    pause(shown)
    assert shown.execute_script("return document.querySelectorAll('canvas').length") == 8
    for number in range(8):
        pixels = picture(shown, number)
        assert len(np.unique(pixels, axis=0)) > (100 if number % 4 == 0 else 20)
    drawn = data_in(Path(shown.current_url.removeprefix("file://")))["colours"]
    pixels = picture(shown, 0)[:, :3]
    total = pixels.sum(axis=1, keepdims=True)
    for name in ("m1", "m2"):  # in any shade
        hue = np.array(drawn[name]) / sum(drawn[name])
        assert ((np.abs(pixels / total - hue).max(axis=1) < 0.03) & (total[:, 0] > 200)).sum() > 40


def test_the_slider_and_the_plots_set_the_time(shown: Any) -> None:
    from selenium.webdriver import ActionChains

    pause(shown)
    before = picture(shown, 0)
    slide = "const s = document.getElementById('time'); s.value = 120; s.dispatchEvent(new Event('input'))"
    shown.execute_script(slide)
    assert shown.find_element("id", "clock").text.startswith("2.40 of 4.00")
    assert (picture(shown, 0) != before).any()
    plot = shown.find_elements("tag name", "canvas")[5]
    ActionChains(shown).move_to_element_with_offset(plot, -plot.size["width"] // 4, 0).click().perform()
    assert 20 < step_of(shown) < 80


def test_dragging_turns_both_scenes_and_a_double_click_turns_them_back(shown: Any) -> None:
    from selenium.webdriver import ActionChains

    pause(shown)
    before = [picture(shown, number) for number in (0, 4)]
    scene = shown.find_elements("tag name", "canvas")[0]
    ActionChains(shown).move_to_element(scene).click_and_hold().move_by_offset(80, 30).release().perform()
    assert shown.execute_script("return camera.azimuth") == pytest.approx(-62 - 32)
    assert all((picture(shown, number) != old).any() for number, old in zip((0, 4), before, strict=True))
    ActionChains(shown).double_click(scene).perform()
    assert all((picture(shown, number) == old).all() for number, old in zip((0, 4), before, strict=True))


@pytest.mark.parametrize(("speed", "step"), [(0.25, 1), (1, 4), (4, 16)])
def test_the_speed_is_kept(shown: Any, speed: float, step: int) -> None:
    script = """go(0); clock.playing = true; clock.speed = arguments[0]; before = 1000; tick(1080);
    clock.playing = false; return clock.step;"""
    assert shown.execute_script(script, speed) == pytest.approx(step)


@pytest.mark.parametrize(("pull", "redder"), [(1.0, True), (-1.0, False)])
def test_springs_are_red_where_they_pull_and_blue_where_they_push(shown: Any, pull: float, redder: bool) -> None:
    pause(shown)
    shown.execute_script("for (const one of data.players[0].pulls) one.fill(arguments[0]); draw()", pull)
    red, green, blue = picture(shown, 0)[:, :3].T
    reds = ((red > green + 60) & (abs(green - blue) < 30)).sum()
    blues = ((blue > red + 60) & (blue > green + 40)).sum()
    assert (reds > 10 * blues + 100) if redder else (blues > 10 * reds + 100)


def test_it_fits_a_phone_and_a_thumb_scrolls_past_it(shown: Any) -> None:
    shown.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 360, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    )
    try:
        pause(shown)
        assert shown.execute_script("return document.documentElement.scrollWidth") <= 360
        assert shown.execute_script("return getComputedStyle(document.querySelector('canvas')).touchAction") == "pan-y"
        texts = """const pen = CanvasRenderingContext2D.prototype, fill = pen.fillText, ends = [];
        pen.fillText = function (text, x, y) {
          ends.push(this.textAlign === "right" ? x : x + this.measureText(text).width);
          fill.call(this, text, x, y);
        };
        draw();
        pen.fillText = fill;
        return Math.max(...ends) - document.querySelector("canvas.plot").clientWidth;"""
        assert shown.execute_script(texts) <= 0
    finally:
        shown.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_numbers_have_a_sign_where_they_need_one(shown: Any) -> None:
    assert shown.execute_script("return [-0.001, -1.5, 0, 2].map(written)") == [
        "0.00",
        "\N{MINUS SIGN}1.50",
        "0.00",
        "2.00",
    ]


def test_all_is_in_the_picture_from_every_side(shown: Any) -> None:
    outside = """let worst = 0;
    for (camera.azimuth = -180; camera.azimuth < 180; camera.azimuth += 30)
      for (camera.elevation = -80; camera.elevation <= 80; camera.elevation += 20)
        for (const player of data.players)
          for (const row of player.bodies)
            for (const i of [0, 3, 6]) {
              const p = lens(400, 400).project(row.slice(i, i + 3));
              worst = Math.max(worst, Math.abs(p.x - 200), Math.abs(p.y - 200));
            }
    Object.assign(camera, HOME);
    return worst;"""
    assert shown.execute_script(outside) < 195


def test_the_screenshot_is_not_blank(shown: Any, tmp_path: Path) -> None:
    pause(shown)
    assert shown.save_screenshot(str(tmp_path / "page.png"))
    with Image.open(tmp_path / "page.png") as image:
        assert len(image.convert("RGB").getcolors(10_000_000) or ()) > 500
