// The page: what is shown, and what the visitor may do.

const $ = (id) => document.getElementById(id);
const CURVES = 5; // shown at once
const STEPS = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002]; // of the splitting, s
const FRAME = 0.03; // s of computing for each picture at most; a slow machine shows slow motion
const policies = Object.fromEntries(DATA.policies.map((json) => [json.name, new Policy(json)]));
const scene = new Scene($("scene"));

const chosen = {
  parameters: { ...DATA.parameters },
  start: DATA.starts[0].state,
  control: null,
  method: "RK45",
  tolerance: 1e-3,
  step: 0.02,
  playing: !matchMedia("(prefers-reduced-motion: reduce)").matches,
  speed: 1,
  ghost: true,
};
let simulation, exact, curves = [], shown, clock = 0, held = null, colours;

function solver() {
  const { method, tolerance, step } = chosen;
  return method === "splitting" ? { method, step } : { method, tolerance };
}

function solverLabel() {
  return chosen.method === "splitting"
    ? `splitting, ${Math.round(chosen.step * 1e4) / 10} ms`
    : `${chosen.method}, ${power(Math.round(Math.log10(chosen.tolerance)))}`;
}

// Starts a motion; `compare` keeps the curves of earlier runs from the same start.
function begin(state, compare = false) {
  chosen.start = [...state];
  const free = chosen.control !== null;
  simulation = new Simulation(chosen.parameters, state, solver(), free);
  exact = free ? null : new Simulation(chosen.parameters, state, { method: "DOP853", tolerance: 1e-13 });
  clock = 0;
  shown = simulation.y;
  scene.forget();
  if (!compare) curves = [];
  const label = solverLabel();
  // What was only passed by on the way to another choice isn't kept.
  curves = curves.filter((curve) => curve.label !== label && curve.points.at(-1)?.[0] > 1).slice(1 - CURVES);
  const taken = curves.map((curve) => curve.number);
  curves.push(Object.assign(new Curve(label), { number: [0, 1, 2, 3, 4].find((number) => !taken.includes(number)) }));
  readColours();
  legend();
  $("message").hidden = true;
}

function advance(seconds) {
  const until = clock + seconds, stop = performance.now() + 1000 * FRAME;
  while (clock < until && performance.now() < stop && !simulation.failed) {
    clock = Math.min(until, clock + 0.02);
    if (chosen.control) policies[chosen.control].drive(simulation, clock);
    else simulation.run(clock, true);
    if (exact) exact.run(clock, true);
    curves.at(-1).add(simulation.t, simulation.error);
    shown = chosen.control ? simulation.y : simulation.at(clock);
    scene.remember(clock, shown);
  }
  if (simulation.failed) {
    chosen.playing = false;
    $("message").hidden = false;
    buttons();
  }
}

const sign = (value, digits) => value.toFixed(digits).replace("-", "−");
const short = (value) => {
  if (value < 1e-16) return "0";
  const n = Math.floor(Math.log10(value));
  return n > -3 && n < 3 ? value.toPrecision(2) : `${(value / 10 ** n).toFixed(1)} · ${power(n)}`;
};

function readOut() {
  $("time").textContent = `${clock.toFixed(1)} s`;
  $("energy").textContent = `${sign(simulation.energy, 2)} J`;
  $("error").textContent = short(simulation.error);
  $("rate").textContent = clock > 0.2 ? `${Math.round(simulation.evaluations / clock).toLocaleString("en")} /s` : "–";
  const compare = exact && chosen.ghost;
  $("offRow").hidden = !compare;
  $("forceRow").hidden = !chosen.control;
  $("force").textContent = `${Math.hypot(...simulation.u).toFixed(1)} N`;
  if (!compare) return;
  const [a, b] = [shown, exact.at(clock)];
  const off = Math.max(...[1, 2].map((i) => Math.hypot(...minus(body(a, i), body(b, i)))));
  $("off").textContent = off < 1e-3 ? `${short(off)} m` : `${off.toFixed(3)} m`;
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  const get = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = "ink faint grid paper spring pulled pressed mass1 mass2 anchor force".split(" ");
  colours = Object.fromEntries(names.map((name) => [name, numbers(get(name))]));
  colours.curves = [1, 2, 3, 4, 5].map((n) => numbers(get(`curve${n}`)));
  curves.forEach((curve) => (curve.colour = colours.curves[curve.number % 5]));
  colours.grid = css(colours.grid);
}

