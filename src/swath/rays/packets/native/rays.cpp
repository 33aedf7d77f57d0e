// Rays of a group: where they start and go, how far they look, what they hit.

struct Job {  // as JOB in traversal.py
  const double *origins, *directions;                        // of all rays, (rays, 3), origins also one for all, or, with spots,
  const double* spots;                                       // of all beams (beams, 3), (beams, 3, 3): as Spots.offsets
  const int *order, *first;                                  // the rays, group after group, null = as they come; first of each group
  float* distance; unsigned char* organ; float *cosine, *reflectance, *normal;  // out, per ray; normal or null
  long long lanes, groups, sub_rays;              // rays in a vector, at most N
  long long row;                                  // rays in a row of a group of an image, else 0
  long long spot_step, origin_step, direction_step;  // from one beam's spots, a ray's origin, its direction to the next one's,
                                                  // 0 = the same
  long long solids;                               // 1 = out holds the nearest solid of every ray, organ 0 without one
  long long next, flags;                         // shared by all threads: the next group; what is to be looked at again
  double range_max;
};


struct Block {  // N lanes side by side: all that is known of them lies together
  I ray;
  F ox, oy, oz, dx, dy, dz;     // stand frame, from the ray's own tile
  F ivx, ivy, ofx, ofy;         // t of planes x = c: c * iv + of
  F tx, ty, z0;                 // the ray's tile and height, from the group's
  F w0, w1;                     // depth of the ray at t: w0 + w1 t
  F t;                          // nearest so far
  I what;                       // organ, 0 = nothing but the solid that was there before
  F cosine, albedo, n[3];       // unit normal in the stand frame, against the ray
  // in the tile at hand: local ray from t = start, per t, where it enters, limit, nearest primitive
  F p[3], q[3], low, limit, start, shrink, end, tin, tout;
  I is_open, prim, image;
};
struct alignas(64) Taken {  // rays of a group as they come, before they are packed: as in a block
  float ox[ROOM + N], oy[ROOM + N], oz[ROOM + N], dx[ROOM + N], dy[ROOM + N], dz[ROOM + N], tx[ROOM + N], ty[ROOM + N], z0[ROOM + N];
  float u[ROOM + N], v[ROOM + N];  // slopes
};
struct Spot { F u, v, ou, ov, depth_max; };  // for the cull: slope, offset of the origin, depth beyond which nothing counts
struct alignas(64) VectorBounds {  // N lanes each. Slopes: middle, half size
  float cu[VECTORS], cv[VECTORS], ru[VECTORS], rv[VECTORS];
  float depth_max[VECTORS];  // depth beyond which nothing counts in the tile at hand
};
struct alignas(64) PacketBounds {  // boxes of the rays of a packet: place o and direction d along A, across it, up
  float until[PACKETS];  // t beyond which nothing counts
  float oa0[PACKETS], oa1[PACKETS], da0[PACKETS], da1[PACKETS], ob0[PACKETS], ob1[PACKETS], db0[PACKETS], db1[PACKETS];
  float oz0[PACKETS], oz1[PACKETS], dz0[PACKETS], dz1[PACKETS];
  float row_t0[PACKETS], row_t1[PACKETS], row_b0[PACKETS], row_b1[PACKETS], row_z0[PACKETS];  // in the row of tiles at hand
  int ground[PACKETS];  // vectors that get down to it in the tile at hand
};

struct Rays : Vectors {
  Job& job;
  SceneRef scene;
  const float size = (float)scene.tile_size;
  const bool is_parallel = job.direction_step == 0;  // then slopes are places across, and the depth is of no concern
  int taken, packets, vectors;   // its rays; its packets, the vectors of each
  int gx, gy, A;               // the tile it is seen from; tiles go by in rows along this axis of the stand
  double gz, corner[2];        // the height it is seen from; the tile again
  double lowest[3], highest[3];  // origins
  float apex[3], lead_direction[3], e[3][3], offset_max;  // offset_max: how far a ray is from its place in slopes where depth is 1, at most
  int begun;                     // place of its first ray
  bool is_invalid;
  D pattern[SUBS / 8][5];        // spots of a beam, where all beams have the same
  Taken come;
  int sorted[ROOM];              // of those, in the order of vectors
  Block r[VECTORS];
  Spot spot[VECTORS];
  VectorBounds c;
  PacketBounds k;

