// Where one looks from. Dragging turns, the wheel or two fingers come nearer.

const CAMERAS = [
  { name: "follow", label: "Follow", yaw: 2.5, pitch: 0.34, away: 16.5, aim: [4.5, 2.2, 0.6] },
  { name: "edge", label: "At the edge", yaw: 3.0, pitch: 0.2, away: 5.2, aim: [2.6, 0, 0.55] },
  { name: "cab", label: "Cab", yaw: 0, pitch: 0.3, away: 1, aim: [0, 0, 0] },
  { name: "above", label: "Above", yaw: 0, pitch: 1.53, away: 38, aim: [4, 0, 0] },
  { name: "free", label: "Free", yaw: 2.4, pitch: 0.5, away: 22, aim: [0, 0, 0] },
];
const FOV = 0.80;

class Cameras {
  constructor(canvas, ground, onChange) {
    this.ground = ground;
    this.onChange = onChange;
    this.at = 0;
    this.own = CAMERAS.map(({ yaw, pitch, away }) => ({ yaw, pitch, away }));
    this.target = null;
    this.fingers = new Map();
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      this.fingers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    canvas.addEventListener("pointermove", (e) => this.moveFinger(e));
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (e) => this.fingers.delete(e.pointerId));
    }
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom(Math.exp(e.deltaY * 0.0012));
    }, { passive: false });
  }

  get name() { return CAMERAS[this.at].name; }

  choose(index) {
    if (CAMERAS[index].name === "free" && this.at !== index && this.last) {  // stay where one is
      const { eye, target } = this.last, d = minus(eye, target), away = Math.hypot(...d);
      this.target = target;
      this.own[index] = { yaw: Math.atan2(d[1], d[0]), pitch: Math.asin(d[2] / away), away };
    }
    this.at = index;
    this.onChange();
  }

  zoom(factor) {
    const own = this.own[this.at];
    own.away = Math.min(Math.max(own.away * factor, 0.6), 400);
    this.onChange();
  }

  moveFinger(e) {
    const before = this.fingers.get(e.pointerId);
    if (!before) return;
    const own = this.own[this.at], dx = e.clientX - before[0], dy = e.clientY - before[1];
    if (this.fingers.size === 2) {
      const other = [...this.fingers].find(([id]) => id !== e.pointerId)[1];
      const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      own.away = Math.min(Math.max(own.away * far(before) / Math.max(far([e.clientX, e.clientY]), 1), 0.6), 400);
      this.shift(dx / 2, dy / 2, own);
    } else if (e.shiftKey || e.buttons === 2) this.shift(dx, dy, own);
    else {
      own.yaw -= dx * 0.006;
      own.pitch = Math.min(Math.max(own.pitch + dy * 0.005, -0.2), 1.55);
    }
    this.fingers.set(e.pointerId, [e.clientX, e.clientY]);
    this.onChange();
  }

  // Moves the target of the free camera over the ground.
  shift(dx, dy, own) {
    if (this.name !== "free" || !this.target) return;
    const k = own.away * 0.0013, c = Math.cos(own.yaw), s = Math.sin(own.yaw);
    this.target = [this.target[0] + k * (s * dx - c * dy), this.target[1] + k * (-c * dx - s * dy), this.target[2]];
  }

  // Where eye and target are for a machine at a time.
  place(machine, t) {
    const own = this.own[this.at], base = CAMERAS[this.at], pose = machine.pose(t), yaw = machine.calmYaw(t);
    const foot = applied(pose, [0, 0, 0]);
    const side = machine.side === "right" ? -1 : 1;
    const [width, knife, middle] = machine.header;
    const forward = (x, y, z) => [
      foot[0] + Math.cos(yaw) * x - Math.sin(yaw) * y, foot[1] + Math.sin(yaw) * x + Math.cos(yaw) * y, foot[2] + z];
    if (base.name === "cab") {
      const [, front, , , top] = machine.body, eye = applied(pose, [front - 0.35, 0, top - 0.55]);
      const a = yaw + own.yaw, p = own.pitch;
      const d = [Math.cos(a) * Math.cos(p), Math.sin(a) * Math.cos(p), -Math.sin(p)];
      return { eye, target: [eye[0] + d[0], eye[1] + d[1], eye[2] + d[2]], near: 0.5 };
    }
    let target;
    if (base.name === "free") target = this.target || (this.target = forward(4, 0, 1));
    else if (base.name === "edge" && width > 0) target = forward(knife + base.aim[0], middle + side * width / 2, base.aim[2]);
    else if (base.name === "edge") target = forward(machine.body[1] + 3, side * (machine.body[2] + 1.5), 0.8);
    else target = forward(base.aim[0], side * base.aim[1], base.aim[2]);
    const turn = base.name === "free" ? own.yaw : yaw + side * own.yaw, p = own.pitch;
    const eye = [
      target[0] + own.away * Math.cos(turn) * Math.cos(p), target[1] + own.away * Math.sin(turn) * Math.cos(p),
      target[2] + own.away * Math.sin(p)];
    if (base.name === "above") {
      return { eye: [target[0], target[1], target[2] + own.away], target, up: [Math.cos(yaw + own.yaw), Math.sin(yaw + own.yaw), 0], near: 1 };
    }
    eye[2] = Math.max(eye[2], this.ground.heightAt(eye[0], eye[1]) + 0.5);
    return { eye, target, near: 0.15 };
  }

  // What the parts draw with. width, height [px]
  view(machine, t, width, height) {
    const { eye, target, up = [0, 0, 1], near } = this.place(machine, t);
    this.last = { eye, target };
    const aspect = width / height, fov = aspect < 1 ? 1.1 : FOV, f = 1 / Math.tan(fov / 2);
    const m = times(perspective(fov, aspect, near, 900), lookAt(eye, target, up));
    m[16] = f / aspect + 1;  // how far a body reaches over the sides of the picture, per metre of its size
    m[17] = f + 1;
    return { camera: m.slice(0, 16), clip: m, eye, pixel: 1 / (f * height), zoom: this.name === "cab" ? 1.2 : 1, up };
  }
}
