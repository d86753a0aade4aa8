// The picture: a small perspective drawing on a canvas, far things first.

const FLOOR = -3.6; // m, where the grid lies; lower, and wider, where the pendulum is long
const TRAIL = 3; // s

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (a, d, s) => [a[0] + s * d[0], a[1] + s * d[1], a[2] + s * d[2]];
const body = (state, number) => state.slice(3 * number, 3 * number + 3);

class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    Object.assign(this, { azimuth: -1.1, elevation: 0.2, zoom: 1, reach: 2.6, target: [0, 0, -0.95] });
    this.trails = [[], []];
  }

  // Called for each frame: takes the canvas's size, and lets the camera follow softly.
  prepare(state, height, seconds) {
    const { canvas } = this, ratio = Math.min(2, window.devicePixelRatio || 1);
    this.width = canvas.clientWidth;
    this.height = canvas.clientHeight;
    if (canvas.width !== Math.round(this.width * ratio) || canvas.height !== Math.round(this.height * ratio)) {
      canvas.width = Math.round(this.width * ratio);
      canvas.height = Math.round(this.height * ratio);
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const follow = 1 - Math.exp(-3 * seconds);
    const anchor = body(state, 0);
    const goal = [anchor[0], anchor[1], anchor[2] + height];
    this.target = this.target.map((value, i) => value + follow * (goal[i] - value));
    const far = Math.max(...[0, 1, 2].map((i) => Math.hypot(...minus(body(state, i), this.target))));
    const reach = Math.max(1.9, far + 0.35);
    this.reach += (reach > this.reach ? Math.min(1, 4 * follow) : 0.15 * follow) * (reach - this.reach);
    const [ca, sa, ce, se] = [this.azimuth, this.azimuth, this.elevation, this.elevation].map((angle, i) =>
      i % 2 ? Math.sin(angle) : Math.cos(angle));
    this.eye = [ce * ca, ce * sa, se];
    this.right = [-sa, ca, 0];
    this.up = [-se * ca, -se * sa, ce];
    this.distance = 3.2 * this.reach;
    this.focus = (0.47 * Math.min(this.width, this.height) * this.distance * this.zoom) / this.reach;
  }

  // Where a point is on the canvas, px, and px for a metre there; nothing where it is behind the eye.
  project(point) {
    const p = minus(point, this.target);
    const depth = this.distance - dot(p, this.eye);
    if (depth < 0.1) return null;
    const scale = this.focus / depth;
    return { x: this.width / 2 + scale * dot(p, this.right), y: this.height / 2 - scale * dot(p, this.up), scale, depth };
  }

  // The point at the same depth as `point` that is under a place on the canvas.
  under(x, y, point) {
    const at = this.project(point);
    return along(along(point, this.right, (x - at.x) / at.scale), this.up, (at.y - y) / at.scale);
  }

  line(points, colour, width, alpha = 1, cap = "round") {
    const c = this.context;
    c.globalAlpha = alpha;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.lineCap = cap;
    c.beginPath();
    let drawing = false;
    for (const point of points) {
      const at = point && this.project(point);
      if (at && drawing) c.lineTo(at.x, at.y);
      else if (at) c.moveTo(at.x, at.y);
      drawing = !!at;
    }
    c.stroke();
    c.globalAlpha = 1;
  }

  floor(state, colours) {
    let spacing = 1;
    while (spacing < this.reach / 5) spacing *= 2;
    const reach = 5, floor = FLOOR * spacing;
    const at = (i, j) => [x0 + i * spacing, y0 + j * spacing, floor];
    const [x0, y0] = this.target.map((value) => spacing * Math.round(value / spacing));
    for (let i = -reach; i <= reach; i++)
      for (let j = -reach; j < reach; j++) {
        const alpha = Math.max(0, 1 - Math.hypot(i, j + 0.5) / reach) * 0.8;
        this.line([at(i, j), at(i, j + 1)], colours.grid, 1, alpha);
        this.line([at(j, i), at(j + 1, i)], colours.grid, 1, alpha);
      }
    for (const number of [1, 2]) {
      const [x, y, z] = body(state, number);
      if (z < floor) continue;
      const ring = Array.from({ length: 25 }, (_, k) => this.project([
        x + 0.16 * spacing * Math.cos((k * Math.PI) / 12), y + 0.16 * spacing * Math.sin((k * Math.PI) / 12), floor]));
      if (ring.includes(null)) continue;
      this.context.globalAlpha = 0.18;
      this.context.fillStyle = colours.ink;
      this.context.beginPath();
      ring.forEach((at) => this.context.lineTo(at.x, at.y));
      this.context.fill();
      this.context.globalAlpha = 1;
    }
  }

  // A coil that thins when it is stretched; red in tension, blue in compression.
  spring(a, b, rest, colours, ghost) {
    const d = minus(b, a), long = springLength(...d) || 1e-9, e = d.map((value) => value / long);
    const side = Math.abs(e[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    let p = cross(e, side);
    p = p.map((value) => value / Math.hypot(...p));
    const q = cross(e, p), turns = 13, radius = 0.1 * Math.min(1.5, Math.sqrt(Math.max(rest, 0.3) / long));
    const stretch = Math.max(-1, Math.min(1, ((long - rest) / Math.max(rest, 0.5)) * 1.4));
    const colour = mixed(colours.spring, stretch > 0 ? colours.pulled : colours.pressed, Math.abs(stretch));
    const front = [], back = [], count = turns * 20;
    let last = null;
    for (let n = 0; n <= count; n++) {
      const s = n / count, angle = 2 * Math.PI * turns * s, swell = Math.min(1, Math.min(s, 1 - s) * 14);
      const offset = p.map((value, i) => radius * swell * (Math.cos(angle) * value + Math.sin(angle) * q[i]));
      const point = along(along(a, d, 0.06 + 0.88 * s), offset, 1);
      if (last) (dot(offset, this.eye) >= 0 ? front : back).push(last, point, null);
      last = point;
    }
    const at = this.project(along(a, d, 0.5));
    const width = Math.max(1.2, 0.028 * (at ? at.scale : 60));
    const alpha = ghost ? 0.25 : 1;
    this.line([a, along(a, d, 0.06)], colour, width, alpha);
    this.line([along(a, d, 0.94), b], colour, width, alpha);
    this.line(back, mixed(colour, colours.paper, 0.55), width, alpha);
    this.line(front, colour, width, alpha);
  }

  ball(point, mass, colour, colours, ghost, label) {
    const at = this.project(point), c = this.context;
    if (!at) return;
    const radius = Math.max(5, this.radius(mass) * at.scale);
    c.globalAlpha = ghost ? 0.28 : 1;
    const shade = c.createRadialGradient(at.x - radius * 0.35, at.y - radius * 0.4, radius * 0.1, at.x, at.y, radius);
    shade.addColorStop(0, mixed(colour, [255, 255, 255], 0.65));
    shade.addColorStop(0.6, css(colour));
    shade.addColorStop(1, mixed(colour, [0, 0, 0], 0.35));
    c.fillStyle = shade;
    c.beginPath();
    c.arc(at.x, at.y, radius, 0, 2 * Math.PI);
    c.fill();
    if (label && !ghost && radius > 8) {
      c.fillStyle = "#fff";
      c.font = `600 ${Math.round(Math.min(16, radius))}px system-ui, sans-serif`;
      c.textAlign = "center";
      c.textBaseline = "middle";
      c.fillText(label, at.x, at.y + 1);
    }
    c.globalAlpha = 1;
  }

  radius(mass) {
    return 0.13 * Math.cbrt(mass);
  }

  anchor(point, free, force, maxForce, colours) {
    const c = this.context;
    if (free) {
      for (const axis of [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
        this.line([along([0, 0, 0], axis, -2), along([0, 0, 0], axis, 2)], colours.grid, 1.5);
    }
    const size = free ? 0.12 : 0.22;
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) =>
      this.project([point[0] + size * x, point[1] + size * y, point[2]]));
    if (!corners.includes(null)) {
      c.beginPath();
      corners.forEach((at) => c.lineTo(at.x, at.y));
      c.closePath();
      c.fillStyle = c.strokeStyle = css(colours.anchor);
      c.lineWidth = 4;
      c.lineJoin = "round";
      c.fill();
      c.stroke();
    }
    const strength = Math.hypot(...force);
    if (strength < 0.02 * maxForce) return;
    const tip = along(point, force, 1.2 / maxForce), from = this.project(point), to = this.project(tip);
    if (!from || !to) return;
    const angle = Math.atan2(to.y - from.y, to.x - from.x), head = 11;
    this.line([point, tip], css(colours.force), 4);
    c.fillStyle = css(colours.force);
    c.beginPath();
    c.moveTo(to.x + head * 0.6 * Math.cos(angle), to.y + head * 0.6 * Math.sin(angle));
    for (const turn of [2.5, -2.5]) c.lineTo(to.x + head * Math.cos(angle + turn), to.y + head * Math.sin(angle + turn));
    c.fill();
  }

  remember(time, state) {
    this.trails.forEach((trail, i) => {
      trail.push({ time, point: body(state, i + 1) });
      while (trail.length && trail[0].time < time - TRAIL) trail.shift();
    });
  }

  forget() {
    this.trails = [[], []];
  }

  pendulum(state, p, colours, ghost) {
    const [q0, q1, q2] = [0, 1, 2].map((i) => body(state, i));
    const parts = [
      [along(q0, minus(q1, q0), 0.5), () => this.spring(q0, q1, p.L1, colours, ghost)],
      [along(q1, minus(q2, q1), 0.5), () => this.spring(q1, q2, p.L2, colours, ghost)],
      [along(q1, this.eye, 0.15), () => this.ball(q1, p.m1, colours.mass1, colours, ghost, "1")],
      [along(q2, this.eye, 0.15), () => this.ball(q2, p.m2, colours.mass2, colours, ghost, "2")],
    ];
    parts.sort((a, b) => dot(a[0], this.eye) - dot(b[0], this.eye)).forEach(([, draw]) => draw());
  }

  draw({ state, ghost, p, free, force, maxForce, time, colours }) {
    const c = this.context;
    c.clearRect(0, 0, this.width, this.height);
    this.floor(state, colours);
    this.anchor(body(state, 0), free, force, maxForce, colours);
    this.trails.forEach((trail, i) => {
      for (let n = 1; n < trail.length; n++) {
        const age = (time - trail[n].time) / TRAIL;
        this.line([trail[n - 1].point, trail[n].point], css(i ? colours.mass2 : colours.mass1), 2.2, 0.75 * (1 - age), "butt");
      }
    });
    if (ghost) this.pendulum(ghost, p, colours, true);
    this.pendulum(state, p, colours, false);
  }
}

const numbers = (colour) => (Array.isArray(colour) ? colour : colour.match(/[\d.]+/g).map(Number));
const css = (colour) => (Array.isArray(colour) ? `rgb(${colour.map(Math.round).join(" ")})` : colour);
function mixed(a, b, share) {
  const [x, y] = [numbers(a), numbers(b)];
  return css([0, 1, 2].map((i) => x[i] + share * (y[i] - x[i])));
}
