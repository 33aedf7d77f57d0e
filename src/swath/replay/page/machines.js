// Machines from the numbers of their data sheets: body, header, wheels, and how they move at a time.

const PAINTS = [
  { body: [0.44, 0.58, 0.16], dark: [0.30, 0.40, 0.12], header: [0.66, 0.18, 0.12] },
  { body: [0.72, 0.45, 0.10], dark: [0.48, 0.29, 0.07], header: [0.28, 0.30, 0.33] },
  { body: [0.20, 0.42, 0.60], dark: [0.13, 0.28, 0.42], header: [0.55, 0.57, 0.58] },
  { body: [0.60, 0.22, 0.20], dark: [0.42, 0.15, 0.14], header: [0.30, 0.32, 0.34] },
];
const GLASS = [0.13, 0.18, 0.22], STEEL = [0.62, 0.64, 0.66], RUBBER = [0.10, 0.10, 0.11], RIM = [0.85, 0.80, 0.62];
const CHASSIS = [0.17, 0.18, 0.19], GRAIN = [0.86, 0.66, 0.27], ROOF = [0.88, 0.89, 0.88], STREAM = [1.0, 0.90, 0.52];

class Machine {
  // own: triangles of a body from a file, corner by corner, and of its header; none = made from the data sheet
  constructor(gl, about, tracks, index, own) {
    Object.assign(this, about);
    this.about = about;
    this.track = tracks;
    this.paint = PAINTS[index % PAINTS.length];
    this.index = index;
    if (own) this.own = own.map((corners, k) => meshShape(corners, k ? this.paint.header : this.paint.body).upload(gl));
    const kind = about.type === "combine" || about.type === "forage_harvester" ? harvesterBody : vehicleBody;
    this.bodyShape = kind(new Shape(), about, this.paint, Boolean(tracks.columns.unload_angle_rad)).upload(gl);
    this.pivot = [about.body[1] - 0.6, 0, Math.max(1.3, about.body[3] + 0.9)];
    if (about.header[0] > 0) {
      this.headerShape = headerBody(new Shape(), about, this.pivot, this.paint).upload(gl);
      this.reelShape = reelBody(new Shape(), about).upload(gl);
    }
    const rim = about.type === "truck" ? STEEL : RIM;
    this.wheels = [[0, 0], [about.steered_x, 1]].flatMap(([x, k]) => [-1, 1].map((side) => ({
      x, y: side * about.tracks[k] / 2, r: about.radii[k], steered: k === 1,
      shape: new Shape().wheel(about.radii[k], Math.max(0.3, about.widths[k]), RUBBER, rim).upload(gl),
    })));
    this.sensorShape = new Shape().box(-0.09, 0.09, -0.09, 0.09, -0.1, 0.1, [0.0, 0.32, 0.55]).upload(gl);
    this.bracketShape = new Shape();
    for (const sensor of this.sensors) bracket(this.bracketShape, about, sensor.position);
    this.bracketShape.upload(gl);
    if (about.trailer && tracks.columns.trailer_x_m) this.addTrailer(gl);
    this.box = about.box;
    if (about.box && tracks.columns.heap_level) {
      const half = about.box.width / 2 - 0.02, long = about.box.length / 2 - 0.02;
      this.heapShape = new Shape();
      for (const s of [-1, 1]) {  // a hip roof on a box, both one high
        this.heapShape.quad([-long, s * half, 0], [long, s * half, 0], [long, s * half, 1], [-long, s * half, 1], GRAIN);
        this.heapShape.quad([-long, s * half, 1], [long, s * half, 1], [long - half, 0, 1.45], [half - long, 0, 1.45], GRAIN);
        this.heapShape.triangle([s * long, -half, 1], [s * long, half, 1], [s * (long - half), 0, 1.45], GRAIN);
      }
      this.heapShape.upload(gl);
    }
    if (about.pipe && tracks.columns.unload_angle_rad) {
      const mouth = -about.pipe.length, foot = -1.8; // of the riser, inside the tank [m]
      this.pipeShape = new Shape()
        .rod([0, 0, foot], [0, 0, 0], 0.24, this.paint.dark)
        .rod([0.24, 0, 0], [mouth, 0, 0], 0.2, this.paint.dark)
        .rod([mouth, 0, 0.1], [mouth - 0.25, 0, -0.45], 0.18, this.paint.dark)
        .upload(gl);
      this.streamShape = streamBody(new Shape()).upload(gl);
    }
    if (tracks.columns.tank_level) this.grainShape = new Shape().box(-0.5, 0.5, -0.5, 0.5, -1, 0, GRAIN).upload(gl);
  }

