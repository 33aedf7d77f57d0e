// Tops of all tiles of pages in memory: the body of one native function (height_kernel.py), after pages.cpp and tops.cpp.

for (int n = 0; n < keys.shape[0]; ++n) {
  const int i = keys.data[2 * n], j = keys.data[2 * n + 1], slot = slot_at(land, i, j);
  for (int tile = 0; tile < 64; ++tile) {
    const int at = 64 * slot + tile, reach = reach_of(land, at);
    write_top(land, i * TILES + (tile & 7), j * TILES + (tile >> 3), at, reach);
    if (reach > land.counters.data[STEM_REACH]) land.counters.data[STEM_REACH] = reach;
  }
}
