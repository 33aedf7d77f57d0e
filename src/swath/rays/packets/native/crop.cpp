// The crop of a tile: which pieces of which plants the rays of a group may touch.

struct alignas(64) Paths {  // of the packets through the tile at hand, along the traversal's axis: first, last, and linear
  float a0[PACKETS], a1[PACKETS], from[PACKETS], depth_max[PACKETS], until[PACKETS];  // bounds from `from` on: across low and
  float bound[5][PACKETS], rise[5][PACKETS];                   // high, other axis low and high, least depth
};
struct alignas(64) Kept {  // pieces in slopes: middle, half of the way from end to end, half width; least depth, 1 / depth
  float u[KEPT + N], v[KEPT + N], hu[KEPT + N], hv[KEPT + N], wide[KEPT + N], near[KEPT + N], inv[KEPT + N];
  float tu[KEPT + N], tv[KEPT + N], side[KEPT + N], ahead[KEPT + N], reach[KEPT + N];  // direction; middle across it, along
  int prim[KEPT + N], image[KEPT + N];                                                // it; half length and width
};

typedef unsigned long long Set;  // of vectors
struct Places : Vectors {  // of vectors on one axis, in steps
  float from, per;
  Set behind[STEPS], before[STEPS];  // those that reach as far as a step or farther; that begin there or before
  void mark(const float* middle, const float* half, int count) {
    float low = FAR, high = -FAR;
    for (int i = 0; i < count; ++i) {
      low = lower(low, middle[i] - half[i]);
      high = upper(high, middle[i] + half[i]);
    }
    from = low;
    per = (STEPS - 1) / (high - low);
    for (int i = 0; i < STEPS; ++i) behind[i] = before[i] = 0;
    for (int i = 0; i < count; ++i) {
      behind[step_of(put(middle[i] + half[i]))[0]] |= 1ull << i;
      before[step_of(put(middle[i] - half[i]))[0]] |= 1ull << i;
    }
    for (int i = 1; i < STEPS; ++i) before[i] |= before[i - 1];
    for (int i = STEPS - 1; i > 0; --i) behind[i - 1] |= behind[i];
  }
  I step_of(F x) const { return __builtin_convertvector(least(most((x - from) * per, F{}), put(STEPS - 1.0f)), I); }
  Set beside(int low, int high) const { return behind[low] & before[high]; }  // that may lie between two steps
};

struct Crop : Tiles {
  IndexRef index;
  int active[PACKETS], active_count, active_of[PACKETS];  // packets that go through crop in the tile at hand
  float m[3][3], shift[3], depth_gain, side_gain;        // prototype to group: depth, u, v = m x + shift; how lengths grow
  int axis, ib, ic, sense;                     // the axis it is traversed along, the others; the direction of most rays
  float cell[3], per_cell[3], wide[3], path0, path1, group_depth_max, slant_gain;
  float gu0, gu1, gv0, gv1;                    // its live vectors in slopes
  Paths path;
  struct Run { int first, last, kx, ky; float top; } coming[COMING];  // of entries; what is higher is cut
  int runs;
  Kept kept;
  int waiting;
  struct Beside { Set some; int piece; } beside[KEPT + N];  // vectors that a piece may touch, of pieces that may any
  unsigned pair[PAIRS + N];                    // a piece and a vector it may touch, as piece * VECTORS + vector
  unsigned char touched[VECTORS];
  int fresh[VECTORS], news;            // vectors with new hits
  Places along, across;                        // of its vectors in slopes
  float c_low[SPAN], c_high[SPAN];

  Crop(Job& j, SceneRef s, IndexRef i) : Tiles(j, s), index(i) {
    for (int i = 0; i < SPAN; ++i) { c_low[i] = FAR; c_high[i] = -FAR; }
  }

