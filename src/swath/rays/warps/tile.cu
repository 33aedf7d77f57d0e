// ---- One tile: its rays, the columns that they pass, what they hit

// How high what is left of cut crop can reach, for each column of the tile, by the highest code of the columns around it
// in which its stems may stand; beyond the page all may stand. False: nothing here is cut.
auto find_cut = [&]() {
  if (tile.cut_row < 0 || index.columns != 8 || index.skirt > 4) return false;
  const unsigned char* rows = scene.cut.data + (size_t)tile.cut_row * 512 * 512;
  int least = STANDING;
  for (int part = 0; part < 2; ++part) {  // the tile's own columns, then those around it
    for (int base = 0; base < 256; base += WARP) EACH_LANE {
      const int x = (base + lane) % 16, y = (base + lane) / 16, cx = tile.jx * 8 - 4 + x, cy = tile.jy * 8 - 4 + y;
      const bool is_own = x >= 4 && x < 12 && y >= 4 && y < 12;
      int code = STANDING, low = STANDING;
      if (is_own == (part == 0)) {
        if (cx >= 0 && cy >= 0 && cx < 64 && cy < 64) {
          code = 0;
          for (int i = 0; i < 64; ++i) {
            const int found = rows[(cy * 8 + i / 8) * 512 + cx * 8 + i % 8];
            code = found > code ? found : code;
            low = found < low ? found : low;
          }
        }
        codes[base + lane] = (unsigned char)code;
      }
      fold_least(least, is_own ? low : STANDING);
    }
    if (least == STANDING) return false;
  }
  for (int base = 0; base < 64; base += WARP) EACH_LANE {
    const int x = (base + lane) % 8, y = (base + lane) / 8;
    int code = 0;
    for (int j = -index.skirt; j <= index.skirt; ++j)
      for (int i = -index.skirt; i <= index.skirt; ++i) {
        const int found = codes[(y + 4 + j) * 16 + x + 4 + i];
        code = found > code ? found : code;
      }
    s.tallest[(tile.mirror_y ? 7 - y : y) * 8 + (tile.mirror_x ? 7 - x : x)] =
        code == STANDING ? FAR : code == 0 ? -FAR : 0.01f * (float)code * tile.squeeze + 0.02f;
  }
  return true;
};

// How high plants and ground reach above the tile's plane, both above the group's height, how deep the ground below the plane
struct Heights { float top, bump, crest, dip; };

