// Beams against bodies: the body of one native function (kernel.py), after vectors.cpp. One packet of 16 beams.
//
// In: p, the packet; scene, canopy, range_max [m]; of the beams origins, directions, score (standard normal numbers, low = high up).
// In and out, per beam: distance, kind (organ), cosine, reflectance: with has_solids the nearest solid's, else only out. Out: flags,
// 2 where a beam starts over no known page or under the ground, 256 << k where one left axis k of the grid of standing crop,
// 4096 << k of that of stubble, 65536 where one met lodged crop.
//
// Frames as in kernel/scene.py: each beam in the stand frame, from the corner of the tile it starts over.

const int count = beams.count;

constexpr int STANDING = 255, GROUND = 1, STRAW = 2, STEM = 3, EAR = 4, STUBBLE = 6;
constexpr float EAR_ZONE = 0.85f;      // crop above this share of its height counts as ears
constexpr float SPOT_AT = 0.9f;        // share of the height of crop or stubble where the spot is taken, or lower at a wall
constexpr float LODGED = 0.364f;       // crop leans by more than 20 deg: aside per height
constexpr float FLAT = 1.0e-3f;        // steps that change the relative height by less use the projected area itself
constexpr float TOP_ROOM = 0.12f;      // as in rays/bodies.py
constexpr float FALL = 0.025f;         // steps lose no more height than this [m]
constexpr float THIN = 1.0e-4f, FEW = 1.0e-5f;  // where less projected area than this lies above, steps are doubled, and again [m2]
constexpr int HALVINGS = 5;            // of the step that holds the echo, which falls 10 cm at most; straight from there
constexpr float SNAP = 1.0e-4f;        // values so close to a node, in shares of a step, are taken as on it
constexpr float STRAW_DEPTH = 0.005f;  // as in kernel/cast.py
constexpr float MARGIN = 0.005f, SLACK = 0.001f, BELOW = 0.001f;  // as in kernel/cast.py, rays/refusals.py

const int start = p * N, nx = scene.table.shape[1], ny = scene.table.shape[0];
const float size = (float)scene.tile_size, per_size = 1.0f / size, per_gap = 8.0f / size, fine = 64.0f / size;
const float per_fine = 1.0f / canopy.fine, per_height = 1.0f / canopy.height;
const I number = count_up + start;

struct Stepped { I first, stops; };  // met crop, or standing crop after stubble, for the first time; have their echo
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

const int upper_organ = scene.reflectance.data[EAR] > 0.0f ? EAR : STEM;  // crops without ears reflect as stems do

// ---- What a beam carries
F hit_t = put(range_max), hit_cosine = {}, hit_albedo = {};
I hit_organ = {}, out_of = {};
if (has_solids) {
  hit_t = load(beams.distance.data + start), hit_cosine = load(beams.cosine.data + start), hit_albedo = load(beams.reflectance.data + start);
  hit_organ = loadi(beams.kind.data + start);
}
const F share = normal_share(load(beams.score.data + start));
I turn = whole(share * 65536.0f);  // which part of a plant the next step looks for: digits that say little about the depth
F left = put(-1.0f), spent = {}, full = put(1.0f);  // optical depth until the echo (-1 = no crop met yet), passed, of a full canopy
F seen = {}, lift = {};  // of what it was drawn for: share of beams that crop stops, mean measured height of the others [m]
F entry = put(MISS);     // relative height where it first met what it was drawn for
F cut = put(-1.0f);      // what it was drawn for: height of stubble [m], 0 = standing crop

I view = {};  // where the silhouettes from its depression begin

auto area_above = [&](F relative) -> F {  // per stem above a relative height [m2]
  const int last = canopy.depth_steps - 1;
  const F x = within(relative * per_fine, 0.0f, (float)last);
  const I k = leasti(whole(x), puti(last - 1)), at = view + k;
  const F a = gather(canopy.depth.data, at, puti(-1));
  return a + (gather(canopy.depth.data + 1, at, puti(-1)) - a) * (x - real(k));
};

