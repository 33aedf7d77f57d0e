"""Pages of the field, and polygons in which they are changed, as kernels see them."""

from typing import Any

import warp as wp


@wp.struct
class Land:
    """As `memory_layout.Pages`. counters, touched, code_max, straw_at: as in `PageStore`.

    turn: cosine and sine of the yaw of the stand, and it; cell_area: of a cell [m2]; sway: as in
    height_bounds.py; laid: room for straw on nodes [kg], depth_per_kg: of straw on a node
    """

    table: wp.array2d(dtype=int)
    table_x: int
    table_y: int
    counters: wp.array(dtype=wp.int64)
    touched: wp.array2d(dtype=int)
    cut_slot: wp.array(dtype=int)
    cut: wp.array3d(dtype=wp.uint8)
    code_max: wp.array3d(dtype=wp.uint8)
    ground: wp.array3d(dtype=float)
    straw: wp.array3d(dtype=float)
    straw_at: wp.array(dtype=wp.int64)
    tile_plane: wp.array4d(dtype=float)
    tile_bump: wp.array3d(dtype=float)
    tile_stand: wp.array3d(dtype=wp.vec4)
    tile_prototype: wp.array3d(dtype=int)
    tile_top: wp.array3d(dtype=float)
    laid: wp.array(dtype=wp.float64)
    turn: wp.vec3d
    tile_size: wp.float64
    cell_area: wp.float64
    height_max: wp.float64
    stem_reach: wp.float64
    sway: wp.float64
    depth_per_kg: wp.float64


@wp.struct
class Stem:
    """As in `cutting.StemIndex`, in one place, since each is looked up alone."""

    rank: float
    height: float
    ear: wp.float64
    grain: wp.float64
    straw: wp.float64


@wp.struct
class Roots:
    """Stems by the line of cells they stand on, as in `cutting.StemIndex`; those of line k begin at first[k]
    and end before first[k + 1].

    taken: of each line a bit for each of its cells with a stem
    at: number n of the stem, of a weed -1 - n; column of its cell in the tile
    straw_exponent: of what of the straw lies above a cut
    """

    taken: wp.array(dtype=wp.uint64)
    first: wp.array(dtype=int)
    at: wp.array(dtype=wp.vec2i)
    stems: wp.array(dtype=Stem)
    straw_exponent: wp.float64


@wp.struct
class Work:
    """Convex polygons in worlds, which compiled code does in order up to one that Python has to: pages are
    missing, or it is refused. needs: becomes 1 then.

    known: (worlds,) how often pages had moved in memory when `lands` were filled in, -1 = they were not; -2:
        the field is a profile, on which straw is but counted
    lands, roots: of each world
    polygons: (worlds, n, ...) number of corners, two numbers that the kernel asks for, x and y of the corners
        [m], counter-clockwise; found: (worlds,) how many there are
    rows: (worlds,) first and last row of cells that counts; of straw: 1 = its pages were just asked for
    sums: (worlds, 8) grain, straw, grain left [kg], area [m2], stems, area swept [m2], polygons done, what
        is lacking
    pages: (worlds, 256, 4) of the polygon that is not done, see the kernels
    """

    needs: wp.array(dtype=int)
    known: wp.array(dtype=wp.int64)
    lands: wp.array(dtype=Land)
    roots: wp.array(dtype=Roots)
    polygons: wp.array3d(dtype=wp.float64)
    found: wp.array(dtype=int)
    rows: wp.array(dtype=wp.vec2i)
    sums: wp.array2d(dtype=wp.float64)
    pages: wp.array3d(dtype=int)


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
