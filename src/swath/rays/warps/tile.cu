// ---- One tile: its rays, what they hit

// Height of the tile's plane above a ray's whole metre: the same whatever the group's height is
auto above_ray = [&](float off) { return (float)((double)tile.plane0 - (gz + (double)cast_off(off, 2))); };

// How high plants and ground reach above the tile's plane, both above the group's height, how deep the ground below the plane
struct Heights { float top, bump, crest, dip; };

// Rays into the tile, and into its prototype by the plain kernel's formulas. Gives the slices that get down to the
// ground; sets `walkers`, and `lead`, the first ray that walks
auto enter = [&](unsigned acts, const Heights& h, int& lead) {
  unsigned grounds = 0;
  walkers = 0;
  lead = ROOM;
  for (int base = 0; base < count; base += WARP) {
    if (!(acts >> (base / N) & 3u)) continue;
    EACH_LANE {
      const int j = base + lane, k = j / N;
      unsigned low = 0, walks = 0;
      if (j < count && acts >> k & 1) {
        const Four o = four(ray_origin + j), d = four(ray_direction + j);
        const float now = s.t[j], best = lower(now, s.rest[k].w);
        const float kx = (float)tile.x - cast_off(o.w, 0), ky = (float)tile.y - cast_off(o.w, 1);
        float t0 = 0.0f, t1 = FAR;
        auto cross = [&](float from, float o_, float d_) {
          if (::fabsf(d_) < 1e-12f) {
            if (!(o_ >= from * size && o_ < (from + 1.0f) * size)) t0 = FAR;
            return;
          }
          const float per_d = 1.0f / d_, off = -o_ / d_;
          t0 = upper((d_ > 0.0f ? from : from + 1.0f) * size * per_d + off, t0);
          t1 = lower((d_ > 0.0f ? from + 1.0f : from) * size * per_d + off, t1);
        };
        cross(kx, o.x, d.x);
        cross(ky, o.y, d.y);
        bool live = t0 <= t1 && t0 < best;
        s.key[j] = 0;
        s.state[j] &= HIT;
        if (tile.slot < 0) {  // lost: nothing is known from here on
          if (live) { s.t[j] = t0; s.state[j] = 0; }
        } else {
          const float h1 = d.z - tile.plane1 * d.x - tile.plane2 * d.y;
          const float rise = above_ray(o.w);
          const float h0 = o.z - rise - tile.plane1 * (o.x - (kx + 0.5f) * size) - tile.plane2 * (o.y - (ky + 0.5f) * size);
          const float lowest = lower(h0 + h1 * t0, h0 + h1 * lower(t1, best));
          if (live && lowest <= h.bump) low = 1u << k;
          float ta = t0, tb = lower(t1, best);
          const float through = (h.top - h0) / h1, under = (h.dip - h0) / h1;
          if (h1 < 0.0f) { ta = upper(ta, through); tb = lower(tb, under); }
          if (h1 > 0.0f) { ta = upper(ta, under); tb = lower(tb, through); }
          live = live && h.top > 0.005f && lowest <= h.top && ta <= tb;
          const float zd = h1 * tile.squeeze, z = (h0 + h1 * ta) * tile.squeeze;
          float xd = d.x - tile.lean_x * zd, yd = d.y - tile.lean_y * zd;
          float x = o.x - kx * size + d.x * ta - tile.lean_x * z, y = o.y - ky * size + d.y * ta - tile.lean_y * z;
          if (tile.mirror_x) { x = size - x; xd = -xd; }
          if (tile.mirror_y) { y = size - y; yd = -yd; }
          const float stretch = ::sqrtf(xd * xd + yd * yd + zd * zd), shrink = 1.0f / stretch, end = (tb - ta) * stretch;
          live = live && end < 200.0f * size;
          ray_way[j] = {ta, t0, t1, end};
          if (live) {
            ray_point[j] = {x, y, z, (t0 - ta) * stretch};
            ray_ahead[j] = {xd * shrink, yd * shrink, zd * shrink, shrink};
            s.state[j] |= HERE;
            s.key[j] = key_of((lower(t1, best) - ta) * stretch, 0);
            walks = 1u << k;
          }
        }
      }
      fold_bits(grounds, low);
      fold_bits(walkers, walks);
      fold_least(lead, walks ? j : ROOM);
    }
  }
  return grounds;
};

// What was hit: as the end of `walk_crop` in kernel/crop.py
auto name_hits = [&]() {
  for (int base = 0; base < count; base += WARP) {
    if (!(walkers >> (base / N) & 3u)) continue;
    EACH_LANE {
      const int j = base + lane;
      if (j < count && walkers >> (j / N) & 1 && (unsigned)s.key[j] != 0) {
        const Plant p = plant_at((int)(unsigned)s.key[j] - 1, *copy_of(j));
        const Four at = four(ray_point + j), q = four(ray_ahead + j), d = four(ray_direction + j);
        const V u = p.b - p.a, place = V(at.x, at.y, at.z) + key_t(s.key[j]) * V(q.x, q.y, q.z) - p.a;
        const float along = lower(upper(wp::dot(place, u) / upper(wp::dot(u, u), 1.0e-20f), 0.0f), 1.0f);
        const V normal = p.radius <= 0.0f ? wp::cross(u, p.w) : place - along * u;
        const float x = tile.mirror_x ? -normal[0] : normal[0], y = tile.mirror_y ? -normal[1] : normal[1];
        const float lift = (normal[2] - x * tile.lean_x - y * tile.lean_y) * tile.squeeze;
        const V up(x - lift * tile.plane1, y - lift * tile.plane2, lift);
        const float length = upper(::sqrtf(wp::dot(up, up)), 1.0e-20f);
        const bool is_stub = p.code != STANDING && (int)p.organ == 3;
        const int what = is_stub ? 6 : (int)p.organ;
        out(j, s.t[j], what, lower(1.0f, ::fabsf(up[0] * d.x + up[1] * d.y + up[2] * d.z) / length),
            p.albedo > 0.0f && !is_stub ? p.albedo : scene.reflectance.data[what]);
      }
    }
  }
};

