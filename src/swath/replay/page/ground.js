// Terrain with what grows on it seen from afar: soil, stubble, and layers of crop where single stems end.

const FIELD = `
uniform highp usampler2D heights, tilesA, tilesB, cut, list;
uniform mat4 camera; uniform vec3 eye;
uniform vec2 shift, turn; uniform float tile, cells, low, heightUnit, now, scaleMax; uniform ivec2 size;
float node(ivec2 p) { return low + heightUnit * float(texelFetch(heights, clamp(p, ivec2(0), size), 0).r); }
float soil(vec2 q) {
  vec2 f = q / tile; ivec2 i = clamp(ivec2(floor(f)), ivec2(0), size - 1); f -= vec2(i);
  return mix(mix(node(i), node(i + ivec2(1, 0)), f.x), mix(node(i + ivec2(0, 1)), node(i + 1), f.x), f.y);
}
vec3 world(vec2 q, float z) { return vec3(shift + vec2(turn.x * q.x - turn.y * q.y, turn.y * q.x + turn.x * q.y), z); }
uvec2 cutAt(vec2 q) {
  ivec2 c = clamp(ivec2(floor(q * cells / tile)), ivec2(0), size * int(cells) - 1);
  return texelFetch(cut, c, 0).rg;
}
uint listed(int i) { return texelFetch(list, ivec2(i & 1023, i >> 10), 0).r; }
`;

const GROUND_VERTEX = `${FIELD}
uniform float lift; out vec2 q; out float away, light, above;
void main() {
  int n = int(listed(gl_VertexID / 6)), k = gl_VertexID % 6;
  ivec2 t = ivec2(n % size.x, n / size.x);
  ivec2 corner = t + (k == 0 ? ivec2(0) : k == 1 || k == 3 ? ivec2(1, 0) : k == 2 || k == 4 ? ivec2(0, 1) : ivec2(1));
  q = vec2(corner) * tile;
  float scale = float(texelFetch(tilesA, clamp(corner, ivec2(0), size - 1), 0).r) / 255. * scaleMax;
  float z = node(corner);
  vec2 slope = vec2(node(corner + ivec2(1, 0)) - node(corner - ivec2(1, 0)),
                    node(corner + ivec2(0, 1)) - node(corner - ivec2(0, 1))) / (2. * tile);
  vec3 normal = normalize(vec3(-(turn.x * slope.x - turn.y * slope.y), -(turn.y * slope.x + turn.x * slope.y), 1.));
  light = .55 + .5 * dot(normal, normalize(vec3(-.4, .3, .85)));
  above = lift;
  vec3 p = world(q, z + lift * scale);
  away = distance(eye, p);
  gl_Position = camera * vec4(p, 1.);
}`;

const GROUND_FRAGMENT = `${FIELD}${FOG}
uniform float lift, rows, canopy, near, filled; in vec2 q; in float away, light, above; out vec4 colour;
float hash(vec2 p) { vec3 a = fract(vec3(p.xyx) * .1031); a += dot(a, a.yzx + 33.33); return fract((a.x + a.y) * a.z); }
void main() {
  uvec2 c = cutAt(q);
  bool stands = float(c.r) > now;
  float fine = mix(hash(floor(q * 24.)), .5, clamp(away / 50., 0., 1.));
  float patches = hash(floor(q * 1.7)) * .5 + hash(floor(q * .6)) * .5;
  vec3 rgb;
  if (lift > 0.) {
    if (!stands) discard;
    float share = float(texelFetch(tilesA, clamp(ivec2(q / tile), ivec2(0), size - 1), 0).a) / 255.;
    float keep = (1.06 - lift / canopy) * mix(.2, 1., min(1., share * 1.1)) * mix(filled, 1., clamp(away / 60., 0., 1.));
    float speck = hash(floor(q * mix(70., 14., clamp(away / 45., 0., 1.))));
    if (speck > mix(keep, min(1., keep + .5 * share), clamp(away / 70., 0., 1.))) discard;
    if (away < near * (.6 + .7 * hash(floor(q * 9.))) && lift > .45 * canopy) discard;
    rgb = mix(vec3(.50, .41, .19), vec3(.87, .69, .29), lift / canopy) * (.86 + .2 * speck + .08 * patches);
  } else if (stands) {
    rgb = vec3(.33, .27, .16) * (.85 + .3 * fine);
  } else {
    bool bare = c.g == 0u;
    rgb = bare ? vec3(.52, .43, .33) : c.r > 0u ? vec3(.80, .71, .49) : vec3(.68, .61, .45);
    rgb *= .88 + .2 * fine + .06 * patches;
    if (rows > 0. && !bare) {
      float line = abs(fract(q.y / rows) - .5) * 2.;
      rgb *= mix(mix(.86, 1.08, smoothstep(.35, .75, line)), 1., clamp(away / 26. - .15, 0., 1.));
    }
  }
  colour = vec4(hazed(rgb * light, away), 1.);
}`;