  pose(t) { return this.track.pose(t); }

  addTrailer(gl) {
    const { drawbar, width, track, radius } = this.about.trailer, box = this.about.box, shape = new Shape();
    shape.box(0.6, drawbar, -0.12, 0.12, 0.55, 0.75, CHASSIS);
    shape.box(-0.15, 0.15, -track / 2, track / 2, radius - 0.15, radius + 0.15, CHASSIS);
    if (box) {
      const x0 = box.x - box.length / 2, x1 = box.x + box.length / 2, h = box.width / 2, top = box.floor + box.depth;
      shape.box(x0 + 0.6, x1 - 0.6, -0.5, 0.5, radius, box.floor, CHASSIS);
      shape.box(x0, x1, -h, h, box.floor - 0.08, box.floor, this.paint.dark);
      for (const s of [-1, 1]) shape.box(x0, x1, s * h - 0.03, s * h + 0.03, box.floor - 0.08, top, this.paint.body);
      for (const x of [x0, x1]) shape.box(x - 0.03, x + 0.03, -h, h, box.floor - 0.08, top, this.paint.body);
    }
    this.trailerShape = shape.upload(gl);
    const wide = Math.max(0.4, width - track);
    this.trailerWheel = new Shape().wheel(radius, wide, RUBBER, RIM).upload(gl);
  }

  trailerPose(t) {
    const x = this.track.at("trailer_x_m", t), y = this.track.at("trailer_y_m", t), z = this.track.at("trailer_z_m", t);
    return times(moved(x, y, z), turned("z", this.track.angle("trailer_yaw_rad", t)));
  }

  // Heading, calmed over a second and a half, for cameras.
  calmYaw(t) {
    let c = 0, s = 0;
    for (let k = -3; k <= 3; k++) {
      const yaw = this.track.angle("yaw_rad", t + k * 0.25);
      c += Math.cos(yaw);
      s += Math.sin(yaw);
    }
    return Math.atan2(s, c);
  }

  // pose_machine_header: turned about the feeder house by lift and tilt.
  headerMotion(t) {
    const lift = this.track.at("header_lift_rad", t) || 0, tilt = this.track.at("header_tilt_rad", t) || 0;
    return times(turnedAt(this.pivot, "y", -lift), turnedAt([0, this.header[2], this.pivot[2]], "x", tilt));
  }

  // The same of a body from a file, whose header turns where the simulated one does.
  ownHeaderMotion(t) {
    const lift = this.track.at("header_lift_rad", t) || 0, tilt = this.track.at("header_tilt_rad", t) || 0;
    const [x, z, low] = this.about.header_axes;
    return times(turnedAt([x, 0, z], "y", -lift), turnedAt([0, 0, low], "x", tilt));
  }

