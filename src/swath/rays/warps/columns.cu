// ---- The columns of a tile that the rays pass

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
            s.run_copy[run] = copy_at(kx, ky);
          }
        }
        if (is_end || pieces >= MANY || runs > RUNS - WARP) gather(is_end);
      }
  }
};
