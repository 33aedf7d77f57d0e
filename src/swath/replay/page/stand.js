// The stand as single stems: the card draws the pieces of tile prototypes, asks the raster of cut times at each
// stem's foot and ends the piece at the stubble. A moment costs nothing but a new number for `now`.

const STAND_VERTEX = `${FIELD}${FOG}
uniform highp isampler2D pieces; uniform highp usampler2D feet;
uniform int per, most, count, corners; uniform float widen, pixel, unit, thin, lean;
out vec3 tint;
ivec4 piece(int i) { return texelFetch(pieces, ivec2(i & 1023, i >> 10), 0); }
void main() {
  gl_Position = vec4(2., 2., 2., 1.); tint = vec3(0.);
  int id = gl_VertexID / corners, k = gl_VertexID % corners;
  int n = int(listed(id / count)), i = id % count;
  ivec2 t = ivec2(n % size.x, n / size.x);
  uvec4 stand = texelFetch(tilesA, t, 0);
  int kind = int(texelFetch(tilesB, t, 0).r), proto = kind & 15;
  ivec4 p0 = piece(3 * (proto * per + i));
  if (p0.w == 0) return;
  ivec4 p1 = piece(3 * (proto * per + i) + 1), p2 = piece(3 * (proto * per + i) + 2);
  int at = proto * most + int(uint(p2.z) & 65535u);
  uvec4 foot = texelFetch(feet, ivec2(at & 1023, at >> 10), 0);
  if (float(foot.z) / 65535. >= float(stand.a) / 255.) return;
  float scale = float(stand.r) / 255. * scaleMax;
  vec3 a = vec3(p0.xyz) * unit, b = vec3(p1.xyz) * unit, w = vec3(p1.w, p2.x, p2.y) * thin;
  vec2 f = vec2(foot.xy) * unit;
  if ((kind & 16) != 0) { a.x = tile - a.x; b.x = tile - b.x; f.x = tile - f.x; w.x = -w.x; }
  if ((kind & 32) != 0) { a.y = tile - a.y; b.y = tile - b.y; f.y = tile - f.y; w.y = -w.y; }
  vec2 from = vec2(t) * tile;
  uvec2 c = cutAt(from + f);
  bool stands = float(c.r) > now;
  if (!stands) {
    float limit = float(c.g) * .01 / scale;
    if (min(a.z, b.z) >= limit) return;
    if (b.z > limit) b = mix(a, b, (limit - a.z) / (b.z - a.z));
    else if (a.z > limit) a = mix(b, a, (limit - b.z) / (a.z - b.z));
  }
  vec2 leaning = (vec2(stand.gb) - 128.) * lean;
  float top = k == 0 || k == 1 || k == 3 ? 0. : 1.;
  float side = k == 0 || k == 2 || k == 5 ? -1. : 1.;
  if (corners == 3) { top = k == 2 ? 1. : 0.; side = k == 0 ? -1. : k == 1 ? 1. : 0.; }
  else { top = k == 0 || k == 1 || k == 4 ? 0. : 1.; side = k == 0 || k == 2 || k == 3 ? -1. : 1.; }
  float za = soil(from + a.xy + leaning * a.z), zb = soil(from + b.xy + leaning * b.z);
  vec3 lower = world(from + a.xy + leaning * a.z, za + scale * a.z);
  vec3 upper = world(from + b.xy + leaning * b.z, zb + scale * b.z);
  vec3 p = mix(lower, upper, top);
  float away = distance(eye, p), height = mix(a.z, b.z, top);
  bool round = (p0.w & 64) != 0;
  vec3 across;
  if (round) {
    across = cross(upper - lower, eye - p);
    across *= max(w.x * widen, pixel * away) / max(length(across), 1e-6);
  } else {
    across = world(w.xy, w.z) - world(vec2(0.), 0.);
    float l = length(across);
    across *= max(l * widen, .8 * pixel * away) / max(l, 1e-6);
    if ((p0.w & 128) != 0 && top > .5) across = vec3(0.);
  }
  gl_Position = camera * vec4(p + side * across, 1.);
  int organ = p0.w & 63;
  vec3 rgb = organ == 4 ? vec3(.93, .71, .24) : organ == 5 ? vec3(.71, .64, .33) : organ == 8 ? vec3(.29, .55, .30)
    : organ == 9 ? vec3(.95, .83, .50) : organ == 10 ? vec3(.73, .63, .38) : organ == 11 || organ == 12
    ? vec3(.92, .68, .22) : vec3(.87, .77, .45);
  float lit = .40 + .60 * clamp(height / .75, 0., 1.);
  if (!stands) { rgb = mix(rgb, vec3(.84, .75, .52), .8); lit = .70 + .30 * clamp(height / .15, 0., 1.); }
  float seed = fract(float(p2.z) * .618 + float(n) * .37);
  tint = hazed(rgb * lit * (.84 + .32 * seed) * (round ? 1. : .92), away);
}`;

const STAND_FRAGMENT = `in vec3 tint; out vec4 colour; void main() { colour = vec4(tint, 1.); }`;

// [reach m, share of the stems and ears (2 = the leaves too), times as wide, corners of a piece]
const DETAIL = [[6, 2, 1, 6], [15, 1, 1.1, 6], [34, 0.25, 2, 3], [80, 0.0625, 3.6, 3]];

