// ---- Exact tests of one ray, by the formulas of kernel/shapes.py and kernel/crop.py; FAR where nothing is hit

auto hit_ball = [&](V to, V d, float rr) {
  const float along = wp::dot(to, d);
  const V q = to - along * d;
  const float rest = rr - wp::dot(q, q);
  return rest < 0.0f ? FAR : along - ::sqrtf(rest);
};
// A capsule, not before `low`: a tile's side cuts through what stands on it, unless the ray starts there
auto hit_rod = [&](V o, V d, float low, bool is_open, V a, V b, float radius) {
  const V u = b - a, m = a - o, n = wp::cross(d, u);
  const float nn = wp::dot(n, n), gap = wp::dot(m, n), rr = radius * radius, h = rr * nn - gap * gap;
  if (!(h >= 0.0f)) return FAR;
  const float uu = wp::dot(u, u), du = wp::dot(d, u);
  bool at_a = du > 0.0f, at_b = !at_a;
  float t = 0.0f;
  if (nn > 1.0e-10f * uu) {
    t = (wp::dot(wp::cross(m, u), n) - ::sqrtf(h * uu)) / nn;
    const float y = t * du - wp::dot(m, u);
    at_a = y < 0.0f;
    at_b = y > uu;
  }
  if (at_a || at_b) t = hit_ball(at_b ? m + u : m, d, rr);
  if (t < low) {
    const V e = low * d - m;
    const V q = e - lower(upper(wp::dot(e, u) / upper(uu, 1.0e-20f), 0.0f), 1.0f) * u;
    t = is_open || wp::dot(q, q) > rr ? FAR : low;
  }
  return t;
};
// A ribbon (radius 0) or a triangle (-1), not before `low` nor above `top`
auto hit_flat = [&](V o, V d, float low, V a, V b, V w, float radius, float top) {
  const V u = b - a, m = o - a, p = wp::cross(d, w);
  const float det = wp::dot(u, p), wide = ::fabsf(det);
  float s_ = wp::dot(m, p);
  if (det < 0.0f) s_ = -s_;
  if (!(s_ >= 0.0f && s_ <= wide && wide >= 1.0e-20f)) return FAR;
  const V q = wp::cross(m, u);
  if (!(::fabsf(wp::dot(d, q)) <= wide + radius * s_)) return FAR;
  const float t = wp::dot(w, q) / det;
  return t >= low && o[2] + t * d[2] <= top ? t : FAR;
};

// What is left of a stem at a place of the unwrapped prototype: cut code, 255 = all of it
auto cut_code = [&](float x, float y) {
  if (tile.mirror_x) x = size - x;
  if (tile.mirror_y) y = size - y;
  int cx = tile.jx * 64 + down(x * fine), cy = tile.jy * 64 + down(y * fine), row = tile.cut_row;
  if (cx < 0 || cy < 0 || cx > 511 || cy > 511) {
    const int i = tile.page_x + per(cx, 512), j = tile.page_y + per(cy, 512), slot = slot_of(i, j);
    if (slot < 0) return STANDING;
    row = scene.cut_slot.data[slot];
    cx -= per(cx, 512) * 512;
    cy -= per(cy, 512) * 512;
  }
  return row < 0 ? -1 - row : (int)scene.cut.data[((size_t)row * 512 + cy) * 512 + cx];
};
auto cut_back = [&](V& a, V& b, float top) {
  const bool is_b = b[2] > top;
  const V high = is_b ? b : a, low = is_b ? a : b;
  if (high[2] <= top) return;
  const V end = low + (top - low[2]) / (high[2] - low[2]) * (high - low);
  if (is_b) b = end;
  else a = end;
};

// One primitive, one copy of it: 4 x 4 numbers as in kernel/scene.py; what is left of it
struct Plant { V a, b, w; float radius, rank, organ, albedo, top; int code; };
auto plant_at = [&](int number, int copy) {
  const float* row = (const float*)scene.prims.data + (size_t)number * 16;
  const Four p0 = four(row), p1 = four(row + 4), p2 = four(row + 8), p3 = four(row + 12);
  const float mx = copy_x(copy) * size, my = copy_y(copy) * size;
  Plant p;
  p.a = V(p0.x, p0.y, p0.z);
  p.b = V(p1.x, p1.y, p1.z);
  p.w = V(p2.x, p2.y, p2.z);
  p.radius = p0.w;
  p.rank = p1.w;
  p.organ = p2.w;
  p.albedo = p3.z;
  p.code = cut_code(p3.x + mx, p3.y + my);
  p.top = p.code == STANDING ? FAR : 0.01f * (float)p.code * tile.squeeze;
  if (p.code == 0 || (p.radius >= 0.0f && lower(p.a[2], p.b[2]) > p.top)) p.rank = FAR;  // gone
  else if (p.radius > 0.0f && p.code != STANDING) cut_back(p.a, p.b, p.top);
  p.a[0] += mx; p.a[1] += my;
  p.b[0] += mx; p.b[1] += my;
  return p;
};

