"""The rays of a scan through the canopy, compiled: `trace` and the plane of the stubble, then `answer`."""

import warp as wp

from swath.control.edge import canopy_classes as k

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

real = wp.float64
ZERO, HALF, ONE = (wp.constant(real(n)) for n in (0.0, 0.5, 1.0))
NAN = wp.constant(real(float("nan")))
FAR, NEAR, STEEPEST, REPEATS, LAYER, LOWEST, HEADROOM, HEAD = (
    wp.constant(real(n))
    for n in (k.FAR, k.NEAR, k.STEEPEST, k.REPEATS, k.LAYER, k.LOWEST, k.HEADROOM, k.ROOM)
)
LIMIT, INWARD, OUTWARD, OUTWARD_SHARE = (
    wp.constant(real(n)) for n in (k.LIMIT, k.INWARD, k.OUTWARD, k.OUTWARD_SHARE)
)
GROUND_REACH, GROUND_MOST, GROUND_LEAST, GROUND_SPREAD = (
    wp.constant(real(n)) for n in (k.GROUND_REACH, k.GROUND_MOST, k.GROUND_LEAST, k.GROUND_SPREAD)
)
CELL, HALF_WIDTH = wp.constant(real(k.CELL)), wp.constant(real(k.HALF))
LEAST_FALL = wp.constant(real(-1e-3))
LAYERS, DUST, NOTHING, AIR, CLASSES, PLACES = (
    wp.constant(n) for n in (k.LAYERS, k.DUST, k.NOTHING, k.AIR, k.CLASSES, k.PLACES)
)
FALLING, BESIDES, CLOSE = (wp.constant(n) for n in range(3))  # of the counts that `trace` gives
COUNTED, MIDDLE = wp.constant(0), wp.constant(1)  # of those that `answer` gives


@wp.struct
class Way:
    """How the machine moves during a scan, where its scanner sits, where the edge is expected: an arc in the
    machine's (x, u). low, high: of what lies on the stubble, beside the edge [m]; level, slope, prior, steep:
    the plane before and what it is worth.
    """

    count: wp.float64
    speed: wp.float64
    turning: wp.float64
    sign: wp.float64
    x: wp.float64
    y: wp.float64
    z: wp.float64
    edge_x: wp.float64
    edge_u: wp.float64
    cos: wp.float64
    sin: wp.float64
    bend: wp.float64
    low: wp.float64
    high: wp.float64
    level: wp.float64
    slope: wp.float64
    prior: wp.float64
    steep: wp.float64


@wp.struct
class Canopy:
    """Plane of the stubble, seen about a place x [m] and rising ahead by `grade` [1]; height of the crop [m];
    how far tops stand ahead and aside of feet [1].
    """

    count: wp.float64
    level: wp.float64
    slope: wp.float64
    x: wp.float64
    grade: wp.float64
    height: wp.float64
    ahead: wp.float64
    aside: wp.float64


@wp.struct
class Traced:
    """What falls: start and direction in (x, u, z), distance, nan = no echo; before: in the last scan.

    stands: 1 = both are alike; of the stubble: x, u, z [m].
    """

    start: wp.array(dtype=wp.vec3d)
    aim: wp.array(dtype=wp.vec3d)
    distance: wp.array(dtype=wp.float64)
    before: wp.array(dtype=wp.float64)
    stands: wp.array(dtype=int)
    x: wp.array(dtype=wp.float64)
    u: wp.array(dtype=wp.float64)
    z: wp.array(dtype=wp.float64)


@wp.struct
class Answers:
    """Height above the stubble, place beside the edge at the crop's top and at the lower limit [m], of every
    ray; of those that count: cell, place and class, flat; solid: it stands; ahead, of an echo in the canopy
    along the edge [m], else nan.
    """

    height: wp.array(dtype=wp.float64)
    upper: wp.array(dtype=wp.float64)
    lower: wp.array(dtype=wp.float64)
    cell: wp.array(dtype=wp.int64)
    solid: wp.array(dtype=int)
    ahead: wp.array(dtype=wp.float64)


@wp.func
def place(way: Way, x: wp.float64, u: wp.float64) -> wp.vec2d:
    """(along, beside) the arc [m]; second order in the way along."""
    dx = x - way.edge_x
    du = u - way.edge_u
    along = way.cos * dx + way.sin * du
    return wp.vec2d(along, way.cos * du - way.sin * dx - HALF * way.bend * along * along)


