// The page: makes the parts, draws when something changed, and answers the controls.

class App {
  constructor(data) {
    this.data = data;
    this.time = 0;
    this.machineAt = 0;
    this.dirty = true;
    this.detail = 1;
    this.frames = 0;
    this.canvas = element("view");
    const gl = this.gl = this.canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("this browser has no WebGL 2, which the picture needs");
    this.isSlow = /swiftshader|llvmpipe|software/i.test(rendererName(gl));
    if (this.isSlow) this.detail = 0.4;
    const tracks = data.machines.map((m, k) => new Tracks(m.columns, data[`track_${k}`]));
    this.machines = data.machines.map((m, k) => new Machine(gl, m, tracks[k], k,
      m.header_axes && [data[`own_body_${k}`], data[`own_header_${k}`]]));
    this.ground = new Ground(gl, data);
    this.stand = new Stand(gl, data, this.ground);
    this.solids = new Solids(gl);
    this.flat = new Flat(gl);
    this.straw = new Straw(gl, data, this.machines, this.ground);
    this.things = new Things(gl, data);
    this.scans = new Scans(gl, data, this.machines, this.flat);
    this.edges = new Edges(gl, data, this.machines, this.ground, this.flat);
    this.cameras = new Cameras(this.canvas, this.ground, () => this.touch());
    this.charts = new Charts(element("charts"), data, this.machines, (t) => this.seek(t));
    this.timeline = new Timeline(data, this);
    this.fillHead();
    this.chooseMachine(this.machines[0].name);
    this.chooseCamera(0);
    this.canvas.addEventListener("webglcontextlost", () => say("the graphics card let go of the picture, load the page again"));
    addEventListener("resize", () => this.resize());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.resize());
    this.resize();
    this.fromAddress();
    requestAnimationFrame((now) => this.frame(now));
  }

  // #t=20&camera=3&machine=west: what a link may say.
  fromAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    if (asked.has("machine")) this.chooseMachine(asked.get("machine"));
    if (asked.has("camera")) this.chooseCamera(Number(asked.get("camera")) - 1);
    if (asked.has("detail")) this.detail = Number(asked.get("detail"));
    this.seek(Number(asked.get("t") || 0));
  }

  get machine() { return this.machines[this.machineAt]; }

  touch() { this.dirty = true; }

  seek(t) {
    this.time = Math.min(Math.max(t, 0), this.data.duration);
    if (this.live) this.live.sought();
    this.touch();
  }

  chooseMachine(name) {
    const index = this.machines.findIndex((m) => m.name === name);
    if (index < 0) return;
    this.machineAt = index;
    element("machine").value = String(index);
    this.cameras.target = null;
    this.charts.show(index);
    this.touch();
  }

  chooseCamera(index) {
    if (!(index >= 0 && index < CAMERAS.length)) return;
    this.cameras.choose(index);
    [...element("cameras").children].forEach((b, k) => b.setAttribute("aria-pressed", String(k === index)));
  }

  fillHead() {
    const { data } = this, [passed, failed, unmeasured, unjudged] = data.limits;
    const open = unmeasured + unjudged, missing = unmeasured ? "measured" : "judged";
    element("name").textContent = data.name;
    element("about").textContent = data.about;
    const verdict = element("verdict");
    verdict.textContent = data.incomplete ? "incomplete" : failed ? `✗ ${failed} of ${passed + failed + open} limits fail`
      : open ? `${open} of ${passed + open} limits not ${missing}` : passed ? `✓ ${passed} limits pass` : "no limits set";
    verdict.className = failed || data.incomplete ? "fail" : open ? "open" : "pass";
    CAMERAS.forEach((camera, k) => {
      const button = document.createElement("button");
      button.textContent = camera.label;
      button.title = `camera ${k + 1} (key ${k + 1})`;
      button.addEventListener("click", () => this.chooseCamera(k));
      element("cameras").append(button);
    });
    this.machines.forEach((m, k) => element("machine").append(new Option(m.name, k)));
    element("machine").hidden = this.machines.length < 2;
    element("machine").addEventListener("change", (e) => this.chooseMachine(this.machines[e.target.value].name));
    for (const id of ["scans", "beams", "edges"]) element(id).addEventListener("change", () => this.touch());
    element("notes").hidden = !data.notes.length;
    for (const note of data.notes) {
      const item = document.createElement("li");
      item.textContent = note;
      element("missing").append(item);
    }
  }

  resize() {
    const ratio = this.isSlow ? 1 : Math.min(devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.ratio = ratio;
    this.sky = colourOf("--sky").split(" ").map(Number);
    this.charts.resize();
    this.touch();
  }

  frame(now) {
    const passed = Math.min((now - (this.last || now)) / 1000, 0.25);
    this.last = now;
    if (this.timeline.playing) {
      this.timeline.advance(passed);
      this.adapt(passed);
    }
    if (this.dirty && !this.gl.isContextLost()) {
      this.dirty = false;
      this.draw();
    }
    requestAnimationFrame((next) => this.frame(next));
  }

  // Fewer stems where a frame takes long, more where there is time.
  adapt(passed) {
    if (passed > 0.055) this.detail = Math.max(0.25, this.detail * 0.93);
    else if (passed < 0.02 && !this.isSlow) this.detail = Math.min(1, this.detail * 1.01);
  }

  draw() {
    const { gl, canvas, time } = this, begun = performance.now();
    const seen = this.cameras.view(this.machine, time, canvas.width, canvas.height);
    const view = {
      camera: seen.camera, eye: seen.eye, pixel: seen.pixel, sky: this.sky, seconds: time,
      now: time / this.data.area.unit_s, near: 6 * Math.max(this.detail, 0.5), dot: 3.2 * this.ratio,
    };
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...this.sky, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    const inCab = this.cameras.name === "cab";
    const parts = this.machines.flatMap((m, k) => m.parts(time).slice(inCab && k === this.machineAt ? 1 : 0));
    parts.push(...this.machines.flatMap((m) => m.stream(time, this.machines)));
    this.stand.draw({ ...view, zoom: seen.zoom, clip: seen.clip }, this.detail);
    this.ground.draw(view);
    this.straw.draw(view);
    gl.enable(gl.BLEND);
    if (element("edges").checked) this.edges.draw(view, time);
    gl.disable(gl.BLEND);
    this.solids.draw(view, [...parts, ...this.things.parts(time)]);  // after the edges, which crop does not hide
    gl.enable(gl.BLEND);
    this.scans.draw(view, time, { scans: element("scans").checked, beams: element("beams").checked });
    this.edges.drawFrusta(view, time);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
    this.timeline.show(time);
    this.charts.cursor(time);
    this.facts();
    this.frames++;
    this.frameMs = performance.now() - begun;
  }

  facts() {
    const { track } = this.machine, t = this.time, found = [];
    const add = (name, column, factor, unit, digits) => {
      const v = track.at(column, t) * factor;
      if (Number.isFinite(v)) found.push(`${name} ${v.toFixed(digits).replace("-", "−")} ${unit}`.trim());
    };
    add("", "distance_m", 1, "m", 1);
    add("", "speed_m_s", 3.6, "km/h", 1);
    if (this.machine.cuts) {
      add("header end", "lateral_error_m", 100, "cm", 1);
      add("grain", "grain_flow_kg_s", 1, "kg/s", 1);
    }
    element("facts").textContent = (this.machines.length > 1 ? `${this.machine.name}: ` : "") + found.join(" · ");
  }
}

