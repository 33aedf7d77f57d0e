"""The edge beside the machine: a robust local parabola through the blocks around the place that is reported.

Interpolation, not extrapolation: the place lies just ahead of the knife, so that blocks stand on both sides:
the track's place abreast of the reference, and the parabola about it.
"""

import warp as wp

from swath.control.edge.line import line_weights as w

real = wp.float64
ZERO, HALF, ONE = (wp.constant(real(n)) for n in (0.0, 0.5, 1.0))
LARGE = wp.constant(real(1e300))
LOOK = wp.constant(real(w.LOOK))
REACH = wp.constant(real(w.REACH))
NEAREST = wp.constant(real(1.5))  # reach over the distance to the nearest point
FLOOR = wp.constant(real(1e-4))  # m2, of the variance of a point; ridge of the offset
TUKEY, MAD = wp.constant(real(w.TUKEY)), wp.constant(real(w.MAD))
LEAST_SPREAD = wp.constant(real(0.02))
NEAR_SHARE = wp.constant(real(0.05))
FEWEST = wp.constant(real(0.2))
SLOPE_PRIOR = wp.constant(real(1.0 / 0.5**2))
BENT, STRAIGHT, PROVEN = (wp.constant(real(n)) for n in (w.BENT, w.STRAIGHT, w.PROVEN))
DISTANCE, X, U, ALONG, BESIDE, WEIGHT, ROBUST, AWAY = (
    wp.constant(n) for n in range(8)
)  # rows of the scratch


@wp.struct
class Asked:
    """count: of points; x, u, heading: of the machine; front_...: the track's newest place, in the machine's
    frame; reference: abreast of which the edge is asked for [m].
    """

    count: wp.float64
    x: wp.float64
    u: wp.float64
    heading: wp.float64
    front_x: wp.float64
    front_u: wp.float64
    front_angle: wp.float64
    front_way: wp.float64
    reference: wp.float64


@wp.struct
class Line:
    """The edge near a place, in the machine's frame. x, u [m], angle [rad], bend [1/m]; offset_sd [m],
    angle_sd [rad].

    gap: distance along the edge from the place to the nearest point [m]; spread: of the points about the line
    [m]; seen_to: distance along the edge from the place to the last point [m]
    """

    x: wp.float64
    u: wp.float64
    angle: wp.float64
    bend: wp.float64
    offset_sd: wp.float64
    angle_sd: wp.float64
    gap: wp.float64
    spread: wp.float64
    seen_to: wp.float64


@wp.struct
class Parabola:
    """fitted: offset, slope, bend; covariance; spread of the points about it [m]."""

    fitted: wp.vec3d
    covariance: wp.mat33d
    spread: wp.float64


@wp.func
def between(s: wp.array2d(dtype=wp.float64), n: int, of: int, at: wp.float64) -> wp.float64:
    """Row `of` over row X at a place, linear between neighbours, held outside."""
    j = int(-1)
    for i in range(n):
        if s[X, i] <= at:
            j = int(i)
    if j < 0:
        return s[of, 0]
    if j == n - 1:
        return s[of, j]
    return s[of, j] + (s[of, j + 1] - s[of, j]) * ((at - s[X, j]) / (s[X, j + 1] - s[X, j]))


@wp.func
def median_away(s: wp.array2d(dtype=wp.float64), n: int) -> wp.float64:
    """Median of the first n of row AWAY, which it sorts; 0 of none."""
    if n == 0:
        return ZERO
    for i in range(1, n):
        value = s[AWAY, i]
        j = int(i)
        while j > 0 and s[AWAY, j - 1] > value:
            s[AWAY, j] = s[AWAY, j - 1]
            j = j - 1
        s[AWAY, j] = value
    if n % 2 == 1:
        return s[AWAY, n / 2]
    return HALF * (s[AWAY, n / 2 - 1] + s[AWAY, n / 2])


@wp.func
def residual(s: wp.array2d(dtype=wp.float64), i: int, p: wp.vec3d) -> wp.float64:
    a = s[ALONG, i]
    return s[BESIDE, i] - (p[0] + p[1] * a + p[2] * HALF * a * a)


