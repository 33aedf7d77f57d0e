"""The cut, and looks at the crop along lines, compiled; rows of cells and stems are native code.

Rules and units are those of `cut_result.py` here and `field/paging/height_bounds.py`; numbers are float64
without fused multiply-adds.
"""

from pathlib import Path

import warp as wp

from swath.field.cutting.land_kernel import Land, highest_code, slot_at, write_tops

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

_HERE = Path(__file__).parent
# places in `report`; then cells that stood and were cut, stems of the crop that stood, cells that changed
STATUS = wp.constant(0)  # 0 done, 1 pages have to be prepared first, 3 too many pages
PAGE_COUNT = wp.constant(1)


@wp.struct
class Stem:
    """As in `cutting.StemIndex`, in one place, since each is looked up alone; crop: 1, 0 of a weed."""

    rank: wp.float64
    height: wp.float64
    ear: wp.float64
    grain: wp.float64
    straw: wp.float64
    crop: wp.float64


@wp.struct
class Roots:
    """Stems by the cell they stand on, as in `cutting.StemIndex`; those of cell k begin at first[k] and end
    before first[k + 1]. at: number of the stem, column of the cell in its tile.

    straw_exponent: of what of the straw lies above a cut
    """

    first: wp.array(dtype=int)
    at: wp.array(dtype=wp.vec2i)
    stems: wp.array(dtype=Stem)
    straw_exponent: wp.float64


@wp.func
def find_edges(polygon: wp.array2d(dtype=wp.float64), corners: int, edges: wp.array(dtype=wp.vec4d)):
    """Edges of a polygon (n, 2) in cell units: corner x, y, then dx/dy and dy to the next corner."""
    for i in range(corners):
        n = i + 1
        if n == corners:
            n = 0
        ex = polygon[n, 0] - polygon[i, 0]
        ey = polygon[n, 1] - polygon[i, 1]
        slope = wp.float64(0.0)
        if ey != wp.float64(0.0):
            slope = ex / ey
        edges[i] = wp.vec4d(polygon[i, 0], polygon[i, 1], slope, ey)


@wp.func_native((_HERE / "cut_rows.cpp").read_text(encoding="utf-8"))
def cut_rows(
    land: Land,
    roots: Roots,
    edges: wp.array(dtype=wp.vec4d),
    ask: wp.array(dtype=int),
    masses: wp.array(dtype=wp.vec3d),
    pages: wp.array2d(dtype=int),
    tiles: wp.array2d(dtype=wp.uint8),
    report: wp.array(dtype=int),
): ...


@wp.func_native((_HERE / "crop_along.cpp").read_text(encoding="utf-8"))
def look_along(
    land: Land,
    starts: wp.array2d(dtype=wp.float64),
    step: wp.array(dtype=wp.float64),
    crop: wp.array2d(dtype=wp.bool),
    is_missing: wp.array(dtype=int),
): ...


@wp.kernel
def crop_along(
    land: Land,
    starts: wp.array2d(dtype=wp.float64),
    step: wp.array(dtype=wp.float64),
    crop: wp.array2d(dtype=wp.bool),
    is_missing: wp.array(dtype=int),
):
    """Whether crop stands at the middles of steps (2,) from starts (n, 2) on, cell units.

    is_missing: becomes 1 where a page is not in memory
    """
    look_along(land, starts, step, crop, is_missing)


@wp.func_native((_HERE / "standing_cells.cpp").read_text(encoding="utf-8"))
def count_standing(
    land: Land, edges: wp.array(dtype=wp.vec4d), ask: wp.array(dtype=int), report: wp.array(dtype=int)
): ...


@wp.kernel
def standing_cells(
    land: Land,
    polygon: wp.array2d(dtype=wp.float64),
    edges: wp.array(dtype=wp.vec4d),
    ask: wp.array(dtype=int),
    report: wp.array(dtype=int),
):
    """Cells of a polygon on which crop stands; arguments as of `cut_cells`, see standing_cells.cpp."""
    find_edges(polygon, ask[0], edges)
    count_standing(land, edges, ask, report)


@wp.kernel
def cut_cells(
    land: Land,
    roots: Roots,
    polygon: wp.array2d(dtype=wp.float64),
    edges: wp.array(dtype=wp.vec4d),
    ask: wp.array(dtype=int),
    masses: wp.array(dtype=wp.vec3d),
    pages: wp.array2d(dtype=int),
    tiles: wp.array2d(dtype=wp.uint8),
    report: wp.array(dtype=int),
):
    """Brings all cells of a polygon that are higher down to a code. Changes nothing unless STATUS is 0.

    edges: memory for as many corners
    ask: number of corners, first row, last row, code; masses: grain and straw taken of all stems on changed
    cells and grain left [kg], and what of it earlier cuts took; pages: (256, 4) i, j, 1 = some tile of
    it got lower, 1 = some cell of it changed; tiles: (256, 64) 1 = some cell of it changed, 2 = it got
    lower too; report: see above
    """
    find_edges(polygon, ask[0], edges)
    cut_rows(land, roots, edges, ask, masses, pages, tiles, report)
    if report[STATUS] != 0:
        return
    for n in range(report[PAGE_COUNT]):
        slot = slot_at(land, pages[n, 0], pages[n, 1])
        line = land.cut_slot[slot]
        for t in range(64):
            if tiles[n, t] != wp.uint8(0):
                highest = highest_code(land, line, t / 8, t % 8)
                if highest < int(land.code_max[slot, t / 8, t % 8]):
                    land.code_max[slot, t / 8, t % 8] = wp.uint8(highest)
                    tiles[n, t] = wp.uint8(2)
                    pages[n, 2] = 1
    for n in range(report[PAGE_COUNT]):
        if pages[n, 2] != 0:
            for t in range(64):
                if tiles[n, t] == wp.uint8(2):
                    write_tops(land, pages[n, 0] * 8 + t % 8, pages[n, 1] * 8 + t / 8)
