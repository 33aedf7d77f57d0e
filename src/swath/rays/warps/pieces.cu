// ---- From runs of pieces in the index to pieces in slopes

float deep = 0.0f, swell = 0.0f, fat = 0.0f;  // how much s.m stretches along and across; how steep slopes may be
float gcu = 0.0f, gru = 0.0f, gcv = 0.0f, grv = 0.0f;  // box of the group's slopes
int runs = 0, pieces = 0, rank_max = 0;

auto set_frame = [&]() {
  const float flip_x = tile.mirror_x ? -1.0f : 1.0f, flip_y = tile.mirror_y ? -1.0f : 1.0f;
  const float cx = tile.mirror_x ? size : 0.0f, cy = tile.mirror_y ? size : 0.0f;
  const V corner((float)tile.x * size + cx - s.apex[0], (float)tile.y * size + cy - s.apex[1],
                 s.lift + tile.plane1 * (cx - 0.5f * size) + tile.plane2 * (cy - 0.5f * size) - s.apex[2]);
  auto turned = [&](V e) {
    return V(flip_x * (e[0] + e[2] * tile.plane1), flip_y * (e[1] + e[2] * tile.plane2),
             e[0] * tile.lean_x + e[1] * tile.lean_y + e[2] * (tile.plane1 * tile.lean_x + tile.plane2 * tile.lean_y + tile.height));
  };
  const V m0 = turned(vector(s.e0)), m1 = turned(vector(s.e1)), m2 = turned(vector(s.e2));
  const float m11 = wp::dot(m1, m1), m22 = wp::dot(m2, m2), m12 = wp::dot(m1, m2);
  const float half = 0.25f * (m11 - m22) * (m11 - m22) + m12 * m12, step = index.step;
  swell = 1.0001f * ::sqrtf(0.5f * (m11 + m22) + ::sqrtf(half)) * step;
  deep = 1.0001f * ::sqrtf(wp::dot(m0, m0)) * step;
  rank_max = tile.share >= 1.0f ? 32767 : (int)(tile.share * 32767.0f) + 1;
  EACH_LANE if (lane == 0) {
    s.m[0] = {m0[0] * step, m0[1] * step, m0[2] * step, wp::dot(vector(s.e0), corner)};
    s.m[1] = {m1[0] * step, m1[1] * step, m1[2] * step, wp::dot(vector(s.e1), corner)};
    s.m[2] = {m2[0] * step, m2[1] * step, m2[2] * step, wp::dot(vector(s.e2), corner)};
  }
};

// The pieces of all runs that wait, one lane each; those that the group may touch go into the ring, and on from there
// whenever 32 wait; in the end all
auto gather = [&](bool is_end) {
  for (int base = 0;; base += WARP) {
    if (base < pieces) EACH_LANE {
      int k = 0, copy = 0, number = 0;
      bool keep = false;
      Four piece = {0, 0, 0, 0}, more = {0, 0, 0, 0};
      if (base + lane < pieces) {
        for (int jump = RUNS / 2; jump > 0; jump /= 2)
          if (k + jump < runs && s.run_at[k + jump] <= base + lane) k += jump;
        const int e = s.run_first[k] + base + lane - s.run_at[k];
        copy = s.run_copy[k];
        const float kx = copy_x(copy) * tile_steps, ky = copy_y(copy) * tile_steps;
        const Four raw = four(index.coarse.data + (size_t)e * 8);  // 8 short numbers
        auto first = [&](float x) { return (float)(short)(bits_of(x) & 0xffff); };
        auto second = [&](float x) { return (float)(bits_of(x) >> 16); };
        const float ax = first(raw.x) + kx, ay = second(raw.x) + ky, az = first(raw.y), bx = second(raw.y) + kx;
        const float by = first(raw.z) + ky, bz = second(raw.z), thick = first(raw.w), rank = second(raw.w);
        auto at = [&](Four m, float x, float y, float z) { return m.x * x + m.y * y + m.z * z + m.w; };
        const Four m0 = s.m[0], m1 = s.m[1], m2 = s.m[2];
        const float wa = at(m0, ax, ay, az), wb = at(m0, bx, by, bz);
        float ua = at(m1, ax, ay, az), ub = at(m1, bx, by, bz), va = at(m2, ax, ay, az), vb = at(m2, bx, by, bz);
        const float near = lower(wa, wb) - thick * deep - ROUND;
        const float ia = about_inverse(wa), ib = about_inverse(wb), nearer = upper(ia, ib), thin = (thick * deep + ROUND) * nearer;
        const bool close = near < 0.05f || thin > 0.25f;
        const float most_inv = nearer * (1.0f + 1.34f * thin);  // at least 1 / near
        ua *= ia; va *= ia; ub *= ib; vb *= ib;
        const float u = 0.5f * (ua + ub), v = 0.5f * (va + vb), hu = 0.5f * (ub - ua), hv = 0.5f * (vb - va);
        const float broad = (thick * swell + ROUND) * most_inv * fat + sway_u * 0.71f * ::fabsf(ia - ib);
        const float room = broad + sway_u * most_inv, t = (near - w_origin) * w_rate - ROUND;
        keep = (close || (::fabsf(u - gcu) <= ::fabsf(hu) + room + gru && ::fabsf(v - gcv) <= ::fabsf(hv) + room + grv)) &&
               t <= reach && rank <= (float)rank_max;
        if (keep) number = index.primitive.data[e];
        const float hh = hu * hu + hv * hv, per_h = about_inverse_root(hh);
        const bool tiny = hh < 1.0e-18f;
        piece = {close ? 0.0f : u, close ? 0.0f : v, tiny || close ? 1.0f : hu * per_h, tiny || close ? 0.0f : hv * per_h};
        more = {close || tiny ? 0.0f : hh * per_h, close ? FAR : broad, close ? 0.0f : 0.5f * (ia + ib), t};
      }
      const int at = (head + claim(waiting, keep)) & (KEPT - 1);
      if (keep) {
        s.piece[at] = piece;
        s.more[at] = more;
        s.prim[at] = number;
        s.piece_copy[at] = copy;
      }
    }
    const bool is_last = base + WARP >= pieces;
    while (waiting >= WARP || (is_end && is_last && waiting > 0)) batch();
    if (is_last) break;
  }
  runs = pieces = 0;
};
