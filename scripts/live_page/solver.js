// Integration. The formulas above come from physics.py and the tables from SciPy and integrators.py; here are only the
// loops. A state has 18 numbers: positions of the anchor, mass 1 and mass 2 (m), then their velocities (m/s). A 19th goes
// with them here, what drag has dissipated (J).

const SIZE = 18;
const ALL = 19;

// Root mean square of numbers, each relative to its scale. An anchor that is held adds zeros, which don't count.
function norm(values, scale, moving) {
  let sum = 0;
  for (let i = 0; i < SIZE; i++) sum += (values[i] / scale[i]) ** 2;
  return Math.sqrt(sum / moving);
}

function scaleOf(a, b, tolerance) {
  return a.map((value, i) => tolerance * (1 + Math.max(Math.abs(value), Math.abs(b[i]))));
}

// One pendulum on its way, its energy budget kept. `solver` is {method: "RK45" | "DOP853", tolerance} with the step
// control of SciPy's solve_ivp (relative and absolute tolerance the same), or {method: "splitting", step} in seconds.
class Simulation {
  constructor(parameters, state, solver, free = false) {
    this.p = { ...parameters };
    this.solver = solver;
    this.free = free;
    this.c = (free ? constantsFree : constantsHeld)(this.p, []);
    this.r = dragRates(this.p, []);
    this.u = [0, 0, 0];
    this.t = this.before = this.evaluations = 0;
    this.y = [...state.slice(0, SIZE), 0];
    if (!free) this.y.fill(0, 9, 12);
    this.moving = free ? 18 : 12;
    this.f = this.slope(this.y);
    this.last = { y: this.y, f: this.f };
    this.start = totalEnergy(this.y, this.p);
    this.work = this.steps = 0;
    this.step = solver.method === "splitting" ? solver.step : this.firstStep(Infinity);
  }

  slope(y) {
    this.evaluations++;
    const out = derivatives(y, this.u, this.c, this.r, []);
    out.push(dragPower(y, this.p));
    return out;
  }

  get energy() {
    return totalEnergy(this.y, this.p);
  }

  // The paper's equation (42): the change of energy that neither work nor drag accounts for.
  get error() {
    const change = this.energy - this.start - this.work + this.y[SIZE];
    return this.start === 0 ? absoluteError(change) : relativeError(change, this.start);
  }

  get failed() {
    return !this.y.every(Number.isFinite);
  }

  // The force on the anchor from now on, N.
  push(force) {
    this.u = [...force];
    this.f = this.slope(this.y);
  }

  // Goes to a time, s, exactly; or with `beyond` to the end of the step that reaches it.
  run(time, beyond = false) {
    while (this.t < time && !this.failed) {
      const anchor = this.y.slice(0, 3);
      this.before = this.t;
      this.last = { y: this.y, f: this.f };
      if (this.solver.method === "splitting") this.split(beyond ? Infinity : time);
      else this.embedded(beyond ? Infinity : time);
      for (let i = 0; i < 3; i++) this.work += this.u[i] * (this.y[i] - anchor[i]);
      this.steps++;
    }
    return this;
  }

  // Between the last two steps a cubic with the right slopes, for the eye alone.
  at(time) {
    const h = this.t - this.before;
    if (!(h > 0)) return this.y;
    const s = Math.min(1, Math.max(0, (time - this.before) / h));
    const b = s * s * (3 - 2 * s), c = s * (1 - s) * (1 - s) * h, d = s * s * (s - 1) * h;
    return this.y.map((y, i) => (1 - b) * this.last.y[i] + b * y + c * this.last.f[i] + d * this.f[i]);
  }

