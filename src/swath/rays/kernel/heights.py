"""One ray through a grid of measured heights: solids, then tiles, then cells.

In a cell F(z) is the share of the heights measured there that lie below z. A ray that sinks from a to b in it
goes on with probability F(b) / F(a): it is above a already. It is stopped where the product along its way
falls below its own number u in [0, 1). In an even stand the product is F(z): it meets measured heights as
often as they were measured.
"""

import warp as wp

from swath.rays.kernel.cast import hit_things
from swath.rays.kernel.scene import Things, no_hit

NOTHING = wp.constant(0)
MEASURED = wp.constant(1)
UNMEASURED = wp.constant(2)
SOLID = wp.constant(3)
FAR = wp.constant(1.0e9)
FLATTEST = wp.constant(0.18)  # as in study/replay/passing.py
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
    nodes_per_m: float
    table: wp.array2d(dtype=int)
    tile_top: wp.array2d(dtype=float)
    quantiles: wp.array4d(dtype=wp.int16)
    cut: wp.array3d(dtype=wp.uint8)
    ground: wp.array2d(dtype=float)


@wp.struct
class Draw:
    """How a height is drawn. seed: of this scan; share: u of all beams, < 0 = drawn per foot cell

    grain: side of the cells in which beams that end there draw the same [m]
    """

    seed: wp.uint32
    share: float
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
    fx = wp.clamp(x * g.nodes_per_m, 0.0, float(g.ground.shape[1] - 1))
    fy = wp.clamp(y * g.nodes_per_m, 0.0, float(g.ground.shape[0] - 1))
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
def per(d: float) -> float:
    """1 / d, or 0 for a direction that never leaves a column."""
    if wp.abs(d) < 1.0e-9:
        return 0.0
    return 1.0 / d


@wp.func
def exit_of(o: float, inverse: float, index: int, side: float) -> float:
    """t at which a ray leaves column `index` of width `side`; inverse: `per` of its direction."""
    if inverse == 0.0:
        return FAR
    return (float(wp.where(inverse > 0.0, index + 1, index)) * side - o) * inverse


@wp.func
def draw_share(g: Heights, draw: Draw, o: wp.vec3, d: wp.vec3, range_max: float) -> float:
    if draw.share >= 0.0:
        return draw.share
    t = range_max
    if d[2] < -1.0e-6:
        t = wp.clamp((ground_at(g, o[0], o[1]) - o[2]) / d[2], 0.0, range_max)
    i = int(wp.floor((o[0] + d[0] * t) / draw.grain))
    j = int(wp.floor((o[1] + d[1] * t) / draw.grain))
    h = mix(mix(draw.seed ^ mix(wp.uint32(i))) ^ wp.uint32(j))
    return (float(h >> wp.uint32(8)) + 0.5) / 16777216.0


@wp.func
def share_below(g: Heights, slot: int, row: int, column: int, z: float) -> float:
    """Share of the heights of a cell that lie below z, linear between its quantiles."""
    mm = 1000.0 * z
    last = g.levels - 1
    share = float(0.0)
    if mm > float(g.quantiles[slot, row, column, last]):
        share = 1.0
    elif mm > float(g.quantiles[slot, row, column, 0]):
        k = int(0)  # largest level below z
        n = int(last)
        while n - k > 1:
            m = (n + k) / 2
            if float(g.quantiles[slot, row, column, m]) < mm:
                k = m
            else:
                n = m
        lower = float(g.quantiles[slot, row, column, k])
        upper = float(g.quantiles[slot, row, column, n])
        share = (float(k) + 0.5 + (mm - lower) / wp.max(upper - lower, 1.0)) / float(g.levels)
    stubble = int(g.cut[slot, row, column])
    if stubble < 255:
        share = wp.max(share, wp.clamp(100.0 * z / wp.max(float(stubble), 0.01), 0.0, 1.0))
    return share


@wp.func
def height_at(g: Heights, slot: int, row: int, column: int, share: float) -> float:
    """Height of a cell that a share of the measured ones lie below [m]."""
    f = wp.clamp(share * float(g.levels) - 0.5, 0.0, float(g.levels - 1))
    k = wp.min(int(f), g.levels - 2)
    lower = float(g.quantiles[slot, row, column, k])
    upper = float(g.quantiles[slot, row, column, k + 1])
    z = 0.001 * (lower + (upper - lower) * (f - float(k)))
    stubble = int(g.cut[slot, row, column])
    if stubble < 255:
        z = wp.min(z, 0.01 * float(stubble) * share)
    return z