// ---- The table: fill in the optical depth of beams that meet crop here
struct Place { I node; F share; I outside; };
auto place = [&](const auto& grid, int first, int nodes, F value) -> Place {  // lower node on an axis, share of the way to the next
  const float* axis = grid.axes.data + first;
  if (nodes < 2) return {I{}, F{}, size_of(value - axis[0]) > 0.1f};
  I k = {};
  for (int n = 1; n < nodes - 1; ++n) k -= (I)(put(axis[n]) <= value);
  const F low = gather(axis, k, puti(-1)), s = (value - low) / (gather(axis + 1, k, puti(-1)) - low);
  return {k, pick(s < SNAP, F{}, pick(s > 1.0f - SNAP, put(1.0f), s)), (s < -1.0e-3f) | (s > 1.001f)};
};
// On the log of a depth that was drawn for beams from above: how much less it varies through the side of a crop
struct Nodes { decltype(canopy.side_axes)& axes; };
auto from_side = [&](I who, F depth, F entry, F spot) -> F {
  const Nodes nodes{canopy.side_axes};
  const int levels = canopy.side_size[0], spots = canopy.side_size[1];
  const Place z = place(nodes, 0, levels, within(entry, nodes.axes.data[0], nodes.axes.data[levels - 1]));
  const Place w = place(nodes, levels, spots, within(log_of(pick(who, spot, put(1.0f))), nodes.axes.data[levels], nodes.axes.data[levels + spots - 1]));
  auto between = [&](const float* data, I at) -> F { return gather(data, at, who) * (1.0f - w.share) + gather(data + 1, at, who) * w.share; };
  const F middle = between(canopy.side_median.data, w.node), off = log_of(most(depth, put(1.0e-6f))) - middle;
  const I cell = z.node * spots + w.node + picki(off > 0.0f, puti(levels * spots), I{});
  const F factor = between(canopy.side_factor.data, cell) * (1.0f - z.share) + between(canopy.side_factor.data + spots, cell) * z.share;
  return exp_of(middle + factor * off);
};
// height: of the crop or its stubble [m]; top: relative height below which crop adds up; flag: of its first axis
auto draw = [&](I who, const auto& grid, int flag, F density, F scale, F height, F top, F tangent, F spot) {
  const int n0 = grid.size[0], n1 = grid.size[1], n2 = grid.size[2], n3 = grid.size[3], nodes = canopy.node_count;
  const Place at[4] = {place(grid, 0, n0, log_of(pick(who, density, put(1.0f)))), place(grid, n0, n1, flag == 1 ? height : log_of(pick(who, height, put(1.0f)))),
                       place(grid, n0 + n1, n2, log_of(pick(who, tangent, put(1.0f)))),
                       place(grid, n0 + n1 + n2, n3, log_of(pick(who, spot, put(1.0f))))};
  const int stride[4] = {n1 * n2 * n3, n2 * n3, n3, 1};
  I base = {}, outside = {};
  for (int i = 0; i < 4; ++i) base += at[i].node * stride[i], outside |= at[i].outside & (flag << i);
  auto at_corners = [&](auto add) {  // the 16 cells around, where any beam needs them, with their weights
    for (int corner = 0; corner < 16; ++corner) {
      F w = put(1.0f);
      int cell = 0;
      for (int i = 0; i < 4; ++i) {
        const bool up = corner >> i & 1;
        w *= up ? at[i].share : 1.0f - at[i].share;
        cell += up ? stride[i] : 0;
      }
      const I on = who & (I)(w > 0.0f);
      if (any(on)) add(base + cell, w, on);
    }
  };
  F loglog = {}, mean_lift = {};
  at_corners([&](I cell, F w, I on) {
    loglog += w * gather(grid.ground.data, cell, on);
    mean_lift += w * gather(grid.lift.data, cell, on);
  });
  const F stopped = 1.0f - exp_of(-exp_of(loglog));
  const F x = arc_cos(within(1.0f - 2.0f * share / stopped, -1.0f, 1.0f)) * (float)(0.318309886 * (nodes - 1));
  const I k = mosti(leasti(whole(x), puti(nodes - 2)), I{}), is_crop = who & (I)(share < stopped);
  const F f = x - real(k);
  F relative = {};
  at_corners([&](I cell, F w, I on) {
    const I q = cell * nodes + k;
    relative += w * (gather(grid.quantile.data, q, on) * (1.0f - f) + gather(grid.quantile.data + 1, q, on) * f);
  });
  // beyond the grid its end is used, as an optical depth: a thinner stand is looked into deeper
  const F cot = 1.0f / within(tangent, grid.tangents[0], grid.tangents[1]), known = within(density, grid.densities[0], grid.densities[1]);
  const F depth = known * scale * cot, none = area_above(top);
  const F drawn = relative * height / (canopy.height * scale);
  F needed = depth * most(area_above(drawn) - none, F{});
  const I aside = who & (I)(entry < canopy.side_axes.data[canopy.side_size[0] - 1]);
  if (flag == 1 && any(aside)) needed = pick(aside, from_side(aside, needed, entry, spot), needed);
  needed -= spent;
  left = pick(who, pick(is_crop, most(needed, F{}), put(MISS)), left);
  full = pick(who, density * scale * cot * (area_above(F{}) - none), full);
  seen = pick(who, stopped, seen);
  lift = pick(who, mean_lift, lift);
  out_of |= who & outside;
};