  parts(t) {
    const body = this.pose(t), found = this.own
      ? [[this.own[0], body], [this.own[1], times(body, this.ownHeaderMotion(t))]] : [[this.bodyShape, body]];
    const way = this.track.at("distance_m", t) || 0, steer = this.track.at("steer_rad", t) || 0;
    if (this.headerShape && !this.own) {
      const header = times(body, this.headerMotion(t)), [, knife, , high] = this.header;
      found.push([this.headerShape, header]);
      const axle = [knife + 0.05, 0, Math.max(0.95, 0.8 * high)];
      found.push([this.reelShape, times(header, times(moved(...axle), turned("y", way * 1.2 / 0.55)))]);
    }
    for (const wheel of this.own ? [] : this.wheels) {
      let m = times(body, moved(wheel.x, wheel.y, wheel.r));
      // a steered axle behind the fixed one turns its wheels the other way
      if (wheel.steered) m = times(m, turned("z", this.steered_x < 0 ? -steer : steer));
      found.push([wheel.shape, times(m, turned("y", way / wheel.r))]);
    }
    for (const sensor of this.sensors) {
      found.push([this.sensorShape, times(body, frameMatrix(sensor.position, sensor.rotation))]);
    }
    if (this.sensors.length) found.push([this.bracketShape, body]);
    if (!this.own && this.track.at("tank_level", t) > 0) found.push([this.grainShape, times(body, this.grain(t))]);
    const carrier = this.carrier(t);
    if (this.trailerShape) {
      found.push([this.trailerShape, carrier]);
      const { track, radius } = this.about.trailer;
      for (const s of [-1, 1]) {
        const m = times(carrier, moved(0, s * track / 2, radius));
        found.push([this.trailerWheel, times(m, turned("y", way / radius))]);
      }
    }
    if (this.heapShape) {
      const high = this.heapHeight(t), m = times(carrier, moved(this.box.x, 0, this.box.floor));
      found.push([this.heapShape, times(m, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, high, 0, 0, 0, 0, 1])]);
    }
    if (this.pipeShape) found.push([this.pipeShape, this.pipePose(t)]);
    return found;
  }

  pipePose(t) {
    const { x, y, z } = this.about.pipe, angle = this.track.at("unload_angle_rad", t) || 0;
    return times(times(this.pose(t), moved(x, y, z)), turned("z", -angle));
  }

  // Grain in the air, from the spout down to the heap in the box of a machine below, or to the ground.
  stream(t, machines) {
    if (!this.pipeShape || !(this.track.at("unload_flow_kg_s", t) > 0.5)) return [];
    const spout = times(this.pipePose(t), moved(-this.about.pipe.length - 0.2, 0, -0.35)), [x, y, z] = applied(spout, [0, 0, 0]);
    const low = Math.max(applied(this.pose(t), [0, 0, 0])[2], ...machines.map((m) => m.heapAt(x, y, t)));
    const high = Math.max(0.1, z - low);
    return [[this.streamShape, times(spout, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, high, 0, 0, 0, 0, 1])]];
  }

  carrier(t) { return this.trailerShape ? this.trailerPose(t) : this.pose(t); }

  heapHeight(t) { return Math.max(0.02, 0.9 * this.box.depth * Math.min(1.1, this.track.at("heap_level", t) || 0)); }

  // Height in the scene of the grain in its box at a place; -Infinity beside the box.
  heapAt(x, y, t) {
    if (!this.heapShape) return -Infinity;
    const m = times(this.carrier(t), moved(this.box.x, 0, this.box.floor)), d = [x - m[12], y - m[13]];
    const along = d[0] * m[0] + d[1] * m[1], across = d[0] * m[4] + d[1] * m[5];
    const inside = Math.abs(along) < this.box.length / 2 && Math.abs(across) < this.box.width / 2;
    return inside ? m[14] + this.heapHeight(t) : -Infinity;
  }

  grain(t) {
    const [, front, half, , top] = this.body, level = Math.min(1, this.track.at("tank_level", t) || 0);
    const m = moved(front - 2.9, 0, top - 0.75 + 0.8 * level);
    return times(m, [1.9, 0, 0, 0, 0, 1.8 * half, 0, 0, 0, 0, 0.6, 0, 0, 0, 0, 1]);
  }
}

// Post and arm from the nearest part of the machine to a sensor: end plate or back of the header, or the body.
function bracket(shape, about, [x, y, z]) {
  const within = (v, low, high) => Math.min(Math.max(v, low), high), far = (p) => Math.hypot(p[0] - x, p[1] - y, p[2] - z);
  const [rear, front, half, bottom, top] = about.body, deep = 0.35;  // into the body, whose outline is no box
  let foot = [within(x, rear + deep, front - deep), within(y, -half + deep, half - deep), within(z, bottom + deep, top - deep)];
  const [width, knife, middle, high, back] = about.header;
  if (width > 0) {
    const plate = within(y, middle - width / 2, middle + width / 2), isEnd = Math.abs(y - middle) > width / 2 - 0.3;
    const on = isEnd ? [within(x, knife - back, knife), plate, 0.4] : [knife - back, plate, 0.1 + high];
    if (far([on[0], on[1], within(z, 0.1, 0.1 + high)]) < far(foot)) foot = on;
  }
  shape.rod(foot, [foot[0], foot[1], z], 0.035, STEEL, 8).rod([foot[0], foot[1], z], [x, y, z], 0.03, STEEL, 8);
}

// A stream that falls by 1: it widens, and is brighter than the heap that it falls on.
function streamBody(shape) {
  const at = (s) => [-0.45 * Math.sqrt(s), 0, -s], wide = (s) => 0.13 + 0.15 * s, steps = 8;
  for (let k = 0; k < steps; k++) {
    const a = k / steps, b = (k + 1) / steps;
    shape.rod(at(a), at(b), wide(a), STREAM, 10, wide(b));
  }
  return shape;
}

function meshShape(c, paint) {
  const shape = new Shape();
  for (let i = 0; i + 8 < c.length; i += 9) {
    shape.triangle([c[i], c[i + 1], c[i + 2]], [c[i + 3], c[i + 4], c[i + 5]], [c[i + 6], c[i + 7], c[i + 8]], paint);
  }
  return shape;
}

