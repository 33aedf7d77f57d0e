// Rays through a grid of measured heights: the body of one native function (kernel.py), after vectors.cpp. One packet of 16 rays.
//
// In a cell F(z) is the share of the heights measured there that lie below z, and -log F(z) the thickness of what stands above
// z. A ray that sinks from a to b in it goes on with probability F(b) / F(a): it is above a already; one that rises from b to a
// likewise. It is stopped where the product along its path falls below its own number u in [0, 1). In an even stand the product
// is F(z): it meets measured heights as often as they were measured.
//
// In: p, the packet; g (see `Heights` in kernel.py), seed, share, grain of the draw, range_max [m]; of the beams origins, directions.
// In and out, per ray: distance, kind, cosine, reflectance: with has_solids the nearest solid's, else only out; kind as in
// rays/heights.py, of solids SOLID. Out: cell, -1 = none; flags, 2 where a ray starts under the ground.

const int count = beams.count;

typedef short S32 __attribute__((vector_size(64)));
typedef bool B32 __attribute__((ext_vector_type(32)));
constexpr int MEASURED = 1, UNMEASURED = 2, SOLID = 3, LEVELS = 32, DEEP = 12, NONE = -32768, UNTOUCHED = 255;
constexpr int TILE = 32, BLOCK = 8, PER_TILE = TILE / BLOCK;  // cells along a tile and along a patch of the ground
constexpr int REST = 16;  // numbers of a cell outside its quantiles: DEEP levels, thickness, passed
constexpr float PER_THICKNESS = 50.0f, THICK = 4.1588831f;  // as in rays/height_grid.py; LEVELS are its EVEN
constexpr float FAR = 1.0e9f, FLATTEST = 0.18f, BELOW = 0.001f;  // sine of 10 deg, as in tools/height_map/passing.py; rays/refusals.py

const int start = p * N, nodes_x = g.ground.shape[1], nodes_y = g.ground.shape[0], columns = nodes_x - 1, rows = nodes_y - 1;  // of blocks
const float side = g.cell * BLOCK, per_side = 1.0f / side, per_cell = 1.0f / g.cell;
const I live = count_up + start < count;

// ---- The rays in the grid's frame
struct alignas(64) { float ox[N], oy[N], oz[N], dx[N], dy[N], dz[N]; } raw = {};
for (int l = 0; l < N && start + l < count; ++l) {
  const auto& o = beams.origins.data[start + l];
  const auto& v = beams.directions.data[start + l];
  const double c = g.turn[0], s = g.turn[1], x = o[0] - g.origin[0], y = o[1] - g.origin[1];
  raw.ox[l] = (float)(c * x + s * y), raw.oy[l] = (float)(c * y - s * x), raw.oz[l] = (float)(o[2] - g.origin[2]);
  raw.dx[l] = (float)(c * v[0] + s * v[1]), raw.dy[l] = (float)(c * v[1] - s * v[0]), raw.dz[l] = (float)v[2];
}
const F ox = load(raw.ox), oy = load(raw.oy), oz = load(raw.oz), dx = load(raw.dx), dy = load(raw.dy), dz = load(raw.dz);
const I right = dx > 0.0f, upward = dy > 0.0f, stays_x = size_of(dx) < 1.0e-9f, stays_y = size_of(dy) < 1.0e-9f;
const F per_x = pick(stays_x, F{}, 1.0f / dx), per_y = pick(stays_y, F{}, 1.0f / dy), flattest = FLATTEST * root(dx * dx + dy * dy);

