"""One ray through a grid of measured heights: solids, then tiles, then cells, the first surface above it."""

import warp as wp

from swath.rays.kernel.cast import hit_things
from swath.rays.kernel.scene import Hit, Things

NOTHING = wp.constant(0)
MEASURED = wp.constant(1)
UNMEASURED = wp.constant(2)
SOLID = wp.constant(3)
FAR = wp.constant(1.0e9)
MIX_A = wp.constant(wp.uint32(0x7FEB352D))
MIX_B = wp.constant(wp.uint32(0x846CA68B))


@wp.struct
class Heights:
    """A `HeightGrid`. tile_top: highest surface in a tile above origin z, ground where nothing was measured

    cut: per cell 255 = as measured, else stubble height [cm]
    """

    origin: wp.vec3d
    turn: wp.vec2d
    cell: float
    tile: int
    levels: int
    none: int
    node_cells: int
    table: wp.array2d(dtype=int)
    tile_top: wp.array2d(dtype=float)
    quantiles: wp.array4d(dtype=wp.int16)
    cut: wp.array3d(dtype=wp.uint8)
    ground: wp.array2d(dtype=float)


@wp.struct
class Draw:
    """How a height is drawn. seed: of this scan; level: the quantile of all beams, -1 = drawn per foot cell

    grain: side of the cells in which beams that end there draw the same [m]
    """

    seed: wp.uint32
    level: int
    grain: float


@wp.func
def mix(h: wp.uint32) -> wp.uint32:
    """lowbias32, C. Wellons, hash-prospector (public domain)."""
    h = h ^ (h >> wp.uint32(16))
    h = h * MIX_A
    h = h ^ (h >> wp.uint32(15))
    h = h * MIX_B
    return h ^ (h >> wp.uint32(16))


@wp.func
def ground_at(g: Heights, x: float, y: float) -> float:
    node = g.cell * float(g.node_cells)
    fx = wp.clamp(x / node, 0.0, float(g.ground.shape[1] - 1))
    fy = wp.clamp(y / node, 0.0, float(g.ground.shape[0] - 1))
    i = wp.min(int(fx), g.ground.shape[1] - 2)
    j = wp.min(int(fy), g.ground.shape[0] - 2)
    fx = fx - float(i)
    fy = fy - float(j)
    low = g.ground[j, i] + (g.ground[j, i + 1] - g.ground[j, i]) * fx
    high = g.ground[j + 1, i] + (g.ground[j + 1, i + 1] - g.ground[j + 1, i]) * fx
    return low + (high - low) * fy


@wp.func
def slab(o: float, d: float, low: float, high: float) -> wp.vec2:
    """t of entry and exit between two planes."""
    if wp.abs(d) < 1.0e-9:
        if o < low or o >= high:
            return wp.vec2(FAR, -FAR)
        return wp.vec2(-FAR, FAR)
    a = (low - o) / d
    b = (high - o) / d
    return wp.vec2(wp.min(a, b), wp.max(a, b))


@wp.func
def exit_of(o: float, d: float, index: int, side: float) -> float:
    """t at which a ray leaves column `index` of width `side`."""
    if wp.abs(d) < 1.0e-9:
        return FAR
    edge = float(index) * side
    if d > 0.0:
        edge = edge + side
    return (edge - o) / d


@wp.func
def draw_level(g: Heights, draw: Draw, o: wp.vec3, d: wp.vec3, range_max: float) -> int:
    if draw.level >= 0:
        return draw.level
    t = range_max
    if d[2] < -1.0e-6:
        t = wp.clamp((ground_at(g, o[0], o[1]) - o[2]) / d[2], 0.0, range_max)
    i = int(wp.floor((o[0] + d[0] * t) / draw.grain))
    j = int(wp.floor((o[1] + d[1] * t) / draw.grain))
    h = mix(mix(draw.seed ^ mix(wp.uint32(i))) ^ wp.uint32(j))
    return int(h >> wp.uint32(16)) * g.levels / 65536


