// A job from above: the field, what is cut, machines to scale, what they hold and why they wait.

const CAMERAS = [];
const LEAST = 9; // px, that a machine is drawn at least
const isDark = matchMedia("(prefers-color-scheme: dark)");
const tones = () => (isDark.matches
  ? { crop: "#6d6228", cut: "#3a3f33", edge: "#9aa3ab", ink: "#e4e7ea", hollow: "#15181b", combine: "#7fbf6a",
    cart: "#6fb4ea", truck: "#c9ced4", raised: "#4e7d41", pipe: "#ffd27a" }
  : { crop: "#e3cf7c", cut: "#d7d9c4", edge: "#6b6f76", ink: "#22262b", hollow: "#f3f4f5", combine: "#3f8a2d",
    cart: "#1d6fb0", truck: "#4c5158", raised: "#86b877", pipe: "#7a4b00" });

class Job {
  constructor(data) {
    this.data = data;
    this.time = 0;
    this.frames = 0;
    this.pace = 25; // keys move by so many times what they do in a run
    this.canvas = element("view");
    this.pen = this.canvas.getContext("2d");
    this.follows = "";
    this.tracks = data.machines.map((m, k) => new Tracks(["t_s", "x", "y", "heading", "trailer"], data[`track_${k}`]));
    this.fills = data.machines.map((m, k) => new Tracks(["t_s", "kg"], data[`fill_${k}`]));
    this.atTruck = new Tracks(["t_s", "kg"], data.at_truck);
    this.fillPage();
    this.timeline = new Timeline(data, this);
    this.controls();
    isDark.addEventListener("change", () => this.resize());
    addEventListener("resize", () => this.resize());
    this.resize();
    this.whole();
    const asked = new URLSearchParams(location.hash.slice(1));
    if (asked.has("machine")) this.chooseMachine(asked.get("machine"));
    this.seek(Number(asked.get("t") || 0));
    requestAnimationFrame((now) => this.frame(now));
  }

  fillPage() {
    element("about").textContent = this.data.about;
    this.rows = this.data.machines.map((m) => {
      const row = document.createElement("button");
      row.className = "machine";
      row.title = "follow it";
      row.innerHTML = "<b></b><div class=bar><i></i></div><span></span>";
      row.querySelector("b").textContent = m.name;
      row.addEventListener("click", () => this.chooseMachine(this.follows === m.name ? "" : m.name));
      element("machines").append(row);
      element("machine").append(new Option(`follow ${m.name}`, m.name));
      return row;
    });
    this.data.states.forEach((state, k) => {
      const item = document.createElement("li"), spot = document.createElement("i");
      spot.style.background = this.data.colours[k];
      item.append(spot, state);
      element("states").append(item);
    });
  }

  controls() {
    const { canvas } = this;
    let held = null;
    canvas.addEventListener("pointerdown", (e) => { held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointermove", (e) => {
      if (!held) return;
      this.chooseMachine("");
      this.x -= (e.clientX - held[0]) / this.scale;
      this.y += (e.clientY - held[1]) / this.scale;
      held = [e.clientX, e.clientY];
      this.touch();
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      const box = canvas.getBoundingClientRect(), by = Math.exp(-0.0015 * e.deltaY);
      const u = e.clientX - box.left - box.width / 2, v = e.clientY - box.top - box.height / 2;
      const scale = Math.min(Math.max(this.scale * by, 0.05), 60);
      this.x += u / this.scale - u / scale;
      this.y -= v / this.scale - v / scale;
      this.scale = scale;
      this.touch();
    }, { passive: false });
    element("whole").addEventListener("click", () => this.whole());
    element("machine").addEventListener("change", () => this.chooseMachine(element("machine").value));
    element("bars").addEventListener("click", (e) => {
      const box = e.target.getBoundingClientRect();
      this.seek((e.clientX - box.left) / box.width * this.data.duration);
    });
  }

  whole() {
    this.chooseMachine("");
    const points = [...this.data.rings.flat(), ...this.data.truck];
    const [west, east] = [Math.min(...points.map((p) => p[0])), Math.max(...points.map((p) => p[0]))];
    const [south, north] = [Math.min(...points.map((p) => p[1])), Math.max(...points.map((p) => p[1]))];
    [this.x, this.y] = [(west + east) / 2, (south + north) / 2];
    this.scale = Math.min(this.width / (east - west + 50), this.height / (north - south + 50));
    this.touch();
  }

