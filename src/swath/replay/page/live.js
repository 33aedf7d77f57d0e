// A run that goes on: rows and scans as they come, the knife's way, and the controls of the run.

const MOST_LIVE_ROWS = 20000, TRAIL_SCANS = 12, SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 10, 0];  // 0: as fast as possible

class Live {
  constructor(app, data) {
    Object.assign(this, { app, data, at: 0, follows: true, drawnAt: 0, ids: 0, waiting: new Map(), state: {}, frames: 0, bytes: 0 });
    app.machines.forEach((machine, k) => this.makeRoom(machine.track, data.live.columns[k]));
    app.scans.scanners.forEach((scanner) => { scanner.kept = []; });
    this.tell("connecting …");
    this.panel();
    app.live = this;
    this.connect();
  }

  // Room for rows to come, in the place of the one that the page began with.
  makeRoom(track, names) {
    track.columns = Object.fromEntries(names.map((name) => {
      const all = new Float32Array(MOST_LIVE_ROWS).fill(NaN);
      all[0] = track.columns[name] ? track.columns[name][0] : NaN;
      return [name, all];
    }));
    track.times = track.columns.t_s;
    track.count = 1;
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}/live${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("message", (e) => this.take(e.data));
    this.socket.addEventListener("close", () => this.end(this.over || "connection lost: swath or this page was stopped", !this.over));
  }

  take(message) {
    if (typeof message !== "string") return this.takeBytes(message);
    const told = JSON.parse(message);
    if (told.again) location.reload();
    else if (told.over) this.end(this.over = told.over);
    else if (told.state) this.takeState(told.state);
    else if ("id" in told) {
      this.say(told.text, told.ok);
      (this.waiting.get(told.id) || (() => {}))(told);
      this.waiting.delete(told.id);
    }
  }

  takeBytes(buffer) {
    const length = new DataView(buffer).getUint32(0, true), head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const { machines } = this.app;
    let at = 4 + length;
    const floats = (count) => {
      const found = new Float32Array(buffer, at, count);
      at += 4 * count;
      return found;
    };
    if (head.history) {
      head.history.forEach(([rows, wide], k) => {
        for (let i = 0; i < rows; i++) this.addRow(machines[k], k, floats(wide), false);
      });
      this.app.ground.uploadCut();
    } else {
      this.socket.send("seen");
      this.frames++;
      this.bytes = Math.max(this.bytes, buffer.byteLength);
      head.rows.forEach((wide, k) => { if (wide) this.addRow(machines[k], k, floats(wide), true); });
      for (const [k, t, x, y, z, count] of head.scans) {
        this.addScan(this.app.scans.scanners[k], t, [x, y, z], new Int16Array(buffer, at, 3 * count));
        at += 6 * count;
      }
      for (const [name, way] of Object.entries(head.ways || {})) {
        for (const thing of this.app.things.items) if (thing.name === name) thing.way = [way];
      }
    }
    this.at = Math.max(0, ...machines.map((m) => m.track.times[m.track.count - 1] || 0));
    if (this.follows) this.app.time = this.at;
    this.redraw();
  }

  addRow(machine, k, row, isShown) {
    const { track } = machine, names = this.data.live.columns[k], t = row[names.indexOf("t_s")];
    if (track.count === MOST_LIVE_ROWS) thin(track);
    const last = track.count - 1;
    if (t < track.times[last]) return;
    const place = t > track.times[last] ? track.count++ : last;
    names.forEach((name, i) => { track.columns[name][place] = row[i]; });
    if (machine.cuts && place > 0) this.cut(machine, k, place, isShown);
  }

