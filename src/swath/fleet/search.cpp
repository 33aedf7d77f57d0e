// Shortest ways of a body with a turning radius on a grid: the body of a native function. Hybrid A* (Dolgov et al. 2010,
// DOI 10.1177/0278364909359210): arcs and straights from pose to pose, the distance on the grid as the heuristic, and from
// every pose the Dubins path to the goal, taken where it is free. A trailer is dragged along: its axle stays on the line to
// the pin. Poses are kept as cosine and sine, so that arcs are rotations.
//
// In and out: m, see ways.py, whose layout this is.

typedef double D;
const D* m = (const D*)numbers.data;
const D* points = (const D*)body.data;
const float* free_from = (const float*)ground.data;
D* nodes = (D*)node_rows.data;
D* keys = (D*)heap_keys.data;
int* heap = (int*)heap_nodes.data;
float* best = (float*)best_rows.data;
float* far = (float*)distance.data;
float *room_now = (float*)clearance.data, *room_ever = (float*)clearance_ever.data;
const float* edge = (const float*)edge_rows.data;
const float* lasting = (const float*)ground_alone.data;
D* out = (D*)found.data;
constexpr int ROW = 10, AT_PARENT = 7, AT_BEND = 8, AT_WAY = 9;
constexpr D PI = 3.14159265358979323846, NEVER = 1e17, SAMPLE = 1.0, COARSE = 2.0, SHOT = 25.0, LATER = 1000.0, BIN = 1.5, WEIGHT = 1.5, RUN_IN = 2.0, FAR = 300.0;
constexpr int AFTER = 1500;  // poses that are looked at once a way is found
const D radius = m[10], turning = m[11], straight = m[12], backwards = m[13], shift = m[14], start_time = m[15];
const D cell = m[16], west = m[17], south = m[18], hitch = m[20], drawbar = m[21], step = m[30], tolerance = m[25];
const bool has_trailer = m[19] > 0.5, reverses = m[22] > 0.5;
const int capacity = (int)m[23], point_count = (int)m[27], nx = (int)m[28], ny = (int)m[29], headings = (int)m[31];
const int ratio = (int)(COARSE / cell + 0.5), cx = (nx + ratio - 1) / ratio, cy = (ny + ratio - 1) / ratio;
out[0] = 0.0;

int size = 0;
auto push = [&](D key, int node) {
  int i = size++;
  while (i > 0) {
    const int up = (i - 1) / 2;
    if (keys[up] < key || (keys[up] == key && heap[up] < node)) break;
    keys[i] = keys[up]; heap[i] = heap[up]; i = up;
  }
  keys[i] = key; heap[i] = node;
};
auto pop = [&](D& key) {
  key = keys[0];
  const int node = heap[0];
  const D last_key = keys[--size];
  const int last = heap[size];
  int i = 0;
  while (true) {
    int down = 2 * i + 1;
    if (down >= size) break;
    if (down + 1 < size && (keys[down + 1] < keys[down] || (keys[down + 1] == keys[down] && heap[down + 1] < heap[down]))) ++down;
    if (last_key < keys[down] || (last_key == keys[down] && last < heap[down])) break;
    keys[i] = keys[down]; heap[i] = heap[down]; i = down;
  }
  keys[i] = last_key; heap[i] = last;
  return node;
};

// the distance of each cell to one that is closed or not free by a time, in steps along the grid and across (Borgefors 1986)
auto nearer = [&](float* room, int c, int i, int j, float d) {
  if (i < 0 || j < 0 || i >= nx || j >= ny) { if (room[c] > d) room[c] = d; return; }
  const float r = room[i * ny + j] + d;
  if (r < room[c]) room[c] = r;
};
auto measure = [&](float* room, D when) {
  for (int i = 0; i < nx * ny; ++i) room[i] = lasting[i] < -1.5f || lasting[i] > when ? 0.0f : 1e6f;
  for (int i = 0; i < nx; ++i)
    for (int j = 0; j < ny; ++j) {
      const int c = i * ny + j;
      nearer(room, c, i - 1, j, 1.0f); nearer(room, c, i, j - 1, 1.0f); nearer(room, c, i - 1, j - 1, 1.41421356f); nearer(room, c, i - 1, j + 1, 1.41421356f);
    }
  for (int i = nx - 1; i >= 0; --i)
    for (int j = ny - 1; j >= 0; --j) {
      const int c = i * ny + j;
      nearer(room, c, i + 1, j, 1.0f); nearer(room, c, i, j + 1, 1.0f); nearer(room, c, i + 1, j + 1, 1.41421356f); nearer(room, c, i + 1, j - 1, 1.41421356f);
    }
};
if (m[37] > 0.5) { measure(room_ever, NEVER); measure(room_now, m[39]); }

