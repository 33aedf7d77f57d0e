"""Exact intersections of a ray with one shape, in float32.

All return the distance along the unit direction to the first surface, MISS when there is none. A ray that
starts inside a closed shape does not see it. Differences of nearly equal squares are avoided: the distance
between lines comes from a cross product, and a sphere is tested by r^2 - |s - (s.d) d|^2.
"""

import warp as wp

MISS = wp.constant(1.0e30)


@wp.func
def hit_sphere(o: wp.vec3, d: wp.vec3, c: wp.vec3, rr: float) -> float:
    s = c - o
    along = wp.dot(s, d)
    q = s - along * d
    h = rr - wp.dot(q, q)
    if h < 0.0:
        return MISS
    return along - wp.sqrt(h)


@wp.func
def hit_capsule(o: wp.vec3, d: wp.vec3, a: wp.vec3, b: wp.vec3, r: float) -> float:
    """First surface; negative when the ray starts inside or has passed it."""
    u = b - a
    m = a - o
    n = wp.cross(d, u)
    nn = wp.dot(n, n)
    gap = wp.dot(m, n)
    rr = r * r
    h = rr * nn - gap * gap
    if h < 0.0:
        return MISS
    uu = wp.dot(u, u)
    du = wp.dot(d, u)
    if nn > 1.0e-10 * uu:
        t = (wp.dot(wp.cross(m, u), n) - wp.sqrt(h * uu)) / nn
        y = t * du - wp.dot(m, u)
        if y < 0.0:
            return hit_sphere(o, d, a, rr)
        if y > uu:
            return hit_sphere(o, d, b, rr)
        return t
    if du > 0.0:
        return hit_sphere(o, d, a, rr)
    return hit_sphere(o, d, b, rr)


@wp.func
def axis_point(p: wp.vec3, a: wp.vec3, b: wp.vec3) -> wp.vec3:
    """The point of the segment a b nearest to p."""
    u = b - a
    s = wp.dot(p - a, u) / wp.max(wp.dot(u, u), 1.0e-20)
    return a + wp.clamp(s, 0.0, 1.0) * u


@wp.func
def hit_facet(o: wp.vec3, d: wp.vec3, a: wp.vec3, b: wp.vec3, w: wp.vec3, taper: float) -> float:
    """Parallelogram a - w, a + w, b + w, b - w (taper 0) or triangle a - w, a + w, b (taper 1).

    Moeller and Trumbore 1997, doi:10.1080/10867651.1997.10487468, in coordinates s along a b and v across:
    0 <= s <= 1, |v| <= 1 - taper s.
    """
    u = b - a
    m = o - a
    p = wp.cross(d, w)
    det = wp.dot(u, p)
    s = wp.dot(m, p)
    if det < 0.0:
        det = -det
        s = -s
    if s < 0.0 or s > det:
        return MISS
    q = wp.cross(m, u)
    if wp.abs(wp.dot(d, q)) > det - taper * s or det < 1.0e-20:
        return MISS
    return wp.dot(w, q) / wp.dot(u, p)


@wp.func
def hit_box(o: wp.vec3, d: wp.vec3, half: wp.vec3) -> wp.vec4:
    """(distance, unit normal) on the box |x| <= half, in its own axes."""
    enter = float(-MISS)
    leave = float(MISS)
    axis = int(0)
    for i in range(3):
        if d[i] != 0.0:
            inv = 1.0 / d[i]
            t0 = (-half[i] - o[i]) * inv
            t1 = (half[i] - o[i]) * inv
            if wp.min(t0, t1) > enter:
                enter = wp.min(t0, t1)
                axis = i
            leave = wp.min(leave, wp.max(t0, t1))
        elif wp.abs(o[i]) > half[i]:
            leave = float(-MISS)
    if enter > leave:
        return wp.vec4(MISS, 0.0, 0.0, 0.0)
    n = wp.vec3(0.0, 0.0, 0.0)
    n[axis] = 1.0
    return wp.vec4(enter, n[0], n[1], n[2])


@wp.func
def hit_patch(h0: float, h1: float, bend: float, length: float) -> float:
    """First root in [0, length] of h0 + h1 t + bend t^2, the height of the ray above a bilinear patch.

    A ray that is below at the start and going down is taken to hit there: it slipped in by rounding.
    """
    if h0 <= 0.0:
        if h1 < 0.0:
            return 0.0
        return MISS
    disc = h1 * h1 - 4.0 * bend * h0
    if disc < 0.0:
        return MISS
    if h1 >= 0.0:
        if bend >= 0.0:
            return MISS
        t = -0.5 * (h1 + wp.sqrt(disc)) / bend
    else:
        t = 2.0 * h0 / (-h1 + wp.sqrt(disc))
    if t > length:
        return MISS
    return t
