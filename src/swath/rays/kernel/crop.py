"""A ray through the plants of one tile: a walk through columns and height bins of the prototype."""

import warp as wp

from swath.rays.kernel.scene import Hit, Ray, Scene, cut_code, plane_offset, plane_slope
from swath.rays.kernel.shapes import MISS, axis_point, hit_capsule, hit_ribbon

STANDING = wp.constant(255)
STEM = wp.constant(3)
STUBBLE = wp.constant(6)
MIRROR_X = wp.constant(1 << 16)
MIRROR_Y = wp.constant(1 << 17)
PROTOTYPE = wp.constant((1 << 16) - 1)


@wp.func
def capsule_from(
    o: wp.vec3, d: wp.vec3, a: wp.vec3, b: wp.vec3, r: float, low: float, is_open: bool
) -> float:
    """First hit at t >= low. A tile's side cuts through what stands on it: the cut face is hit at low."""
    t = hit_capsule(o, d, a, b, r)
    if t < low:
        p = o + low * d
        q = p - axis_point(p, a, b)
        if is_open or wp.dot(q, q) > r * r:
            return MISS
        return low
    return t


@wp.func
def walk_crop(
    scene: Scene,
    ray: Ray,
    tile: wp.vec2i,
    prototype: int,
    plane: wp.vec3,
    stand: wp.vec4,
    height: wp.vec2,
    span: wp.vec4,
    hit: Hit,
) -> Hit:
    """Nearest plant hit within the tile.

    tile: number of the tile, seen from the ray's first tile; height: of the ray above the tile's plane is
    height[0] + t height[1]; span: t of entry and exit of the tile, then of the part to search
    """
    size = float(scene.tile_size)
    ta = span[2]
    # world to prototype, at ta
    mx = float(1.0)
    my = float(1.0)
    squeeze = 1.0 / stand[0]
    zd = height[1] * squeeze
    z = (height[0] + height[1] * ta) * squeeze
    xd = ray.d[0] - stand[1] * zd
    yd = ray.d[1] - stand[2] * zd
    x = ray.o[0] - float(tile[0]) * size + ray.d[0] * ta - stand[1] * z
    y = ray.o[1] - float(tile[1]) * size + ray.d[1] * ta - stand[2] * z
    if (prototype & MIRROR_X) != 0:
        mx = -1.0
        x = size - x
        xd = -xd
    if (prototype & MIRROR_Y) != 0:
        my = -1.0
        y = size - y
        yd = -yd
    stretch = wp.sqrt(xd * xd + yd * yd + zd * zd)
    d = wp.vec3(xd / stretch, yd / stretch, zd / stretch)
    shift_x = wp.floor(x / size) * size
    shift_y = wp.floor(y / size) * size
    o = wp.vec3(x - shift_x, y - shift_y, z)
    low = (span[0] - ta) * stretch
    is_open = span[0] <= 0.0
    end = (span[3] - ta) * stretch
    best = (wp.min(span[1], hit.t) - ta) * stretch
    found = int(-1)
    organ = int(0)
    normal = wp.vec3(0.0, 0.0, 1.0)
    # the walk
    side = scene.side
    columns = scene.columns
    bins = scene.bins
    ix = wp.min(int(o[0] / side), columns - 1)
    iy = wp.min(int(o[1] / side), columns - 1)
    iz = wp.clamp(int(wp.floor(o[2] / scene.bin_height)), 0, bins - 1)
    sx = wp.where(d[0] > 0.0, 1, -1)
    sy = wp.where(d[1] > 0.0, 1, -1)
    sz = wp.where(d[2] > 0.0, 1, -1)
    ux = wp.where(d[0] > 0.0, 1, 0)
    uy = wp.where(d[1] > 0.0, 1, 0)
    uz = wp.where(d[2] > 0.0, 1, 0)
    gx = plane_slope(d[0]) * side
    gy = plane_slope(d[1]) * side
    gz = plane_slope(d[2]) * scene.bin_height
    cx = plane_offset(o[0], d[0])
    cy = plane_offset(o[1], d[1])
    cz = plane_offset(o[2], d[2])
    first = (prototype & PROTOTYPE) * columns * columns
    fraction = stand[3]
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
                r = p0[3]
                w = wp.vec3(0.0, 0.0, 0.0)
                t = float(MISS)
                if r > 0.0:
                    t = hit_capsule(o, d, a, b, r)
                    if t < low:
                        t = capsule_from(o, d, a, b, r, low, is_open)
                else:
                    p2 = scene.prims[p + 2]
                    w = wp.vec3(p2[0], p2[1], p2[2])
                    t = hit_ribbon(o, d, a, b, w)
                    if t < low:
                        t = MISS
                if t < best:
                    foot = scene.prims[p + 3]
                    bx = foot[0] + shift_x
                    by = foot[1] + shift_y
                    if mx < 0.0:
                        bx = size - bx
                    if my < 0.0:
                        by = size - by
                    fine = 64.0 / size
                    code = cut_code(
                        scene,
                        (ray.tile_x + tile[0]) * 64 + int(wp.floor(bx * fine)),
                        (ray.tile_y + tile[1]) * 64 + int(wp.floor(by * fine)),
                    )
                    if code != STANDING:
                        top = 0.01 * float(code) * squeeze
                        if code == 0 or wp.min(a[2], b[2]) > top:
                            t = MISS
                        elif r == 0.0:
                            if o[2] + t * d[2] > top:
                                t = MISS
                        else:
                            if b[2] > top:
                                b = a + (top - a[2]) / (b[2] - a[2]) * (b - a)
                            elif a[2] > top:
                                a = b + (top - b[2]) / (a[2] - b[2]) * (a - b)
                            t = capsule_from(o, d, a, b, r, low, is_open)
                    if t < best:
                        best = t
                        found = p
                        organ = int(scene.prims[p + 2][3])
                        if code != STANDING and organ == STEM:
                            organ = STUBBLE
                        if r > 0.0:
                            q = o + t * d
                            normal = q - axis_point(q, a, b)
                        else:
                            normal = wp.cross(b - a, w)
        if best <= leave or leave >= end:
            break
        if tx <= ty and tx <= tz:
            ix += sx
            if ix == columns or ix < 0:
                ix = wp.where(ix < 0, columns - 1, 0)
                shift_x += float(sx) * size
                o[0] = o[0] - float(sx) * size
                cx = plane_offset(o[0], d[0])
        elif ty <= tz:
            iy += sy
            if iy == columns or iy < 0:
                iy = wp.where(iy < 0, columns - 1, 0)
                shift_y += float(sy) * size
                o[1] = o[1] - float(sy) * size
                cy = plane_offset(o[1], d[1])
        else:
            iz += sz
            if iz == bins:
                break
    if found >= 0:
        # normals go back by the inverse transpose
        lift = normal[2] - normal[0] * mx * stand[1] - normal[1] * my * stand[2]
        zx = -plane[1] * squeeze
        zy = -plane[2] * squeeze
        g = wp.vec3(normal[0] * mx + lift * zx, normal[1] * my + lift * zy, lift * squeeze)
        hit.t = ta + best / stretch
        hit.organ = organ
        hit.cosine = wp.min(1.0, wp.abs(wp.dot(g, ray.d)) / wp.max(wp.length(g), 1.0e-20))
        hit.reflectance = scene.reflectance[organ]
    return hit
