// The group walk: the body of one native function (kernel.py), explained in docs/rays.md in the same words.
//
// In: g, the group; scene, index, lanes (packs x width: ray of each lane, -1 = none), first_pack (per group),
// origins, directions, need. In and out, per ray: distance, organ, cosine, reflectance, preset with the
// nearest solid, or with range_max and organ 0.
//
// 16 lanes are computed at once by vector types of the compiler; whatever the machine has, the values are the
// same. No lane looks at another one: what else is in the group decides what is looked at, never a result.
// Lengths are metres. Frames: stand (from the corner of the first ray's tile), prototype, and group: e0 mean
// direction, e1 along the fan, e2; "slope" = place across over depth w along e0, seen from the apex.

typedef float F __attribute__((vector_size(64)));
typedef int I __attribute__((vector_size(64)));
typedef short S __attribute__((vector_size(32)));
typedef short S4 __attribute__((vector_size(64)));
typedef unsigned char U __attribute__((vector_size(64)));
typedef unsigned char B16 __attribute__((vector_size(16)));
typedef unsigned long long W8 __attribute__((vector_size(64)));
typedef bool B __attribute__((ext_vector_type(16)));
typedef double D __attribute__((vector_size(64)));  // half of the lanes
typedef float F8 __attribute__((vector_size(32)));
constexpr int N = 16;            // lanes of a vector
constexpr int ROOM = 1024;       // lanes of a group
constexpr int SLICES = ROOM / N, PACKS = SLICES;  // packs of a group at most
constexpr int PAIRS = 4096;      // pieces and slices that wait
constexpr int KEPT = 2048;       // pieces that wait for their test
constexpr int FLUSH = 8;         // so many are enough for a test
constexpr int AROUND = 8;        // columns of a tile, one way
constexpr int SPAN = 2048;       // columns side by side that a walk through one tile may touch
constexpr float FAR = 1.0e30f;
constexpr float NARROW = 0.03f;  // 1 - cos of the widest angle in a group, about 14 deg
constexpr float SPREAD = 1.0f;   // widest distance between origins in a group
constexpr float ROUND = 2.0e-5f; // of places, covers float32
constexpr int STANDING = 255, CUT = 1 << 30;

auto load = [](const float* p) -> F { F v; __builtin_memcpy(&v, p, 64); return v; };
auto loadi = [](const int* p) -> I { I v; __builtin_memcpy(&v, p, 64); return v; };
auto store = [](float* p, F v) { __builtin_memcpy(p, &v, 64); };
auto storei = [](int* p, I v) { __builtin_memcpy(p, &v, 64); };
auto put = [](float x) -> F { return F{} + x; };
auto puti = [](int x) -> I { return I{} + x; };
auto least = [](F a, F b) -> F { return a < b ? a : b; };
auto most = [](F a, F b) -> F { return a > b ? a : b; };
auto size_of = [](F a) -> F { return __builtin_elementwise_abs(a); };
auto root = [](F a) -> F { return __builtin_elementwise_sqrt(a); };
auto folded = [](F a, auto pick) -> float {  // of all lanes; the compiler's own way minds nan and takes three times as long
  a = pick(a, __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7));
  a = pick(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3));
  a = pick(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1));
  return pick(a, __builtin_shufflevector(a, a, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0))[0];
};
auto lowest_of = [&](F a) -> float { return folded(a, least); };
auto highest_of = [&](F a) -> float { return folded(a, most); };
auto bits = [](I m) -> unsigned {
  B b = __builtin_convertvector(m < 0, B);
  unsigned short u;
  __builtin_memcpy(&u, &b, 2);
  return u;
};
auto keep_some = [&](float* to, F v, I keep, unsigned found) {  // the kept lanes, one after the other
#ifdef __AVX512F__
  F packed = __builtin_ia32_compresssf512_mask(v, F{}, (unsigned short)found);
  __builtin_memcpy(to, &packed, 64);
#else
  for (; found; found &= found - 1) *to++ = v[__builtin_ctz(found)];
#endif
};
auto keep_ints = [&](int* to, I v, I keep, unsigned found) {
  F f;
  __builtin_memcpy(&f, &v, 64);
  keep_some((float*)to, f, keep, found);
};
auto lower = [](float a, float b) { return a < b ? a : b; };
auto upper = [](float a, float b) { return a > b ? a : b; };
auto down = [](float x) { return (int)__builtin_floorf(x); };
auto per = [](int a, int b) { int q = a / b; return a - q * b < 0 ? q - 1 : q; };

struct alignas(64) Block {  // N lanes side by side: all that is known of them lies together
  int ray[N];
  float ox[N], oy[N], oz[N], dx[N], dy[N], dz[N];  // stand frame, from the ray's own tile
  float ivx[N], ivy[N], ofx[N], ofy[N];            // t of planes x = c: c * iv + of
  float tx[N], ty[N], z0[N];                       // the ray's tile and height, from the group's
  float w0[N], w1[N];                              // depth of the ray at t: w0 + w1 t
  float t[N];                                      // nearest so far
  int what[N];                                     // organ, 0 = nothing, -1 = the solid that was there before
  float cosine[N], albedo[N];
  // in the tile at hand: local ray from t = start, per t, where it enters, limit, nearest primitive
  float p[3][N], q[3][N];
  float low[N], limit[N], start[N], shrink[N], end[N], tin[N], tout[N];
  int is_open[N], prim[N], image[N];
};
struct alignas(64) Spot {  // the same lanes for the cull: slope, offset of the origin, depth beyond which nothing counts
  float u[N], v[N], ou[N], ov[N], deep[N];
};
struct alignas(64) Slices {  // N lanes each. Slopes: middle, half size, disc; the same of the offsets; depth
  float cu[SLICES], cv[SLICES], ru[SLICES], rv[SLICES], disc[SLICES];
  float ou[SLICES], ov[SLICES], pu[SLICES], pv[SLICES], pdisc[SLICES];
  float reach[SLICES];  // depth beyond which nothing counts in the tile at hand
};
struct alignas(64) Packs {  // boxes of the rays of a pack
  float until[PACKS];  // t beyond which nothing counts
  float oa0[PACKS], oa1[PACKS], da0[PACKS], da1[PACKS], ob0[PACKS], ob1[PACKS], db0[PACKS], db1[PACKS];
  float oz0[PACKS], oz1[PACKS], dz0[PACKS], dz1[PACKS];
  float row_t0[PACKS], row_t1[PACKS], row_b0[PACKS], row_b1[PACKS], row_z0[PACKS], row_z1[PACKS];
  int ground[PACKS];
};
struct alignas(64) Ways {  // of the packs through the tile at hand, along the walk's axis: first, last, and linear
  float a0[PACKS], a1[PACKS], from[PACKS], reach[PACKS], until[PACKS];  // bounds from `from` on: across low and
  float bound[5][PACKS], rise[5][PACKS];                   // high, other axis low and high, least depth
};
struct Kept {  // pieces in slopes: middle, direction, half length, half width; least depth, 1 / depth, 1 / least; rounding; entry, image
  float u[KEPT + N], v[KEPT + N], tu[KEPT + N], tv[KEPT + N], h[KEPT + N], wide[KEPT + N], near[KEPT + N], inv[KEPT + N];
  int prim[KEPT + N], image[KEPT + N];
};
Block r[ROOM / N];
Packs k;
Slices c;
Spot spot[ROOM / N];
Kept kept;
Ways way;
struct { int piece, slice; } pair[PAIRS + N];
int asked_piece[PAIRS + N], asked_slice[PAIRS + N];
const I every = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

struct Job {  // as JOB in cast.py
  const double *origins, *directions;                        // of all rays, (rays, 3)
  const int *lanes, *first_pack;                             // (packs, width) ray of each lane, -1 = none; per group
  float* distance; unsigned char* organ; float *cosine, *reflectance;  // out: per ray, or per bundle as asked
  const float* solid; const unsigned char* solid_organ; const float *solid_cosine, *solid_reflectance;  // or null
  long long width, groups, sub_rays, need, only;  // need > 0: so many nearest hits per bundle; only: the last of them
  long long next, doubts;                         // shared by all threads: the next group; what is to be looked at again
  double range_max;
};
constexpr int WRONG = 1, LOW = 2;  // doubts: rays that are none; rays that start low or where nothing is known
Job& job = *(Job*)job_bytes.data;
const int width = job.width, slices = width / N, cap = ROOM / width, need = job.need;
const float size = (float)scene.tile_size;
const double dsize = scene.tile_size, per_size = 1.0 / dsize;
const int* lane_of = job.lanes;


struct Early { float t[ROOM], cosine[ROOM], albedo[ROOM]; int what[ROOM]; } early;  // of a pack that is walked in parts

