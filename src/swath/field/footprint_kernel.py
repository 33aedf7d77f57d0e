"""Bilinear heights under the points of a body, compiled; the class around it: `footprint.Footprint`."""

import warp as wp

real = wp.float64


@wp.struct
class Ground:
    """The lattice around a body and the points of the body that are looked at.

    c, s: cosine and sine of the world's heading in the stand frame; per_m: nodes per metre
    points: (n, 2) of the body, in nodes; first: column and row of nodes[0, 0]; nodes: heights [m]
    heights: (n,) under the points [m]; means: over equal parts of the points in a row [m]
    """

    c: wp.float64
    s: wp.float64
    per_m: wp.float64
    points: wp.array2d(dtype=wp.float64)
    first: wp.array(dtype=wp.int32)
    nodes: wp.array2d(dtype=wp.float64)
    heights: wp.array(dtype=wp.float64)
    means: wp.array(dtype=wp.float64)


@wp.func
def bilinear(g: Ground, u: wp.float64, v: wp.float64) -> wp.float64:
    """Height [m] at u, v in nodes."""
    fu = u - wp.floor(u)
    fv = v - wp.floor(v)
    i = wp.clamp(wp.int32(u - fu) - g.first[0], 0, g.nodes.shape[1] - 2)
    j = wp.clamp(wp.int32(v - fv) - g.first[1], 0, g.nodes.shape[0] - 2)
    low = g.nodes[j, i] + (g.nodes[j, i + 1] - g.nodes[j, i]) * fu
    high = g.nodes[j + 1, i] + (g.nodes[j + 1, i + 1] - g.nodes[j + 1, i]) * fu
    return low + (high - low) * fv


@wp.func
def read_points(place: wp.vec3d, g: Ground):
    """Heights and means of a body at a place: x, y [m] and heading [rad] in the world."""
    cy = wp.cos(place[2])
    sy = wp.sin(place[2])
    c = g.c * cy + g.s * sy
    s = g.c * sy - g.s * cy
    u = (g.c * place[0] + g.s * place[1]) * g.per_m
    v = (g.c * place[1] - g.s * place[0]) * g.per_m
    group = g.points.shape[0] // g.means.shape[0]
    for part in range(g.means.shape[0]):
        total = real(0.0)
        for k in range(group * part, group * (part + 1)):
            x = g.points[k, 0]
            y = g.points[k, 1]
            z = bilinear(g, u + (x * c - y * s), v + (x * s + y * c))
            g.heights[k] = z
            total += z
        g.means[part] = total / real(group)


@wp.kernel(enable_backward=False)
def read_heights(places: wp.array(dtype=wp.vec3d), ground: Ground):
    read_points(places[0], ground)