@wp.func
def walk(g: Heights, o: wp.vec3, d: wp.vec3, level: int, t_max: float) -> wp.vec3:
    """(t, what, index of the cell). The cell is -1 where there is none."""
    side = g.cell * float(g.tile)
    width = side * float(g.table.shape[1])
    length = side * float(g.table.shape[0])
    sx = slab(o[0], d[0], 0.0, width)
    sy = slab(o[1], d[1], 0.0, length)
    t = wp.max(wp.max(sx[0], sy[0]), 0.0)
    t_out = wp.min(sx[1], sy[1])
    if t >= t_out:  # passes beside the box
        t = 0.0
        t_out = 0.0
    a = o[2] + d[2] * t - ground_at(g, o[0] + d[0] * t, o[1] + d[1] * t)
    if t < t_max and t < t_out and a < 0.0:  # into the ground before the box
        return wp.vec3(t, float(UNMEASURED), -1.0)
    end = wp.min(t_out, t_max)
    i = wp.clamp(int(wp.floor((o[0] + d[0] * t) / side)), 0, g.table.shape[1] - 1)
    j = wp.clamp(int(wp.floor((o[1] + d[1] * t) / side)), 0, g.table.shape[0] - 1)
    while t < end:
        ex = exit_of(o[0], d[0], i, side)
        ey = exit_of(o[1], d[1], j, side)
        leave = wp.max(wp.min(wp.min(ex, ey), end), t)
        low = o[2] + wp.min(d[2] * t, d[2] * leave)
        if low <= g.tile_top[j, i]:
            slot = g.table[j, i]
            u = wp.clamp(int(wp.floor((o[0] + d[0] * t) / g.cell)), i * g.tile, (i + 1) * g.tile - 1)
            v = wp.clamp(int(wp.floor((o[1] + d[1] * t) / g.cell)), j * g.tile, (j + 1) * g.tile - 1)
            inside = bool(True)
            while inside:
                cx = exit_of(o[0], d[0], u, g.cell)
                cy = exit_of(o[1], d[1], v, g.cell)
                after = wp.max(wp.min(wp.min(cx, cy), leave), t)
                b = o[2] + d[2] * after - ground_at(g, o[0] + d[0] * after, o[1] + d[1] * after)
                h = float(0.0)
                what = int(UNMEASURED)
                cell = int(-1)
                if slot >= 0:
                    p = u - i * g.tile
                    q = v - j * g.tile
                    first = int(g.quantiles[slot, q, p, 0])
                    if first != g.none:
                        what = MEASURED
                        h = 0.001 * float(g.quantiles[slot, q, p, level])
                        cell = (slot * g.tile + q) * g.tile + p
                        stubble = int(g.cut[slot, q, p])
                        if stubble < 255:
                            h = wp.min(h, 0.01 * float(stubble) * (float(level) + 0.5) / float(g.levels))
                if what == MEASURED and a <= h:
                    return wp.vec3(t, float(what), float(cell))
                if b <= h:
                    t = t + (after - t) * wp.clamp((a - h) / wp.max(a - b, 1.0e-9), 0.0, 1.0)
                    return wp.vec3(t, float(what), float(cell))
                a = b
                t = after
                if after >= leave:
                    inside = False
                elif cx <= cy:
                    u = u + wp.where(d[0] > 0.0, 1, -1)
                    inside = u >= i * g.tile and u < (i + 1) * g.tile
                else:
                    v = v + wp.where(d[1] > 0.0, 1, -1)
                    inside = v >= j * g.tile and v < (j + 1) * g.tile
        t = leave
        a = o[2] + d[2] * t - ground_at(g, o[0] + d[0] * t, o[1] + d[1] * t)
        if ex <= ey:
            i = i + wp.where(d[0] > 0.0, 1, -1)
        else:
            j = j + wp.where(d[1] > 0.0, 1, -1)
        if i < 0 or j < 0 or i >= g.table.shape[1] or j >= g.table.shape[0]:
            t_out = t
            end = t
    if t < t_max and d[2] < 0.0:  # beyond the box: the ground goes on as at its border
        reach = t - a / d[2]
        if reach < t_max:
            return wp.vec3(reach, float(UNMEASURED), -1.0)
    return wp.vec3(t_max, float(NOTHING), -1.0)


@wp.kernel(enable_backward=False)
def cast_heights(
    g: Heights,
    things: Things,
    draw: Draw,
    range_max: float,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    distance: wp.array(dtype=float),
    what: wp.array(dtype=int),
    cell: wp.array(dtype=int),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
):
    k = wp.tid()
    o = origins[k]
    v = directions[k]
    hit = Hit()
    hit.t = range_max
    hit.organ = 0
    hit.cosine = 0.0
    hit.reflectance = 0.0
    hit = hit_things(things, o, wp.vec3(v), hit)
    away = o - g.origin
    c = g.turn[0]
    s = g.turn[1]
    local = wp.vec3(float(c * away[0] + s * away[1]), float(c * away[1] - s * away[0]), float(away[2]))
    along = wp.vec3(float(c * v[0] + s * v[1]), float(c * v[1] - s * v[0]), float(v[2]))
    level = draw_level(g, draw, local, along, range_max)
    found = walk(g, local, along, level, hit.t)
    kind = int(found[1])
    cell[k] = int(found[2])
    cosine[k] = hit.cosine
    reflectance[k] = hit.reflectance
    distance[k] = found[0]
    if kind == NOTHING and hit.organ != 0:
        kind = SOLID
        distance[k] = hit.t
    if kind == NOTHING:
        distance[k] = wp.nan
    what[k] = kind