for (long long g; (g = __atomic_fetch_add(&job.next, 1, __ATOMIC_RELAXED)) < job.groups;)
for (int at = job.first_pack[g], from = -1; at < job.first_pack[g + 1];) {
  // ---- 1. The rays of the next packs, in the stand frame, each from its own tile: as `to_stand` in kernel/scene.py.
  // Packs that are too far from the first one wait for the next turn; a pack that is too wide goes part by part,
  // lanes [from, after)
  const int left = job.first_pack[g + 1] - at;
  int packs = from >= 0 ? 1 : left < cap ? left : cap, after = width;
  double origin[2];  // corner of the first ray's tile, in tiles
  double gz = 0.0;
  float apex[3], lead[3];
  D lowest[3], highest[3];
  bool is_wrong = false;
  auto turned = [&](D* v) { D x = v[0]; v[0] = scene.turn[0] * x + scene.turn[1] * v[1]; v[1] = scene.turn[0] * v[1] - scene.turn[1] * x; };
  auto fetch = [&](const double* v, const int* ray, D* to) {
    for (int i = 0; i < 3; ++i) for (int l = 0; l < 8; ++l) to[i][l] = v[3 * (size_t)ray[l] + i];
  };
  auto whole = [](D v) -> D { return __builtin_elementwise_floor(v); };
  auto narrow = [](D v, float* to) { F8 f = __builtin_convertvector(v, F8); __builtin_memcpy(to, &f, 32); };
  auto lead_by = [&](int ray) {
    const int same[8] = {ray, ray, ray, ray, ray, ray, ray, ray};
    D o[3], d[3];
    fetch(job.origins, same, o);
    fetch(job.directions, same, d);
    turned(o);
    turned(d);
    const D tile[3] = {whole(o[0] * per_size), whole(o[1] * per_size), whole(o[2])};
    origin[0] = tile[0][0]; origin[1] = tile[1][0]; gz = tile[2][0];
    const double unit[3] = {dsize, dsize, 1.0};
    for (int i = 0; i < 3; ++i) {
      apex[i] = (float)(o[i] - tile[i] * unit[i])[0];
      lead[i] = (float)d[i][0];
      lowest[i] = highest[i] = o[i];
    }
  };
  auto take = [&](int slice, const int* ray) {  // false: some of it too far from the first for one group
    Block& b = r[slice];
    for (int h = 0; h < N; h += 8) {
      D o[3], d[3];
      fetch(job.origins, ray + h, o);
      fetch(job.directions, ray + h, d);
      D bad = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.0;
      auto fine = (bad < 0.99e-3) & (bad > -0.99e-3) & (o[0] < 1e8) & (o[0] > -1e8) & (o[1] < 1e8) & (o[1] > -1e8) & (o[2] < 1e8) & (o[2] > -1e8);
      is_wrong |= __builtin_reduce_and(fine) == 0;
      turned(o);
      turned(d);
      for (int i = 0; i < 3; ++i) {
        lowest[i] = o[i] < lowest[i] ? o[i] : lowest[i];
        highest[i] = o[i] > highest[i] ? o[i] : highest[i];
      }
      const D tx = whole(o[0] * per_size), ty = whole(o[1] * per_size), z0 = whole(o[2]);
      narrow(tx - origin[0], b.tx + h);
      narrow(ty - origin[1], b.ty + h);
      narrow(z0 - gz, b.z0 + h);
      narrow(o[0] - tx * dsize, b.ox + h);
      narrow(o[1] - ty * dsize, b.oy + h);
      narrow(o[2] - z0, b.oz + h);
      narrow(d[0], b.dx + h);
      narrow(d[1], b.dy + h);
      narrow(d[2], b.dz + h);
    }
    F x = load(b.ox) + load(b.tx) * size - apex[0], y = load(b.oy) + load(b.ty) * size - apex[1], z = load(b.oz) + load(b.z0) - apex[2];
    F turn = load(b.dx) * lead[0] + load(b.dy) * lead[1] + load(b.dz) * lead[2];
    return bits((x * x + y * y + z * z <= SPREAD * SPREAD) & (turn >= 1.0f - NARROW));
  };
  auto start = [&](int slice, const int* ray, I live) {
    Block& b = r[slice];
    storei(b.ray, live ? loadi(ray) : puti(-1));
    store(b.t, live ? put((float)job.range_max) : put(-1.0f));
    storei(b.what, I{});
    if (!job.solid) return;
    for (int l = 0; l < N; ++l) {
      if (b.ray[l] < 0) continue;
      b.t[l] = job.solid[ray[l]];
      b.what[l] = job.solid_organ[ray[l]] > 0 ? -1 : 0;
    }
  };
  lead_by(lane_of[at * width + (from < 0 ? 0 : from)]);
  for (int p = 0; p < packs; ++p) {
    const int begin = from < 0 ? 0 : from;
    bool fits = true;
    for (int v = 0; v < slices && fits; ++v) {
      const int* mine = lane_of + (at + p) * width;
      alignas(64) int ray[N];
      unsigned ok = 0xffff;
      for (;;) {
        I lane = every + v * N, known = loadi(mine + v * N);
        I live = (known >= 0) & (lane >= begin) & (lane < after);
        storei(ray, live ? known : puti(mine[begin]));
        ok = take(p * slices + v, ray);
        if (ok == 0xffff || from < 0 || is_wrong) { start(p * slices + v, ray, live); break; }
        after = v * N + __builtin_ctz(~ok);  // so far one part
      }
      fits = ok == 0xffff;
    }
    if (!fits) { packs = p; break; }
  }
  if (is_wrong) { __atomic_fetch_or(&job.doubts, WRONG, __ATOMIC_RELAXED); break; }
  if (packs == 0) { from = 0; continue; }  // the first pack alone is too wide: part by part
  const int gx = (int)origin[0], gy = (int)origin[1];
  const int count = packs * slices, count16 = (count + N - 1) & ~(N - 1);
  auto page_at = [&](int x, int y) {
    const int i = x - scene.table_x, j = y - scene.table_y;
    if (i < 0 || j < 0 || i >= scene.table.shape[1] || j >= scene.table.shape[0]) return -1;
    return scene.table.data[j * scene.table.shape[1] + i];
  };
  {  // do all start above all that stands or lies there?
    double low[3], high[3];
    for (int i = 0; i < 3; ++i) { low[i] = __builtin_reduce_min(lowest[i]); high[i] = __builtin_reduce_max(highest[i]); }
    auto page_of = [&](double x) { return (int)__builtin_floor(x * per_size * 0.125); };
    bool is_above = high[0] - low[0] < 8.0 * dsize && high[1] - low[1] < 8.0 * dsize;
    for (int y = page_of(low[1]); is_above && y <= page_of(high[1]); ++y)
      for (int x = page_of(low[0]); is_above && x <= page_of(high[0]); ++x) {
        const int slot = page_at(x, y);
        is_above = slot >= 0 && low[2] > scene.page_top.data[slot];
      }
    if (!is_above) __atomic_fetch_or(&job.doubts, LOW, __ATOMIC_RELAXED);
  }

  // ---- 2. The frame of the group, and every ray in slopes
  float e0[3] = {0, 0, 0}, e1[3], e2[3];
  for (int p = 0; p < packs; ++p) {
    e0[0] += r[p * slices].dx[0];
    e0[1] += r[p * slices].dy[0];
    e0[2] += r[p * slices].dz[0];
  }
  auto unit = [](float* v) {
    float n = __builtin_sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; ++i) v[i] /= n > 1e-20f ? n : 1.0f;
    return n;
  };
  unit(e0);
  {
    int j = (packs - 1) * width;
    e1[0] = r[j / N].dx[j % N] - r[0].dx[0];
    e1[1] = r[j / N].dy[j % N] - r[0].dy[0];
    e1[2] = r[j / N].dz[j % N] - r[0].dz[0];
    float along = e1[0] * e0[0] + e1[1] * e0[1] + e1[2] * e0[2];
    for (int i = 0; i < 3; ++i) e1[i] -= along * e0[i];
    if (unit(e1) < 1e-3f) {
      bool steep = e0[2] * e0[2] > 0.9f;
      e1[0] = steep ? 1.0f - e0[0] * e0[0] : -e0[1];
      e1[1] = steep ? -e0[0] * e0[1] : e0[0];
      e1[2] = steep ? -e0[0] * e0[2] : 0.0f;
      unit(e1);
    }
    e2[0] = e0[1] * e1[2] - e0[2] * e1[1];
    e2[1] = e0[2] * e1[0] - e0[0] * e1[2];
    e2[2] = e0[0] * e1[1] - e0[1] * e1[0];
  }
  const int A = e0[0] * e0[0] >= e0[1] * e0[1] ? 0 : 1;  // tiles go by in rows along this axis of the stand
  float sway_u = 0.0f;
  for (int p = 0; p < packs; ++p) {
    F low[6], high[6];  // place and direction along A, across A, up
    for (int i = 0; i < 6; ++i) { low[i] = put(FAR); high[i] = put(-FAR); }
    for (int b = p * slices; b < (p + 1) * slices; ++b) {
      Block& k_ = r[b];
      Spot& s_ = spot[b];
      F dx = load(k_.dx), dy = load(k_.dy), dz = load(k_.dz), ox = load(k_.ox), oy = load(k_.oy);
      I flat_x = size_of(dx) < 1e-12f, flat_y = size_of(dy) < 1e-12f;
      store(k_.ivx, flat_x ? F{} : 1.0f / dx);
      store(k_.ivy, flat_y ? F{} : 1.0f / dy);
      store(k_.ofx, flat_x ? put(FAR) : -ox / dx);
      store(k_.ofy, flat_y ? put(FAR) : -oy / dy);
      F xx = ox + load(k_.tx) * size, yy = oy + load(k_.ty) * size, zz = load(k_.oz) + load(k_.z0);
      F x = xx - apex[0], y = yy - apex[1], z = zz - apex[2];
      F d0 = dx * e0[0] + dy * e0[1] + dz * e0[2], x0 = x * e0[0] + y * e0[1] + z * e0[2];
      F su = (dx * e1[0] + dy * e1[1] + dz * e1[2]) / d0, sv = (dx * e2[0] + dy * e2[1] + dz * e2[2]) / d0;
      F ou = x * e1[0] + y * e1[1] + z * e1[2] - x0 * su, ov = x * e2[0] + y * e2[1] + z * e2[2] - x0 * sv;
      store(k_.w0, x0);
      store(k_.w1, d0);
      store(s_.u, su);
      store(s_.v, sv);
      store(s_.ou, ou);
      store(s_.ov, ov);
      F found[6] = {A ? yy : xx, A ? dy : dx, A ? xx : yy, A ? dx : dy, zz, dz};
      for (int i = 0; i < 6; ++i) { low[i] = least(low[i], found[i]); high[i] = most(high[i], found[i]); }
      auto box = [&](F x, float* middle, float* half) {
        float a = lowest_of(x), e = highest_of(x);
        middle[b] = 0.5f * (a + e);
        half[b] = 0.5f * (e - a) + 1e-6f;
      };
      box(su, c.cu, c.ru);
      box(sv, c.cv, c.rv);
      box(ou, c.ou, c.pu);
      box(ov, c.ov, c.pv);
      F au = su - c.cu[b], av = sv - c.cv[b];
      c.disc[b] = __builtin_sqrtf(highest_of(au * au + av * av)) + 1e-6f;
      c.pdisc[b] = __builtin_sqrtf(c.pu[b] * c.pu[b] + c.pv[b] * c.pv[b]);
      sway_u = upper(sway_u, upper(__builtin_fabsf(c.ou[b]) + c.pu[b], __builtin_fabsf(c.ov[b]) + c.pv[b]));
    }
    auto ends = [&](int i, float* a, float* b, float room) {
      a[p] = lowest_of(low[i]) - room;
      b[p] = highest_of(high[i]) + room;
    };
    ends(0, k.oa0, k.oa1, ROUND);
    ends(1, k.da0, k.da1, 1e-7f);
    ends(2, k.ob0, k.ob1, ROUND);
    ends(3, k.db0, k.db1, 1e-7f);
    ends(4, k.oz0, k.oz1, ROUND);
    ends(5, k.dz0, k.dz1, 1e-7f);
  }
  for (int b = count; b < count16; ++b)
    c.cu[b] = c.cv[b] = c.ru[b] = c.rv[b] = c.disc[b] = c.ou[b] = c.ov[b] = c.pu[b] = c.pv[b] = c.pdisc[b] = 0.0f;
  // t that at least `need` of a pack's hits do not exceed, at most a sixtieth of their spread above the least
  // such; t and hits are asked for by slice
  auto enough = [&](int p, auto t_of, auto is_hit) {
    F low = put(FAR), high = put(-FAR);
    int hits = 0;
    for (int b = p * slices; b < (p + 1) * slices; ++b) {
      I hit = is_hit(r[b]);
      F t = t_of(r[b]);
      low = least(low, hit ? t : put(FAR));
      high = most(high, hit ? t : put(-FAR));
      hits += __builtin_popcount(bits(hit));
    }
    if (hits < need) return FAR;
    float a = lowest_of(low), e = highest_of(high);
    for (int i = 0; i < (need == 1 ? 0 : 6) && hits > need; ++i) {
      const float middle = 0.5f * (a + e);
      int below = 0;
      for (int b = p * slices; b < (p + 1) * slices; ++b) below += __builtin_popcount(bits(is_hit(r[b]) & (t_of(r[b]) <= middle)));
      (below >= need ? e : a) = middle;
    }
    return need == 1 ? a : e;
  };
  // How far a pack still looks: to the farthest of its rays' nearest hits, or as far as is needed
  auto look = [&](int p) {
    F t_far = put(-FAR);
    for (int b = p * slices; b < (p + 1) * slices; ++b) t_far = most(t_far, load(r[b].t));
    k.until[p] = highest_of(t_far);
    if (need > 0)
      k.until[p] = lower(k.until[p], enough(p, [&](Block& b) { return load(b.t); }, [&](Block& b) { return loadi(b.what) != 0; }));
  };
  for (int p = 0; p < packs; ++p) look(p);

  // ---- 3. Ground of one tile for one lane: as `walk_ground` in kernel/cast.py
  auto hit_ground = [&](int j, int slot, int X, int Y, int jx, int jy, float ta, float tb) {
    const float gap = size / 8.0f, cx0 = ((float)(X - jx) - r[j / N].tx[j % N]) * size, cy0 = ((float)(Y - jy) - r[j / N].ty[j % N]) * size;
    const float z0 = (float)(gz + r[j / N].z0[j % N]);
    const float x = (r[j / N].ox[j % N] - cx0) / gap, y = (r[j / N].oy[j % N] - cy0) / gap, xd = r[j / N].dx[j % N] / gap, yd = r[j / N].dy[j % N] / gap;
    int ix = down(x + xd * ta), iy = down(y + yd * ta);
    ix = ix < jx * 8 ? jx * 8 : ix > jx * 8 + 7 ? jx * 8 + 7 : ix;
    iy = iy < jy * 8 ? jy * 8 : iy > jy * 8 + 7 ? jy * 8 + 7 : iy;
    const bool flat_x = __builtin_fabsf(xd) < 1e-12f, flat_y = __builtin_fabsf(yd) < 1e-12f;
    const float mx = flat_x ? 0.0f : 1.0f / xd, my = flat_y ? 0.0f : 1.0f / yd;
    const float cx = flat_x ? FAR : -x / xd, cy = flat_y ? FAR : -y / yd;
    const float* ground = scene.ground.data + (size_t)slot * 65 * 65;
    const float* straw = scene.straw.data + (size_t)slot * 65 * 65;
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
      const float above = r[j / N].oz[j % N] + r[j / N].dz[j % N] * t - (h00 + hu * u + hv * v + huv * u * v);
      const float rate = r[j / N].dz[j % N] - (hu + huv * v) * xd - (hv + huv * u) * yd, bend = -huv * xd * yd;
      float s = FAR;
      if (above <= 0.0f) {
        if (rate < 0.0f) s = 0.0f;
      } else {
        const float disc = rate * rate - 4.0f * bend * above;
        if (disc >= 0.0f) {
          if (rate >= 0.0f) { if (bend < 0.0f) s = -0.5f * (rate + __builtin_sqrtf(disc)) / bend; }
          else s = 2.0f * above / (-rate + __builtin_sqrtf(disc));
          if (s > upper(leave - t, 0.0f)) s = FAR;
        }
      }
      if (s < FAR && t + s <= r[j / N].t[j % N]) {
        u += xd * s;
        v += yd * s;
        const float nx = -(hu + huv * v) / gap, ny = -(hv + huv * u) / gap;
        const float depth = (s00 * (1.0f - u) + s10 * u) * (1.0f - v) + (s01 * (1.0f - u) + s11 * u) * v;
        r[j / N].t[j % N] = t + s;
        r[j / N].what[j % N] = depth > 0.005f ? 2 : 1;
        r[j / N].cosine[j % N] = __builtin_fabsf(nx * r[j / N].dx[j % N] + ny * r[j / N].dy[j % N] + r[j / N].dz[j % N]) / __builtin_sqrtf(nx * nx + ny * ny + 1.0f);
        r[j / N].albedo[j % N] = scene.reflectance.data[r[j / N].what[j % N]];
        return;
      }
      if (leave >= tb) return;
      t = upper(leave, t);
      if (tx <= ty) {
        ix += xd > 0.0f ? 1 : -1;
        if (ix < jx * 8 || ix > jx * 8 + 7) return;
      } else {
        iy += yd > 0.0f ? 1 : -1;
        if (iy < jy * 8 || iy > jy * 8 + 7) return;
      }
    }
  };
  auto code_at = [&](int x, int y) {  // cut code of a cell of the stand frame
    const int i = per(x, 512), j = per(y, 512), slot = page_at(i, j);
    if (slot < 0) return STANDING;
    const int row = scene.cut_slot.data[slot];
    if (row < 0) return -1 - row;
    return (int)scene.cut.data[((size_t)row * 512 + (y - j * 512)) * 512 + (x - i * 512)];
  };

  // ---- 4. One tile: X, Y counted from the group's
  auto visit = [&](int X, int Y) {
    const int page_x = per(gx + X, 8), page_y = per(gy + Y, 8), slot = page_at(page_x, page_y);
    const int jx = gx + X - page_x * 8, jy = gy + Y - page_y * 8, place = slot * 64 + jy * 8 + jx;
    const int B_ = A ? X : Y;
    float plane[3] = {0, 0, 0}, stand[4] = {1, 0, 0, 0}, top = 0.0f, bump = 0.0f, crest = FAR, dip = 0.0f;
    if (slot >= 0) {
      for (int i = 0; i < 3; ++i) plane[i] = scene.tile_plane.data[place][i];
      for (int i = 0; i < 4; ++i) stand[i] = scene.tile_stand.data[place][i];
      top = scene.tile_top.data[place] + 0.005f;
      bump = scene.tile_bump.data[place] + 0.001f;
      crest = (float)(plane[0] - gz) + 0.5f * size * (__builtin_fabsf(plane[1]) + __builtin_fabsf(plane[2])) +
              upper(top, bump) + ROUND;
    }
    int act[PACKS], acts = 0;
    for (int p = 0; p < packs; ++p)
      if (k.row_t0[p] <= k.row_t1[p] && k.row_b0[p] < (B_ + 1) * size && k.row_b1[p] > B_ * size && k.row_z0[p] <= crest)
        act[acts++] = p;
    if (acts == 0) return;
    if (slot >= 0 && scene.sways != 0) {
      auto wave = [&](const wp::vec_t<3, wp::float64>& q) {
        double cycles = q[0] * (double)(gx + X) + q[1] * (double)(gy + Y) + q[2];
        cycles = cycles - __builtin_floor(cycles);
        return (float)wp::sin(cycles * 6.283185307179586);
      };
      const float slope = scene.slopes[0] + scene.slopes[1] * wave(scene.wave) + scene.slopes[2] * wave(scene.gust);
      const float aside = slope * stand[0];
      stand[1] += aside * scene.toward[0];
      stand[2] += aside * scene.toward[1];
    }
    if (slot >= 0) {  // how deep the ground lies under the tile's plane
      const float* ground = scene.ground.data + (size_t)slot * 65 * 65 + jy * 8 * 65 + jx * 8;
      for (int j = 0; j < 9; ++j)
        for (int i = 0; i < 9; ++i)
          dip = lower(dip, ground[j * 65 + i] - plane[0] - plane[1] * (i / 8.0f - 0.5f) * size - plane[2] * (j / 8.0f - 0.5f) * size);
      dip -= 0.002f;
    }
    const int prototype = slot >= 0 ? scene.tile_prototype.data[place] : 0;
    const bool mirror_x = prototype & (1 << 16), mirror_y = prototype & (1 << 17);
    const float squeeze = 1.0f / stand[0];
    const bool has_crop = slot >= 0 && top > 0.005f;
    const float fx = (float)X, fy = (float)Y;
    int walkers[PACKS], walking = 0;
    for (int n = 0; n < acts; ++n) {
      const int p = act[n];
      unsigned any = 0, touches = 0;
      for (int v = 0; v < slices; ++v) {
        Block& k_ = r[p * slices + v];
        F kx = fx - load(k_.tx), ky = fy - load(k_.ty);
        F dx = load(k_.dx), dy = load(k_.dy), dz = load(k_.dz), ox = load(k_.ox), oy = load(k_.oy);
        F ivx = load(k_.ivx), ivy = load(k_.ivy), ofx = load(k_.ofx), ofy = load(k_.ofy), now = load(k_.t), best = least(now, put(k.until[p]));
        I right = dx > 0.0f, left = dy > 0.0f;
        F tnx = (right ? kx : kx + 1.0f) * size * ivx + ofx, tfx = (right ? kx + 1.0f : kx) * size * ivx + ofx;
        F tny = (left ? ky : ky + 1.0f) * size * ivy + ofy, tfy = (left ? ky + 1.0f : ky) * size * ivy + ofy;
        I flat_x = size_of(dx) < 1e-12f, flat_y = size_of(dy) < 1e-12f;
        I in_x = (ox >= kx * size) & (ox < (kx + 1.0f) * size), in_y = (oy >= ky * size) & (oy < (ky + 1.0f) * size);
        tnx = flat_x ? (in_x ? put(-FAR) : put(FAR)) : tnx;
        tny = flat_y ? (in_y ? put(-FAR) : put(FAR)) : tny;
        F t0 = most(most(tnx, tny), F{}), t1 = least(tfx, tfy);
        I live = (t0 <= t1) & (t0 < best);
        store(k_.tin, t0);
        if (slot < 0) {  // lost: nothing is known from here on
          store(k_.t, live ? t0 : now);
          storei(k_.what, live ? I{} : loadi(k_.what));
          continue;
        }
        F h1 = dz - plane[1] * dx - plane[2] * dy;
        F base = put((float)(plane[0] - gz)) - load(k_.z0);
        F h0 = load(k_.oz) - base - plane[1] * (ox - (kx + 0.5f) * size) - plane[2] * (oy - (ky + 0.5f) * size);
        F lowest = least(h0 + h1 * t0, h0 + h1 * least(t1, best));
        store(k_.tout, t1);
        touches |= bits(live & (lowest <= bump)) ? 1u << v : 0u;
        F ta = t0, tb = least(t1, best);
        F through = (top - h0) / h1, under = (dip - h0) / h1;
        I falls = h1 < 0.0f, climbs = h1 > 0.0f;
        ta = falls ? most(ta, through) : climbs ? most(ta, under) : ta;
        tb = climbs ? least(tb, through) : falls ? least(tb, under) : tb;
        live &= (lowest <= top) & (ta <= tb);
        if (!has_crop) live = I{};
        // into the prototype: as `to_prototype` in kernel/crop.py
        F zd = h1 * squeeze, z = (h0 + h1 * ta) * squeeze;
        F xd = dx - stand[1] * zd, yd = dy - stand[2] * zd;
        F x = ox - kx * size + dx * ta - stand[1] * z, y = oy - ky * size + dy * ta - stand[2] * z;
        if (mirror_x) { x = size - x; xd = -xd; }
        if (mirror_y) { y = size - y; yd = -yd; }
        F stretch = root(xd * xd + yd * yd + zd * zd), shrink = 1.0f / stretch;
        F end = (tb - ta) * stretch;
        live &= end < 200.0f * size;
        any |= bits(live);
        store(k_.p[0], x);
        store(k_.p[1], y);
        store(k_.p[2], z);
        store(k_.q[0], xd * shrink);
        store(k_.q[1], yd * shrink);
        store(k_.q[2], zd * shrink);
        store(k_.start, ta);
        store(k_.shrink, shrink);
        store(k_.low, (t0 - ta) * stretch);
        store(k_.end, end);
        store(k_.limit, live ? (least(t1, best) - ta) * stretch : put(-FAR));
        storei(k_.is_open, t0 <= 0.0f);
        storei(k_.prim, puti(-1));
      }
      k.ground[p] = touches;
      if (any) walkers[walking++] = p;
    }
    if (slot < 0) {
      for (int n = 0; n < acts; ++n) look(act[n]);
      return;
    }
    if (walking) {
      const int cut_row = scene.cut_slot.data[slot];
      // 4a. From the prototype into the group's frame: depth, u, v = m x + shift
      float m[3][3], shift[3], reach_w = -FAR, gu0 = FAR, gu1 = -FAR, gv0 = FAR, gv1 = -FAR;
      {
        const float flip[2] = {mirror_x ? -1.0f : 1.0f, mirror_y ? -1.0f : 1.0f};
        const float cx = mirror_x ? size : 0.0f, cy = mirror_y ? size : 0.0f;
        const float corner[3] = {fx * size + cx - apex[0], fy * size + cy - apex[1],
                                 (float)(plane[0] - gz) + plane[1] * (cx - 0.5f * size) + plane[2] * (cy - 0.5f * size) - apex[2]};
        const float* frame[3] = {e0, e1, e2};
        for (int i = 0; i < 3; ++i) {
          const float* e = frame[i];
          m[i][0] = flip[0] * (e[0] + e[2] * plane[1]);
          m[i][1] = flip[1] * (e[1] + e[2] * plane[2]);
          m[i][2] = e[0] * stand[1] + e[1] * stand[2] + e[2] * (plane[1] * stand[1] + plane[2] * stand[2] + stand[0]);
          shift[i] = e[0] * corner[0] + e[1] * corner[1] + e[2] * corner[2];
        }
      }
      auto dot3 = [](const float* a, const float* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
      const float m11 = dot3(m[1], m[1]), m22 = dot3(m[2], m[2]), m12 = dot3(m[1], m[2]);
      const float swell = 1.0001f * __builtin_sqrtf(0.5f * (m11 + m22) + __builtin_sqrtf(0.25f * (m11 - m22) * (m11 - m22) + m12 * m12));
      const float deep = 1.0001f * __builtin_sqrtf(dot3(m[0], m[0]));
      // 4a'. Where cells of the tile are cut: how high what is left can reach, for each column, by the highest code of
      // the columns around it in which its stems may stand; beyond the page all may stand
      float live[AROUND][AROUND];  // [m] in the prototype
      bool trims = false;
      if (cut_row >= 0 && index.columns == 8 && index.skirt <= 4) {
        const unsigned char* codes = scene.cut.data + (size_t)cut_row * 512 * 512;
        auto bytes = [](const unsigned char* p) -> U { U v; __builtin_memcpy(&v, p, 64); return v; };
        auto larger = [](auto a, auto b) { return __builtin_elementwise_max(a, b); };
        U least_code = bytes(codes + (size_t)(jy * 64) * 512 + jx * 64);
        for (int y = 1; y < 64; ++y)
          least_code = __builtin_elementwise_min(least_code, bytes(codes + (size_t)(jy * 64 + y) * 512 + jx * 64));
        trims = __builtin_reduce_min(least_code) != STANDING;
        if (trims) {
          const int from_x = jx * 8 - 4 < 0 ? 0 : jx * 8 - 4 > 48 ? 48 : jx * 8 - 4;  // first of 16 columns of the page
          const int shift_x = from_x - (jx * 8 - 4), side = 2 * index.skirt + 1, begin = 4 - index.skirt;
          unsigned char block[16][48], wide_of[16][16];
          __builtin_memset(block, STANDING, sizeof block);
          for (int y = 0; y < 16; ++y) {
            const int row = jy * 8 - 4 + y;
            if (row < 0 || row > 63) continue;
            const unsigned char* at_row = codes + (size_t)(row * 8) * 512 + from_x * 8;
            for (int half = 0; half < 2; ++half) {
              U m = bytes(at_row + half * 64);
              for (int v = 1; v < 8; ++v) m = larger(m, bytes(at_row + v * 512 + half * 64));
              for (int bit = 32; bit >= 8; bit /= 2) {
                W8 q;
                __builtin_memcpy(&q, &m, 64);
                q >>= bit;
                U moved;
                __builtin_memcpy(&moved, &q, 64);
                m = larger(m, moved);
              }
              for (int x = 0; x < 8; ++x) block[y][16 + shift_x + half * 8 + x] = m[8 * x];
            }
          }
          for (int y = 0; y < 16; ++y) {
            B16 m;
            __builtin_memcpy(&m, &block[y][16 + begin], 16);
            for (int i = 1; i < side; ++i) {
              B16 next;
              __builtin_memcpy(&next, &block[y][16 + begin + i], 16);
              m = larger(m, next);
            }
            __builtin_memcpy(wide_of[y], &m, 16);
          }
          for (int y = 0; y < 8; ++y)
            for (int x = 0; x < 8; ++x) {
              int code = 0;
              for (int i = 0; i < side; ++i) code = wide_of[y + begin + i][x] > code ? wide_of[y + begin + i][x] : code;
              live[mirror_y ? 7 - y : y][mirror_x ? 7 - x : x] =
                  code == STANDING ? FAR : code == 0 ? -FAR : 0.01f * (float)code * squeeze + 0.02f;
            }
        }
      }
      auto live_top = [&](int x, int y) {  // of a column of the unwrapped prototype
        if (!trims || x < 0 || y < 0 || x >= index.columns || y >= index.columns) return FAR;
        return live[y][x];
      };
      // 4b. The walk's axis, and each pack's way as linear bounds along it
      float lead_q[3] = {0, 0, 0};
      for (int l = 0; l < width; ++l) {
        const int j = walkers[0] * width + l;
        if (r[j / N].limit[j % N] >= 0.0f) { lead_q[0] = r[j / N].q[0][j % N]; lead_q[1] = r[j / N].q[1][j % N]; lead_q[2] = r[j / N].q[2][j % N]; break; }
      }
      for (int i = 0; i < 3; ++i) lead_q[i] = __builtin_fabsf(lead_q[i]);
      const int axis = lead_q[2] > upper(lead_q[0], lead_q[1]) ? 2 : lead_q[0] >= lead_q[1] ? 0 : 1;
      const int ib = axis == 2 ? 1 : 1 - axis, ic = axis == 2 ? 0 : 2;
      const float cell[3] = {index.side, index.side, index.bin_height};
      const float wide[3] = {index.reach[0] + ROUND, index.reach[1] + ROUND, index.reach[2] + ROUND};
      const float room = wide[axis] + cell[axis];
      float way0 = FAR, way1 = -FAR;
      int sense = 0;
      for (int b = 0; b < count16; ++b) c.reach[b] = -FAR;
      for (int n = 0; n < walking; ++n) {
        const int p = walkers[n];
        int forth = 0, back = 0;
        F a0 = put(FAR), a1 = put(-FAR), slowest = put(FAR), w_far = put(-FAR);
        for (int v = 0; v < slices; ++v) {
          Block& k_ = r[p * slices + v];
          F limit = load(k_.limit), x = load(k_.p[axis]), q = load(k_.q[axis]);
          I live = limit >= 0.0f;
          F y = x + q * load(k_.end);
          a0 = live ? least(a0, least(x, y)) : a0;
          a1 = live ? most(a1, most(x, y)) : a1;
          slowest = live ? least(slowest, size_of(q)) : slowest;
          forth += __builtin_popcount(bits(live & (q > 0.0f)));
          back += __builtin_popcount(bits(live & (q <= 0.0f)));
          F w = load(k_.w0) + load(k_.w1) * (load(k_.start) + limit * load(k_.shrink));
          w = live ? w + ROUND : put(-FAR);
          w_far = most(w_far, w);
          store(spot[p * slices + v].deep, w);
          const int b = p * slices + v;
          c.reach[b] = highest_of(w);
          gu0 = lower(gu0, c.cu[b] - c.ru[b]);
          gu1 = upper(gu1, c.cu[b] + c.ru[b]);
          gv0 = lower(gv0, c.cv[b] - c.rv[b]);
          gv1 = upper(gv1, c.cv[b] + c.rv[b]);
        }
        way.a0[n] = lowest_of(a0);
        way.a1[n] = highest_of(a1);
        way.reach[n] = highest_of(w_far);
        way.until[n] = k.until[p];
        sense += forth - back;
        const bool straight = lowest_of(slowest) > 0.05f && (forth == 0 || back == 0);
        const float plane0 = way.a0[n] - room, plane1 = way.a1[n] + room;
        float edge[2][5];
        way.from[n] = plane0;
        for (int side = 0; side < 2; ++side) {
          F b0 = put(FAR), b1 = put(-FAR), c0 = put(FAR), c1 = put(-FAR), w0 = put(FAR);
          for (int v = 0; v < slices; ++v) {
            Block& k_ = r[p * slices + v];
            I live = load(k_.limit) >= 0.0f;
            for (int turn = 0; turn < (straight ? 1 : 2); ++turn) {
              F s = straight ? ((side ? plane1 : plane0) - load(k_.p[axis])) / load(k_.q[axis]) : turn ? load(k_.end) : F{};
              F b = load(k_.p[ib]) + s * load(k_.q[ib]), c = load(k_.p[ic]) + s * load(k_.q[ic]);
              F w = load(k_.w0) + load(k_.w1) * (load(k_.start) + s * load(k_.shrink));
              b0 = live ? least(b0, b) : b0;
              b1 = live ? most(b1, b) : b1;
              c0 = live ? least(c0, c) : c0;
              c1 = live ? most(c1, c) : c1;
              w0 = live ? least(w0, w) : w0;
            }
          }
          float* e = edge[side];
          e[0] = lowest_of(b0) - wide[ib];
          e[1] = highest_of(b1) + wide[ib];
          e[2] = lowest_of(c0) - wide[ic];
          e[3] = highest_of(c1) + wide[ic];
          e[4] = lowest_of(w0) - ROUND;
        }
        for (int i = 0; i < 5; ++i) {
          way.bound[i][n] = edge[0][i];
          way.rise[i][n] = (edge[1][i] - edge[0][i]) / (plane1 - plane0);
        }
        way0 = lower(way0, way.a0[n]);
        way1 = upper(way1, way.a1[n]);
        reach_w = upper(reach_w, way.reach[n]);
      }
      const float slant = upper(gu1 * gu1, gu0 * gu0) + upper(gv1 * gv1, gv0 * gv0);
      const float fat = 1.01f * __builtin_sqrtf(1.0f + slant);
      const int kind = (prototype & 0xffff) * index.columns * index.columns;
      const int rank_max = stand[3] >= 1.0f ? 32767 : (int)(stand[3] * 32767.0f) + 1;
      int waiting = 0;
      unsigned char touched[SLICES] = {};
      int fresh[SLICES + ROOM / N], news = 0, walker_of[PACKS];
      for (int n = 0; n < walking; ++n) walker_of[walkers[n]] = n;

      // 4c. One piece against one pack: the exact test of the whole primitive, lane by lane
      auto test = [&](int at_block, int n, const float* a, const float* b, const float* w, float radius, float z_top) {
        const float u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, uu = dot3(u, u), rr = radius * radius;
        const int id = kept.prim[n];
        Block& k_ = r[at_block];
        F dx = load(k_.q[0]), dy = load(k_.q[1]), dz = load(k_.q[2]);
        F x = load(k_.p[0]), y = load(k_.p[1]), z = load(k_.p[2]), t, limit;
        I hit;
        if (radius > 0.0f) {
          F mx = a[0] - x, my = a[1] - y, mz = a[2] - z;
          F nx = dy * u[2] - dz * u[1], ny = dz * u[0] - dx * u[2], nz = dx * u[1] - dy * u[0];
          F nn = nx * nx + ny * ny + nz * nz, gap = mx * nx + my * ny + mz * nz, h = rr * nn - gap * gap;
          hit = h >= 0.0f;
          if (!bits(hit)) return 0u;
          limit = load(k_.limit);
          F du = dx * u[0] + dy * u[1] + dz * u[2], mu = mx * u[0] + my * u[1] + mz * u[2];
          F kx = my * u[2] - mz * u[1], ky = mz * u[0] - mx * u[2], kz = mx * u[1] - my * u[0];
          I side = nn > 1.0e-10f * uu;
          t = (kx * nx + ky * ny + kz * nz - root(h * uu)) / nn;
          F s = t * du - mu;
          I at_a = side ? s < 0.0f : du > 0.0f, at_b = side ? s > uu : du <= 0.0f;
          if (bits(hit & (at_a | at_b))) {  // the round ends
            F sx = at_b ? mx + u[0] : mx, sy = at_b ? my + u[1] : my, sz = at_b ? mz + u[2] : mz;
            F along = sx * dx + sy * dy + sz * dz;
            F ox = sx - along * dx, oy = sy - along * dy, oz = sz - along * dz, rest = rr - (ox * ox + oy * oy + oz * oz);
            F ball = rest < 0.0f ? put(FAR) : along - root(rest);
            t = at_a | at_b ? ball : t;
          }
          F low = load(k_.low);
          I early = hit & (t < low) & (limit >= 0.0f);
          if (bits(early)) {  // a tile's side cuts through what stands on it
            F ex = low * dx - mx, ey = low * dy - my, ez = low * dz - mz;
            F f = (ex * u[0] + ey * u[1] + ez * u[2]) / upper(uu, 1.0e-20f);
            f = least(most(f, F{}), put(1.0f));
            F gx_ = ex - f * u[0], gy_ = ey - f * u[1], gz_ = ez - f * u[2];
            I out = (loadi(k_.is_open) != 0) | (gx_ * gx_ + gy_ * gy_ + gz_ * gz_ > rr);
            t = early ? (out ? put(FAR) : low) : t;
          }
        } else {
          F mx = x - a[0], my = y - a[1], mz = z - a[2];
          F px = dy * w[2] - dz * w[1], py = dz * w[0] - dx * w[2], pz = dx * w[1] - dy * w[0];
          F det = u[0] * px + u[1] * py + u[2] * pz, s = mx * px + my * py + mz * pz;
          I turned = det < 0.0f;
          s = turned ? -s : s;
          F adet = size_of(det);
          hit = (s >= 0.0f) & (s <= adet) & (adet >= 1.0e-20f);
          F qx = my * u[2] - mz * u[1], qy = mz * u[0] - mx * u[2], qz = mx * u[1] - my * u[0];
          hit &= size_of(dx * qx + dy * qy + dz * qz) <= adet + radius * s;  // radius -1: a triangle, pointed at b
          if (!bits(hit)) return 0u;
          t = (w[0] * qx + w[1] * qy + w[2] * qz) / det;
          limit = load(k_.limit);
          hit &= (t >= load(k_.low)) & (z + t * dz <= z_top);
        }
        I prim = loadi(k_.prim);
        hit &= (t < limit) | ((t == limit) & (prim >= 0) & (id < (prim & (CUT - 1))));
        if (!bits(hit)) return 0u;
        store(k_.limit, hit ? t : limit);
        storei(k_.prim, hit ? puti(z_top < FAR ? id | CUT : id) : prim);
        storei(k_.image, hit ? puti(kept.image[n]) : loadi(k_.image));
        return 1u;
      };
      auto foot_code = [&](const float* row, int kx, int ky) {  // as in kernel/crop.py
        float x = row[12] + kx * size, y = row[13] + ky * size;
        if (mirror_x) x = size - x;
        if (mirror_y) y = size - y;
        const float fine = 64.0f / size;
        const int cx = jx * 64 + down(x * fine), cy = jy * 64 + down(y * fine);
        if (cx < 0 || cy < 0 || cx > 511 || cy > 511) return code_at(page_x * 512 + cx, page_y * 512 + cy);
        return cut_row < 0 ? -1 - cut_row : (int)scene.cut.data[((size_t)cut_row * 512 + cy) * 512 + cx];
      };
      auto cut_back = [&](float* a, float* b, float z_top) {
        float *high = b[2] > z_top ? b : a, *low = b[2] > z_top ? a : b;
        if (high[2] <= z_top) return;
        const float f = (z_top - low[2]) / (high[2] - low[2]);
        for (int i = 0; i < 3; ++i) high[i] = low[i] + f * (high[i] - low[i]);
      };

      auto settle = [&](int pairs) {
        for (int i = 0; i < pairs;) {
          const int n = pair[i].piece, ky = (short)(kept.image[n] & 0xffff), kx = (kept.image[n] - ky) / 65536;
          const float* row = (const float*)scene.prims.data + (size_t)kept.prim[n] * 16;
          int next = i + 1;
          while (next < pairs && pair[next].piece == n) ++next;
          const int first = i;
          i = next;
          if (!(row[7] < stand[3])) continue;
          const int code = foot_code(row, kx, ky);
          const float z_top = code == STANDING ? FAR : 0.01f * (float)code * squeeze;
          if (code == 0 || (row[3] >= 0.0f && lower(row[2], row[6]) > z_top)) continue;
          float a[3] = {row[0], row[1], row[2]}, b[3] = {row[4], row[5], row[6]};
          if (row[3] > 0.0f && code != STANDING) cut_back(a, b, z_top);
          const float mx = kx * size, my = ky * size;
          a[0] += mx; b[0] += mx; a[1] += my; b[1] += my;
          for (int s = first; s < next; ++s) if (test(pair[s].slice, n, a, b, row + 8, row[3], z_top) && !touched[pair[s].slice]) {
            touched[pair[s].slice] = 1;
            fresh[news++] = pair[s].slice;
          }
        }
      };
      static_assert(SLICES / N <= N, "one vector holds the boxes of all blocks");
      alignas(64) float box[4][N];  // of N slices that are looked at together, one lane each: least u, most u, v, v
      for (int b = 0; b < SLICES; b += N) {
        float u0 = 4.0f * FAR, u1 = -u0, v0 = u0, v1 = -u0;  // beyond what any piece may touch
        for (int i = b; i < b + N && b < count; ++i) {
          if (c.reach[i] <= -FAR) continue;
          u0 = lower(u0, c.cu[i] - c.ru[i]);
          u1 = upper(u1, c.cu[i] + c.ru[i]);
          v0 = lower(v0, c.cv[i] - c.rv[i]);
          v1 = upper(v1, c.cv[i] + c.rv[i]);
        }
        box[0][b / N] = u0; box[1][b / N] = u1; box[2][b / N] = v0; box[3][b / N] = v1;
      }
      for (int b = SLICES / N; b < N; ++b) { box[0][b] = box[2][b] = 4.0f * FAR; box[1][b] = box[3][b] = -4.0f * FAR; }
      const F box_u0 = load(box[0]), box_u1 = load(box[1]), box_v0 = load(box[2]), box_v1 = load(box[3]);

      // 4d. The pieces that wait: against all slices at once, then against the lanes of those that they may touch;
      // what is left is tested
      auto narrow_down = [&](int asked) {  // of the slices that a piece may touch, those of which it may touch a lane
#pragma clang fp contract(fast)
        int pairs = 0;
        for (int q = 0; q < asked; ++q) {
          const int n = asked_piece[q], i = asked_slice[q];
          const float tu = kept.tu[n], tv = kept.tv[n], inv = kept.inv[n], wide = kept.wide[n];
          const Spot& s = spot[i];
          F lu = load(s.u) + load(s.ou) * inv - kept.u[n], lv = load(s.v) + load(s.ov) * inv - kept.v[n];
          I may = (size_of(lv * tu - lu * tv) <= wide) & (size_of(lu * tu + lv * tv) <= wide + kept.h[n]) &
                  (load(s.deep) >= kept.near[n]);
          pair[pairs] = {n, i};  // no branch: whether it stays is hard to foretell
          pairs += bits(may) != 0;
        }
        for (int q = 0; q < pairs; ++q) __builtin_prefetch((const float*)scene.prims.data + (size_t)kept.prim[pair[q].piece] * 16);
        return pairs;
      };
      auto flush = [&]() {
        int asked = 0;
        for (int n = 0; n < waiting; ++n) {
#pragma clang fp contract(fast)
          const float tu = kept.tu[n], tv = kept.tv[n], h = kept.h[n], inv = kept.inv[n], wide = kept.wide[n];
          const float u = kept.u[n], v = kept.v[n], su = __builtin_fabsf(tu), sv = __builtin_fabsf(tv), swing = sway_u * inv;
          const float out_u = su * h + wide + swing, out_v = sv * h + wide + swing;
          I over = (box_u0 <= u + out_u) & (box_u1 >= u - out_u) & (box_v0 <= v + out_v) & (box_v1 >= v - out_v);
          for (unsigned blocks = bits(over); blocks; blocks &= blocks - 1) {
            const int b = __builtin_ctz(blocks) * N;
            F du = load(c.cu + b) + load(c.ou + b) * inv - u, dv = load(c.cv + b) + load(c.ov + b) * inv - v;
            F bu = load(c.ru + b) + load(c.pu + b) * inv, bv = load(c.rv + b) + load(c.pv + b) * inv;
            F disc = load(c.disc + b) + load(c.pdisc + b) * inv;
            I meets = (size_of(dv * tu - du * tv) <= wide + least(bu * sv + bv * su, disc)) &
                      (size_of(du * tu + dv * tv) <= wide + h + least(bu * su + bv * sv, disc)) & (load(c.reach + b) >= kept.near[n]);
            const unsigned found = bits(meets);
            keep_ints(asked_slice + asked, every + b, meets, found);
            storei(asked_piece + asked, puti(n));
            asked += __builtin_popcount(found);
          }
          if (asked > PAIRS - SLICES) {
            settle(narrow_down(asked));
            asked = 0;
          }
        }
        settle(narrow_down(asked));
        waiting = 0;
        if (need > 0) {  // a new hit may bring the end nearer for all of its pack
          for (int i = 0; i < news; ++i) touched[fresh[i]] = 0;
          const int known = news;
          for (int i = 0; i < known; ++i) {
            const int p = fresh[i] / slices;
            if (touched[p * slices]) continue;
            way.until[walker_of[p]] = lower(k.until[p], enough(p,
                [&](Block& b) { return loadi(b.prim) >= 0 ? load(b.start) + load(b.limit) * load(b.shrink) : load(b.t); },
                [&](Block& b) { return (loadi(b.prim) >= 0) | (loadi(b.what) != 0); }));
            for (int b = p * slices; b < (p + 1) * slices; ++b) {
              if (b != fresh[i]) fresh[news++] = b;
              touched[b] = 1;
            }
          }
        }
        for (int i = 0; i < news; ++i) {
          const int b = fresh[i], p = b / slices;
          touched[b] = 0;
          Block& k_ = r[b];
          F limit = load(k_.limit);
          F w = load(k_.w0) + load(k_.w1) * least(load(k_.start) + limit * load(k_.shrink), put(way.until[walker_of[p]]));
          w = limit >= 0.0f ? w + ROUND : put(-FAR);
          store(spot[b].deep, w);
          c.reach[b] = highest_of(w);
          float reach = -FAR;
          for (int q = p * slices; q < (p + 1) * slices; ++q) reach = upper(reach, c.reach[q]);
          way.reach[walker_of[p]] = reach;
        }
        news = 0;
      };

      // 4e. A run of pieces into the group's slopes; those outside the box of the group are dropped
      int image_x = 0, image_y = 0;
      float off[3] = {shift[0], shift[1], shift[2]};
      const float gcu = 0.5f * (gu0 + gu1), gru = 0.5f * (gu1 - gu0), gcv = 0.5f * (gv0 + gv1), grv = 0.5f * (gv1 - gv0);
      const short* coarse = index.coarse.data;
      float n[3][3];  // m for ends in steps
      for (int i = 0; i < 9; ++i) n[i / 3][i % 3] = m[i / 3][i % 3] * index.step;
      const float deep_step = deep * index.step, swell_step = swell * index.step;
      auto soon = [&](int first, int last) {
        for (int e = first; e < last && e < first + 16; e += 4) __builtin_prefetch(coarse + (size_t)e * 8);
        if (first < last) __builtin_prefetch(index.primitive.data + first);
      };
      struct { int first, last, kx, ky; } run = {0, 0, 0, 0};  // the one before the last that was asked for
      auto gather = [&](int first, int last, int kx, int ky) {
#pragma clang fp contract(fast)
        if (kx != image_x || ky != image_y) {
          image_x = kx;
          image_y = ky;
          for (int i = 0; i < 3; ++i) off[i] = shift[i] + (m[i][0] * kx + m[i][1] * ky) * size;
        }
        auto number = [](S4 a, S4 b, int i) {  // the i-th field of two halves
          S s;
          __builtin_memcpy(&s, (const short*)&a + 8 * i, 16);
          __builtin_memcpy((short*)&s + 8, (const short*)&b + 8 * i, 16);
          return __builtin_convertvector(s, F);
        };
                for (int e = first; e < last; e += N) {
          S4 raw[4];  // 16 entries of 8 numbers; turned into 8 slices
          __builtin_memcpy(raw, coarse + (size_t)e * 8, 256);
          S4 head0 = __builtin_shufflevector(raw[0], raw[1], 0, 8, 16, 24, 32, 40, 48, 56, 1, 9, 17, 25, 33, 41, 49, 57, 2, 10, 18, 26, 34, 42, 50, 58, 3, 11, 19, 27, 35, 43, 51, 59);
          S4 head1 = __builtin_shufflevector(raw[2], raw[3], 0, 8, 16, 24, 32, 40, 48, 56, 1, 9, 17, 25, 33, 41, 49, 57, 2, 10, 18, 26, 34, 42, 50, 58, 3, 11, 19, 27, 35, 43, 51, 59);
          S4 tail0 = __builtin_shufflevector(raw[0], raw[1], 4, 12, 20, 28, 36, 44, 52, 60, 5, 13, 21, 29, 37, 45, 53, 61, 6, 14, 22, 30, 38, 46, 54, 62, 7, 15, 23, 31, 39, 47, 55, 63);
          S4 tail1 = __builtin_shufflevector(raw[2], raw[3], 4, 12, 20, 28, 36, 44, 52, 60, 5, 13, 21, 29, 37, 45, 53, 61, 6, 14, 22, 30, 38, 46, 54, 62, 7, 15, 23, 31, 39, 47, 55, 63);
          F ax = number(head0, head1, 0), ay = number(head0, head1, 1), az = number(head0, head1, 2), bx = number(head0, head1, 3);
          F by = number(tail0, tail1, 0), bz = number(tail0, tail1, 1), thick = number(tail0, tail1, 2), rank = number(tail0, tail1, 3);
          F wa = n[0][0] * ax + n[0][1] * ay + n[0][2] * az + off[0], wb = n[0][0] * bx + n[0][1] * by + n[0][2] * bz + off[0];
          F ua = n[1][0] * ax + n[1][1] * ay + n[1][2] * az + off[1], ub = n[1][0] * bx + n[1][1] * by + n[1][2] * bz + off[1];
          F va = n[2][0] * ax + n[2][1] * ay + n[2][2] * az + off[2], vb = n[2][0] * bx + n[2][1] * by + n[2][2] * bz + off[2];
          F near = least(wa, wb) - thick * deep_step - ROUND;
          F ia = 1.0f / wa, ib_ = 1.0f / wb, nearer = most(ia, ib_), thin = (thick * deep_step + ROUND) * nearer;
          I inside = every < last - e, close = (near < 0.05f) | (thin > 0.25f);
          F inv = 0.5f * (ia + ib_), most_inv = nearer * (1.0f + 1.34f * thin);  // at least 1 / near
          ua *= ia; va *= ia; ub *= ib_; vb *= ib_;
          F u = 0.5f * (ua + ub), v = 0.5f * (va + vb), hu = 0.5f * (ub - ua), hv = 0.5f * (vb - va);
          F broad = (thick * swell_step + ROUND) * most_inv * fat + sway_u * 0.71f * size_of(ia - ib_);
          F reach_u = broad + sway_u * most_inv;
          I keep = (size_of(u - gcu) <= size_of(hu) + reach_u + gru) & (size_of(v - gcv) <= size_of(hv) + reach_u + grv);
          keep = (keep | close) & inside & (near <= reach_w) & (rank <= (float)rank_max);
          const unsigned found = bits(keep);
          F h = root(hu * hu + hv * hv);
          I tiny = h < 1.0e-9f;
          F per_h = 1.0f / h, tu = tiny ? put(1.0f) : hu * per_h, tv = tiny ? F{} : hv * per_h;
          broad = close ? put(FAR) : broad;
          h = close ? F{} : h;
          keep_some(kept.u + waiting, close ? F{} : u, keep, found);
          keep_some(kept.v + waiting, close ? F{} : v, keep, found);
          keep_some(kept.tu + waiting, tu, keep, found);
          keep_some(kept.tv + waiting, tv, keep, found);
          keep_some(kept.h + waiting, h, keep, found);
          keep_some(kept.wide + waiting, broad, keep, found);
          keep_some(kept.near + waiting, near, keep, found);
          keep_some(kept.inv + waiting, close ? F{} : inv, keep, found);
          keep_ints(kept.prim + waiting, loadi(index.primitive.data + e), keep, found);
          keep_ints(kept.image + waiting, puti(kx * 65536 + ky), keep, found);
          waiting += __builtin_popcount(found);
          if (waiting > KEPT - N) flush();
        }
      };

      auto queue = [&](int first, int last, int kx, int ky) {  // gathers the run before: this one is on its way
        soon(first, last);
        if (run.first < run.last) gather(run.first, run.last, run.kx, run.ky);
        run = {first, last, kx, ky};
      };

      // 4f. Slabs of columns, front to back
      const int bins = index.bins, columns = index.columns;
      const float per_bin = 1.0f / index.bin_height;
      auto bin_of = [&](float z) {
        const int i = down(z * per_bin);
        return i < 0 ? 0 : i >= bins ? bins - 1 : i;
      };
      const int first_slab = axis == 2 ? bin_of(way0 - wide[2]) : down((way0 - wide[axis]) / cell[axis]);
      const int last_slab = axis == 2 ? bin_of(way1 + wide[2]) : down((way1 + wide[axis]) / cell[axis]);
      static_assert(SPAN % 2 == 0, "");
      float c_low[SPAN], c_high[SPAN];
      for (int i = 0; i < SPAN; ++i) { c_low[i] = FAR; c_high[i] = -FAR; }
      for (int n = 0; n <= last_slab - first_slab; ++n) {
        const int i = sense >= 0 ? first_slab + n : last_slab - n;
        const float x0 = axis == 2 && i == 0 ? -FAR : i * cell[axis] - wide[axis];
        const float x1 = axis == 2 && i == bins - 1 ? FAR : (i + 1) * cell[axis] + wide[axis];
        int j0 = SPAN, j1 = -1;
        const float per_cell = 1.0f / cell[ib];
        for (int w = 0; w < walking; w += N) {
#pragma clang fp contract(fast)
          F lo = most(put(x0), load(way.a0 + w)), hi = least(put(x1), load(way.a1 + w));
          F f0 = lo - load(way.from + w), f1 = hi - load(way.from + w), found[5];
          for (int q = 0; q < 5; ++q) {
            F x = load(way.bound[q] + w), rise = load(way.rise[q] + w), y0 = x + rise * f0, y1 = x + rise * f1;
            found[q] = q == 1 || q == 3 ? most(y0, y1) + ROUND : least(y0, y1) - ROUND;
          }
          I side0 = __builtin_convertvector(__builtin_elementwise_floor(found[0] * per_cell), I) + SPAN / 2;
          I side1 = __builtin_convertvector(__builtin_elementwise_floor(found[1] * per_cell), I) + SPAN / 2;
          side0 = side0 < 0 ? I{} : side0;
          side1 = side1 >= SPAN ? puti(SPAN - 1) : side1;
                    for (unsigned some = bits((lo <= hi) & (found[4] <= load(way.reach + w)) & (every < walking - w)); some; some &= some - 1) {
            const int l = __builtin_ctz(some), b0 = side0[l], b1 = side1[l];
            const float c0 = found[2][l], c1 = found[3][l];
            for (int j = b0; j <= b1; ++j) {
              c_low[j] = lower(c_low[j], c0);
              c_high[j] = upper(c_high[j], c1);
            }
            j0 = b0 < j0 ? b0 : j0;
            j1 = b1 > j1 ? b1 : j1;
          }
        }
        for (int s = j0; s <= j1; ++s) {
          const float c0 = c_low[s], c1 = c_high[s];
          if (c0 > c1) continue;
          c_low[s] = FAR;
          c_high[s] = -FAR;
          const int j = s - SPAN / 2;
          if (axis == 2) {
            const int ky = per(j, columns), row = (kind + (j - ky * columns) * columns) * bins + i;
            for (int x = down(c0 / cell[0]); x <= down(c1 / cell[0]); ++x) {
              if (i * cell[2] - wide[2] > live_top(x, j)) continue;
              const int kx = per(x, columns), at_cell = row + (x - kx * columns) * bins;
              queue(index.start.data[at_cell], index.start.data[at_cell + 1], kx, ky);
            }
          } else {
            const int x = axis == 0 ? i : j, y = axis == 0 ? j : i, kx = per(x, columns), ky = per(y, columns);
            const int at_cell = (kind + (y - ky * columns) * columns + x - kx * columns) * bins;
            const float tallest = live_top(x, y) + wide[2];
            if (c0 > tallest) continue;
            queue(index.start.data[at_cell + bin_of(c0)], index.start.data[at_cell + bin_of(lower(c1, tallest)) + 1], kx, ky);
          }
        }
        queue(0, 0, 0, 0);
        if (waiting >= FLUSH) flush();
      }
      flush();

      // 4g. What was hit: as the end of `walk_crop` in kernel/crop.py
      int struck[ROOM + N], strikes = 0;
      for (int n = 0; n < walking; ++n)
        for (int b = walkers[n] * slices; b < (walkers[n] + 1) * slices; ++b) {
          I hit = loadi(r[b].prim) >= 0;
          keep_ints(struck + strikes, every + b * N, hit, bits(hit));
          strikes += __builtin_popcount(bits(hit));
        }
      for (int n = 0; n < strikes; ++n) {
        const int j = struck[n], id = r[j / N].prim[j % N];
        const float* row = (const float*)scene.prims.data + (size_t)(id & (CUT - 1)) * 16;
        const int ky = (short)(r[j / N].image[j % N] & 0xffff), kx = (r[j / N].image[j % N] - ky) / 65536;
        float a[3], b[3], nrm[3];
        for (int i = 0; i < 3; ++i) { a[i] = row[i]; b[i] = row[4 + i]; }
        if (row[3] <= 0.0f) {
          const float u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
          nrm[0] = u[1] * row[10] - u[2] * row[9];
          nrm[1] = u[2] * row[8] - u[0] * row[10];
          nrm[2] = u[0] * row[9] - u[1] * row[8];
        } else {
          if (id & CUT) cut_back(a, b, 0.01f * (float)foot_code(row, kx, ky) * squeeze);
          const float s = r[j / N].limit[j % N];
          const float q[3] = {r[j / N].p[0][j % N] + s * r[j / N].q[0][j % N] - a[0] - kx * size, r[j / N].p[1][j % N] + s * r[j / N].q[1][j % N] - a[1] - ky * size, r[j / N].p[2][j % N] + s * r[j / N].q[2][j % N] - a[2]};
          const float u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
          const float f = lower(upper(dot3(q, u) / upper(dot3(u, u), 1.0e-20f), 0.0f), 1.0f);
          for (int i = 0; i < 3; ++i) nrm[i] = q[i] - f * u[i];
        }
        const float x = mirror_x ? -nrm[0] : nrm[0], y = mirror_y ? -nrm[1] : nrm[1];
        const float lift = (nrm[2] - x * stand[1] - y * stand[2]) * squeeze;
        const float gx_ = x - lift * plane[1], gy_ = y - lift * plane[2];
        const float length = upper(__builtin_sqrtf(gx_ * gx_ + gy_ * gy_ + lift * lift), 1.0e-20f);
        int what = (int)row[11];
        const bool is_stub = (id & CUT) && what == 3;
        if (is_stub) what = 6;
        r[j / N].t[j % N] = r[j / N].start[j % N] + r[j / N].limit[j % N] * r[j / N].shrink[j % N];
        r[j / N].what[j % N] = what;
        r[j / N].cosine[j % N] = lower(1.0f, __builtin_fabsf(gx_ * r[j / N].dx[j % N] + gy_ * r[j / N].dy[j % N] + lift * r[j / N].dz[j % N]) / length);
        r[j / N].albedo[j % N] = row[14] > 0.0f && !is_stub ? row[14] : scene.reflectance.data[what];
      }
    }
    for (int n = 0; n < acts; ++n) {
      const int p = act[n];
      if (k.ground[p])
        for (int l = 0; l < width; ++l) {
          const int j = p * width + l;
          if (!(k.ground[p] >> (l / N) & 1) || r[j / N].t[j % N] < 0.0f) continue;
          const float t0 = r[j / N].tin[j % N], t1 = lower(r[j / N].tout[j % N], r[j / N].t[j % N]);
          if (!(t0 <= t1)) continue;
          const float kx = fx - r[j / N].tx[j % N], ky = fy - r[j / N].ty[j % N];
          const float h1 = r[j / N].dz[j % N] - plane[1] * r[j / N].dx[j % N] - plane[2] * r[j / N].dy[j % N];
          const float h0 = r[j / N].oz[j % N] - ((float)(plane[0] - gz) - r[j / N].z0[j % N]) - plane[1] * (r[j / N].ox[j % N] - (kx + 0.5f) * size) -
                           plane[2] * (r[j / N].oy[j % N] - (ky + 0.5f) * size);
          if (lower(h0 + h1 * t0, h0 + h1 * t1) > bump) continue;
          float ta = t0, tb = t1;
          if (h1 < 0.0f) ta = upper(ta, (bump - h0) / h1);
          if (h1 > 0.0f) tb = lower(tb, (bump - h0) / h1);
          hit_ground(j, slot, X, Y, jx, jy, ta, tb);
        }
      look(p);
    }
  };

  // ---- 5. Tiles in rows, front to back, until no pack looks further
  const float along = e0[A];
  const int step = along >= 0.0f ? 1 : -1;
  bool mixed = false;
  for (int p = 0; p < packs; ++p) mixed |= k.da0[p] <= 0.0f && k.da1[p] >= 0.0f || (k.da0[p] > 0.0f) != (along >= 0.0f);
  for (int n = -1;; ++n) {
    bool goes_on = n < 1;
    for (int side = 0; side < (mixed ? 2 : 1); ++side) {
      if (side == 1 && n <= 0) continue;
      const int row = side ? -step * n : step * n;
      const float near = row * size, far = near + size;
      float b0 = FAR, b1 = -FAR;
      for (int p = 0; p < packs; ++p) {
        float t0, t1;
        if (k.da0[p] > 1e-6f) {
          const float x = near - k.oa1[p], y = far - k.oa0[p];
          t0 = x > 0.0f ? x / k.da1[p] : x / k.da0[p];
          t1 = y > 0.0f ? y / k.da0[p] : y / k.da1[p];
        } else if (k.da1[p] < -1e-6f) {
          const float x = k.oa0[p] - far, y = k.oa1[p] - near;
          t0 = x > 0.0f ? x / -k.da0[p] : x / -k.da1[p];
          t1 = y > 0.0f ? y / -k.da1[p] : y / -k.da0[p];
        } else {
          const float away = upper(upper(near - k.oa1[p], k.oa0[p] - far), 0.0f);
          t0 = away / upper(upper(k.da1[p], -k.da0[p]), 1e-6f);
          t1 = FAR;
        }
        t0 = upper(t0 - 1e-4f, 0.0f);
        k.row_t0[p] = FAR;
        k.row_t1[p] = -FAR;
        if (t1 >= 0.0f && t0 <= k.until[p]) goes_on = true;  // this row or a later one is still to come
        t1 = lower(t1 + 1e-4f, k.until[p]);
        if (t0 > t1) continue;
        k.row_t0[p] = t0;
        k.row_t1[p] = t1;
        const float lo = k.ob0[p] + lower(k.db0[p] * t0, k.db0[p] * t1) - ROUND;
        const float hi = k.ob1[p] + upper(k.db1[p] * t0, k.db1[p] * t1) + ROUND;
        k.row_b0[p] = lo;
        k.row_b1[p] = hi;
        k.row_z0[p] = k.oz0[p] + lower(k.dz0[p] * t0, k.dz0[p] * t1) - 1e-4f;
        b0 = lower(b0, lo);
        b1 = upper(b1, hi);
      }
      if (b0 > b1) continue;
      const int first = down(b0 / size), final = down(b1 / size);
      for (int b = first; b <= final; ++b) A ? visit(b, row) : visit(row, b);
    }
    if (!goes_on) break;
  }

  // ---- 6. Out
  auto write = [&](size_t to, float t, int what, float cosine, float albedo) {
    job.distance[to] = t;
    job.organ[to] = (unsigned char)what;
    job.cosine[to] = cosine;
    job.reflectance[to] = albedo;
  };
  auto settled = [&](int block) {  // what is known of its lanes by now: nothing nearer than a solid is the solid
    Block& b = r[block];
    for (int l = 0; l < N; ++l) {
      const int i = b.ray[l];
      if (b.what[l] > 0 || i < 0) continue;
      const bool is_solid = job.solid && job.solid_organ[i] > 0;
      if (is_solid && b.what[l] == 0) k.until[block / slices] = FAR;  // lost before it came to the solid
      b.t[l] = is_solid ? job.solid[i] : __builtin_nanf("");
      b.what[l] = is_solid ? job.solid_organ[i] : 0;
      b.cosine[l] = is_solid ? job.solid_cosine[i] : 0.0f;
      b.albedo[l] = is_solid ? job.solid_reflectance[i] : 0.0f;
    }
  };
  auto all_of = [&](Block& b) {
    for (int l = 0; l < N; ++l) if (b.ray[l] >= 0) write(b.ray[l], b.t[l], b.what[l], b.cosine[l], b.albedo[l]);
  };
  auto nearest_of = [&](int p) {  // the place of each hit in the order of its bundle, ties by number
    Block* mine = r + p * slices;
    const size_t to = (size_t)(mine[0].ray[0] / job.sub_rays) * (job.only ? 1 : need);
    int found = 0;
    for (int v = 0; v < slices; ++v) found += __builtin_popcount(bits((loadi(mine[v].ray) >= 0) & (loadi(mine[v].what) > 0)));
    for (int j = 0; j < width; ++j) {
      Block& b = mine[j / N];
      const int l = j % N;
      if (b.ray[l] < 0 || b.what[l] == 0 || b.t[l] > k.until[p]) continue;
      int place = 0;
      for (int v = 0; v < slices; ++v) {
        F t = load(mine[v].t);
        I ray = loadi(mine[v].ray);
        place += __builtin_popcount(bits((ray >= 0) & ((t < b.t[l]) | ((t == b.t[l]) & (ray < b.ray[l])))));
      }
      if (place >= need || (job.only && place != need - 1)) continue;
      write(to + (job.only ? 0 : place), b.t[l], b.what[l], b.cosine[l], b.albedo[l]);
    }
    for (int i = job.only ? need - 1 : found; i < need; ++i)
      if (i >= found) write(to + (job.only ? 0 : i), __builtin_nanf(""), 0, 0.0f, 0.0f);
  };
  for (int b = 0; b < count; ++b) {
    settled(b);
    if (need == 0) all_of(r[b]);
  }
  if (from < 0) {
    for (int p = 0; need > 0 && p < packs; ++p) nearest_of(p);
    at += packs;
  } else {
    for (int j = from; j < after; ++j) {
      early.t[j] = r[j / N].t[j % N]; early.what[j] = r[j / N].what[j % N];
      early.cosine[j] = r[j / N].cosine[j % N]; early.albedo[j] = r[j / N].albedo[j % N];
    }
    for (from = after; from < width && lane_of[at * width + from] < 0;) ++from;
    if (from == width) {
      if (need > 0) {
        for (int j = 0; j < width; ++j) {
          r[j / N].ray[j % N] = lane_of[at * width + j];
          r[j / N].t[j % N] = early.t[j]; r[j / N].what[j % N] = early.what[j];
          r[j / N].cosine[j % N] = early.cosine[j]; r[j / N].albedo[j % N] = early.albedo[j];
        }
        k.until[0] = FAR;
        nearest_of(0);
      }
      ++at;
      from = -1;
    }
  }
}
