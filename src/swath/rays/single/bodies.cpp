// Beams against bodies: the body of one native function (kernel.py), after vectors.cpp. One packet of 16 beams.
//
// In: p, the packet; scene, canopy, range_max [m]; of the beams origins, directions, score (standard normal numbers, low = high up).
// In and out, per beam: distance, kind (organ), cosine, reflectance: with has_solids the nearest solid's, else only out. Out: flags,
// 2 where a beam starts over no known page or under the ground, 256 << k where one left axis k of the grid of standing crop,
// 4096 << k of that of stubble, 65536 where one met lodged crop.
//
// Frames as in kernel/scene.py: each beam in the stand frame, from the corner of the tile it starts over.

const int count = beams.count;

constexpr float TOP_ROOM = 0.12f;      // as in rays/bodies.py
constexpr float STRAW_DEPTH = 0.005f;  // as in kernel/cast.py
constexpr float MARGIN = 0.005f, SLACK = 0.001f, BELOW = 0.001f;  // as in kernel/cast.py, rays/refusals.py

const int start = p * N, nx = scene.table.shape[1], ny = scene.table.shape[0];
const float size = (float)scene.tile_size, per_size = 1.0f / size, per_gap = 8.0f / size, fine = 64.0f / size;
const I number = count_up + start;
auto& reflectance = scene.reflectance;

struct Visited { I enters, ends, through; };

// ---- The beams in the stand frame
const double per_tile = 1.0 / scene.tile_size;
struct alignas(64) { float ox[N], oy[N], oz[N], dx[N], dy[N], dz[N], z0[N]; int tx[N], ty[N]; } raw = {};
for (int l = 0; l < N && start + l < count; ++l) {
  const auto& o = beams.origins.data[start + l];
  const auto& v = beams.directions.data[start + l];
  const double c = scene.turn[0], s = scene.turn[1], x = c * o[0] + s * o[1], y = c * o[1] - s * o[0];
  const double tx = __builtin_floor(x * per_tile), ty = __builtin_floor(y * per_tile), z0 = __builtin_floor(o[2]);
  raw.tx[l] = (int)tx, raw.ty[l] = (int)ty, raw.z0[l] = (float)z0;
  raw.ox[l] = (float)(x - tx * scene.tile_size), raw.oy[l] = (float)(y - ty * scene.tile_size), raw.oz[l] = (float)(o[2] - z0);
  raw.dx[l] = (float)(c * v[0] + s * v[1]), raw.dy[l] = (float)(c * v[1] - s * v[0]), raw.dz[l] = (float)v[2];
}
const F ox = load(raw.ox), oy = load(raw.oy), oz = load(raw.oz), dx = load(raw.dx), dy = load(raw.dy), dz = load(raw.dz), z0 = load(raw.z0);
const I tile_x = loadi(raw.tx), tile_y = loadi(raw.ty), right = dx > 0.0f, upward = dy > 0.0f;
const F per_flat = 1.0f / most(root(dx * dx + dy * dy), put(1.0e-6f)), heading_x = dx * per_flat, heading_y = dy * per_flat;
auto slope_of = [&](F d) -> F { return pick(size_of(d) < 1.0e-12f, F{}, 1.0f / d); };           // t of a plane
auto offset_of = [&](F o, F d) -> F { return pick(size_of(d) < 1.0e-12f, put(MISS), -o / d); };  // x = c: c * slope + offset
const F inv_x = slope_of(dx), inv_y = slope_of(dy), off_x = offset_of(ox, dx), off_y = offset_of(oy, dy);

#include "canopy.cpp"

// ---- Where a beam is: page, tile from its first one, and t; where it leaves the tile, and through which side
I page_x = {}, page_y = {}, slot = {}, jx = {}, jy = {}, along_x = {};
F leave = {};