  firstStep(longest) {
    const { errorOrder } = TABLES[this.solver.method];
    const scale = scaleOf(this.y, this.y, this.solver.tolerance);
    const d0 = norm(this.y, scale, this.moving), d1 = norm(this.f, scale, this.moving);
    const h0 = Math.min(d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : (0.01 * d0) / d1, longest);
    const f1 = this.slope(this.y.map((y, i) => y + h0 * this.f[i]));
    const d2 = norm(f1.map((f, i) => f - this.f[i]), scale, this.moving) / h0;
    const largest = Math.max(d1, d2);
    const h1 = largest <= 1e-15 ? Math.max(1e-6, h0 * 1e-3) : (0.01 / largest) ** (1 / (errorOrder + 1));
    return Math.min(100 * h0, h1, longest);
  }

  // One accepted step of an embedded Runge-Kutta pair.
  embedded(limit) {
    const { A, B, errorOrder } = TABLES[this.solver.method];
    const exponent = -1 / (errorOrder + 1), y = this.y;
    let h = Math.max(this.step, 1e-14 * Math.max(1, this.t)), rejected = false;
    for (;;) {
      const end = this.t + h >= limit ? limit : this.t + h;
      const taken = end - this.t, k = [this.f];
      const combined = (row) => {
        const next = [...y];
        row.forEach((weight, j) => {
          if (weight !== 0) for (let i = 0; i < ALL; i++) next[i] += taken * weight * k[j][i];
        });
        return next;
      };
      for (let s = 1; s < B.length; s++) k.push(this.slope(combined(A[s].slice(0, s))));
      const next = combined(B);
      k.push(this.slope(next));
      const error = this.estimate(k, taken, scaleOf(y, next, this.solver.tolerance));
      if (!(error < 1) && h > 1e-14 * Math.max(1, this.t) && !Number.isNaN(error)) {
        h = taken * Math.max(0.2, 0.9 * error ** exponent);
        rejected = true;
        continue;
      }
      this.t = end;
      this.y = next;
      this.f = k[B.length];
      const factor = error === 0 ? 10 : Math.min(10, Math.max(0.2, 0.9 * error ** exponent));
      this.step = taken * (rejected ? Math.min(1, factor) : factor);
      return;
    }
  }

  // Estimated error of a step in units of what is allowed; two estimates are joined as Dormand-Prince 8(5,3) has it.
  estimate(k, h, scale) {
    const sums = TABLES[this.solver.method].errors.map((weights) => {
      const e = new Array(SIZE).fill(0);
      weights.forEach((weight, j) => {
        if (weight !== 0) for (let i = 0; i < SIZE; i++) e[i] += weight * k[j][i];
      });
      return norm(e, scale, this.moving);
    });
    if (sums.length === 1) return h * sums[0];
    return sums[0] === 0 ? 0 : (h * sums[0] ** 2) / Math.sqrt(sums[0] ** 2 + 0.01 * sums[1] ** 2);
  }

  // One step of the splitting: kicks and drifts in turn, drag solved exactly inside the drifts.
  split(limit) {
    const { kicks, drifts } = TABLES.splitting;
    const left = limit - this.t;
    // Equal steps, none longer than what was chosen, that end where they should.
    const h = Number.isFinite(left) ? left / Math.ceil(left / this.solver.step - 1e-9) : this.solver.step;
    const y = [...this.y], a = [];
    for (let s = 0; s < kicks.length; s++) {
      if (s === 0 || drifts[s - 1] !== 0) accelerations(y, this.u, this.c, a);
      this.evaluations++;
      const kick = kicks[s] * h, drift = drifts[s] * h;
      for (let i = 0; i < 9; i++) y[9 + i] += kick * a[i];
      const kinetic = kineticEnergy(y, this.p);
      for (let i = 0; i < 9; i++) {
        const rate = this.r[Math.floor(i / 3)], v = y[9 + i];
        const share = -Math.expm1(-rate * drift);
        y[i] += (rate === 0 ? drift : share / rate) * v;
        y[9 + i] = v - share * v;
      }
      y[SIZE] += kinetic - kineticEnergy(y, this.p);
    }
    this.t += h;
    if (limit - this.t < 1e-12) this.t = limit;
    this.y = y;
    this.f = this.slope(y);
  }
}
