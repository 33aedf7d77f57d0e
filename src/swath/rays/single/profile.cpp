// Beams against the field as profiles along an edge: the body of one native function, after vectors.cpp. One packet of 16 beams.
//
// In: p, the packet; profile (see `Profile` in kernel.py), canopy, range_max [m]; of the beams origins, directions, score. Out, per beam and
// as flags: as bodies.cpp, without solids.
//
// Each beam in the stand frame, from the corner of the square tile it starts over, as in bodies.cpp: cut cells are the same. The ground
// is the plane of the station and column in which it ends there, and so is the stand.

const int count = beams.count;

constexpr int has_solids = 0, ROUNDS = 8;
constexpr float CLEAR = 1.0f;  // farther from the edge of the standing crop than this nothing leans over it [m]

const int start = p * N, last_station = profile.x.shape[0] - 1, last_bin = profile.reach.shape[0] - 1;
const double size = profile.tile_size;
const float fine = (float)(64.0 / size), per_cell = (float)(size / 64.0);
const I number = count_up + start;
auto& reflectance = profile.reflectance;

// ---- The beams in the stand frame
struct alignas(64) { float ox[N], oy[N], oz[N], dx[N], dy[N], dz[N]; double cx[N], cy[N], cz[N]; } raw = {};
for (int l = 0; l < N && start + l < count; ++l) {
  const auto& o = beams.origins.data[start + l];
  const auto& v = beams.directions.data[start + l];
  const double c = profile.turn[0], s = profile.turn[1], x = c * o[0] + s * o[1], y = c * o[1] - s * o[0];
  raw.cx[l] = __builtin_floor(x / size) * size, raw.cy[l] = __builtin_floor(y / size) * size, raw.cz[l] = __builtin_floor(o[2]);
  raw.ox[l] = (float)(x - raw.cx[l]), raw.oy[l] = (float)(y - raw.cy[l]), raw.oz[l] = (float)(o[2] - raw.cz[l]);
  raw.dx[l] = (float)(c * v[0] + s * v[1]), raw.dy[l] = (float)(c * v[1] - s * v[0]), raw.dz[l] = (float)v[2];
}
const F ox = load(raw.ox), oy = load(raw.oy), oz = load(raw.oz), dx = load(raw.dx), dy = load(raw.dy), dz = load(raw.dz);
const F per_flat = 1.0f / most(root(dx * dx + dy * dy), put(1.0e-6f)), heading_x = dx * per_flat, heading_y = dy * per_flat;

#include "canopy.cpp"

// ---- Along the edge: the station that a place is beside, its way from there, and how far it is left of the edge
struct Beside { F along, left; };
const I all = puti(-1);
auto from_corner = [&](const double* of, const double* corner, I station) -> F {
  struct alignas(64) { int k[N]; float v[N]; } at;
  storei(at.k, station);
  for (int l = 0; l < N; ++l) at.v[l] = (float)(of[at.k[l]] - corner[l]);
  return load(at.v);
};
struct { I station; F x, y, cosine, sine, bend; } held = {puti(-1)};  // stations that were asked for last
auto hold = [&](I station) {
  if (!any(station != held.station)) return;
  held = {station, from_corner((const double*)profile.x.data, raw.cx, station), from_corner((const double*)profile.y.data, raw.cy, station), gather(profile.cosine.data, station, all), gather(profile.sine.data, station, all), 0.5f * gather(profile.curvature.data, station, all)};
};
auto beside = [&](F x, F y, I& station) -> Beside {
  for (int round = 0;; ++round) {
    hold(station);
    const F ex = x - held.x, ey = y - held.y, along = ex * held.cosine + ey * held.sine;
    const I next = mosti(leasti(station + down(along + 0.5f), puti(last_station)), I{});
    if (round == ROUNDS || !any(next != station)) return {along, ey * held.cosine - ex * held.sine - held.bend * along * along};
    station = next;
  }
};
auto column_at = [&](I station, F left) -> I {  // place of its numbers
  const I column = mosti(leasti(down(left * (1.0f / profile.column) + 0.5f) + profile.columns / 2, puti(profile.columns - 1)), I{});
  return station * profile.columns + column;
};
struct Stands { I code; F clear; I is_before; };  // of a place; how far it is from where crop begins or ends [m]; before it begins along the edge
auto stands_at = [&](F x, F y, I& station) -> Stands {
  const Beside at = beside(x, y, station);
  const F along = real(station) + at.along, from_begin = along - profile.begin;
  const I bin = mosti(leasti(down(along * profile.bins_per_m), puti(last_bin)), I{});
  const F inside = profile.is_left ? at.left : -at.left, reach = gather(profile.reach.data, bin, all);
  const F near = gather(profile.near.data, bin, all), far = gather(profile.far.data, bin, all);
  const I grows = (I)(inside >= reach), is_cut = (I)(inside >= near) & (I)(inside < far);
  const I bare = picki(inside >= 0.0f, gatheri(profile.inner.data, bin, all), puti(profile.outer));
  const F apart = least(least(size_of(inside - reach), size_of(from_begin)), least(size_of(inside - near), size_of(inside - far)));
  return {picki(grows, picki(is_cut, puti(profile.cut.data[0]), puti(STANDING)), bare), apart, (I)(from_begin < 0.0f)};
};