auto page_of = [&](I px, I py) -> I {  // slot of a page, -1 where nothing is known
  const I i = px - scene.table_x, j = py - scene.table_y;
  const I in = (i >= 0) & (j >= 0) & (i < nx) & (j < ny);
  return picki(in, gatheri(scene.table.data, j * nx + i, in), puti(-1));
};

// The ground of the tile between t0 and t1: patch by patch of the lattice, as cross_ground in kernel/cast.py
auto cross_ground = [&](I who, F t0, F t1) {
  const I low_x = (jx + tile_x - page_x * 8) * 8, low_y = (jy + tile_y - page_y * 8) * 8;
  const F x = (ox - real(page_x * 8 - tile_x) * size) * per_gap, y = (oy - real(page_y * 8 - tile_y) * size) * per_gap, xd = dx * per_gap, yd = dy * per_gap;
  const F gx = slope_of(xd), gy = slope_of(yd), px = offset_of(x, xd), py = offset_of(y, yd);
  I ix = mosti(leasti(down(x + xd * t0), low_x + 7), low_x), iy = mosti(leasti(down(y + yd * t0), low_y + 7), low_y);
  F t = t0;
  while (any(who)) {
    const F tx = real(ix - right) * gx + px, ty = real(iy - upward) * gy + py, leave = least(least(tx, ty), t1);
    const I node = (slot * 65 + iy) * 65 + ix;
    F h[4], s[4];  // surface and depth of straw at the corners
    const int corner[4] = {0, 1, 65, 66};
    for (int i = 0; i < 4; ++i) {
      s[i] = gather(scene.straw.data + corner[i], node, who);
      h[i] = (gather(scene.ground.data + corner[i], node, who) - z0) + s[i];
    }
    const F u = x + xd * t - real(ix), v = y + yd * t - real(iy), hu = h[1] - h[0], hv = h[2] - h[0], huv = h[3] - h[1] - hv;
    const F over = oz + dz * t - (h[0] + hu * u + hv * v + huv * u * v), falls = dz - (hu + huv * v) * xd - (hv + huv * u) * yd;
    // first root in [0, length] of over + falls t + bend t^2, as hit_patch in kernel/shapes.py
    const F bend = -huv * xd * yd, disc = falls * falls - 4.0f * bend * over, r = root(most(disc, F{})), length = most(leave - t, F{});
    const F rising = pick(bend >= 0.0f, put(MISS), -0.5f * (falls + r) / bend), falling = 2.0f * over / (r - falls);
    F step = pick(falls >= 0.0f, rising, falling);
    step = pick((disc >= 0.0f) & (step <= length), step, put(MISS));
    step = pick(over <= 0.0f, pick(falls < 0.0f, F{}, put(MISS)), step);
    const I found = who & (I)(step < MISS) & (I)(t + step < hit_t);
    if (any(found)) {
      const F a = u + xd * step, b = v + yd * step, nu = -(hu + huv * b) * per_gap, nv = -(hv + huv * a) * per_gap;
      const F straw = (s[0] * (1.0f - a) + s[1] * a) * (1.0f - b) + (s[2] * (1.0f - a) + s[3] * a) * b;
      hit_t = pick(found, t + step, hit_t);
      hit_organ = picki(found, picki(straw > STRAW_DEPTH, puti(STRAW), puti(GROUND)), hit_organ);
      hit_cosine = pick(found, size_of(nu * dx + nv * dy + dz) / root(nu * nu + nv * nv + 1.0f), hit_cosine);
    }
    who &= ~found & (I)(leave < t1);
    t = most(leave, t);
    const I along_x = tx <= ty;
    ix += picki(along_x, picki(right, puti(1), puti(-1)), I{});
    iy += picki(along_x, I{}, picki(upward, puti(1), puti(-1)));
    who &= (((ix - low_x) | (iy - low_y)) & ~7) == 0;
  }
};

