// Bumps of all tiles of pages in memory: the body of one native function (height_kernel.py), after pages.cpp and bumps.cpp.

for (int n = 0; n < keys.shape[0]; ++n)
  for (int slot = slot_at(land, keys.data[2 * n], keys.data[2 * n + 1]), tile = 0; tile < 64; ++tile) land.tile_bump.data[64 * slot + tile] = bump_on(land, slot, tile);
