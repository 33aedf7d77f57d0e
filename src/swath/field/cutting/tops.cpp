// Before the body of a native function, after pages.cpp: how high a ray has to look for crop over a tile (height_bounds.py).

auto reach_of = [](const auto& land, int at) -> int {  // how many tiles away crop may stand that a tile shows; at: of it in the pools
  constexpr int REACH_MAX = 4;  // as in height_bounds.py
  const auto& stand = land.tile_stand.data[at];
  const double x = stand[1], y = stand[2], lean = __builtin_sqrt(x * x + y * y) + land.sway * (double)stand[0];
  const int tiles = (int)__builtin_ceil((land.stem_reach + lean * land.height_max) / land.tile_size);
  return tiles < REACH_MAX ? tiles : REACH_MAX;
};
auto write_top = [&](const auto& land, int u, int v, int at, int reach) {  // of tile (u, v) from the origin
  int highest = 0;  // code of those that it shows, STANDING where no page is
  for (int b = v - reach; b <= v + reach; ++b)
    for (int a = u - reach; a <= u + reach; ++a) {
      const int slot = slot_at(land, a >> 3, b >> 3), code = slot < 0 ? STANDING : land.code_max.data[64 * slot + (b & 7) * 8 + (a & 7)];
      highest = code > highest ? code : highest;
    }
  const double whole = land.height_max * (double)land.tile_stand.data[at][0], cut = 0.01 * highest, top = highest < STANDING && cut < whole ? cut : whole;
  land.tile_top.data[at] = highest == 0 || land.tile_stand.data[at][3] <= 0.0f ? 0.0f : (float)(top + 0.001);  // SLACK, as there
};
