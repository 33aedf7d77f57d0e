"""Where a machine can drive in a field that is being cut: outside of it, and where the crop is gone."""

from collections.abc import Iterator, Sequence
from copy import copy
from itertools import pairwise
from math import ceil, cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Point = tuple[float, float]
FINEST = 0.5  # side of the cells [m]
MOST_CELLS = 400  # along a side of a square field
AROUND = 30.0  # how far beyond the boundary, and about other places, one can drive [m]
ROOM = 0.5  # m to both sides of a header that comes by outside of the field


class Ground:
    """Cells that are not driven on: standing crop, and where a header comes by outside of the field.

    boundary: ring of the field; places: beside it [m]
    """

    def __init__(self, boundary: Sequence[Point], places: Sequence[Point] = ()) -> None:
        ring = np.asarray(boundary, dtype=float)
        known = np.concatenate([ring, np.asarray(places, dtype=float).reshape(-1, 2)])
        west, south = (known.min(axis=0) - AROUND).tolist()
        east, north = (known.max(axis=0) + AROUND).tolist()
        self.cell = max(FINEST, max(east - west, north - south) / MOST_CELLS)
        self.west, self.south = west, south
        nx, ny = ceil((east - west) / self.cell), ceil((north - south) / self.cell)
        self.x = west + (np.arange(nx) + 0.5) * self.cell
        self.y = south + (np.arange(ny) + 0.5) * self.cell
        self.crop = inside(ring, self.x, self.y)
        self._outside, self._swept = ~self.crop, np.zeros_like(self.crop)

    def copy(self) -> "Ground":
        """Another ground in the same state."""
        other = copy(self)
        other.crop, other._swept = self.crop.copy(), self._swept.copy()
        return other

    def cut(self, line: Sequence[Point], width: float, length: float | None = None) -> None:
        """The crop along a line is gone. width: of the header; length: how much of the line [m]"""
        for on, off in self._along(line, width, np.inf if length is None else length):
            self.crop &= ~on
            self._swept &= ~off

    def sweep(self, line: Sequence[Point], width: float) -> None:
        """A header of a width will be driven along a line [m]."""
        for _, on in self._along(line, width, np.inf):
            self._swept |= on & self._outside

    def _along(self, line: Sequence[Point], width: float, left: float) -> Iterator[tuple[Mask, Mask]]:
        """Cells that a header of a width comes over along the pieces of a line, and with ROOM beside them."""
        for (ax, ay), (bx, by) in pairwise(line):
            if left <= 0.0:
                return
            size = hypot(bx - ax, by - ay)
            ux, uy = (bx - ax) / size, (by - ay) / size
            dx, dy = self.x[:, None] - ax, self.y[None, :] - ay
            along, across = ux * dx + uy * dy, np.abs(ux * dy - uy * dx)
            on = (along >= -0.5) & (along <= min(size, left))
            yield on & (across <= 0.5 * width), on & (across <= 0.5 * width + ROOM)
            left -= size

    def clear_of(self, radius: float, discs: Sequence[tuple[float, float, float]] = ()) -> Mask:
        """Cells that crop, headers to come and discs (x, y, radius) are nearer to than a radius [m]."""
        closed = self.crop | self._swept
        reach = ceil(radius / self.cell)
        blocked = np.zeros_like(self.crop)
        nx, ny = self.crop.shape
        for i in range(-reach, reach + 1):
            for j in range(-reach, reach + 1):
                if hypot(i, j) * self.cell <= radius:
                    to_x, from_x = slice(max(i, 0), nx + min(i, 0)), slice(max(-i, 0), nx + min(-i, 0))
                    to_y, from_y = slice(max(j, 0), ny + min(j, 0)), slice(max(-j, 0), ny + min(-j, 0))
                    blocked[to_x, to_y] |= closed[from_x, from_y]
        for x, y, size in discs:
            far = size + radius
            columns, rows = _within(self.x, x, far), _within(self.y, y, far)
            away = np.hypot(self.x[columns, None] - x, self.y[None, rows] - y)
            blocked[columns, rows] |= away < far
        return blocked

    def is_in(self, mask: Mask, x: float, y: float) -> bool:
        """True in a cell of a mask, and beyond the cells."""
        i, j = int((x - self.west) // self.cell), int((y - self.south) // self.cell)
        return not (0 <= i < mask.shape[0] and 0 <= j < mask.shape[1]) or bool(mask[i, j])


def _within(axis: NDArray[np.float64], at: float, reach: float) -> slice:
    """Which of the middles of cells along an axis are within reach of a place on it [m]."""
    first, last = np.searchsorted(axis, (at - reach, at + reach)).tolist()
    return slice(first, last)


def inside(ring: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> Mask:
    """Which of a grid of points lie in a ring (n, 2), by the number of sides that a ray east crosses."""
    found = np.zeros((len(x), len(y)), dtype=bool)
    for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if ay == by:
            continue
        between = (y >= min(ay, by)) & (y < max(ay, by))
        at = ax + (y - ay) * (bx - ax) / (by - ay)
        found ^= between[None, :] & (x[:, None] < at[None, :])
    return found


def beside(x: float, y: float, heading: float, ahead: float, left: float) -> Point:
    """A point ahead of and to the left of a place [m]."""
    c, s = cos(heading), sin(heading)
    return x + c * ahead - s * left, y + s * ahead + c * left