auto ground_at = [&](F x, F y) -> F {  // bilinear, beyond the lattice as at its border
  const F fx = within(x * g.nodes_per_m, 0.0f, (float)(nodes_x - 1)), fy = within(y * g.nodes_per_m, 0.0f, (float)(nodes_y - 1));
  const I i = leasti(whole(fx), puti(nodes_x - 2)), j = leasti(whole(fy), puti(nodes_y - 2)), at = j * nodes_x + i;
  const F u = fx - real(i), v = fy - real(j);
  float h[4][N];
  int k[N];
  storei(k, at);
  for (int l = 0; l < N; ++l) {
    const float* n = g.ground.data + k[l];
    h[0][l] = n[0], h[1][l] = n[1], h[2][l] = n[nodes_x], h[3][l] = n[nodes_x + 1];
  }
  const F low = load(h[0]) + (load(h[1]) - load(h[0])) * u, high = load(h[2]) + (load(h[3]) - load(h[2])) * u;
  return low + (high - low) * v;
};
auto height_over = [&](F t) -> F { return oz + dz * t - ground_at(ox + dx * t, oy + dy * t); };
auto enter_x = [&](I i) -> F { return pick(stays_x, put(-FAR), (real(i + 1 + right) * g.cell - ox) * per_x); };  // of a cell
auto enter_y = [&](I j) -> F { return pick(stays_y, put(-FAR), (real(j + 1 + upward) * g.cell - oy) * per_y); };
auto shorts = [](const short* p, const int* k) -> I {
  return I{p[k[0]], p[k[1]], p[k[2]], p[k[3]], p[k[4]], p[k[5]], p[k[6]], p[k[7]], p[k[8]], p[k[9]], p[k[10]], p[k[11]], p[k[12]], p[k[13]], p[k[14]], p[k[15]]};
};
auto place_of = [&](I slot, I cx, I cy) -> I {  // of a cell in the pools, block by block
  return (((slot * PER_TILE + ((cy >> 3) & (PER_TILE - 1))) * PER_TILE + ((cx >> 3) & (PER_TILE - 1))) << 6) + ((cy & 7) << 3) + (cx & 7);
};
auto exit_x = [&](I i, float width) -> F { return pick(stays_x, put(FAR), (real(i - right) * width - ox) * per_x); };
auto exit_y = [&](I j, float width) -> F { return pick(stays_y, put(FAR), (real(j - upward) * width - oy) * per_y); };

// ---- What is drawn for a ray: the share u, of all rays or by the cell of ground that it is aimed at
const F under = ground_at(ox, oy);
if (any(live & (I)(under - oz > BELOW))) beams.flags.data[0] |= 2;
F drawn = put(share);
if (share < 0.0f) {
  const F aim = pick(dz < -1.0e-6f, within((under - oz) / pick(dz < -1.0e-6f, dz, put(-1.0f)), 0.0f, range_max), put(range_max));
  auto mix = [](I h) -> I {  // lowbias32, C. Wellons, hash-prospector (public domain)
    typedef unsigned U __attribute__((vector_size(64)));
    U v = (U)h;
    v = (v ^ (v >> 16)) * 0x7FEB352Du;
    v = (v ^ (v >> 15)) * 0x846CA68Bu;
    return (I)(v ^ (v >> 16));
  };
  const I h = mix(mix(puti(seed) ^ mix(down((ox + dx * aim) / grain))) ^ down((oy + dy * aim) / grain));
  drawn = (real((h >> 8) & 0xffffff) + 0.5f) / 16777216.0f;
}