let before = performance.now();
function picture(now) {
  const seconds = Math.min(0.05, Math.max(0, (now - before) / 1000));
  before = now;
  if (chosen.playing && held === null) advance(seconds * chosen.speed);
  scene.prepare(shown, chosen.control && chosen.control !== "damping" ? 0.75 : -0.95, seconds);
  scene.draw({
    state: shown,
    ghost: exact && chosen.ghost && held === null ? exact.at(clock) : null,
    p: chosen.parameters,
    free: chosen.control !== null,
    force: simulation.u,
    maxForce: chosen.control ? policies[chosen.control].maxForce : 1,
    time: clock,
    colours,
  });
  drawChart($("chart"), curves, colours);
  readOut();
}

function frame(now) {
  picture(now);
  requestAnimationFrame(frame);
}

// What is pressed, and what each choice means.
function buttons() {
  document.querySelectorAll("[data-control]").forEach((button) =>
    button.setAttribute("aria-pressed", (button.dataset.control || null) === chosen.control));
  document.querySelectorAll("[data-method]").forEach((button) =>
    button.setAttribute("aria-pressed", button.dataset.method === chosen.method));
  document.querySelectorAll("[data-speed]").forEach((button) =>
    button.setAttribute("aria-pressed", Number(button.dataset.speed) === chosen.speed));
  $("play").textContent = chosen.playing ? "Pause" : "Play";
  const splitting = chosen.method === "splitting";
  $("accuracyName").textContent = splitting ? "Step" : "Tolerance";
  $("accuracyValue").textContent = splitting
    ? `${Math.round(chosen.step * 1e4) / 10} ms` : power(Math.round(Math.log10(chosen.tolerance)));
  $("accuracy").min = splitting ? 0 : 1;
  $("accuracy").max = splitting ? STEPS.length - 1 : 13;
  $("accuracy").value = splitting ? STEPS.indexOf(chosen.step) : -Math.round(Math.log10(chosen.tolerance));
  $("about").textContent = {
    "": "The anchor is held: this is the passive pendulum.",
    damping: "A trained network pushes the anchor until both masses hang still. Throw them about again!",
    "inverted-inverted": "A trained network balances both springs upside down. Switch it off and see them fall.",
  }[chosen.control ?? ""];
}

function legend() {
  $("legend").replaceChildren(...curves.map((curve) => {
    const item = document.createElement("span"), swatch = document.createElement("i");
    swatch.style.background = css(curve.colour);
    item.append(swatch, curve.label);
    return item;
  }));
}

function resolve() {
  buttons();
  begin(chosen.start, true);
}

// A nudge, so that balancing has something to do.
const nudged = (state) => state.map((value, i) => (i > 2 && i < 9 ? value + 0.06 * (2 * Math.random() - 1) : value));

function setControl(name) {
  if (name === chosen.control) return;
  chosen.control = name;
  const state = name && name !== "damping" ? nudged(policies[name].reference) : [...simulation.y.slice(0, 18)];
  begin(state);
  buttons();
}

DATA.starts.forEach((start) => {
  const button = document.createElement("button");
  button.textContent = start.name;
  button.title = start.about;
  button.onclick = () => {
    chosen.playing = true;
    begin(start.nudge ? nudged(start.state) : start.state);
    buttons();
  };
  $("starts").append(button);
});
document.querySelectorAll("[data-control]").forEach((button) =>
  (button.onclick = () => setControl(button.dataset.control || null)));