I row = {};  // of the codes of a page
auto code_at = [&](I who, I x, I y) -> I {  // of cut cells, counted from the page's corner
  const I inside = ((x | y) & ~511) == 0;
  struct alignas(64) { int x[N], y[N], row[N], code[N]; } at;
  storei(at.x, x), storei(at.y, y), storei(at.row, row), storei(at.code, -1 - row);
  for (unsigned m = bits(who & inside & (row >= 0)); m; m &= m - 1) {
    const int l = __builtin_ctz(m);
    at.code[l] = scene.cut.data[((size_t)at.row[l] * 512 + at.y[l]) * 512 + at.x[l]];
  }
  for (unsigned m = bits(who & ~inside); m; m &= m - 1) {  // in a neighbouring page
    const int l = __builtin_ctz(m), i = page_x[l] + (at.x[l] >> 9) - scene.table_x, j = page_y[l] + (at.y[l] >> 9) - scene.table_y;
    const int other = i < 0 || j < 0 || i >= nx || j >= ny ? -1 : scene.table.data[j * nx + i];
    const int its = other < 0 ? -1 - STANDING : scene.cut_slot.data[other];
    at.code[l] = its < 0 ? -1 - its : scene.cut.data[((size_t)its * 512 + (at.y[l] & 511)) * 512 + (at.x[l] & 511)];
  }
  return loadi(at.code);
};
// ---- One tile of beams under way: they end on its ground, enter its canopy, or go on. Says who enters, and who ends
auto visit = [&](I who) -> Visited {
  I ends = who & (I)(t >= hit_t), passes = {};
  who &= ~ends;
  const I px = (tile_x + jx) >> 3, py = (tile_y + jy) >> 3, fresh = who & ((px != page_x) | (py != page_y) | (slot < 0));
  if (any(fresh)) {  // another page: down to the highest thing in it at once, or on to the next
    page_x = picki(fresh, px, page_x);
    page_y = picki(fresh, py, page_y);
    slot = picki(fresh, page_of(px, py), slot);
    ends |= fresh & (slot < 0);
    who &= ~ends;
    const F high = gather(scene.page_top.data, slot, who) - z0;
    F lower = pick(dz < 0.0f, (high - oz) / least(dz, put(-1.0e-6f)), put(MISS));
    lower = pick(oz + dz * t > high, lower, t);
    const I over = fresh & who & (I)(lower > t), bx = page_x * 8 - tile_x, by = page_y * 8 - tile_y;
    const F ex = real(bx + picki(right, puti(8), I{})) * size * inv_x + off_x, ey = real(by + picki(upward, puti(8), I{})) * size * inv_y + off_y;
    const F out = most(least(ex, ey), t);
    t = pick(over, least(lower, out), t);
    passes = over & (I)(lower >= out);
    const I kx = mosti(leasti(down((ox + dx * t) * per_size), bx + 7), bx), ky = mosti(leasti(down((oy + dy * t) * per_size), by + 7), by);
    jx = picki(over, picki(passes & (I)(ex <= ey), picki(right, bx + 8, bx - 1), kx), jx);
    jy = picki(over, picki(passes & (I)(ex > ey), picki(upward, by + 8, by - 1), ky), jy);
    who &= ~passes;
  }
  const I tile = (slot * 8 + ((tile_y + jy) & 7)) * 8 + ((tile_x + jx) & 7);
  const F tx = real(jx - right) * size * inv_x + off_x, ty = real(jy - upward) * size * inv_y + off_y;
  leave = pick(who, most(least(tx, ty), t), leave);
  along_x = picki(who, tx <= ty, along_x);
  const float* planes = (const float*)scene.tile_plane.data;
  const F plane[3] = {gather(planes, 3 * tile, who), gather(planes + 1, 3 * tile, who), gather(planes + 2, 3 * tile, who)};
  const F b = dz - plane[1] * dx - plane[2] * dy;  // height over the tile's plane: a + b t
  const F a = oz - (plane[0] - z0) - plane[1] * (ox - (real(jx) + 0.5f) * size) - plane[2] * (oy - (real(jy) + 0.5f) * size);
  const F end = least(leave, hit_t), lowest = least(a + b * t, a + b * end);
  const F per_b = 1.0f / b;
  auto from = [&](F high) -> F { return pick(b < 0.0f, most(t, (high - a) * per_b), t); };              // where the beam
  auto to = [&](F high, F far) -> F { return pick(b > 0.0f, least(far, (high - a) * per_b), far); };  // is lower than that
  const F bump = gather(scene.tile_bump.data, tile, who) + SLACK, top = gather(scene.tile_top.data, tile, who), scales = gather((const float*)scene.tile_stand.data, 4 * tile, who);
  const F crown = least(top + TOP_ROOM * top, scales * canopy.top_bound);
  const I is_low = who & (I)(lowest <= bump), is_in_crop = who & (I)(top > MARGIN) & (I)(lowest <= crown);
  if (any(is_low)) cross_ground(is_low, from(bump), to(bump, end));
  const F ta = from(crown), tb = to(crown, least(end, hit_t));
  const I enters = is_in_crop & (I)(ta < tb);
  if (any(enters)) {
    const float* stands = (const float*)scene.tile_stand.data;
    row = picki(enters, gatheri(scene.cut_slot.data, slot, enters), row);
    enter(enters, ta, tb, scales, gather(stands + 1, 4 * tile, enters), gather(stands + 2, 4 * tile, enters), canopy.density_max * gather(stands + 3, 4 * tile, enters), a, b,
          real(page_x * 8 - tile_x) * 64.0f, real(page_y * 8 - tile_y) * 64.0f);
  }
  return {enters, ends, who & ~enters};
};