class Stand {
  constructor(gl, data, ground) {
    const { plant_ends: ends, plant_width: width, plant_organ: organ, plant_stem: stem } = data;
    this.gl = gl;
    this.data = data;
    this.ground = ground;
    this.per = data.plants.per;
    const count = organ.length, rows = new Int16Array(12 * count);
    for (let i = 0; i < count; i++) {
      rows.set([ends[6 * i], ends[6 * i + 1], ends[6 * i + 2], organ[i]], 12 * i);
      rows.set([ends[6 * i + 3], ends[6 * i + 4], ends[6 * i + 5], width[3 * i]], 12 * i + 4);
      rows.set([width[3 * i + 1], width[3 * i + 2], stem[i], 0], 12 * i + 8);
    }
    const feet = new Uint16Array(4 * (data.plant_feet.length / 3));
    for (let i = 0; i < feet.length / 4; i++) for (let k = 0; k < 3; k++) feet[4 * i + k] = data.plant_feet[3 * i + k];
    this.pieces = makeRow(gl, 0, "rgba16i", 3 * count, rows);
    this.feet = makeRow(gl, 0, "rgba16", feet.length / 4, feet);
    this.program = makeProgram(gl, STAND_VERTEX, STAND_FRAGMENT);
    this.main = Math.max(...data.plants.mains);
    const tiles = ground.shown.length;
    this.lists = DETAIL.map(() => ({ list: new Uint32Array(Math.ceil(tiles / 1024) * 1024), count: 0 }));
    for (const own of this.lists) own.texture = makeTexture(gl, 0, "r32", 1024, own.list.length / 1024, own.list);
    this.centres = ground.shown.map((n) => {
      const { tile, nx } = ground.area, u = (n % nx + 0.5) * tile, v = (Math.floor(n / nx) + 0.5) * tile;
      const [c, s] = ground.turn, x = ground.shift[0] + c * u - s * v, y = ground.shift[1] + s * u + c * v;
      return [x, y, ground.heightAt(x, y)];
    });
    this.thrift = Math.min(1, Math.max(0.35, Math.sqrt(1500 / this.main)));  // plants of many pieces end sooner
    this.drawn = 0;
  }

  // Sorts the tiles in sight by distance. scale: of the reaches.
  choose(view, scale) {
    const { eye, camera: m } = view, size = this.ground.area.tile;
    for (const own of this.lists) own.count = 0;
    for (let i = 0; i < this.centres.length; i++) {
      const p = this.centres[i], away = Math.hypot(p[0] - eye[0], p[1] - eye[1], p[2] + 0.5 - eye[2]);
      if (this.data.tiles[5 * this.ground.shown[i] + 3] === 0) continue;
      const w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15], slack = 2 * size + 0.6;
      if (w < -slack) continue;
      const x = m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12], y = m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13];
      if (Math.abs(x) > w + slack * m[16] || Math.abs(y) > w + slack * m[17]) continue;
      const k = DETAIL.findIndex(([reach]) => away / view.zoom < reach * scale * this.thrift);
      if (k >= 0) this.lists[k].list[this.lists[k].count++] = this.ground.shown[i];
    }
    const { gl } = this;
    for (const own of this.lists) {
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, own.texture);
      const rows = Math.ceil(own.count / 1024);
      if (rows) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 1024, rows, gl.RED_INTEGER, gl.UNSIGNED_INT, own.list);
    }
  }

  draw(view, scale) {
    const { gl, data } = this;
    this.choose(view, scale);
    this.drawn = 0;
    gl.bindVertexArray(this.ground.empty);
    DETAIL.forEach(([, share, widen, corners], level) => {
      const own = this.lists[level];
      const count = share > 1 ? this.per : Math.max(1, Math.ceil(this.main * share));
      if (!own.count) return;
      this.ground.bind(this.program, {
        ...view, pieces: 8, feet: 9, per: this.per, most: data.plants.most, count, corners, widen,
        unit: 1 / 2000, thin: 1 / 10000, lean: 1 / 100,
      }, own.texture);
      for (const [unit, texture] of [[8, this.pieces], [9, this.feet]]) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, texture);
      }
      gl.drawArrays(gl.TRIANGLES, 0, corners * count * own.count);
      this.drawn += count * own.count;
    });
  }

  // Stems that stand and stems that are cut at a time [s], within a reach [m] of a place in the scene.
  countStems(x, y, reach, time) {
    const { tile, nx, ny, cells, unit_s: unit } = this.ground.area, { data } = this;
    const [u, v] = this.ground.local(x, y), found = { standing: 0, cut: 0 };
    const low = (a) => Math.max(Math.floor((a - reach) / tile), 0);
    for (let j = low(v); j < Math.min((v + reach) / tile, ny); j++) {
      for (let i = low(u); i < Math.min((u + reach) / tile, nx); i++) {
        const n = j * nx + i, kind = data.tiles[5 * n + 4], share = data.tiles[5 * n + 3] / 255;
        for (let k = 0; k < data.plants.most; k++) {
          const at = 3 * ((kind & 15) * data.plants.most + k), rank = data.plant_feet[at + 2] / 65535;
          if (rank >= share || (!data.plant_feet[at] && !data.plant_feet[at + 1] && !rank)) continue;
          let fx = data.plant_feet[at] / 2000, fy = data.plant_feet[at + 1] / 2000;
          if (kind & 16) fx = tile - fx;
          if (kind & 32) fy = tile - fy;
          const px = i * tile + fx, py = j * tile + fy;
          if (Math.hypot(px - u, py - v) > reach) continue;
          const column = Math.min(Math.floor(px * cells / tile), nx * cells - 1);
          const row = Math.min(Math.floor(py * cells / tile), ny * cells - 1);
          if (data.cut_when[row * nx * cells + column] > time / unit) found.standing++; else found.cut++;
        }
      }
    }
    return found;
  }
}
