"""Straw over the nodes around a convex polygon, as one serial loop; float64 without fused multiply-adds."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

# places in `whole`: asked, then told
CORNERS = wp.constant(0)
IS_RIDGE = wp.constant(1)
FIRST_U = wp.constant(2)
FIRST_V = wp.constant(3)
LAST_U = wp.constant(4)
LAST_V = wp.constant(5)


@wp.struct
class Ridge:
    """mass [kg]; c, s: cosine and sine of the heading; middle, half: of the ridge across it [nodes].

    spacing: longest side of a part of a triangle [nodes]
    """

    mass: wp.float64
    c: wp.float64
    s: wp.float64
    middle: wp.float64
    half: wp.float64
    spacing: wp.float64


@wp.func
def parts_along(e: wp.vec2d, f: wp.vec2d, spacing: wp.float64) -> int:
    """Into how many parts each side of a triangle is divided; e, f: two of its sides."""
    g = f - e
    longest = wp.max(
        wp.max(wp.sqrt(e[0] * e[0] + e[1] * e[1]), wp.sqrt(f[0] * f[0] + f[1] * f[1])),
        wp.sqrt(g[0] * g[0] + g[1] * g[1]),
    )
    return wp.max(int(wp.ceil(longest / spacing)), 1)


@wp.func
def middle_of(i: int, up: int, n: int) -> wp.float64:
    """Share of a side at which the middle of part i lies."""
    third = (wp.float64(1.0) + wp.float64(up)) / wp.float64(3.0)
    return (wp.float64(i) + third) / wp.float64(n)


@wp.func
def share_at(ridge: Ridge, is_ridge: int, point: wp.vec2d) -> wp.float64:
    """Height of the ridge at a point, 1 in its middle."""
    if is_ridge == 0:
        return wp.float64(1.0)
    off = (ridge.c * point[1] - ridge.s * point[0] - ridge.middle) / ridge.half
    return wp.max(wp.float64(1.0) - off * off, wp.float64(0.0))


@wp.kernel
def lay(
    corners: wp.array(dtype=wp.vec2d),
    numbers: wp.array(dtype=Ridge),
    whole: wp.array(dtype=int),
    laid: wp.array(dtype=wp.float64),
):
    """Lays a mass on nodes: every point of a lattice over the polygon its share on the four around it.

    laid: mass on the nodes from (FIRST_U, FIRST_V) to (LAST_U, LAST_V), row by row; nothing is reported or
    laid where LAST_U stays below FIRST_U
    """
    ridge = numbers[0]
    is_ridge = whole[IS_RIDGE]
    total = wp.float64(0.0)
    whole[FIRST_U] = 1 << 30
    whole[FIRST_V] = 1 << 30
    whole[LAST_U] = -(1 << 30)
    whole[LAST_V] = -(1 << 30)
    for turn in range(2):  # sums first, then masses
        per_weight = wp.float64(0.0)
        columns = int(0)
        if turn == 1:
            if total <= wp.float64(0.0):
                whole[LAST_U] = whole[FIRST_U] - 1
                return
            whole[LAST_U] = whole[LAST_U] + 1
            whole[LAST_V] = whole[LAST_V] + 1
            per_weight = ridge.mass / total
            columns = whole[LAST_U] - whole[FIRST_U] + 1
            for k in range(columns * (whole[LAST_V] - whole[FIRST_V] + 1)):
                laid[k] = wp.float64(0.0)
        a = corners[0]
        for corner in range(1, whole[CORNERS] - 1):
            e = corners[corner] - a
            f = corners[corner + 1] - a
            n = parts_along(e, f, ridge.spacing)
            area = wp.float64(0.5) * wp.abs(e[0] * f[1] - e[1] * f[0]) / wp.float64(n * n)
            for j in range(n):
                for i in range(n - j):
                    for up in range(2):
                        if up == 0 or i + j < n - 1:
                            x = middle_of(i, up, n)
                            y = middle_of(j, up, n)
                            px = a[0] + e[0] * x + f[0] * y
                            py = a[1] + e[1] * x + f[1] * y
                            weight = area * share_at(ridge, is_ridge, wp.vec2d(px, py))
                            low_u = wp.floor(px)
                            low_v = wp.floor(py)
                            u = int(low_u)
                            v = int(low_v)
                            if turn == 0:
                                total += weight
                                whole[FIRST_U] = wp.min(whole[FIRST_U], u)
                                whole[FIRST_V] = wp.min(whole[FIRST_V], v)
                                whole[LAST_U] = wp.max(whole[LAST_U], u)
                                whole[LAST_V] = wp.max(whole[LAST_V], v)
                            else:
                                share = weight * per_weight
                                fx = px - low_u
                                fy = py - low_v
                                gx = wp.float64(1.0) - fx
                                gy = wp.float64(1.0) - fy
                                k = (v - whole[FIRST_V]) * columns + u - whole[FIRST_U]
                                laid[k] = laid[k] + gx * gy * share
                                laid[k + 1] = laid[k + 1] + fx * gy * share
                                laid[k + columns] = laid[k + columns] + gx * fy * share
                                laid[k + columns + 1] = laid[k + columns + 1] + fx * fy * share
