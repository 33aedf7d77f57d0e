"""Straw over a polygon as masses on nodes, compiled; the class around it: `straw.Spreader`."""

import warp as wp

real = wp.float64
ZERO, ONE, HALF, THIRD = (wp.constant(real(n)) for n in (0.0, 1.0, 0.5, 1.0 / 3.0))
FAR = wp.constant(real(1.0e12))


@wp.struct
class Heap:
    """count: corners; mass [kg]; c, s: of the ridge's heading; middle, half: of it across, half 0 = even

    spacing: of the points in nodes. Back come u0, v0, u1, v1: first and last node with a point.
    """

    count: wp.float64
    mass: wp.float64
    c: wp.float64
    s: wp.float64
    middle: wp.float64
    half: wp.float64
    spacing: wp.float64
    u0: wp.float64
    v0: wp.float64
    u1: wp.float64
    v1: wp.float64


@wp.func
def weight(h: Heap, x: wp.float64, y: wp.float64) -> wp.float64:
    """Of a point: a parabola across the ridge, or 1."""
    if h.half <= ZERO:
        return ONE
    across = (h.c * y - h.s * x - h.middle) / h.half
    return wp.max(ONE - across * across, ZERO)


@wp.func
def lay(x: wp.float64, y: wp.float64, mass: wp.float64, h: Heap, laid: wp.array2d(dtype=wp.float64)):
    """A mass on the four nodes around a point."""
    u = wp.floor(x)
    v = wp.floor(y)
    fx = x - u
    fy = y - v
    i = wp.int32(u - h.u0)
    j = wp.int32(v - h.v0)
    laid[j, i] += (ONE - fx) * (ONE - fy) * mass
    laid[j, i + 1] += fx * (ONE - fy) * mass
    laid[j + 1, i] += (ONE - fx) * fy * mass
    laid[j + 1, i + 1] += fx * fy * mass


@wp.kernel(enable_backward=False)
def spread(
    heaps: wp.array(dtype=Heap), corners: wp.array(dtype=wp.vec2d), laid: wp.array2d(dtype=wp.float64)
):
    """Points in the middles of equal parts of the triangles of a convex polygon; `laid` begins at u0, v0."""
    h = heaps[0]
    h.u0 = FAR
    h.v0 = FAR
    h.u1 = -FAR
    h.v1 = -FAR
    a = corners[0]
    whole = ZERO
    for turn in range(2):  # first how much they weigh, then the mass
        for k in range(1, wp.int32(h.count) - 1):
            e = corners[k] - a
            f = corners[k + 1] - a
            longest = wp.max(wp.max(wp.length(e), wp.length(f)), wp.length(f - e))
            n = wp.max(wp.int32(wp.ceil(longest / h.spacing)), 1)
            area = HALF * wp.abs(e[0] * f[1] - e[1] * f[0]) / real(n * n)
            for j in range(n):
                for i in range(n - j):
                    for up in range(2):
                        if up == 0 or i + j < n - 1:
                            third = THIRD * real(1 + up)
                            p = a + e * ((real(i) + third) / real(n)) + f * ((real(j) + third) / real(n))
                            part = area * weight(h, p[0], p[1])
                            if turn == 0:
                                whole += part
                                h.u0 = wp.min(h.u0, wp.floor(p[0]))
                                h.v0 = wp.min(h.v0, wp.floor(p[1]))
                                h.u1 = wp.max(h.u1, wp.floor(p[0]))
                                h.v1 = wp.max(h.v1, wp.floor(p[1]))
                            elif whole > ZERO:
                                lay(p[0], p[1], part * (h.mass / whole), h, laid)
    heaps[0] = h