// ---- Where each beam gets to the ground
I travels = number < count, station = puti(station_at.data[world]), column = column_at(station, beside(ox, oy, station).left);
int wrong = 0;
F end = put(range_max), a = {}, b = {}, slope_x = {}, slope_y = {};
for (int round = 0; round < 4; ++round) {
  slope_x = gather(profile.slope_x.data, column, all), slope_y = gather(profile.slope_y.data, column, all);
  b = dz - slope_x * dx - slope_y * dy;
  a = oz - from_corner((const double*)profile.z.data, raw.cz, column) - slope_x * (ox - from_corner((const double*)profile.x.data, raw.cx, station)) -
      slope_y * (oy - from_corner((const double*)profile.y.data, raw.cy, station));
  end = pick(b < -1.0e-6f, least(-a / b, put(range_max)), put(range_max));
  if (round == 0 && any(travels & (I)(a < -0.001f))) wrong = 2;
  if (round < 3) column = column_at(station, beside(ox + dx * end, oy + dy * end, station).left);
}
const I is_down = travels & (I)(a + b * end < 1.0e-3f) & (I)(end > 0.0f);
hit_t = pick(is_down, end, hit_t);
hit_organ = picki(is_down, puti(GROUND), hit_organ);
hit_cosine = pick(is_down, size_of(dz - slope_x * dx - slope_y * dy) / root(slope_x * slope_x + slope_y * slope_y + 1.0f), hit_cosine);

// ---- The canopy above
const float* stand = (const float*)profile.stand.data;
const F scales = gather(stand, 4 * column, all), crown = scales * canopy.top_bound;
const F from = pick(b < 0.0f, most(F{}, (crown - a) / b), F{}), to = pick(b > 0.0f, least(end, (crown - a) / b), end);
I inside = travels & (I)(from < to) & (I)(a + b * to <= crown), waits = {};
I sure = puti(-1), foot = station;  // the code all the way along, < 0 where that changes
if (any(inside)) {
  enter(inside, from, to, scales, gather(stand + 1, 4 * column, all), gather(stand + 2, 4 * column, all), gather(stand + 3, 4 * column, all), a, b, F{}, F{});
  const Stands low = stands_at(ox + dx * to, oy + dy * to, station), high = stands_at(ox + dx * from, oy + dy * from, foot);
  // the edge moves by less than `bite` along the way, on which a beam does not cross it where both ends are on one side of it, farther
  // from it than plants lean
  const F margin = CLEAR + gather(profile.bite.data, station, all) + crown * root(lean_x * lean_x + lean_y * lean_y) / scale;
  sure = picki((low.code == high.code) & (low.is_before == high.is_before) & (I)(low.clear > margin) & (I)(high.clear > margin), low.code, sure);
}
auto code_at = [&](I who, I x, I y) -> I {
  if (!any(who & (sure < 0))) return sure;
  return picki(sure < 0, stands_at((real(x) + 0.5f) * per_cell, (real(y) + 0.5f) * per_cell, foot).code, sure);
};
while (any(inside | waits)) {
  if (any(inside)) {
    // In one step: what crop adds up is a difference of projected areas; over stubble down to it
    const I stands = sure == STANDING;
    const F reach = 0.01f * canopy.stubble_bound * real(sure) + 1.0e-3f, over = h0 + h1 * t - reach;
    const I is_drawn = (I)(left >= 0.0f) & ~(stands & (I)(cut > 0.0f));
    const F longer = pick(is_drawn, until - t, pick(stands | (I)(over < 0.0f), F{}, least(until - t, over / most(-h1, put(1.0e-6f)))));
    const Stepped s = step(inside, code_at, pick(sure < 0, F{}, longer));
    waits |= s.first;
    inside &= ~(s.first | s.stops) & (I)(t < until);
  } else {
    draw_for(waits);
    inside = waits;
    waits = I{};
  }
}
// ---- Where in its last step a beam has its echo: back from the projected area above to the height
const I stopped = (I)(stop_length > 0.0f);
if (any(stopped)) {
  I low = {}, high = puti(canopy.depth_steps - 1);
  for (int steps = canopy.depth_steps; steps > 1; steps = (steps + 1) / 2) {
    const I middle = (low + high) >> 1, is_low = (I)(gather(canopy.depth.data, view + middle, all) >= stop_above);
    low = picki(is_low, middle, low), high = picki(is_low, high, middle);
  }
  const F most_area = gather(canopy.depth.data, view + low, all), fall = most_area - gather(canopy.depth.data, view + high, all);
  const F relative = (real(low) + within((most_area - stop_above) / most(fall, put(1.0e-12f)), 0.0f, 1.0f)) * canopy.fine;
  hit_t = pick(stopped, most(stop_from, least(stop_from + stop_length, (relative - r0) / r1)), hit_t);
  hit_organ = picki(stopped & (hit_organ != STUBBLE), picki(r0 + r1 * hit_t > EAR_ZONE, puti(upper_organ), puti(STEM)), hit_organ);
  stop_length = F{};
}
finish(wrong);
