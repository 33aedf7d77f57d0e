"""One ray: solids, then pages, tiles, ground and plants, nearest hit wins."""

import warp as wp

from swath.rays.kernel.crop import Tile, cross_crop
from swath.rays.kernel.scene import (
    Hit,
    Ray,
    Scene,
    SolidArrays,
    facing,
    floor_div,
    no_hit,
    plane_offset,
    plane_slope,
    slot_at,
    swayed,
    to_stand,
)
from swath.rays.kernel.shapes import MISS, hit_patch
from swath.rays.kernel.solids_alone import BLOCK as BLOCK
from swath.rays.kernel.solids_alone import SOLID, hit_solids

GROUND = wp.constant(1)
STRAW = wp.constant(2)
STRAW_DEPTH = wp.constant(0.005)  # thinner straw does not hide the soil [m]
MARGIN = wp.constant(0.005)  # what may rise above tile_top: round ends of clipped stems [m]
SLACK = wp.constant(0.001)  # rounding of tile planes [m]


@wp.func
def cross_ground(
    scene: Scene, ray: Ray, slot: int, corner: wp.vec2, jx: int, jy: int, t0: float, t1: float, hit: Hit
):
    """Nearest ground hit within the tile (jx, jy) of a page with that lower corner, t in [t0, t1].

    The ground is one bilinear patch per lattice cell; the ray's height above a patch is a quadratic in t.
    """
    gap = float(scene.tile_size) / 8.0
    x = (ray.o[0] - corner[0]) / gap
    y = (ray.o[1] - corner[1]) / gap
    xd = ray.d[0] / gap
    yd = ray.d[1] / gap
    ix = wp.clamp(int(wp.floor(x + xd * t0)), jx * 8, jx * 8 + 7)
    iy = wp.clamp(int(wp.floor(y + yd * t0)), jy * 8, jy * 8 + 7)
    gx = plane_slope(xd)
    gy = plane_slope(yd)
    cx = plane_offset(x, xd)
    cy = plane_offset(y, yd)
    t = t0
    while True:
        tx = float(ix + wp.where(xd > 0.0, 1, 0)) * gx + cx
        ty = float(iy + wp.where(yd > 0.0, 1, 0)) * gy + cy
        leave = wp.min(wp.min(tx, ty), t1)
        s00 = scene.straw[slot, iy, ix]
        s10 = scene.straw[slot, iy, ix + 1]
        s01 = scene.straw[slot, iy + 1, ix]
        s11 = scene.straw[slot, iy + 1, ix + 1]
        h00 = (scene.ground[slot, iy, ix] - ray.z0) + s00
        h10 = (scene.ground[slot, iy, ix + 1] - ray.z0) + s10
        h01 = (scene.ground[slot, iy + 1, ix] - ray.z0) + s01
        h11 = (scene.ground[slot, iy + 1, ix + 1] - ray.z0) + s11
        u = x + xd * t - float(ix)
        v = y + yd * t - float(iy)
        hu = h10 - h00
        hv = h01 - h00
        huv = h11 - h10 - hv
        above = ray.o[2] + ray.d[2] * t - (h00 + hu * u + hv * v + huv * u * v)
        rate = ray.d[2] - (hu + huv * v) * xd - (hv + huv * u) * yd
        s = hit_patch(above, rate, -huv * xd * yd, wp.max(leave - t, 0.0))
        if s < MISS and t + s < hit.t:
            u = u + xd * s
            v = v + yd * s
            n = wp.vec3(-(hu + huv * v) / gap, -(hv + huv * u) / gap, 1.0)
            depth = (s00 * (1.0 - u) + s10 * u) * (1.0 - v) + (s01 * (1.0 - u) + s11 * u) * v
            hit.t = t + s
            hit.organ = wp.where(depth > STRAW_DEPTH, STRAW, GROUND)
            hit.cosine = wp.abs(wp.dot(n, ray.d)) / wp.length(n)
            hit.reflectance = scene.reflectance[hit.organ]
            hit.normal = n
            break
        if leave >= t1:
            break
        t = wp.max(leave, t)
        if tx <= ty:
            ix += wp.where(xd > 0.0, 1, -1)
            if ix < jx * 8 or ix > jx * 8 + 7:
                break
        else:
            iy += wp.where(yd > 0.0, 1, -1)
            if iy < jy * 8 or iy > jy * 8 + 7:
                break
    return hit


