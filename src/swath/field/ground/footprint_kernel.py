"""Mean heights under groups of points, compiled."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.struct
class Place:
    """u, v: of the body, in nodes of the stand frame; c, s: cosine and sine of its heading in that frame."""

    u: wp.float64
    v: wp.float64
    c: wp.float64
    s: wp.float64


@wp.struct
class Span:
    """c, s: cosine and sine of the heading of the body's world in the stand frame; per_m: nodes per metre.

    low_u to high_v: places of the body [nodes] at which all its points lie on the nodes in memory
    """

    c: wp.float64
    s: wp.float64
    per_m: wp.float64
    low_u: wp.float64
    high_u: wp.float64
    low_v: wp.float64
    high_v: wp.float64


@wp.func
def height_at(
    nodes: wp.array2d(dtype=wp.float64), u: wp.float64, v: wp.float64, i: int, j: int
) -> wp.float64:
    """Bilinear between nodes; node (i, j) of the stand frame is the first of the array."""
    low_u = wp.floor(u)
    low_v = wp.floor(v)
    fu = u - low_u
    fv = v - low_v
    x = int(low_u) - i
    y = int(low_v) - j
    a = nodes[y, x]
    b = nodes[y + 1, x]
    low = a + (nodes[y, x + 1] - a) * fu
    high = b + (nodes[y + 1, x + 1] - b) * fu
    return low + (high - low) * fv


@wp.func
def mean_height(
    nodes: wp.array2d(dtype=wp.float64),
    first: wp.array(dtype=int),
    points: wp.array2d(dtype=wp.float64),
    p: Place,
    group: int,
    groups: int,
) -> wp.float64:
    """Mean height under one of the equal groups of points [m]; points: (2, n) in the body's frame [nodes]."""
    count = points.shape[1] / groups
    total = wp.float64(0.0)
    for k in range(group * count, (group + 1) * count):
        x = points[0, k]
        y = points[1, k]
        u = p.u + (x * p.c - y * p.s)
        v = p.v + (x * p.s + y * p.c)
        height = height_at(nodes, u, v, first[0], first[1])
        if k == group * count:
            total = height
        else:
            total = total + height
    return total / wp.float64(count)