// ---- The distribution of a cell: its quantiles [mm], the thickness below these, and what is left of it when it was cut
auto log_one = [&](float x) -> float { return log_of(put(x))[0]; };
auto exp_one = [&](float x) -> float { return x < -80.0f ? 0.0f : exp_of(put(x))[0]; };
auto row_of = [&](int at) -> const short* { return g.quantiles.data + (size_t)at * LEVELS; };
auto rest_of = [&](int at) -> const short* { return g.rest.data + (size_t)at * REST; };
auto number = [](const short* at) -> float { float x; __builtin_memcpy(&x, at, 4); return x; };
auto thickness_in = [&](int at) -> float { return number(rest_of(at) + DEEP); };
auto whole_of = [&](int at) -> float { return __builtin_fabsf(thickness_in(at)); };
auto thickness_at = [&](int at, int k) -> float {  // at the k-th of the heights from the lowest up to the first quantile
  return k == 0 ? whole_of(at) : k >= DEEP ? THICK : rest_of(at)[k] / PER_THICKNESS;
};
struct Below { float share, thickness; };  // of the heights in a cell; thickness < 0: the share says it
auto below = [&](int at, float z) -> Below {
  const short* q = row_of(at);
  const float mm = 1000.0f * z;
  Below found = {0.0f, FAR};
  if (mm > (float)q[LEVELS - 1]) {
    found = {1.0f, -1.0f};
  } else if (mm > (float)q[0]) {
    S32 all;
    __builtin_memcpy(&all, q, 64);
    const B32 lower = __builtin_convertvector(all < (short)__builtin_ceilf(mm), B32);
    unsigned bits_below;
    __builtin_memcpy(&bits_below, &lower, 4);
    int k = __builtin_popcount(bits_below) - 1;  // largest level below z
    k = k > LEVELS - 2 ? LEVELS - 2 : k < 0 ? 0 : k;
    const float a = q[k], b = q[k + 1];
    found = {((float)k + 0.5f + (mm - a) / (b - a > 1.0f ? b - a : 1.0f)) / LEVELS, -1.0f};
    const float passed = __builtin_fabsf(number(rest_of(at) + DEEP + 2));  // beams went below all that was measured here: no less than their share
    if (found.share < passed) found.share = passed;
  } else if (const float lowest = rest_of(at)[0]; mm > lowest) {
    const float span = (float)q[0] - lowest, f = DEEP * (mm - lowest) / (span > 1.0f ? span : 1.0f);
    const int k = (int)f > DEEP - 1 ? DEEP - 1 : (int)f;
    const float a = thickness_at(at, k), b = thickness_at(at, k + 1), thick = a + (b - a) * (f - (float)k);
    found.thickness = thick < whole_of(at) ? thick : whole_of(at);
  } else if (z > 0.0f && thickness_in(at) >= 0.0f) {
    found.thickness = whole_of(at);
  }
  const int stubble = g.cut.data[at];
  if (stubble < UNTOUCHED) {
    const float cut = 100.0f * z / (stubble > 0 ? (float)stubble : 0.01f), kept = cut < 0.0f ? 0.0f : cut > 1.0f ? 1.0f : cut;
    const float part = found.thickness < 0.0f ? found.share : exp_one(-found.thickness);
    found = {part > kept ? part : kept, -1.0f};
    if (found.share <= 0.0f) found.thickness = FAR;
  }
  return found;
};
auto thickness_of = [&](Below b) -> float { return b.thickness < 0.0f ? -log_one(b.share) : b.thickness; };
auto height_under = [&](int at, bool has_passed, float thickness, float part) -> float {  // of a cell that has this thickness above it, part = its exp(-) [m]
  const short* q = row_of(at);
  float z = 0.0f;  // the ground stops what nothing measured did
  if ((!has_passed && thickness <= THICK) || thickness <= whole_of(at) || thickness_in(at) < 0.0f) {  // not has_passed: no less than THICK
    if (thickness <= THICK) {
      float f = part * LEVELS - 0.5f;
      f = f < 0.0f ? 0.0f : f > LEVELS - 1 ? (float)(LEVELS - 1) : f;
      const int k = (int)f > LEVELS - 2 ? LEVELS - 2 : (int)f;
      z = 0.001f * (q[k] + (float)(q[k + 1] - q[k]) * (f - (float)k));
    } else {
      int k = DEEP - 1;
      while (k > 0 && thickness_at(at, k) < thickness) --k;
      const float a = thickness_at(at, k), b = thickness_at(at, k + 1), lowest = rest_of(at)[0];
      const float f = a <= thickness ? 0.0f : (a - thickness) / (a - b > 1.0e-6f ? a - b : 1.0e-6f);
      z = 0.001f * (lowest + ((float)q[0] - lowest) * ((float)k + (f > 1.0f ? 1.0f : f)) / DEEP);
    }
  }
  const int stubble = has_passed ? g.cut.data[at] : UNTOUCHED;
  const float left = 0.01f * (float)stubble * part;
  return stubble < UNTOUCHED && left < z ? left : z;
};

