// A trained policy, as agents/residual.py runs it: LQR's action plus what a network adds to it.

const bytes = (data) => Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0)).buffer;

function floats(data) {
  const view = new DataView(bytes(data));
  return Array.from({ length: view.byteLength / 4 }, (_, i) => view.getFloat32(4 * i, true));
}

// A vector or the rows of a matrix: floats, or whole numbers with a step for each row.
function unpacked({ shape, data, steps }) {
  const numbers = steps ? Array.from(new Int8Array(bytes(data))) : floats(data);
  if (shape.length === 1) return numbers;
  const sizes = steps ? floats(steps) : [];
  return Array.from({ length: shape[0] }, (_, row) =>
    numbers.slice(row * shape[1], (row + 1) * shape[1]).map((value) => value * (sizes[row] ?? 1)));
}

const times = (matrix, vector) => matrix.map((row) => row.reduce((sum, value, i) => sum + value * vector[i], 0));
const limited = (values) => values.map((value) => Math.min(1, Math.max(-1, value)));
const ACTIVATIONS = { silu: (x) => x / (1 + Math.exp(-x)), tanh: Math.tanh, relu: (x) => Math.max(0, x) };

class Policy {
  constructor(json) {
    Object.assign(this, json);
    this.features = unpacked(json.features);
    this.gain = unpacked(json.gain);
    this.layers = json.layers.map((layer) => layer.map(unpacked));
    this.offset = this.body(this.features.map(() => 0));
  }

  body(seen) {
    let values = seen;
    this.layers.forEach(([weight, bias], number) => {
      values = times(weight, values).map((value, i) => value + bias[i]);
      if (number < this.layers.length - 1) values = values.map(ACTIVATIONS[this.activation]);
    });
    return values;
  }

  // Action in [-1, 1] on each axis for a state of 18 numbers, the anchor counted from `centre`.
  action(state, centre = [0, 0, 0]) {
    const away = state.slice(0, 18).map((value, i) => value - this.reference[i] - (i < 9 ? centre[i % 3] : 0));
    const added = this.body(times(this.features, away));
    return limited(limited(times(this.gain, away)).map((value, i) => value + added[i] - this.offset[i]));
  }

  // Drives a simulation to a time, a force held for each control period.
  drive(simulation, time, centre) {
    const period = this.controlPeriod;
    simulation.next ??= 0;
    while (simulation.t < time && !simulation.failed) {
      if (simulation.t >= simulation.next * period - 1e-12) {
        simulation.push(this.action(simulation.y, centre).map((value) => value * this.maxForce));
        simulation.next++;
      }
      simulation.run(simulation.next * period);
    }
  }
}
