"""One ray per beam against bodies: solids, ground, and the canopy, which a beam enters by a drawn depth.

The depth is drawn from a table of measured heights (`rays/spread.py`). It is turned into an optical depth, so
that the same draw works where the canopy begins at a side wall, ends at a cut, or changes its density: the
beam is followed in short steps, and what stands there adds up until the drawn depth is reached.
"""

import warp as wp

from swath.rays.kernel.cast import MARGIN, SLACK, hit_things, walk_ground
from swath.rays.kernel.scene import (
    Hit,
    Ray,
    Scene,
    Things,
    cut_code,
    floor_div,
    no_hit,
    page_slot,
    to_stand,
)
from swath.rays.kernel.shapes import MISS

STANDING = wp.constant(255)
GROUND = wp.constant(1)
STRAW = wp.constant(2)
STEM = wp.constant(3)
EAR = wp.constant(4)
STUBBLE = wp.constant(6)
EAR_ZONE = wp.constant(0.85)  # crop above this share of its height counts as ears
SPOT_AT = wp.constant(0.9)  # share of the crop's height where the spot is taken, or lower down at a wall
FLAT = wp.constant(1.0e-3)  # steps that change the relative height by less use the silhouette itself
TOP_ROOM = wp.constant(0.12)  # as in rays/bodies.py
FALL = wp.constant(0.025)  # steps lose no more height than this [m]
THIN = wp.constant(1.0e-4)  # where less silhouette than this lies above, steps are doubled [m2]
SNAP = wp.constant(
    1.0e-4
)  # values this close to a node of the table, in shares of a step, are taken as on it
LN_HALF = wp.constant(0.7071067811865476)


@wp.struct
class Canopy:
    """The table as the kernel reads it, see `rays/spread.py`.

    axes: log density, height [m], log tan depression, log spot, one after the other; size: of each
    quantile: relative heights, node_count per cell; ground: log(-log(ground share)) per cell
    lift: mean measured height of ground returns per cell [m]
    depth: silhouette per stem above equal steps `fine` of the relative height [m2]
    lean: sideways place of tips per plant height, many drawn stems
    pitch: step along the ray [m]; height: of the crop at scale 1 [m]; density_max [1/m2]
    exit, divergence: of the beam [m, rad]; cosine: mean |cos| of incidence on crop
    tangents: of the flattest and the steepest depression of the table
    room: no measured height lies further above the highest thing in a page [m]
    """

    axes: wp.array(dtype=float)
    size: wp.vec4i
    quantile: wp.array(dtype=float)
    ground: wp.array(dtype=float)
    lift: wp.array(dtype=float)
    node_count: int
    depth: wp.array(dtype=float)
    fine: float
    lean: wp.array(dtype=wp.vec2)
    pitch: float
    height: float
    density_max: float
    exit: float
    divergence: float
    cosine: float
    room: float
    tangents: wp.vec2


@wp.struct
class Beam:
    """What a beam carries: the drawn share u and its number.

    left: optical depth until its echo, -1 = no crop met yet; spent: what it passed; whole: of a full canopy
    lift: drawn, of a ground return under a full canopy [m]
    clamped: bit per axis of the table that was left
    """

    share: float
    number: int
    left: float
    spent: float
    whole: float
    lift: float
    clamped: int


@wp.func
def place(canopy: Canopy, first: int, count: int, value: float) -> wp.vec3:
    """Lower node of a value on an axis, the share of the way to the next, and 1 where it lies outside."""
    k = int(0)
    while k < count - 2 and canopy.axes[first + k + 1] <= value:
        k += 1
    low = canopy.axes[first + k]
    if count < 2:
        return wp.vec3(0.0, 0.0, wp.where(wp.abs(value - low) > 0.1, 1.0, 0.0))
    share = (value - low) / (canopy.axes[first + k + 1] - low)
    outside = wp.where(share < -1.0e-3 or share > 1.001, 1.0, 0.0)
    return wp.vec3(float(k), wp.where(share < SNAP, 0.0, wp.where(share > 1.0 - SNAP, 1.0, share)), outside)


@wp.func
def silhouette_above(canopy: Canopy, relative: float) -> float:
    """Silhouette per stem above a relative height [m2]."""
    last = canopy.depth.shape[0] - 1
    x = wp.clamp(relative / canopy.fine, 0.0, float(last))
    k = wp.min(int(x), last - 1)
    a = canopy.depth[k]
    return a + (canopy.depth[k + 1] - a) * (x - float(k))


