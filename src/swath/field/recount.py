"""What is gone from a field, counted anew from the codes of its cells: the check of what cuts returned."""

from collections.abc import Mapping
from math import fsum

import numpy as np
from numpy.typing import NDArray

from swath.field.cut_result import TILE_CELLS, Cut, StemIndex, cell_in_tile
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, PAGE_CUT_CELLS, PAGE_TILES, STANDING
from swath.field.pages import Codes, Key, PageStore, inflate_codes


def recount_pages(store: PageStore, stems: StemIndex, begun: Mapping[Key, int | bytes | None]) -> Cut:
    """Sum over all changed pages, tile by tile and stem by stem, of what is gone against the start.

    begun: packed codes of pages that were not whole at the start
    """
    total, cell = [], store.tile_size / TILE_CELLS
    for key, codes in store.recut_codes():
        data = store.make([key])[0]
        before = begun.get(key)
        start, now = _full(data.codes if before is None else inflate_codes(before)), _full(codes)
        for ty in range(PAGE_TILES):
            for tx in range(PAGE_TILES):
                part = np.s_[ty * TILE_CELLS : (ty + 1) * TILE_CELLS, tx * TILE_CELLS : (tx + 1) * TILE_CELLS]
                if not np.array_equal(start[part], now[part]):
                    stand, prototype = data.tile_stand[ty, tx], int(data.tile_prototype[ty, tx])
                    total.append(_recount_tile(stems, cell, stand, prototype, start[part], now[part]))
    return Cut(
        fsum(c.grain for c in total),
        fsum(c.straw for c in total),
        sum(c.stem_count for c in total),
        fsum(c.area for c in total),
        fsum(c.grain_left for c in total),
    )


def _recount_tile(
    stems: StemIndex,
    cell: float,
    stand: NDArray[np.float32],
    prototype: int,
    start: NDArray[np.uint8],
    now: NDArray[np.uint8],
) -> Cut:
    library = stems.library
    k = prototype & (MIRROR_X - 1)
    mine = np.arange(library.stem_start[k], library.stem_start[k + 1])
    mine = mine[library.stem_rank[mine] < stand[3]]
    xy = library.stem_xy[mine].astype(np.float64)
    ix = cell_in_tile(xy[:, 0], library.tile_size, bool(prototype & MIRROR_X))
    iy = cell_in_tile(xy[:, 1], library.tile_size, bool(prototype & MIRROR_Y))
    then, after = start[iy, ix], now[iy, ix]
    stands = np.broadcast_to(stand.astype(np.float64), (len(mine), 4))
    was, is_now = stems.taken(mine, stands, then), stems.taken(mine, stands, after)
    grain, straw, left = (fsum((b - a).tolist()) for a, b in zip(was, is_now, strict=True))
    newly = (start == STANDING) & (now != STANDING)
    area = float(np.count_nonzero(newly)) * cell**2 if stand[3] > 0.0 else 0.0
    gone = (then == STANDING) & (after != STANDING) & stems.is_crop[mine]
    return Cut(grain, straw, int(np.count_nonzero(gone)), area, left)


def _full(codes: Codes) -> NDArray[np.uint8]:
    if isinstance(codes, int):
        return np.full((PAGE_CUT_CELLS, PAGE_CUT_CELLS), codes, np.uint8)
    return codes