  // The cells that the knife passed between a row and the one before.
  cut(machine, k, place, isShown) {
    const { ground } = this.app, { tile, cells, unit_s: unit } = ground.area, { columns: col } = machine.track;
    const [width, knife, middle] = machine.header;
    const ends = [place - 1, place].map((i) => [1, -1].map((s) => {
      const c = Math.cos(col.yaw_rad[i]), n = Math.sin(col.yaw_rad[i]), y = middle + s * width / 2;
      return ground.local(col.x_m[i] + c * knife - n * y, col.y_m[i] + n * knife + c * y).map((v) => v * cells / tile);
    }));
    const high = col.knife_height_m ? col.knife_height_m[place] : NaN;
    const code = Math.round(100 * (Number.isFinite(high) ? Math.max(high, 0.02) : this.data.live.cut_m[k]));
    ground.cutBetween(ends[0], ends[1], [col.t_s[place - 1] / unit, col.t_s[place] / unit], code, isShown);
  }

  addScan(scanner, t, middle, points) {
    const places = new Float32Array(points.length);
    for (let i = 0; i < points.length; i++) places[i] = middle[i % 3] + points[i] * scanner.unit;
    scanner.kept.push({ t, places });
    if (scanner.kept.length > TRAIL_SCANS) scanner.kept.shift();
    const rows = [], starts = [0];
    for (const scan of scanner.kept) {
      for (let i = 0; i < scan.places.length; i += 3) rows.push(scan.places[i], scan.places[i + 1], scan.places[i + 2], 0, 0, 0, -1, 0);
      starts.push(rows.length / 8);
    }
    scanner.starts = starts;
    scanner.scanTimes = scanner.kept.map((scan) => scan.t);
    scanner.all = rows.filter((_, i) => i % 8 < 3);
    const { gl } = this.app;
    gl.bindBuffer(gl.ARRAY_BUFFER, scanner.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(rows), gl.DYNAMIC_DRAW);
  }

  // Charts and marks anew, twice a second at most: they cost more than a picture.
  redraw() {
    const now = performance.now(), { app } = this;
    if (now - this.drawnAt > 500) {
      this.drawnAt = now;
      const duration = Math.max(10, this.at + 1);
      this.data.duration = app.timeline.duration = app.charts.duration = duration;
      app.timeline.slider.max = duration;
      app.charts.resize();
      this.fillStraw();
      this.fillMoments();
    }
    app.touch();
  }

  // Straw behind the machines, station by station, from the mass on the ground.
  fillStraw() {
    const { app } = this, rows = [];
    this.data.live.straw.forEach((laid, k) => {
      if (laid) strawRows(rows, laid, stationsOf(app.machines[k].track, laid), app.machines[k], app.ground);
    });
    app.straw.refill(rows);
  }

  // Events so far and the worst moments of every machine, marks and list.
  fillMoments() {
    const { app, data } = this;
    const worst = app.machines.flatMap((machine, k) => data.live.worst.map((w) => worstOf(machine, data.machines[k].name, w)).filter(Boolean));
    app.timeline.moments = [...(this.state.marks || []).map((e) => ({ ...e, worst: false })), ...worst].sort((a, b) => a.t_s - b.t_s);
    element("marks").replaceChildren();
    app.timeline.fillMarks();
    const told = JSON.stringify(app.timeline.moments);
    if (told === this.toldMoments) return;
    this.toldMoments = told;
    element("list").replaceChildren();
    app.timeline.fillMoments();
  }

  takeState(state) {
    const { app, data } = this;
    this.state = state;
    app.timeline.label(!state.paused);
    this.stepButton.disabled = !state.paused;
    this.speed.value = String(state.speed);
    this.speed.disabled = state.is_paced;
    this.tellState();
    element("go-back").hidden = Boolean(state.no_way_back);
    element("no-way-back").textContent = state.no_way_back ? `cannot branch: ${state.no_way_back}` : "";
    this.fillKeys();
    this.obstacles.replaceChildren(...Object.keys(state.values).filter((key) => key.startsWith("obstacles.")).map((key) => {
      const item = document.createElement("li");
      item.append(`${key.slice(10)} `, this.button("remove", () => this.ask("set", { key, value: null })));
      return item;
    }));
    if (JSON.stringify(state.things) !== this.things) {
      this.things = JSON.stringify(state.things);
      app.things = new Things(app.gl, { things: state.things, mesh: Float32Array.from(state.mesh) });
    }
    this.drawnAt = 0;
    if (!data.ended) this.redraw();
  }

