// The traversal of a group: tiles in rows, front to back.

struct Traversal : Crop {
  using Crop::Crop;

  void run() {
    for (long long g; (g = __atomic_fetch_add(&job.next, 1, __ATOMIC_RELAXED)) < job.groups;)
      for (int at = job.first[g]; at < job.first[g + 1]; at += taken) {
        const int left = job.first[g + 1] - at, room = VECTORS * (int)job.lanes;
        take(at, left < room ? left : room);
        if (is_invalid) break;
        cast();
        for (int b = 0; b < packets * vectors; ++b) hand_out(r[b]);
      }
  }

  void cast() {
    check_height();
    find_frame();
    pack();
    into_slopes();
    along.mark(c.cu, c.ru, packets * vectors);
    across.mark(c.cv, c.rv, packets * vectors);
    for (int p = 0; p < packets; ++p) look(p);
    march();
  }

  // Tiles in rows, front to back, until no packet looks further
  void march() {
    const float along = e[0][A];
    const int step = along >= 0.0f ? 1 : -1;
    bool mixed = false;
    for (int p = 0; p < packets; ++p)
      mixed |= (k.da0[p] <= 0.0f && k.da1[p] >= 0.0f) || (k.da0[p] > 0.0f) != (along >= 0.0f);
    for (int n = -1;; ++n) {
      bool goes_on = n < 1;
      for (int side = 0; side < (mixed && n > 0 ? 2 : 1); ++side) {
        const int row = side ? -step * n : step * n;
        float b0 = FAR, b1 = -FAR;
        for (int p = 0; p < packets; p += N) goes_on |= cross_row(p, row * size, row * size + size, &b0, &b1);
        if (b0 > b1) continue;
        for (int b = down(b0 / size); b <= down(b1 / size); ++b) A ? visit(b, row) : visit(row, b);
      }
      if (!goes_on) return;
    }
  }
  bool cross_row(int p, float near, float far, float* b0, float* b1) {  // N packets; true: this row or a later is to come
    const F oa0 = load(k.oa0 + p), oa1 = load(k.oa1 + p), da0 = load(k.da0 + p), da1 = load(k.da1 + p), until = load(k.until + p);
    const I ahead = da0 > 1e-6f, turns = ~ahead & ~(da1 < -1e-6f), known = every() < packets - p;
    const F to_go = ahead ? near - oa1 : oa0 - far, to_leave = ahead ? far - oa0 : oa1 - near;
    const F slow = ahead ? da0 : -da1, fast = ahead ? da1 : -da0;
    const F away = most(most(near - oa1, oa0 - far), F{}) / most(most(da1, -da0), put(1e-6f));
    F t0 = turns ? away : to_go / (to_go > 0.0f ? fast : slow), t1 = turns ? put(FAR) : to_leave / (to_leave > 0.0f ? slow : fast);
    t0 = most(t0 - 1e-4f, F{});
    const bool goes_on = bits(known & (t1 >= 0.0f) & (t0 <= until)) != 0;
    t1 = least(t1 + 1e-4f, until);
    const I crosses = known & (t0 <= t1);
    const F db0 = load(k.db0 + p), db1 = load(k.db1 + p), dz0 = load(k.dz0 + p), dz1 = load(k.dz1 + p);
    const F low = load(k.ob0 + p) + least(db0 * t0, db0 * t1) - ROUND, high = load(k.ob1 + p) + most(db1 * t0, db1 * t1) + ROUND;
    store(k.row_t0 + p, crosses ? t0 : put(FAR));
    store(k.row_t1 + p, crosses ? t1 : put(-FAR));
    store(k.row_b0 + p, low);
    store(k.row_b1 + p, high);
    store(k.row_z0 + p, load(k.oz0 + p) + least(dz0 * t0, dz0 * t1) - 1e-4f);
    *b0 = lower(*b0, lowest_of(crosses ? low : put(FAR)));
    *b1 = upper(*b1, highest_of(crosses ? high : put(-FAR)));
    return goes_on;
  }

  // One tile: X, Y counted from the group's
  void visit(int X, int Y) {
    tile.x = (float)X;
    tile.y = (float)Y;
    tile.page_x = per(gx + X, 8);
    tile.page_y = per(gy + Y, 8);
    tile.slot = page_at(tile.page_x, tile.page_y);
    tile.jx = gx + X - tile.page_x * 8;
    tile.jy = gy + Y - tile.page_y * 8;
    const int place = tile.slot * 64 + tile.jy * 8 + tile.jx;
    tile.top_bound = FAR;
    if (tile.slot >= 0) read_heights(place);
    int act[PACKETS], acts = 0;
    const float near = A ? tile.x * size : tile.y * size;
    for (int p = 0; p < packets; ++p)
      if (k.row_t0[p] <= k.row_t1[p] && k.row_b0[p] < near + size && k.row_b1[p] > near && k.row_z0[p] <= tile.top_bound)
        act[acts++] = p;
    if (acts == 0) return;
    if (tile.slot >= 0) read_stand(place);
    active_count = 0;
    for (int n = 0; n < acts; ++n) {
      unsigned any = 0;
      k.ground[act[n]] = 0;
      for (int v = 0; v < vectors; ++v) {
        Block& b = r[act[n] * vectors + v];
        if (tile.slot < 0) lose(b);
        else any |= enter(b, &k.ground[act[n]], 1 << v);
      }
      if (any) active[active_count++] = act[n];
    }
    if (active_count) through_crop();
    for (int n = 0; n < acts; ++n) {
      for (unsigned v = tile.slot < 0 ? 0 : k.ground[act[n]]; v; v &= v - 1) meet_ground(r[act[n] * vectors + __builtin_ctz(v)]);
      look(act[n]);
    }
  }
};

Traversal traversal(*(Job*)job_bytes.data, scene, index);
traversal.run();
