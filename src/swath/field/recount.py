"""What is gone from a field, counted anew from the codes of its cells: the check of what cuts returned."""

from collections.abc import Mapping
from itertools import islice, pairwise
from math import fsum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.cut_result import TILE_CELLS, Cut, StemIndex, cell_in_tile
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, PAGE_CUT_CELLS, PAGE_TILES, STANDING, PlantLibrary
from swath.field.pages import Codes, Key, PageData, PageStore, inflate_codes

Ints = NDArray[Any]
TOGETHER = 16  # pages that are made for one look


def recount_pages(store: PageStore, stems: StemIndex, begun: Mapping[Key, int | bytes | None]) -> Cut:
    """Sum over all changed pages, tile by tile and stem by stem, of what is gone against the start.

    begun: packed codes of pages that were not whole at the start
    """
    total, changed = list[Cut](), store.recut_codes()
    while some := dict(islice(changed, TOGETHER)):
        for data, (key, codes) in zip(store.make([*some]), some.items(), strict=True):
            before = begun.get(key)
            start = _full(data.codes if before is None else inflate_codes(before))
            total += _recount_page(stems, store.tile_size / TILE_CELLS, data, start, _full(codes))
    return Cut(
        fsum(c.grain for c in total),
        fsum(c.straw for c in total),
        sum(c.stem_count for c in total),
        fsum(c.area for c in total),
        fsum(c.grain_left for c in total),
    )


def _recount_page(
    stems: StemIndex, cell: float, data: PageData, start: NDArray[np.uint8], now: NDArray[np.uint8]
) -> list[Cut]:
    """What is gone from each changed tile of a page. start, now: codes (512, 512)"""
    ty, tx = np.nonzero(_tiles(start != now).any(axis=(1, 3)))
    stand = data.tile_stand[ty, tx].astype(np.float64)
    mine, tile = _stems_of(stems.library, data.tile_prototype[ty, tx], stand[:, 3])
    row, column = _cells_of(stems.library, mine, data.tile_prototype[ty, tx][tile])
    row, column = row + TILE_CELLS * ty[tile], column + TILE_CELLS * tx[tile]
    then, after = start[row, column], now[row, column]
    moved = then != after
    mine, tile, then, after = mine[moved], tile[moved], then[moved], after[moved]
    was, is_now = (_taken(stems, mine, stand[tile], codes) for codes in (then, after))
    masses = (is_now - was).tolist()
    gone = (then == STANDING) & (after != STANDING) & stems.is_crop[mine]
    counts = np.bincount(tile[gone], minlength=len(ty)).tolist()
    cells = _tiles((start == STANDING) & (now != STANDING)).sum(axis=(1, 3))[ty, tx]
    areas = np.where(stand[:, 3] > 0.0, cells * cell**2, 0.0).tolist()
    ends = np.searchsorted(tile, np.arange(len(ty) + 1)).tolist()
    found = []
    for n, (first, last) in enumerate(pairwise(ends)):
        grain, straw, left = (fsum(mass[first:last]) for mass in masses)
        found.append(Cut(grain, straw, counts[n], areas[n], left))
    return found


def _taken(
    stems: StemIndex, mine: Ints, stand: NDArray[np.float64], codes: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Grain, straw and grain left [kg] that are gone from stems by the codes of their cells, (3, n)."""
    masses, cut = np.zeros((3, len(mine))), codes != STANDING
    masses[:, cut] = stems.taken(mine[cut], stand[cut], codes[cut])
    return masses


def _tiles(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells (512, 512) of a page by tile: row, row in the tile, column, column in the tile."""
    return cells.reshape(PAGE_TILES, TILE_CELLS, PAGE_TILES, TILE_CELLS)


def _stems_of(library: PlantLibrary, prototypes: Ints, share: NDArray[np.float64]) -> tuple[Ints, Ints]:
    """The stems that stand on tiles, and the tile of each. share: of the prototype's stems, (tiles,)"""
    k = prototypes & (MIRROR_X - 1)
    first, after = library.stem_start[k].astype(np.int64), library.stem_start[k + 1].astype(np.int64)
    tile = np.repeat(np.arange(len(k)), after - first)
    before = np.cumsum(after - first) - (after - first)
    mine = np.arange(len(tile)) + (first - before)[tile]
    stands = library.stem_rank[mine] < share[tile]
    return mine[stands], tile[stands]


def _cells_of(library: PlantLibrary, stems: Ints, prototypes: Ints) -> tuple[Ints, Ints]:
    """Row and column in its tile of the cell that each stem stands on."""
    xy = library.stem_xy[stems].astype(np.float64)
    column = cell_in_tile(xy[:, 0], library.tile_size, (prototypes & MIRROR_X) != 0)
    return cell_in_tile(xy[:, 1], library.tile_size, (prototypes & MIRROR_Y) != 0), column


def _full(codes: Codes) -> NDArray[np.uint8]:
    if isinstance(codes, int):
        return np.full((PAGE_CUT_CELLS, PAGE_CUT_CELLS), codes, np.uint8)
    return codes
