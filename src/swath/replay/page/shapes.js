// Bodies of flat colour: triangles with a normal and a colour each.

const SOLID_VERTEX = `
layout(location = 0) in vec3 place; layout(location = 1) in vec3 normal; layout(location = 2) in vec3 paint;
uniform mat4 camera, body; uniform vec3 eye; out vec3 tint, facing; out vec3 p;
void main() {
  vec4 q = body * vec4(place, 1.);
  p = q.xyz; facing = mat3(body) * normal; tint = paint; gl_Position = camera * q;
}`;
const SOLID_FRAGMENT = `${FOG}
uniform vec3 eye; uniform float alpha; in vec3 tint, facing, p; out vec4 colour;
void main() {
  vec3 n = normalize(facing), v = normalize(eye - p), l = normalize(vec3(-.4, .3, .85));
  if (dot(n, v) < 0.) n = -n;
  float sun = max(dot(n, l), 0.), dome = .5 + .5 * n.z, shine = pow(max(dot(reflect(-l, n), v), 0.), 24.);
  vec3 rgb = tint * (.42 + .36 * dome + .62 * sun) + .12 * shine;
  colour = vec4(hazed(rgb, distance(eye, p)), alpha);
}`;

class Shape {
  constructor() { this.rows = []; }

  triangle(a, b, c, paint) {
    const n = unit(cross(minus(b, a), minus(c, a)));
    for (const p of [a, b, c]) this.rows.push(...p, ...n, ...paint);
    return this;
  }

  quad(a, b, c, d, paint) { return this.triangle(a, b, c, paint).triangle(a, c, d, paint); }

  box(x0, x1, y0, y1, z0, z1, paint) {
    return this.prism([[x0, z0], [x1, z0], [x1, z1], [x0, z1]], y0, y1, paint);
  }

  // A convex outline of (x, z) drawn out from y0 to y1.
  prism(outline, y0, y1, paint) {
    const n = outline.length, at = (k, y) => [outline[k % n][0], y, outline[k % n][1]];
    for (let k = 0; k < n; k++) this.quad(at(k, y0), at(k + 1, y0), at(k + 1, y1), at(k, y1), paint);
    for (let k = 1; k + 1 < n; k++) {
      for (const y of [y0, y1]) this.triangle(at(0, y), at(k, y), at(k + 1, y), paint);
    }
    return this;
  }

  // A round body from p to q.
  rod(p, q, radius, paint, sides = 12, end = radius) {
    const z = unit(minus(q, p)), x = unit(cross(z, Math.abs(z[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), y = cross(z, x);
    const ring = (c, r, k) => {
      const a = 2 * Math.PI * k / sides, u = r * Math.cos(a), v = r * Math.sin(a);
      return [c[0] + u * x[0] + v * y[0], c[1] + u * x[1] + v * y[1], c[2] + u * x[2] + v * y[2]];
    };
    for (let k = 0; k < sides; k++) {
      this.quad(ring(p, radius, k), ring(p, radius, k + 1), ring(q, end, k + 1), ring(q, end, k), paint);
      this.triangle(p, ring(p, radius, k), ring(p, radius, k + 1), paint);
      this.triangle(q, ring(q, end, k), ring(q, end, k + 1), paint);
    }
    return this;
  }

  // half: half axes along x, y, z.
  ellipsoid(half, paint, sides = 14) {
    const at = (i, j) => {
      const a = 2 * Math.PI * i / sides, b = Math.PI * (j / 8 - 0.5);
      return [half[0] * Math.cos(a) * Math.cos(b), half[1] * Math.sin(a) * Math.cos(b), half[2] * Math.sin(b)];
    };
    for (let j = 0; j < 8; j++) {
      for (let i = 0; i < sides; i++) this.quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1), paint);
    }
    return this;
  }

  // A wheel about the y axis through the origin, with lugs that show how it turns.
  wheel(radius, width, paint, rim) {
    const h = width / 2;
    this.rod([0, -h, 0], [0, h, 0], radius * 0.95, paint, 28);
    this.rod([0, -h - 0.01, 0], [0, h + 0.01, 0], radius * 0.56, rim, 18);
    this.rod([0, -h - 0.05, 0], [0, h + 0.05, 0], radius * 0.16, [0.25, 0.26, 0.27], 10);
    for (let k = 0; k < 20; k++) {
      const a = 2 * Math.PI * k / 20, s = radius * 0.1;
      const c = Math.cos(a), n = Math.sin(a), side = k % 2 ? 1 : -1;
      const point = (r, t, y) => [r * c - t * n, y, r * n + t * c];
      const low = radius * 0.93, y0 = side > 0 ? -0.02 : -h, y1 = side > 0 ? h : 0.02;
      this.quad(point(low, -s, y0), point(radius, 0, y0), point(radius, 0, y1), point(low, -s, y1), paint);
      this.quad(point(radius, 0, y0), point(low, s, y0), point(low, s, y1), point(radius, 0, y1), paint);
    }
    return this;
  }

  upload(gl) {
    this.count = this.rows.length / 9;
    this.object = makeArrayObject(gl, makeBuffer(gl, Float32Array.from(this.rows)), [3, 3, 3]);
    this.rows = null;
    return this;
  }
}

class Solids {
  constructor(gl) {
    this.gl = gl;
    this.program = makeProgram(gl, SOLID_VERTEX, SOLID_FRAGMENT);
  }

  // parts: [shape, matrix]
  draw(view, parts, alpha = 1) {
    const { gl, program } = this;
    gl.useProgram(program.program);
    setUniforms(gl, program, { ...view, alpha });
    for (const [shape, body] of parts) {
      if (!shape.count) continue;
      setUniforms(gl, program, { body });
      gl.bindVertexArray(shape.object);
      gl.drawArrays(gl.TRIANGLES, 0, shape.count);
    }
  }
}