@wp.func
def draw(canopy: Canopy, beam: Beam, density: float, scale: float, tangent: float, spot: float) -> Beam:
    """Fill in the optical depth of a beam that meets crop here."""
    n = canopy.size
    first = wp.vec4i(0, n[0], n[0] + n[1], n[0] + n[1] + n[2])
    p0 = place(canopy, first[0], n[0], wp.log(density))
    p1 = place(canopy, first[1], n[1], canopy.height * scale)
    p2 = place(canopy, first[2], n[2], wp.log(tangent))
    p3 = place(canopy, first[3], n[3], wp.log(spot))
    clamped = int(p0[2]) + 2 * int(p1[2]) + 4 * int(p2[2]) + 8 * int(p3[2])
    low = wp.vec4(1.0 - p0[1], 1.0 - p1[1], 1.0 - p2[1], 1.0 - p3[1])
    high = wp.vec4(p0[1], p1[1], p2[1], p3[1])
    stride = wp.vec4i(n[1] * n[2] * n[3], n[2] * n[3], n[3], 1)
    base = int(p0[0]) * stride[0] + int(p1[0]) * stride[1] + int(p2[0]) * stride[2] + int(p3[0])
    loglog = float(0.0)
    beam.lift = 0.0
    for a in range(2):
        w0 = wp.where(a == 1, high[0], low[0])
        if w0 > 0.0:
            for b in range(2):
                w1 = w0 * wp.where(b == 1, high[1], low[1])
                if w1 > 0.0:
                    for c in range(2):
                        w2 = w1 * wp.where(c == 1, high[2], low[2])
                        cell = base + a * stride[0] + b * stride[1] + c * stride[2]
                        for d in range(2):
                            w = w2 * wp.where(d == 1, high[3], low[3])
                            if w > 0.0:
                                loglog += w * canopy.ground[cell + d]
                                beam.lift += w * canopy.lift[cell + d]
    seen = 1.0 - wp.exp(-wp.exp(loglog))
    beam.clamped = clamped
    cot = 1.0 / wp.clamp(tangent, canopy.tangents[0], canopy.tangents[1])
    beam.left = 1.0e30
    beam.whole = density * scale * cot * canopy.depth[0]
    beam.lift = 2.0 * beam.lift * (1.0 - beam.share) / wp.max(1.0 - seen, 1.0e-9)
    if beam.share < seen:
        nodes = canopy.node_count
        x = wp.acos(1.0 - 2.0 * beam.share / seen) / wp.pi * float(nodes - 1)
        k = wp.clamp(int(x), 0, nodes - 2)
        f = x - float(k)
        relative = float(0.0)
        for a in range(2):
            w0 = wp.where(a == 1, high[0], low[0])
            if w0 > 0.0:
                for b in range(2):
                    w1 = w0 * wp.where(b == 1, high[1], low[1])
                    if w1 > 0.0:
                        for c in range(2):
                            w2 = w1 * wp.where(c == 1, high[2], low[2])
                            cell = base + a * stride[0] + b * stride[1] + c * stride[2]
                            for d in range(2):
                                w = w2 * wp.where(d == 1, high[3], low[3])
                                if w > 0.0:
                                    q = (cell + d) * nodes + k
                                    relative += w * (
                                        canopy.quantile[q] * (1.0 - f) + canopy.quantile[q + 1] * f
                                    )
        beam.left = density * scale * cot * silhouette_above(canopy, relative)
    return beam


@wp.func
def stands(scene: Scene, ray: Ray, page: wp.vec3i, x: float, y: float, height: float, fine: float) -> int:
    """Code of the cell of a foot (seen from the ray's tile) when what grows there reaches the height [m].

    page: cells from the ray's tile to the lower corner of the page that the foot is most likely in, its row
    of `cut`; fine: cells per metre
    """
    i = int(wp.floor(x * fine))
    j = int(wp.floor(y * fine))
    in_x = i - page[0]
    in_y = j - page[1]
    code = int(0)
    if in_x < 0 or in_y < 0 or in_x > 511 or in_y > 511:
        code = cut_code(scene, ray.tile_x * 64 + i, ray.tile_y * 64 + j)
    elif page[2] < 0:
        code = -1 - page[2]
    else:
        code = int(scene.cut[page[2], in_y, in_x])
    if code != STANDING and 0.01 * float(code) <= height:
        return 0
    return code