const FAR_VERTEX = `
layout(location = 0) in vec3 place; layout(location = 1) in float code;
uniform mat4 camera; uniform vec3 eye; uniform vec2 shift, turn, corner; uniform float lift;
out vec2 q; out float away, standing;
void main() {
  q = place.xy - corner;
  vec3 p = vec3(shift + vec2(turn.x * q.x - turn.y * q.y, turn.y * q.x + turn.x * q.y), place.z + lift - .04);
  away = distance(eye, p); standing = code;
  gl_Position = camera * vec4(p, 1.);
}`;

const FAR_FRAGMENT = `${FOG}
uniform highp usampler2D shown; uniform ivec2 size; uniform float tile, lift, share; in vec2 q; in float away, standing; out vec4 colour;
float hash(vec2 p) { vec3 a = fract(vec3(p.xyx) * .1031); a += dot(a, a.yzx + 33.33); return fract((a.x + a.y) * a.z); }
bool inside(ivec2 t) {
  return t.x >= 0 && t.y >= 0 && t.x < size.x && t.y < size.y && texelFetch(shown, t, 0).r > 0u;
}
void main() {
  ivec2 t = ivec2(floor(q / tile));
  if (inside(t) && inside(t + ivec2(1, 0)) && inside(t - ivec2(1, 0)) && inside(t + ivec2(0, 1)) && inside(t - ivec2(0, 1))) discard;
  if (lift > 0. && standing < .5) discard;
  float speck = mix(hash(floor(q * 16.)), .5, clamp(away / 90., 0., 1.));
  vec3 rgb = lift > 0. ? mix(vec3(.46, .37, .16), vec3(.75, .595, .26), share / .85) : standing < .5 ? vec3(.665, .595, .44) : vec3(.58, .46, .20);
  rgb *= .92 + .16 * speck;
  colour = vec4(hazed(rgb, away), 1.);
}`;

