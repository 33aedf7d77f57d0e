// Before the body of a native function: how far ground and straw rise above a tile's plane [m], over its 9 x 9 nodes.

auto bump_on = [](const auto& land, int slot, int tile) -> float {
  constexpr int STEPS = 8, ROW = 65;  // nodes along a tile, and of a page
  const int first = (slot * ROW + (tile >> 3) * STEPS) * ROW + (tile & 7) * STEPS;
  const float *ground = land.ground.data + first, *straw = land.straw.data + first, *plane = land.tile_plane.data + 3 * (64 * slot + tile);
  const double height = plane[0], slope_x = plane[1], slope_y = plane[2];
  double found = -__builtin_inf();
  for (int v = 0; v <= STEPS; ++v)
    for (int u = 0; u <= STEPS; ++u) {
      const double x = ((double)u / STEPS - 0.5) * land.tile_size, y = ((double)v / STEPS - 0.5) * land.tile_size;
      const double over = (double)(ground[v * ROW + u] + straw[v * ROW + u]) - (height + slope_x * x + slope_y * y);
      found = over > found ? over : found;
    }
  return (float)found;
};