function harvesterBody(shape, about, paint, moves) {
  const [rear, front, half, bottom, top] = about.body, side = half * 0.94, cab = front - 1.5;
  const hull = [
    [rear + 0.2, bottom + 0.75], [rear + 1.0, bottom + 0.25], [cab - 0.2, bottom + 0.25], [cab, bottom + 0.7],
    [cab, top - 0.75], [rear + 1.0, top - 0.75], [rear, top - 1.5],
  ];
  shape.prism(hull, -side, side, paint.body);
  shape.prism([[rear + 0.1, bottom + 0.7], [rear + 0.9, bottom + 0.2], [rear + 1.1, bottom + 1.2], [rear, bottom + 1.5]],
    -side * 0.8, side * 0.8, CHASSIS);  // straw hood
  for (const y of [-side - 0.03, side]) {
    shape.prism([[rear + 0.9, bottom + 0.6], [cab - 0.5, bottom + 0.6], [cab - 0.5, bottom + 1.05], [rear + 0.9, bottom + 0.95]],
      y, y + 0.03, paint.dark);
  }
  shape.prism([[rear + 0.7, top - 0.8], [cab - 2.6, top - 0.8], [cab - 2.6, top - 0.25], [rear + 1.2, top - 0.25]],
    -side * 0.9, side * 0.9, paint.dark);  // engine
  shape.box(rear + 1.4, cab - 2.9, -side * 0.7, side * 0.7, top - 0.25, top - 0.2, CHASSIS);
  if (about.type === "combine") {  // rim of the grain tank, open above
    for (const s of [-1, 1]) shape.box(cab - 2.5, cab - 0.15, s * side - 0.04, s * side + 0.04, top - 0.8, top + 0.05, paint.body);
    for (const x of [cab - 2.5, cab - 0.2]) shape.box(x, x + 0.06, -side, side, top - 0.8, top + 0.05, paint.body);
    shape.box(cab - 2.5, cab - 0.15, -side, side, top - 0.8, top - 0.7, CHASSIS);
    if (!moves) shape.rod([cab - 2.3, side + 0.12, top - 0.35], [rear - 0.3, side + 0.22, top - 0.2], 0.17, paint.dark);  // spout
  } else {
    shape.rod([cab - 1.6, 0, top - 0.3], [cab - 1.8, 0, top + 1.0], 0.22, paint.dark);
    shape.rod([cab - 1.8, 0, top + 1.0], [cab - 5.6, 0, top + 1.5], 0.2, paint.dark);
  }
  cabin(shape, cab + 0.05, front + 0.15, 0.62 * half + 0.1, bottom + 1.15, top + 0.12);
  shape.box(-0.22, 0.22, -about.tracks[0] / 2, about.tracks[0] / 2, about.radii[0] - 0.2, about.radii[0] + 0.2, CHASSIS);
  const x = about.steered_x;
  shape.box(x - 0.15, x + 0.15, -about.tracks[1] / 2, about.tracks[1] / 2, about.radii[1] - 0.12, about.radii[1] + 0.12, CHASSIS);
  return shape;
}

function cabin(shape, x0, x1, half, z0, z1) {
  shape.prism([[x0, z0], [x1 - 0.35, z0], [x1, z1 - 0.35], [x1 - 0.15, z1 - 0.12], [x0, z1 - 0.12]], -half, half, GLASS);
  shape.prism([[x0 - 0.1, z1 - 0.14], [x1 - 0.02, z1 - 0.14], [x1 - 0.15, z1], [x0, z1]], -half - 0.06, half + 0.06, ROOF);
  for (const y of [-half - 0.02, half - 0.04]) {
    shape.box(x0 - 0.04, x0 + 0.08, y, y + 0.06, z0 - 0.1, z1, CHASSIS);
  }
  shape.box(x0 - 0.05, x1 - 0.3, -half - 0.04, half + 0.04, z0 - 0.12, z0 + 0.06, CHASSIS);
  shape.rod([x0 + 0.2, half * 0.7, z1], [x0 + 0.2, half * 0.7, z1 + 0.18], 0.07, [0.95, 0.55, 0.05]);
}