@wp.func
def cross_canopy(
    scene: Scene,
    canopy: Canopy,
    ray: Ray,
    page: wp.vec3i,
    stand: wp.vec4,
    line: wp.vec2,
    ta: float,
    tb: float,
    hit: Hit,
    beam: Beam,
):
    """The beam through the crop of one tile between ta and tb; line: height above its plane is line[0] + t
    line[1]. Changes the hit and what is left of the beam's optical depth."""
    fine = 64.0 / float(scene.tile_size)
    scale = stand[0]
    density = canopy.density_max * stand[3]
    rate = line[1] / scale
    flow = wp.vec2(ray.d[0] - stand[1] * rate, ray.d[1] - stand[2] * rate)
    speed = wp.max(wp.length(flow), 1.0e-3)
    pitch = wp.min(canopy.pitch, FALL / wp.max(wp.abs(line[1]), 1.0e-6))
    per_height = 1.0 / (scale * canopy.height)
    leans = canopy.lean.shape[0]
    k = beam.number * 7
    t = ta
    above = silhouette_above(canopy, (line[0] + line[1] * t) * per_height)
    while t < tb:
        dt = wp.min(wp.where(above < THIN, 2.0 * pitch, pitch), tb - t)
        below = silhouette_above(canopy, (line[0] + line[1] * (t + dt)) * per_height)
        k += 1
        middle = t + 0.5 * dt
        z = (line[0] + line[1] * middle) / scale  # height in the stand as it is at scale 1
        if z > 0.0:
            relative = z / canopy.height
            bow = wp.min(relative, 1.2) * wp.min(relative, 1.2) * canopy.height
            lean = canopy.lean[k % leans]
            x = ray.o[0] + ray.d[0] * middle - stand[1] * z - lean[0] * bow
            y = ray.o[1] + ray.d[1] * middle - stand[2] * z - lean[1] * bow
            code = stands(scene, ray, page, x, y, z * scale, fine)
            if code != 0:
                if beam.left < 0.0:
                    tangent = wp.max(-line[1], 1.0e-4) / speed
                    deeper = wp.max(relative - SPOT_AT, 0.0) / wp.max(-rate / canopy.height, 0.05)
                    spot = wp.max(canopy.exit + canopy.divergence * (middle + deeper), 1.0e-4)
                    beam = draw(canopy, beam, density, scale, tangent, spot)
                fall = -rate * dt / canopy.height
                width = (below - above) / wp.where(wp.abs(fall) > FLAT, fall, 1.0)
                if wp.abs(fall) <= FLAT:
                    width = (
                        silhouette_above(canopy, relative - 0.5 * canopy.fine)
                        - silhouette_above(canopy, relative + 0.5 * canopy.fine)
                    ) / canopy.fine
                gain = density * width / canopy.height * speed * dt
                if gain >= beam.left:
                    hit.t = t + dt * beam.left / gain
                    hit.organ = wp.where(code == STANDING, wp.where(relative > EAR_ZONE, EAR, STEM), STUBBLE)
                    hit.cosine = canopy.cosine
                    hit.reflectance = scene.reflectance[hit.organ]
                    beam.left = 0.0
                    break
                beam.left -= gain
                beam.spent += gain
        above = below
        t += dt
    return hit, beam