// ---- Where a beam is: page, tile from its first one, and t; where it leaves the tile, and through which side
I page_x = {}, page_y = {}, slot = {}, jx = {}, jy = {}, along_x = {};
F t = {}, leave = {};

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

// ---- The canopy of a tile, in steps along the beam short enough for what stands around each of them. Of a beam in it:
// until where, the stand, height over the tile's plane as h0 + h1 t and in crop heights as r0 + r1 t, place in cut cells from
// the page's corner as x0 + x1 t, optical depth per projected area, projected area above
F stop_from = {}, stop_length = {}, stop_above = {};  // the step in which a beam has its echo, and the projected area above the echo
F until = {}, density = {}, scale = put(1.0f), lean_x = {}, lean_y = {}, h0 = {}, h1 = {}, r0 = {}, r1 = {}, x0 = {}, x1 = {}, y0 = {}, y1 = {};
F speed = put(1.0f), pitch = put(1.0f), unit = {}, above = {}, spot = put(1.0f);
I row = {};
const int parts = canopy.aside.shape[0] / (2 * canopy.aside_levels);  // of plants at a level, and what lies opposite
const float row_cells = canopy.row * fine, per_row = row_cells > 0.0f ? 1.0f / row_cells : 0.0f;  // rows lie along x
const float per_level = 1.0f / canopy.aside_step, aside = canopy.height * fine;