@wp.func
def cross_tile(
    scene: Scene, ray: Ray, slot: int, page: wp.vec2i, jx: int, jy: int, t0: float, t1: float, hit: Hit
):
    """Nearest hit in one tile, entered at t0 and left at t1. page: its first tile from the ray's tile."""
    size = float(scene.tile_size)
    tile = wp.vec2i(page[0] + jx, page[1] + jy)
    plane = scene.tile_plane[slot, jy, jx]
    h1 = ray.d[2] - plane[1] * ray.d[0] - plane[2] * ray.d[1]
    h0 = (
        ray.o[2]
        - (plane[0] - ray.z0)
        - plane[1] * (ray.o[0] - (float(tile[0]) + 0.5) * size)
        - plane[2] * (ray.o[1] - (float(tile[1]) + 0.5) * size)
    )
    lowest = wp.min(h0 + h1 * t0, h0 + h1 * t1)
    bump = scene.tile_bump[slot, jy, jx] + SLACK
    top = scene.tile_top[slot, jy, jx] + MARGIN
    if lowest <= bump:
        ta = t0
        tb = t1
        if h1 < 0.0:
            ta = wp.max(ta, (bump - h0) / h1)
        elif h1 > 0.0:
            tb = wp.min(tb, (bump - h0) / h1)
        corner = wp.vec2(float(page[0]) * size, float(page[1]) * size)
        hit = cross_ground(scene, ray, slot, corner, jx, jy, ta, tb, hit)
    if top > MARGIN and lowest <= top:
        ta = t0
        tb = wp.min(t1, hit.t)
        if h1 < 0.0:
            ta = wp.max(ta, (top - h0) / h1)
        elif h1 > 0.0:
            tb = wp.min(tb, (top - h0) / h1)
        if ta <= tb:
            stand = scene.tile_stand[slot, jy, jx]
            if scene.sways != 0:
                stand = swayed(scene, stand, ray.tile_x + tile[0], ray.tile_y + tile[1])
            found = Tile(
                tile[0],
                tile[1],
                scene.tile_prototype[slot, jy, jx],
                plane,
                stand,
                wp.vec2(h0, h1),
            )
            hit = cross_crop(scene, ray, found, wp.vec4(t0, t1, ta, tb), hit)
    return hit


@wp.func
def cross_page(scene: Scene, ray: Ray, slot: int, page: wp.vec2i, t0: float, t1: float, hit: Hit):
    """Nearest hit in one page, between t0 and t1: its tiles in the order of the ray."""
    size = float(scene.tile_size)
    jx = wp.clamp(int(wp.floor((ray.o[0] + ray.d[0] * t0) / size)) - page[0], 0, 7)
    jy = wp.clamp(int(wp.floor((ray.o[1] + ray.d[1] * t0) / size)) - page[1], 0, 7)
    t = t0
    while True:
        tx = float(page[0] + jx + wp.where(ray.d[0] > 0.0, 1, 0)) * size * ray.inv[0] + ray.off[0]
        ty = float(page[1] + jy + wp.where(ray.d[1] > 0.0, 1, 0)) * size * ray.inv[1] + ray.off[1]
        leave = wp.min(wp.min(tx, ty), t1)
        if leave >= t:
            hit = cross_tile(scene, ray, slot, page, jx, jy, t, leave, hit)
            t = leave
        if leave >= t1 or hit.t <= leave:
            break
        if tx <= ty:
            jx += wp.where(ray.d[0] > 0.0, 1, -1)
            if jx < 0 or jx > 7:
                break
        else:
            jy += wp.where(ray.d[1] > 0.0, 1, -1)
            if jy < 0 or jy > 7:
                break
    return hit


@wp.func
def cross_field(scene: Scene, ray: Ray, hit: Hit):
    """Nearest hit in the field: pages in the order of the ray, until it leaves the known ones."""
    size = float(scene.tile_size)
    px = floor_div(ray.tile_x, 8)
    py = floor_div(ray.tile_y, 8)
    t = float(0.0)
    while True:
        slot = slot_at(scene, px, py)
        if slot < 0:
            break
        page = wp.vec2i(px * 8 - ray.tile_x, py * 8 - ray.tile_y)
        tx = float(page[0] + wp.where(ray.d[0] > 0.0, 8, 0)) * size * ray.inv[0] + ray.off[0]
        ty = float(page[1] + wp.where(ray.d[1] > 0.0, 8, 0)) * size * ray.inv[1] + ray.off[1]
        leave = wp.max(wp.min(tx, ty), t)
        ta = t
        tb = wp.min(leave, hit.t)
        over = ray.o[2] - (scene.page_top[slot] + 2.0 * MARGIN - ray.z0)  # above all that is in the page
        if ray.d[2] < 0.0:
            ta = wp.max(ta, -over / ray.d[2])
        elif ray.d[2] > 0.0:
            tb = wp.min(tb, -over / ray.d[2])
        elif over > 0.0:
            tb = -1.0
        if ta <= tb:
            hit = cross_page(scene, ray, slot, page, ta, tb, hit)
        if hit.t <= leave:
            break
        t = leave
        if tx <= ty:
            px += wp.where(ray.d[0] > 0.0, 1, -1)
        else:
            py += wp.where(ray.d[1] > 0.0, 1, -1)
    return hit


@wp.kernel(enable_backward=False, launch_bounds=(BLOCK, 1024 // BLOCK))
def cast(
    scene: Scene,
    solids: SolidArrays,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    range_max: float,
    first: int,
    distance: wp.array(dtype=float),
    organ: wp.array(dtype=wp.uint8),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
):
    i = first + wp.tid()
    o = origins[i]
    v = directions[i]
    hit = hit_solids(solids, o, wp.vec3(v), no_hit(range_max))
    ray = to_stand(scene, o, v)
    hit = cross_field(scene, ray, hit)
    if hit.organ == 0:
        distance[i] = wp.nan
    else:
        distance[i] = hit.t
    organ[i] = wp.uint8(hit.organ)
    cosine[i] = hit.cosine
    reflectance[i] = hit.reflectance
    if normal.shape[0] > 0:
        n = hit.normal
        if hit.organ != SOLID:
            c = float(scene.turn[0])
            s = float(scene.turn[1])
            n = wp.vec3(c * n[0] - s * n[1], s * n[0] + c * n[1], n[2])
        normal[i] = facing(n, wp.vec3(v))