  ask(what, more = {}) {
    const id = ++this.ids;
    this.socket.send(JSON.stringify({ id, do: what, ...more }));
    return new Promise((done) => this.waiting.set(id, done));
  }

  say(text, ok) {
    this.answer.textContent = text || "done";
    this.answer.className = ok ? "pass" : "fail";
  }

  // The run is over, or cannot be reached: play and speed are those of what was seen.
  end(text, isLost = false) {
    this.isOver = true;
    this.tell(text, isLost ? "fail" : "");
    for (const part of [...this.box.querySelectorAll("button, input, select"), this.stepButton, this.now]) part.disabled = true;
    this.speed.replaceChildren(...SPEEDS.filter((v) => v).map((v) => new Option(`${v}×`, v, v === 1, v === 1)));
    this.speed.disabled = false;
    this.app.timeline.label();
    this.say("what was seen stays here until the page is closed", true);
  }

  tell(text, kind = "") {
    element("verdict").textContent = text;
    element("verdict").className = kind;
  }

  // Another moment is looked at; that of the run is followed.
  sought() {
    const ago = this.at - this.app.time;
    this.follows = ago < 0.05;
    if (!this.follows) this.back.value = Math.max(0.1, ago).toFixed(1);
    this.tellState();
  }

  tellState() {
    const { paused } = this.state, past = this.follows ? "" : `, shown at ${clock(this.app.time)}`;
    if (!this.isOver && paused !== undefined) this.tell((paused ? "paused" : "running") + past, paused ? "" : "pass");
  }

  // Play and pause are those of the run, also when an earlier moment is looked at.
  plays() {
    if (this.isOver) return false;
    if (!this.state.paused) this.ask("pause", { value: true });
    else {
      this.toNow();
      this.ask("pause", { value: false });
    }
    return true;
  }

  toNow() {
    this.app.seek(this.at);
  }

  // Keys of the run by machine and slot, levels first; the last entry is for any other key.
  fillKeys() {
    const { values, levels } = this.state, chosen = this.key.value, groups = new Map();
    for (const key of [...Object.keys(levels), ...Object.keys(values)]) {
      const name = key.split(".").slice(0, 2).join("."), keys = groups.get(name) || new Set();
      if (!key.startsWith("obstacles.")) groups.set(name, keys.add(key));
    }
    this.key.replaceChildren(...[...groups].sort().map(([name, keys]) => {
      const group = document.createElement("optgroup");
      group.label = name;
      for (const key of keys) group.append(new Option(key, key));
      return group;
    }), new Option("another key …", ""));
    this.key.value = chosen;
    if (this.key.selectedIndex < 0 || !this.hasKeys) this.key.selectedIndex = 0;
    if (!this.hasKeys || !this.change.contains(document.activeElement)) this.fillValue();
    this.hasKeys = true;
  }

  // A list of levels, yes or no, or a field with the present value.
  fillValue() {
    const key = this.key.value, value = this.state.values[key], levels = this.state.levels[key];
    const choices = levels || (typeof value === "boolean" ? ["true", "false"] : null), text = value === undefined ? "" : String(value);
    this.otherKey.hidden = Boolean(key);
    this.otherKey.required = !key;
    const field = document.createElement(choices ? "select" : "input");
    if (choices) field.append(...[...new Set([...choices, text].filter(Boolean))].map((each) => new Option(each, each)));
    else field.autocomplete = "off";
    Object.assign(field, { name: "value", required: true, value: typeof value === "object" ? JSON.stringify(value) : text });
    this.change.elements.value.replaceWith(field);
  }

