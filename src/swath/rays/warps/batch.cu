// ---- Pieces that wait, 32 at a time: against slices, then rays, then exactly

int waiting = 0, head = 0;  // pieces in the ring, the first of them

// The last `n` of `found` candidates, each a piece and a ray: the exact test. Of equal distances the primitive of the lower
// number counts, and of its copies the lower one: no result depends on what came first. Marks slices with new hits.
auto test = [&](int found, int n, unsigned& fresh) {
  unsigned some = 0;
  EACH_LANE {
    unsigned mine = 0;
    if (lane < n) {
      const int who = s.candidate[found + lane], i = who >> 9, j = who & 511, number = s.prim[i];
      const Plant p = plant_at(number, s.piece_copy[i]);
      float t = FAR;
      if (p.rank < tile.share) {
        const Four p0 = four(ray_point + j), q0 = four(ray_ahead + j);
        const bool is_open = four(ray_way + j).y <= 0.0f;
        const V o(p0.x, p0.y, p0.z), d(q0.x, q0.y, q0.z);
        t = p.radius > 0.0f ? hit_rod(o, d, p0.w, is_open, p.a, p.b, p.radius)
                            : hit_flat(o, d, p0.w, p.a, p.b, p.w, p.radius, p.top);
      }
      const unsigned long long key = key_of(t, number + 1), was = t < FAR ? keep_least64(&s.key[j], key) : 0;
      s.tried[lane] = key;
      s.is_new[lane] = key < was;
      if (key <= was) mine = 1u << j / N;
    }
    fold_bits(some, mine);
  }
  if (!some) return;
  fresh |= some;
  EACH_LANE if (lane < n) {
    const int j = s.candidate[found + lane] & 511;
    const unsigned long long key = s.tried[lane];
    if (key != s.key[j]) s.tried[lane] = 0;  // another one was nearer
    else {
      if (s.is_new[lane]) *copy_of(j) = NOWHERE;
      s.t[j] = four(ray_way + j).x + key_t(key) * four(ray_ahead + j).w;
      s.state[j] = HIT | HERE;
    }
  }
  EACH_LANE if (lane < n && s.tried[lane]) {
    const int who = s.candidate[found + lane];
    keep_least(copy_of(who & 511), s.piece_copy[who >> 9]);
  }
};

auto batch = [&]() {
  const int n = waiting < WARP ? waiting : WARP;
  int pairs = 0, found = 0;
  unsigned fresh = 0;
  EACH_LANE {  // one piece each: which slices may it touch?
    const int i = (head + lane) & (KEPT - 1);
    unsigned meets = 0;
    if (lane < n) {
      const Four a = s.piece[i], b = s.more[i];
      const float u = a.x, v = a.y, tu = a.z, tv = a.w, h = b.x, wide = b.y, inv = b.z, su = ::fabsf(tu), sv = ::fabsf(tv);
      for (unsigned left = walkers; left; left &= left - 1) {
        const int k = lowest_bit(left);
        const Four box = s.box[k], shift = s.shift[k], rest = s.rest[k];
        const float du = box.x + shift.x * inv - u, dv = box.y + shift.y * inv - v;
        const float bu = box.z + shift.z * inv, bv = box.w + shift.w * inv, disc = rest.x + rest.y * inv;
        const bool touches = ::fabsf(dv * tu - du * tv) <= wide + lower(bu * sv + bv * su, disc) &&
                             ::fabsf(du * tu + dv * tv) <= wide + h + lower(bu * su + bv * sv, disc) && rest.z >= b.w;
        meets |= (unsigned)touches << k;
      }
    }
    int at = claim_many(pairs, bit_count(meets));
    for (; meets; meets &= meets - 1) s.pair[at++] = (unsigned short)(i * 32 + lowest_bit(meets));
  }
  for (int base = 0; base < pairs; base += WARP) {
    EACH_LANE {  // one pair each: which rays of the slice may the piece touch?
      unsigned meets = 0;
      int i = 0, k = 0;
      if (base + lane < pairs) {
        i = s.pair[base + lane] / 32;
        k = s.pair[base + lane] % 32;
        const Four a = s.piece[i], b = s.more[i], shift = s.shift[k];
        const float tu = a.z, tv = a.w, inv = b.z, u = a.x - shift.x * inv, v = a.y - shift.y * inv;
        const float across = v * tu - u * tv, wide = b.y + (shift.z * ::fabsf(tv) + shift.w * ::fabsf(tu)) * inv;
        const float along = u * tu + v * tv, longer = b.y + b.x + (shift.z * ::fabsf(tu) + shift.w * ::fabsf(tv)) * inv;
        for (int r = 0; r < N; ++r) {
          const int l = (r + lane) & (N - 1);  // not all in the same bank of the memory
          const Two spot = s.spot[k * N + l];
          const bool may = ::fabsf(spot.y * tu - spot.x * tv - across) <= wide && ::fabsf(spot.x * tu + spot.y * tv - along) <= longer;
          meets |= (unsigned)may << l;
        }
        for (unsigned left = meets; left; left &= left - 1) {
          const int l = lowest_bit(left), j = k * N + l;
          if (!(s.state[j] & HERE) || s.t[j] < b.w) meets &= ~(1u << l);
        }
      }
      int at = claim_many(found, bit_count(meets));
      for (; meets; meets &= meets - 1) s.candidate[at++] = (unsigned short)(i << 9 | (k * N + lowest_bit(meets)));
    }
    const bool is_last = base + WARP >= pairs;
    while (found >= WARP || (is_last && found > 0)) {
      const int some = found < WARP ? found : WARP;
      found -= some;
      test(found, some, fresh);
    }
  }
  head += n;
  waiting -= n;
  if (fresh) look(fresh);
};
