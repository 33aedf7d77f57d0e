// Obstacles, straw, and lines on the ground.

const FLAT_VERTEX = `
layout(location = 0) in vec3 place; layout(location = 1) in vec4 side; layout(location = 2) in float stamp;
uniform mat4 camera; uniform vec3 eye; uniform float pixel, seconds, dots; out float away, gone, across;
void main() {
  float d = distance(eye, place), w = side.w < 0. ? 0. : max(side.w, dots * pixel * d);
  vec3 p = place + side.xyz * w;
  away = d; gone = stamp > seconds ? 1. : 0.; across = dot(side.xyz, vec3(1.));
  gl_Position = camera * vec4(p, 1.); gl_PointSize = dots;
}`;
const FLAT_FRAGMENT = `${FOG}
uniform vec4 paint; uniform bool round; in float away, gone, across; out vec4 colour;
void main() {
  if (gone > .5) discard;
  if (round && length(gl_PointCoord - .5) > .5) discard;
  colour = vec4(hazed(paint.rgb, away * .5), paint.a);
}`;
const STRAW_VERTEX = `
layout(location = 0) in vec3 place; layout(location = 1) in float stamp; layout(location = 2) in vec2 q;
uniform mat4 camera; uniform vec3 eye; uniform float seconds; out float away; out vec2 at;
void main() {
  away = distance(eye, place); at = q;
  gl_Position = stamp > seconds ? vec4(2., 2., 2., 1.) : camera * vec4(place, 1.);
}`;
const STRAW_FRAGMENT = `${FOG}
in float away; in vec2 at; out vec4 colour;
float hash(vec2 p) { vec3 a = fract(vec3(p.xyx) * .1031); a += dot(a, a.yzx + 33.33); return fract((a.x + a.y) * a.z); }
void main() {
  float speck = mix(hash(floor(at * vec2(40., 12.))) * .6 + hash(floor(at * vec2(9., 40.))) * .4, .5, clamp(away / 50., 0., 1.));
  if (abs(at.y) + .25 * speck > 1.08) discard;
  colour = vec4(hazed(vec3(.89, .80, .53) * (.72 + .4 * speck), away), 1.);
}`;

// Lines with a width [m] and points, all as triangles or points of one buffer that is written anew.
class Flat {
  constructor(gl) {
    this.gl = gl;
    this.program = makeProgram(gl, FLAT_VERTEX, FLAT_FRAGMENT);
    this.buffer = makeBuffer(gl, new Float32Array(8), gl.DYNAMIC_DRAW);
    this.object = makeArrayObject(gl, this.buffer, [3, 4, 1]);
  }

  use(view, paint, dots, round = false) {
    const { gl } = this;
    gl.useProgram(this.program.program);
    setUniforms(gl, this.program, { ...view, paint, dots, round });
  }

  // rows: eight numbers per vertex, as in FLAT_VERTEX.
  draw(kind, rows) {
    const { gl } = this;
    gl.bindVertexArray(this.object);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(rows), gl.DYNAMIC_DRAW);
    gl.drawArrays(kind, 0, rows.length / 8);
  }
}

// A line on the ground as triangles; dash: [m] drawn of twice that, 0 = whole.
function lineRows(points, width, dash = 0) {
  const rows = [];
  let way = 0;
  for (let i = 0; i + 1 < points.length; i++) {
    const a = points[i], b = points[i + 1], d = unit([b[0] - a[0], b[1] - a[1], 0]), n = [-d[1], d[0], 0];
    const drawn = !dash || Math.floor(way / dash) % 2 === 0;
    way += Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (!drawn) continue;
    const at = (p, s) => rows.push(...p, s * n[0], s * n[1], 0, width / 2, 0);
    at(a, 1); at(a, -1); at(b, 1); at(b, 1); at(a, -1); at(b, -1);
  }
  return rows;
}

class Straw {
  constructor(gl, data, machines, ground) {
    this.gl = gl;
    this.program = makeProgram(gl, STRAW_VERTEX, STRAW_FRAGMENT);
    const rows = [];
    data.straw.forEach((laid, index) => strawRows(rows, laid, data[`straw_${index}`], machines[laid.machine], ground));
    this.count = rows.length / 6;
    this.buffer = makeBuffer(gl, Float32Array.from(rows));
    this.object = makeArrayObject(gl, this.buffer, [3, 1, 2]);
  }