// ---- All beams, each kind of work for as many of them at once as there are
I travels = number < count, inside = {}, waits = {};
slot = page_of(tile_x >> 3, tile_y >> 3);
int wrong = any(travels & (slot < 0)) ? 2 : 0;
for (unsigned m = bits(travels & (slot >= 0) & (I)(oz + z0 <= gather(scene.page_top.data, slot, slot >= 0))); m; m &= m - 1) {
  const int l = __builtin_ctz(m);  // lower than something in its page: over the ground?
  const float x = ox[l] * per_gap, y = oy[l] * per_gap;
  const int ix = x < 7.0f ? (int)x : 7, iy = y < 7.0f ? (int)y : 7;
  const float u = x - ix, v = y - iy, *g = scene.ground.data + ((size_t)slot[l] * 65 + (raw.ty[l] & 7) * 8 + iy) * 65 + (raw.tx[l] & 7) * 8 + ix;
  if ((g[0] * (1.0f - u) + g[1] * u) * (1.0f - v) + (g[65] * (1.0f - u) + g[66] * u) * v - z0[l] - oz[l] > BELOW) wrong = 2;
}
slot = puti(-1);
for (;;) {
  I through = {};  // done with their tile
  if (__builtin_popcount(bits(travels)) > 2 * __builtin_popcount(bits(inside))) {
    const Visited v = visit(travels);
    inside |= v.enters;
    travels &= ~(v.enters | v.ends | v.through);
    through = v.through;
  } else if (any(inside)) {
    const Stepped s = step(inside, code_at, F{});
    waits |= s.first;
    inside &= ~(s.first | s.stops);
    through = inside & (I)(t >= until);
    inside &= ~through;
  } else if (any(waits)) {
    draw_for(waits);
    inside = waits;
    waits = I{};
  } else {
    break;
  }
  through &= (I)(hit_t > leave);
  t = pick(through, leave, t);
  jx += picki(through & along_x, picki(right, puti(1), puti(-1)), I{});
  jy += picki(through & ~along_x, picki(upward, puti(1), puti(-1)), I{});
  travels |= through;
}

finish(wrong);