// Rays into the tile, and into its prototype by the plain kernel's formulas. Gives the slices that get down to the
// ground; sets `walkers`, and `lead`, the first ray that walks
auto enter = [&](unsigned acts, const Heights& h, int& lead) {
  unsigned grounds = 0;
  walkers = 0;
  lead = ROOM;
  for (int base = 0; base < count; base += WARP) {
    if (!(acts >> (base / N) & 3u)) continue;
    EACH_LANE {
      const int j = base + lane, k = j / N;
      unsigned low = 0, walks = 0;
      if (j < count && acts >> k & 1) {
        const Four o = four(ray_origin + j), d = four(ray_direction + j);
        const float now = s.t[j], best = lower(now, s.rest[k].w);
        const float kx = (float)tile.x - cast_off(o.w, 0), ky = (float)tile.y - cast_off(o.w, 1);
        float t0 = 0.0f, t1 = FAR;
        auto cross = [&](float from, float o_, float d_) {
          if (::fabsf(d_) < 1e-12f) {
            if (!(o_ >= from * size && o_ < (from + 1.0f) * size)) t0 = FAR;
            return;
          }
          const float per_d = 1.0f / d_, off = -o_ / d_;
          t0 = upper((d_ > 0.0f ? from : from + 1.0f) * size * per_d + off, t0);
          t1 = lower((d_ > 0.0f ? from + 1.0f : from) * size * per_d + off, t1);
        };
        cross(kx, o.x, d.x);
        cross(ky, o.y, d.y);
        bool live = t0 <= t1 && t0 < best;
        s.key[j] = 0;
        s.state[j] &= HIT;
        if (tile.slot < 0) {  // lost: nothing is known from here on
          if (live) { s.t[j] = t0; s.state[j] = 0; }
        } else {
          const float h1 = d.z - tile.plane1 * d.x - tile.plane2 * d.y;
          const float rise = s.lift - cast_off(o.w, 2);
          const float h0 = o.z - rise - tile.plane1 * (o.x - (kx + 0.5f) * size) - tile.plane2 * (o.y - (ky + 0.5f) * size);
          const float lowest = lower(h0 + h1 * t0, h0 + h1 * lower(t1, best));
          if (live && lowest <= h.bump) low = 1u << k;
          float ta = t0, tb = lower(t1, best);
          const float through = (h.top - h0) / h1, under = (h.dip - h0) / h1;
          if (h1 < 0.0f) { ta = upper(ta, through); tb = lower(tb, under); }
          if (h1 > 0.0f) { ta = upper(ta, under); tb = lower(tb, through); }
          live = live && h.top > 0.005f && lowest <= h.top && ta <= tb;
          const float zd = h1 * tile.squeeze, z = (h0 + h1 * ta) * tile.squeeze;
          float xd = d.x - tile.lean_x * zd, yd = d.y - tile.lean_y * zd;
          float x = o.x - kx * size + d.x * ta - tile.lean_x * z, y = o.y - ky * size + d.y * ta - tile.lean_y * z;
          if (tile.mirror_x) { x = size - x; xd = -xd; }
          if (tile.mirror_y) { y = size - y; yd = -yd; }
          const float stretch = ::sqrtf(xd * xd + yd * yd + zd * zd), shrink = 1.0f / stretch, end = (tb - ta) * stretch;
          live = live && end < 200.0f * size;
          ray_way[j] = {ta, t0, t1, end};
          if (live) {
            ray_point[j] = {x, y, z, (t0 - ta) * stretch};
            ray_ahead[j] = {xd * shrink, yd * shrink, zd * shrink, shrink};
            s.state[j] |= HERE;
            s.key[j] = key_of((lower(t1, best) - ta) * stretch, 0);
            walks = 1u << k;
          }
        }
      }
      fold_bits(grounds, low);
      fold_bits(walkers, walks);
      fold_least(lead, walks ? j : ROOM);
    }
  }
  return grounds;
};

auto of = [&](int axis, float x, float y, float z) { return axis == 0 ? x : axis == 1 ? y : z; };
int axis = 0, ib = 1, ic = 2;
float way0 = 0.0f, way1 = 0.0f;
int sense = 0;

