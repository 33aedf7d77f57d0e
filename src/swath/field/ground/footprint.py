"""Heights of the ground under a few fixed points of a moving body, quicker than `Field.ground_height`.

The pages around the points lie in one array of nodes until the body leaves them. Ground never changes, so the
array needs no renewal; where its borders are does not enter the result.
"""

from collections.abc import Callable
from functools import partial
from math import cos, isfinite, sin
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.kernels import Repeated, Row, repeatable, start_warp

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
    groups: equal parts of the points, each in a row, that `means` averages over
    """

    def __init__(
        self,
        points: Any,
        turn: tuple[float, float],
        node: float,
        nodes_around: Callable[[float, float, float, tuple[float, float]], Block],
        *,
        groups: int = 1,
    ) -> None:
        at = np.asarray(points, dtype=float) / node
        self._points = np.ascontiguousarray(at.T)
        self._turn, self._per_m, self._nodes_around, self._groups = turn, 1.0 / node, nodes_around, groups
        self._extent = float(np.hypot(*at.T).max())
        self._held: Block = (0, 0, np.zeros((0, 0)))
        self._inside = (0.0, -1.0, 0.0, -1.0)
        self._first, self._means = np.zeros(2, np.int32), np.zeros(groups)
        self._launch: Any = None
        self._span: Row | None = None
        self._readers: list[tuple[Repeated, int]] = []

    def heights(self, x: float, y: float, yaw: float) -> Array:
        """Height of the ground [m] under the points, (n,), the body being at x, y [m] with heading yaw [rad]
        in the world. Equal to `Field.ground_height` but for rounding. InputError on a place or heading that
        is not finite, or far out of the field.
        """
        u, v, c, s = self._place(x, y, yaw)
        px, py = self._points
        return self._bilinear(u + (px * c - py * s), v + (px * s + py * c))

    def means(self, x: float, y: float, yaw: float) -> list[float]:
        """Mean height of the ground [m] under each group of points, compiled."""
        place = self._place(x, y, yaw)
        if self._launch is None:
            self._compile()
        self._asked.write(*place)
        self._launch.launch()
        return list(self._read())

    def take(self, x: float, y: float, yaw: float) -> None:
        """Hold the nodes around a place [m] of the body with heading yaw [rad]. InputError as `heights`."""
        self._place(x, y, yaw)

    def arguments(self) -> list[Any]:
        """For kernels that look up the ground themselves: nodes, first, points of `mean_heights`, Span.

        Nodes are replaced when the body leaves them, see `serve`.
        """
        from swath.field.ground.footprint_kernel import Span

        if self._span is None:
            self._span = Row(Span)
            self._tell_span()
        array = start_warp().array
        shared = [array(a, device="cpu", copy=False) for a in (self._held[2], self._first, self._points)]
        return [*shared, self._span.array]

    def serve(self, launch: Repeated, index: int) -> None:
        """From now on this argument of a launch is the nodes in memory."""
        self._readers.append((launch, index))

    def _tell_span(self) -> None:
        if self._span is not None:
            self._span.write(*self._turn, self._per_m, *self._inside)

    def _place(self, x: float, y: float, yaw: float) -> tuple[float, float, float, float]:
        """Place in nodes of the stand frame, cosine and sine of the heading in it; takes the pages there."""
        if not isfinite(yaw):
            raise InputError("heading", yaw, "expected a finite heading")
        (c, s), n, cy, sy = self._turn, self._per_m, cos(yaw), sin(yaw)
        u, v = (c * x + s * y) * n, (c * y - s * x) * n
        low_u, high_u, low_v, high_v = self._inside
        turn = c * cy + s * sy, c * sy - s * cy
        if not (low_u <= u <= high_u and low_v <= v <= high_v):
            self._take(u, v, turn)
        return u, v, *turn

    def _compile(self) -> None:
        """The launch, over memory that is shared with it."""
        from swath.field.ground import footprint_kernel as kernel

        self._asked = Row(kernel.Place)
        nodes, first, points, _ = self.arguments()
        means = start_warp().array(self._means, device="cpu", copy=False)
        self._read = partial(Struct(f"{self._groups}d").unpack_from, self._means.data.cast("B"))
        self._launch = repeatable(kernel.mean_heights, [nodes, first, points, self._asked.array, means])
        self.serve(self._launch, 0)

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

    def _take(self, u: float, v: float, turn: tuple[float, float]) -> None:
        """Hold the nodes around a place."""
        i, j, nodes = self._nodes_around(u, v, self._extent + AHEAD * self._per_m, turn)
        rows, columns = nodes.shape
        self._held = i, j, np.ascontiguousarray(nodes)
        self._first[:] = i, j
        for launch, index in self._readers:
            launch.set_param_at_index(index, start_warp().array(self._held[2], device="cpu", copy=False))
        e = self._extent + 1e-6
        self._inside = (i + e, i + columns - 1 - e, j + e, j + rows - 1 - e)
        self._tell_span()