  chooseMachine(name) {
    if (name && !this.data.machines.some((m) => m.name === name)) return;
    if (name && this.follows === "" && this.scale < 4) this.scale = 4;
    this.follows = name;
    element("machine").value = name;
    this.touch();
  }

  seek(t) {
    this.time = Math.min(Math.max(t, 0), this.data.duration);
    this.touch();
  }

  touch() { this.dirty = true; }

  resize() {
    const ratio = devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    [this.width, this.height] = [box.width, box.height];
    [this.canvas.width, this.canvas.height] = [box.width * ratio, box.height * ratio];
    this.ratio = ratio;
    this.drawn = null;
    this.touch();
  }

  frame(now) {
    if (this.timeline.playing && this.last) this.timeline.advance(Math.min((now - this.last) / 1000, 0.1));
    this.last = now;
    if (this.dirty) {
      this.dirty = false;
      this.draw();
      this.timeline.show(this.time);
      this.frames += 1;
    }
    requestAnimationFrame((then) => this.frame(then));
  }

  draw() {
    const { pen, data, time } = this, tone = tones();
    if (this.follows) {
      const track = this.tracks[data.machines.findIndex((m) => m.name === this.follows)];
      [this.x, this.y] = [track.at("x", time), track.at("y", time)];
    }
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.translate(this.width / 2, this.height / 2);
    pen.scale(this.scale, -this.scale);
    pen.translate(-this.x, -this.y);
    this.field(tone);
    this.polygon(data.truck, tone.truck);
    const poses = data.machines.map((m, k) => this.machine(m, this.tracks[k], tone));
    this.pours(poses, tone);
    this.labels(poses, tone);
    this.told();
    this.bars();
  }

  field(tone) {
    const { pen, data, time } = this, { cuts } = data;
    pen.beginPath();
    for (const ring of data.rings) this.outline(ring);
    pen.fillStyle = tone.crop;
    pen.fill("evenodd");
    pen.save();
    pen.clip("evenodd");
    pen.beginPath();
    for (let i = 0; i < cuts.length; i += 7) {
      if (cuts[i + 5] >= time) continue;
      const share = Math.min((time - cuts[i + 5]) / Math.max(cuts[i + 6] - cuts[i + 5], 1e-3), 1);
      const dx = cuts[i + 2] - cuts[i], dy = cuts[i + 3] - cuts[i + 1], half = cuts[i + 4] / 2 / (Math.hypot(dx, dy) || 1);
      const [u, v] = [-dy * half, dx * half], [x, y] = [cuts[i], cuts[i + 1]], [a, b] = [x + share * dx, y + share * dy];
      pen.moveTo(x + u, y + v);
      pen.lineTo(a + u, b + v);
      pen.lineTo(a - u, b - v);
      pen.lineTo(x - u, y - v);
      pen.closePath();
    }
    pen.fillStyle = tone.cut;
    pen.fill();
    pen.strokeStyle = tone.cut; // no seams between stretches
    pen.lineWidth = Math.max(0.12, 0.7 / this.scale);
    pen.stroke();
    pen.restore();
    pen.beginPath();
    for (const ring of data.rings) this.outline(ring);
    pen.strokeStyle = tone.edge;
    pen.lineWidth = 1.2 / this.scale;
    pen.stroke();
  }

