"""What a line sweeps over between two moments, as convex polygons without gaps."""

from itertools import pairwise

import numpy as np

from swath.core.frames import Array, Pose


def line_ends(pose: Pose, x: float, left_y: float, right_y: float) -> Array:
    """World xy of a line across the machine, shape (2, 2): left end, right end [m]."""
    return pose.apply(((x, left_y, 0.0), (x, right_y, 0.0)))[:, :2]


def swept(before: Array, after: Array) -> list[Array]:
    """Convex polygons, anticlockwise, between two positions (2, 2) of a line, ends joined straight.

    A quad where the line moves ahead; two triangles that meet in a point where it turns about a point of its
    own (one end backs up); two triangles where the quad has a dent. Both positions of the line are edges of
    what is returned, so the next sweep joins without a gap. Empty when nothing moved.
    """
    left0, right0, left1, right1 = before[0], before[1], after[0], after[1]
    pivot = _crossing(left0, right0, left1, right1)
    if pivot is not None:
        parts = [np.array([left0, pivot, left1]), np.array([right0, right1, pivot])]
    else:
        quad = np.array([left0, right0, right1, left1])
        parts = [quad] if _is_convex(quad) else _halves(quad)
    return [p if signed_area(p) > 0 else p[::-1].copy() for p in parts if abs(signed_area(p)) > 1e-9]


def signed_area(polygon: Array) -> float:
    """Area [m2] of a polygon (n, 2), > 0 when anticlockwise."""
    (x0, y0), *rest = polygon.tolist()
    around = [(x - x0, y - y0) for x, y in rest]
    twice: float = sum(a[0] * b[1] - a[1] * b[0] for a, b in pairwise(around))
    return 0.5 * twice


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _is_convex(quad: Array) -> bool:
    turns = [_cross(quad[(i + 1) % 4] - quad[i], quad[(i + 2) % 4] - quad[(i + 1) % 4]) for i in range(4)]
    return min(turns) >= 0.0 or max(turns) <= 0.0


def _halves(quad: Array) -> list[Array]:
    """A dented quad as two triangles, split along the diagonal that lies inside it."""
    cuts = [[quad[[0, 1, 2]], quad[[0, 2, 3]]], [quad[[1, 2, 3]], quad[[1, 3, 0]]]]
    return min(cuts, key=lambda parts: sum(abs(signed_area(p)) for p in parts))


def _crossing(a0: Array, a1: Array, b0: Array, b1: Array) -> Array | None:
    """Point strictly inside both lines a0-a1 and b0-b1, None without one."""
    along, other, gap = a1 - a0, b1 - b0, b0 - a0
    det = _cross(along, other)
    if abs(det) < 1e-15:
        return None
    s, u = _cross(gap, other) / det, _cross(gap, along) / det
    return a0 + s * along if 0.0 < s < 1.0 and 0.0 < u < 1.0 else None