// Where the rays of each slice go along the walk's axis, as linear bounds
auto find_ways = [&](int lead) {
  const Four q_ = four(ray_ahead + lead);
  const float qx = ::fabsf(q_.x), qy = ::fabsf(q_.y), qz = ::fabsf(q_.z);
  axis = qz > upper(qx, qy) ? 2 : qx >= qy ? 0 : 1;
  ib = axis == 2 ? 1 : 1 - axis;
  ic = axis == 2 ? 0 : 2;
  const float room = of(axis, index.reach[0], index.reach[1], index.reach[2]) + ROUND + of(axis, index.side, index.side, index.bin_height);
  const float wide_b = of(ib, index.reach[0], index.reach[1], index.reach[2]) + ROUND;
  const float wide_c = of(ic, index.reach[0], index.reach[1], index.reach[2]) + ROUND;
  float u0 = FAR, u1 = -FAR, v0 = FAR, v1 = -FAR;
  way0 = FAR;
  way1 = -FAR;
  sense = 0;
  EACH_LANE {
    const bool walks = lane < SLICES && walkers >> lane & 1;
    int turn = 0;
    float a0 = FAR, a1 = -FAR, slowest = FAR, leave = -FAR;
    if (walks) {
      bool forth = false, back = false;
      for (int i = 0; i < N; ++i) {
        const int j = lane * N + i;
        if (!(s.state[j] & HERE)) continue;
        const Four p = four(ray_point + j), q = four(ray_ahead + j), e = four(ray_way + j);
        const float x = of(axis, p.x, p.y, p.z), d = of(axis, q.x, q.y, q.z), y = x + d * e.w;
        a0 = lower(a0, lower(x, y));
        a1 = upper(a1, upper(x, y));
        leave = upper(leave, e.z);
        slowest = lower(slowest, ::fabsf(d));
        turn += d > 0.0f ? 1 : -1;
        if (d > 0.0f) forth = true;
        else back = true;
      }
      const bool is_straight = slowest > 0.05f && !(forth && back);
      const float plane0 = a0 - room, plane1 = a1 + room;
      s.a0[lane] = a0;
      s.a1[lane] = a1;
      s.from[lane] = plane0;
      s.leave[lane] = leave;
      float low[2][3] = {{FAR, FAR, FAR}, {FAR, FAR, FAR}}, high[2][2] = {{-FAR, -FAR}, {-FAR, -FAR}};
      for (int i = 0; i < N; ++i) {  // where they are at both planes, or from end to end
        const int j = lane * N + i;
        if (!(s.state[j] & HERE)) continue;
        const Four p = four(ray_point + j), q = four(ray_ahead + j), e = four(ray_way + j);
        const float per_d = 1.0f / of(axis, q.x, q.y, q.z), x = of(axis, p.x, p.y, p.z);
        const float ways[2] = {is_straight ? (plane0 - x) * per_d : 0.0f, is_straight ? (plane1 - x) * per_d : e.w};
        for (int end = 0; end < 2; ++end) {
          const float way = ways[end], b = of(ib, p.x, p.y, p.z) + way * of(ib, q.x, q.y, q.z);
          const float c = of(ic, p.x, p.y, p.z) + way * of(ic, q.x, q.y, q.z), t = e.x + way * q.w;
          for (int side = 0; side < 2; ++side) {
            if (is_straight && side != end) continue;
            low[side][0] = lower(low[side][0], b);
            high[side][0] = upper(high[side][0], b);
            low[side][1] = lower(low[side][1], c);
            high[side][1] = upper(high[side][1], c);
            low[side][2] = lower(low[side][2], t);
          }
        }
      }
      auto bound = [&](int i, float x0, float x1) {
        s.bound[i][lane] = x0;
        s.rise[i][lane] = (x1 - x0) / (plane1 - plane0);
      };
      bound(0, low[0][0] - wide_b, low[1][0] - wide_b);
      bound(1, high[0][0] + wide_b, high[1][0] + wide_b);
      bound(2, low[0][1] - wide_c, low[1][1] - wide_c);
      bound(3, high[0][1] + wide_c, high[1][1] + wide_c);
      bound(4, low[0][2] - ROUND, low[1][2] - ROUND);
    }
    const Four box = walks ? s.box[lane] : Four{0.0f, 0.0f, 0.0f, 0.0f};
    fold_low(u0, walks ? box.x - box.z : FAR);
    fold_high(u1, walks ? box.x + box.z : -FAR);
    fold_low(v0, walks ? box.y - box.w : FAR);
    fold_high(v1, walks ? box.y + box.w : -FAR);
    fold_low(way0, walks ? a0 : FAR);
    fold_high(way1, walks ? a1 : -FAR);
    claim_many(sense, turn);
  }
  gcu = 0.5f * (u0 + u1);
  gru = 0.5f * (u1 - u0);
  gcv = 0.5f * (v0 + v1);
  grv = 0.5f * (v1 - v0);
  fat = 1.01f * ::sqrtf(1.0f + upper(u1 * u1, u0 * u0) + upper(v1 * v1, v0 * v0));
};