  void through_crop() {
    find_box();
    find_tops();
    set_frame();
    together_through();
    for (int n = 0; n < active_count; ++n)
      for (int v = 0; v < vectors; ++v) set_hits(r[active[n] * vectors + v]);
  }
  void find_box() {  // of the live vectors, in slopes
    gu0 = gv0 = FAR;
    gu1 = gv1 = -FAR;
    for (int n = 0; n < active_count; ++n)
      for (int b = active[n] * vectors; b < (active[n] + 1) * vectors; ++b) {
        gu0 = lower(gu0, c.cu[b] - c.ru[b]);
        gu1 = upper(gu1, c.cu[b] + c.ru[b]);
        gv0 = lower(gv0, c.cv[b] - c.rv[b]);
        gv1 = upper(gv1, c.cv[b] + c.rv[b]);
      }
  }
  void set_frame() {  // from the prototype into the group's frame
    const float flip[2] = {tile.mirror_x ? -1.0f : 1.0f, tile.mirror_y ? -1.0f : 1.0f};
    const float cx = tile.mirror_x ? size : 0.0f, cy = tile.mirror_y ? size : 0.0f;
    const float *plane = tile.plane, *stand = tile.stand;
    const float at[3] = {tile.x * size + cx - apex[0], tile.y * size + cy - apex[1],
                         (float)(plane[0] - gz) + plane[1] * (cx - 0.5f * size) + plane[2] * (cy - 0.5f * size) - apex[2]};
    for (int i = 0; i < 3; ++i) {
      m[i][0] = flip[0] * (e[i][0] + e[i][2] * plane[1]);
      m[i][1] = flip[1] * (e[i][1] + e[i][2] * plane[2]);
      m[i][2] = e[i][0] * stand[1] + e[i][1] * stand[2] + e[i][2] * (plane[1] * stand[1] + plane[2] * stand[2] + stand[0]);
      shift[i] = dot3(e[i], at);
    }
    const float m11 = dot3(m[1], m[1]), m22 = dot3(m[2], m[2]), m12 = dot3(m[1], m[2]);
    side_gain = 1.0001f * __builtin_sqrtf(0.5f * (m11 + m22) + __builtin_sqrtf(0.25f * (m11 - m22) * (m11 - m22) + m12 * m12));
    depth_gain = 1.0001f * __builtin_sqrtf(dot3(m[0], m[0]));
  }

