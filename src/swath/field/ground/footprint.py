"""The ground under a few fixed points of a moving body, for kernels: quicker than `Field.ground_height`.

The pages around the points lie in one array of nodes until the body leaves them. Ground never changes, so the
array needs no renewal; where its borders are does not enter the result.
"""

from collections.abc import Callable
from math import cos, isfinite, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.kernels import Row, shared

Array = NDArray[np.float64]
Block = tuple[int, int, Array]  # first column and row of nodes, their heights [m], (rows, columns)
AHEAD = 1.5  # nodes are taken so far ahead [m]


class Footprint:
    """Points of a body that stands in the field.

    points: (n, 2) in the body's frame [m]
    turn: heading of the body's world in the stand frame, cos and sin
    node: lattice spacing [m]
    nodes_around: heights of the nodes as far as a room around a place, all in nodes of the stand frame, and
        farther where a body of this heading (cos and sin) goes
    """

    def __init__(
        self,
        points: Any,
        turn: tuple[float, float],
        node: float,
        nodes_around: Callable[[float, float, float, tuple[float, float]], Block],
    ) -> None:
        at = np.asarray(points, dtype=float) / node
        self._points = np.ascontiguousarray(at.T)
        self._turn, self._per_m, self._nodes_around = turn, 1.0 / node, nodes_around
        self._extent = float(np.hypot(*at.T).max())
        self._nodes, self._first = np.zeros((0, 0)), np.zeros(2, np.int32)
        self._inside = (0.0, -1.0, 0.0, -1.0)

    def take(self, x: float, y: float, yaw: float) -> None:
        """Hold the nodes around a place [m] of the body with heading yaw [rad] in the world.

        InputError on a place or heading that is not finite, or far out of the field.
        """
        if not isfinite(yaw):
            raise InputError("heading", yaw, "expected a finite heading")
        (c, s), n, cy, sy = self._turn, self._per_m, cos(yaw), sin(yaw)
        u, v = (c * x + s * y) * n, (c * y - s * x) * n
        low_u, high_u, low_v, high_v = self._inside
        if low_u <= u <= high_u and low_v <= v <= high_v:
            return
        turn = c * cy + s * sy, c * sy - s * cy
        i, j, nodes = self._nodes_around(u, v, self._extent + AHEAD * n, turn)
        rows, columns = nodes.shape
        self._nodes, self._first = np.ascontiguousarray(nodes), np.array([i, j], np.int32)
        e = self._extent + 1e-6
        self._inside = (i + e, i + columns - 1 - e, j + e, j + rows - 1 - e)

    def arguments(self) -> list[Any]:
        """For kernels, what is held now: nodes, first, points of `mean_height`, Span."""
        from swath.field.ground.footprint_kernel import Span

        span = Row(Span)
        span.write(*self._turn, self._per_m, *self._inside)
        return [*map(shared, (self._nodes, self._first, self._points)), span.array]