// Slabs of columns, front to back: which columns and bins the slices pass; their pieces are gathered
auto march = [&](bool trims) {
  const int bins = index.bins, columns = index.columns, kind = (tile.prototype & 0xffff) * columns * columns;
  const float cell_x = index.side, cell_z = index.bin_height, wide_z = index.reach[2] + ROUND;
  const float cell_a = of(axis, cell_x, cell_x, cell_z), per_b = 1.0f / cell_x, per_z = 1.0f / cell_z;
  const float wide_a = of(axis, index.reach[0], index.reach[1], index.reach[2]) + ROUND;
  auto within = [&](int i, int low, int high) { return i < low ? low : i > high ? high : i; };
  auto bin_of = [&](float z) { return within(down(z * per_z), 0, bins - 1); };
  auto top_of = [&](int x, int y) {  // of what is left in a column of the unwrapped prototype
    return trims && x >= 0 && y >= 0 && x < 8 && y < 8 ? s.tallest[y * 8 + x] : FAR;
  };
  const int first_slab = axis == 2 ? bin_of(way0 - wide_a) : down((way0 - wide_a) / cell_a);
  const int last_slab = axis == 2 ? bin_of(way1 + wide_a) : down((way1 + wide_a) / cell_a);
  const int slabs = last_slab - first_slab + 1;
  runs = pieces = waiting = head = 0;
  for (int n = 0; n <= slabs; ++n) {
    const bool is_end = n == slabs;
    const int i = sense >= 0 ? first_slab + n : last_slab - n;
    int j0 = is_end ? 0 : NOWHERE, minus_j1 = j0;
    float c_low = FAR, c_high = -FAR;
    if (!is_end) {
      const float x0 = axis == 2 && i == 0 ? -FAR : i * cell_a - wide_a;
      const float x1 = axis == 2 && i == bins - 1 ? FAR : (i + 1) * cell_a + wide_a;
      EACH_LANE {
        int side0 = NOWHERE, side1 = -NOWHERE;
        float c0 = FAR, c1 = -FAR;
        if (lane < SLICES) {
          if (walkers >> lane & 1) {
            const float lo = upper(x0, s.a0[lane]) - s.from[lane], hi = lower(x1, s.a1[lane]) - s.from[lane];
            auto least = [&](int q) { return s.bound[q][lane] + lower(s.rise[q][lane] * lo, s.rise[q][lane] * hi) - ROUND; };
            auto most = [&](int q) { return s.bound[q][lane] + upper(s.rise[q][lane] * lo, s.rise[q][lane] * hi) + ROUND; };
            if (lo <= hi && least(4) <= s.rest[lane].z) {
              c0 = least(2);
              c1 = most(3);
              side0 = within(down(least(0) * per_b), -SPAN, SPAN);
              side1 = within(down(most(1) * per_b), -SPAN, SPAN);
              s.c0[lane] = c0;
              s.c1[lane] = c1;
            }
          }
          s.side0[lane] = side0;
          s.side1[lane] = side1;
        }
        fold_least(j0, side0);
        fold_least(minus_j1, -side1);
        fold_low(c_low, c0);
        fold_high(c_high, c1);
      }
    }
    // steep ways pass several columns of a row: one after the other
    const int many = axis == 2 && !is_end ? within(down(c_high * per_b) - down(c_low * per_b) + 1, 0, SPAN) : 1;
    for (int from = j0; from <= -minus_j1; from += WARP)
      for (int at = 0; at < many; ++at) {
        if (!is_end) EACH_LANE {  // one column each
          const int j = from + lane;
          float c0 = FAR, c1 = -FAR;
          for (unsigned left = walkers; left; left &= left - 1) {
            const int k = lowest_bit(left);
            if (j < s.side0[k] || j > s.side1[k]) continue;
            c0 = lower(c0, s.c0[k]);
            c1 = upper(c1, s.c1[k]);
          }
          int x = axis == 0 ? i : j, y = axis == 0 ? j : i, bin0 = i, bin1 = i;
          bool passes = c0 <= c1;
          if (axis == 2) {
            x = down(c0 * per_b) + at;
            y = j;
            passes = passes && x <= down(c1 * per_b) && i * cell_z - wide_z <= top_of(x, y);
          } else {
            const float tallest = top_of(x, y) + wide_z;
            passes = passes && c0 <= tallest;
            bin0 = bin_of(c0);
            bin1 = bin_of(lower(c1, tallest));
          }
          int first = 0, last = 0, kx = 0, ky = 0;
          if (passes) {
            kx = per(x, columns);
            ky = per(y, columns);
            const int cell = (kind + (y - ky * columns) * columns + x - kx * columns) * bins;
            first = index.start.data[cell + bin0];
            last = index.start.data[cell + bin1 + 1];
          }
          const int run = claim(runs, first < last), place = claim_many(pieces, last - first);
          if (first < last) {
            s.run_first[run] = first;
            s.run_at[run] = place;
            s.run_copy[run] = kx * 65536 + ky;
          }
        }
        if (is_end || pieces >= MANY || runs > RUNS - WARP) gather(is_end);
      }
  }
};

