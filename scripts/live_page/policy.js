// A trained policy, as agents/residual.py runs it: LQR's action plus what a network adds to it.

function unpacked({ bits, shape, data }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const numbers = Array.from({ length: (bytes.length * 8) / bits }, (_, i) =>
    bits === 32 ? view.getFloat32(4 * i, true) : half(view.getUint16(2 * i, true)));
  if (shape.length === 1) return numbers;
  return Array.from({ length: shape[0] }, (_, row) => numbers.slice(row * shape[1], (row + 1) * shape[1]));
}

// A 16-bit float, IEEE 754.
function half(word) {
  const sign = word & 0x8000 ? -1 : 1, exponent = (word >> 10) & 31, fraction = word & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  return exponent === 31 ? (fraction ? NaN : sign * Infinity) : sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
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
