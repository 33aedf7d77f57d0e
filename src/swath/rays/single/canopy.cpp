// How beams go through crop: what `bodies.cpp` and `profile.cpp` share, in the middle of either, after vectors.cpp.
//
// In: p, canopy, beams, has_solids, range_max; number of each beam; its origin and direction ox to dz in a frame whose x runs along the
// rows; heading_x, heading_y of the direction on the ground; fine: cut cells in a metre; reflectance of the organs.
// A field says where it enters the canopy (`enter`), and which code a cut cell has.

constexpr int STANDING = 255, GROUND = 1, STRAW = 2, STEM = 3, EAR = 4, STUBBLE = 6;
constexpr float EAR_ZONE = 0.85f;      // crop above this share of its height counts as ears
constexpr float SPOT_AT = 0.9f;        // share of the height of crop or stubble where the spot is taken, or lower at a wall
constexpr float LODGED = 0.364f;       // crop leans by more than 20 deg: aside per height
constexpr float FLAT = 1.0e-3f;        // steps that change the relative height by less use the projected area itself
constexpr float FALL = 0.025f;         // steps lose no more height than this [m]
constexpr float THIN = 1.0e-4f, FEW = 1.0e-5f;  // where less projected area than this lies above, steps are doubled, and again [m2]
constexpr int HALVINGS = 5;            // of the step that holds the echo, which falls 10 cm at most; straight from there
constexpr float SNAP = 1.0e-4f;        // values so close to a node, in shares of a step, are taken as on it
const float per_fine = 1.0f / canopy.fine, per_height = 1.0f / canopy.height;

struct Stepped { I first, stops; };  // met crop, or standing crop after stubble, for the first time; have their echo

const int upper_organ = reflectance.data[EAR] > 0.0f ? EAR : STEM;  // crops without ears reflect as stems do

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
auto place = [&](const auto& grid, int first, int nodes, F value) __attribute__((noinline)) -> Place {  // lower node on an axis, share of the way to the next
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
auto draw = [&](I who, const auto& grid, int flag, F density, F scale, F height, F top, F tangent, F spot) __attribute__((noinline)) {
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

F t = {};  // where a beam is

// ---- The canopy of a tile, in steps along the beam short enough for what stands around each of them. Of a beam in it:
// until where, the stand, height over the tile's plane as h0 + h1 t and in crop heights as r0 + r1 t, place in cut cells from
// the page's corner as x0 + x1 t, optical depth per projected area, projected area above
F stop_from = {}, stop_length = {}, stop_above = {};  // the step in which a beam has its echo, and the projected area above the echo
F until = {}, density = {}, scale = put(1.0f), lean_x = {}, lean_y = {}, h0 = {}, h1 = {}, r0 = {}, r1 = {}, x0 = {}, x1 = {}, y0 = {}, y1 = {};
F speed = put(1.0f), pitch = put(1.0f), unit = {}, above = {}, spot = put(1.0f);
const int parts = canopy.aside.shape[0] / (2 * canopy.aside_levels);  // of plants at a level, and what lies opposite
const float row_cells = canopy.row * fine, per_row = row_cells > 0.0f ? 1.0f / row_cells : 0.0f;  // rows lie along x
const float per_level = 1.0f / canopy.aside_step, aside = canopy.height * fine;

// Beams enter the canopy at `from` and leave it at `to`. scales, leans_x, leans_y, stems: of the stand; a + b t: height over the ground;
// corner_x, corner_y: from where cells are counted
auto enter = [&](I who, F from, F to, F scales, F leans_x, F leans_y, F stems, F a, F b, F corner_x, F corner_y) {
  until = pick(who, to, until);
  h0 = pick(who, a, h0), h1 = pick(who, b, h1);
  scale = pick(who, scales, scale);
  lean_x = pick(who, leans_x, lean_x), lean_y = pick(who, leans_y, lean_y);
  density = pick(who, stems, density);
  t = pick(who, from, t);
  const F per_scale = 1.0f / scale, rise = h0 * per_scale, rate = h1 * per_scale, flow_x = dx - lean_x * rate, flow_y = dy - lean_y * rate;
  speed = most(root(flow_x * flow_x + flow_y * flow_y), put(1.0e-3f));
  pitch = least(put(canopy.pitch), FALL / most(size_of(h1), put(1.0e-6f)));
  unit = -density * speed / pick(rate == 0.0f, put(1.0f), rate);
  r0 = rise * per_height, r1 = rate * per_height;
  x0 = (ox - lean_x * rise) * fine - corner_x, x1 = flow_x * fine;
  y0 = (oy - lean_y * rise) * fine - corner_y, y1 = flow_y * fine;
  const F tangent = size_of(h1) / speed;
  I seen_from = {};
  for (int k = 0; k < canopy.view.shape[0]; ++k) seen_from -= (I)(put(canopy.view.data[k]) <= tangent);
  view = picki(who & (I)(left < 0.0f), canopy.depth_steps * seen_from, view);
  above = area_above(r0 + r1 * t);
};
auto step = [&](I who, auto& code_at, F longer) -> Stepped {  // one step of beams in the canopy; code_at: of cut cells; longer: than others it may be
  const F dt = least(most(longer, pick(above < THIN, pick(above < FEW, 4.0f * pitch, 2.0f * pitch), pitch)), until - t), middle = t + 0.5f * dt;
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
  F upmost = {};  // nothing of stubble adds up above its reach
  if (any(acts & ~stands)) upmost = pick(stands, upmost, area_above(reach * per_height / scale));
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

auto draw_for = [&](I waits) {  // of beams that met crop: what they meet
  const I stands = waits & (I)(cut == 0.0f), over_stubble = waits & ~stands;
  const F tangent = most(-h1, put(1.0e-4f)) / speed, reach = cut * canopy.stubble_bound / (canopy.height * scale);
  out_of |= stands & (I)(lean_x * lean_x + lean_y * lean_y > LODGED * LODGED) & 256;
  if (any(stands)) draw(stands, canopy.standing, 1, density, scale, canopy.height * scale, put(MISS), tangent, spot);
  if (any(over_stubble)) draw(over_stubble, canopy.stubble, 16, density, scale, cut, reach, tangent, spot);
};

auto finish = [&](int wrong) {  // wrong: flags so far
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
  hit_albedo = pick(is_field, gather(reflectance.data, hit_organ, is_field), hit_albedo);
  store(beams.distance.data + start, hit_t);
  storei(beams.kind.data + start, hit_organ);
  store(beams.cosine.data + start, hit_cosine);
  store(beams.reflectance.data + start, hit_albedo);
  for (int axis = 0; axis < 9; ++axis) wrong |= any((out_of & (1 << axis)) != 0) ? 256 << axis : 0;
  beams.flags.data[0] |= wrong;
};
