"""The cut as one serial loop: rows of cells inside a convex polygon, and the stems on them.

Rules and units are those of `field/cut_result.py` and `field/height_bounds.py`; numbers are float64 without
fused multiply-adds.
"""

import warp as wp

from swath.field.land_kernel import (
    CELLS,
    PAGE,
    STANDING,
    Land,
    floor_div,
    highest_code,
    is_ready,
    slot_at,
    variant_of,
    write_tops,
)

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

PAGES_MAX = wp.constant(256)  # of one launch
ROWS_KEPT = wp.constant(2048)  # of which the span is known in the second pass
# places in `report`
STATUS = wp.constant(0)  # 0 done, 1 pages have to be prepared first, 3 too many pages
PAGE_COUNT = wp.constant(1)
NEWLY_CUT = wp.constant(2)  # cells
CROP_STEMS = wp.constant(3)  # of the crop, that stood
CHANGED = wp.constant(4)  # cells


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
    before first[k + 1]. at: number of the stem, column of the cell in its tile

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


@wp.func
def row_span(edges: wp.array(dtype=wp.vec4d), corners: int, row: int) -> wp.vec2i:
    """First cell and cell after the last of a row whose middles lie in the polygon of these edges."""
    y = wp.float64(row) + wp.float64(0.5)
    low = wp.float64(-1.0e300)
    high = wp.float64(1.0e300)
    for i in range(corners):
        edge = edges[i]
        if edge[3] != wp.float64(0.0):
            x = edge[0] + edge[2] * (y - edge[1])
            if edge[3] > wp.float64(0.0):
                high = wp.min(high, x)
            else:
                low = wp.max(low, x)
    if low < wp.float64(-1.0e299) or high > wp.float64(1.0e299):
        return wp.vec2i(0, 0)
    first = int(wp.ceil(low - wp.float64(0.5)))
    after = int(wp.floor(high - wp.float64(0.5))) + 1
    return wp.vec2i(first, after)


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
    half = wp.float64(0.5)
    for n in range(crop.shape[0]):
        slot = int(-1)
        page_x = int(0)
        page_y = int(0)
        for k in range(crop.shape[1]):
            along = wp.float64(k) + half
            x = int(wp.floor(starts[n, 0] + step[0] * along))
            y = int(wp.floor(starts[n, 1] + step[1] * along))
            i = floor_div(x, PAGE)
            j = floor_div(y, PAGE)
            if slot < 0 or i != page_x or j != page_y:
                slot = slot_at(land, i, j)
                page_x = i
                page_y = j
                if slot < 0:
                    is_missing[0] = 1
                    return
            x = x - i * PAGE
            y = y - j * PAGE
            line = land.cut_slot[slot]
            code = -1 - line
            if line >= 0:
                code = int(land.cut[line, y, x])
            stands = code == STANDING and land.tile_stand[slot, y / CELLS, x / CELLS][3] > 0.0
            crop[n, k] = stands


@wp.func
def length_of(stand: wp.vec4) -> wp.float64:
    """Length of the stems of a tile, over that in the library."""
    scale = wp.float64(stand[0])
    lean_x = wp.float64(stand[1])
    lean_y = wp.float64(stand[2])
    return wp.sqrt(scale * scale + lean_x * lean_x + lean_y * lean_y)


@wp.func
def taken_of(stem: Stem, exponent: wp.float64, scale: wp.float64, length: wp.float64, code: int) -> wp.vec3d:
    """Grain and straw that a cut at this code takes of a stem, and grain that it leaves [kg]."""
    cut_height = wp.float64(0.01) * wp.float64(code)
    share = wp.float64(1.0) - cut_height / (stem.height * scale)
    above = wp.min(wp.max(share, wp.float64(0.0)), wp.float64(1.0))
    straw = stem.straw * length * wp.pow(above, exponent)
    grain = stem.grain
    if stem.ear * scale > cut_height:
        return wp.vec3d(grain, straw, wp.float64(0.0))
    return wp.vec3d(wp.float64(0.0), straw, grain)


@wp.func
def page_number(pages: wp.array2d(dtype=int), count: int, last: int, i: int, j: int) -> int:
    """Place of page (i, j) in the list of those of this cut, -1 when it is not in it."""
    if last >= 0 and pages[last, 0] == i and pages[last, 1] == j:
        return last
    for n in range(count):
        if pages[n, 0] == i and pages[n, 1] == j:
            return n
    return -1