// the distance to the goal on coarse cells in which the fixed axle can be somewhere, `m[36]` from what is never free
auto coarse_of = [&](D x, D y) {
  int i = (int)((x - west) / COARSE), j = (int)((y - south) / COARSE);
  i = i < 0 ? 0 : i >= cx ? cx - 1 : i;
  j = j < 0 ? 0 : j >= cy ? cy - 1 : j;
  return i * cy + j;
};
for (int i = 0; i < cx; ++i)
  for (int j = 0; j < cy; ++j) {
    bool is_free = false;
    for (int a = i * ratio; a < (i + 1) * ratio && a < nx && !is_free; ++a)
      for (int b = j * ratio; b < (j + 1) * ratio && b < ny && !is_free; ++b) {
          is_free = (room_ever[a * ny + b] + 1.0) * cell > m[36];
        }
    far[i * cy + j] = is_free ? 1e18f : -1.0f;
  }
const int goal_cell = coarse_of(m[6], m[7]), start_cell = coarse_of(m[0], m[1]);
far[start_cell] = 1e18f;
far[goal_cell] = 0.0f;
push(0.0, goal_cell);
D enough = 1e17;
while (size) {
  D key;
  const int c = pop(key);
  if (key > far[c]) continue;
  if (key > enough) break;
  if (c == start_cell) enough = 1.3 * key + 60.0;
  const int i = c / cy, j = c % cy;
  for (int a = -1; a <= 1; ++a)
    for (int b = -1; b <= 1; ++b) {
      if ((!a && !b) || i + a < 0 || j + b < 0 || i + a >= cx || j + b >= cy) continue;
      const int n = c + a * cy + b;
      const float d = (float)(key + COARSE * (a && b ? 1.41421356 : 1.0));
      if (d < far[n]) { far[n] = d; push(d, n); }
    }
}
size = 0;
if (far[start_cell] > NEVER) return;
const D poses = m[24] * (0.5 + far[start_cell] / FAR);  // more for who has farther to go
const int most = poses < capacity ? (int)poses : capacity;

auto has_room = [&](D x, D y, D around) {
  for (int k = 0; k < (int)m[38]; ++k) {
    const D dx = x - m[40 + 3 * k], dy = y - m[41 + 3 * k], near = m[42 + 3 * k] + around;
    if (dx * dx + dy * dy < near * near) return false;
  }
  const D gi = (x - west) / cell, gj = (y - south) / cell;
  return gi >= 0.0 && gj >= 0.0 && gi < nx && gj < ny && (room_now[(int)gi * ny + (int)gj] * 0.92 - 1.5) * cell > around;
};

auto edge_at = [&](D gi, D gj) {  // the distance to closed ground, between the middles of four cells
  D u = gi - 0.5, w = gj - 0.5;
  u = u < 0.0 ? 0.0 : u > nx - 1.001 ? nx - 1.001 : u;
  w = w < 0.0 ? 0.0 : w > ny - 1.001 ? ny - 1.001 : w;
  const int i = (int)u, j = (int)w;
  const float* e = edge + i * ny + j;
  u -= i; w -= j;
  return (1.0 - u) * ((1.0 - w) * e[0] + w * e[1]) + u * ((1.0 - w) * e[ny] + w * e[ny + 1]);
};
// a body at a pose and a time: on open ground throughout, its wheels not in standing crop
auto is_clear = [&](D x, D y, D c, D s, D tx, D ty, D when) {
  D u = 1.0, w = 0.0;
  if (has_trailer) {
    u = (x + hitch * c - tx) / drawbar; w = (y + hitch * s - ty) / drawbar;
    if (u * c + w * s < 0.5) return false;  // 60 deg
  }
  if (has_room(x + m[32] * c, y + m[32] * s, m[33]) && (!has_trailer || has_room(tx + m[34] * u, ty + m[34] * w, m[35]))) return true;
  for (int k = 0; k < point_count; ++k) {
    const D* p = points + 4 * k;
    D px, py;
    if (p[2] > 0.5) { px = tx + p[0] * u - p[1] * w; py = ty + p[0] * w + p[1] * u; }
    else { px = x + p[0] * c - p[1] * s; py = y + p[0] * s + p[1] * c; }
    const D gi = (px - west) / cell, gj = (py - south) / cell;
    if (gi < 0.0 || gj < 0.0 || gi >= nx || gj >= ny) return false;
    const int at = (int)gi * ny + (int)gj;
    const float f = free_from[at];
    if (f < -2.5f || (p[3] < 0.5 && f > when)) return false;
    if (edge[at] < 1.0f && edge_at(gi, gj) < 0.0) return false;
  }
  return true;
};
{  // a goal where it cannot stand
  const D tx = m[6] + hitch * m[8] - drawbar * m[8], ty = m[7] + hitch * m[9] - drawbar * m[9];
  if (!is_clear(m[6], m[7], m[8], m[9], tx, ty, start_time + LATER)) return;
}
struct State { D x, y, c, s, tx, ty; };
auto drag = [&](State& q) {
  if (!has_trailer) return;
  const D px = q.x + hitch * q.c, py = q.y + hitch * q.s, dx = px - q.tx, dy = py - q.ty;
  const D d = __builtin_sqrt(dx * dx + dy * dy);
  q.tx = px - drawbar * dx / d; q.ty = py - drawbar * dy / d;
};
// an arc (bend of -1, 0, 1 over the radius, or part of it) of a signed length; false where it meets something
auto drive = [&](State& q, D bend, D length, D& when, D speed) {
  const int count = (int)__builtin_ceil(__builtin_fabs(length) / SAMPLE - 1e-9);
  if (count < 1) return true;
  const D d = length / count, k = bend / radius, turn = k * d;
  const D dc = cos(turn), ds = sin(turn), chord = __builtin_fabs(turn) < 1e-9 ? d : 2.0 * sin(0.5 * turn) / k;
  const D hc = cos(0.5 * turn), hs = sin(0.5 * turn);
  for (int i = 0; i < count; ++i) {
    q.x += chord * (q.c * hc - q.s * hs); q.y += chord * (q.s * hc + q.c * hs);
    const D c = q.c * dc - q.s * ds, s = q.s * dc + q.c * ds;
    q.c = c; q.s = s;
    drag(q);
    when += __builtin_fabs(d) / speed;
    if (!is_clear(q.x, q.y, q.c, q.s, q.tx, q.ty, when)) return false;
  }
  return true;
};
auto angle_of = [&](D a) { a = a - 2.0 * PI * floor(a / (2.0 * PI)); return a > 2.0 * PI - 1e-9 ? 0.0 : a; };