  outline(points) {
    points.forEach(([x, y], i) => (i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
    this.pen.closePath();
  }

  polygon(points, colour) {
    this.pen.beginPath();
    this.outline(points);
    this.pen.fillStyle = colour;
    this.pen.fill();
  }

  machine(m, track, tone) {
    const { pen, time } = this;
    const x = track.at("x", time), y = track.at("y", time), heading = track.at("heading", time), trailer = track.at("trailer", time);
    const tx = x + m.hitch * Math.cos(heading) - m.drawbar * Math.cos(trailer);
    const ty = y + m.hitch * Math.sin(heading) - m.drawbar * Math.sin(trailer);
    const grow = Math.max(1, LEAST / (6 * this.scale));
    const part = (px, py, angle, boxes, colour) => {
      pen.save();
      pen.translate(px, py);
      pen.rotate(angle);
      pen.scale(grow, grow);
      boxes.forEach(([rear, front, right, left], i) => {
        pen.fillStyle = colour(i);
        pen.fillRect(rear, right, front - rear, left - right);
      });
      pen.restore();
    };
    if (m.towed.length) part(tx, ty, trailer, m.towed, () => tone[m.kind]);
    part(x, y, heading, m.own, (i) => (i === m.raised ? tone.raised : tone[m.kind]));
    return { x, y, tx, ty, heading, towed: m.towed.length > 0 };
  }

  pours(poses, tone) {
    const { pen, data, time } = this, at = (name) => data.machines.findIndex((m) => m.name === name);
    pen.strokeStyle = tone.pipe;
    pen.lineWidth = Math.max(0.5, 2 / this.scale);
    for (const [from, to, begin, end] of data.pours) {
      if (time < begin || time > end) continue;
      const k = at(from), a = poses[k], pipe = data.machines[k].pipe, b = poses[at(to)];
      let [x, y] = [a.towed ? a.tx : a.x, a.towed ? a.ty : a.y], goal = b && [b.tx, b.ty];
      if (!goal) {
        const n = data.truck.length;
        goal = [0, 1].map((i) => data.truck.reduce((sum, p) => sum + p[i], 0) / n);
      } else if (pipe) {
        const [c, s] = [Math.cos(a.heading), Math.sin(a.heading)];
        [x, y] = [a.x + pipe[0] * c, a.y + pipe[0] * s];
        goal = [x - pipe[1] * s, y + pipe[1] * c];
      }
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(...goal);
      pen.stroke();
    }
  }

  labels(poses, tone) {
    const { pen } = this;
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.font = "12px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    pen.lineWidth = 3;
    const named = this.data.machines.map((m, k) => [m.name, poses[k].x, poses[k].y]);
    named.push(["truck", ...this.data.truck[0]]);
    for (const [name, x, y] of named) {
      const u = this.width / 2 + (x - this.x) * this.scale + 12, v = this.height / 2 - (y - this.y) * this.scale - 12;
      pen.strokeStyle = tone.hollow;
      pen.strokeText(name, u, v);
      pen.fillStyle = tone.ink;
      pen.fillText(name, u, v);
    }
  }

  told() {
    const { data, time } = this;
    data.machines.forEach((m, k) => {
      const span = m.spans.find((s) => s[1] <= time && time < s[2]) || m.spans[m.spans.length - 1];
      const kg = Math.max(0, this.fills[k].at("kg", time)), share = m.holds ? Math.min(kg / m.holds, 1) : 0;
      const row = this.rows[k], does = data.states[span[0]];
      row.setAttribute("aria-pressed", String(this.follows === m.name));
      row.querySelector("i").style.width = `${100 * share}%`;
      const why = span[3] ? `waits for ${span[3]}` : does;
      row.querySelector("span").textContent = `${(kg / 1000).toFixed(1)} of ${(m.holds / 1000).toFixed(1)} t · ${why}`;
    });
    element("facts").textContent = `${(this.atTruck.at("kg", time) / 1000).toFixed(1)} t at the truck`;
  }

  bars() {
    const canvas = element("bars"), { data } = this, high = 14, gap = 4;
    const wide = canvas.clientWidth, tall = data.machines.length * (high + gap) + gap, pen = canvas.getContext("2d");
    if (!this.drawn) { // all but the line of the time, kept
      canvas.style.height = `${tall}px`;
      [canvas.width, canvas.height] = [wide * this.ratio, tall * this.ratio];
      pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      data.machines.forEach((m, k) => {
        for (const [state, begin, end] of m.spans) {
          pen.fillStyle = data.colours[state];
          const x = begin / data.duration * wide;
          pen.fillRect(x, gap + k * (high + gap), (end - begin) / data.duration * wide + 0.3, high);
        }
      });
      this.drawn = document.createElement("canvas");
      [this.drawn.width, this.drawn.height] = [canvas.width, canvas.height];
      this.drawn.getContext("2d").drawImage(canvas, 0, 0);
    }
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(this.drawn, 0, 0);
    pen.fillStyle = tones().ink;
    pen.fillRect(this.time / data.duration * canvas.width - 1, 0, 2, canvas.height);
  }
}

readData(element("data").textContent).then((data) => { globalThis.swath = new Job(data); }).catch((error) => {
  element("message").hidden = false;
  element("message").textContent = String(error);
});
