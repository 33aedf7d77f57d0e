// ---- Groups: rays, frame, rows of tiles front to back

// The rays of the next bundles into the stand frame, each from its own tile, as `to_stand` in kernel/scene.py. `from` < 0:
// whole bundles, as far as they lie close enough to the first ray; else of one bundle the rays from there on.
// Gives the first slot that does not fit.
auto take = [&](int from) {
  const int begin = from < 0 ? 0 : from;
  struct Placed { double tx, ty, z0; float ox, oy, oz, dx, dy, dz; };
  auto placed = [&](int ray) {
    const auto& o = origins.data[ray];
    const auto& v = directions.data[ray];
    const double c = scene.turn[0], sn = scene.turn[1], x = c * o[0] + sn * o[1], y = c * o[1] - sn * o[0];
    Placed p;
    p.tx = ::floor(x / dsize);
    p.ty = ::floor(y / dsize);
    p.z0 = ::floor(o[2]);
    p.ox = (float)(x - p.tx * dsize);
    p.oy = (float)(y - p.ty * dsize);
    p.oz = (float)(o[2] - p.z0);
    p.dx = (float)(c * v[0] + sn * v[1]);
    p.dy = (float)(c * v[1] - sn * v[0]);
    p.dz = (float)v[2];
    return p;
  };
  const Placed first = placed(ray_of(begin));
  gx = (int)first.tx;
  gy = (int)first.ty;
  gz = first.z0;
  const V apex(first.ox, first.oy, first.oz);
  EACH_LANE if (lane == 0) keep_vector(s.apex, apex);
  int end = packs * width;
  for (int pass = 0; pass < 2; ++pass) {  // again where only some of a bundle fit: the others become copies of the first
    const int all = packs * width, until = pass == 0 ? all : end;
    for (int base = 0; base < all; base += WARP) EACH_LANE {
      const int j = base + lane;
      bool fits = true;
      if (j < all) {
        const int own = ray_of(j);
        const bool live = own >= 0 && j >= begin && j < until;
        const Placed p = placed(live ? own : ray_of(from < 0 ? j - j % width : begin));
        const float tx = (float)(p.tx - gx), ty = (float)(p.ty - gy), z0 = (float)(p.z0 - gz);
        const V away(p.ox + tx * size - apex[0], p.oy + ty * size - apex[1], p.oz + z0 - apex[2]);
        const float along = p.dx * first.dx + p.dy * first.dy + p.dz * first.dz;
        fits = wp::dot(away, away) <= SPREAD * SPREAD && along >= 1.0f - NARROW && along <= 2.0f;
        const int off = fits ? ((int)tx + 128) | ((int)ty + 128) << 8 | ((int)z0 + 128) << 16 : 0;
        ray_origin[j] = {p.ox, p.oy, p.oz, float_of(off)};
        ray_direction[j] = {p.dx, p.dy, p.dz, 0.0f};
        s.t[j] = live ? distance.data[own] : -1.0f;
        s.state[j] = live && organ.data[own] > 0 ? HIT : 0;
      }
      if (pass == 0) fold_least(end, fits ? all : j);
    }
    if (from < 0 || end == all) break;
    end = end > begin ? end : begin + 1;  // the first fits, unless it is none: then it is alone
  }
  return end;
};

