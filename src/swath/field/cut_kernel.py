"""The cut as one serial loop: rows of cells inside a convex polygon, the stems on them, tiles that got lower.

Rules and units are those of `field/cut_result.py` and `field/height_bounds.py`; numbers are float64 without
fused multiply-adds.
"""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

CELLS = wp.constant(64)  # along a tile
PAGE = wp.constant(512)  # cells along a page
STANDING = wp.constant(255)
REACH_MAX = wp.constant(4)  # tiles, as in tops.py
SLACK = wp.constant(wp.float64(0.001))  # as in tops.py
PAGES_MAX = wp.constant(256)  # of one launch
# places in `report`
STATUS = wp.constant(0)  # 0 done, 1 pages have to be prepared first, 3 too many pages
PAGE_COUNT = wp.constant(1)
NEWLY_CUT = wp.constant(2)  # cells
CROP_STEMS = wp.constant(3)  # of the crop, that stood
CHANGED = wp.constant(4)  # cells


@wp.struct
class Land:
    """Pages as in `layout.Pages`, code_max: highest code per tile; lengths [m]; sway: as in tops.py."""

    table: wp.array2d(dtype=int)
    table_x: int
    table_y: int
    cut_slot: wp.array(dtype=int)
    cut: wp.array3d(dtype=wp.uint8)
    code_max: wp.array3d(dtype=wp.uint8)
    tile_stand: wp.array3d(dtype=wp.vec4)
    tile_prototype: wp.array3d(dtype=int)
    tile_top: wp.array3d(dtype=float)
    tile_size: wp.float64
    height_max: wp.float64
    stem_reach: wp.float64
    sway: wp.float64


@wp.struct
class Roots:
    """Stems by the cell they stand on, as in `cutting.StemIndex`; column: of the cell in its tile.

    straw_exponent: of what of the straw lies above a cut
    """

    first: wp.array(dtype=int)
    count: wp.array(dtype=int)
    stem: wp.array(dtype=int)
    column: wp.array(dtype=wp.uint8)
    rank: wp.array(dtype=wp.float64)
    height: wp.array(dtype=wp.float64)
    ear: wp.array(dtype=wp.float64)
    grain: wp.array(dtype=wp.float64)
    straw: wp.array(dtype=wp.float64)
    is_crop: wp.array(dtype=wp.uint8)
    straw_exponent: wp.float64


@wp.func
def floor_div(a: int, b: int) -> int:
    q = a / b
    if a - q * b < 0:
        q = q - 1
    return q


@wp.func
def slot_at(land: Land, i: int, j: int) -> int:
    """Slot of a page, -1 where none is."""
    x = i - land.table_x
    y = j - land.table_y
    if x < 0 or y < 0 or x >= land.table.shape[1] or y >= land.table.shape[0]:
        return -1
    return land.table[y, x]


@wp.func
def row_span(polygon: wp.array2d(dtype=wp.float64), corners: int, row: int) -> wp.vec2i:
    """First cell and cell after the last of a row whose middles lie in the polygon (n, 2), cell units."""
    y = wp.float64(row) + wp.float64(0.5)
    low = wp.float64(-1.0e300)
    high = wp.float64(1.0e300)
    for i in range(corners):
        n = i + 1
        if n == corners:
            n = 0
        ex = polygon[n, 0] - polygon[i, 0]
        ey = polygon[n, 1] - polygon[i, 1]
        if ey != wp.float64(0.0):
            x = polygon[i, 0] + ex / ey * (y - polygon[i, 1])
            if ey > wp.float64(0.0):
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
def taken_of(roots: Roots, stem: int, stand: wp.vec4, code: int) -> wp.vec3d:
    """Grain and straw that a cut at this code takes of a stem, and grain that it leaves [kg]."""
    scale = wp.float64(stand[0])
    lean_x = wp.float64(stand[1])
    lean_y = wp.float64(stand[2])
    cut_height = wp.float64(0.01) * wp.float64(code)
    share = wp.float64(1.0) - cut_height / (roots.height[stem] * scale)
    above = wp.min(wp.max(share, wp.float64(0.0)), wp.float64(1.0))
    length = wp.sqrt(scale * scale + lean_x * lean_x + lean_y * lean_y)
    straw = roots.straw[stem] * length * wp.pow(above, roots.straw_exponent)
    grain = roots.grain[stem]
    if roots.ear[stem] * scale > cut_height:
        return wp.vec3d(grain, straw, wp.float64(0.0))
    return wp.vec3d(wp.float64(0.0), straw, grain)


@wp.func
def reach_of(land: Land, slot: int, ty: int, tx: int) -> int:
    """How many tiles away crop may stand that this tile shows."""
    stand = land.tile_stand[slot, ty, tx]
    x = wp.float64(stand[1])
    y = wp.float64(stand[2])
    lean = wp.sqrt(x * x + y * y) + land.sway * wp.float64(stand[0])
    return wp.min(int(wp.ceil((land.stem_reach + lean * land.height_max) / land.tile_size)), REACH_MAX)


@wp.func
def code_at(land: Land, tile_x: int, tile_y: int) -> int:
    """Highest code of a tile by its number from the origin; STANDING where no page is."""
    i = floor_div(tile_x, 8)
    j = floor_div(tile_y, 8)
    slot = slot_at(land, i, j)
    if slot < 0:
        return STANDING
    return int(land.code_max[slot, tile_y - j * 8, tile_x - i * 8])


