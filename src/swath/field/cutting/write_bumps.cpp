// Bumps of all tiles of pages: the body of one native function (bumps_kernel.py), after bumps.cpp.

for (int n = 0; n < its.slots.shape[0]; ++n)
  for (int slot = its.slots.data[n], tile = 0; tile < 64; ++tile) its.tile_bump.data[64 * slot + tile] = bump_on(its, slot, tile);