// The frame of the group, rays as slopes in it, boxes of slices
auto set_group = [&]() {
  auto direction = [&](int j) {
    const Four d = four(ray_direction + j);
    return V(d.x, d.y, d.z);
  };
  auto unit = [&](V v) { return v / upper(::sqrtf(wp::dot(v, v)), 1e-20f); };
  V e0(0.0f, 0.0f, 0.0f);
  for (int p = 0; p < packs; ++p) e0 += direction(p * width);
  e0 = unit(e0);
  V e1 = direction((packs - 1) * width) - direction(0);
  e1 = e1 - wp::dot(e1, e0) * e0;
  if (wp::dot(e1, e1) < 1e-6f)
    e1 = e0[2] * e0[2] > 0.9f ? V(1.0f - e0[0] * e0[0], -e0[0] * e0[1], -e0[0] * e0[2]) : V(-e0[1], e0[0], 0.0f);
  e1 = unit(e1);
  const V e2 = wp::cross(e0, e1), apex = vector(s.apex);
  EACH_LANE if (lane == 0) {
    keep_vector(s.e0, e0);
    keep_vector(s.e1, e1);
    keep_vector(s.e2, e2);
  }
  A = e0[0] * e0[0] >= e0[1] * e0[1] ? 0 : 1;
  sway_u = 0.0f;
  w_origin = 0.0f;
  float most_rate = 0.5f;
  EACH_LANE {  // one slice each
    float swings = 0.0f, w0_most = 0.0f, w1_most = 0.5f, low[10], high[10];
    for (int q = 0; q < 10; ++q) { low[q] = FAR; high[q] = -FAR; }
    for (int j = lane * N; j < (lane + 1) * N && lane < slice_count; ++j) {
      const Four o = four(ray_origin + j);
      const V d = direction(j), x(o.x + cast_off(o.w, 0) * size, o.y + cast_off(o.w, 1) * size, o.z + cast_off(o.w, 2));
      const float w0 = wp::dot(x - apex, e0), w1 = wp::dot(d, e0), u = wp::dot(d, e1) / w1, v = wp::dot(d, e2) / w1;
      const float ou = wp::dot(x - apex, e1) - w0 * u, ov = wp::dot(x - apex, e2) - w0 * v;
      s.spot[j] = {u, v};
      swings = upper(swings, upper(::fabsf(ou), ::fabsf(ov)) + 1e-6f);
      w0_most = upper(w0_most, w0);
      w1_most = upper(w1_most, w1);
      const float found[10] = {u, v, ou, ov, A ? x[1] : x[0], A ? d[1] : d[0], A ? x[0] : x[1], A ? d[0] : d[1], x[2], d[2]};
      for (int q = 0; q < 10; ++q) { low[q] = lower(low[q], found[q]); high[q] = upper(high[q], found[q]); }
    }
    fold_high(sway_u, swings);
    fold_high(w_origin, w0_most);
    fold_high(most_rate, w1_most);
    if (lane >= slice_count) continue;
    float middle[4], half[4], far = 0.0f;
    for (int q = 0; q < 4; ++q) { middle[q] = 0.5f * (low[q] + high[q]); half[q] = 0.5f * (high[q] - low[q]) + 1e-6f; }
    for (int j = lane * N; j < (lane + 1) * N; ++j) {
      const Two spot = s.spot[j];
      const float u = spot.x - middle[0], v = spot.y - middle[1];
      far = upper(far, u * u + v * v);
    }
    s.box[lane] = {middle[0], middle[1], half[0], half[1]};
    s.shift[lane] = {middle[2], middle[3], half[2], half[3]};
    s.rest[lane] = {::sqrtf(far) + 1e-6f, ::sqrtf(half[2] * half[2] + half[3] * half[3]), -FAR, -FAR};
    s.cap[lane] = FAR;
    s.oa0[lane] = low[4] - ROUND;
    s.oa1[lane] = high[4] + ROUND;
    s.da0[lane] = low[5] - 1e-7f;
    s.da1[lane] = high[5] + 1e-7f;
    s.ob0[lane] = low[6] - ROUND;
    s.ob1[lane] = high[6] + ROUND;
    s.db0[lane] = low[7] - 1e-7f;
    s.db1[lane] = high[7] + 1e-7f;
    s.oz0[lane] = low[8] - ROUND;
    s.dz0[lane] = low[9] - 1e-7f;
  }
  w_rate = 1.0f / most_rate;
  walkers = 0;
  look(~0u >> (32 - slice_count));
};