function rendererName(gl) {
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}

function say(text) {
  element("message").textContent = text;
  element("message").hidden = false;
}

readData(element("data").textContent).then((data) => {
  const app = new App(data);
  element("loading").remove();
  // What tests and curious people may ask.
  globalThis.swath = {
    app,
    get time() { return app.time; },
    get frames() { return app.frames; },
    get drawn() { return app.stand.drawn; },
    get frameMs() { return app.frameMs; },
    seek: (t) => app.seek(t),
    camera: (index) => app.chooseCamera(index),
    header: (k, t) => {
      const m = app.machines[k], at = times(m.pose(t), IDENTITY), [width, knife, middle] = m.header;
      return [1, -1].map((s) => applied(at, [knife, middle + s * width / 2, 0]));
    },
    // Where a place in the scene is in the picture, 0 to 1 from the left and from the top.
    project: (x, y, z) => {
      const m = app.cameras.view(app.machine, app.time, app.canvas.width, app.canvas.height).camera;
      const [u, v] = applied(m, [x, y, z]), w = m[3] * x + m[7] * y + m[11] * z + m[15];
      return [0.5 + u / w / 2, 0.5 - v / w / 2];
    },
    // Where the camera is and what it looks at, in the scene.
    get view() { return app.cameras.place(app.machine, app.time); },
    geometry: { applied, cross, moved, placeOn, times, unit, CAMERAS, FOV },
    stems: (x, y, reach, t) => app.stand.countStems(x, y, reach, t),
  };
  if (data.live) globalThis.swath.live = new Live(app, data);
}).catch((error) => say(`This page cannot be shown: ${error.message}`));
