// Shortest ways of a body with a turning radius on a grid: the body of a native function. Hybrid A* (Dolgov et al. 2010,
// DOI 10.1177/0278364909359210): arcs and straights from pose to pose, the distance on the grid as the heuristic, and from
// every pose the Dubins path to the goal, taken where it is free. A trailer is dragged along: its axle stays on the line to
// the pin. Poses are kept as cosine and sine, so that arcs are rotations. A body is clear where discs about patches of its
// points are, each looked up in a grid; the points themselves are looked at in the other patches alone.
//
// In and out: m, see ways.py, whose layout this is. Of poses that share a bin one is kept, found again by a table of hashes.

typedef double D;
const D* m = (const D*)its.numbers.data;
const D* points = (const D*)its.body.data;
const float* free_from = (const float*)its.ground.data;
D* nodes = (D*)its.node_rows.data;
D* keys = (D*)its.heap_keys.data;
int* heap = (int*)its.heap_nodes.data;
constexpr int SLOTS = 1 << 17;  // twice as many as poses at least, as in ways.py
float* best = (float*)its.best_rows.data;
int* bin_in = (int*)best + SLOTS;  // the bin of a slot, -1 for none
float* far = (float*)its.distance.data;
const D* patches = (const D*)its.patch_rows.data;
float *bare_from = (float*)its.bare_rows.data, *within = (float*)its.within_rows.data;
const D* track = (const D*)its.track_rows.data;
const float* edge = (const float*)its.edge_rows.data;
const float* reachable = (const float*)its.reachable_from.data;
int* follows = (int*)its.following.data;
float* lanes = (float*)its.lane_rows.data;
const D* sides = (const D*)its.near_sides.data;
const unsigned char* taken = (const unsigned char*)its.taken_cells.data;
D* out = (D*)its.found.data;
constexpr int ROW = 11, AT_PARENT = 7, AT_BEND = 8, AT_WAY = 9, AT_SLOT = 10;
constexpr D PI = 3.14159265358979323846, NEVER = 1e17, SAMPLE = 1.0, COARSE = 2.0, BIN = 1.5;  // m, as in ways.py
constexpr int SEARCH = 0, LANES = 1, CHECK = 2;  // what is asked for
constexpr D FARTHER = 1.3, BEYOND = 60.0;  // bound of the estimate: so many times as far as the start, and so much [m] more
constexpr D FOLDED = 0.5;  // cosine of a trailer's angle to who tows it, 60 deg
constexpr D BENT = 0.02;  // share by which what bends at all costs more, so that of two ways alike the straighter one is taken
constexpr D LONG = 4.0;  // steps of a long straight
constexpr int NOW_AND_THEN = 16;  // of poses far off the goal, one in so many is joined to it
const D radius = m[10], turning = m[11], straight = m[12], backwards = m[13], shift = m[14], start_time = m[15];
const D cell = m[16], west = m[17], south = m[18], hitch = m[20], drawbar = m[21], step = m[30], tolerance = m[25], cells_m = 1.0 / cell;
const bool has_trailer = m[19] > 0.5, reverses = m[22] > 0.5;
const int capacity = (int)m[23], nx = (int)m[28], ny = (int)m[29], headings = (int)m[31];
const int mode = (int)m[26], patch_count = (int)m[33], near_count = (int)m[36], stand_count = (int)m[38];
const D stray = m[32], around_own[2] = {m[45], m[46]}, around_towed[2] = {m[47], m[48]};
// estimates of ways.py: m, s, -, rad, 1/m, poses
const D SHOT = m[34], LATER = m[35], WEIGHT = m[40], BEND = m[41], PER_M = m[42], AFTER = m[43], OFF = m[44], ROUGH = m[50];
const D* stands = m + 52;  // x, y, radius
const int ratio = (int)(COARSE / cell + 0.5), cx = (nx + ratio - 1) / ratio, cy = (ny + ratio - 1) / ratio;
out[0] = 0.0;