  Rays(Job& j, SceneRef s) : job(j), scene(s) {
    const bool is_same = job.spots && job.spot_step == 0;
    for (int sub = 0; is_same && sub < job.sub_rays; sub += 8) gather_spots(0, sub, pattern[sub / 8]);
  }

  // The next rays in the stand frame, each from its own tile: as `to_stand` in kernel/scene.py.
  // `taken`: how many go together with the first
  void take(int at, int wanted) {
    is_invalid = false;
    begun = at;
    begin_at(at);
    D low[3], high[3];
    for (int i = 0; i < 3; ++i) low[i] = high[i] = D{} + lowest[i];
    for (int n = 0, some; n < wanted && !is_invalid; n += some) {
      some = wanted - n < 8 ? wanted - n : 8;
      D o[3], d[3];
      gather(at + n, &some, o, d);
      into_tiles(n, o, d);
      const unsigned apart = ~bits(together(n)) & ((1u << some) - 1);
      taken = n + (apart ? __builtin_ctz(apart) : some);
      for (int i = 0; i < 3; ++i) {
        for (int l = taken - n; apart && l < 8; ++l) o[i][l] = lowest[i];  // the first one's
        low[i] = o[i] < low[i] ? o[i] : low[i];
        high[i] = o[i] > high[i] ? o[i] : high[i];
      }
      if (apart) break;
    }
    if (is_invalid) __atomic_fetch_or(&job.flags, INVALID, __ATOMIC_RELAXED);
    for (int i = 0; i < 3; ++i) {
      lowest[i] = __builtin_reduce_min(low[i]);
      highest[i] = __builtin_reduce_max(high[i]);
    }
  }
  int ray_at(int place) const { return job.order ? job.order[place] : place; }