@wp.func
def write_tops(land: Land, tile_x: int, tile_y: int):
    """`tile_top` of every tile that shows what stood on this one."""
    for v in range(tile_y - REACH_MAX, tile_y + REACH_MAX + 1):
        for u in range(tile_x - REACH_MAX, tile_x + REACH_MAX + 1):
            i = floor_div(u, 8)
            j = floor_div(v, 8)
            slot = slot_at(land, i, j)
            if slot >= 0:
                ty = v - j * 8
                tx = u - i * 8
                reach = reach_of(land, slot, ty, tx)
                if wp.abs(u - tile_x) <= reach and wp.abs(v - tile_y) <= reach:
                    highest = int(0)
                    for b in range(v - reach, v + reach + 1):
                        for a in range(u - reach, u + reach + 1):
                            highest = wp.max(highest, code_at(land, a, b))
                    stand = land.tile_stand[slot, ty, tx]
                    top = land.height_max * wp.float64(stand[0])
                    if highest < STANDING:
                        top = wp.min(top, wp.float64(0.01) * wp.float64(highest))
                    top = top + SLACK
                    if highest == 0 or stand[3] <= 0.0:
                        top = wp.float64(0.0)
                    land.tile_top[slot, ty, tx] = float(top)


@wp.func
def highest_code(land: Land, row: int, ty: int, tx: int) -> int:
    """Highest code on a tile; its corners first, since most tiles are not cut wholly."""
    y0 = ty * CELLS
    x0 = tx * CELLS
    last = CELLS - 1
    highest = wp.max(
        wp.max(int(land.cut[row, y0, x0]), int(land.cut[row, y0, x0 + last])),
        wp.max(int(land.cut[row, y0 + last, x0]), int(land.cut[row, y0 + last, x0 + last])),
    )
    for y in range(CELLS):
        if highest == STANDING:
            return highest
        for x in range(CELLS):
            highest = wp.max(highest, int(land.cut[row, y0 + y, x0 + x]))
    return highest


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
def variant_of(land: Land, slot: int, ty: int, tx: int) -> int:
    """First cell of a tile's prototype, mirrored as it is, in the numbering of `Roots`."""
    p = land.tile_prototype[slot, ty, tx]
    mirror = (p >> 16) & 3
    return ((p & 65535) * 4 + mirror) * (CELLS * CELLS)


@wp.func
def is_ready(land: Land, slot: int, code: int) -> bool:
    """In memory, and with a row of codes of its own unless it is this low already."""
    return slot >= 0 and (land.cut_slot[slot] >= 0 or -1 - land.cut_slot[slot] <= code)


@wp.func
def list_pages(
    land: Land,
    polygon: wp.array2d(dtype=wp.float64),
    ask: wp.array(dtype=int),
    pages: wp.array2d(dtype=int),
    tiles: wp.array2d(dtype=wp.uint8),
    report: wp.array(dtype=int),
) -> bool:
    """The pages of a cut; True when all are ready."""
    code = ask[3]
    count = int(0)
    last = int(-1)
    ready = int(1)
    for row in range(ask[1], ask[2] + 1):
        span = row_span(polygon, ask[0], row)
        j = floor_div(row, PAGE)
        c = span[0]
        while c < span[1]:
            i = floor_div(c, PAGE)
            after = wp.min((floor_div(c, CELLS) + 1) * CELLS, span[1])
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
    ask: wp.array(dtype=int),
    masses: wp.array(dtype=wp.vec3d),
    pages: wp.array2d(dtype=int),
    tiles: wp.array2d(dtype=wp.uint8),
    report: wp.array(dtype=int),
):
    """Brings all cells of a polygon that are higher down to a code. Changes nothing unless STATUS is 0.

    ask: number of corners, first row, last row, code; masses: grain and straw taken of all stems on changed
    cells and grain left [kg], and what of it earlier cuts took; pages: (PAGES_MAX, 3) i, j, 1 = some tile of
    it got lower; tiles: (PAGES_MAX, 64) 1 = some cell of it changed, 2 = it got lower too; report: see above
    """
    if not list_pages(land, polygon, ask, pages, tiles, report):
        return
    code = ask[3]
    last = int(-1)
    taken = wp.vec3d()
    again = wp.vec3d()
    newly = int(0)
    crop = int(0)
    changed = int(0)
    for row in range(ask[1], ask[2] + 1):
        span = row_span(polygon, ask[0], row)
        j = floor_div(row, PAGE)
        y = row - j * PAGE
        ty = y / CELLS
        c = span[0]
        while c < span[1]:
            i = floor_div(c, PAGE)
            after = wp.min((floor_div(c, CELLS) + 1) * CELLS, span[1])
            slot = slot_at(land, i, j)
            line = land.cut_slot[slot]
            if line >= 0:
                x = c - i * PAGE
                tx = x / CELLS
                stand = land.tile_stand[slot, ty, tx]
                cell = variant_of(land, slot, ty, tx) + (y % CELLS) * CELLS + x % CELLS
                end = cell + after - c - 1
                rank = wp.float64(stand[3])
                for s in range(roots.first[cell], roots.first[end] + roots.count[end]):
                    stem = roots.stem[s]
                    old = int(land.cut[line, y, tx * CELLS + int(roots.column[s])])
                    if old > code and roots.rank[stem] < rank:
                        taken += taken_of(roots, stem, stand, code)
                        if old == STANDING:
                            crop += int(roots.is_crop[stem])
                        else:
                            again += taken_of(roots, stem, stand, old)
                count = int(0)
                stood = int(0)
                for k in range(x, x + after - c):
                    old = int(land.cut[line, y, k])
                    if old > code:
                        land.cut[line, y, k] = wp.uint8(code)
                        count += 1
                        if old == STANDING:
                            stood += 1
                changed += count
                if stand[3] > 0.0:
                    newly += stood
                if count > 0:
                    last = page_number(pages, report[PAGE_COUNT], last, i, j)
                    tiles[last, ty * 8 + tx] = wp.uint8(1)
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