// from when a disc about a cell is free, of crop and all else or of all but crop, once it was asked for
const D reach = m[37];  // cells
auto free_about = [&](float* known, int i, int j, bool over_crop) {
  float& from = known[i * ny + j];
  if (from < -5.0f) {
    from = -1.0f;
    const int r = (int)reach;
    for (int a = -r; a <= r && from < 1e17f; ++a) {
      const int half = (int)__builtin_sqrt(reach * reach - a * a);
      if (i + a < 0 || i + a >= nx || j - half < 0 || j + half >= ny) { from = 2e18f; break; }
      const int row = (i + a) * ny + j;
      for (int b = -half; b <= half; ++b) {
        if (edge[row + b] < 0.75f * cell) from = 2e18f;  // closed, or it begins between the middles of cells
        else if (!over_crop && free_from[row + b] > from) from = free_from[row + b];
      }
    }
  }
  return from;
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
// of who stands so near at the start that cells are too coarse: sides (normal, distance) of convex outlines
auto inside_any = [&](D x, D y) {
  const D* side = sides;
  for (int k = 0; k < near_count; ++k) {
    const int n = (int)side[0];
    bool is_inside = true;
    for (int i = 0; i < n && is_inside; ++i) is_inside = x * side[1 + 3 * i] + y * side[2 + 3 * i] < side[3 + 3 * i];
    if (is_inside) return true;
    side += 1 + 3 * n;
  }
  return false;
};
auto is_near = [&](D x, D y, D around) {  // anybody who stands
  for (int k = 0; k < stand_count; ++k) {
    const D dx = x - stands[3 * k], dy = y - stands[3 * k + 1], near = stands[3 * k + 2] + around;
    if (dx * dx + dy * dy < near * near) return true;
  }
  return false;
};
// a body at a pose and a time: on open ground throughout, its wheels not in standing crop
bool is_alone = false;  // without what it tows
auto is_clear = [&](D x, D y, D c, D s, D tx, D ty, D when) {
  D u = 1.0, w = 0.0;
  if (has_trailer && !is_alone) {
    u = (x + hitch * c - tx) / drawbar; w = (y + hitch * s - ty) / drawbar;
    if (u * c + w * s < FOLDED && mode != CHECK) return false;
  }
  const bool near_own = is_near(x + around_own[0] * c, y + around_own[0] * s, around_own[1]);
  const bool near_towed = has_trailer && !is_alone && is_near(tx + around_towed[0] * u, ty + around_towed[0] * w, around_towed[1]);
  for (int n = 0; n < patch_count; ++n) {
    const D* q = patches + 7 * n;  // x, y, whether on the trailer, raised, radius, first point and the one behind the last
    const bool towed = q[2] > 0.5, raised = q[3] > 0.5;
    if (towed && is_alone) continue;
    const D ox = towed ? tx : x, oy = towed ? ty : y, oc = towed ? u : c, os = towed ? w : s;
    const D mx = ox + q[0] * oc - q[1] * os, my = oy + q[0] * os + q[1] * oc;
    const D mi = (mx - west) * cells_m, mj = (my - south) * cells_m;
    if (!(mi >= 0.0 && mj >= 0.0 && mi < nx && mj < ny)) return false;
    if (free_about(raised ? within : bare_from, (int)mi, (int)mj, raised) <= when && !((towed ? near_towed : near_own) && is_near(mx, my, q[4]))) continue;
    for (int k = (int)q[5]; k < (int)q[6]; ++k) {
      const D* p = points + 2 * k;
      const D px = ox + p[0] * oc - p[1] * os, py = oy + p[0] * os + p[1] * oc, gi = (px - west) * cells_m, gj = (py - south) * cells_m;
      if (gi < 0.0 || gj < 0.0 || gi >= nx || gj >= ny) return false;
      if (inside_any(px, py)) return false;
      const int at = (int)gi * ny + (int)gj;
      if ((stand_count && taken[at]) || (!raised && free_from[at] > when)) return false;
      if (mode == CHECK ? edge[at] < -stray : edge[at] < 1.0f && edge_at(gi, gj) < 0.0) return false;
    }
  }
  return true;
};
if (mode == CHECK) {  // each pose of a track: x, y, heading, heading of the trailer, time
  for (int n = 0; n < (int)m[27]; ++n) {
    const D *q = track + 5 * n, c = cos(q[2]), s = sin(q[2]);
    if (!is_clear(q[0], q[1], c, s, q[0] + hitch * c - drawbar * cos(q[3]), q[1] + hitch * s - drawbar * sin(q[3]), q[4])) return;
  }
  out[0] = 1.0;
  return;
}

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

// the distance to the goal on coarse cells in which a fixed axle can be by then, `reachable` their times: buckets of steps
// along and across (10 and 14 for 10 and 14.1), each a list
auto coarse_of = [&](D x, D y) {
  int i = (int)((x - west) / COARSE), j = (int)((y - south) / COARSE);
  i = i < 0 ? 0 : i >= cx ? cx - 1 : i;
  j = j < 0 ? 0 : j >= cy ? cy - 1 : j;
  return i * cy + j;
};
auto is_taken = [&](int c) {
  const int i = c / cy * ratio, j = c % cy * ratio;
  for (int a = i; a < i + ratio && a < nx; ++a)
    for (int b = j; b < j + ratio && b < ny; ++b)
      if (!taken[a * ny + b]) return false;
  return true;
};
const int goal_cell = coarse_of(m[6], m[7]), start_cell = coarse_of(m[0], m[1]);
const float by_then = (float)(start_time + LATER), unit = (float)(0.1 * COARSE);
for (int c = 0; c < cx * cy; ++c) far[c] = reachable[c] <= by_then ? 1e18f : -1.0f;
far[start_cell] = 1e18f;
far[goal_cell] = 0.0f;
constexpr int RING = 16;
int first_of[RING];
for (int k = 0; k < RING; ++k) first_of[k] = -1;
int entries = 0, unused = -1, waiting = 0, enough = 1 << 30;
auto put = [&](int what, int& first) {  // into the list of a bucket
  const int e = unused >= 0 ? unused : entries++;
  if (e >= (int)m[49]) return false;
  if (e == unused) unused = follows[e];
  heap[e] = what; follows[e] = first; first = e; ++waiting;
  return true;
};
auto take = [&](int& first) {
  const int e = first;
  first = follows[e]; follows[e] = unused; unused = e; --waiting;
  return heap[e];
};
put(goal_cell, first_of[0]);
for (int now = 0; waiting > 0 && now <= enough && mode == SEARCH; ++now) {
  while (first_of[now % RING] >= 0) {
    const int c = take(first_of[now % RING]);
    if (far[c] < now * unit - 0.01f) continue;
    if (c == start_cell && enough == 1 << 30) enough = (int)(FARTHER * now + BEYOND / unit);
    const int i = c / cy, j = c % cy;
    for (int a = -1; a <= 1; ++a)
      for (int b = -1; b <= 1; ++b) {
        if ((!a && !b) || i + a < 0 || j + b < 0 || i + a >= cx || j + b >= cy) continue;
        const int n = c + a * cy + b, d = now + (a && b ? 14 : 10);
        if (d * unit > far[n] - 0.01f) continue;
        if (stand_count && n != start_cell && is_taken(n)) { far[n] = -1.0f; continue; }
        far[n] = d * unit;
        if (!put(n, first_of[d % RING])) return;
      }
  }
}
const bool all_lanes = mode == LANES;
if (far[start_cell] > NEVER && !all_lanes) return;
// the same with eight headings of which each step along one changes at most to the next: so a way
// around a field is not tried first in the direction in which it cannot turn round. A cell is about an eighth of a turning circle
constexpr int TURNS = 8, WIDE_RING = 160, BACK = 3;  // a step backwards counts as three
const int LANE = (int)m[39], AXIS = 10 * LANE, ACROSS = 14 * LANE;
constexpr D EIGHTH = 0.25 * PI;
const int lx = (cx + LANE - 1) / LANE, ly = (cy + LANE - 1) / LANE, ei[TURNS] = {1, 1, 0, -1, -1, -1, 0, 1}, ej[TURNS] = {0, 1, 1, 1, 0, -1, -1, -1};
auto lane_of = [&](D x, D y) { const int c = coarse_of(x, y); return c / cy / LANE * ly + c % cy / LANE; };
auto eighth_of = [&](D c, D s) { const D a = atan2(s, c) / EIGHTH; return (int)floor(a) + TURNS; };
D expected = far[start_cell];
{
  const int goal_lane = lane_of(m[6], m[7]), start_lane = lane_of(m[0], m[1]), start_turn = eighth_of(m[2], m[3]), goal_turn = eighth_of(m[8], m[9]);
  for (int i = 0; i < lx; ++i)
    for (int j = 0; j < ly; ++j) {
      int open = 0;
      for (int a = i * LANE; a < (i + 1) * LANE && a < cx; ++a)
        for (int b = j * LANE; b < (j + 1) * LANE && b < cy; ++b) open += far[a * cy + b] >= 0.0f;
      const int c = i * ly + j;
      for (int h = 0; h < TURNS; ++h) lanes[c * TURNS + h] = 2 * open >= LANE * LANE || c == goal_lane || c == start_lane ? 1e18f : -1.0f;
    }
  int first_lane[WIDE_RING];
  for (int k = 0; k < WIDE_RING; ++k) first_lane[k] = -1;
  entries = 0; unused = -1; waiting = 0; enough = 1 << 30;
  for (int k = 0; k < 2; ++k) {
    const int n = goal_lane * TURNS + (goal_turn + k) % TURNS;
    lanes[n] = 0.0f;
    put(n, first_lane[0]);
  }
  for (int now = 0; waiting > 0 && now <= enough; ++now)
    while (first_lane[now % WIDE_RING] >= 0) {
      const int n = take(first_lane[now % WIDE_RING]), c = n / TURNS, h = n % TURNS;
      if (lanes[n] < now * unit - 0.01f) continue;
      if (c == start_lane && (h == start_turn % TURNS || h == (start_turn + 1) % TURNS) && enough == 1 << 30 && !all_lanes) { enough = (int)(FARTHER * now + BEYOND / unit); expected = now * unit; }
      for (int t = 0; t < (reverses ? 6 : 3); ++t) {  // it came along g, or backwards, and turned to h
        const int g = (h + t % 3 - 1 + TURNS) % TURNS, way = t < 3 ? 1 : -1, i = c / ly - way * ei[g], j = c % ly - way * ej[g];
        if (i < 0 || j < 0 || i >= lx || j >= ly) continue;
        const int from = (i * ly + j) * TURNS + g, d = now + (g % 2 ? ACROSS : AXIS) * (way < 0 ? BACK : 1);
        if (d * unit > lanes[from] - 0.01f) continue;
        lanes[from] = d * unit;
        if (!put(from, first_lane[d % WIDE_RING])) return;
      }
    }
}
auto lane_at = [&](D x, D y, D c, D s) {
  const int n = lane_of(x, y) * TURNS, h = eighth_of(c, s);
  const float a = lanes[n + h % TURNS], b = lanes[n + (h + 1) % TURNS], least = a < b ? a : b;
  return least < 0.0f || least > 1e17f ? -1.0 : (D)least;
};
if (all_lanes) return;
const D poses = 0.5 * m[24] + expected * PER_M;  // more for who has farther to go
const int most = poses < capacity ? (int)poses : capacity;

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
// an arc (bend of -1, 0, 1 over the radius, or part of it) of a signed length: its samples and the turn of each
struct Arc { int count; D step, chord, dc, ds, hc, hs; };
auto arc_of = [&](D bend, D length) {
  const int count = (int)__builtin_ceil(__builtin_fabs(length) / SAMPLE - 1e-9);
  if (count < 1) return Arc{0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0};
  const D d = length / count, k = bend / radius, turn = k * d;
  return Arc{count, __builtin_fabs(d), __builtin_fabs(turn) < 1e-9 ? d : 2.0 * sin(0.5 * turn) / k, cos(turn), sin(turn), cos(0.5 * turn), sin(0.5 * turn)};
};
auto follow = [&](State& q, const Arc& arc, D& when, D speed, auto is_as_asked) {  // as long as each sample is as asked
  for (int i = 0; i < arc.count; ++i) {
    q.x += arc.chord * (q.c * arc.hc - q.s * arc.hs); q.y += arc.chord * (q.s * arc.hc + q.c * arc.hs);
    const D c = q.c * arc.dc - q.s * arc.ds, s = q.s * arc.dc + q.c * arc.ds;
    q.c = c; q.s = s;
    drag(q);
    when += arc.step / speed;
    if (!is_as_asked(q, when)) return false;
  }
  return true;
};
auto roll = [&](State& q, D bend, D length, D& when, D speed, auto is_as_asked) { return follow(q, arc_of(bend, length), when, speed, is_as_asked); };
auto is_free = [&](const State& q, D when) { return is_clear(q.x, q.y, q.c, q.s, q.tx, q.ty, when); };
auto angle_of = [&](D a) { a = a - 2.0 * PI * floor(a / (2.0 * PI)); return a > 2.0 * PI - 1e-9 ? 0.0 : a; };

int count = 0, best_node = -1, best_word = 0, popped = 0, found_at = 0;
D best_cost = 1e18, best_parts[4] = {0.0, 0.0, 0.0, 0.0};
const D bends[4][3] = {{1, 0, 1}, {-1, 0, -1}, {1, 0, -1}, {-1, 0, 1}};
// the parts [m] of the Dubins paths of four words to the goal, or to a run-in before it; the first < 0 where there is none
auto words_to = [&](D x, D y, D c, D s, D run_in, D (*parts)[4]) {
  const D gc = m[8], gs = m[9], dx = m[6] - run_in * gc - x, dy = m[7] - run_in * gs - y, away = __builtin_sqrt(dx * dx + dy * dy);
  const D u = away > 0.0 ? dx / away : 1.0, w = away > 0.0 ? dy / away : 0.0, d = away / radius;
  const D ca = c * u + s * w, sa = s * u - c * w, cb = gc * u + gs * w, sb = gs * u - gc * w, cab = c * gc + s * gs;
  const D a = atan2(sa, ca), b = atan2(sb, cb);
  for (int word = 0; word < 4; ++word) {
    const bool is_left = word % 2 == 0, is_bent_alike = word < 2;
    D square = is_bent_alike ? 2.0 + d * d - 2.0 * cab + 2.0 * d * (is_left ? sa - sb : sb - sa) : -2.0 + d * d + 2.0 * cab + 2.0 * d * (is_left ? sa + sb : -sa - sb);
    parts[word][0] = -1.0;
    if (square < -1e-9) continue;
    if (square < 0.0) square = 0.0;
    const D p = __builtin_sqrt(square);
    D e, t, q;
    if (word == 0) { e = atan2(cb - ca, d + sa - sb); t = e - a; q = b - e; }
    else if (word == 1) { e = atan2(ca - cb, d - sa + sb); t = a - e; q = e - b; }
    else if (word == 2) { e = atan2(-ca - cb, d + sa + sb) - atan2(-2.0, p); t = e - a; q = e - b; }
    else { e = atan2(ca + cb, d - sa - sb) - atan2(2.0, p); t = a - e; q = b - e; }
    parts[word][0] = angle_of(t) * radius; parts[word][1] = p * radius; parts[word][2] = angle_of(q) * radius; parts[word][3] = run_in;
  }
};
const D run_in_line = has_trailer && tolerance > -1.0 ? drawbar * __builtin_log(BEND / __builtin_acos(tolerance)) : 0.0;
// samples of a path to the goal, and when it is there; whether it ends in line is known before where it leads is looked at
const int most_samples = (int)m[51];
State* sample = (State*)its.sample_rows.data;
D* time_at = (D*)(sample + most_samples);
int samples = 0;
auto keep = [&](const State& q, D when) {
  if (samples < most_samples) { sample[samples] = q; time_at[samples] = when; }
  return ++samples <= most_samples;
};
// how far back from the goal, or a run-in before it, whoever tows can have come on the left and the right bend: on a longer
// last bend something is in its way, whatever is before
auto reach_back = [&](D run_in, D* most) {
  is_alone = true;
  State at = {m[6], m[7], m[8], m[9], 0.0, 0.0};
  D when = NEVER;
  const bool is_open = roll(at, 0.0, -run_in, when, 1e18, is_free);
  for (int side = 0; side < 2; ++side) {
    State q = at;
    most[side] = -1.0;
    if (!is_open) continue;
    for (most[side] = 0.0; most[side] < 2.0 * PI * radius && roll(q, side ? -1.0 : 1.0, -SAMPLE, when, 1e18, is_free);) most[side] += SAMPLE;
    most[side] += SAMPLE;
  }
  is_alone = false;
};
D reached_back[2][2];
reach_back(0.0, reached_back[0]);
if (run_in_line > 0.0) reach_back(run_in_line, reached_back[1]);
const D nearly = tolerance > -1.0 ? cos(1.3 * __builtin_acos(tolerance)) : -1.0;
auto in_line = [&](const State& q) { return ((q.x + hitch * q.c - q.tx) * q.c + (q.y + hitch * q.s - q.ty) * q.s) / drawbar; };
// about how far a trailer is in line behind a path: on a straight the tangent of half its angle fades
auto line_behind = [&](State q, int word, const D* p) {
  D when = 0.0;
  for (int i = 0; i < 4; ++i) {
    if (i % 2 == 0) { roll(q, bends[word][i], p[i], when, 1.0, [](const State&, D) { return true; }); continue; }
    const D vx = (q.x + hitch * q.c - q.tx) / drawbar, vy = (q.y + hitch * q.s - q.ty) / drawbar, along = vx * q.c + vy * q.s;
    const D k = (q.c * vy - q.s * vx) / (1.0 + along) * __builtin_exp(-p[i] / drawbar), cf = (1.0 - k * k) / (1.0 + k * k), sf = 2.0 * k / (1.0 + k * k);
    q.x += p[i] * q.c; q.y += p[i] * q.s;
    q.tx = q.x + hitch * q.c - drawbar * (q.c * cf - q.s * sf); q.ty = q.y + hitch * q.s - drawbar * (q.s * cf + q.c * sf);
  }
  return in_line(q);
};
auto shoot_to = [&](int n, D run_in) {  // the shortest of the four that is free
  const D* q0 = nodes + ROW * n;
  const D* most_back = reached_back[run_in > 0.0];
  D parts[4][4], cost[4];
  words_to(q0[0], q0[1], q0[2], q0[3], run_in, parts);
  for (int word = 0; word < 4; ++word) {
    const D* p = parts[word];
    const bool is_possible = p[0] >= 0.0 && p[2] < most_back[bends[word][2] < 0.0];
    cost[word] = is_possible ? q0[6] + (q0[AT_WAY] < 0.0 ? shift : 0.0) + (p[0] + p[2]) / turning + (p[1] + run_in) / straight : 1e18;
  }
  for (int tried = 0; tried < 4; ++tried) {
    int word = 0;
    for (int other = 1; other < 4; ++other) if (cost[other] < cost[word]) word = other;
    const D all = cost[word], *p = parts[word];
    if (all >= best_cost - 1e-6) return;
    cost[word] = 1e18;
    State at = {q0[0], q0[1], q0[2], q0[3], q0[4], q0[5]};
    D when = start_time + q0[6];
    if (has_trailer && tolerance > -1.0 && line_behind(at, word, p) < nearly) continue;
    samples = 0;
    bool is_clear_way = true;
    for (int i = 0; i < 4 && is_clear_way; ++i) is_clear_way = roll(at, i < 3 ? bends[word][i] : 0.0, p[i], when, i % 2 ? straight : turning, keep);
    if (has_trailer && tolerance > -1.0 && in_line(at) < tolerance) continue;
    for (int first = 1; first <= 4 && is_clear_way; ++first)  // what is in the way is longer than a sample: each fourth first
      for (int i = samples - first; i >= 0 && is_clear_way; i -= 4) is_clear_way = is_free(sample[i], time_at[i]);
    if (!is_clear_way) continue;
    if (best_node < 0) found_at = popped;
    best_cost = all; best_node = n; best_word = word;
    for (int i = 0; i < 4; ++i) best_parts[i] = p[i];
    return;
  }
};
auto shoot = [&](int n) {  // a trailer that has to be in line behind a bend comes in line on a straight
  shoot_to(n, 0.0);
  if (run_in_line > 0.0) shoot_to(n, run_in_line);
};
// the time to the goal: on the grid, or of who cannot reverse along the shortest Dubins path, whichever is longer
auto estimate = [&](const State& q) {
  const D on_grid = far[coarse_of(q.x, q.y)];
  if (on_grid < 0.0) return on_grid;
  D least = 1e18, parts[4][4];
  if (!reverses) words_to(q.x, q.y, q.c, q.s, run_in_line, parts);
  for (int word = 0; word < 4 && !reverses; ++word) {
    const D *p = parts[word], t = (p[0] + p[2]) / turning + (p[1] + p[3]) / straight;
    if (p[0] >= 0.0 && t < least) least = t;
  }
  const D on_lanes = lane_at(q.x, q.y, q.c, q.s), farther = on_lanes < 0.0 ? on_grid * WEIGHT + OFF : on_lanes * WEIGHT - ROUGH;
  const D alone = (farther > on_grid * WEIGHT ? farther : on_grid * WEIGHT) / straight;
  return least < 1e17 && least > alone ? least : alone;
};
auto bin_of = [&](const State& q) {
  const int i = (int)((q.x - west) / BIN), j = (int)((q.y - south) / BIN);
  const int wide = (int)(nx * cell / BIN) + 1, high = (int)(ny * cell / BIN) + 1;
  if (i < 0 || j < 0 || i >= wide || j >= high) return -1;
  const int h = (int)((atan2(q.s, q.c) + PI) / (2.0 * PI) * headings + 0.5) % headings;
  return (i * high + j) * headings + h;
};
auto slot_of = [&](int bin) {  // the slot that has it, or the free one in which it would be
  unsigned slot = (unsigned)bin * 2654435761u >> 15;
  while (bin_in[slot] >= 0 && bin_in[slot] != bin) slot = (slot + 1) % SLOTS;
  return (int)slot;
};
auto add = [&](const State& q, D g, int parent, D bend, D way) {
  const int bin = bin_of(q);
  if (bin < 0 || count >= most) return;
  const int slot = slot_of(bin);
  if (bin_in[slot] == bin && g >= best[slot]) return;
  const D e = estimate(q);
  if (e < 0.0 || g + e >= best_cost) return;
  bin_in[slot] = bin; best[slot] = (float)g;
  D* n = nodes + ROW * count;
  n[0] = q.x; n[1] = q.y; n[2] = q.c; n[3] = q.s; n[4] = q.tx; n[5] = q.ty; n[6] = g;
  n[AT_PARENT] = parent; n[AT_BEND] = bend; n[AT_WAY] = way; n[AT_SLOT] = slot;
  push(g + e, count++);
};
const State first = {m[0], m[1], m[2], m[3], m[4], m[5]};
add(first, 0.0, -1, 0.0, 0.0);
const D arcs[6] = {0.0, 1.0, -1.0, 0.5, -0.5, 0.0};
Arc there[6], back[5];
for (int k = 0; k < 6; ++k) there[k] = arc_of(arcs[k], k == 5 ? (LONG - 1.0) * step : step);
for (int k = 0; k < 5; ++k) back[k] = arc_of(arcs[k], -step);
while (size) {
  D key;
  const int n = pop(key);
  const D* q0 = nodes + ROW * n;
  if (key >= best_cost - 1e-6 || (best_node >= 0 && popped > found_at + AFTER)) break;
  const State here = {q0[0], q0[1], q0[2], q0[3], q0[4], q0[5]};
  if (q0[6] > best[(int)q0[AT_SLOT]] * 1.000001 + 1e-6) continue;
  if (popped % NOW_AND_THEN == 0 || far[coarse_of(here.x, here.y)] < SHOT) shoot(n);
  ++popped;
  const D before = q0[AT_WAY], g0 = q0[6];
  State ahead = here;
  D when_ahead = 0.0;
  bool is_open_ahead = false;
  for (int way = 1; way >= (reverses ? -1 : 1); way -= 2)
    for (int k = 0; k < (way > 0 ? 6 : 5); ++k) {  // the last one a long straight, on from the first
      const bool is_long = k == 5;
      if (is_long && !is_open_ahead) continue;
      State q = is_long ? ahead : here;
      const D length = is_long ? LONG * step : step;
      const D speed = way < 0 ? backwards : arcs[k] == 0.0 ? straight : turning;
      const D changed = before * way < 0.0 ? shift : 0.0;
      D when = is_long ? when_ahead : start_time + g0 + changed;
      if (!follow(q, way > 0 ? there[k] : back[k], when, speed, is_free)) continue;
      if (way > 0 && k == 0) { is_open_ahead = true; ahead = q; when_ahead = when; }
      add(q, g0 + changed + length / speed * (1.0 + BENT * __builtin_fabs(arcs[k])), n, arcs[k], way * length);
    }
}
for (int n = 0; n < count; ++n) bin_in[(int)nodes[ROW * n + AT_SLOT]] = -1;  // as it was
if (best_node < 0) return;
int pieces = 0;
out[1] = 0.0; out[2 + 2 * pieces++] = best_parts[3];
for (int i = 0; i < 3; ++i) { out[1 + 2 * pieces] = bends[best_word][2 - i] / radius; out[2 + 2 * pieces++] = best_parts[2 - i]; }
for (int n = best_node; n >= 0 && pieces < 2000; n = (int)nodes[ROW * n + AT_PARENT]) {
  const D* q = nodes + ROW * n;
  if (q[AT_PARENT] < 0.0) break;
  out[1 + 2 * pieces] = q[AT_BEND] / radius; out[2 + 2 * pieces++] = q[AT_WAY];
}
out[0] = pieces;