// What was hit: as the end of `walk_crop` in kernel/crop.py
auto name_hits = [&]() {
  for (int base = 0; base < count; base += WARP) {
    if (!(walkers >> (base / N) & 3u)) continue;
    EACH_LANE {
      const int j = base + lane;
      if (j < count && walkers >> (j / N) & 1 && (unsigned)s.key[j] != 0) {
        const Plant p = plant_at((int)(unsigned)s.key[j] - 1, *copy_of(j));
        const Four at = four(ray_point + j), q = four(ray_ahead + j), d = four(ray_direction + j);
        const V u = p.b - p.a, place = V(at.x, at.y, at.z) + key_t(s.key[j]) * V(q.x, q.y, q.z) - p.a;
        const float along = lower(upper(wp::dot(place, u) / upper(wp::dot(u, u), 1.0e-20f), 0.0f), 1.0f);
        const V normal = p.radius <= 0.0f ? wp::cross(u, p.w) : place - along * u;
        const float x = tile.mirror_x ? -normal[0] : normal[0], y = tile.mirror_y ? -normal[1] : normal[1];
        const float lift = (normal[2] - x * tile.lean_x - y * tile.lean_y) * tile.squeeze;
        const V up(x - lift * tile.plane1, y - lift * tile.plane2, lift);
        const float length = upper(::sqrtf(wp::dot(up, up)), 1.0e-20f);
        const bool is_stub = p.code != STANDING && (int)p.organ == 3;
        const int what = is_stub ? 6 : (int)p.organ;
        out(j, s.t[j], what, lower(1.0f, ::fabsf(up[0] * d.x + up[1] * d.y + up[2] * d.z) / length),
            p.albedo > 0.0f && !is_stub ? p.albedo : scene.reflectance.data[what]);
      }
    }
  }
};