// The ground of the tile at hand, t in [ta, tb]: as `walk_ground` in kernel/cast.py
auto hit_ground = [&](int j, float ta, float tb) {
  const Four o = ray_origin[j], d = ray_direction[j];
  const float gap = size / 8.0f, cx0 = ((float)(tile.x - tile.jx) - cast_off(o.w, 0)) * size;
  const float cy0 = ((float)(tile.y - tile.jy) - cast_off(o.w, 1)) * size, z0 = (float)(gz + cast_off(o.w, 2));
  const float x = (o.x - cx0) / gap, y = (o.y - cy0) / gap, xd = d.x / gap, yd = d.y / gap;
  const int first_x = tile.jx * 8, first_y = tile.jy * 8;
  int ix = down(x + xd * ta), iy = down(y + yd * ta);
  ix = ix < first_x ? first_x : ix > first_x + 7 ? first_x + 7 : ix;
  iy = iy < first_y ? first_y : iy > first_y + 7 ? first_y + 7 : iy;
  const bool flat_x = ::fabsf(xd) < 1e-12f, flat_y = ::fabsf(yd) < 1e-12f;
  const float mx = flat_x ? 0.0f : 1.0f / xd, my = flat_y ? 0.0f : 1.0f / yd;
  const float cx = flat_x ? FAR : -x / xd, cy = flat_y ? FAR : -y / yd;
  const float* ground = scene.ground.data + (size_t)tile.slot * 65 * 65;
  const float* straw = scene.straw.data + (size_t)tile.slot * 65 * 65;
  float t = ta;
  for (;;) {
    const float tx = (float)(ix + (xd > 0.0f)) * mx + cx, ty = (float)(iy + (yd > 0.0f)) * my + cy;
    const float leave = lower(lower(tx, ty), tb);
    const int n = iy * 65 + ix;
    const float s00 = straw[n], s10 = straw[n + 1], s01 = straw[n + 65], s11 = straw[n + 66];
    const float h00 = (ground[n] - z0) + s00, h10 = (ground[n + 1] - z0) + s10;
    const float h01 = (ground[n + 65] - z0) + s01, h11 = (ground[n + 66] - z0) + s11;
    float u = x + xd * t - (float)ix, v = y + yd * t - (float)iy;
    const float hu = h10 - h00, hv = h01 - h00, huv = h11 - h10 - hv;
    const float above = o.z + d.z * t - (h00 + hu * u + hv * v + huv * u * v);
    const float rate = d.z - (hu + huv * v) * xd - (hv + huv * u) * yd, bend = -huv * xd * yd;
    float way = FAR;
    if (above <= 0.0f) {
      if (rate < 0.0f) way = 0.0f;
    } else {
      const float disc = rate * rate - 4.0f * bend * above;
      if (disc >= 0.0f) {
        if (rate >= 0.0f) {
          if (bend < 0.0f) way = -0.5f * (rate + ::sqrtf(disc)) / bend;
        } else way = 2.0f * above / (-rate + ::sqrtf(disc));
        if (way > upper(leave - t, 0.0f)) way = FAR;
      }
    }
    if (way < FAR && t + way <= s.t[j]) {
      u += xd * way;
      v += yd * way;
      const float nx = -(hu + huv * v) / gap, ny = -(hv + huv * u) / gap;
      const float depth = (s00 * (1.0f - u) + s10 * u) * (1.0f - v) + (s01 * (1.0f - u) + s11 * u) * v;
      const int what = depth > 0.005f ? 2 : 1;
      const float level = ::fabsf(nx * d.x + ny * d.y + d.z) / ::sqrtf(nx * nx + ny * ny + 1.0f);
      out(j, t + way, what, level, scene.reflectance.data[what]);
      return;
    }
    if (leave >= tb) return;
    t = upper(leave, t);
    if (tx <= ty) {
      ix += xd > 0.0f ? 1 : -1;
      if (ix < first_x || ix > first_x + 7) return;
    } else {
      iy += yd > 0.0f ? 1 : -1;
      if (iy < first_y || iy > first_y + 7) return;
    }
  }
};