class Ground {
  constructor(gl, data) {
    const { nx, ny, cells } = data.area;
    this.gl = gl;
    this.data = data;
    this.area = data.area;
    this.turn = [Math.cos(data.area.yaw), Math.sin(data.area.yaw)];
    const [fx, fy] = data.area.first.map((n) => n * data.area.tile);
    this.corner = [fx, fy];
    this.shift = [
      this.turn[0] * fx - this.turn[1] * fy - data.origin[0],
      this.turn[1] * fx + this.turn[0] * fy - data.origin[1],
    ];
    const first = new Uint8Array(nx * ny * 4), second = new Uint8Array(nx * ny), shown = new Uint8Array(nx * ny);
    this.shown = [];
    for (let i = 0; i < nx * ny; i++) {
      for (let k = 0; k < 4; k++) first[4 * i + k] = data.tiles[5 * i + k];
      second[i] = data.tiles[5 * i + 4];
      shown[i] = data.shown[i];
      if (shown[i]) this.shown.push(i);
    }
    const both = this.cut = new Uint16Array(2 * data.cut_when.length);
    for (let i = 0; i < data.cut_when.length; i++) {
      both[2 * i] = data.cut_when[i];
      both[2 * i + 1] = data.cut_code[i];
    }
    this.textures = {
      heights: makeTexture(gl, 0, "r16", nx + 1, ny + 1, data.heights),
      tilesA: makeTexture(gl, 0, "rgba8", nx, ny, first),
      tilesB: makeTexture(gl, 0, "r8", nx, ny, second),
      cut: makeTexture(gl, 0, "rg16", nx * cells, ny * cells, both),
      shown: makeTexture(gl, 0, "r8", nx, ny, shown),
    };
    this.list = makeRow(gl, 0, "r32", this.shown.length, Uint32Array.from(this.shown));
    this.program = makeProgram(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    this.farProgram = makeProgram(gl, FAR_VERTEX, FAR_FRAGMENT);
    this.empty = gl.createVertexArray();
    this.makeFar();
  }

  makeFar() {
    const { gl, data } = this, { x, y, step, nx, ny, low, unit_m: unit } = data.far;
    const rows = [];
    const vertex = (i, j) => {
      const code = data.far_codes[j * nx + i] / 255;
      rows.push(x + i * step, y + j * step, low + unit * data.far_heights[j * nx + i], code);
    };
    for (let j = 0; j + 1 < ny; j++) {
      for (let i = 0; i + 1 < nx; i++) {
        for (const [a, b] of [[0, 0], [1, 0], [0, 1], [0, 1], [1, 0], [1, 1]]) vertex(i + a, j + b);
      }
    }
    this.farCount = rows.length / 4;
    this.farObject = makeArrayObject(gl, makeBuffer(gl, Float32Array.from(rows)), [3, 1]);
  }

  // Textures and uniforms of the field; list: of tiles.
  bind(program, values, list) {
    const { gl, area } = this, units = {};
    gl.useProgram(program.program);
    Object.entries({ ...this.textures, list: list || this.list }).forEach(([name, texture], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      units[name] = unit;
    });
    setUniforms(gl, program, {
      ...units, shift: this.shift, turn: this.turn, tile: area.tile, cells: area.cells, low: area.low,
      heightUnit: area.unit_m, scaleMax: area.scale_max, size: [area.nx, area.ny], ...values,
    });
  }

  draw(view) {
    const { gl, data } = this, canopy = 0.93 * data.plants.height;
    gl.bindVertexArray(this.farObject);
    for (const share of [0, 0.28, 0.57, 0.85]) {  // the soil, and layers of crop
      this.bind(this.farProgram, { ...view, corner: this.corner, lift: share * data.plants.height, share });
      gl.drawArrays(gl.TRIANGLES, 0, this.farCount);
    }
    gl.bindVertexArray(this.empty);
    const filled = Math.min(1, Math.max(0.2, data.plants.most / this.area.tile ** 2 / 120));  // few plants hide little
    for (const share of [0, 0.3, 0.5, 0.68, 0.84, 1]) {
      this.bind(this.program, { ...view, lift: share * canopy, canopy, rows: data.plants.rows, near: view.near, filled });
      gl.drawArrays(gl.TRIANGLES, 0, 6 * this.shown.length);
    }
  }

  // Cuts what stands between two places of a knife, left and right end each, in cells; moments: of both, in
  // units of time; code: height that is left [cm].
  cutBetween(before, after, moments, code, isShown) {
    const { nx, ny, cells } = this.area, wide = nx * cells, four = [before[0], before[1], after[1], after[0]];
    const span = (axis, most) => {
      const all = four.map((p) => p[axis]);
      return [Math.max(0, Math.floor(Math.min(...all))), Math.min(most, Math.ceil(Math.max(...all)) + 1)];
    };
    const [x0, x1] = span(0, wide), [y0, y1] = span(1, ny * cells);
    if (x0 >= x1 || y0 >= y1) return;
    const side = (a, b, x, y) => (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]);
    const within = (a, b, c, x, y) => {
      const s = [side(a, b, x, y), side(b, c, x, y), side(c, a, x, y)];
      return s.every((v) => v >= 0) || s.every((v) => v <= 0);
    };
    const far = (line, x, y) => Math.abs(side(line[0], line[1], x, y));
    for (let j = y0; j < y1; j++) {
      for (let i = x0; i < x1; i++) {
        const n = j * wide + i, x = i + 0.5, y = j + 0.5;
        if (this.cut[2 * n] !== 65535) continue;
        if (!within(four[0], four[1], four[2], x, y) && !within(four[0], four[2], four[3], x, y)) continue;
        const a = far(before, x, y), b = far(after, x, y), share = a + b > 0 ? a / (a + b) : 0;
        this.data.cut_when[n] = this.cut[2 * n] = Math.max(1, Math.round(moments[0] + share * (moments[1] - moments[0])));
        this.cut[2 * n + 1] = code;
      }
    }
    if (isShown) this.uploadCut(y0, y1);
  }

  // Gives the card the rows of the cut that changed.
  uploadCut(first = 0, end = this.area.ny * this.area.cells) {
    const { gl } = this, wide = this.area.nx * this.area.cells;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.cut);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, first, wide, end - first, gl.RG_INTEGER, gl.UNSIGNED_SHORT,
      this.cut.subarray(2 * first * wide, 2 * end * wide));
  }

  // Place in the area [m] of a place in the scene.
  local(x, y) {
    const [c, s] = this.turn, dx = x - this.shift[0], dy = y - this.shift[1];
    return [c * dx + s * dy, c * dy - s * dx];
  }

  heightAt(x, y) {
    const { tile, nx, ny, low, unit_m: unit } = this.area, q = this.local(x, y);
    const u = Math.min(Math.max(q[0] / tile, 0), nx - 1e-6), v = Math.min(Math.max(q[1] / tile, 0), ny - 1e-6);
    const i = Math.floor(u), j = Math.floor(v), f = u - i, g = v - j;
    const z = (a, b) => low + unit * this.data.heights[b * (nx + 1) + a];
    return (z(i, j) * (1 - f) + z(i + 1, j) * f) * (1 - g) + (z(i, j + 1) * (1 - f) + z(i + 1, j + 1) * f) * g;
  }
}