@wp.func
def list_pages(
    land: Land,
    edges: wp.array(dtype=wp.vec4d),
    spans: wp.array(dtype=wp.vec2i),
    ask: wp.array(dtype=int),
    pages: wp.array2d(dtype=int),
    tiles: wp.array2d(dtype=wp.uint8),
    report: wp.array(dtype=int),
) -> bool:
    """The pages of a cut, and the spans of its first rows; True when all pages are ready."""
    code = ask[3]
    count = int(0)
    last = int(-1)
    ready = int(1)
    low_i = int(0)  # pages of the last row that was looked at
    high_i = int(-1)
    listed_j = int(0)
    for row in range(ask[1], ask[2] + 1):
        span = row_span(edges, ask[0], row)
        if row - ask[1] < ROWS_KEPT:
            spans[row - ask[1]] = span
        j = floor_div(row, PAGE)
        c = span[0]
        if c < span[1]:
            first_i = floor_div(c, PAGE)
            last_i = floor_div(span[1] - 1, PAGE)
            if j == listed_j and first_i >= low_i and last_i <= high_i:
                c = span[1]
            low_i = first_i
            high_i = last_i
            listed_j = j
        while c < span[1]:
            i = floor_div(c, PAGE)
            after = wp.min((i + 1) * PAGE, span[1])
            last = page_number(pages, count, last, i, j)
            if last < 0:
                if count == PAGES_MAX:
                    report[STATUS] = 3
                    return False
                last = count
                count += 1
                pages[last, 0] = i
                pages[last, 1] = j
                pages[last, 2] = 0
                pages[last, 3] = 0
                for t in range(64):
                    tiles[last, t] = wp.uint8(0)
            slot = slot_at(land, i, j)
            if not is_ready(land, slot, code):
                ready = 0
            c = after
    report[PAGE_COUNT] = count
    if ready == 0:
        report[STATUS] = 1
        return False
    report[STATUS] = 0
    return True


@wp.kernel
def cut_cells(
    land: Land,
    roots: Roots,
    polygon: wp.array2d(dtype=wp.float64),
    edges: wp.array(dtype=wp.vec4d),
    spans: wp.array(dtype=wp.vec2i),
    ask: wp.array(dtype=int),
    masses: wp.array(dtype=wp.vec3d),
    pages: wp.array2d(dtype=int),
    tiles: wp.array2d(dtype=wp.uint8),
    report: wp.array(dtype=int),
):
    """Brings all cells of a polygon that are higher down to a code. Changes nothing unless STATUS is 0.

    edges, spans: memory for as many corners and ROWS_KEPT rows
    ask: number of corners, first row, last row, code; masses: grain and straw taken of all stems on changed
    cells and grain left [kg], and what of it earlier cuts took; pages: (PAGES_MAX, 4) i, j, 1 = some tile of
    it got lower, 1 = some cell of it changed; tiles: (PAGES_MAX, 64) 1 = some cell of it changed, 2 = it got
    lower too; report: see above
    """
    find_edges(polygon, ask[0], edges)
    if not list_pages(land, edges, spans, ask, pages, tiles, report):
        return
    code = ask[3]
    last = int(-1)
    taken = wp.vec3d()
    again = wp.vec3d()
    newly = int(0)
    crop = int(0)
    changed = int(0)
    tile = wp.vec2i(0, 0)  # the last one, by its number from the origin, and what holds on all of it
    is_first = int(1)
    page_x = int(0)
    number = int(0)
    line = int(-1)
    variant = int(0)
    rank = wp.float64(0.0)
    scale = wp.float64(0.0)
    length = wp.float64(0.0)
    for row in range(ask[1], ask[2] + 1):
        span = spans[wp.min(row - ask[1], ROWS_KEPT - 1)]
        if row - ask[1] >= ROWS_KEPT:
            span = row_span(edges, ask[0], row)
        tile_y = floor_div(row, CELLS)
        j = floor_div(tile_y, 8)
        y = row - j * PAGE
        c = span[0]
        while c < span[1]:
            tile_x = floor_div(c, CELLS)
            after = wp.min((tile_x + 1) * CELLS, span[1])
            if is_first == 1 or tile_x != tile[0] or tile_y != tile[1]:
                is_first = 0
                tile = wp.vec2i(tile_x, tile_y)
                i = floor_div(tile_x, 8)
                page_x = i * PAGE
                slot = slot_at(land, i, j)
                line = land.cut_slot[slot]
                tx = tile_x - i * 8
                ty = tile_y - j * 8
                stand = land.tile_stand[slot, ty, tx]
                variant = variant_of(land, slot, ty, tx)
                rank = wp.float64(stand[3])
                scale = wp.float64(stand[0])
                length = length_of(stand)
                last = page_number(pages, report[PAGE_COUNT], last, i, j)
                number = ty * 8 + tx
            if line >= 0:
                x = c - page_x
                corner = x - x % CELLS
                cell = variant + (y % CELLS) * CELLS + x - corner
                for s in range(roots.first[cell], roots.first[cell + after - c]):
                    at = roots.at[s]
                    old = int(land.cut[line, y, corner + at[1]])
                    if old > code:
                        stem = roots.stems[at[0]]
                        if stem.rank < rank:
                            taken += taken_of(stem, roots.straw_exponent, scale, length, code)
                            if old == STANDING:
                                crop += int(stem.crop)
                            else:
                                again += taken_of(stem, roots.straw_exponent, scale, length, old)
                count = int(0)
                for k in range(x, x + after - c):
                    old = int(land.cut[line, y, k])
                    if old > code:
                        land.cut[line, y, k] = wp.uint8(code)
                        count += 1
                        if old == STANDING and rank > wp.float64(0.0):
                            newly += 1
                changed += count
                if count > 0:
                    tiles[last, number] = wp.uint8(1)
                    pages[last, 3] = 1
            c = after
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
    masses[0] = taken
    masses[1] = again
    report[NEWLY_CUT] = newly
    report[CROP_STEMS] = crop
    report[CHANGED] = changed