// What is known of a tile, for all lanes; gives the slices that pass where something is
auto open_tile = [&](int x, int y, Heights& h) {
  Tile now = {};
  now.x = x;
  now.y = y;
  now.page_x = per(gx + x, 8);
  now.page_y = per(gy + y, 8);
  now.slot = slot_of(now.page_x, now.page_y);
  now.jx = gx + x - now.page_x * 8;
  now.jy = gy + y - now.page_y * 8;
  const int place = now.slot * 64 + now.jy * 8 + now.jx;
  if (now.slot >= 0) {
    const auto& plane = scene.tile_plane.data[place];
    now.plane0 = plane[0];
    now.plane1 = plane[1];
    now.plane2 = plane[2];
    h.top = scene.tile_top.data[place] + 0.005f;
    h.bump = scene.tile_bump.data[place] + 0.001f;
    const float slant = 0.5f * size * (::fabsf(now.plane1) + ::fabsf(now.plane2));
    h.crest = (float)(now.plane0 - gz) + slant + upper(h.top, h.bump) + ROUND;
  }
  unsigned acts = 0;
  EACH_LANE {
    bool comes = false;
    if (lane < slice_count) {
      const int b = A ? x : y;
      comes = s.row_t0[lane] <= s.row_t1[lane] && s.row_b0[lane] < (b + 1) * size && s.row_b1[lane] > b * size &&
              s.row_z0[lane] <= h.crest;
    }
    fold_bits(acts, comes ? 1u << lane : 0u);
  }
  if (acts && now.slot >= 0) {
    const auto& stand = scene.tile_stand.data[place];
    now.height = stand[0];
    now.lean_x = stand[1];
    now.lean_y = stand[2];
    now.share = stand[3];
    now.squeeze = 1.0f / now.height;
    now.prototype = scene.tile_prototype.data[place];
    now.mirror_x = now.prototype & 1 << 16;
    now.mirror_y = now.prototype & 1 << 17;
    now.cut_row = scene.cut_slot.data[now.slot];
    if (scene.sways != 0) {
      auto wave = [&](const wp::vec_t<3, wp::float64>& q) {
        double cycles = q[0] * (double)(gx + x) + q[1] * (double)(gy + y) + q[2];
        cycles = cycles - ::floor(cycles);
        return (float)wp::sin(cycles * 6.283185307179586);
      };
      const float slope = scene.slopes[0] + scene.slopes[1] * wave(scene.wave) + scene.slopes[2] * wave(scene.gust);
      const float aside = slope * now.height;
      now.lean_x += aside * scene.toward[0];
      now.lean_y += aside * scene.toward[1];
    }
    const float* ground = scene.ground.data + (size_t)now.slot * 65 * 65 + now.jy * 8 * 65 + now.jx * 8;
    for (int base = 0; base < 81; base += WARP) EACH_LANE {
      const int i = (base + lane) % 9, j = (base + lane) / 9;
      const float flat = now.plane0 + now.plane1 * (i / 8.0f - 0.5f) * size + now.plane2 * (j / 8.0f - 0.5f) * size;
      fold_low(h.dip, base + lane < 81 ? ground[j * 65 + i] - flat : 0.0f);
    }
    h.dip -= 0.002f;
  }
  EACH_LANE if (lane == 0) {
    s.tile = now;
    s.lift = (float)(now.plane0 - gz);
  }
  return acts;
};

auto visit = [&](int x, int y) {
  Heights h = {0.0f, 0.0f, FAR, 0.0f};
  const unsigned acts = open_tile(x, y, h);
  if (!acts) return;
  int lead = ROOM;
  const unsigned grounds = enter(acts, h, lead);
  if (walkers) {
    set_frame();
    find_ways(lead);
    look(0);
    march(find_cut());
    name_hits();
  }
  if (grounds)
    for (int base = 0; base < count; base += WARP) EACH_LANE {
      const int j = base + lane;
      if (j < count && grounds >> (j / N) & 1 && s.t[j] >= 0.0f) {
        const Four o = four(ray_origin + j), d = four(ray_direction + j), e = four(ray_way + j);
        const float t0 = e.y, t1 = lower(e.z, s.t[j]), kx = (float)x - cast_off(o.w, 0), ky = (float)y - cast_off(o.w, 1);
        const float h1 = d.z - tile.plane1 * d.x - tile.plane2 * d.y, rise = s.lift - cast_off(o.w, 2);
        const float h0 = o.z - rise - tile.plane1 * (o.x - (kx + 0.5f) * size) - tile.plane2 * (o.y - (ky + 0.5f) * size);
        if (t0 <= t1 && lower(h0 + h1 * t0, h0 + h1 * t1) <= h.bump) {
          float ta = t0, tb = t1;
          if (h1 < 0.0f) ta = upper(ta, (h.bump - h0) / h1);
          if (h1 > 0.0f) tb = lower(tb, (h.bump - h0) / h1);
          hit_ground(j, ta, tb);
        }
      }
    }
};
