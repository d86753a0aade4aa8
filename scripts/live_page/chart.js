// Energy error against time, on a logarithmic scale; earlier runs of the same motion stay for comparison.

const LOWEST = -17, HIGHEST = 2; // powers of ten
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const power = (n) => (n === 0 ? "1" : `10${n < 0 ? "⁻" : ""}${[...String(Math.abs(n))].map((d) => SUPERSCRIPTS[d]).join("")}`);

class Curve {
  constructor(label) {
    this.label = label;
    this.points = [];
    this.gap = 0.02;
  }

  // Keeps the largest error of each short stretch, and makes stretches longer when there are many.
  add(time, error) {
    const last = this.points.at(-1), value = Math.max(10 ** LOWEST, error);
    if (last && time < last[0] + this.gap) {
      last[1] = Math.max(last[1], value);
      return;
    }
    this.points.push([time, value]);
    if (this.points.length < 1500) return;
    this.gap *= 2;
    this.points = this.points.filter((_, i) => i % 2 === 0);
  }
}

function drawChart(canvas, curves, colours) {
  const ratio = Math.min(2, window.devicePixelRatio || 1), c = canvas.getContext("2d");
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  const left = 44, right = width - 12, top = 8, bottom = height - 24;
  const latest = Math.max(0, ...curves.map((curve) => curve.points.at(-1)?.[0] ?? 0));
  let span = 10;
  while (span < latest) span *= 2;
  const x = (time) => left + ((right - left) * time) / span;
  const y = (error) => top + ((HIGHEST - Math.min(HIGHEST, Math.log10(error))) / (HIGHEST - LOWEST)) * (bottom - top);
  c.font = "12px system-ui, sans-serif";
  c.fillStyle = css(colours.faint);
  c.strokeStyle = css(colours.grid);
  c.lineWidth = 1;
  c.textBaseline = "middle";
  c.textAlign = "right";
  for (let n = -16; n <= 0; n += 4) {
    c.beginPath();
    c.moveTo(left, y(10 ** n));
    c.lineTo(right, y(10 ** n));
    c.stroke();
    c.fillText(power(n), left - 6, y(10 ** n));
  }
  c.textBaseline = "alphabetic";
  c.textAlign = "center";
  for (let n = 0; n <= 5; n++) c.fillText(`${(span * n) / 5}${n === 5 ? " s" : ""}`, x((span * n) / 5) - (n === 5 ? 8 : 0), height - 6);
  c.lineJoin = "round";
  curves.forEach((curve, i) => {
    c.globalAlpha = i === curves.length - 1 ? 1 : 0.7;
    c.lineWidth = i === curves.length - 1 ? 2.2 : 1.3;
    c.strokeStyle = css(curve.colour);
    c.beginPath();
    curve.points.forEach(([time, error]) => c.lineTo(x(time), y(error)));
    c.stroke();
  });
  c.globalAlpha = 1;
}
