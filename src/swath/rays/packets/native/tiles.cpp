// One tile: the path of every lane through it, its plants and its ground, as the plain kernel has them.

struct Tile {
  int slot, page_x, page_y, jx, jy, cut_row, kind, rank_max;  // page, place in it; first column of the prototype
  float x, y;                                   // counted from the group's
  float plane[3], stand[4], squeeze;
  float top, bump, top_bound, dip;                  // crop and ground above the plane; top above z of the group; ground below
  bool mirror_x, mirror_y, has_crop, trims;
  float live[AROUND][AROUND];                   // [m] in the prototype: how high what is left can reach, per column
};


struct Tiles : Rays {
  Tile tile;  // at hand
  using Rays::Rays;

  void read_heights(int place) {
    for (int i = 0; i < 3; ++i) tile.plane[i] = scene.tile_plane.data[place][i];
    tile.top = scene.tile_top.data[place] + 0.005f;
    tile.bump = scene.tile_bump.data[place] + 0.001f;
    tile.top_bound = (float)(tile.plane[0] - gz) + upper(tile.top, tile.bump) + ROUND +
                 0.5f * size * (__builtin_fabsf(tile.plane[1]) + __builtin_fabsf(tile.plane[2]));
  }
  void read_stand(int place) {
    for (int i = 0; i < 4; ++i) tile.stand[i] = scene.tile_stand.data[place][i];
    if (scene.sways != 0) {  // as `swayed` in kernel/scene.py
      auto wave = [&](const wp::vec_t<3, wp::float64>& q) {
        double cycles = q[0] * (double)(gx + (int)tile.x) + q[1] * (double)(gy + (int)tile.y) + q[2];
        cycles = cycles - __builtin_floor(cycles);
        return (float)wp::sin(cycles * 6.283185307179586);
      };
      const float slope = scene.slopes[0] + scene.slopes[1] * wave(scene.wave) + scene.slopes[2] * wave(scene.gust);
      const float aside = slope * tile.stand[0];
      tile.stand[1] += aside * scene.toward[0];
      tile.stand[2] += aside * scene.toward[1];
    }
    tile.dip = 0.0f;  // how depth_gain the ground lies under the tile's plane
    const float* ground = scene.ground.data + (size_t)tile.slot * 65 * 65 + tile.jy * 8 * 65 + tile.jx * 8;
    for (int j = 0; j < 9; ++j)
      for (int i = 0; i < 9; ++i)
        tile.dip = lower(tile.dip, ground[j * 65 + i] - tile.plane[0] - tile.plane[1] * (i / 8.0f - 0.5f) * size -
                                       tile.plane[2] * (j / 8.0f - 0.5f) * size);
    tile.dip -= 0.002f;
    const int prototype = scene.tile_prototype.data[place];
    tile.mirror_x = prototype & (1 << 16);
    tile.mirror_y = prototype & (1 << 17);
    tile.kind = prototype & 0xffff;
    tile.squeeze = 1.0f / tile.stand[0];
    tile.has_crop = tile.top > 0.005f;
    tile.cut_row = scene.cut_slot.data[tile.slot];
    tile.rank_max = tile.stand[3] >= 1.0f ? 32767 : (int)(tile.stand[3] * 32767.0f) + 1;
  }

