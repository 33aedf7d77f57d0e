"""Tops of tiles: how high a ray has to look for crop.

A stem stands on its own cell but leans over others, and a tile shows every stem whose foot lies within reach
of it. So a tile counts as standing as long as crop stands on it or on a tile within that reach.
"""

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import PAGE_TILES, STANDING, STEM_REACH, PlantLibrary
from swath.field.paging.pages import PageStore
from swath.field.paging.stored_changes import Key
from swath.kernels import filled, launch, start_warp

Ints = NDArray[np.int64]
SLACK = 0.001  # added to tops so that float32 rounding never hides a tip [m]
REACH_MAX = 4  # tiles


def update_tops(store: PageStore, library: PlantLibrary, keys: list[Key], *, sway: float = 0.0) -> None:
    """Write `tile_top` of the pages `keys` and of the pages around them, as far as they are in memory.

    sway: the most that wind leans stems on top of their own lean [m aside per m of height]
    """
    around = {(i + a, j + b) for i, j in keys for a in (-1, 0, 1) for b in (-1, 0, 1)}
    here = sorted(key for key in around if key in store.keys)
    if not here:
        return
    page = np.array(here, dtype=np.int64)
    slots = np.array([store.keys[key] for key in here], dtype=np.int64)
    p = store.pages
    stand = p.tile_stand[slots].astype(np.float64)
    lean = np.hypot(stand[..., 1], stand[..., 2]) + sway * stand[..., 0]
    tiles = np.ceil((library.reach + lean * library.height_max) / library.tile_size).astype(int)
    reach = np.minimum(tiles, REACH_MAX)
    store.counters[STEM_REACH] = max(store.counters[STEM_REACH], int(reach.max()))
    code = _code_around(store, page, int(reach.max()))
    highest = np.zeros(reach.shape, np.uint8)
    for r in range(int(reach.max()) + 1):
        widened = _widest(code, int(reach.max()), r)
        highest = np.where(reach == r, widened, highest)
    top = np.where(highest == STANDING, np.inf, 0.01 * highest)
    top = np.minimum(top, library.height_max * stand[..., 0]) + SLACK
    p.tile_top[slots] = np.where((highest == 0) | (stand[..., 3] <= 0.0), 0.0, top)


def update_bumps(store: PageStore, keys: list[Key]) -> None:
    """Write `tile_bump` of pages in memory: how far ground and straw rise above each tile's plane."""
    if not keys:
        return
    start_warp()
    from swath.field.cutting.bumps_kernel import Bumps, write_bumps

    pools = {name: getattr(store.pages, name) for name in ("ground", "straw", "tile_plane", "tile_bump")}
    slots = np.array([store.keys[key] for key in keys], np.int32)
    launch(write_bumps, filled(Bumps, slots=slots, tile_size=store.tile_size, **pools))


def _code_around(store: PageStore, page: Ints, reach: int) -> NDArray[np.uint8]:
    """Highest codes of the tiles of pages and `reach` tiles around them; STANDING where no page is."""
    p = store.pages
    step = np.arange(-reach, PAGE_TILES + reach)
    tx = (page[:, 0] * PAGE_TILES)[:, None, None] + step
    ty = (page[:, 1] * PAGE_TILES)[:, None, None] + step[:, None]
    tx, ty = np.broadcast_arrays(tx, ty)
    slot = p.slots_at(tx // PAGE_TILES, ty // PAGE_TILES)
    code = store.code_max[slot, ty % PAGE_TILES, tx % PAGE_TILES]
    return np.where(slot >= 0, code, STANDING).astype(np.uint8)


def _widest(code: NDArray[np.uint8], border: int, reach: int) -> NDArray[np.uint8]:
    """Maximum over the tiles within `reach`, (n, 8, 8)."""
    found = np.zeros((len(code), PAGE_TILES, PAGE_TILES), np.uint8)
    for dy in range(border - reach, border + reach + 1):
        for dx in range(border - reach, border + reach + 1):
            np.maximum(found, code[:, dy : dy + PAGE_TILES, dx : dx + PAGE_TILES], out=found)
    return found
