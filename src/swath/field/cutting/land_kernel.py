"""Pages of the field as the kernels of the cut see them; tiles that got lower.

Units are those of `field/paging/height_bounds.py`; numbers are float64 without fused multiply-adds.
"""

from typing import Any

import warp as wp

CELLS = wp.constant(64)  # along a tile
STANDING = wp.constant(255)
REACH_MAX = wp.constant(4)  # tiles, as in height_bounds.py
SLACK = wp.constant(wp.float64(0.001))  # as in height_bounds.py


@wp.struct
class Land:
    """As `memory_layout.Pages`; code_max: highest code per tile; [m]; sway: as in height_bounds.py."""

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


@wp.func
def floor_div(a: int, b: int) -> int:
    """Floor of a / b for b > 0."""
    q = a / b
    if a - q * b < 0:
        q = q - 1
    return q


@wp.func
def slot_at(land: Any, i: int, j: int) -> int:
    """Slot of a page, -1 where none is. land: a struct with a table as in `memory_layout.Pages`."""
    x = i - land.table_x
    y = j - land.table_y
    if x < 0 or y < 0 or x >= land.table.shape[1] or y >= land.table.shape[0]:
        return -1
    return land.table[y, x]


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
