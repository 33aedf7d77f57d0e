"""Heights of the ground under a few fixed points of a moving body: the lean way of `Field.ground_height`.

The pages around the points lie in one array of nodes until the body leaves them. Ground never changes, so the
array needs no renewal; where its borders are does not enter the result.
"""

from collections.abc import Callable
from math import ceil, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.memory_layout import PAGE_NODES
from swath.kernels import Row, numbers, repeatable, start_warp

Array = NDArray[np.float64]
Block = tuple[int, int, Array]  # first page column and row, heights of the nodes [m], (rows, columns)
STEP = 0.5  # a body may go on so far from the place it is held for [m]
AHEAD = 1.0  # pages are taken so far ahead [m]


class Footprint:
    """Points of a body that stands in the field.

    points: (n, 2) in the body's frame [m]; turn: heading of the body's world in the stand frame, cos and sin;
    node: lattice spacing [m]; pages_of: heights of a rectangle of pages, by its first and last column, first
    and last row; groups: equal parts of the points, each in a row, that `means` averages over

    ground: for kernels of others, which call `_footprint.read_points`
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
        from swath.field.footprint_kernel import read_heights

        at = np.asarray(points, dtype=float) / node
        self._turn, self._per_m, self._pages_of = turn, 1.0 / node, pages_of
        self._reach = float(np.hypot(*at.T).max()) + STEP / node
        side = PAGE_NODES * (1 + ceil(2.0 * (self._reach + AHEAD / node) / PAGE_NODES)) + 1
        self.ground = make_ground(at, groups, side)
        self.ground.c, self.ground.s, self.ground.per_m = *turn, self._per_m
        shared = self.ground.first, self.ground.nodes, self.ground.heights, self.ground.means
        self._first, self._nodes, self._heights, self._means = (a.numpy() for a in shared)
        self._place = Row(start_warp().vec3d)
        self._launch = repeatable(read_heights, [self._place.array, self.ground]).launch
        self._inside = (0.0, -1.0, 0.0, -1.0)

    def heights(self, x: float, y: float, yaw: float) -> Array:
        """Height of the ground [m] under the points, (n,), the body being at x, y [m] with heading yaw [rad]
        in the world. Equal to `Field.ground_height` but for rounding.
        """
        self._read(x, y, yaw)
        found: Array = self._heights.copy()
        return found

    def means(self, x: float, y: float, yaw: float) -> list[float]:
        """Mean height of the ground [m] under each group of points."""
        self._read(x, y, yaw)
        found: list[float] = self._means.tolist()
        return found

    def hold(self, x: float, y: float) -> None:
        """Have the ground at hand for any heading of the body at x, y [m] and up to STEP from there."""
        (c, s), n = self._turn, self._per_m
        u, v = (c * x + s * y) * n, (c * y - s * x) * n
        low_u, high_u, low_v, high_v = self._inside
        if not (low_u <= u <= high_u and low_v <= v <= high_v):
            self._take(u, v)

    def _read(self, x: float, y: float, yaw: float) -> None:
        if not isfinite(yaw):
            raise InputError("heading", yaw, "expected a finite heading")
        self.hold(x, y)
        self._place.write(x, y, yaw)
        self._launch()

    def _take(self, u: float, v: float) -> None:
        n, reach = PAGE_NODES, self._reach + AHEAD * self._per_m
        block = self._pages_of((u - reach) // n, (u + reach) // n, (v - reach) // n, (v + reach) // n)
        i, j, heights = block
        rows, columns = heights.shape
        self._first[:] = n * i, n * j
        self._nodes[:rows, :columns] = heights
        low_u, low_v = n * i + self._reach, n * j + self._reach
        high_u, high_v = n * i + columns - 1 - self._reach, n * j + rows - 1 - self._reach
        self._inside = (low_u, high_u, low_v, high_v)


def make_ground(points: Array, groups: int, side: int) -> Any:
    """`_footprint.Ground` with room for side x side nodes; points (n, 2) in nodes."""
    from swath.field.footprint_kernel import Ground

    ground = Ground()
    ground.points, ground.first = numbers(len(points), 2), numbers(2, whole=True)
    ground.points.numpy()[:] = points
    ground.nodes, ground.heights, ground.means = numbers(side, side), numbers(len(points)), numbers(groups)
    return ground
