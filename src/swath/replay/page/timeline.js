// Slider, play, speed, marks of events, the list of moments, and the keys.

const element = (id) => document.getElementById(id);
const clock = (t) => {
  if (t < 60) return `${t.toFixed(1)} s`;
  if (t < 3600) return `${Math.floor(t / 60)}:${(t % 60).toFixed(1).padStart(4, "0")}`;
  const minutes = Math.floor(t / 60) % 60, seconds = Math.floor(t % 60);
  return `${Math.floor(t / 3600)}:${String(minutes).padStart(2, "0")}:${String(seconds).padStart(2, "0")}`;
};

class Timeline {
  constructor(data, app) {
    this.app = app;
    this.duration = data.duration;
    this.playing = false;
    this.slider = element("time");
    this.slider.max = data.duration;
    this.slider.addEventListener("input", () => app.seek(Number(this.slider.value)));
    element("play").addEventListener("click", () => this.toggle());
    element("speed").addEventListener("change", () => app.touch());
    this.moments = [
      ...data.events.map((e) => ({ ...e, worst: false })),
      ...data.moments.map((m) => ({ ...m, kind: "worst", worst: true, end_s: m.t_s })),
    ].sort((a, b) => a.t_s - b.t_s);
    this.several = data.machines.length > 1;
    this.fillMarks();
    this.fillMoments();
    addEventListener("keydown", (e) => this.key(e));
  }

  get speed() { return Number(element("speed").value); }

  toggle() {
    if (this.app.live && this.app.live.plays()) return;
    this.playing = !this.playing;
    if (this.playing && this.app.time >= this.duration) this.app.seek(0);
    this.label();
    this.app.touch();
  }

  label(playing = this.playing) {
    element("play").textContent = playing ? "❚❚" : "►";
    element("play").setAttribute("aria-label", playing ? "pause" : "play");
  }

  // Moves on by wall time [s]; stops at the end.
  advance(seconds) {
    const next = this.app.time + seconds * this.speed;
    if (next >= this.duration) {
      this.playing = false;
      this.label();
    }
    this.app.seek(next);
  }

  fillMarks() {
    for (const m of this.moments) {
      const mark = document.createElement("button"), end = m.end_s === null ? this.duration : m.end_s;
      mark.className = `mark ${m.kind}`;
      mark.style.left = `${100 * m.t_s / this.duration}%`;
      mark.style.width = `${100 * Math.max(end - m.t_s, 0) / this.duration}%`;
      mark.title = this.text(m);
      mark.setAttribute("aria-label", this.text(m));
      mark.tabIndex = -1;
      mark.addEventListener("click", () => this.jump(m));
      element("marks").append(mark);
    }
  }

  text(m) {
    const who = this.several && m.machine && m.machine !== "field" ? `${m.machine}: ` : "";
    return `${clock(m.t_s)}  ${who}${m.text}`;
  }

  fillMoments() {
    element("moments").hidden = !this.moments.length;
    for (const m of this.moments) {
      const item = document.createElement("li"), button = document.createElement("button"), at = document.createElement("time");
      const dot = document.createElement("i");
      at.textContent = clock(m.t_s);
      dot.className = m.kind;
      button.append(dot, at, this.text(m).slice(clock(m.t_s).length));
      button.addEventListener("click", () => this.jump(m));
      item.append(button);
      element("list").append(item);
    }
  }

  // A little before it happens, with the machine that it happens to.
  jump(m) {
    this.app.chooseMachine(m.machine);
    this.app.seek(m.worst ? m.t_s : Math.max(0, m.t_s - 0.5));
  }

  next(sign) {
    const at = this.app.time, open = this.moments.filter((m) => sign * (m.t_s - at) > 0.6);
    if (open.length) this.jump(sign > 0 ? open[0] : open[open.length - 1]);
  }

  key(e) {
    if (e.ctrlKey || e.altKey || e.metaKey || e.target.tagName === "SELECT") return;
    const jump = (e.shiftKey ? 5 : 0.2) * (this.app.pace || 1), { app } = this;
    const deeds = {
      " ": () => this.toggle(),
      ArrowRight: () => app.seek(app.time + jump),
      ArrowLeft: () => app.seek(app.time - jump),
      Home: () => app.seek(0),
      End: () => app.seek(this.duration),
      n: () => this.next(1),
      p: () => this.next(-1),
      b: () => element("beams")?.click(),
    };
    const number = Number(e.key);
    const deed = number >= 1 && number <= CAMERAS.length ? () => app.chooseCamera(number - 1) : deeds[e.key];
    if (!deed) return;
    e.preventDefault();
    deed();
  }

  show(t) {
    this.slider.value = t;
    this.slider.setAttribute("aria-valuetext", clock(t));
    element("clock").textContent = `${clock(t)} / ${clock(this.duration)}`;
  }
}