@wp.func
def fit(s: wp.array2d(dtype=wp.float64), n: int, bend_sd: wp.float64) -> Parabola:
    """A parabola by three rounds of weighted least squares with Tukey's biweight; prior of the bend: 0."""
    most = real(0.0)
    for i in range(n):
        s[ROBUST, i] = ONE
        most = wp.max(most, s[WEIGHT, i])
    near = NEAR_SHARE * most
    line = Parabola()
    inverse = wp.mat33d()
    for _ in range(3):
        a = wp.mat33d(FLOOR, ZERO, ZERO, ZERO, SLOPE_PRIOR, ZERO, ZERO, ZERO, ONE / (bend_sd * bend_sd))
        b = wp.vec3d()
        for i in range(n):
            at = s[ALONG, i]
            v = wp.vec3d(ONE, at, HALF * at * at)
            weighted = v * (s[WEIGHT, i] * s[ROBUST, i])
            a += wp.outer(weighted, v)
            b += weighted * s[BESIDE, i]
        inverse = wp.inverse(a)
        line.fitted = inverse * b
        count = int(0)
        for i in range(n):
            if s[WEIGHT, i] > near:
                s[AWAY, count] = wp.abs(residual(s, i, line.fitted))
                count += 1
        line.spread = MAD * median_away(s, count)
        kept = real(0.0)
        whole = real(0.0)
        for i in range(n):
            r = residual(s, i, line.fitted) / (TUKEY * wp.max(line.spread, LEAST_SPREAD))
            t = wp.max(ONE - r * r, ZERO)
            s[ROBUST, i] = t * t
            if s[WEIGHT, i] > near:
                kept += s[WEIGHT, i] * s[ROBUST, i]
                whole += s[WEIGHT, i]
        if kept < FEWEST * whole:
            for i in range(n):
                s[ROBUST, i] = ONE
    squares = real(0.0)
    total = real(0.0)
    for i in range(n):
        r = residual(s, i, line.fitted)
        k = s[WEIGHT, i] * s[ROBUST, i]
        squares += k * s[WEIGHT, i] * r * r
        total += k
    line.covariance = inverse * wp.max(ONE, squares / wp.max(total, real(1e-9)))
    return line


@wp.func
def sort_by_way(
    points: wp.array(dtype=wp.vec4d),
    ask: Asked,
    s: wp.array2d(dtype=wp.float64),
    c: wp.float64,
    sn: wp.float64,
):
    """Points in the machine's frame and the track's front, by their distance; their x never falls."""
    n = int(ask.count)
    for i in range(n + 1):
        x = ask.front_x
        u = ask.front_u
        distance = ask.front_way
        if i < n:
            dx = points[i][0] - ask.x
            du = points[i][1] - ask.u
            x = c * dx + sn * du
            u = c * du - sn * dx
            distance = points[i][3]
        j = int(i)
        while j > 0 and s[DISTANCE, j - 1] > distance:
            for row in range(3):
                s[row, j] = s[row, j - 1]
            j = j - 1
        s[DISTANCE, j] = distance
        s[X, j] = x
        s[U, j] = u
    for i in range(1, n + 1):
        s[X, i] = wp.max(s[X, i], s[X, i - 1])


@wp.func
def near(ask: Asked, points: wp.array(dtype=wp.vec4d), s: wp.array2d(dtype=wp.float64)) -> Line:
    """points: (x, u, variance, distance) in the frame at rest; s: scratch, (8, room)."""
    n = int(ask.count)
    c = wp.cos(ask.heading)
    sn = wp.sin(ask.heading)
    sort_by_way(points, ask, s, c, sn)
    angle = ask.front_angle
    distance = s[DISTANCE, 0] - (s[X, 0] - ask.reference)
    if ask.reference >= s[X, 0]:
        rise = between(s, n + 1, U, ask.reference + LOOK) - between(s, n + 1, U, ask.reference - LOOK)
        angle = wp.atan2(rise, LOOK + LOOK)
        distance = between(s, n + 1, DISTANCE, ask.reference)
    place_u = between(s, n + 1, U, ask.reference)
    line = Line()
    line.gap = LARGE
    line.seen_to = -LARGE
    for i in range(n):
        line.gap = wp.min(line.gap, wp.abs(points[i][3] - distance))
        line.seen_to = wp.max(line.seen_to, points[i][3] - distance)
    reach = wp.max(REACH, NEAREST * line.gap)
    ca = wp.cos(angle)
    sa = wp.sin(angle)
    for i in range(n):
        dx = points[i][0] - ask.x
        du = points[i][1] - ask.u
        x = c * dx + sn * du - ask.reference
        u = c * du - sn * dx - place_u
        s[ALONG, i] = ca * x + sa * u
        s[BESIDE, i] = ca * u - sa * x
        away = (points[i][3] - distance) / reach
        s[WEIGHT, i] = wp.exp(-HALF * away * away) / (points[i][2] + FLOOR)
    p = fit(s, n, BENT)
    bend_sd = wp.sqrt(p.covariance[2, 2])
    if wp.abs(p.fitted[2]) < PROVEN * bend_sd:
        p = fit(s, n, wp.max(STRAIGHT, wp.min(wp.abs(p.fitted[2]), HALF * bend_sd)))
    slope = p.fitted[1]
    steep = wp.sqrt(ONE + slope * slope)
    line.x = ask.reference - p.fitted[0] * sa
    line.u = place_u + p.fitted[0] * ca
    line.angle = angle + wp.atan(slope)
    line.bend = p.fitted[2] / (steep * steep * steep)
    line.offset_sd = wp.sqrt(p.covariance[0, 0])
    line.angle_sd = wp.sqrt(p.covariance[1, 1])
    line.spread = p.spread
    return line
