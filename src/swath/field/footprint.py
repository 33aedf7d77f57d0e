"""Heights of the ground under a few fixed points of a moving body, quicker than `Field.ground_height`.

The pages around the points lie in one array of nodes until the body leaves them. Ground never changes, so the
array needs no renewal; where its borders are does not enter the result.
"""

from collections.abc import Callable
from functools import reduce
from math import cos, isfinite, sin
from operator import add
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.memory_layout import PAGE_NODES

Array = NDArray[np.float64]
Block = tuple[int, int, Array]  # first page column and row, heights of the nodes [m], (rows, columns)
AHEAD = 1.5  # pages are taken so far ahead [m]


class Footprint:
    """Points of a body that stands in the field.

    points: (n, 2) in the body's frame [m]; turn: heading of the body's world in the stand frame, cos and sin;
    node: lattice spacing [m]; pages_of: heights of a rectangle of pages, by its first and last column, first
    and last row; groups: equal parts of the points, each in a row, that `means` averages over
    """

    def __init__(
        self,
        points: Any,
        turn: tuple[float, float],
        node: float,
        pages_of: Callable[[float, float, float, float], Block],
        *,
        groups: int = 1,
    ) -> None:
        at = np.asarray(points, dtype=float) / node
        self._x, self._y = np.ascontiguousarray(at.T)
        self._turn, self._per_m, self._pages_of, self._groups = turn, 1.0 / node, pages_of, groups
        self._extent = float(np.hypot(*at.T).max())
        self._held: Block = (0, 0, np.zeros((0, 0)))
        self._inside = (0.0, -1.0, 0.0, -1.0)

    def heights(self, x: float, y: float, yaw: float) -> Array:
        """Height of the ground [m] under the points, (n,), the body being at x, y [m] with heading yaw [rad]
        in the world. Equal to `Field.ground_height` but for rounding. InputError on a place or heading that
        is not finite, or far out of the field.
        """
        if not isfinite(yaw):
            raise InputError("heading", yaw, "expected a finite heading")
        (c, s), n, cy, sy = self._turn, self._per_m, cos(yaw), sin(yaw)
        u, v = (c * x + s * y) * n, (c * y - s * x) * n
        low_u, high_u, low_v, high_v = self._inside
        if not (low_u <= u <= high_u and low_v <= v <= high_v):
            self._take(u, v)
        c, s = c * cy + s * sy, c * sy - s * cy
        return self._bilinear(u + (self._x * c - self._y * s), v + (self._x * s + self._y * c))

    def means(self, x: float, y: float, yaw: float) -> list[float]:
        """Mean height of the ground [m] under each group of points."""
        parts = self.heights(x, y, yaw).reshape(self._groups, -1)
        found: list[float] = (reduce(add, parts.T) / parts.shape[1]).tolist()
        return found

    def _bilinear(self, u: Array, v: Array) -> Array:
        """Heights [m] at places in nodes of the stand frame."""
        i, j, nodes = self._held
        low_u, low_v = np.floor(u), np.floor(v)
        fu, fv = u - low_u, v - low_v
        at = (low_v.astype(np.int64) - j) * nodes.shape[1] + (low_u.astype(np.int64) - i)
        flat, up = nodes.reshape(-1), nodes.shape[1]
        a, b = flat[at], flat[at + up]
        low, high = a + (flat[at + 1] - a) * fu, b + (flat[at + up + 1] - b) * fu
        heights: Array = low + (high - low) * fv
        return heights

    def _take(self, u: float, v: float) -> None:
        """Hold the pages around a place."""
        n, room = PAGE_NODES, self._extent + AHEAD * self._per_m
        i, j, nodes = self._pages_of((u - room) // n, (u + room) // n, (v - room) // n, (v + room) // n)
        rows, columns = nodes.shape
        self._held = n * i, n * j, np.ascontiguousarray(nodes)
        e = self._extent + 1e-6
        self._inside = (n * i + e, n * i + columns - 1 - e, n * j + e, n * j + rows - 1 - e)
