"""Heights of the ground under a few fixed points of a moving body: the lean way of `Field.ground_height`.

The pages under the points lie in one array of nodes until the body leaves them. Ground never changes, so the
array needs no renewal; where its borders are does not enter the result.
"""

from collections.abc import Callable
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import PAGE_NODES

Array = NDArray[np.float64]
Block = tuple[int, int, Array]  # first page column and row, heights of the nodes [m], (rows, columns)


class Footprint:
    """Points of a body that stands in the field.

    points: (n, 2) in the body's frame [m]; turn: heading of the body's world in the stand frame, cos and sin;
    node: lattice spacing [m]; pages_of: heights of a rectangle of pages, by its first and last column, first
    and last row
    """

    def __init__(
        self,
        points: Any,
        turn: tuple[float, float],
        node: float,
        pages_of: Callable[[float, float, float, float], Block],
    ) -> None:
        at = np.asarray(points, dtype=float) / node
        low, high = at.min(axis=0), at.max(axis=0)
        self._middle = tuple((0.5 * (low + high)).tolist())
        self._half = tuple((0.5 * (high - low) + 1e-6).tolist())
        x, y = at.T
        self._along, self._across = np.stack([x, y]), np.stack([-y, x])
        self._turn, self._node, self._pages_of = turn, node, pages_of
        self._origin = np.zeros((2, 1))  # only a place to work in
        self._use((0, 0, np.zeros((0, 0))))

    def heights(self, x: float, y: float, yaw: float) -> Array:
        """Height of the ground [m] under the points, (n,), the body being at x, y [m] with heading yaw [rad]
        in the world. Equal to `Field.ground_height` but for rounding.
        """
        tc, ts = self._turn
        c, s = cos(yaw), sin(yaw)
        c, s = tc * c + ts * s, tc * s - ts * c
        u0, v0 = (tc * x + ts * y) / self._node, (tc * y - ts * x) / self._node
        self._reach(u0, v0, c, s)
        origin = self._origin
        origin[0, 0], origin[1, 0] = u0, v0
        w = self._along * c
        w += self._across * s
        w += origin
        k = np.floor(w)
        w -= k
        at = k[1] * self._width
        at += k[0]
        z = self._flat.take(at.astype(np.intp) + self._corners)
        near, far = z[:2], z[2:]
        far -= near
        far *= w[0]
        near += far
        low: Array = near[0]
        high = near[1]
        high -= low
        high *= w[1]
        low += high
        return low

    def _reach(self, u0: float, v0: float, c: float, s: float) -> None:
        """Have the pages at hand that the rectangle about all points touches."""
        (mx, my), (hx, hy), n = self._middle, self._half, PAGE_NODES
        u, du = u0 + c * mx - s * my, abs(c) * hx + abs(s) * hy
        v, dv = v0 + s * mx + c * my, abs(s) * hx + abs(c) * hy
        low_u, low_v, high_u, high_v = self._inside
        if low_u <= u - du and u + du < high_u and low_v <= v - dv and v + dv < high_v:
            return
        self._use(self._pages_of((u - du) // n, (u + du) // n, (v - dv) // n, (v + dv) // n))

    def _use(self, block: Block) -> None:
        i, j, heights = block
        rows, columns = heights.shape
        u, v = PAGE_NODES * i, PAGE_NODES * j
        self._inside = (u, v, u + columns - 1, v + rows - 1)
        self._width, self._flat = columns, heights.ravel()
        corners = np.array([0, columns, 1, columns + 1])  # both of the left, both of the right
        self._corners = corners[:, None] - (u + v * columns)