@wp.func
def cross_fields(scene: Scene, canopy: Canopy, ray: Ray, hit: Hit, beam: Beam):
    """Nearest body in the field: tile by tile along the ray, until it leaves the known pages."""
    size = float(scene.tile_size)
    jx = int(0)  # tile from the ray's first one
    jy = int(0)
    t = float(0.0)
    last = int(-1)
    while True:
        gx = ray.tile_x + jx
        gy = ray.tile_y + jy
        px = floor_div(gx, 8)
        py = floor_div(gy, 8)
        slot = page_slot(scene, px, py)
        if slot < 0 or t >= hit.t:
            break
        if slot != last:  # down to the highest thing in the page at once, or on to the next
            last = slot
            roof = scene.page_top[slot] + canopy.room - ray.z0
            down = t
            if ray.o[2] + ray.d[2] * t > roof:
                down = wp.where(ray.d[2] < 0.0, (roof - ray.o[2]) / wp.min(ray.d[2], -1.0e-6), MISS)
            if down > t:
                bx = px * 8 - ray.tile_x
                by = py * 8 - ray.tile_y
                ex = float(bx + wp.where(ray.d[0] > 0.0, 8, 0)) * size * ray.inv[0] + ray.off[0]
                ey = float(by + wp.where(ray.d[1] > 0.0, 8, 0)) * size * ray.inv[1] + ray.off[1]
                out = wp.max(wp.min(ex, ey), t)
                t = wp.min(down, out)
                jx = wp.clamp(int(wp.floor((ray.o[0] + ray.d[0] * t) / size)), bx, bx + 7)
                jy = wp.clamp(int(wp.floor((ray.o[1] + ray.d[1] * t) / size)), by, by + 7)
                if down >= out:
                    if ex <= ey:
                        jx = wp.where(ray.d[0] > 0.0, bx + 8, bx - 1)
                    else:
                        jy = wp.where(ray.d[1] > 0.0, by + 8, by - 1)
                    continue
                gx = ray.tile_x + jx
                gy = ray.tile_y + jy
        ix = gx - px * 8
        iy = gy - py * 8
        tx = float(jx + wp.where(ray.d[0] > 0.0, 1, 0)) * size * ray.inv[0] + ray.off[0]
        ty = float(jy + wp.where(ray.d[1] > 0.0, 1, 0)) * size * ray.inv[1] + ray.off[1]
        leave = wp.max(wp.min(tx, ty), t)
        end = wp.min(leave, hit.t)
        plane = scene.tile_plane[slot, iy, ix]
        h1 = ray.d[2] - plane[1] * ray.d[0] - plane[2] * ray.d[1]
        h0 = (
            ray.o[2]
            - (plane[0] - ray.z0)
            - plane[1] * (ray.o[0] - (float(jx) + 0.5) * size)
            - plane[2] * (ray.o[1] - (float(jy) + 0.5) * size)
        )
        lowest = wp.min(h0 + h1 * t, h0 + h1 * end)
        bump = scene.tile_bump[slot, iy, ix] + SLACK
        if lowest <= bump:
            ta = t
            tb = end
            if h1 < 0.0:
                ta = wp.max(ta, (bump - h0) / h1)
            elif h1 > 0.0:
                tb = wp.min(tb, (bump - h0) / h1)
            corner = wp.vec2(float(px * 8 - ray.tile_x) * size, float(py * 8 - ray.tile_y) * size)
            hit = walk_ground(scene, ray, slot, corner, ix, iy, ta, tb, hit)
        stand = scene.tile_stand[slot, iy, ix]
        top = scene.tile_top[slot, iy, ix]
        if top > MARGIN:
            top += TOP_ROOM * top
            if lowest <= top:
                ta = t
                tb = wp.min(end, hit.t)
                if h1 < 0.0:
                    ta = wp.max(ta, (top - h0) / h1)
                elif h1 > 0.0:
                    tb = wp.min(tb, (top - h0) / h1)
                if ta < tb:
                    page = wp.vec3i(
                        (px * 8 - ray.tile_x) * 64, (py * 8 - ray.tile_y) * 64, scene.cut_slot[slot]
                    )
                    line = wp.vec2(h0, h1)
                    hit, beam = cross_canopy(scene, canopy, ray, page, stand, line, ta, tb, hit, beam)
        if hit.t <= leave:
            break
        t = leave
        if tx <= ty:
            jx += wp.where(ray.d[0] > 0.0, 1, -1)
        else:
            jy += wp.where(ray.d[1] > 0.0, 1, -1)
    return hit, beam


@wp.kernel(enable_backward=False)
def cast_bodies(
    scene: Scene,
    things: Things,
    canopy: Canopy,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    score: wp.array(dtype=float),
    range_max: float,
    out: wp.array2d(dtype=float),
):
    i = wp.tid()
    o = origins[i]
    v = directions[i]
    hit = hit_things(things, o, wp.vec3(v), no_hit(range_max))
    ray = to_stand(scene, o, v)
    beam = Beam()
    beam.share = 0.5 + 0.5 * wp.erf(score[i] * LN_HALF)
    beam.number = i
    beam.left = -1.0
    beam.spent = 0.0
    beam.whole = 0.0
    beam.lift = 0.0
    beam.clamped = 0
    hit, beam = cross_fields(scene, canopy, ray, hit, beam)
    if beam.spent > 0.0 and (hit.organ == GROUND or hit.organ == STRAW):
        lift = beam.lift * wp.min(1.0, beam.spent / wp.max(beam.whole, 1.0e-9))
        hit.t -= lift / wp.max(-ray.d[2], 0.05)
    out[i, 0] = hit.t
    out[i, 1] = float(hit.organ)
    out[i, 2] = hit.cosine
    out[i, 3] = hit.reflectance
    out[i, 4] = float(beam.clamped)
