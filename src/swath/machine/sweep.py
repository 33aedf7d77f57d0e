"""What a line sweeps over between two moments, as convex polygons without gaps."""

from collections.abc import Iterable, Iterator, Sequence
from math import fsum, hypot

from swath.core.component import KeepsState

STILL = 1e-6  # a line that moves less stands [m]
Corner = list[float]  # x, y [m]
Corners = list[Corner]


def line_ends(pose: Sequence[float], x: float, left_y: float, right_y: float) -> Corners:
    """World xy of a line across the machine: left end, right end [m]. pose: 12 numbers, see `Row`."""
    px, py, _, a, b, _, d, e, *_ = pose
    ahead_x, ahead_y = a * x, d * x
    left = [ahead_x + b * left_y + px, ahead_y + e * left_y + py]
    return [left, [ahead_x + b * right_y + px, ahead_y + e * right_y + py]]


class LinePath(KeepsState):
    """Where a line on a machine was last. step: poses closer together than this are joined [m]."""

    kept = ("_last",)

    def __init__(self, step: float) -> None:
        self._step = step
        self.clear()

    def clear(self) -> None:
        """Nothing known of where it was."""
        self._last: Corners | None = None

    def over(self, lines: Iterable[Corners]) -> Iterator[tuple[Corners, Corners]]:
        """Positions of the line before and after every part of its way over new ones.

        lines: the line's points in the world; the first that ever comes only says where it is
        """
        every = [*lines]
        last = len(every) - 1
        for index, now in enumerate(every):
            if self._last is None:
                self._last = now
                continue
            least = max(self._step, STILL) if index < last else STILL
            for (x, y), (u, v) in zip(now, self._last, strict=True):
                if hypot(x - u, y - v) >= least:
                    yield self._last, now
                    self._last = now
                    break


def swept(before: Corners, after: Corners) -> list[Corners]:
    """Convex polygons, anticlockwise, between two positions of a line of two ends, joined straight.

    A quad where the line moves ahead; two triangles that meet in a point where it turns about a point of its
    own (one end backs up); two triangles where the quad has a dent. Both positions of the line are edges of
    what is returned, so the next sweep joins without a gap. Empty when nothing moved.
    """
    (left0, right0), (left1, right1) = before, after
    pivot = _crossing(left0, right0, left1, right1)
    if pivot is not None:
        parts = [[left0, pivot, left1], [right0, right1, pivot]]
    else:
        quad = [left0, right0, right1, left1]
        parts = [quad] if _is_convex(quad) else _halves(quad)
    areas = [signed_area(p) for p in parts]
    return [p if a > 0 else p[::-1] for p, a in zip(parts, areas, strict=True) if abs(a) > 1e-9]


def signed_area(polygon: Sequence[Sequence[float]]) -> float:
    """Area [m2] of a polygon, > 0 when anticlockwise."""
    x0, y0 = polygon[0]
    x, y = polygon[1]
    a, b, parts = x - x0, y - y0, []
    for x, y in polygon[2:]:
        c, d = x - x0, y - y0
        parts.append(a * d - b * c)
        a, b = c, d
    twice: float = fsum(parts)
    return 0.5 * twice


def _is_convex(quad: Corners) -> bool:
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = quad
    ex, ey, fx, fy = bx - ax, by - ay, cx - bx, cy - by
    gx, gy, hx, hy = dx - cx, dy - cy, ax - dx, ay - dy
    turns = ex * fy - ey * fx, fx * gy - fy * gx, gx * hy - gy * hx, hx * ey - hy * ex
    return min(turns) >= 0.0 or max(turns) <= 0.0


def _halves(quad: Corners) -> list[Corners]:
    """A dented quad as two triangles, split along the diagonal that lies inside it."""
    a, b, c, d = quad
    return min(
        [[[a, b, c], [a, c, d]], [[b, c, d], [b, d, a]]], key=lambda h: fsum(abs(signed_area(p)) for p in h)
    )


def _crossing(a0: Corner, a1: Corner, b0: Corner, b1: Corner) -> Corner | None:
    """Point strictly inside both lines a0-a1 and b0-b1, None without one."""
    ax, ay, bx, by = a1[0] - a0[0], a1[1] - a0[1], b1[0] - b0[0], b1[1] - b0[1]
    gx, gy = b0[0] - a0[0], b0[1] - a0[1]
    det = ax * by - ay * bx
    if abs(det) < 1e-15:
        return None
    s, u = (gx * by - gy * bx) / det, (gx * ay - gy * ax) / det
    return [a0[0] + s * ax, a0[1] + s * ay] if 0.0 < s < 1.0 and 0.0 < u < 1.0 else None