auto enter = [&](I who, F from, F to, I tile, F scales, F a, F b) {
  const float* stands = (const float*)scene.tile_stand.data;
  until = pick(who, to, until);
  h0 = pick(who, a, h0), h1 = pick(who, b, h1);
  scale = pick(who, scales, scale);
  lean_x = pick(who, gather(stands + 1, 4 * tile, who), lean_x), lean_y = pick(who, gather(stands + 2, 4 * tile, who), lean_y);
  density = pick(who, canopy.density_max * gather(stands + 3, 4 * tile, who), density);
  row = picki(who, gatheri(scene.cut_slot.data, slot, who), row);
  t = pick(who, from, t);
  const F per_scale = 1.0f / scale, rise = h0 * per_scale, rate = h1 * per_scale, flow_x = dx - lean_x * rate, flow_y = dy - lean_y * rate;
  speed = most(root(flow_x * flow_x + flow_y * flow_y), put(1.0e-3f));
  pitch = least(put(canopy.pitch), FALL / most(size_of(h1), put(1.0e-6f)));
  unit = -density * speed / pick(rate == 0.0f, put(1.0f), rate);
  r0 = rise * per_height, r1 = rate * per_height;
  x0 = (ox - lean_x * rise) * fine - real(page_x * 8 - tile_x) * 64.0f, x1 = flow_x * fine;
  y0 = (oy - lean_y * rise) * fine - real(page_y * 8 - tile_y) * 64.0f, y1 = flow_y * fine;
  const F tangent = size_of(h1) / speed;
  I seen_from = {};
  for (int k = 0; k < canopy.view.shape[0]; ++k) seen_from -= (I)(put(canopy.view.data[k]) <= tangent);
  view = picki(who & (I)(left < 0.0f), canopy.depth_steps * seen_from, view);
  above = area_above(r0 + r1 * t);
};
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
auto step = [&](I who) -> Stepped {  // one step of beams in the canopy
  const F dt = least(pick(above < THIN, pick(above < FEW, 4.0f * pitch, 2.0f * pitch), pitch), until - t), middle = t + 0.5f * dt;
  const F relative = r0 + r1 * middle, below = area_above(r0 + r1 * (t + dt));
  const I looks = who & (I)(relative > 0.0f), level = mosti(leasti(whole(relative * per_level), puti(canopy.aside_levels - 1)), I{});
  const I part = 2 * (level * parts + (turn & (parts - 1)));
  const F far = pick((turn & parts) != 0, put(-aside), put(aside)), along = gather(canopy.aside.data, part, looks) * far, across = gather(canopy.aside.data + 1, part, looks) * far;
  F aside_y = along * heading_y + across * heading_x;
  if (row_cells > 0.0f) aside_y *= gather(canopy.from_row.data, level, looks);
  const F foot_x = x0 + x1 * middle - (along * heading_x - across * heading_y), between = y0 + y1 * middle - aside_y;
  const F foot_y = row_cells > 0.0f ? (real(down(between * per_row)) + 0.5f) * row_cells : between;
  const I code = code_at(looks, down(foot_x), down(foot_y));
  const I stands = code == STANDING;
  const F stubble = 0.01f * real(code);
  const F reach = stubble * canopy.stubble_bound, lowest = h0 + h1 * pick(h1 < 0.0f, t + dt, t);
  const I meets = looks & (stands | (I)(reach > lowest));
  const I first = meets & ((I)(left < 0.0f) | (stands & (I)(cut > 0.0f))), acts = meets & ~first;
  if (any(first)) {
    const F spot_at = SPOT_AT * pick(stands, put(1.0f), stubble * per_height / scale);
    const F deeper = most(relative - spot_at, F{}) / most(-r1, put(0.05f));
    entry = pick(first, relative, entry);
    cut = pick(first, pick(stands, F{}, stubble), cut);
    spot = pick(first, most(canopy.exit + canopy.divergence * (middle + deeper), put(1.0e-4f)), spot);
  }
  const F upmost = pick(stands, F{}, area_above(reach * per_height / scale));  // nothing of stubble adds up above its reach
  const F from = most(above, upmost), to = most(below, upmost);
  F gain = unit * (to - from);
  const I flat = acts & (I)(size_of(r1 * dt) <= FLAT);
  if (any(flat)) {
    const F half = put(0.5f * canopy.fine), width = area_above(relative - half) - area_above(relative + half);
    gain = pick(flat, density * speed * dt * width * (per_fine * per_height), gain);
  }
  const I stops = acts & (I)(gain >= left), goes_on = acts & ~stops;
  const F reached = left / gain;
  hit_t = pick(stops, t + dt * reached, hit_t);
  stop_from = pick(stops, t, stop_from);
  stop_length = pick(stops & ~flat, dt, stop_length);
  stop_above = pick(stops, from + (to - from) * reached, stop_above);
  hit_organ = picki(stops, picki(code == STANDING, picki(relative > EAR_ZONE, puti(upper_organ), puti(STEM)), puti(STUBBLE)), hit_organ);
  hit_cosine = pick(stops, put(canopy.cosine), hit_cosine);
  left = pick(goes_on, left - gain, pick(stops, F{}, left));
  spent = pick(goes_on, spent + gain, spent);
  who &= ~first;  // those draw, and repeat the step with the same part of a plant
  turn -= who;
  above = pick(who, below, above);
  t = pick(who, t + dt, t);
  return {first, stops};
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
  if (any(enters)) enter(enters, ta, tb, tile, scales, a, b);
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
    const Stepped s = step(inside);
    waits |= s.first;
    inside &= ~(s.first | s.stops);
    through = inside & (I)(t >= until);
    inside &= ~through;
  } else if (any(waits)) {
    const I stands = waits & (I)(cut == 0.0f), over_stubble = waits & ~stands;
    const F tangent = most(-h1, put(1.0e-4f)) / speed, reach = cut * canopy.stubble_bound / (canopy.height * scale);
    out_of |= stands & (I)(lean_x * lean_x + lean_y * lean_y > LODGED * LODGED) & 256;
    if (any(stands)) draw(stands, canopy.standing, 1, density, scale, canopy.height * scale, put(MISS), tangent, spot);
    if (any(over_stubble)) draw(over_stubble, canopy.stubble, 16, density, scale, cut, reach, tangent, spot);
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

// ---- Where in its last step a beam has its echo: the projected area is anything but a straight line there, above all near the top
if (any(stop_length > 0.0f)) {
  const F falls = pick(r1 < 0.0f, put(1.0f), put(-1.0f));
  F near = stop_from, far = stop_from + stop_length;
  for (int k = 0; k < HALVINGS; ++k) {
    const F middle = 0.5f * (near + far);
    const I is_far = (falls * (area_above(r0 + r1 * middle) - stop_above) >= 0.0f);
    far = pick(is_far, middle, far), near = pick(is_far, near, middle);
  }
  const F a = area_above(r0 + r1 * near), b = area_above(r0 + r1 * far), rise = b - a;
  const F part = within(pick(size_of(rise) > 0.0f, (stop_above - a) / rise, put(0.5f)), 0.0f, 1.0f);
  hit_t = pick(stop_length > 0.0f, near + (far - near) * part, hit_t);
}

// ---- Ground seen through crop is reported a little above itself: crop hides the far part of the spot. Those that get to the
// ground are spread evenly from 0 to twice the mean, the later drawn the lower; where less crop was passed than was drawn
// for, there are more of them, and they are lifted less
const I is_ground = (hit_organ == GROUND) | (hit_organ == STRAW);
const F passed = least(put(1.0f), spent / most(full, put(1.0e-9f)));
const F rank = least(put(1.0f), (1.0f - share) / most(1.0f - seen * passed, put(1.0e-9f)));
const F raised = 2.0f * lift * rank * passed / most(-dz, put(0.05f));
hit_t = pick(is_ground & (I)(spent > 0.0f), hit_t - raised, hit_t);
const I is_field = (hit_organ > 0) & (hit_organ < 7);
hit_albedo = pick(is_field, gather(scene.reflectance.data, hit_organ, is_field), hit_albedo);
store(beams.distance.data + start, hit_t);
storei(beams.kind.data + start, hit_organ);
store(beams.cosine.data + start, hit_cosine);
store(beams.reflectance.data + start, hit_albedo);
for (int axis = 0; axis < 9; ++axis) wrong |= any((out_of & (1 << axis)) != 0) ? 256 << axis : 0;
beams.flags.data[0] |= wrong;