  button(text, deed) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.addEventListener("click", deed);
    return made;
  }

  panel() {
    this.box = document.createElement("section");
    this.box.id = "live";
    this.box.setAttribute("aria-label", "control of the run");
    this.box.innerHTML = `<h2>Change the run</h2>
<form id="change"><label>set <select name="key"></select></label>
<input name="other" placeholder="machine.slot.key" aria-label="key" autocomplete="off" hidden>
<label>to <input name="value" required autocomplete="off"></label><button>now</button>
<span id="go-back"><button name="branch" title="a new run begins there, in a folder of its own">branch</button>
<label><input name="back" type="number" min="0.1" step="0.1" value="10"> s ago</label></span>
<small id="no-way-back"></small></form>
<form id="obstacle"><label>obstacle <input name="name" value="pole" required pattern="[^.]+"></label>
<label>is <input name="value" value="{kind: post, x_m: 12, y_m: 3}" required></label><button>add</button>
<ul id="there"></ul></form><p id="answer" role="status"></p>`;
    document.querySelector("aside").prepend(this.box);
    this.obstacles = element("there");
    this.answer = element("answer");
    this.stepButton = this.button("step", () => { this.toNow(); this.ask("step"); });
    this.stepButton.title = "one tick of a paused run";
    this.now = this.button("live", () => this.toNow());
    this.now.title = "back to the present of the run";
    element("play").after(this.stepButton, this.now);
    this.speed = element("speed");
    this.speed.setAttribute("aria-label", "speed of the run");
    this.speed.replaceChildren(...SPEEDS.map((v) => new Option(v ? `${v}×` : "max", v)));
    this.speed.addEventListener("change", () => { if (!this.isOver) this.ask("speed", { value: Number(this.speed.value) }); });
    const changed = this.change = element("change"), put = element("obstacle");
    this.key = changed.elements.key;
    this.otherKey = changed.elements.other;
    this.key.addEventListener("change", () => this.fillValue());
    this.back = changed.elements.back;
    changed.addEventListener("submit", (e) => {
      e.preventDefault();
      const change = { key: this.key.value || this.otherKey.value, value: changed.elements.value.value };
      if (e.submitter && e.submitter.name === "branch") this.ask("branch", { ...change, at_s: Math.max(0.001, this.at - Number(this.back.value)) });
      else this.ask("set", change);
    });
    put.addEventListener("submit", (e) => {
      e.preventDefault();
      this.ask("set", { key: `obstacles.${put.elements.name.value}`, value: put.elements.value.value });
    });
  }
}

const STRAW_STEP = 0.5, NEAR_M = 5;

// Times [s] and mean depths [m] of straw, every STRAW_STEP driven, as a table of two columns.
function stationsOf(track, laid) {
  const { t_s: t, distance_m: s, straw_kg: mass } = track.columns, found = [];
  let before = NaN, from = 0, next = 0;
  for (let i = 0; i < track.count; i++) {
    if (!(s[i] >= next) || Number.isNaN(mass[i])) continue;
    const area = Math.max(s[i] - from, 0.1) * laid.width;
    found.push(t[i], Number.isNaN(before) ? 0 : Math.max(0, (mass[i] - before) / (area * laid.density)));
    before = mass[i];
    from = s[i];
    next = s[i] + STRAW_STEP;
  }
  const table = Float32Array.from(found);
  table.shape = [found.length / 2, 2];
  return table;
}

// The moment at which a column of a machine is largest, or smallest; null where it never says much.
function worstOf(machine, name, w) {
  const { track } = machine, values = track.columns[w.column];
  if (!values || (w.of_header && !machine.cuts)) return null;
  let at = -1, size = NaN;
  for (let i = 0; i < track.count; i++) {
    const v = Math.abs(values[i]);
    if (Number.isNaN(v) || track.columns.distance_m[i] < w.beyond_m) continue;
    if (at < 0 || (w.is_least ? v < size : v > size)) [at, size] = [i, v];
  }
  if (at < 0 || size < w.at_least || (w.is_least && size > NEAR_M)) return null;
  const text = w.text.replace(/\{:\.(\d)f\}/, (_, digits) => (values[at] * w.factor).toFixed(digits)).replace("-", "−");
  const t = track.times[at];
  return { t_s: t, end_s: t, kind: "worst", machine: name, worst: true, text };
}

// Every other row of a track, and the last.
function thin(track) {
  const half = Math.floor(track.count / 2);
  for (const all of Object.values(track.columns)) {
    for (let i = 0; i < half; i++) all[i] = all[2 * i + 1];
    all.fill(NaN, half);
  }
  track.count = half;
}
