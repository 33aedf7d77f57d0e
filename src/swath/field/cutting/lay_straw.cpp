// Straw on the nodes in and around polygons in a world: the body of one native function (cut_kernel.py), after pages.cpp and bumps.cpp.
//
// In: `its` as `Work`, of a polygon the mass [kg] and a heading [rad] in the world: straw lies as a ridge along it, a parabola across; nan =
// even. Every point of a lattice over it, less than SPACING apart, lays its share on the four nodes around. Out: what Python lacks to lay,
// how many masses `land.laid` has to hold, and its nodes in `pages`: first and last column, first and last row.

constexpr double SPACING = 0.5;  // of the points, in nodes
constexpr int NODES = 64, ROW = NODES + 1;
const bool is_counted = its.known.data[w] == COUNTED;
each_polygon(w, its, [&](const auto& land, const Asked& polygon, double* sums) -> bool {
  if (is_counted) {
    land.laid.data[0] += polygon.first;
    return true;
  }
  const int corners = (int)polygon.corners;
  const double mass = polygon.first, node = land.tile_size / TILES, cos_yaw = land.turn[0], sin_yaw = land.turn[1];
  const bool is_ridge = polygon.second == polygon.second;
  Point at[CORNERS_MAX];  // in nodes of the stand frame
  double along = 1.0, up = 0.0, middle = 0.0, half = 1.0;
  if (is_ridge) along = wp::cos(polygon.second - land.turn[2]), up = wp::sin(polygon.second - land.turn[2]);
  double low = __builtin_inf(), high = -__builtin_inf();
  for (int k = 0; k < corners; ++k) {
    const Point p = polygon.at[k];
    at[k] = {(cos_yaw * p.x + sin_yaw * p.y) / node, (cos_yaw * p.y - sin_yaw * p.x) / node};
    const double across = along * at[k].y - up * at[k].x;
    low = across < low ? across : low, high = across > high ? across : high;
  }
  if (is_ridge) middle = 0.5 * (high + low), half = 0.5 * (high - low) > 1.0e-9 ? 0.5 * (high - low) : 1.0e-9;
  // ---- Which nodes, then how much lies on each
  double total = 0.0, per_weight = 0.0;
  double* laid = land.laid.data;
  int u0 = 1 << 30, v0 = 1 << 30, u1 = -(1 << 30), v1 = -(1 << 30), columns = 0;
  auto each_point = [&](bool lays) {
    for (int corner = 1; corner < corners - 1; ++corner) {
      const Point a = at[0], e = {at[corner].x - a.x, at[corner].y - a.y}, f = {at[corner + 1].x - a.x, at[corner + 1].y - a.y};
      const Point sides[3] = {e, f, {f.x - e.x, f.y - e.y}};
      double longest = 0.0;
      for (const Point& side : sides) {
        const double length = __builtin_sqrt(side.x * side.x + side.y * side.y);
        longest = length > longest ? length : longest;
      }
      const int parts = (int)__builtin_ceil(longest / SPACING), n = parts > 1 ? parts : 1;
      const double area = 0.5 * __builtin_fabs(e.x * f.y - e.y * f.x) / (double)(n * n);
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n - j; ++i)
          for (int far = 0; far < (i + j < n - 1 ? 2 : 1); ++far) {
            const double third = (1.0 + far) / 3.0, x = (i + third) / n, y = (j + third) / n;
            const double px = a.x + e.x * x + f.x * y, py = a.y + e.y * x + f.y * y, low_x = __builtin_floor(px), low_y = __builtin_floor(py);
            const double off = (along * py - up * px - middle) / half, high = 1.0 - off * off;
            const double weight = area * (!is_ridge ? 1.0 : high > 0.0 ? high : 0.0);
            const int u = (int)low_x, v = (int)low_y;
            if (!lays) {
              total += weight;
              u0 = u < u0 ? u : u0, v0 = v < v0 ? v : v0, u1 = u + 1 > u1 ? u + 1 : u1, v1 = v + 1 > v1 ? v + 1 : v1;
              continue;
            }
            const double share = weight * per_weight, fx = px - low_x, fy = py - low_y, gx = 1.0 - fx, gy = 1.0 - fy;
            double* k = laid + (long long)(v - v0) * columns + u - u0;
            k[0] = k[0] + gx * gy * share, k[1] = k[1] + fx * gy * share;
            k[columns] = k[columns] + gx * fy * share, k[columns + 1] = k[columns + 1] + fx * fy * share;
          }
    }
  };
  each_point(false);
  if (!(total > 0.0)) return true;
  columns = u1 - u0 + 1, per_weight = mass / total;
  int* told = its.pages.data + 4 * PAGES_MAX * w;
  told[0] = u0, told[1] = u1, told[2] = v0, told[3] = v1;
  sums[LACKED] = (double)columns * (v1 - v0 + 1);
  if (sums[LACKED] > land.laid.shape[0]) return false;
  __builtin_memset(laid, 0, (size_t)sums[LACKED] * sizeof *laid);
  each_point(true);
  // ---- The pages: are all of them ready, with memory for the masses that they get? Then they get these
  const bool is_used = its.rows.data[w][0] == 1;  // they were just asked for
  if (!is_used && !has_room(land, ((u1 >> 6) - (u0 >> 6) + 1) * ((v1 >> 6) - (v0 >> 6) + 1))) return false;
  for (int lays = 0; lays < 2; ++lays)
    for (int j = v0 >> 6; j <= v1 >> 6; ++j)
      for (int i = u0 >> 6; i <= u1 >> 6; ++i) {
        const int slots[4] = {slot_at(land, i, j), slot_at(land, i - 1, j), slot_at(land, i, j - 1), slot_at(land, i - 1, j - 1)};
        const int left = u0 > i * NODES ? u0 : i * NODES, right = u1 < i * NODES + NODES - 1 ? u1 : i * NODES + NODES - 1;
        const int below = v0 > j * NODES ? v0 : j * NODES, above = v1 < j * NODES + NODES - 1 ? v1 : j * NODES + NODES - 1;
        bool gets_some = false;
        for (int v = below; v <= above && !gets_some; ++v)
#pragma clang loop vectorize(disable) unroll(disable)
          for (int u = left; u <= right; ++u) gets_some |= laid[(long long)(v - v0) * columns + u - u0] != 0.0;
        if (slots[0] < 0 || (gets_some && !land.straw_at.data[slots[0]])) return false;
        if (!lays) continue;
        if (!is_used) touch(land, Used{i, j, 0, 0});
        double* masses = (double*)land.straw_at.data[slots[0]];
        for (int v = below; gets_some && v <= above; ++v)
#pragma clang loop vectorize(disable) unroll(disable)
          for (int u = left; u <= right; ++u) {
            double& own = masses[(v & 63) * NODES + (u & 63)];
            own += laid[(long long)(v - v0) * columns + u - u0];
            for (int side = 0; side < 4; ++side) {  // on it, and on the borders where its neighbours show the node
              const int to_u = (u & 63) + (side & 1) * NODES, to_v = (v & 63) + (side >> 1) * NODES;
              if (slots[side] >= 0 && to_u <= NODES && to_v <= NODES) land.straw.data[(slots[side] * ROW + to_v) * ROW + to_u] = (float)(own * land.depth_per_kg);
            }
          }
      }
  for (int v = (v0 - 1) >> 3; v <= v1 >> 3; ++v)
    for (int u = (u0 - 1) >> 3; u <= u1 >> 3; ++u) {
      const int slot = slot_at(land, u >> 3, v >> 3), tile = (v & 7) * TILES + (u & 7);
      if (slot >= 0) land.tile_bump.data[64 * slot + tile] = bump_on(land, slot, tile);
    }
  ++land.counters.data[REVISION];
  sums[LACKED] = 0.0;
  return true;
}, is_counted);