int count = 0, best_node = -1, best_word = 0, popped = 0, found_at = 0;
D best_cost = 1e18, best_parts[4] = {0.0, 0.0, 0.0, 0.0};
const D bends[4][3] = {{1, 0, 1}, {-1, 0, -1}, {1, 0, -1}, {-1, 0, 1}};
// the parts [m] of a Dubins path of one of four words to the goal, or to a run-in before it; false where there is none
auto word_to = [&](D x, D y, D c, D s, D run_in, int word, D* parts) {
  const D dx = m[6] - run_in * m[8] - x, dy = m[7] - run_in * m[9] - y, way = atan2(dy, dx), d = __builtin_sqrt(dx * dx + dy * dy) / radius;
  const D a = angle_of(atan2(s, c) - way), b = angle_of(atan2(m[9], m[8]) - way);
  const D sa = sin(a), sb = sin(b), ca = cos(a), cb = cos(b), cab = cos(a - b);
  D square, t, q;
  if (word == 0) square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb);
  else if (word == 1) square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa);
  else if (word == 2) square = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb);
  else square = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb);
  if (square < -1e-9) return false;
  if (square < 0.0) square = 0.0;
  const D p = __builtin_sqrt(square);
  if (word == 0) { const D e = atan2(cb - ca, d + sa - sb); t = angle_of(e - a); q = angle_of(b - e); }
  else if (word == 1) { const D e = atan2(ca - cb, d - sa + sb); t = angle_of(a - e); q = angle_of(e - b); }
  else if (word == 2) { const D e = atan2(-ca - cb, d + sa + sb) - atan2(-2.0, p); t = angle_of(e - a); q = angle_of(e - b); }
  else { const D e = atan2(ca + cb, d - sa - sb) - atan2(2.0, p); t = angle_of(a - e); q = angle_of(b - e); }
  parts[0] = t * radius; parts[1] = p * radius; parts[2] = q * radius; parts[3] = run_in;
  return true;
};
const D run_in_line = has_trailer && tolerance > -1.0 ? RUN_IN * drawbar : 0.0;
auto shoot_to = [&](int n, D run_in) {  // the shortest of the four that is free
  const D* q0 = nodes + ROW * n;
  for (int word = 0; word < 4; ++word) {
    D parts[4];
    if (!word_to(q0[0], q0[1], q0[2], q0[3], run_in, word, parts)) continue;
    const D cost = q0[6] + (q0[AT_WAY] < 0.0 ? shift : 0.0) + (parts[0] + parts[2]) / turning + (parts[1] + run_in) / straight;
    if (cost >= best_cost - 1e-6) continue;
    State at = {q0[0], q0[1], q0[2], q0[3], q0[4], q0[5]};
    D when = start_time + q0[6];
    bool is_free = true;
    for (int i = 0; i < 4 && is_free; ++i) is_free = drive(at, i < 3 ? bends[word][i] : 0.0, parts[i], when, i % 2 ? straight : turning);
    if (!is_free) continue;
    if (has_trailer && tolerance > -1.0) {
      const D u = (at.x + hitch * at.c - at.tx) / drawbar, w = (at.y + hitch * at.s - at.ty) / drawbar;
      if (u * at.c + w * at.s < tolerance) continue;
    }
    if (best_node < 0) found_at = popped;
    best_cost = cost; best_node = n; best_word = word;
    for (int i = 0; i < 4; ++i) best_parts[i] = parts[i];
  }
};
auto shoot = [&](int n) {  // a trailer that has to be in line behind a bend comes in line on a straight
  shoot_to(n, 0.0);
  if (run_in_line > 0.0) shoot_to(n, run_in_line);
};
// the time to the goal: on the grid, or of who cannot reverse along the shortest Dubins path, whichever is longer
auto estimate = [&](const State& q) {
  const D on_grid = far[coarse_of(q.x, q.y)];
  if (reverses || on_grid < 0.0) return on_grid / straight * WEIGHT;
  D least = 1e18, parts[4];
  for (int word = 0; word < 4; ++word)
    if (word_to(q.x, q.y, q.c, q.s, run_in_line, word, parts)) { const D t = (parts[0] + parts[2]) / turning + (parts[1] + parts[3]) / straight; if (t < least) least = t; }
  const D alone = on_grid / straight * WEIGHT;
  return least < 1e17 && least > alone ? least : alone;
};
auto bin_of = [&](const State& q) {
  const int i = (int)((q.x - west) / BIN), j = (int)((q.y - south) / BIN);
  const int wide = (int)(nx * cell / BIN) + 1, high = (int)(ny * cell / BIN) + 1;
  if (i < 0 || j < 0 || i >= wide || j >= high) return -1;
  const int h = (int)((atan2(q.s, q.c) + PI) / (2.0 * PI) * headings + 0.5) % headings;
  return (i * high + j) * headings + h;
};
auto add = [&](const State& q, D g, int parent, D bend, D way) {
  const int bin = bin_of(q);
  const D e = estimate(q);
  if (bin < 0 || e < 0.0 || g >= best[bin] || g + e >= best_cost || count >= most) return;
  best[bin] = (float)g;
  D* n = nodes + ROW * count;
  n[0] = q.x; n[1] = q.y; n[2] = q.c; n[3] = q.s; n[4] = q.tx; n[5] = q.ty; n[6] = g;
  n[AT_PARENT] = parent; n[AT_BEND] = bend; n[AT_WAY] = way;
  push(g + e, count++);
};
const State first = {m[0], m[1], m[2], m[3], m[4], m[5]};
add(first, 0.0, -1, 0.0, 0.0);
const D arcs[5] = {0.0, 1.0, -1.0, 0.5, -0.5};
while (size) {
  D key;
  const int n = pop(key);
  const D* q0 = nodes + ROW * n;
  if (key >= best_cost - 1e-6 || (best_node >= 0 && popped > found_at + AFTER)) break;
  const State here = {q0[0], q0[1], q0[2], q0[3], q0[4], q0[5]};
  const int bin = bin_of(here);
  if (q0[6] > best[bin] * 1.000001 + 1e-6) continue;
  if (popped % 16 == 0 || far[coarse_of(here.x, here.y)] < SHOT) shoot(n);
  ++popped;
  const D before = q0[AT_WAY], g0 = q0[6];
  for (int way = 1; way >= (reverses ? -1 : 1); way -= 2)
    for (int k = 0; k < 5; ++k) {
      State q = here;
      const D speed = way < 0 ? backwards : arcs[k] == 0.0 ? straight : turning;
      const D changed = before * way < 0.0 ? shift : 0.0;
      D when = start_time + g0 + changed;
      if (!drive(q, arcs[k], way * step, when, speed)) continue;
      // what bends at all costs a little more, so that of two ways alike the straighter one is taken
      add(q, g0 + changed + step / speed * (1.0 + 0.02 * __builtin_fabs(arcs[k])), n, arcs[k], way * step);
    }
}
if (best_node < 0) return;
int pieces = 0;
out[3] = 0.0; out[4 + 2 * pieces++] = best_parts[3];
for (int i = 0; i < 3; ++i) { out[3 + 2 * pieces] = bends[best_word][2 - i] / radius; out[4 + 2 * pieces++] = best_parts[2 - i]; }
for (int n = best_node; n >= 0 && pieces < 2000; n = (int)nodes[ROW * n + AT_PARENT]) {
  const D* q = nodes + ROW * n;
  if (q[AT_PARENT] < 0.0) break;
  out[3 + 2 * pieces] = q[AT_BEND] / radius; out[4 + 2 * pieces++] = q[AT_WAY];
}
out[0] = pieces; out[1] = best_cost; out[2] = popped;