// A row of tiles: from where to where each slice passes it; false when neither this row nor a later one is still to come
auto pass_row = [&](int row, float& b0, float& b1) {
  const float near = row * size, far = near + size;
  unsigned goes_on = 0;
  EACH_LANE {
    float lo = FAR, hi = -FAR;
    bool comes = false;
    if (lane < slice_count) {
      const float oa0 = s.oa0[lane], oa1 = s.oa1[lane], da0 = s.da0[lane], da1 = s.da1[lane], until = s.rest[lane].w;
      float t0, t1;
      if (da0 > 1e-6f) {
        const float x = near - oa1, y = far - oa0;
        t0 = x > 0.0f ? x / da1 : x / da0;
        t1 = y > 0.0f ? y / da0 : y / da1;
      } else if (da1 < -1e-6f) {
        const float x = oa0 - far, y = oa1 - near;
        t0 = x > 0.0f ? x / -da0 : x / -da1;
        t1 = y > 0.0f ? y / -da1 : y / -da0;
      } else {
        t0 = upper(upper(near - oa1, oa0 - far), 0.0f) / upper(upper(da1, -da0), 1e-6f);
        t1 = FAR;
      }
      t0 = upper(t0 - 1e-4f, 0.0f);
      comes = t1 >= 0.0f && t0 <= until;
      t1 = lower(t1 + 1e-4f, until);
      if (t0 <= t1) {
        lo = s.ob0[lane] + lower(s.db0[lane] * t0, s.db0[lane] * t1) - ROUND;
        hi = s.ob1[lane] + upper(s.db1[lane] * t0, s.db1[lane] * t1) + ROUND;
        s.row_z0[lane] = s.oz0[lane] + lower(s.dz0[lane] * t0, s.dz0[lane] * t1) - 1e-4f;
      }
      s.row_t0[lane] = t0 <= t1 ? t0 : FAR;
      s.row_t1[lane] = t0 <= t1 ? t1 : -FAR;
      s.row_b0[lane] = lo;
      s.row_b1[lane] = hi;
    }
    fold_low(b0, lo);
    fold_high(b1, hi);
    fold_bits(goes_on, comes);
  }
  return goes_on != 0;
};

for (int at = first_pack.data[g], from = -1; at < first_pack.data[g + 1];) {
  const int left = first_pack.data[g + 1] - at;
  begun = at;
  packs = from >= 0 ? 1 : left < ROOM / width ? left : ROOM / width;
  const int end = take(from);
  if (from < 0) packs = end / width;
  if (packs == 0) { from = 0; continue; }  // the first bundle alone is too wide: piece by piece
  count = packs * width;
  slice_count = count / N;
  set_group();
  const int step = (A ? s.e0[1] : s.e0[0]) >= 0.0f ? 1 : -1;
  unsigned mixed = 0;  // do some rays go against the rows?
  EACH_LANE fold_bits(mixed, lane < slice_count && ((s.da0[lane] <= 0.0f && s.da1[lane] >= 0.0f) || (s.da0[lane] > 0.0f) != (step > 0)));
  bool goes_on = true;
  for (int n = -1; goes_on; ++n) {
    goes_on = n < 1;
    for (int side = 0; side < (mixed && n > 0 ? 2 : 1); ++side) {
      const int row = side ? -step * n : step * n;
      float b0 = FAR, b1 = -FAR;
      look(0);
      if (pass_row(row, b0, b1)) goes_on = true;
      if (b0 > b1) continue;
      const int first_tile = down(b0 / size), last_tile = down(b1 / size);
      for (int b = first_tile; b <= last_tile; ++b) visit(A ? b : row, A ? row : b);
    }
  }
  if (from < 0) at += packs;
  else {
    for (from = end; from < width && ray_of(from) < 0;) ++from;
    if (from >= width) { ++at; from = -1; }
  }
}
#undef EACH_LANE
#undef SHARED
