"""A ray through the plants of one tile: a traversal of columns and height bins of the prototype."""

import warp as wp

from swath.rays.kernel.scene import Hit, Ray, Scene, cut_code, plane_offset, plane_slope
from swath.rays.kernel.shapes import MISS, axis_point, hit_capsule, hit_facet

STANDING = wp.constant(255)
STEM = wp.constant(3)
STUBBLE = wp.constant(6)
MIRROR_X = wp.constant(1 << 16)
MIRROR_Y = wp.constant(1 << 17)
PROTOTYPE = wp.constant((1 << 16) - 1)
LENGTH_MAX = wp.constant(200.0)  # of a path through one tile, in tiles; a stand bent to 80 degrees needs ten


@wp.struct
class Tile:
    """A tile and how the ray meets it.

    x, y: number of the tile, seen from the ray's first tile
    prototype: with mirror flags
    plane, stand: as in the pages
    height: the ray is height[0] + t height[1] above the plane
    """

    x: int
    y: int
    prototype: int
    plane: wp.vec3
    stand: wp.vec4
    height: wp.vec2


@wp.struct
class Local:
    """The ray in prototype coordinates.

    o, d: point at t = start and unit direction
    stretch: length along d per t
    mirror: -1 or 1 in x and y
    shift: whole periods taken off o
    squeeze: 1 / scale of the heights
    low: where it enters the tile
    is_open: it starts in the tile, so no cut face lies at low
    """

    o: wp.vec3
    d: wp.vec3
    start: float
    stretch: float
    mirror: wp.vec2
    shift: wp.vec2
    squeeze: float
    low: float
    is_open: bool


@wp.struct
class Touch:
    """A primitive on the ray: distance along d, ends after cutting (of a ribbon uncut), cut code."""

    t: float
    a: wp.vec3
    b: wp.vec3
    code: int


@wp.func
def to_prototype(ray: Ray, tile: Tile, size: float, enter: float, start: float) -> Local:
    """The affine map of `field/memory_layout.py`, applied to the ray."""
    r = Local()
    r.start = start
    r.squeeze = 1.0 / tile.stand[0]
    zd = tile.height[1] * r.squeeze
    z = (tile.height[0] + tile.height[1] * start) * r.squeeze
    xd = ray.d[0] - tile.stand[1] * zd
    yd = ray.d[1] - tile.stand[2] * zd
    x = ray.o[0] - float(tile.x) * size + ray.d[0] * start - tile.stand[1] * z
    y = ray.o[1] - float(tile.y) * size + ray.d[1] * start - tile.stand[2] * z
    r.mirror = wp.vec2(1.0, 1.0)
    if (tile.prototype & MIRROR_X) != 0:
        r.mirror[0] = -1.0
        x = size - x
        xd = -xd
    if (tile.prototype & MIRROR_Y) != 0:
        r.mirror[1] = -1.0
        y = size - y
        yd = -yd
    r.stretch = wp.sqrt(xd * xd + yd * yd + zd * zd)
    r.d = wp.vec3(xd, yd, zd) / r.stretch
    r.shift = wp.vec2(wp.floor(x / size) * size, wp.floor(y / size) * size)
    r.o = wp.vec3(x - r.shift[0], y - r.shift[1], z)
    r.low = (enter - start) * r.stretch
    r.is_open = enter <= 0.0
    return r


@wp.func
def from_low(r: Local, a: wp.vec3, b: wp.vec3, radius: float, t: float) -> float:
    """A capsule hit at t, not before low. A tile's side cuts through what stands on it: a face at low."""
    if t < r.low:
        p = r.o + r.low * r.d
        q = p - axis_point(p, a, b)
        if r.is_open or wp.dot(q, q) > radius * radius:
            return MISS
        return r.low
    return t


@wp.func
def foot_code(scene: Scene, ray: Ray, tile: Tile, r: Local, foot: wp.vec4, size: float) -> int:
    """Cut code where the owner of a primitive stands, as seen from this copy of it."""
    x = foot[0] + r.shift[0]
    y = foot[1] + r.shift[1]
    if r.mirror[0] < 0.0:
        x = size - x
    if r.mirror[1] < 0.0:
        y = size - y
    fine = 64.0 / size
    cell_x = (ray.tile_x + tile.x) * 64 + int(wp.floor(x * fine))
    cell_y = (ray.tile_y + tile.y) * 64 + int(wp.floor(y * fine))
    return cut_code(scene, cell_x, cell_y)


@wp.func
def cut_back(r: Local, touch: Touch, radius: float) -> Touch:
    """What the knife left of a primitive: capsules end at the cut, flat ones are not hit above it."""
    top = 0.01 * float(touch.code) * r.squeeze
    a = touch.a
    b = touch.b
    if touch.code == 0 or (radius >= 0.0 and wp.min(a[2], b[2]) > top):
        touch.t = MISS
    elif radius <= 0.0:
        if r.o[2] + touch.t * r.d[2] > top:
            touch.t = MISS
    else:
        if b[2] > top:
            touch.b = a + (top - a[2]) / (b[2] - a[2]) * (b - a)
        elif a[2] > top:
            touch.a = b + (top - b[2]) / (a[2] - b[2]) * (a - b)
        t = hit_capsule(r.o, r.d, touch.a, touch.b, radius)
        touch.t = from_low(r, touch.a, touch.b, radius, t)
    return touch


