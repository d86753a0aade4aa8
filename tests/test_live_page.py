"""The page in the browser: it is what the script makes, computes what the package computes, and obeys."""

from __future__ import annotations

import html
import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import spring_pendulum_env
from spring_pendulum_env import Parameters, simulate
from spring_pendulum_env.equilibria import BODY_STATE, full_state

pytest.importorskip("torch", reason="the page holds trained policies")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts"))
make_live_page = importlib.import_module("make_live_page")
agents = importlib.import_module("agents")

START = np.array([0.3, 0.1, -1.2, 0.8, -0.2, -2.1, 0.1, 0.2, 0.0, 0.0, -0.3, 0.0])
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome") or ""
NODE = shutil.which("node") or ""
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]


@pytest.fixture(scope="module")
def page() -> str:
    return str(make_live_page.page())


@pytest.fixture(scope="module")
def run_script(request: pytest.FixtureRequest, page: str, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Runs JavaScript that sets `result`, in the page in real Chromium, or after the numerical core in node."""
    where = request.param
    if where == "quickest":  # for what is arithmetic alone
        where = "node" if NODE else "chromium"

    def in_chromium(script: str) -> Any:
        if not CHROMIUM:
            pytest.skip("no Chromium on the PATH (Debian: apt install chromium)")
        folder = tmp_path_factory.mktemp("chromium")
        listening = (
            "<script>var faults = [];"
            "onerror = (message) => { faults.push(String(message)); };"
            "for (const kind of ['error', 'warn']) console[kind] = (...said) => faults.push(said.join(' '));</script>"
        )
        telling = (
            f"<script>(() => {{ let result; try {{ {script} }} catch (error) {{ faults.push(String(error)); }}"
            "const told = document.createElement('pre'); told.id = 'told';"
            "told.textContent = JSON.stringify({result, faults}); document.body.append(told);"
            "})();</script>"
        )
        file = folder / "page.html"
        file.write_text(page.replace("<head>", "<head>" + listening).replace("</body>", telling + "</body>"))
        command = [
            CHROMIUM,
            *FLAGS,
            f"--user-data-dir={folder / 'profile'}",
        ]
        done = subprocess.run(
            [*command, "--window-size=1200,900", "--dump-dom", file.as_uri()],
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
        told = re.search(r'<pre id="told">(.*?)</pre>', done.stdout, re.DOTALL)
        assert told, f"the page told nothing: {done.stderr[-500:]}"
        answer = json.loads(html.unescape(told[1]))
        assert answer["faults"] == []
        return answer["result"]

    def in_node(script: str) -> Any:
        if not NODE:
            pytest.skip("no node on the PATH")
        text = f'"use strict";\n{make_live_page.core()}\nlet result;\n{script};\nconsole.log(JSON.stringify(result));'
        file = tmp_path_factory.mktemp("node") / "core.js"
        file.write_text(text)
        done = subprocess.run([NODE, str(file)], capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return {"chromium": in_chromium, "node": in_node}[where]


everywhere = pytest.mark.parametrize("run_script", ["chromium", "node"], indirect=True)
quickly = pytest.mark.parametrize("run_script", ["quickest"], indirect=True)
in_browser = pytest.mark.parametrize("run_script", ["chromium"], indirect=True)


def test_committed_page_is_what_the_script_makes(page: str) -> None:
    assert make_live_page.PAGE.read_text(encoding="utf-8") == page, "run scripts/make_live_page.py"
    assert len(page.encode()) < 150_000
    assert not re.search(r"""(src|href)=["'](?!data:)""", page), "the page must stand alone"


@everywhere
def test_motion_is_that_of_simulate(run_script: Any) -> None:
    cases = [
        (Parameters(), {"method": "DOP853", "tolerance": 1e-13}, 1e-9),
        (Parameters(), {"method": "splitting", "step": 0.005}, 1e-9),
        (Parameters(m1=0.7, k2=60.0, L1=1.3, g=3.7), {"method": "DOP853", "tolerance": 1e-13}, 1e-9),
        (Parameters(R1=0.1, R2=0.3), {"method": "splitting", "step": 0.005}, 1e-9),
        # With SciPy's own tables and step control even a coarse motion is SciPy's, errors included.
        (Parameters(), {"method": "RK45", "tolerance": 1e-3}, 1e-9),
        (Parameters(), {"method": "DOP853", "tolerance": 1e-5}, 1e-9),
    ]
    times = [1.0, 2.5, 5.0]
    runs = [[p.as_dict(), full_state(START).tolist(), solver] for p, solver, _ in cases]
    told = run_script(
        f"result = {json.dumps(runs)}.map(([p, y, solver]) => {times}.map((time) => {{"
        "const run = new Simulation(p, y, solver).run(time); return [run.y.slice(0, 18), run.error]; }))"
    )
    for (p, solver, allowed), ours in zip(cases, told, strict=True):
        tolerance = solver.get("tolerance", 1e-13)
        for time, (state, error) in zip(times, ours, strict=True):
            expected = simulate(p, START, [0.0, time], method=str(solver["method"]).replace("splitting", "DOP853"),
                                rtol=tolerance, atol=tolerance)  # fmt: skip
            assert np.abs(np.array(state)[BODY_STATE] - expected.states[-1]).max() < allowed, (p, solver, time)
            if p.R1 == 0.0:
                assert error == pytest.approx(expected.energy_error, rel=1e-6, abs=1e-11)
            else:
                assert error < 1e-11


@quickly
def test_policies_act_as_the_shipped_ones(run_script: Any) -> None:
    generator = np.random.default_rng(0)
    for name in make_live_page.POLICIES:
        policy = agents.load(name)
        states = policy.reference + generator.normal(0.0, 0.05, (20, 18))
        told = run_script(
            f"const policy = new Policy({json.dumps(make_live_page.compiling.policy(name))});"
            f"result = {json.dumps(states.tolist())}.map((state) => policy.action(state))"
        )
        # The weights are rounded to 8 bits on the page.
        np.testing.assert_allclose(told, policy.predict(states)[0], atol=0.02)
        assert float(np.abs(np.array(told)).max()) > 0.1


@quickly
def test_policies_do_their_task_in_the_page(run_script: Any) -> None:
    env: Any = gym.make("SpringPendulumStabilisation-v0", start_scale=1.0).unwrapped
    env.reset(seed=1)
    upside_down = env.state.tolist()
    hanging = full_state(START).tolist()
    policies = json.dumps([make_live_page.compiling.policy(name) for name in make_live_page.POLICIES])
    told = run_script(
        f"result = {policies}.map((json, i) => {{"
        "const policy = new Policy(json);"
        f"const run = new Simulation({json.dumps(Parameters().as_dict())}, [{hanging}, {upside_down}][i],"
        "{method: 'DOP853', tolerance: 1e-9}, true);"
        "policy.drive(run, 10); return [run.y.slice(0, 18), run.error, policy.reference]; })"
    )
    for state, error, reference in told:
        assert np.abs(np.array(state) - reference).max() < 0.05
        assert error < 1e-6


@in_browser
def test_visitor_finds_a_moving_pendulum_and_can_change_it(run_script: Any) -> None:
    told = run_script(
        """
        const until = (time) => {
          for (let frames = 0; frames < 5000 && clock < time; frames++) picture(before + 30);
        };
        const press = (selector) => document.querySelector(selector).click();
        const painted = (id) => {
          const canvas = document.getElementById(id);
          const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
          const seen = new Set();
          for (let i = 0; i < pixels.length; i += 4) seen.add(pixels[i] + "," + pixels[i + 1] + "," + pixels[i + 2]);
          return seen.size;
        };
        const show = (id) => document.getElementById(id).textContent;
        result = {};
        until(1);
        result.scene = painted("scene");
        result.chart = painted("chart");
        result.coarse = simulation.error;

        const slider = document.getElementById("accuracy");
        slider.value = 12;
        slider.oninput();
        until(1);
        result.fine = simulation.error;
        result.legend = document.getElementById("legend").children.length;

        press("#play");
        const box = document.getElementById("scene").getBoundingClientRect();
        const at = scene.project(body(shown, 2));
        const finger = (kind, x, y, target) => target.dispatchEvent(new PointerEvent(kind, {
          pointerId: 1, clientX: box.left + x, clientY: box.top + y, bubbles: true, cancelable: true }));
        finger("pointerdown", at.x, at.y, document.getElementById("scene"));
        finger("pointermove", at.x + 60, at.y - 40, window);
        finger("pointerup", at.x + 60, at.y - 40, window);
        scene.prepare(shown, -0.95, 0);
        const moved = scene.project(body(shown, 2));
        result.dragged = Math.hypot(moved.x - at.x - 60, moved.y - at.y + 40);
        const azimuth = scene.azimuth;
        finger("pointerdown", 5, 150, document.getElementById("scene"));
        finger("pointermove", 45, 150, window);
        finger("pointerup", 45, 150, window);
        result.turned = azimuth - scene.azimuth;

        press("[data-control=damping]");
        press("#play");
        until(1);
        result.free = simulation.c[0];
        result.force = show("force");
        press("[data-control='']");
        result.held = simulation.c[0];
        const mass = document.querySelector("#constants input");
        mass.value = 3;
        mass.oninput();
        result.mass = simulation.p.m1;
        press("[data-method=splitting]");
        result.label = curves.at(-1).label;
        """
    )
    assert told["scene"] > 50
    assert told["chart"] > 3
    assert told["fine"] < 1e-3 * told["coarse"]
    assert told["legend"] == 2
    assert told["dragged"] < 1.0
    assert told["turned"] == pytest.approx(0.32)
    assert told["free"] == 1.0 / spring_pendulum_env.Parameters().m0
    assert told["held"] == 0.0
    assert float(told["force"].split()[0]) > 0.0
    assert told["mass"] == 3.0
    assert told["label"] == "splitting, 20 ms"


@in_browser
def test_springs_are_red_where_they_pull_and_blue_where_they_push(run_script: Any) -> None:
    told = run_script(
        """
        picture(before + 30); // sets the camera
        result = [1.4, 1, 0.6].map((length) => {
          const seen = [];
          scene.line = (points, colour) => seen.push(colour);
          scene.spring([0, 0, 0], [0, 0, -length], 1, colours, false);
          delete scene.line;
          return numbers(seen.at(-1)); // the half of the coil that is in front
        });
        """
    )
    pulled, slack, pressed = np.array(told)
    assert pulled[0] - pulled[2] > 80 and pressed[2] - pressed[0] > 80
    assert abs(slack[0] - slack[2]) < 40
