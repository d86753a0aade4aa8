"use strict";
// Draws an episode that was worked out beforehand: scenes in perspective, plots beside them, one time for all.

const data = JSON.parse(document.getElementById("data").textContent);
const colour = Object.fromEntries(Object.entries(data.colours).map(([name, rgb]) => [name, `rgb(${rgb})`]));
const last = Math.max(...data.players.map((player) => player.bodies.length)) - 1;
const HOME = { azimuth: -62, elevation: 14, zoom: 1 };
const TRAIL = 2; // s
const COILS = 10, COIL_POINTS = 14;
const camera = { ...HOME };
const clock = { step: 0, playing: last > 0, speed: 1, drawn: 0 };

// --- vectors and the camera ---

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.hypot(...a);
const mixed = (a, b, share) => `rgb(${a.map((x, i) => Math.round(x + (b[i] - x) * share))})`;

/** A function from a point in space to x, y (pixels), pixels per metre, and how near it is to the eye (m). */
function lens(width, height) {
  const a = (camera.azimuth * Math.PI) / 180, e = (camera.elevation * Math.PI) / 180;
  const right = [-Math.sin(a), Math.cos(a), 0];
  const eye = [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
  const up = cross(eye, right);
  const focal = Math.min(width, height) / 2 / Math.tan(data.fieldOfView / 2);
  const distance = (0.93 * data.radius) / Math.sin(data.fieldOfView / 2) / camera.zoom;
  const project = (point) => {
    const from = add(point, data.centre, -1), near = dot(from, eye);
    const scale = focal / Math.max(distance - near, 0.05 * distance);
    return { x: width / 2 + dot(from, right) * scale, y: height / 2 - dot(from, up) * scale, scale, near };
  };
  return { project, eye };
}

// --- the scene ---

function line(pen, points, stroke, width) {
  pen.strokeStyle = stroke;
  pen.lineWidth = width;
  pen.beginPath();
  points.forEach((p, i) => (i ? pen.lineTo(p.x, p.y) : pen.moveTo(p.x, p.y)));
  pen.stroke();
}

function disc(pen, p, radius, fill, flat = 1) {
  pen.fillStyle = fill;
  pen.beginPath();
  pen.ellipse(p.x, p.y, radius, radius * flat, 0, 0, 2 * Math.PI);
  pen.fill();
}

function drawGround(pen, view, bodies) {
  const spacing = [0.5, 1, 2, 5, 10, 20, 50, 100].find((s) => s > data.radius / 3.5) || 200;
  const [x0, y0] = data.centre.map((c) => Math.round(c / spacing) * spacing);
  const at = (i, j) => view.project([x0 + i * spacing, y0 + j * spacing, data.floor]);
  for (let i = -5; i <= 5; i++) {
    for (let j = -5; j < 5; j++) {
      pen.globalAlpha = Math.max(0, 0.6 * (1 - Math.hypot(i, j + 0.5) / 5.2));
      line(pen, [at(i, j), at(i, j + 1)], colour.grid, 1);
      line(pen, [at(j, i), at(j + 1, i)], colour.grid, 1);
    }
  }
  pen.globalAlpha = 1;
  const feet = bodies.map((b) => view.project([b[0], b[1], data.floor]));
  line(pen, feet, colour.shadow, 2);
  return { feet, spacing };
}

function drawTrails(pen, view, player, step) {
  const count = Math.round(TRAIL / data.period);
  pen.lineCap = "butt"; // round ends would overlap, and show
  for (const [body, name] of [[1, "m1"], [2, "m2"]]) {
    let before = null;
    for (let i = Math.max(0, step - count); i <= step; i++) {
      const row = player.bodies[i], now = view.project(row.slice(3 * body, 3 * body + 3));
      if (before) {
        pen.globalAlpha = 0.8 * (1 - (step - i) / count) ** 1.5;
        line(pen, [before, now], colour[name], 2);
      }
      before = now;
    }
  }
  pen.globalAlpha = 1;
  pen.lineCap = "round";
}

function drawTask(pen, view, player, anchor) {
  for (const axis of data.actuated ? data.axes : "") {
    const ends = [-1, 1].map((side) => anchor.map((x, i) => (i === "xyz".indexOf(axis) ? side * data.travel : x)));
    const seen = ends.map(view.project);
    pen.globalAlpha = 0.35;
    line(pen, seen, colour.anchor, 1);
    pen.globalAlpha = 1;
    pen.fillStyle = colour.dim;
    pen.fillText(axis, seen[1].x + 5, seen[1].y - 4);
  }
  (player.rest || []).forEach((place, i) => {
    const p = view.project(add(anchor, place));
    pen.globalAlpha = 0.6;
    pen.strokeStyle = colour[`m${i + 1}`];
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(p.x, p.y, Math.max(6, 1.45 * player.sizes[i + 1] * p.scale), 0, 2 * Math.PI);
    pen.stroke();
    pen.globalAlpha = 1;
  });
}

/** A coil, thinner when it is longer; red where it pulls, blue where it pushes. */
function drawSpring(pen, view, player, from, to, natural, pull) {
  const along = add(to, from, -1), length = size(along);
  if (!length) return;
  const way = along.map((x) => x / length);
  let side = cross(way, view.eye);
  side = size(side) > 1e-6 ? side.map((x) => x / size(side)) : [1, 0, 0];
  const depth = cross(side, way), slim = Math.min(Math.max(natural / length, 0.3), 1.4);
  const strong = Math.min(Math.abs(pull), 1) ** 0.8;
  const full = pull > 0 ? data.colours.pull : data.colours.push;
  const shade = data.colours.slack.map((x, i) => x + (full[i] - x) * strong), stroke = `rgb(${shade.map(Math.round)})`;
  const points = [];
  for (let i = 0; i <= COILS * COIL_POINTS; i++) {
    const share = i / (COILS * COIL_POINTS), turn = (2 * Math.PI * i) / COIL_POINTS;
    const radius = 0.048 * data.reach * slim * Math.min(9 * Math.min(share, 1 - share), 1);
    const place = add(add(add(from, along, share), side, radius * Math.sin(turn)), depth, radius * Math.cos(turn));
    points.push(view.project(place));
  }
  const width = Math.min(Math.max(0.013 * data.reach * points[0].scale * Math.sqrt(slim), 1), 5);
  for (const front of [false, true]) { // what is behind first, and darker
    pen.strokeStyle = front ? stroke : mixed(shade, data.colours.sky, 0.5);
    pen.lineWidth = width;
    pen.beginPath();
    for (let i = 0; i < COILS * COIL_POINTS; i++) {
      if (Math.cos((2 * Math.PI * (i + 0.5)) / COIL_POINTS) > 0 !== front) continue;
      pen.moveTo(points[i].x, points[i].y);
      pen.lineTo(points[i + 1].x, points[i + 1].y);
    }
    pen.stroke();
  }
}

function drawMass(pen, p, radius, rgb) {
  const shade = pen.createRadialGradient(p.x - 0.35 * radius, p.y - 0.45 * radius, 0.1 * radius, p.x, p.y, radius);
  shade.addColorStop(0, mixed(rgb, [255, 255, 255], 0.6));
  shade.addColorStop(0.35, mixed(rgb, [0, 0, 0], 0.05));
  shade.addColorStop(1, mixed(rgb, [0, 0, 0], 0.65));
  disc(pen, p, radius, shade);
}

function drawForce(pen, view, anchor, force) {
  const tip = add(anchor, force, (0.35 * data.reach) / data.maxForce);
  const [a, b] = [anchor, tip].map(view.project), length = Math.hypot(b.x - a.x, b.y - a.y);
  if (length < 3) return;
  const head = Math.min(12, length), ux = (b.x - a.x) / length, uy = (b.y - a.y) / length;
  line(pen, [a, { x: b.x - 0.7 * head * ux, y: b.y - 0.7 * head * uy }], colour.force, 3);
  pen.fillStyle = colour.force;
  pen.beginPath();
  pen.moveTo(b.x, b.y);
  pen.lineTo(b.x - head * (ux - 0.45 * uy), b.y - head * (uy + 0.45 * ux));
  pen.lineTo(b.x - head * (ux + 0.45 * uy), b.y - head * (uy - 0.45 * ux));
  pen.fill();
}

function drawScene(canvas, player) {
  const { pen, width, height } = fitted(canvas);
  const step = Math.min(clock.drawn, player.bodies.length - 1), row = player.bodies[step];
  const bodies = [0, 3, 6].map((i) => row.slice(i, i + 3)), view = lens(width, height);
  const sky = pen.createLinearGradient(0, 0, 0, height);
  sky.addColorStop(0, colour.sky);
  sky.addColorStop(1, colour.ground);
  pen.fillStyle = sky;
  pen.fillRect(0, 0, width, height);
  pen.font = "13px system-ui, DejaVu Sans, sans-serif";
  const { feet, spacing } = drawGround(pen, view, bodies);
  const flat = Math.abs(Math.sin((camera.elevation * Math.PI) / 180));
  for (const i of [1, 2]) disc(pen, feet[i], player.sizes[i] * feet[i].scale, colour.shadow, flat);
  drawTrails(pen, view, player, step);
  drawTask(pen, view, player, bodies[0]);
  const seen = bodies.map(view.project), L = [player.constants.L1, player.constants.L2];
  const parts = [{ near: seen[0].near, draw: () => {
    const half = Math.max(player.sizes[0] * seen[0].scale, 4);
    pen.fillStyle = colour.anchor;
    pen.fillRect(seen[0].x - half, seen[0].y - (data.actuated ? half : half / 3), 2 * half, data.actuated ? 2 * half : half / 1.5);
  } }];
  for (const i of [1, 2]) {
    const radius = Math.max(player.sizes[i] * seen[i].scale, 4);
    parts.push({ near: seen[i].near, draw: () => drawMass(pen, seen[i], radius, data.colours[`m${i}`]) });
    if (player.tied[i - 1]) {
      const spring = () => drawSpring(pen, view, player, bodies[i - 1], bodies[i], L[i - 1], player.pulls[i - 1][step]);
      parts.push({ near: (seen[i - 1].near + seen[i].near) / 2, draw: spring });
    }
  }
  parts.sort((a, b) => a.near - b.near).forEach((part) => part.draw());
  if (data.actuated) drawForce(pen, view, bodies[0], player.force[step]);
  pen.fillStyle = colour.dim;
  pen.textAlign = "right";
  pen.fillText(`grid ${spacing} m`, width - 12, height - 10);
  pen.textAlign = "left";
}

// --- the plots ---

const PLOTS = [
  { title: "energy (J)", curves: (player) => [["excess", "ink", player.excess], ["kinetic", "kinetic", player.kinetic]] },
  { title: "spring lengths (m)", curves: (player) => [["spring 1", "m1", player.lengths[0]], ["spring 2", "m2", player.lengths[1]]] },
  { title: "force (N)", actuated: true, curves: (player) => ["x", "y", "z"].map((axis, i) =>
    [axis, ["push", "force", "slack"][i], player.force.map((row) => row[i])]) },
].filter((plot) => data.actuated || !plot.actuated);
PLOTS.forEach((plot) => { // the same scale for all players
  const numbers = data.players.flatMap((player) => plot.curves(player).flatMap((curve) => curve[2]));
  plot.low = Math.min(0, numbers.reduce((a, b) => Math.min(a, b)));
  plot.high = Math.max(plot.low + 1e-9, numbers.reduce((a, b) => Math.max(a, b)));
});
const EDGE = { left: 44, right: 8, top: 20, bottom: 6 };

/** A number with two decimals, without a zero below zero, and with the minus sign of print. */
const written = (value) => value.toFixed(2).replace(/^-(?=0\.00$)/, "").replace("-", "−");

function drawPlot(canvas, player, plot) {
  const { pen, width, height } = fitted(canvas), curves = plot.curves(player);
  const step = Math.min(clock.drawn, player.bodies.length - 1);
  const x = (i) => EDGE.left + ((width - EDGE.left - EDGE.right) * i) / Math.max(last, 1);
  const y = (v) => height - EDGE.bottom - ((height - EDGE.top - EDGE.bottom) * (v - plot.low)) / (plot.high - plot.low);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, DejaVu Sans, sans-serif";
  line(pen, [{ x: x(0), y: y(0) }, { x: x(last), y: y(0) }], colour.ground, 1);
  pen.fillStyle = colour.dim;
  pen.textAlign = "right";
  for (const v of [plot.low, plot.high]) pen.fillText(String(Number(v.toPrecision(3))).replace("-", "−"), EDGE.left - 5, y(v) + 4);
  pen.textAlign = "left";
  pen.fillText(plot.title, EDGE.left, 13);
  const names = curves.map(([name, , numbers]) => `${name} ${written(numbers[step])}`);
  // Beside each other in columns that don't move with the numbers, closer where there is little room.
  const column = Math.min(98, (width - EDGE.left - EDGE.right - 118) / curves.length);
  if (column < 70) pen.font = "10.5px system-ui, DejaVu Sans, sans-serif";
  let place = width < 420 ? width - EDGE.right - column * curves.length : EDGE.left + 130;
  for (const [i, [, hue, numbers]] of curves.entries()) {
    line(pen, numbers.map((v, n) => ({ x: x(n), y: y(v) })), colour[hue], 1.4);
    pen.fillStyle = colour[hue];
    pen.fillText(names[i], place, 13);
    place += column;
  }
  line(pen, [{ x: x(clock.drawn), y: EDGE.top }, { x: x(clock.drawn), y: height - EDGE.bottom }], colour.dim, 1);
  for (const [, hue, numbers] of curves) disc(pen, { x: x(step), y: y(numbers[step]) }, 3, colour[hue]);
}

// --- the page ---

/** The canvas's pen, in CSS pixels whatever the screen's resolution. */
function fitted(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.lineJoin = pen.lineCap = "round";
  return { pen, width, height };
}

const $ = (id) => document.getElementById(id);
const views = [];

function dragged(canvas, move) {
  let from = null;
  canvas.addEventListener("pointerdown", (event) => { from = event; canvas.setPointerCapture(event.pointerId); move(event, 0, 0); });
  canvas.addEventListener("pointermove", (event) => {
    if (from) move(event, event.clientX - from.clientX, event.clientY - from.clientY);
    if (from) from = event;
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
}

function build() {
  for (const player of data.players) {
    const panel = document.createElement("section"), title = document.createElement("h2");
    title.textContent = player.ended ? `${player.name}: ${player.ended}` : player.name;
    const scene = document.createElement("canvas");
    scene.className = "scene";
    panel.append(title, scene);
    dragged(scene, (event, right, down) => {
      camera.azimuth -= 0.4 * right;
      camera.elevation = Math.min(Math.max(camera.elevation + 0.4 * down, -85), 85);
      draw();
    });
    scene.addEventListener("wheel", (event) => {
      event.preventDefault();
      camera.zoom = Math.min(Math.max(camera.zoom * Math.exp(-event.deltaY / 1000), 0.2), 8);
      draw();
    }, { passive: false });
    scene.addEventListener("dblclick", () => { Object.assign(camera, HOME); draw(); });
    views.push(() => drawScene(scene, player));
    for (const plot of PLOTS) {
      const canvas = document.createElement("canvas");
      canvas.className = "plot";
      panel.append(canvas);
      dragged(canvas, (event) => {
        const box = canvas.getBoundingClientRect();
        const share = (event.clientX - box.left - EDGE.left) / (box.width - EDGE.left - EDGE.right);
        go(share * last);
      });
      views.push(() => drawPlot(canvas, player, plot));
    }
    $("players").append(panel);
  }
  const p = data.players[0].constants;
  $("about").textContent = `${data.task} task; ` + Object.entries(p).map(([name, value]) => `${name} ${+value.toPrecision(4)}`).join(", ");
}

function draw() {
  clock.drawn = Math.round(clock.step);
  $("time").value = clock.drawn;
  $("clock").textContent = `${(clock.drawn * data.period).toFixed(2)} of ${(last * data.period).toFixed(2)} s`;
  $("play").textContent = clock.playing ? "pause" : "play";
  views.forEach((view) => view());
}

function go(step) {
  clock.step = Math.min(Math.max(step, 0), last);
  draw();
}

function toggle() {
  clock.playing = !clock.playing;
  if (clock.playing && clock.step >= last) clock.step = 0;
  draw();
}

let before = null;
function tick(now) {
  if (clock.playing && before !== null) {
    clock.step += (clock.speed * Math.min(now - before, 100)) / 1000 / data.period;
    if (clock.step >= last) clock.playing = false;
    go(clock.step);
  }
  before = now;
  requestAnimationFrame(tick);
}

build();
for (const name of ["push", "pull"]) document.querySelector(`.${name}`).style.color = colour[name];
$("time").max = last;
$("time").addEventListener("input", () => go(Number($("time").value)));
$("speed").addEventListener("change", () => { clock.speed = Number($("speed").value); });
$("play").addEventListener("click", toggle);
window.addEventListener("resize", draw);
window.addEventListener("keydown", (event) => {
  if (event.target.matches("input, select, button")) return;
  if (event.key === " ") toggle();
  else if (event.key === "ArrowRight") go(Math.round(clock.step) + 1);
  else if (event.key === "ArrowLeft") go(Math.round(clock.step) - 1);
  else return;
  event.preventDefault();
});
draw();
requestAnimationFrame(tick);