  static D whole(D v) { return __builtin_elementwise_floor(v); }
  void turn(D* v) const {
    const D x = v[0], y = v[1];
    v[0] = scene.turn[0] * x + scene.turn[1] * y;
    v[1] = scene.turn[0] * y - scene.turn[1] * x;
  }
  HOT void gather(int at, int* some, D* o, D* d) const {  // 8 rays in the stand frame, of which so many count
    if (job.spots) {  // of one beam: as Spots.rays
      const int beam = at / (int)job.sub_rays, sub = at - beam * (int)job.sub_rays;
      const int left = (int)job.sub_rays - sub < 8 - sub % 8 ? (int)job.sub_rays - sub : 8 - sub % 8;
      const double *place = job.origins + 3 * (size_t)beam, *axes = job.directions + 9 * (size_t)beam;
      if (left < *some) *some = left;
      D f[5];
      if (job.spot_step == 0 && sub % 8 == 0) for (int i = 0; i < 5; ++i) f[i] = pattern[sub / 8][i];
      else gather_spots(beam, sub, f);
      for (int i = 0; i < 3; ++i) {
        o[i] = place[i] + f[0] * axes[3 * i + 1] + f[1] * axes[3 * i + 2];
        d[i] = (axes[3 * i] + f[2] * axes[3 * i + 1] + f[3] * axes[3 * i + 2]) * f[4];
      }
    } else {
      gather_numbers(job.directions, job.direction_step, at, *some, d);
      gather_numbers(job.origins, job.origin_step, at, *some, o);
    }
    turn(o);
    turn(d);
  }
  HOT void gather_numbers(const double* all, long long step, int at, int some, D* to) const {  // three of each ray
    const int begin = ray_at(at);
    if (step == 0) {
      for (int i = 0; i < 3; ++i) to[i] = D{} + all[i];
    } else if (some == 8 && ray_at(at + 7) == begin + 7) {  // one after the other in memory
      D a, b, c;
      __builtin_memcpy(&a, all + step * begin, 64);
      __builtin_memcpy(&b, all + step * begin + 8, 64);
      __builtin_memcpy(&c, all + step * begin + 16, 64);
      to[0] = __builtin_shufflevector(__builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 0, 0), c, 0, 1, 2, 3, 4, 5, 10, 13);
      to[1] = __builtin_shufflevector(__builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 0, 0, 0), c, 0, 1, 2, 3, 4, 8, 11, 14);
      to[2] = __builtin_shufflevector(__builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 0, 0, 0), c, 0, 1, 2, 3, 4, 9, 12, 15);
    } else {
      for (int l = 0; l < 8; ++l)
        for (int i = 0; i < 3; ++i) to[i][l] = all[step * ray_at(at + (l < some ? l : 0)) + i];
    }
  }
  void gather_spots(int beam, int sub, D* f) const {  // the last one again where there are no more
    const double* all = job.spots + beam * job.spot_step;
    for (int l = 0; l < 8; ++l) {
      const int n = sub + l < job.sub_rays ? sub + l : (int)job.sub_rays - 1;
      for (int i = 0; i < 5; ++i) f[i][l] = all[5 * n + i];
    }
  }
  void begin_at(int place) {  // all is seen from the tile and the height of this ray
    D o[3], d[3];
    int one = 1;
    gather(place, &one, o, d);
    const double per_size = 1.0 / scene.tile_size, unit[3] = {scene.tile_size, scene.tile_size, 1.0};
    const double from[3] = {whole(o[0] * per_size)[0], whole(o[1] * per_size)[0], whole(o[2])[0]};
    corner[0] = from[0];
    corner[1] = from[1];
    gz = from[2];
    for (int i = 0; i < 3; ++i) {
      apex[i] = (float)(o[i][0] - from[i] * unit[i]);
      lead_direction[i] = (float)d[i][0];
      lowest[i] = highest[i] = o[i][0];
    }
  }
  HOT void into_tiles(int n, const D* o, const D* d) {
    const double per_size = 1.0 / scene.tile_size, unit = scene.tile_size;
    const D off = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.0;
    auto fine = (off < 0.99e-3) & (off > -0.99e-3);
    for (int i = 0; i < 3; ++i) fine &= (o[i] < 1e8) & (o[i] > -1e8);
    is_invalid |= __builtin_reduce_and(fine) == 0;
    const D tx = whole(o[0] * per_size), ty = whole(o[1] * per_size), z0 = whole(o[2]);
    const D found[9] = {o[0] - tx * unit, o[1] - ty * unit, o[2] - z0, d[0], d[1], d[2], tx - corner[0], ty - corner[1], z0 - gz};
    float* const to[9] = {come.ox, come.oy, come.oz, come.dx, come.dy, come.dz, come.tx, come.ty, come.z0};
    for (int i = 0; i < 9; ++i) {
      const F8 f = __builtin_convertvector(found[i], F8);
      __builtin_memcpy(to[i] + n, &f, 32);
    }
  }
  I together(int n) const {  // rays from there on that look about the same direction as the first one, from about there
    F x = load(come.ox + n) + load(come.tx + n) * size - apex[0], y = load(come.oy + n) + load(come.ty + n) * size - apex[1];
    F z = load(come.oz + n) + load(come.z0 + n) - apex[2];
    F turned = load(come.dx + n) * lead_direction[0] + load(come.dy + n) * lead_direction[1] + load(come.dz + n) * lead_direction[2];
    const F along = x * lead_direction[0] + y * lead_direction[1] + z * lead_direction[2];
    if (is_parallel) return (x * x + y * y + z * z - along * along <= SPREAD * SPREAD) & (size_of(along) <= DEEP);
    return (x * x + y * y + z * z <= SPREAD * SPREAD) & (turned >= 1.0f - NARROW);
  }

  // Which rays are a vector: columns along the fan, in each from one side to the other, about as high as wide; a packet
  // is a column. What a ray hits does not depend on it
  void pack() {
    const int lanes = (int)job.lanes;
    F u0 = put(FAR), u1 = put(-FAR), v0 = put(FAR), v1 = put(-FAR);
    for (int n = 0; n < taken; n += N) {
      const F dx = load(come.dx + n), dy = load(come.dy + n), dz = load(come.dz + n);
      const F depth = dx * e[0][0] + dy * e[0][1] + dz * e[0][2];
      F u = (dx * e[1][0] + dy * e[1][1] + dz * e[1][2]) / depth, v = (dx * e[2][0] + dy * e[2][1] + dz * e[2][2]) / depth;
      if (is_parallel) {
        const F x = load(come.ox + n) + load(come.tx + n) * size, y = load(come.oy + n) + load(come.ty + n) * size;
        const F z = load(come.oz + n) + load(come.z0 + n);
        u = x * e[1][0] + y * e[1][1] + z * e[1][2];
        v = x * e[2][0] + y * e[2][1] + z * e[2][2];
      }
      store(come.u + n, u);
      store(come.v + n, v);
      const I known = every() < taken - n;
      u0 = known ? least(u0, u) : u0; u1 = known ? most(u1, u) : u1;
      v0 = known ? least(v0, v) : v0; v1 = known ? most(v1, v) : v1;
    }
    const float left = lowest_of(u0), low = lowest_of(v0), wide = highest_of(u1) - left + 1e-6f, high = highest_of(v1) - low + 1e-6f;
    const int all = (taken + lanes - 1) / lanes;
    const float aim = __builtin_sqrtf(all * high / (UPRIGHT * wide));
    vectors = 1;
    for (int v = 2; v <= all; ++v)  // the nearest to it, as a ratio, of those for which there is room
      if ((all + v - 1) / v * v <= VECTORS && (v <= aim || v * vectors < aim * aim)) vectors = v;
    packets = (all + vectors - 1) / vectors;
    int as_come[ROOM];
    for (int n = 0; n < taken; ++n) as_come[n] = n;
    sort_by(come.u, left, wide, as_come, taken, sorted);
    for (int p = 0; vectors > 1 && p < packets; ++p) {
      const int begin = p * vectors * lanes, count = taken - begin < vectors * lanes ? taken - begin : vectors * lanes;
      sort_by(come.v, low, high, sorted + begin, count, as_come);
      __builtin_memcpy(sorted + begin, as_come, count * sizeof(int));
    }
    for (int b = 0; b < packets * vectors; ++b) fill(r[b], b * lanes, b / vectors * vectors * lanes);
  }
  static void sort_by(const float* value, float from, float range, const int* some, int count, int* to) {  // roughly
    int at[257];
    unsigned char step[ROOM];
    const int steps = count < 256 ? count : 256;
    const float per = ((float)steps - 0.1f) / range;
    for (int i = 0; i <= steps; ++i) at[i] = 0;
    for (int n = 0; n < count; ++n) ++at[1 + (step[n] = (unsigned char)((value[some[n]] - from) * per))];
    for (int i = 1; i < steps; ++i) at[i] += at[i - 1];
    for (int n = 0; n < count; ++n) to[at[step[n]]++] = some[n];
  }
  void fill(Block& b, int begin, int spare) {
    I live = (every() < (int)job.lanes) & (every() < taken - begin);
    alignas(64) int ray[N], from[N];
    for (int l = 0; l < N; ++l) {
      from[l] = sorted[live[l] ? begin + l : begin < taken ? begin : spare];
      ray[l] = ray_at(begun + from[l]);
    }
    const float* const all[9] = {come.ox, come.oy, come.oz, come.dx, come.dy, come.dz, come.tx, come.ty, come.z0};
    F* const to[9] = {&b.ox, &b.oy, &b.oz, &b.dx, &b.dy, &b.dz, &b.tx, &b.ty, &b.z0};
    const bool is_one = starts_at_one();
    for (int i = 0; i < 9; ++i) {
      if (is_one && (i < 3 || i >= 6)) *to[i] = put(all[i][0]);
      else for (int l = 0; l < N; ++l) (*to[i])[l] = all[i][from[l]];
    }
    start(b, ray, live);
  }
  bool starts_at_one() const { return lowest[0] == highest[0] && lowest[1] == highest[1] && lowest[2] == highest[2]; }
  void start(Block& b, const int* ray, I live) const {
    b.ray = live ? loadi(ray) : puti(-1);
    b.t = live ? put((float)job.range_max) : put(-1.0f);
    b.what = I{};
    for (unsigned l = job.solids ? bits(live) : 0; l; l &= l - 1) {
      const int i = __builtin_ctz(l);
      if (job.organ[ray[i]]) b.t[i] = job.distance[ray[i]];
    }
  }
  int page_at(int x, int y) const {
    const int i = x - scene.table_x, j = y - scene.table_y;
    if (i < 0 || j < 0 || i >= scene.table.shape[1] || j >= scene.table.shape[0]) return -1;
    return scene.table.data[j * scene.table.shape[1] + i];
  }
  void check_height() {  // do all rays start above whatever stands or lies there?
    const double side = 8.0 * scene.tile_size;
    auto page_of = [&](double x) { return (int)__builtin_floor(x / side); };
    bool is_above = highest[0] - lowest[0] < side && highest[1] - lowest[1] < side;
    for (int y = page_of(lowest[1]); is_above && y <= page_of(highest[1]); ++y)
      for (int x = page_of(lowest[0]); is_above && x <= page_of(highest[0]); ++x) {
        const int slot = page_at(x, y);
        is_above = slot >= 0 && lowest[2] > scene.page_top.data[slot];
      }
    if (!is_above) __atomic_fetch_or(&job.flags, LOW, __ATOMIC_RELAXED);
  }

  // The frame of the group, and every ray in slopes
  void find_frame() {
    gx = (int)corner[0];
    gy = (int)corner[1];
    const float *way[3] = {come.dx, come.dy, come.dz};
    const int z = taken - 1, end = job.row > 1 && job.row < taken ? (int)job.row - 1 : z;  // of the fan
    for (int i = 0; i < 3; ++i) {
      e[0][i] = way[i][0] + way[i][taken / 2] + way[i][z];
      e[1][i] = way[i][end] - way[i][0];
    }
    unit(e[0]);
    A = e[0][0] * e[0][0] >= e[0][1] * e[0][1] ? 0 : 1;
    const float along = dot3(e[0], e[1]);
    for (int i = 0; i < 3; ++i) e[1][i] -= along * e[0][i];
    if (unit(e[1]) < 1e-3f) {
      const bool steep = e[0][2] * e[0][2] > 0.9f;
      e[1][0] = steep ? 1.0f - e[0][0] * e[0][0] : -e[0][1];
      e[1][1] = steep ? -e[0][0] * e[0][1] : e[0][0];
      e[1][2] = steep ? -e[0][0] * e[0][2] : 0.0f;
      unit(e[1]);
    }
    for (int i = 0; i < 3; ++i) {
      const int n = (i + 1) % 3, o = (i + 2) % 3;
      e[2][i] = e[0][n] * e[1][o] - e[0][o] * e[1][n];
    }
  }
  void into_slopes() {
    offset_max = 0.0f;
    for (int p = 0; p < packets; ++p) {
      F low[6], high[6];
      for (int i = 0; i < 6; ++i) { low[i] = put(FAR); high[i] = put(-FAR); }
      for (int b = p * vectors; b < (p + 1) * vectors; ++b) slope_of(b, low, high);
      auto ends = [&](int i, float* a, float* z, float room) {
        a[p] = lowest_of(low[i]) - room;
        z[p] = highest_of(high[i]) + room;
      };
      ends(0, k.oa0, k.oa1, ROUND);
      ends(1, k.da0, k.da1, 1e-7f);
      ends(2, k.ob0, k.ob1, ROUND);
      ends(3, k.db0, k.db1, 1e-7f);
      ends(4, k.oz0, k.oz1, ROUND);
      ends(5, k.dz0, k.dz1, 1e-7f);
    }
  }
  void slope_of(int b, F* low, F* high) {
#pragma clang fp contract(on)
    Block& k_ = r[b];
    Spot& s_ = spot[b];
    F dx = k_.dx, dy = k_.dy, dz = k_.dz, ox = k_.ox, oy = k_.oy;
    I flat_x = size_of(dx) < 1e-12f, flat_y = size_of(dy) < 1e-12f;
    k_.ivx = flat_x ? F{} : 1.0f / dx;
    k_.ivy = flat_y ? F{} : 1.0f / dy;
    k_.ofx = flat_x ? put(FAR) : -ox / dx;
    k_.ofy = flat_y ? put(FAR) : -oy / dy;
    F xx = ox + k_.tx * size, yy = oy + k_.ty * size, zz = k_.oz + k_.z0;
    F found[6] = {A ? yy : xx, A ? dy : dx, A ? xx : yy, A ? dx : dy, zz, dz};
    for (int i = 0; i < 6; ++i) { low[i] = least(low[i], found[i]); high[i] = most(high[i], found[i]); }
    F x = xx - apex[0], y = yy - apex[1], z = zz - apex[2];
    F d0 = dx * e[0][0] + dy * e[0][1] + dz * e[0][2], x0 = x * e[0][0] + y * e[0][1] + z * e[0][2];
    F su = (dx * e[1][0] + dy * e[1][1] + dz * e[1][2]) / d0, sv = (dx * e[2][0] + dy * e[2][1] + dz * e[2][2]) / d0;
    F ou = x * e[1][0] + y * e[1][1] + z * e[1][2] - x0 * su, ov = x * e[2][0] + y * e[2][1] + z * e[2][2] - x0 * sv;
    k_.w0 = x0;
    k_.w1 = d0;
    if (is_parallel) {
      su = ou;
      sv = ov;
      ou = ov = F{};
    }
    s_.u = su;
    s_.v = sv;
    s_.ou = ou;
    s_.ov = ov;
    auto span = [&](F x, float* middle, float* half) {
      const float a = lowest_of(x), z = highest_of(x);
      middle[b] = 0.5f * (a + z);
      half[b] = 0.5f * (z - a) + 1e-6f;
    };
    span(su, c.cu, c.ru);
    span(sv, c.cv, c.rv);
    offset_max = upper(offset_max, highest_of(most(size_of(ou), size_of(ov))) + 1e-6f);
  }

  // How far a packet still looks: to the farthest of its rays' nearest hits
  void look(int p) {
    F t_far = put(-FAR);
    for (int b = p * vectors; b < (p + 1) * vectors; ++b) t_far = most(t_far, r[b].t);
    k.until[p] = highest_of(t_far);
  }

  // Out
  void write(size_t to, const Block& b, int l) const {
    const bool some = b.what[l] > 0;
    if (!some && job.solids && job.organ[to]) return;
    job.distance[to] = some ? b.t[l] : __builtin_nanf("");
    job.organ[to] = (unsigned char)b.what[l];
    job.cosine[to] = some ? b.cosine[l] : 0.0f;
    job.reflectance[to] = some ? b.albedo[l] : 0.0f;
    if (!job.normal) return;
    const float x = b.n[0][l], y = b.n[1][l], c = (float)scene.turn[0], s = (float)scene.turn[1];
    job.normal[3 * to] = some ? c * x - s * y : 0.0f;
    job.normal[3 * to + 1] = some ? s * x + c * y : 0.0f;
    job.normal[3 * to + 2] = some ? b.n[2][l] : 0.0f;
  }
  void hand_out(const Block& b) const {
    for (unsigned l = bits(b.ray >= 0); l; l &= l - 1) write(b.ray[__builtin_ctz(l)], b, __builtin_ctz(l));
  }
};
