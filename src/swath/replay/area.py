"""Which part of the field a replay shows: the tiles about the ways of all machines."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.signals import F64

MARGIN = 12.0  # shown beside every way [m]
MOST_TILES = 250_000  # of the rectangle about all ways
MOST_CELLS = 4_000_000
MOST_SIDE = 4096  # longest texture that every graphics card takes


@dataclass(frozen=True)
class Area:
    """A rectangle of tiles in the stand frame.

    tile: side T [m]; first: index of the lower left tile (x, y); shape: tiles (ny, nx)
    shown: (ny, nx), tiles near a way; cells: cut cells along a tile; until_s: ways up to there are inside
    """

    tile: float
    first: tuple[int, int]
    shape: tuple[int, int]
    shown: NDArray[np.bool_]
    cells: int
    until_s: float

    @property
    def cell(self) -> float:
        """Side of a cut cell [m]."""
        return self.tile / self.cells


def area_about(tile: float, times: F64, points: F64) -> Area:
    """The area about points (n, 2) [m] of the stand frame, passed at times (n,) [s], in order of time.

    A run that covers more than MOST_TILES is shown up to where it leaves what can be shown.
    """
    index = np.floor(points / tile).astype(int)
    reach = int(np.ceil(MARGIN / tile))
    count = _fitting(index, reach)
    index = index[:count]
    low, high = index.min(axis=0) - reach, index.max(axis=0) + reach + 1
    nx, ny = (int(n) for n in high - low)
    cells = 16
    while cells > 2 and (nx * ny * cells**2 > MOST_CELLS or max(nx, ny) * cells > MOST_SIDE):
        cells //= 2
    until = float("inf") if count == len(times) else float(times[count - 1])
    shown = _near(index - low, (ny, nx), reach)
    return Area(tile, (int(low[0]), int(low[1])), (ny, nx), shown, cells, until)


def _fitting(index: NDArray[np.int64], reach: int) -> int:
    """How many points, from the first on, lie in a rectangle that is not too large."""
    low = np.minimum.accumulate(index, axis=0) - reach
    high = np.maximum.accumulate(index, axis=0) + reach + 1
    sides = high - low
    fits = (sides.prod(axis=1) <= MOST_TILES) & (sides.max(axis=1) * 2 <= MOST_SIDE)
    return max(1, int(np.count_nonzero(fits)))


def _near(index: NDArray[np.int64], shape: tuple[int, int], reach: int) -> NDArray[np.bool_]:
    """Tiles within a square of `reach` tiles about any of some tiles."""
    marks = np.zeros(shape, np.int32)
    marks[index[:, 1], index[:, 0]] = 1
    for axis in (0, 1):
        grown = np.zeros_like(marks)
        for shift in range(-reach, reach + 1):
            grown |= np.roll(marks, shift, axis=axis)  # the rectangle has a border as wide as the reach
        marks = grown
    return marks.astype(bool)