// ---- Into the box of the grid
F hit_t = has_solids ? load(beams.distance.data + start) : put(range_max), hit_cosine = has_solids ? load(beams.cosine.data + start) : F{};
F hit_albedo = has_solids ? load(beams.reflectance.data + start) : F{};
I hit_kind = {}, hit_cell = puti(-1);
const I solid = has_solids ? loadi(beams.kind.data + start) != 0 : I{};
auto slab_in = [&](F o, F per, I stays, float high) -> F {
  const F a = -o * per, b = (high - o) * per;
  return pick(stays, pick((o < 0.0f) | (o >= high), put(FAR), put(-FAR)), least(a, b));
};
auto slab_out = [&](F o, F per, I stays, float high) -> F {
  const F a = -o * per, b = (high - o) * per;
  return pick(stays, pick((o < 0.0f) | (o >= high), put(-FAR), put(FAR)), most(a, b));
};
F t = most(most(slab_in(ox, per_x, stays_x, side * columns), slab_in(oy, per_y, stays_y, side * rows)), F{});
F t_out = least(slab_out(ox, per_x, stays_x, side * columns), slab_out(oy, per_y, stays_y, side * rows));
const I outside = t >= t_out;
t = pick(outside, F{}, t);
t_out = pick(outside, F{}, t_out);
auto stop = [&](I who, F at, int what) {
  hit_t = pick(who, at, hit_t);
  hit_kind = picki(who, puti(what), hit_kind);
};
const F limit = hit_t, begin = t;  // nothing behind a solid counts
const I early = live & (I)(t < limit) & (I)(t < t_out) & (I)(height_over(t) < 0.0f);  // into the ground before the box
stop(early, t, UNMEASURED);
const F end = least(t_out, limit);
const I sinks = dz < -1.0e-6f;
const F per_z = 1.0f / pick(sinks, dz, put(-1.0f));
t = pick(sinks, most(t, least((g.top_bound - oz) * per_z, end)), pick(oz + dz * t > g.top_bound, most(t, end), t));  // nothing stands above the top_bound