function vehicleBody(shape, about, paint) {
  const [rear, front, half, bottom, top] = about.body, truck = about.type === "truck";
  const cab = truck ? front - 1.9 : rear + 0.45, end = truck ? front : rear + 2.3, wide = truck ? half : half * 0.68;
  if (truck) shape.box(rear, cab - 0.1, -half, half, bottom + 0.3, top - 0.6, paint.body);
  else {
    shape.prism([[end - 0.1, bottom + 0.35], [front - 0.1, bottom + 0.35], [front, bottom + 0.9], [front - 0.3, top - 1.35], [end - 0.1, top - 1.15]],
      -half * 0.42, half * 0.42, paint.body);
    shape.box(front - 0.02, front + 0.04, -half * 0.36, half * 0.36, bottom + 0.5, top - 1.5, CHASSIS);
    for (const s of [-1, 1]) {
      const y = s * about.tracks[0] / 2, w = 0.5 * Math.max(0.4, about.widths[0]);
      shape.prism([[-0.9, about.radii[0] * 2 - 0.25], [0.9, about.radii[0] * 2 - 0.25], [0.5, about.radii[0] * 2 + 0.1], [-0.5, about.radii[0] * 2 + 0.1]],
        y - w, y + w, paint.dark);
    }
    shape.box(rear, end, -half * 0.5, half * 0.5, bottom + 0.1, bottom + 0.9, CHASSIS);
  }
  cabin(shape, cab, end, wide, truck ? bottom + 0.6 : bottom + 0.85, top);
  shape.box(Math.min(0, about.steered_x), Math.max(0, about.steered_x), -0.25, 0.25, bottom + 0.1, bottom + 0.4, CHASSIS);
  for (const [x, k] of [[0, 0], [about.steered_x, 1]]) {
    shape.box(x - 0.12, x + 0.12, -about.tracks[k] / 2, about.tracks[k] / 2, about.radii[k] - 0.1, about.radii[k] + 0.1, CHASSIS);
  }
  return shape;
}

function headerBody(shape, about, pivot, paint) {
  const [width, knife, middle, high, deep] = about.header, left = middle + width / 2, right = middle - width / 2;
  const back = knife - deep, low = 0.12, red = paint.header;
  shape.prism([[back, low], [back + 0.12, low], [back + 0.08, 0.15 + high], [back - 0.05, 0.15 + high]], right, left, red);
  shape.prism([[back, low], [knife, low - 0.02], [knife, low + 0.03], [back, low + 0.12]], right, left, red.map((c) => 0.7 * c));
  shape.box(knife - 0.02, knife + 0.05, right, left, low - 0.01, low + 0.04, STEEL);  // knife
  for (const [y, s] of [[left, 1], [right, -1]]) {
    const y0 = s > 0 ? y - 0.02 : y - 0.06, y1 = y0 + 0.08;
    shape.prism([[back, low], [knife + 0.1, low], [knife + 0.1, low + 0.45], [back, 0.15 + 0.8 * high]], y0, y1, red);
    shape.prism([[knife + 0.1, low - 0.04], [knife + 0.95, low], [knife + 0.1, low + 0.4]], y0, y1, red);
  }
  shape.rod([back + 0.42, right + 0.05, 0.5], [back + 0.42, left - 0.05, 0.5], 0.2, STEEL, 12);  // auger
  const turns = Math.max(4, Math.round(width / 0.5));
  for (let k = 0; k < turns; k++) {
    const y = right + (k + 0.5) * width / turns, lean = (y > middle ? -1 : 1) * 0.1;
    shape.rod([back + 0.42, y - lean, 0.5], [back + 0.42, y - lean + 0.03, 0.5], 0.31, red, 12);
  }
  for (const y of [left - 0.3, right + 0.3]) {  // arms of the reel
    shape.prism([[back, 0.1 + high], [back, high], [knife + 0.1, Math.max(0.9, 0.75 * high)], [knife + 0.1, Math.max(1.0, 0.85 * high)]],
      y - 0.04, y + 0.04, CHASSIS);
  }
  shape.prism([[pivot[0] - 0.3, pivot[2] + 0.3], [pivot[0] - 0.4, pivot[2] - 0.5], [back, low + 0.1], [back, 0.1 + 0.85 * high]],
    middle - 0.75, middle + 0.75, paint.dark);  // feeder house
  return shape;
}

// About its own axle, along y.
function reelBody(shape, about) {
  const [width, , middle] = about.header, left = middle + width / 2 - 0.35, right = middle - width / 2 + 0.35;
  shape.rod([0, right, 0], [0, left, 0], 0.05, STEEL, 8);
  for (let k = 0; k < 6; k++) {
    const a = 2 * Math.PI * k / 6, x = 0.5 * Math.cos(a), z = 0.5 * Math.sin(a);
    shape.rod([x, right, z], [x, left, z], 0.028, [0.93, 0.80, 0.25], 6);
    for (let y = right; y <= left + 1e-6; y += (left - right) / Math.max(2, Math.round(width / 2.5))) {
      shape.rod([0, y, 0], [x, y, z], 0.02, STEEL, 5);
    }
  }
  return shape;
}