  struct Pass { F t0, t1; I live; };  // of the lanes through the tile's column of air
  Pass pass(const Block& b) const {
#pragma clang fp contract(on)
    F kx = tile.x - b.tx, ky = tile.y - b.ty, dx = b.dx, dy = b.dy, ox = b.ox, oy = b.oy;
    F ivx = b.ivx, ivy = b.ivy, ofx = b.ofx, ofy = b.ofy;
    I right = dx > 0.0f, left = dy > 0.0f;
    F tnx = (right ? kx : kx + 1.0f) * size * ivx + ofx, tfx = (right ? kx + 1.0f : kx) * size * ivx + ofx;
    F tny = (left ? ky : ky + 1.0f) * size * ivy + ofy, tfy = (left ? ky + 1.0f : ky) * size * ivy + ofy;
    I flat_x = size_of(dx) < 1e-12f, flat_y = size_of(dy) < 1e-12f;
    I in_x = (ox >= kx * size) & (ox < (kx + 1.0f) * size), in_y = (oy >= ky * size) & (oy < (ky + 1.0f) * size);
    tnx = flat_x ? (in_x ? put(-FAR) : put(FAR)) : tnx;
    tny = flat_y ? (in_y ? put(-FAR) : put(FAR)) : tny;
    Pass a;
    a.t0 = most(most(tnx, tny), F{});
    a.t1 = least(tfx, tfy);
    a.live = a.t0 <= a.t1;
    return a;
  }
  void lose(Block& b) {  // nothing is known from here on
    Pass a = pass(b);
    I live = a.live & (a.t0 < b.t);
    b.t = live ? a.t0 : b.t;
    b.what = live ? I{} : b.what;
  }
  // Every lane's path between ground and top of the crop, in the prototype: as `to_prototype` in kernel/crop.py
  unsigned enter(Block& b, int* ground, int vector) {
#pragma clang fp contract(on)
    Pass a = pass(b);
    const int p = (int)(&b - r) / vectors;
    F kx = tile.x - b.tx, ky = tile.y - b.ty, dx = b.dx, dy = b.dy, dz = b.dz;
    F ox = b.ox, oy = b.oy, best = least(b.t, put(k.until[p])), t0 = a.t0, t1 = a.t1;
    I live = a.live & (t0 < best);
    if (!bits(live)) {
      b.tin = put(FAR);
      b.limit = put(-FAR);
      b.prim = puti(-1);
      return 0;
    }
    const float *plane = tile.plane, *stand = tile.stand;
    F h1 = dz - plane[1] * dx - plane[2] * dy;
    F base = put((float)(plane[0] - gz)) - b.z0;
    F h0 = b.oz - base - plane[1] * (ox - (kx + 0.5f) * size) - plane[2] * (oy - (ky + 0.5f) * size);
    F lowest = least(h0 + h1 * t0, h0 + h1 * least(t1, best));
    b.tin = live ? t0 : put(FAR);
    b.tout = t1;
    if (bits(live & (lowest <= tile.bump))) *ground |= vector;
    F through = (tile.top - h0) / h1, under = (tile.dip - h0) / h1, ta = t0, tb = least(t1, best);
    I falls = h1 < 0.0f, climbs = h1 > 0.0f;
    ta = falls ? most(ta, through) : climbs ? most(ta, under) : ta;
    tb = climbs ? least(tb, through) : falls ? least(tb, under) : tb;
    live &= (lowest <= tile.top) & (ta <= tb);
    if (!tile.has_crop) live = I{};
    F zd = h1 * tile.squeeze, z = (h0 + h1 * ta) * tile.squeeze;
    F xd = dx - stand[1] * zd, yd = dy - stand[2] * zd;
    F x = ox - kx * size + dx * ta - stand[1] * z, y = oy - ky * size + dy * ta - stand[2] * z;
    if (tile.mirror_x) { x = size - x; xd = -xd; }
    if (tile.mirror_y) { y = size - y; yd = -yd; }
    F stretch = root(xd * xd + yd * yd + zd * zd), shrink = 1.0f / stretch, end = (tb - ta) * stretch;
    live &= end < 200.0f * size;
    b.p[0] = x;
    b.p[1] = y;
    b.p[2] = z;
    b.q[0] = xd * shrink;
    b.q[1] = yd * shrink;
    b.q[2] = zd * shrink;
    b.start = ta;
    b.shrink = shrink;
    b.low = (t0 - ta) * stretch;
    b.end = end;
    b.limit = live ? (least(t1, best) - ta) * stretch : put(-FAR);
    b.is_open = t0 <= 0.0f;
    b.prim = puti(-1);
    return bits(live);
  }