// ---- Blocks and their cells in the order of the rays
I i = mosti(leasti(down((ox + dx * t) * per_side), puti(columns - 1)), I{}), j = mosti(leasti(down((oy + dy * t) * per_side), puti(rows - 1)), I{});
I first = {}, cx = {}, cy = {};  // place of the block's first cell, < 0 = none; the cell, counted from the corner of the grid
I blocks = live & ~early & (I)(t < end), cells = {}, over = live & ~early & ~blocks;  // at a block's border; in its cells; behind it all
struct alignas(64) { float low[N], high[N]; int at[N], next[N], lid[N], bound[2][N]; } in = {};
F c0 = {}, c1 = {}, c2 = {}, c3 = {};  // ground of the block that each ray is in
F a = {}, leave = {}, survived = put(1.0f);
I stopped = {};
const I step_x = picki(right, puti(1), puti(-1)), step_y = picki(upward, puti(1), puti(-1));
auto over_patch = [&](F t) -> F {  // height over the ground of the block
  const F u = (ox + dx * t) * g.nodes_per_m - real(i), v = (oy + dy * t) * g.nodes_per_m - real(j);
  return oz + dz * t - (c0 + c1 * u + (c2 + c3 * u) * v);
};
// ---- Tile by tile down to the first one that is not below the ray; blocks as if each had been stepped over
auto block_at = [&](I k, I tile, F t, F o, F d, I stays, I step, auto exit) -> I {  // the one that a ray is in at t, along an axis
  const I guess = mosti(leasti(down((o + d * t) * per_side), tile * PER_TILE + (PER_TILE - 1)), tile * PER_TILE);
  return picki(stays, k, guess - picki((I)(exit(guess - step, side) > t) & ((guess - step) / PER_TILE == tile), step, I{}));
};
for (I far = blocks; any(far);) {
  const I tile_x = i / PER_TILE, tile_y = j / PER_TILE;
  const F ex = exit_x(tile_x, PER_TILE * side), ey = exit_y(tile_y, PER_TILE * side), to = most(least(least(ex, ey), end), t);
  far &= ~(I)(oz + least(dz * t, dz * to) <= gather(g.tile_top.data, tile_y * (columns / PER_TILE) + tile_x, far));
  if (!any(far)) break;
  const I along_x = ex <= ey;
  const I next_x = picki(right, tile_x * PER_TILE + PER_TILE, tile_x * PER_TILE - 1), next_y = picki(upward, tile_y * PER_TILE + PER_TILE, tile_y * PER_TILE - 1);
  i = picki(far, picki(along_x, next_x, block_at(i, tile_x, to, ox, dx, stays_x, step_x, exit_x)), i);
  j = picki(far, picki(along_x, block_at(j, tile_y, to, oy, dy, stays_y, step_y, exit_y), next_y), j);
  t = pick(far, to, t);
  const I gone = far & ((i < 0) | (j < 0) | (i >= columns) | (j >= rows) | (I)(t >= end));
  over |= gone;
  blocks &= ~gone;
  far &= ~gone;
}
F met_share = put(1.0f), met_thick = {}, met_low = {}, met_high = {}, met_survived = {}, met_t = {}, met_after = {};
I met_has_passed = {}, met_at = {}, met_rises = {};
while (true) {
  if (any(blocks)) {
    const F ex = exit_x(i, side), ey = exit_y(j, side);
    leave = pick(blocks, most(least(least(ex, ey), end), t), leave);
    const F top = gather(g.block_top.data, j * columns + i, blocks);
    const I low = blocks & (I)(oz + least(dz * t, dz * leave) <= top);
    if (any(low)) {  // on to the cell where the ray comes down to the highest surface of the block
      storei(in.at, j * columns + i);
      for (unsigned m = bits(low); m; m &= m - 1) {
        const int l = __builtin_ctz(m);
        const I me = count_up == l;
        const float* c = g.patch.data + 4 * (size_t)in.at[l];
        c0 = pick(me, put(c[0]), c0), c1 = pick(me, put(c[1]), c1), c2 = pick(me, put(c[2]), c2), c3 = pick(me, put(c[3]), c3);
        first = picki(me, puti(g.first.data[in.at[l]]), first);
      }
      const F to = pick(sinks, most(t, least((top - oz) * per_z, leave)), t);
      const I first_x = i * BLOCK, first_y = j * BLOCK;
      cx = picki(low, mosti(leasti(down((ox + dx * to) * per_cell), first_x + (BLOCK - 1)), first_x), cx);
      cy = picki(low, mosti(leasti(down((oy + dy * to) * per_cell), first_y + (BLOCK - 1)), first_y), cy);
      t = pick(low, most(most(enter_x(cx), enter_y(cy)), begin), t);
      a = pick(low, over_patch(t), a);
      cells |= low;
    }
    const I on = blocks & ~low, along_x = ex <= ey;
    t = pick(on, leave, t);
    i += picki(on & along_x, step_x, I{});
    j += picki(on & ~along_x, step_y, I{});
    const I gone = on & ((i < 0) | (j < 0) | (i >= columns) | (j >= rows) | (I)(t >= end));
    over |= gone;
    blocks = on & ~gone;
    continue;
  }
  if (!any(cells)) break;
  const F ex = exit_x(cx, g.cell), ey = exit_y(cy, g.cell), after = most(least(least(ex, ey), leave), t);
  const F b = over_patch(after);
  const I along_x = ex <= ey;
  const I at = first + ((cy & 7) << 3) + (cx & 7);
  const F flat = flattest * (after - t);  // flat rays count as if they sank or rose more steeply
  const I rises = b > a;
  const F low = pick(rises, a, least(b, a - flat)), high = pick(rises, most(b, a + flat), a);
  const I known = cells & (first >= 0);
  storei(in.at, known ? at : I{});
  const I lid = known ? shorts(g.lid.data, in.at) : puti(NONE);
  const I is_measured = lid != NONE, ground = cells & ~is_measured & (I)(b <= 0.0f);
  const F low_mm = 1000.0f * low, high_mm = 1000.0f * high;
  const I within_top = is_measured & (I)(low_mm <= real(lid & ~3));  // others are above all that was measured
  I done = {};
  if (any(within_top)) {
    storei(in.bound[0], whole(__builtin_elementwise_ceil(low_mm)));
    storei(in.bound[1], whole(__builtin_elementwise_ceil(least(high_mm, real(lid | 3)))));
    storei(in.lid, lid);
    storei(in.next, place_of(first >> 10, cx + picki(along_x, step_x, I{}), cy + picki(along_x, I{}, step_y)));
    I pair[2] = {}, found = {};  // quantiles on both sides of each end; how many lie below it, are there none, and the last
    F passed = {}, ratio = {}, thick = put(-1.0f);
    for (unsigned m = bits(within_top); m; m &= m - 1) {
      const int l = __builtin_ctz(m), n = in.at[l];
      const I me = count_up == l;
      const short* q = row_of(n);
      __builtin_prefetch(row_of(in.next[l]));
      S32 all;
      __builtin_memcpy(&all, q, 64);
      unsigned below_it[2];
      int count[2], both[2];
      for (int e = 0; e < 2; ++e) {
        const B32 lower = __builtin_convertvector(all < (short)in.bound[e][l], B32);
        __builtin_memcpy(&below_it[e], &lower, 4);
        count[e] = __builtin_popcount((below_it[e] & 0x7fffffffu) | 1u);  // 1 .. 31
        __builtin_memcpy(&both[e], q + count[e] - 1, 4);
      }
      pair[0] = picki(me, puti(both[0]), pair[0]), pair[1] = picki(me, puti(both[1]), pair[1]);
      found = picki(me, puti(((int)q[LEVELS - 1] << 16) | (~below_it[1] & 1) << 15 | (count[1] << 8) | (~below_it[0] & 1) << 7 | count[0]), found);
      passed = pick(me, put(number(rest_of(n & -(in.lid[l] & 1)) + DEEP + 2)), passed);  // of some other cell where it does not count
    }
    passed = pick((lid & 1) != 0, passed, F{});
    const I under = (found & 128) != 0, closed = under & ((lid & 3) == 2), slow = (under & ~closed) | (I)(passed < 0.0f);
    thick = pick(closed & ((found & 32768) != 0), put(FAR), thick);
    if (any(slow)) {  // below the quantiles, or cut
      store(in.low, low), store(in.high, high);
      for (unsigned m = bits(slow); m; m &= m - 1) {
        const int l = __builtin_ctz(m), n = in.at[l];
        const I me = count_up == l;
        const Below lower = below(n, in.low[l]), upper = below(n, in.high[l]);
        float left = 0.0f;
        if (lower.thickness < 0.0f && upper.thickness < 0.0f) {
          left = lower.share / upper.share;
        } else if (upper.thickness < FAR && lower.thickness < FAR) {
          left = exp_one(thickness_of(upper) - thickness_of(lower));
        }
        ratio = pick(me, put(left), ratio);
        thick = pick(me, put(thickness_of(upper)), thick);
      }
    }
    auto share_of = [&](I both, I count, F mm) -> F {
      const F x = real((both << 16) >> 16), y = real(both >> 16);
      const F f = (real(count) - 0.5f + (mm - x) / most(y - x, put(1.0f))) * (1.0f / LEVELS);
      return pick(mm > real(found >> 16), put(1.0f), most(f, passed));
    };
    const F lower = share_of(pair[0], found & 127, low_mm), upper = share_of(pair[1], (found >> 8) & 127, high_mm);
    const F left = survived * pick(slow | closed, ratio, lower / upper);
    done = within_top & ~(I)(left > drawn);
    met_at = picki(done, at, met_at), met_rises = picki(done, rises, met_rises);
    met_low = pick(done, low, met_low), met_high = pick(done, high, met_high), met_survived = pick(done, survived, met_survived);
    met_share = pick(done, upper, met_share), met_thick = pick(done, thick, met_thick), met_has_passed = picki(done, lid & 1, met_has_passed);
    met_t = pick(done, t, met_t), met_after = pick(done, after, met_after);
    stopped |= done;
    survived = pick(within_top & ~done, left, survived);
  }
  stop(ground, t + (after - t) * within(a / most(a - b, put(1.0e-9f)), 0.0f, 1.0f), UNMEASURED);
  cells &= ~(done | ground);
  a = pick(cells, b, a);
  t = pick(cells, after, t);
  const I out = cells & (I)(after >= leave);
  cx += picki(cells & ~out & along_x, step_x, I{});
  cy += picki(cells & ~out & ~along_x, step_y, I{});
  const I crossed = out | (cells & (((cx >> 3) != i) | ((cy >> 3) != j)));
  cells &= ~crossed;
  if (!any(crossed)) continue;
  const I block_x = exit_x(i, side) <= exit_y(j, side);  // to the next block
  t = pick(crossed, leave, t);
  i += picki(crossed & block_x, step_x, I{});
  j += picki(crossed & ~block_x, step_y, I{});
  const I gone = crossed & ((i < 0) | (j < 0) | (i >= columns) | (j >= rows) | (I)(t >= end));
  over |= gone;
  blocks = crossed & ~gone;
}

