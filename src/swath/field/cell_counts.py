"""Counting and recounting the cells of pages."""

from dataclasses import dataclass
from math import fsum

import numpy as np
from numpy.typing import NDArray

from swath.field.cut_result import (
    TILE_CELLS,
    Cut,
    StemIndex,
    cell_in_tile,
    rows_inside,
    split_at_tiles,
)
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, PAGE_CUT_CELLS, PAGE_TILES, STANDING
from swath.field.pages import Codes, PageStore, inflate_codes
from swath.field.tile_generator import PageMaker

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
PAGE_CELLS = PAGE_CUT_CELLS * PAGE_CUT_CELLS


@dataclass(frozen=True)
class _Runs:
    """Runs of cells within one tile each. slot: of the page; tile_x, tile_y, cell_x, cell_y: tile in the
    page and first cell in the tile; length [cells].
    """

    slot: Ints
    tile_x: Ints
    tile_y: Ints
    cell_x: Ints
    cell_y: Ints
    length: Ints

    def take(self, which: NDArray[np.bool_]) -> "_Runs":
        """Some of the runs."""
        return _Runs(*(getattr(self, n)[which] for n in self.__dataclass_fields__))


def standing_share(store: PageStore, polygon: Array) -> float:
    """Number of standing cells within a polygon (cell units)."""
    runs = _runs(store, polygon)
    p = store.pages
    fraction = p.tile_stand[runs.slot, runs.tile_y, runs.tile_x, 3]
    row = p.cut_slot[runs.slot]
    runs_alive = fraction > 0.0
    whole = runs_alive & (row == -1 - STANDING)
    total = int(runs.length[whole].sum())
    dense = runs.take(runs_alive & (row >= 0))
    base = p.cut_slot[dense.slot].astype(np.int64) * PAGE_CELLS
    base += (dense.tile_y * TILE_CELLS + dense.cell_y) * PAGE_CUT_CELLS
    base += dense.tile_x * TILE_CELLS + dense.cell_x
    before = np.cumsum(dense.length) - dense.length
    flat = np.arange(int(dense.length.sum())) + np.repeat(base - before, dense.length)
    return total + int(np.count_nonzero(p.cut.reshape(-1)[flat] == STANDING))


def recount_pages(store: PageStore, maker: PageMaker, stems: StemIndex) -> Cut:
    """Sum over all changed pages, tile by tile and stem by stem, of what is gone against the start."""
    total = []
    for key, change in store.changes().items():
        if change.codes is None:
            continue
        data = maker.make(*key)
        start, now = _full(data.codes), _full(inflate_codes(change.codes))
        for ty in range(PAGE_TILES):
            for tx in range(PAGE_TILES):
                part = np.s_[ty * TILE_CELLS : (ty + 1) * TILE_CELLS, tx * TILE_CELLS : (tx + 1) * TILE_CELLS]
                if not np.array_equal(start[part], now[part]):
                    stand, prototype = data.tile_stand[ty, tx], int(data.tile_prototype[ty, tx])
                    total.append(_recount_tile(stems, maker.cell, stand, prototype, start[part], now[part]))
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


def _runs(store: PageStore, polygon: Array) -> _Runs:
    """Cells of a polygon as runs; the pages they lie on are brought into memory."""
    row, first, after = split_at_tiles(*rows_inside(polygon))
    i, j = first // PAGE_CUT_CELLS, row // PAGE_CUT_CELLS
    slot = np.empty(len(row), np.int64)
    if row.size:
        i0, j0, nx = int(i.min()), int(j.min()), int(i.max() - i.min()) + 1
        pair = (j - j0) * nx + (i - i0)
        found = np.flatnonzero(np.bincount(pair))
        places = [(i0 + int(n) % nx, j0 + int(n) // nx) for n in found]
        store.need(places)
        lookup = np.zeros(int(found[-1]) + 1, np.int64)
        for n, key in zip(found, places, strict=True):
            lookup[n] = store.keys[key]
        slot = lookup[pair]
    x, y = first - i * PAGE_CUT_CELLS, row - j * PAGE_CUT_CELLS
    return _Runs(slot, x // TILE_CELLS, y // TILE_CELLS, x % TILE_CELLS, y % TILE_CELLS, after - first)


def _full(codes: Codes) -> NDArray[np.uint8]:
    if isinstance(codes, int):
        return np.full((PAGE_CUT_CELLS, PAGE_CUT_CELLS), codes, np.uint8)
    return codes