  // Where cells of the tile are cut: how high what is left can reach, for each column, by the highest code of
  // the columns around it in which its stems may stand; beyond the page all may stand
  static U bytes(const unsigned char* p) { U v; __builtin_memcpy(&v, p, 64); return v; }
  void find_tops() {
    tile.trims = false;
    if (tile.cut_row < 0 || index.columns != AROUND || index.halo > 4) return;
    const unsigned char* codes = scene.cut.data + (size_t)tile.cut_row * 512 * 512;
    U least_code = bytes(codes + (size_t)(tile.jy * 64) * 512 + tile.jx * 64);
    for (int y = 1; y < 64; ++y)
      least_code = __builtin_elementwise_min(least_code, bytes(codes + (size_t)(tile.jy * 64 + y) * 512 + tile.jx * 64));
    tile.trims = __builtin_reduce_min(least_code) != STANDING;
    if (!tile.trims) return;
    unsigned char block[16][16];  // highest code of columns, from four before the tile on
    for (int y = 0; y < 16; ++y) column_codes(codes, tile.jy * 8 - 4 + y, block[y]);
    const int begin = 4 - index.halo, side = 2 * index.halo + 1;
    unsigned char across[16][AROUND];
    auto higher = [](unsigned char a, unsigned char b) { return a > b ? a : b; };
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < AROUND; ++x) {
        across[y][x] = block[y][x + begin];
        for (int i = 1; i < side; ++i) across[y][x] = higher(across[y][x], block[y][x + begin + i]);
      }
    for (int y = 0; y < AROUND; ++y)
      for (int x = 0; x < AROUND; ++x) {
        unsigned char code = across[y + begin][x];
        for (int i = 1; i < side; ++i) code = higher(code, across[y + begin + i][x]);
        tile.live[tile.mirror_y ? 7 - y : y][tile.mirror_x ? 7 - x : x] =
            code == STANDING ? FAR : code == 0 ? -FAR : 0.01f * (float)code * tile.squeeze + 0.02f;
      }
  }
  void column_codes(const unsigned char* codes, int row, unsigned char* to) const {  // 16 columns of a row of columns
    __builtin_memset(to, STANDING, 16);
    if (row < 0 || row > 63) return;
    for (int half = 0; half < 2; ++half) {
      const int first = tile.jx * 8 - 4 + half * 8, from = first < 0 ? 0 : first > 56 ? 56 : first;  // of the page
      U high = bytes(codes + (size_t)row * 8 * 512 + from * 8);
      for (int v = 1; v < 8; ++v) high = __builtin_elementwise_max(high, bytes(codes + (size_t)(row * 8 + v) * 512 + from * 8));
      for (int bit = 32; bit >= 8; bit /= 2) {
        W8 q;
        __builtin_memcpy(&q, &high, 64);
        q >>= bit;
        U moved;
        __builtin_memcpy(&moved, &q, 64);
        high = __builtin_elementwise_max(high, moved);
      }
      for (int x = 0; x < 8; ++x)
        if (first + x >= from && first + x < from + 8) to[half * 8 + x] = high[8 * (first + x - from)];
    }
  }
  float live_top(int x, int y) const {  // of a column of the unwrapped prototype
    if (!tile.trims || x < 0 || y < 0 || x >= index.columns || y >= index.columns) return FAR;
    return tile.live[y][x];
  }

  void together_through() {
    find_paths();
    waiting = news = runs = 0;
    for (int b = 0; b < packets * vectors; ++b) touched[b] = 0;
    for (int n = 0; n < active_count; ++n) active_of[active[n]] = n;
    const int first = slab_of(axis == 2 ? path0 - wide[2] : path0 - wide[axis]), last = slab_of(path1 + wide[axis]);
    for (int n = 0; n <= last - first; ++n) {
      cross_slab(sense >= 0 ? first + n : last - n);
      gather_runs();
      if (waiting >= FLUSH) flush();
    }
    flush();
  }
  int slab_of(float x) const { return axis == 2 ? bin_of(x) / BINS : down(x * per_cell[axis]); }
  int bin_of(float z) const {
    const int i = down(z * per_cell[2]);
    return i < 0 ? 0 : i >= index.bins ? index.bins - 1 : i;
  }

  // The traversal's axis, and each packet's path as linear bounds along it
  void find_paths() {
    float lead_q[3] = {0, 0, 0};
    const int width = vectors * N;
    for (int j = active[0] * width; j < (active[0] + 1) * width; ++j) {
      const Block& b = r[j / N];
      if (b.limit[j % N] < 0.0f) continue;
      for (int i = 0; i < 3; ++i) lead_q[i] = __builtin_fabsf(b.q[i][j % N]);
      break;
    }
    axis = lead_q[2] > upper(lead_q[0], lead_q[1]) ? 2 : lead_q[0] >= lead_q[1] ? 0 : 1;
    ib = axis == 2 ? 1 : 1 - axis;
    ic = axis == 2 ? 0 : 2;
    for (int i = 0; i < 3; ++i) {
      cell[i] = i == 2 ? index.bin_height : index.side;
      per_cell[i] = 1.0f / cell[i];
      wide[i] = index.extent[i] + ROUND;
    }
    path0 = FAR;
    path1 = group_depth_max = -FAR;
    sense = 0;
    for (int b = 0; b < packets * vectors || b % N; ++b) c.depth_max[b] = -FAR;
    for (int n = 0; n < active_count; ++n) find_path(n);
    const float slant = upper(gu1 * gu1, gu0 * gu0) + upper(gv1 * gv1, gv0 * gv0);
    slant_gain = 1.01f * __builtin_sqrtf(1.0f + slant);
  }
  void find_path(int n) {
    const int p = active[n];
    int forth = 0, back = 0;
    F a0 = put(FAR), a1 = put(-FAR), slowest = put(FAR), w_far = put(-FAR);
    for (int b = p * vectors; b < (p + 1) * vectors; ++b) {
      Block& k_ = r[b];
      F limit = k_.limit, x = k_.p[axis], q = k_.q[axis], y = x + q * k_.end;
      I live = limit >= 0.0f;
      a0 = live ? least(a0, least(x, y)) : a0;
      a1 = live ? most(a1, most(x, y)) : a1;
      slowest = live ? least(slowest, size_of(q)) : slowest;
      forth += count(live & (q > 0.0f));
      back += count(live & (q <= 0.0f));
      F w = live ? depth(k_, k_.start + limit * k_.shrink) + ROUND : put(-FAR);
      w_far = most(w_far, w);
      spot[b].depth_max = w;
      c.depth_max[b] = highest_of(w);
    }
    path.a0[n] = lowest_of(a0);
    path.a1[n] = highest_of(a1);
    path.depth_max[n] = highest_of(w_far);
    path.until[n] = k.until[p];
    path0 = lower(path0, path.a0[n]);
    path1 = upper(path1, path.a1[n]);
    group_depth_max = upper(group_depth_max, path.depth_max[n]);
    sense += forth - back;
    const bool straight = lowest_of(slowest) > 0.05f && (forth == 0 || back == 0);
    const float room = wide[axis] + cell[axis], plane0 = path.a0[n] - room, plane1 = path.a1[n] + room;
    float edge[2][5];
    bounds_at(p, straight, plane0, 0, edge[0]);
    bounds_at(p, straight, plane1, 1, edge[1]);
    path.from[n] = plane0;
    for (int i = 0; i < 5; ++i) {
      path.bound[i][n] = edge[0][i];
      path.rise[i][n] = (edge[1][i] - edge[0][i]) / (plane1 - plane0);
    }
  }
  static F depth(const Block& b, F t) { return b.w0 + b.w1 * t; }
  void bounds_at(int p, bool straight, float plane, int side, float* edge) const {  // or of the whole path
    F b0 = put(FAR), b1 = put(-FAR), c0 = put(FAR), c1 = put(-FAR), w0 = put(FAR);
    for (int v = 0; v < vectors; ++v) {
      const Block& k_ = r[p * vectors + v];
      I live = k_.limit >= 0.0f;
      for (int end = 0; end < (straight ? 1 : 2); ++end) {
        F s = straight ? (plane - k_.p[axis]) / k_.q[axis] : end ? k_.end : F{};
        F b = k_.p[ib] + s * k_.q[ib], c = k_.p[ic] + s * k_.q[ic];
        F w = depth(k_, k_.start + s * k_.shrink);
        b0 = live ? least(b0, b) : b0;
        b1 = live ? most(b1, b) : b1;
        c0 = live ? least(c0, c) : c0;
        c1 = live ? most(c1, c) : c1;
        w0 = live ? least(w0, w) : w0;
      }
    }
    edge[0] = lowest_of(b0) - wide[ib];
    edge[1] = highest_of(b1) + wide[ib];
    edge[2] = lowest_of(c0) - wide[ic];
    edge[3] = highest_of(c1) + wide[ic];
    edge[4] = lowest_of(w0) - ROUND;
  }

  // A slab of columns: which columns and bins the packets pass, widened by the extent of pieces
  void cross_slab(int i) {
    const int bin0 = i * BINS, bin1 = bin0 + BINS < index.bins ? bin0 + BINS - 1 : index.bins - 1;  // of one that lies flat
    const float x0 = axis != 2 ? i * cell[axis] - wide[axis] : i == 0 ? -FAR : bin0 * cell[2] - wide[2];
    const float x1 = axis != 2 ? (i + 1) * cell[axis] + wide[axis] : bin1 == index.bins - 1 ? FAR : (bin1 + 1) * cell[2] + wide[2];
    int j0 = SPAN, j1 = -1;
    for (int w = 0; w < active_count; w += N) pass_slab(w, x0, x1, &j0, &j1);
    for (int s = j0; s <= j1; ++s) {
      const float c0 = c_low[s], c1 = c_high[s];
      if (c0 > c1) continue;
      c_low[s] = FAR;
      c_high[s] = -FAR;
      const int j = s - SPAN / 2;
      for (int x = axis == 2 ? down(c0 * per_cell[0]) : 0; x <= (axis == 2 ? down(c1 * per_cell[0]) : 0); ++x) {
        const int cx = axis == 2 ? x : axis == 0 ? i : j, cy = axis == 1 ? i : j;
        const int kx = per(cx, index.columns), ky = per(cy, index.columns);
        const float top = live_top(cx, cy), tallest = top + wide[2];
        const int column = (tile.kind * index.columns + cy - ky * index.columns) * index.columns + cx - kx * index.columns;
        if (tallest < (axis == 2 ? bin0 * cell[2] : c0)) continue;
        const int low = axis == 2 ? bin0 : bin_of(c0), high = axis == 2 ? bin1 : bin_of(lower(c1, tallest));
        const int* start = index.start.data + column * index.bins;
        queue({start[low], start[high + 1], kx, ky, top});
      }
    }
  }
  void pass_slab(int w, float x0, float x1, int* j0, int* j1) {  // N packets
#pragma clang fp contract(fast)
    F lo = most(put(x0), load(path.a0 + w)), hi = least(put(x1), load(path.a1 + w));
    F f0 = lo - load(path.from + w), f1 = hi - load(path.from + w), found[5];
    for (int q = 0; q < 5; ++q) {
      F x = load(path.bound[q] + w), rise = load(path.rise[q] + w), y0 = x + rise * f0, y1 = x + rise * f1;
      found[q] = q == 1 || q == 3 ? most(y0, y1) + ROUND : least(y0, y1) - ROUND;
    }
    I side0 = __builtin_convertvector(__builtin_elementwise_floor(found[0] * per_cell[ib]), I) + SPAN / 2;
    I side1 = __builtin_convertvector(__builtin_elementwise_floor(found[1] * per_cell[ib]), I) + SPAN / 2;
    side0 = side0 < 0 ? I{} : side0;
    side1 = side1 >= SPAN ? puti(SPAN - 1) : side1;
    unsigned some = bits((lo <= hi) & (found[4] <= load(path.depth_max + w)) & (every() < active_count - w));
    for (; some; some &= some - 1) {
      const int l = __builtin_ctz(some), b0 = side0[l], b1 = side1[l];
      const float c0 = found[2][l], c1 = found[3][l];
      for (int j = b0; j <= b1; ++j) {
        c_low[j] = lower(c_low[j], c0);
        c_high[j] = upper(c_high[j], c1);
      }
      *j0 = b0 < *j0 ? b0 : *j0;
      *j1 = b1 > *j1 ? b1 : *j1;
    }
  }
  HOT void queue(Run run) {  // gathered together once there are some: by then they have been fetched
    for (int i = run.first; i < run.last && i < run.first + N; i += 4) __builtin_prefetch(index.coarse.data + (size_t)i * 8);
    __builtin_prefetch(index.primitive.data + run.first);
    coming[runs] = run;
    runs += run.first < run.last;
    if (runs == COMING) gather_runs();
  }

  // Runs of pieces into the group's slopes; those outside the box of the group are dropped
  HOT static F number(S4 a, S4 b, int i) {  // the i-th field of two halves
    S s;
    __builtin_memcpy(&s, (const short*)&a + 8 * i, 16);
    __builtin_memcpy((short*)&s + 8, (const short*)&b + 8 * i, 16);
    return __builtin_convertvector(s, F);
  }
  HOT static void turn_entries(const short* from, F* field) {  // 16 entries of 8 numbers into 8 vectors
    auto head = [](S4 a, S4 b) -> S4 {
      return __builtin_shufflevector(a, b, 0, 8, 16, 24, 32, 40, 48, 56, 1, 9, 17, 25, 33, 41, 49, 57, 2, 10, 18, 26,
                                     34, 42, 50, 58, 3, 11, 19, 27, 35, 43, 51, 59);
    };
    auto tail = [](S4 a, S4 b) -> S4 {
      return __builtin_shufflevector(a, b, 4, 12, 20, 28, 36, 44, 52, 60, 5, 13, 21, 29, 37, 45, 53, 61, 6, 14, 22, 30,
                                     38, 46, 54, 62, 7, 15, 23, 31, 39, 47, 55, 63);
    };
    S4 raw[4];
    __builtin_memcpy(raw, from, 256);
    const S4 head0 = head(raw[0], raw[1]), head1 = head(raw[2], raw[3]);
    const S4 tail0 = tail(raw[0], raw[1]), tail1 = tail(raw[2], raw[3]);
    for (int i = 0; i < 4; ++i) field[i] = number(head0, head1, i);
    for (int i = 0; i < 4; ++i) field[4 + i] = number(tail0, tail1, i);
  }
  void gather_runs() {
#pragma clang fp contract(fast)
    float n[3][3];  // m for ends in steps
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) n[i][j] = m[i][j] * index.step;
    const float gcu = 0.5f * (gu0 + gu1), gru = 0.5f * (gu1 - gu0), gcv = 0.5f * (gv0 + gv1), grv = 0.5f * (gv1 - gv0);
    const float depth_gain_step = depth_gain * index.step, side_gain_step = side_gain * index.step, offset = offset_max, slant = slant_gain, far = group_depth_max;
    const float rank_max = (float)tile.rank_max, per_step = 1.0f / index.step;
    const short* coarse = index.coarse.data;
    int to = waiting;
    for (int q = 0; q < runs; ++q) {
      const Run run = coming[q];
      const float top = run.top * per_step, kx = run.kx * size, ky = run.ky * size;  // the prototype's copy
      const float off[3] = {shift[0] + m[0][0] * kx + m[0][1] * ky, shift[1] + m[1][0] * kx + m[1][1] * ky,
                            shift[2] + m[2][0] * kx + m[2][1] * ky};
      for (int i = run.first; i < run.last; i += N) {
        F f[8];
        turn_entries(coarse + (size_t)i * 8, f);
        const F thick = f[6];
        auto along = [&](int row, const F* x) -> F { return n[row][0] * x[0] + n[row][1] * x[1] + n[row][2] * x[2] + off[row]; };
        F wa = along(0, f), wb = along(0, f + 3), ua = along(1, f), ub = along(1, f + 3), va = along(2, f), vb = along(2, f + 3);
        F near = least(wa, wb) - thick * depth_gain_step - ROUND;
        if (is_parallel) wa = wb = put(1.0f);
        F both = 1.0f / (wa * wb), ia = both * wb, iz = both * wa, nearer = most(ia, iz), thin = (thick * depth_gain_step + ROUND) * nearer;
        I inside = every() < run.last - i, close = is_parallel ? I{} : (near < 0.05f) | (thin > 0.25f);
        F inv = 0.5f * (ia + iz), most_inv = nearer * (1.0f + 1.34f * thin);  // at least 1 / near
        ua *= ia; va *= ia; ub *= iz; vb *= iz;
        F u = 0.5f * (ua + ub), v = 0.5f * (va + vb), hu = 0.5f * (ub - ua), hv = 0.5f * (vb - va);
        F broad = (thick * side_gain_step + ROUND) * most_inv * slant + offset * 0.71f * size_of(ia - iz);
        F margin = broad + offset * most_inv;
        I keep = (size_of(u - gcu) <= size_of(hu) + margin + gru) & (size_of(v - gcv) <= size_of(hv) + margin + grv);
        keep = (keep | close) & inside & (near <= far) & (f[7] <= rank_max) &
               (least(f[2], f[5]) <= top + 2.0f * thick);  // a cut end is round
        if (bits(keep & close)) {  // may touch any vector
          u = close ? F{} : u; v = close ? F{} : v; hu = close ? F{} : hu; hv = close ? F{} : hv;
          broad = close ? put(FAR) : broad; inv = close ? F{} : inv;
        }
        const F pieces[FIELDS] = {u, v, hu, hv, broad, near, inv, as_float(loadi(index.primitive.data + i))};
        float* const places[FIELDS] = {kept.u + to, kept.v + to, kept.hu + to, kept.hv + to,
                                  kept.wide + to, kept.near + to, kept.inv + to, (float*)kept.prim + to};
        keep_some(pieces, places, bits(keep));
        storei(kept.image + to, puti(run.kx * 65536 + run.ky));
        to += count(keep);
        if (to <= KEPT - N) continue;
        waiting = to;
        flush();
        to = 0;
      }
    }
    runs = 0;
    waiting = to;
  }
  // The pieces that wait: which vectors lie beside them, which lanes of these they may touch; what is left is tested
  void flush() {
#pragma clang fp contract(fast)
    float nearest = FAR;
    for (int n = 0; n < waiting; n += N) {
      const F near = load(kept.near + n);
      nearest = lower(nearest, lowest_of(every() < waiting - n ? near : put(FAR)));
    }
    const Set looking = looking_to(nearest);
    int asked = 0, busy = 0;
    for (int n = 0; n < waiting; n += N) {
      const F u = load(kept.u + n), v = load(kept.v + n), room = load(kept.wide + n) + offset_max * load(kept.inv + n);
      const F hu = size_of(load(kept.hu + n)) + room, hv = size_of(load(kept.hv + n)) + room;
      make_strips(n);
      alignas(64) int left[N], right[N], low[N], high[N];
      storei(left, along.step_of(u - hu));
      storei(right, along.step_of(u + hu));
      storei(low, across.step_of(v - hv));
      storei(high, across.step_of(v + hv));
      for (int i = 0; i < N && n + i < waiting; ++i) {
        const Set some = looking & along.beside(left[i], right[i]) & across.beside(low[i], high[i]);
        beside[busy].some = some;
        beside[busy].piece = n + i;
        busy += some != 0;
      }
    }
    for (int i = 0; i < busy; ++i) {
      __builtin_prefetch(row_of(kept.prim[beside[i].piece]));
      asked = ask(asked, beside[i].piece, beside[i].some);
      if (asked <= PAIRS - VECTORS) continue;
      settle(narrow_down(asked));
      asked = 0;
    }
    settle(narrow_down(asked));
    waiting = 0;
    take_news();
  }
  HOT void make_strips(int n) {
#pragma clang fp contract(fast)
    const F u = load(kept.u + n), v = load(kept.v + n), hu = load(kept.hu + n), hv = load(kept.hv + n);
    const F h = root(hu * hu + hv * hv), per_h = 1.0f / most(h, put(1.0e-9f)), tu = hu * per_h, tv = hv * per_h;
    store(kept.tu + n, tu);
    store(kept.tv + n, tv);
    store(kept.side + n, v * tu - u * tv);
    store(kept.ahead + n, u * tu + v * tv);
    store(kept.reach + n, h + load(kept.wide + n));
  }
  HOT int ask(int asked, int n, Set some) {  // most are few: no branch for the first two
    const int left = __builtin_popcountll(some);
    for (int at = asked;; at += 2) {
      pair[at] = n * VECTORS + __builtin_ctzll(some);
      some &= some - 1;
      pair[at + 1] = n * VECTORS + __builtin_ctzll(some | 1ull << 63);
      some &= some - 1;
      if (at + 2 >= asked + left) return asked + left;
    }
  }
  Set looking_to(float nearest) const {  // vectors that look as far as that
    Set some = 0;
    for (int b = 0; b < packets * vectors; b += N) some |= (Set)bits(load(c.depth_max + b) >= nearest) << b;
    return some;
  }
  // is_one: all rays start at one point, so that none is off its slope
  HOT int lanes_beside(int asked, bool is_one) {  // of the vectors that a piece may touch, those of which it may touch a lane
#pragma clang fp contract(fast)
    int pairs = 0;
    for (int q = 0; q < asked; ++q) {
      const int n = pair[q] / VECTORS, i = pair[q] % VECTORS;
      const float tu = kept.tu[n], tv = kept.tv[n], inv = kept.inv[n];
      const Spot& s = spot[i];
      F u = is_one ? s.u : s.u + s.ou * inv, v = is_one ? s.v : s.v + s.ov * inv;
      I may = (size_of(v * tu - u * tv - kept.side[n]) <= kept.wide[n]) &
              (size_of(u * tu + v * tv - kept.ahead[n]) <= kept.reach[n]) & (s.depth_max >= kept.near[n]);
      pair[pairs] = pair[q];  // no branch: whether it stays is hard to foretell
      pairs += bits(may) != 0;
    }
    return pairs;
  }
  int narrow_down(int asked) { return starts_at_one() || is_parallel ? lanes_beside(asked, true) : lanes_beside(asked, false); }
  void settle(int pairs) {
    for (int i = 0, next; i < pairs; i = next) {
      const int n = pair[i] / VECTORS;
      for (next = i + 1; next < pairs && (int)(pair[next] / VECTORS) == n;) ++next;
      Whole w;
      if (!stands(kept.prim[n], kept.image[n], &w)) continue;
      for (int s = i; s < next; ++s) {
        const int b = pair[s] % VECTORS;
        if (!test(r[b], w) || touched[b]) continue;
        touched[b] = 1;
        fresh[news++] = b;
      }
    }
  }
  void take_news() {  // new hits bring nearer how far lanes and vectors still look
    for (int i = 0; i < news; ++i) {
      const int b = fresh[i], p = b / vectors, n = active_of[p];
      touched[b] = 0;
      const Block& k_ = r[b];
      F limit = k_.limit;
      F w = depth(k_, least(k_.start + limit * k_.shrink, put(path.until[n]))) + ROUND;
      w = limit >= 0.0f ? w : put(-FAR);
      spot[b].depth_max = w;
      c.depth_max[b] = highest_of(w);
      float depth_max = -FAR;
      for (int q = p * vectors; q < (p + 1) * vectors; ++q) depth_max = upper(depth_max, c.depth_max[q]);
      path.depth_max[n] = depth_max;
    }
    news = 0;
  }
};