@wp.func
def walk(g: Heights, o: wp.vec3, d: wp.vec3, u: float, t_max: float) -> wp.vec3:
    """(t, what, index of the cell). The cell is -1 where there is none."""
    side = g.cell * float(g.tile)
    width = side * float(g.table.shape[1])
    length = side * float(g.table.shape[0])
    sx = slab(o[0], d[0], 0.0, width)
    sy = slab(o[1], d[1], 0.0, length)
    t = wp.max(wp.max(sx[0], sy[0]), 0.0)
    t_out = wp.min(sx[1], sy[1])
    flattest = FLATTEST * wp.sqrt(d[0] * d[0] + d[1] * d[1])
    survived = float(1.0)
    ix = per(d[0])
    iy = per(d[1])
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
        ex = exit_of(o[0], ix, i, side)
        ey = exit_of(o[1], iy, j, side)
        leave = wp.max(wp.min(wp.min(ex, ey), end), t)
        if o[2] + wp.min(d[2] * t, d[2] * leave) <= g.tile_top[j, i]:
            slot = g.table[j, i]
            if d[2] < -1.0e-6:  # on to where the ray comes down to the highest surface of the tile
                down = wp.min((g.tile_top[j, i] - o[2]) / d[2], leave)
                if down > t:
                    t = down
                    a = o[2] + d[2] * t - ground_at(g, o[0] + d[0] * t, o[1] + d[1] * t)
            p = wp.clamp(int(wp.floor((o[0] + d[0] * t) / g.cell)), i * g.tile, (i + 1) * g.tile - 1)
            q = wp.clamp(int(wp.floor((o[1] + d[1] * t) / g.cell)), j * g.tile, (j + 1) * g.tile - 1)
            inside = bool(True)
            while inside:
                cx = exit_of(o[0], ix, p, g.cell)
                cy = exit_of(o[1], iy, q, g.cell)
                after = wp.max(wp.min(wp.min(cx, cy), leave), t)
                b = o[2] + d[2] * after - ground_at(g, o[0] + d[0] * after, o[1] + d[1] * after)
                column = p - i * g.tile
                row = q - j * g.tile
                is_measured = bool(False)
                if slot >= 0:
                    is_measured = int(g.quantiles[slot, row, column, 0]) != g.none
                if is_measured:
                    low = wp.min(wp.min(a, b), a - flattest * (after - t))
                    high = wp.max(a, b)
                    below = share_below(g, slot, row, column, low)
                    if below < 1.0:
                        above = share_below(g, slot, row, column, high)
                        left = float(0.0)
                        if above > 0.0:
                            left = survived * below / above
                        if left <= u:
                            part = float(0.0)
                            if above > 0.0 and high > low:
                                z = height_at(g, slot, row, column, u * above / survived)
                                part = wp.clamp((high - z) / (high - low), 0.0, 1.0)
                                if b > a:
                                    part = 1.0 - part
                            cell = (slot * g.tile + row) * g.tile + column
                            return wp.vec3(t + (after - t) * part, float(MEASURED), float(cell))
                        survived = left
                elif b <= 0.0:
                    t = t + (after - t) * wp.clamp(a / wp.max(a - b, 1.0e-9), 0.0, 1.0)
                    return wp.vec3(t, float(UNMEASURED), -1.0)
                a = b
                t = after
                if after >= leave:
                    inside = False
                elif cx <= cy:
                    p = p + wp.where(d[0] > 0.0, 1, -1)
                    inside = p >= i * g.tile and p < (i + 1) * g.tile
                else:
                    q = q + wp.where(d[1] > 0.0, 1, -1)
                    inside = q >= j * g.tile and q < (j + 1) * g.tile
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
    hit = hit_things(things, o, wp.vec3(v), no_hit(range_max))
    away = o - g.origin
    c = g.turn[0]
    s = g.turn[1]
    local = wp.vec3(float(c * away[0] + s * away[1]), float(c * away[1] - s * away[0]), float(away[2]))
    along = wp.vec3(float(c * v[0] + s * v[1]), float(c * v[1] - s * v[0]), float(v[2]))
    found = walk(g, local, along, draw_share(g, draw, local, along, range_max), hit.t)
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
