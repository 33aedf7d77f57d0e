// Curves over time, one below the other, with one cursor for all.

const CURVE_PAINT = ["--curve1", "--curve2", "--curve3"];

class Charts {
  constructor(box, data, machines, seek) {
    this.box = box;
    this.duration = data.duration;
    this.machines = machines;
    this.seek = seek;
    this.charts = [];
  }

  show(index) {
    this.box.replaceChildren();
    const machine = this.machines[index];
    this.charts = machine.charts.map((about) => {
      const figure = document.createElement("figure"), head = document.createElement("figcaption");
      const canvas = document.createElement("canvas");
      const title = document.createElement("b");
      title.textContent = `${about.title} [${about.unit}]`;
      head.append(title);
      const values = about.curves.map((curve, k) => {
        const label = document.createElement("span"), value = document.createElement("output");
        label.className = `curve curve${k + 1}`;
        label.textContent = curve.label;
        label.append(" ", value);
        head.append(label);
        return value;
      });
      figure.append(head, canvas);
      this.box.append(figure);
      const chart = { about, canvas, values, track: machine.track };
      const point = (e) => {
        const r = canvas.getBoundingClientRect();
        this.seek((e.clientX - r.left - PAD) / Math.max(r.width - 2 * PAD, 1) * this.duration);
      };
      canvas.addEventListener("pointerdown", (e) => {
        canvas.setPointerCapture(e.pointerId);
        point(e);
      });
      canvas.addEventListener("pointermove", (e) => { if (e.buttons) point(e); });
      return chart;
    });
    this.resize();
  }

  // Draws the curves anew where the size or the colours changed.
  resize() {
    for (const chart of this.charts) {
      const { canvas } = chart, ratio = Math.min(devicePixelRatio || 1, 2);
      canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
      canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
      chart.picture = drawCurves(chart, this.duration, ratio);
    }
  }

  cursor(t) {
    for (const { canvas, picture, about, values, track } of this.charts) {
      const g = canvas.getContext("2d"), pad = PAD * (canvas.width / Math.max(canvas.clientWidth, 1));
      g.clearRect(0, 0, canvas.width, canvas.height);
      g.drawImage(picture, 0, 0);
      g.fillStyle = colourOf("--cursor");
      g.fillRect(pad + t / this.duration * (canvas.width - 2 * pad) - 1, 0, 2, canvas.height);
      about.curves.forEach((curve, k) => {
        const v = track.at(curve.column, t) * curve.factor;
        values[k].textContent = Number.isFinite(v) ? readable(v) : "–";
      });
    }
  }
}

const PAD = 8;  // at both ends of charts and time line [px]
const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const readable = (v) => v.toFixed(Math.abs(v) < 10 ? 1 : 0).replace(/^-(?=0\.?0*$)/, "").replace("-", "−");

// Limits that hold all but the rarest values, so that one outlier does not flatten the rest.
function bounds(chart) {
  const all = [];
  for (const { column, factor } of chart.about.curves) {
    for (const v of chart.track.columns[column]) if (Number.isFinite(v)) all.push(v * factor);
  }
  all.sort((a, b) => a - b);
  let low = Math.min(0, all[Math.floor(0.004 * all.length)] ?? 0);
  let high = Math.max(0, all[Math.ceil(0.996 * all.length) - 1] ?? 1);
  if (high - low < 1e-6) high = low + 1;
  const slack = 0.08 * (high - low);
  return [low < 0 ? low - slack : 0, high + slack];
}

function niceStep(span) {
  const raw = span / 3, power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map((m) => m * power).find((m) => m >= raw);
}

function drawCurves(chart, duration, ratio) {
  const { width, height } = chart.canvas, picture = document.createElement("canvas");
  picture.width = width;
  picture.height = height;
  const g = picture.getContext("2d"), [low, high] = bounds(chart), pad = PAD * ratio;
  const x = (t) => pad + t / duration * (width - 2 * pad), y = (v) => height - (v - low) / (high - low) * height;
  g.font = `${10 * ratio}px system-ui, sans-serif`;
  g.lineWidth = 1;
  const step = niceStep(high - low);
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
    g.strokeStyle = colourOf(Math.abs(v) < step * 1e-6 ? "--axis" : "--grid");
    g.beginPath(); g.moveTo(0, y(v)); g.lineTo(width, y(v)); g.stroke();
    g.fillStyle = colourOf("--soft");
    if (y(v) > 11 * ratio) g.fillText(`${Number(v.toPrecision(6))}`.replace("-", "−"), 2 * ratio, y(v) - 2 * ratio);
  }
  chart.about.curves.forEach(({ column, factor }, k) => {
    const values = chart.track.columns[column], { times: at } = chart.track;
    g.strokeStyle = colourOf(CURVE_PAINT[k]);
    g.lineWidth = 1.5 * ratio;
    g.beginPath();
    let down = false;
    for (let i = 0; i < values.length; i++) {
      const v = values[i] * factor;
      if (!Number.isFinite(v)) { down = false; continue; }
      if (down) g.lineTo(x(at[i]), y(v)); else g.moveTo(x(at[i]), y(v));
      down = true;
    }
    g.stroke();
  });
  return picture;
}