  // One primitive, as it stands there, and the exact test, lane by lane
  struct Whole { int prim, image; float a[3], b[3], radius, z_top; const float* row; };  // z_top: FAR where all stands
  const float* row_of(int prim) const { return (const float*)scene.prims.data + (size_t)prim * 16; }
  static int image_y(int image) { return (short)(image & 0xffff); }
  static int image_x(int image) { return (image - image_y(image)) / 65536; }
  HOT bool stands(int prim, int image, Whole* w) const {  // false: nothing is left of it
    const float* row = row_of(prim);
    if (!(row[7] < tile.stand[3])) return false;
    const int kx = image_x(image), ky = image_y(image), code = foot_code(row, kx, ky);
    const float z_top = code == STANDING ? FAR : 0.01f * (float)code * tile.squeeze;
    if (code == 0 || (row[3] >= 0.0f && lower(row[2], row[6]) > z_top)) return false;
    w->prim = prim; w->image = image; w->radius = row[3]; w->z_top = z_top; w->row = row;
    ends_of(row, image, z_top, w->a, w->b);
    return true;
  }
  HOT void ends_of(const float* row, int image, float z_top, float* a, float* b) const {  // of a rod below the knife
    for (int i = 0; i < 3; ++i) { a[i] = row[i]; b[i] = row[4 + i]; }
    if (row[3] > 0.0f && z_top < FAR) cut_back(a, b, z_top);
    const float x = image_x(image) * size, y = image_y(image) * size;
    a[0] += x; b[0] += x;
    a[1] += y; b[1] += y;
  }
  HOT int foot_code(const float* row, int kx, int ky) const {  // as in kernel/crop.py
    float x = row[12] + kx * size, y = row[13] + ky * size;
    if (tile.mirror_x) x = size - x;
    if (tile.mirror_y) y = size - y;
    const float fine = 64.0f / size;
    int cx = tile.jx * 64 + down(x * fine), cy = tile.jy * 64 + down(y * fine), row_of_codes = tile.cut_row;
    if (cx < 0 || cy < 0 || cx > 511 || cy > 511) {
      const int i = per(cx, 512), j = per(cy, 512), slot = page_at(tile.page_x + i, tile.page_y + j);
      if (slot < 0) return STANDING;
      row_of_codes = scene.cut_slot.data[slot];
      cx -= i * 512;
      cy -= j * 512;
    }
    return row_of_codes < 0 ? -1 - row_of_codes : (int)scene.cut.data[((size_t)row_of_codes * 512 + cy) * 512 + cx];
  }
  HOT static void cut_back(float* a, float* b, float z_top) {
    float *high = b[2] > z_top ? b : a, *low = b[2] > z_top ? a : b;
    if (high[2] <= z_top) return;
    const float f = (z_top - low[2]) / (high[2] - low[2]);
    for (int i = 0; i < 3; ++i) high[i] = low[i] + f * (high[i] - low[i]);
  }
  HOT bool test(Block& k_, const Whole& one) const {  // true: some lane is hit nearer than before
    F t = F{};
    I hit = one.radius > 0.0f ? meet_rod(k_, one, &t) : meet_flat(k_, one, &t);
    if (!bits(hit)) return false;
    // plants at the sides of the prototype are listed as copies, too: of those the one counts on whose side it is hit
    const float x0 = image_x(one.image) * size - SEAM, y0 = image_y(one.image) * size - SEAM, over = size + 2.0f * SEAM;
    F x = k_.p[0] + t * k_.q[0] - x0, y = k_.p[1] + t * k_.q[1] - y0, limit = k_.limit;
    hit &= (x >= 0.0f) & (x <= over) & (y >= 0.0f) & (y <= over);
    I prim = k_.prim;
    hit &= (t < limit) | ((t == limit) & (prim >= 0) & (one.prim < (prim & (CUT - 1))));
    if (!bits(hit)) return false;
    k_.limit = hit ? t : limit;
    k_.prim = hit ? puti(one.z_top < FAR ? one.prim | CUT : one.prim) : prim;
    k_.image = hit ? puti(one.image) : k_.image;
    return true;
  }
  HOT static I meet_rod(const Block& k_, const Whole& one, F* t_of) {
#pragma clang fp contract(on)
    const float *a = one.a, *b = one.b, u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, uu = dot3(u, u), rr = one.radius * one.radius;
    F dx = k_.q[0], dy = k_.q[1], dz = k_.q[2];
    F mx = a[0] - k_.p[0], my = a[1] - k_.p[1], mz = a[2] - k_.p[2];
    F nx = dy * u[2] - dz * u[1], ny = dz * u[0] - dx * u[2], nz = dx * u[1] - dy * u[0];
    F nn = nx * nx + ny * ny + nz * nz, gap = mx * nx + my * ny + mz * nz, h = rr * nn - gap * gap;
    I hit = h >= 0.0f;
    if (!bits(hit)) return hit;
    F du = dx * u[0] + dy * u[1] + dz * u[2], mu = mx * u[0] + my * u[1] + mz * u[2];
    F kx = my * u[2] - mz * u[1], ky = mz * u[0] - mx * u[2], kz = mx * u[1] - my * u[0];
    I side = nn > 1.0e-10f * uu;
    F t = (kx * nx + ky * ny + kz * nz - root(h * uu)) / nn, s = t * du - mu;
    I at_a = side ? s < 0.0f : du > 0.0f, at_b = side ? s > uu : du <= 0.0f;
    if (bits(hit & (at_a | at_b))) {  // the round ends
      F sx = at_b ? mx + u[0] : mx, sy = at_b ? my + u[1] : my, sz = at_b ? mz + u[2] : mz;
      F along = sx * dx + sy * dy + sz * dz;
      F ox = sx - along * dx, oy = sy - along * dy, oz = sz - along * dz, rest = rr - (ox * ox + oy * oy + oz * oz);
      F ball = rest < 0.0f ? put(FAR) : along - root(rest);
      t = at_a | at_b ? ball : t;
    }
    F low = k_.low;
    I early = hit & (t < low) & (k_.limit >= 0.0f);
    if (bits(early)) {  // a tile's side cuts through what stands on it
      F ex = low * dx - mx, ey = low * dy - my, ez = low * dz - mz;
      F f = (ex * u[0] + ey * u[1] + ez * u[2]) / upper(uu, 1.0e-20f);
      f = least(most(f, F{}), put(1.0f));
      F gx_ = ex - f * u[0], gy_ = ey - f * u[1], gz_ = ez - f * u[2];
      I out = (k_.is_open != 0) | (gx_ * gx_ + gy_ * gy_ + gz_ * gz_ > rr);
      t = early ? (out ? put(FAR) : low) : t;
    }
    *t_of = t;
    return hit;
  }
  HOT static I meet_flat(const Block& k_, const Whole& one, F* t_of) {
#pragma clang fp contract(on)
    const float *a = one.a, *b = one.b, *w = one.row + 8, u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    F dx = k_.q[0], dy = k_.q[1], dz = k_.q[2], z = k_.p[2];
    F mx = k_.p[0] - a[0], my = k_.p[1] - a[1], mz = z - a[2];
    F px = dy * w[2] - dz * w[1], py = dz * w[0] - dx * w[2], pz = dx * w[1] - dy * w[0];
    F det = u[0] * px + u[1] * py + u[2] * pz, s = mx * px + my * py + mz * pz, adet = size_of(det);
    s = det < 0.0f ? -s : s;
    I hit = (s >= 0.0f) & (s <= adet) & (adet >= 1.0e-20f);
    F qx = my * u[2] - mz * u[1], qy = mz * u[0] - mx * u[2], qz = mx * u[1] - my * u[0];
    hit &= size_of(dx * qx + dy * qy + dz * qz) <= adet + one.radius * s;  // radius -1: a triangle, pointed at b
    if (!bits(hit)) return hit;
    *t_of = (w[0] * qx + w[1] * qy + w[2] * qz) / det;
    return hit & (*t_of >= k_.low) & (z + *t_of * dz <= one.z_top);
  }