@wp.func
def stand_normal(tile: Tile, r: Local, n: wp.vec3) -> wp.vec3:
    """A normal n of the prototype in the stand frame: by the inverse transpose."""
    x = n[0] * r.mirror[0]
    y = n[1] * r.mirror[1]
    lift = (n[2] - x * tile.stand[1] - y * tile.stand[2]) * r.squeeze
    return wp.vec3(x - lift * tile.plane[1], y - lift * tile.plane[2], lift)


@wp.func
def cross_crop(scene: Scene, ray: Ray, tile: Tile, span: wp.vec4, hit: Hit) -> Hit:
    """Nearest plant hit in the tile. span: t of entry and exit of the tile, then of the part to search."""
    size = float(scene.tile_size)
    r = to_prototype(ray, tile, size, span[0], span[2])
    end = (span[3] - span[2]) * r.stretch
    if not (end < LENGTH_MAX * size):
        return hit
    best = (wp.min(span[1], hit.t) - span[2]) * r.stretch
    o = r.o
    d = r.d
    low = r.low
    organ = int(0)
    own = float(0.0)  # reflectance of the primitive itself
    normal = wp.vec3(0.0, 0.0, 1.0)
    columns = scene.columns
    bins = scene.bins
    ix = wp.clamp(int(o[0] / scene.side), 0, columns - 1)
    iy = wp.clamp(int(o[1] / scene.side), 0, columns - 1)
    iz = wp.clamp(int(wp.floor(o[2] / scene.bin_height)), 0, bins - 1)
    sx = wp.where(d[0] > 0.0, 1, -1)
    sy = wp.where(d[1] > 0.0, 1, -1)
    sz = wp.where(d[2] > 0.0, 1, -1)
    ux = wp.where(d[0] > 0.0, 1, 0)
    uy = wp.where(d[1] > 0.0, 1, 0)
    uz = wp.where(d[2] > 0.0, 1, 0)
    gx = plane_slope(d[0]) * scene.side
    gy = plane_slope(d[1]) * scene.side
    gz = plane_slope(d[2]) * scene.bin_height
    cx = plane_offset(o[0], d[0])
    cy = plane_offset(o[1], d[1])
    cz = plane_offset(o[2], d[2])
    first = (tile.prototype & PROTOTYPE) * columns * columns
    fraction = tile.stand[3]
    while True:
        tx = float(ix + ux) * gx + cx
        ty = float(iy + uy) * gy + cy
        tz = float(iz + uz) * gz + cz
        if iz == 0 and sz < 0:
            tz = MISS
        leave = wp.min(tx, wp.min(ty, tz))
        cell = ((first + iy * columns) + ix) * bins + iz
        for i in range(scene.cell_start[cell], scene.cell_start[cell + 1]):
            p = scene.cell_items[i] * 4
            p0 = scene.prims[p]
            p1 = scene.prims[p + 1]
            if p1[3] < fraction:
                a = wp.vec3(p0[0], p0[1], p0[2])
                b = wp.vec3(p1[0], p1[1], p1[2])
                t = float(MISS)
                if p0[3] > 0.0:
                    t = hit_capsule(o, d, a, b, p0[3])
                    if t < low:
                        t = from_low(r, a, b, p0[3], t)
                else:
                    p2 = scene.prims[p + 2]
                    t = hit_facet(o, d, a, b, wp.vec3(p2[0], p2[1], p2[2]), -p0[3])
                    if t < low:
                        t = MISS
                if t < best:
                    p3 = scene.prims[p + 3]
                    touch = Touch(t, a, b, foot_code(scene, ray, tile, r, p3, size))
                    if touch.code != STANDING:
                        touch = cut_back(r, touch, p0[3])
                    if touch.t < best:
                        best = touch.t
                        p2 = scene.prims[p + 2]
                        organ = int(p2[3])
                        own = p3[2]
                        if touch.code != STANDING and organ == STEM:
                            organ = STUBBLE
                            own = 0.0
                        q = o + best * d
                        normal = q - axis_point(q, touch.a, touch.b)
                        if p0[3] <= 0.0:
                            normal = wp.cross(b - a, wp.vec3(p2[0], p2[1], p2[2]))
        if best <= leave or leave >= end:
            break
        if tx <= ty and tx <= tz:
            ix += sx
            if ix == columns or ix < 0:
                ix = wp.where(ix < 0, columns - 1, 0)
                r.shift[0] = r.shift[0] + float(sx) * size
                o[0] = o[0] - float(sx) * size
                r.o = o
                cx = plane_offset(o[0], d[0])
        elif ty <= tz:
            iy += sy
            if iy == columns or iy < 0:
                iy = wp.where(iy < 0, columns - 1, 0)
                r.shift[1] = r.shift[1] + float(sy) * size
                o[1] = o[1] - float(sy) * size
                r.o = o
                cy = plane_offset(o[1], d[1])
        else:
            iz += sz
            if iz == bins or iz < 0:
                break
    if organ > 0:
        hit.t = r.start + best / r.stretch
        hit.organ = organ
        g = stand_normal(tile, r, normal)
        hit.normal = g
        hit.cosine = wp.min(1.0, wp.abs(wp.dot(g, ray.d)) / wp.max(wp.length(g), 1.0e-20))
        hit.reflectance = scene.reflectance[organ]
        if own > 0.0:
            hit.reflectance = own
    return hit