// ---- Where in its last cell a ray was stopped
if (any(stopped)) {
  storei(in.at, met_at);
  storei(in.lid, met_has_passed);
  const F above = pick(met_thick < 0.0f, -log_of(met_share), met_thick);
  const F deeper = above - log_of(drawn / met_survived), part = pick(deeper > 80.0f, F{}, exp_of(-deeper));
  float depth[N], parts[N], at_height[N];
  store(depth, deeper), store(parts, part);
  for (int l = 0; l < N; ++l) at_height[l] = 0.0f;
  for (unsigned m = bits(stopped & (I)(above < FAR)); m; m &= m - 1) {
    const int l = __builtin_ctz(m);
    at_height[l] = height_under(in.at[l], in.lid[l] != 0, depth[l], parts[l]);
  }
  const I is_open = (I)(above < FAR) & (I)(met_high > met_low);
  const F down_to = within((met_high - load(at_height)) / most(met_high - met_low, put(1.0e-30f)), 0.0f, 1.0f);
  const F held = pick(is_open, pick(met_rises, 1.0f - down_to, down_to), F{});
  stop(stopped, met_t + (met_after - met_t) * held, MEASURED);
  const I slot_block = met_at >> 6, in_tile = slot_block & 15;
  const I cell_y = ((in_tile >> 2) << 3) + ((met_at >> 3) & 7), cell_x = ((in_tile & 3) << 3) + (met_at & 7);
  hit_cell = picki(stopped, ((slot_block >> 4) * TILE + cell_y) * TILE + cell_x, hit_cell);
}

// ---- Beyond the box the ground goes on as at its border
if (any(over)) {
  const F reached = t - height_over(t) / pick(dz < 0.0f, dz, put(-1.0f));
  stop(over & (I)(t < limit) & (I)(dz < 0.0f) & (I)(reached < limit), reached, UNMEASURED);
}
const I measured = hit_kind == MEASURED;
hit_cosine = pick(measured, put(1.0f), hit_cosine);
hit_albedo = pick(measured, gather(g.intensity.data, hit_cell, measured), hit_albedo);
hit_kind = picki(solid & (hit_kind == 0), puti(SOLID), hit_kind);
hit_t = pick(hit_kind == 0, put(__builtin_nanf("")), hit_t);
store(beams.distance.data + start, hit_t);
storei(beams.kind.data + start, hit_kind);
storei(beams.cell.data + start, hit_cell);
store(beams.cosine.data + start, hit_cosine);
store(beams.reflectance.data + start, hit_albedo);