  // What was hit: as the end of `cross_crop` in kernel/crop.py; what the knife cut lane by lane, all else at once
  void set_hits(Block& b) const {
    const unsigned hit = bits(b.prim >= 0), cut = bits((b.prim >= 0) & ((b.prim & CUT) != 0));
    for (unsigned some = cut; some; some &= some - 1) set_hit(b, __builtin_ctz(some));
    if (hit == cut) return;
    constexpr int TAKEN[11] = {0, 1, 2, 4, 5, 6, 8, 9, 10, 3, 11};  // of a row: ends a and b, width, radius, organ
    alignas(64) float field[12][N] = {};
    for (unsigned some = hit & ~cut; some; some &= some - 1) {
      const int l = __builtin_ctz(some);
      const float* row = row_of(b.prim[l]);
      for (int i = 0; i < 11; ++i) field[i][l] = row[TAKEN[i]];
      field[11][l] = row[14] > 0.0f ? row[14] : scene.reflectance.data[(int)row[11]];
    }
    F f[12];
    __builtin_memcpy(f, field, sizeof f);
    const I is_here = (b.prim >= 0) & ((b.prim & CUT) == 0), ky = (b.image << 16) >> 16, kx = (b.image - ky) >> 16;
    const F x_off = real(kx) * size, y_off = real(ky) * size;
    const F v[3] = {f[0] + x_off, f[1] + y_off, f[2]}, z[3] = {f[3] + x_off, f[4] + y_off, f[5]}, *w = f + 6;
    const F u[3] = {z[0] - v[0], z[1] - v[1], z[2] - v[2]};
    F n[3];
    for (int i = 0; i < 3; ++i) n[i] = b.p[i] + b.limit * b.q[i] - v[i];
    F share = (n[0] * u[0] + n[1] * u[1] + n[2] * u[2]) / most(u[0] * u[0] + u[1] * u[1] + u[2] * u[2], put(1.0e-20f));
    share = least(most(share, F{}), put(1.0f));
    const I is_flat = f[9] <= 0.0f;
    for (int i = 0; i < 3; ++i) {
      const F flat = u[(i + 1) % 3] * w[(i + 2) % 3] - u[(i + 2) % 3] * w[(i + 1) % 3];
      n[i] = is_flat ? flat : n[i] - share * u[i];
    }
    const F x = tile.mirror_x ? -n[0] : n[0], y = tile.mirror_y ? -n[1] : n[1];
    const F lift = (n[2] - x * tile.stand[1] - y * tile.stand[2]) * tile.squeeze;
    const F g[3] = {x - lift * tile.plane[1], y - lift * tile.plane[2], lift};
    const F along = g[0] * b.dx + g[1] * b.dy + g[2] * b.dz, length = most(root(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]), put(1.0e-20f));
    b.cosine = is_here ? least(put(1.0f), size_of(along) / length) : b.cosine;
    for (int i = 0; job.normal && i < 3; ++i) b.n[i] = is_here ? g[i] / (along > 0.0f ? -length : length) : b.n[i];
    b.t = is_here ? b.start + b.limit * b.shrink : b.t;
    b.what = is_here ? __builtin_convertvector(f[10], I) : b.what;
    b.albedo = is_here ? f[11] : b.albedo;
  }
  void set_hit(Block& b, int l) const {
    const int id = b.prim[l], prim = id & (CUT - 1), image = b.image[l];
    const float* row = row_of(prim);
    const bool is_stub = (id & CUT) && (int)row[11] == 3;
    b.t[l] = b.start[l] + b.limit[l] * b.shrink[l];
    b.what[l] = is_stub ? 6 : (int)row[11];
    float n[3], v[3], z[3];
    ends_of(row, image, id & CUT ? 0.01f * (float)foot_code(row, image_x(image), image_y(image)) * tile.squeeze : FAR, v, z);
    const float *w = row + 8, u[3] = {z[0] - v[0], z[1] - v[1], z[2] - v[2]};
    if (row[3] <= 0.0f) {
      for (int i = 0; i < 3; ++i) n[i] = u[(i + 1) % 3] * w[(i + 2) % 3] - u[(i + 2) % 3] * w[(i + 1) % 3];
    } else {
      for (int i = 0; i < 3; ++i) n[i] = b.p[i][l] + b.limit[l] * b.q[i][l] - v[i];
      const float f = lower(upper(dot3(n, u) / upper(dot3(u, u), 1.0e-20f), 0.0f), 1.0f);
      for (int i = 0; i < 3; ++i) n[i] -= f * u[i];
    }
    const float x = tile.mirror_x ? -n[0] : n[0], y = tile.mirror_y ? -n[1] : n[1];
    const float lift = (n[2] - x * tile.stand[1] - y * tile.stand[2]) * tile.squeeze;
    const float g[3] = {x - lift * tile.plane[1], y - lift * tile.plane[2], lift}, d[3] = {b.dx[l], b.dy[l], b.dz[l]};
    const float along = dot3(g, d), length = upper(__builtin_sqrtf(dot3(g, g)), 1.0e-20f);
    b.cosine[l] = lower(1.0f, __builtin_fabsf(along) / length);
    for (int i = 0; i < 3; ++i) b.n[i][l] = g[i] / (along > 0.0f ? -length : length);
    b.albedo[l] = row[14] > 0.0f && !is_stub ? row[14] : scene.reflectance.data[b.what[l]];
  }

  // Ground of the tile, for the lanes that get down to it: as `cross_ground` in kernel/cast.py, all lanes over one
  // patch of the lattice at a time, and patch by patch
  struct Patch { float z0, h00, hu, hv, huv, top, s00, s10, s01, s11; };  // surface seen from z0, its top; depth of straw
  void meet_ground(Block& b) {
    const float *plane = tile.plane, per_gap = 8.0f / size;
    F t = b.tin, end = least(b.tout, b.t), kx = tile.x - b.tx, ky = tile.y - b.ty, dx = b.dx, dy = b.dy, dz = b.dz;
    F h1 = dz - plane[1] * dx - plane[2] * dy;
    F h0 = b.oz - (put((float)(plane[0] - gz)) - b.z0) - plane[1] * (b.ox - (kx + 0.5f) * size) -
           plane[2] * (b.oy - (ky + 0.5f) * size);
    I live = (b.t >= 0.0f) & (t <= end) & ~(least(h0 + h1 * t, h0 + h1 * end) > tile.bump);
    if (!bits(live)) return;
    F through = (tile.bump - h0) / h1;
    t = h1 < 0.0f ? most(t, through) : t;
    end = h1 > 0.0f ? least(end, through) : end;
    const int x0 = tile.jx * 8, y0 = tile.jy * 8;  // lattice cells of the page; where the ray is in them
    F x = b.ox * per_gap - (tile.x - tile.jx - b.tx) * 8.0f, y = b.oy * per_gap - (tile.y - tile.jy - b.ty) * 8.0f;
    F xd = dx * per_gap, yd = dy * per_gap, mx = b.ivx * (size / 8.0f), my = b.ivy * (size / 8.0f);  // 0 where parallel
    F cx = mx == 0.0f ? put(FAR) : -x * mx, cy = my == 0.0f ? put(FAR) : -y * my;
    I right = xd > 0.0f, left = yd > 0.0f, ix = cell_of(x + xd * t, x0), iy = cell_of(y + yd * t, y0);
    for (unsigned some = bits(live); some; some = bits(live)) {
      const int l = __builtin_ctz(some), px = ix[l], py = iy[l];
      const Patch patch = patch_at(py * 65 + px, b.z0[l]);
      I here = live & (ix == px) & (iy == py) & (b.z0 == patch.z0);
      F tx = real(px - right) * mx + cx, ty = real(py - left) * my + cy, leave = least(least(tx, ty), end);
      I done = leave >= end;
      F low = b.oz + dz * (dz < 0.0f ? most(leave, t) : t);
      if (bits(here & (low <= patch.top))) done |= hit_patch(b, here, patch, x + xd * t - (float)px, y + yd * t - (float)py, xd, yd, t, leave);
      I turns = here & (tx <= ty), goes = here & ~(tx <= ty);
      ix += turns & (1 | ~right);
      iy += goes & (1 | ~left);
      t = here ? most(leave, t) : t;
      live &= ~(here & done) & ((((ix - x0) | (iy - y0)) & ~7) == 0);
    }
  }
  static F real(I v) { return __builtin_convertvector(v, F); }
  static I cell_of(F x, int first) {
    I i = __builtin_convertvector(__builtin_elementwise_floor(x), I);
    i = i < first ? puti(first) : i;
    return i > first + 7 ? puti(first + 7) : i;
  }
  Patch patch_at(int n, float ray_z0) const {
    const float *ground = scene.ground.data + (size_t)tile.slot * 65 * 65 + n, *straw = scene.straw.data + (size_t)tile.slot * 65 * 65 + n;
    const float z0 = (float)(gz + ray_z0), s00 = straw[0], s10 = straw[1], s01 = straw[65], s11 = straw[66];
    const float h00 = (ground[0] - z0) + s00, h10 = (ground[1] - z0) + s10, h01 = (ground[65] - z0) + s01, h11 = (ground[66] - z0) + s11;
    const float hv = h01 - h00, top = upper(upper(h00, h10), upper(h01, h11));
    return {ray_z0, h00, h10 - h00, hv, h11 - h10 - hv, top + 1e-3f, s00, s10, s01, s11};
  }
  I hit_patch(Block& b, I who, const Patch& g, F u, F v, F xd, F yd, F t, F leave) const {
    const float per_gap = 8.0f / size;
    F above = b.oz + b.dz * t - (g.h00 + g.hu * u + g.hv * v + g.huv * u * v);
    F rate = b.dz - (g.hu + g.huv * v) * xd - (g.hv + g.huv * u) * yd, bend = -g.huv * xd * yd;
    F disc = rate * rate - 4.0f * bend * above, r = root(disc);
    F s = rate < 0.0f ? 2.0f * above / (-rate + r) : bend < 0.0f ? -0.5f * (rate + r) / bend : put(FAR);
    s = (disc >= 0.0f) & ~(s > most(leave - t, F{})) ? s : put(FAR);
    s = above <= 0.0f ? (rate < 0.0f ? F{} : put(FAR)) : s;
    I hit = who & (s < FAR) & (t + s <= b.t);
    if (!bits(hit)) return hit;
    u += xd * s;
    v += yd * s;
    F nx = -(g.hu + g.huv * v) * per_gap, ny = -(g.hv + g.huv * u) * per_gap;
    I is_straw = (g.s00 * (1.0f - u) + g.s10 * u) * (1.0f - v) + (g.s01 * (1.0f - u) + g.s11 * u) * v > 0.005f;
    const float *shade = scene.reflectance.data;
    b.t = hit ? t + s : b.t;
    b.what = hit ? is_straw ? puti(2) : puti(1) : b.what;
    const F n[3] = {nx, ny, put(1.0f)}, across = nx * b.dx + ny * b.dy + b.dz, length = root(nx * nx + ny * ny + 1.0f);
    b.cosine = hit ? size_of(across) / length : b.cosine;
    for (int i = 0; job.normal && i < 3; ++i) b.n[i] = hit ? n[i] / (across > 0.0f ? -length : length) : b.n[i];
    b.albedo = hit ? is_straw ? put(shade[2]) : put(shade[1]) : b.albedo;
    return hit;
  }
};