// What is known of a tile, for all lanes; gives the slices that pass where something is
auto open_tile = [&](int x, int y, Heights& h) {
  Tile now = {};
  now.x = x;
  now.y = y;
  now.page_x = per(gx + x, 8);
  now.page_y = per(gy + y, 8);
  now.slot = slot_of(now.page_x, now.page_y);
  now.jx = gx + x - now.page_x * 8;
  now.jy = gy + y - now.page_y * 8;
  const int place = now.slot * 64 + now.jy * 8 + now.jx;
  if (now.slot >= 0) {
    const auto& plane = scene.tile_plane.data[place];
    now.plane0 = plane[0];
    now.plane1 = plane[1];
    now.plane2 = plane[2];
    h.top = scene.tile_top.data[place] + 0.005f;
    h.bump = scene.tile_bump.data[place] + 0.001f;
    const float slant = 0.5f * size * (::fabsf(now.plane1) + ::fabsf(now.plane2));
    h.crest = (float)(now.plane0 - gz) + slant + upper(h.top, h.bump) + ROUND;
  }
  unsigned acts = 0;
  EACH_LANE {
    bool comes = false;
    if (lane < slice_count) {
      const int b = A ? x : y;
      comes = s.row_t0[lane] <= s.row_t1[lane] && s.row_b0[lane] < (b + 1) * size && s.row_b1[lane] > b * size &&
              s.row_z0[lane] <= h.crest;
    }
    fold_bits(acts, comes ? 1u << lane : 0u);
  }
  if (acts && now.slot >= 0) {
    const auto& stand = scene.tile_stand.data[place];
    now.height = stand[0];
    now.lean_x = stand[1];
    now.lean_y = stand[2];
    now.share = stand[3];
    now.squeeze = 1.0f / now.height;
    now.prototype = scene.tile_prototype.data[place];
    now.mirror_x = now.prototype & 1 << 16;
    now.mirror_y = now.prototype & 1 << 17;
    now.cut_row = scene.cut_slot.data[now.slot];
    if (scene.sways != 0) {
      auto wave = [&](const wp::vec_t<3, wp::float64>& q) {
        double cycles = q[0] * (double)(gx + x) + q[1] * (double)(gy + y) + q[2];
        cycles = cycles - ::floor(cycles);
        return (float)wp::sin(cycles * 6.283185307179586);
      };
      const float slope = scene.slopes[0] + scene.slopes[1] * wave(scene.wave) + scene.slopes[2] * wave(scene.gust);
      const float aside = slope * now.height;
      now.lean_x += aside * scene.toward[0];
      now.lean_y += aside * scene.toward[1];
    }
    const float* ground = scene.ground.data + (size_t)now.slot * 65 * 65 + now.jy * 8 * 65 + now.jx * 8;
    for (int base = 0; base < 81; base += WARP) EACH_LANE {
      const int i = (base + lane) % 9, j = (base + lane) / 9;
      const float flat = now.plane0 + now.plane1 * (i / 8.0f - 0.5f) * size + now.plane2 * (j / 8.0f - 0.5f) * size;
      fold_low(h.dip, base + lane < 81 ? ground[j * 65 + i] - flat : 0.0f);
    }
    h.dip -= 0.002f;
  }
  EACH_LANE if (lane == 0) {
    s.tile = now;
    s.lift = (float)(now.plane0 - gz);
  }
  return acts;
};

auto visit = [&](int x, int y) {
  Heights h = {0.0f, 0.0f, FAR, 0.0f};
  const unsigned acts = open_tile(x, y, h);
  if (!acts) return;
  int lead = ROOM;
  const unsigned grounds = enter(acts, h, lead);
  if (walkers) {
    set_frame();
    find_ways(lead);
    look(0);
    march(find_cut());
    name_hits();
  }
  if (grounds)
    for (int base = 0; base < count; base += WARP) EACH_LANE {
      const int j = base + lane;
      if (j < count && grounds >> (j / N) & 1 && s.t[j] >= 0.0f) {
        const Four o = four(ray_origin + j), d = four(ray_direction + j), e = four(ray_way + j);
        const float t0 = e.y, t1 = lower(e.z, s.t[j]), kx = (float)x - cast_off(o.w, 0), ky = (float)y - cast_off(o.w, 1);
        const float h1 = d.z - tile.plane1 * d.x - tile.plane2 * d.y, rise = above_ray(o.w);
        const float h0 = o.z - rise - tile.plane1 * (o.x - (kx + 0.5f) * size) - tile.plane2 * (o.y - (ky + 0.5f) * size);
        if (t0 <= t1 && lower(h0 + h1 * t0, h0 + h1 * t1) <= h.bump) {
          float ta = t0, tb = t1;
          if (h1 < 0.0f) ta = upper(ta, (h.bump - h0) / h1);
          if (h1 > 0.0f) tb = lower(tb, (h.bump - h0) / h1);
          hit_ground(j, ta, tb);
        }
      }
    }
};