document.querySelectorAll("[data-method]").forEach((button) => (button.onclick = () => {
  chosen.method = button.dataset.method;
  resolve();
}));
document.querySelectorAll("[data-speed]").forEach((button) => (button.onclick = () => {
  chosen.speed = Number(button.dataset.speed);
  buttons();
}));
$("accuracy").oninput = () => {
  const value = Number($("accuracy").value);
  if (chosen.method === "splitting") chosen.step = STEPS[value];
  else chosen.tolerance = Number(`1e-${value}`);
  resolve();
};
$("play").onclick = () => {
  chosen.playing = !chosen.playing;
  buttons();
};
$("again").onclick = () => begin(chosen.start, true);
$("ghost").onchange = () => (chosen.ghost = $("ghost").checked);

DATA.sliders.forEach(({ names, symbol, unit, low, high, step, about }) => {
  const row = document.createElement("label"), input = document.createElement("input"), output = document.createElement("output");
  row.className = "slider";
  row.title = about;
  input.type = "range";
  Object.assign(input, { min: low, max: high, step, value: chosen.parameters[names[0]] });
  const name = document.createElement("span");
  name.innerHTML = symbol;
  const show = () => (output.textContent = `${Number(input.value)} ${unit}`);
  input.oninput = () => {
    names.forEach((parameter) => (chosen.parameters[parameter] = Number(input.value)));
    show();
    begin(shown.slice(0, 18));
  };
  $("constants").append(row);
  row.append(name, input, output);
  show();
  $("defaults").addEventListener("click", () => {
    input.value = DATA.parameters[names[0]];
    input.oninput();
  });
});

// Drag a mass to move it, anywhere else to look around; the wheel or two fingers zoom.
const fingers = new Map();
let pinch = 0;
$("scene").addEventListener("pointerdown", (event) => {
  const box = $("scene").getBoundingClientRect();
  const [x, y] = [event.clientX - box.left, event.clientY - box.top];
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  event.preventDefault();
  if (fingers.size > 1) {
    pinch = spread();
    return;
  }
  let nearest = event.pointerType === "touch" ? 34 : 24;
  for (const number of [1, 2]) {
    const at = scene.project(body(shown, number));
    const reach = at ? Math.hypot(at.x - x, at.y - y) - scene.radius(chosen.parameters[`m${number}`]) * at.scale / 2 : Infinity;
    if (reach < nearest) [nearest, held] = [reach, number];
  }
  if (held !== null) {
    shown = [...shown.slice(0, 9), ...new Array(9).fill(0)];
    scene.forget();
    document.body.classList.add("holding");
  }
});
addEventListener("pointermove", (event) => {
  const old = fingers.get(event.pointerId);
  if (!old) {
    return;
  }
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  if (fingers.size > 1) {
    scene.zoom = Math.min(4, Math.max(0.3, (scene.zoom * spread()) / (pinch || spread())));
    pinch = spread();
  } else if (held !== null) {
    const box = $("scene").getBoundingClientRect();
    const point = scene.under(event.clientX - box.left, event.clientY - box.top, body(shown, held));
    shown.splice(3 * held, 3, ...point);
  } else {
    scene.azimuth -= 0.008 * (event.clientX - old[0]);
    scene.elevation = Math.min(1.4, Math.max(-0.3, scene.elevation + 0.008 * (event.clientY - old[1])));
  }
});
function release(event) {
  if (!fingers.delete(event.pointerId) || held === null) return;
  held = null;
  document.body.classList.remove("holding");
  begin(shown.slice(0, 18));
}
addEventListener("pointerup", release);
addEventListener("pointercancel", release);
function spread() {
  const [a, b] = [...fingers.values()];
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
$("scene").addEventListener("wheel", (event) => {
  event.preventDefault();
  scene.zoom = Math.min(4, Math.max(0.3, scene.zoom * Math.exp(-0.001 * event.deltaY)));
}, { passive: false });
addEventListener("keydown", (event) => {
  if (event.key !== " " || event.target.closest("button, input, summary")) return;
  event.preventDefault();
  $("play").click();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  readColours();
  legend();
});

begin(chosen.start);
buttons();
requestAnimationFrame(frame);
