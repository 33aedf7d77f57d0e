"""The region where crop was sown: outside its outline and in its holes nothing grows."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError

Array = NDArray[np.float64]


class Region:
    """A polygon with holes. outline and each hole: points (n, 2) [m], closed or not, in any direction."""

    def __init__(self, outline: Any, holes: Iterable[Any] = (), *, key: str = "field.boundary") -> None:
        self.rings: tuple[Array, ...] = tuple(_ring(points, key) for points in (outline, *holes))
        self.area = ring_area(self.rings[0])
        if self.area < 1.0:
            raise InputError(key, None, f"expected an area of at least 1 m2, it is {self.area:.3g} m2")
        self._edges = np.concatenate([np.hstack([r, np.roll(r, -1, axis=0)]) for r in self.rings])

    def contains(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True inside, for world points [m], in the shape of x and y broadcast."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        inside = np.zeros(x.shape, dtype=bool)
        if x.size == 0:
            return inside
        low, high, left = y.min(), y.max(), x.min()
        for ax, ay, bx, by in self._edges:
            if ay == by or max(ay, by) < low or min(ay, by) > high or max(ax, bx) < left:
                continue  # no ray from any of the points to the right can cross it
            crosses = (ay > y) != (by > y)
            inside ^= crosses & (x < ax + (bx - ax) * ((y - ay) / (by - ay)))
        return inside

    def distance(self, x: Any, y: Any) -> Array:
        """Distance [m] of world points to the boundary line, in the shape of x and y broadcast."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        best = np.full(x.shape, np.inf)
        for ax, ay, bx, by in self._edges:
            dx, dy = bx - ax, by - ay
            t = np.clip(((x - ax) * dx + (y - ay) * dy) / max(dx * dx + dy * dy, 1e-300), 0.0, 1.0)
            best = np.minimum(best, np.hypot(ax + t * dx - x, ay + t * dy - y))
        return best


def ring_area(points: Array) -> float:
    """Area [m2] within a ring of points (n, 2)."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


def _ring(points: Any, key: str) -> Array:
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1] != 2 or not np.isfinite(p).all():
        raise InputError(key, points, "expected a list of finite [x, y]")
    if len(p) > 1 and np.array_equal(p[0], p[-1]):
        p = p[:-1]
    if len(p) < 3:
        raise InputError(key, None, "expected at least three points")
    return p