@wp.kernel(enable_backward=False)
def trace(
    ways: wp.array(dtype=Way),
    directions: wp.array(dtype=wp.vec3d),
    ago: wp.array(dtype=wp.float64),
    ranges: wp.array(dtype=wp.float64),
    rays: Traced,
    plane: wp.array(dtype=wp.float64),
    counts: wp.array(dtype=int),
):
    """Rays of a moving machine; least squares of the plane, two rounds about the one before."""
    way = ways[0]
    n = int(0)
    ground = int(0)
    for i in range(int(way.count)):
        d = directions[i]
        if d[2] < STEEPEST:
            t = ago[i]
            turn = way.sign * way.turning * t
            c = wp.cos(turn)
            s = wp.sin(turn)
            start = wp.vec3d(
                way.speed * t + c * way.x - s * way.y,
                way.sign * (HALF * way.speed * t * turn + s * way.x + c * way.y),
                way.z,
            )
            aim = wp.vec3d(c * d[0] - s * d[1], way.sign * (s * d[0] + c * d[1]), d[2])
            r = ranges[i]
            if not (r > ZERO and r < FAR):
                r = NAN
            rays.start[n] = start
            rays.aim[n] = aim
            rays.distance[n] = r
            stands = int(0)
            if wp.abs(r - rays.before[n]) < REPEATS * r:
                stands = 1
            rays.stands[n] = stands
            rays.before[n] = r
            n += 1
            if r > NEAR and stands == 1:
                p = start + aim * r
                beside = place(way, p[0], p[1])[1]
                if beside > way.low and beside < way.high and p[2] < GROUND_MOST and p[2] > GROUND_LEAST:
                    rays.x[ground] = p[0]
                    rays.u[ground] = p[1] - way.edge_u
                    rays.z[ground] = p[2]
                    ground += 1
    level = way.level
    slope = way.slope
    close = int(0)
    for _ in range(2):
        close = int(0)
        s0 = way.prior
        s1 = real(0.0)
        s2 = way.steep
        b0 = way.prior * way.level
        b1 = way.steep * way.slope
        for i in range(ground):
            if wp.abs(rays.z[i] - way.level) < GROUND_REACH:
                u = rays.u[i]
                away = (rays.z[i] - level - slope * u) / GROUND_SPREAD
                w = ONE / ((ONE + away * away) * (ONE + away * away))
                s0 += w
                s1 += w * u
                s2 += w * u * u
                b0 += w * rays.z[i]
                b1 += w * u * rays.z[i]
                close += 1
        det = s0 * s2 - s1 * s1
        level = (s2 * b0 - s1 * b1) / det
        slope = (s0 * b1 - s1 * b0) / det
    plane[0] = level
    plane[1] = slope
    counts[FALLING] = n
    counts[BESIDES] = ground
    counts[CLOSE] = close


@wp.func
def above_stubble(way: Way, crop: Canopy, p: wp.vec3d) -> wp.float64:
    """Height of a point above the stubble side."""
    return p[2] - crop.level - crop.slope * (p[1] - way.edge_u) - crop.grade * (p[0] - crop.x)


@wp.func
def crossing(way: Way, crop: Canopy, start: wp.vec3d, aim: wp.vec3d, height: wp.float64) -> wp.vec2d:
    """(along, beside) of where a ray is at a height above the stubble side, moved to the foot."""
    falls = wp.min(aim[2] - crop.slope * aim[1] - crop.grade * aim[0], LEAST_FALL)
    p = start + aim * wp.clamp((height - above_stubble(way, crop, start)) / falls, ZERO, FAR + FAR)
    return place(way, p[0] - crop.ahead * height, p[1] - crop.aside * height)


@wp.kernel(enable_backward=False)
def answer(
    ways: wp.array(dtype=Way),
    crops: wp.array(dtype=Canopy),
    rays: Traced,
    answers: Answers,
    sums: wp.array(dtype=wp.float64),
    counts: wp.array(dtype=int),
):
    """Class and place of every ray. sums: of the way along of rays within 1 m of the edge."""
    way = ways[0]
    crop = crops[0]
    limit = LIMIT * crop.height
    counted = int(0)
    middle = int(0)
    sum_along = real(0.0)
    for i in range(int(crop.count)):
        start = rays.start[i]
        aim = rays.aim[i]
        upper = crossing(way, crop, start, aim, crop.height)
        end = crossing(way, crop, start, aim, limit)
        answers.upper[i] = upper[1]
        answers.lower[i] = end[1]
        kind = int(NOTHING)
        height = real(NAN)
        ahead = real(NAN)
        r = rays.distance[i]
        if r < NEAR:
            kind = AIR
        elif r == r:
            p = start + aim * r
            height = above_stubble(way, crop, p)
            if height > HEADROOM * crop.height + HEAD:
                kind = DUST
            else:
                kind = int(wp.clamp((height - LOWEST) / LAYER, ZERO, real(LAYERS - 1)))
                if height > limit:
                    end = place(way, p[0] - crop.ahead * height, p[1] - crop.aside * height)
                    ahead = end[0]
        answers.height[i] = height
        inner = upper
        through = end[1] - upper[1]
        back = wp.min(-OUTWARD_SHARE * through, OUTWARD)
        if through > ZERO:
            inner = end
            back = wp.min(through, INWARD)
        beside = inner[1] - back
        cell = wp.floor((beside + HALF_WIDTH) / CELL)
        if cell >= ZERO and cell < real(PLACES):
            answers.cell[counted] = wp.int64(cell) * wp.int64(CLASSES) + wp.int64(kind)
            answers.solid[counted] = rays.stands[i]
            answers.ahead[counted] = ahead
            counted += 1
            if wp.abs(beside) < ONE:
                sum_along += inner[0]
                middle += 1
    sums[0] = sum_along
    counts[COUNTED] = counted
    counts[MIDDLE] = middle