  // All rows anew, of a run that goes on.
  refill(rows) {
    const { gl } = this;
    this.count = rows.length / 6;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(rows), gl.DYNAMIC_DRAW);
  }

  draw(view) {
    if (!this.count) return;
    const { gl } = this;
    gl.useProgram(this.program.program);
    setUniforms(gl, this.program, view);
    gl.bindVertexArray(this.object);
    gl.drawArrays(gl.TRIANGLES, 0, this.count);
  }
}

// A swath is a parabola across with the mean depth of its station; spread straw lies flat.
function strawRows(rows, laid, stations, machine, ground) {
  const across = [-1, -0.6, 0, 0.6, 1], sections = [];
  for (let k = 0; k < stations.shape[0]; k++) {
    const t = stations[2 * k], depth = stations[2 * k + 1], pose = machine.pose(t);
    const points = across.map((v) => {
      const p = applied(pose, [machine.body[0], v * laid.width / 2, 0]);
      const high = laid.spread ? depth : 1.5 * depth * (1 - v * v);
      return [p[0], p[1], ground.heightAt(p[0], p[1]) + 0.03 + Math.min(high, 0.6)];
    });
    sections.push({ t, depth, points, s: 0.5 * k });
  }
  for (let k = 0; k + 1 < sections.length; k++) {
    const a = sections[k], b = sections[k + 1];
    if (b.depth <= 0.002 || laid.spread) continue;
    for (let j = 0; j + 1 < across.length; j++) {
      const corner = (s, i) => rows.push(...s.points[i], b.t, s.s, across[i]);
      corner(a, j); corner(a, j + 1); corner(b, j); corner(b, j); corner(a, j + 1); corner(b, j + 1);
    }
  }
}

const THING_PAINT = { box: [0.45, 0.48, 0.52], ellipsoid: [0.50, 0.47, 0.43], post: [0.85, 0.33, 0.05], rod: [0.40, 0.35, 0.30] };
const WHAT_PAINT = {
  person: [0.95, 0.45, 0.05], animal: [0.52, 0.36, 0.22], vehicle: [0.15, 0.30, 0.55], tree: [0.20, 0.42, 0.16],
  hedge: [0.22, 0.40, 0.18], building: [0.62, 0.52, 0.44],
};

// Where a thing that goes is at a time, of rows t, x, y, z, yaw.
function placeOn(way, t) {
  let k = 0;
  while (k + 2 < way.length && way[k + 1][0] <= t) k++;
  const a = way[k], b = way[Math.min(k + 1, way.length - 1)];
  const share = b[0] > a[0] ? Math.min(1, Math.max(0, (t - a[0]) / (b[0] - a[0]))) : 0;
  const at = [1, 2, 3].map((i) => a[i] + share * (b[i] - a[i]));
  return poseMatrix(at, 0, 0, share < 1 ? a[4] : b[4]);
}

class Things {
  constructor(gl, data) {
    this.items = data.things.map((thing) => {
      const [a, b, c] = thing.half, paint = WHAT_PAINT[thing.what] || THING_PAINT[thing.kind], shape = new Shape();
      if (thing.kind === "box") shape.box(-a, a, -b, b, -c, c, paint);
      else if (thing.kind === "ellipsoid") shape.ellipsoid(thing.half, paint);
      else if (thing.kind === "rod") shape.rod([0, 0, -c], [0, 0, c], a, paint, 16);
      else {
        shape.rod([0, 0, -c], [0, 0, c], a, paint, 16);
        for (const z of [0.55, 0.8]) shape.rod([0, 0, z * c], [0, 0, (z + 0.1) * c], a * 1.04, [0.95, 0.95, 0.93], 16);
      }
      return { ...thing, shape: shape.upload(gl), body: frameMatrix(thing.centre, thing.axes) };
    });
    const mesh = new Shape(), m = data.mesh;
    for (let i = 0; i < m.length; i += 9) {
      mesh.triangle([m[i], m[i + 1], m[i + 2]], [m[i + 3], m[i + 4], m[i + 5]], [m[i + 6], m[i + 7], m[i + 8]], [0.72, 0.36, 0.12]);
    }
    this.mesh = mesh.upload(gl);
  }

  parts(t) {
    const there = this.items.filter((thing) => t >= thing.from && (thing.to === null || t < thing.to));
    return [[this.mesh, IDENTITY], ...there.map((thing) => [thing.shape, thing.way ? times(placeOn(thing.way, t), thing.body) : thing.body])];
  }
}
