"""The cut: which cells a swept polygon covers, and what mass stood on them.

What stands on a cell is a function of its code alone (standing, or cut at so many cm), so a cut returns what
stood there before minus what stands there after. Masses therefore add up to the same sum for any sequence
of overlapping cuts, and can be recounted from the codes.
"""

from itertools import chain
from math import fsum, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.frozen import frozen
from swath.field.memory_layout import PAGE_CUT_CELLS, PAGE_TILES, PlantLibrary, ranked

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Corner = tuple[float, float]  # x, y

TILE_CELLS = PAGE_CUT_CELLS // PAGE_TILES
CELLS = TILE_CELLS * TILE_CELLS


@frozen
class Cut:
    """What a cut took. grain, straw [kg]; stem_count; area of crop that stood [m2]; grain_left [kg]: on cut
    stems whose ear lay below the cut and stays in the field; stubble [kg]: straw that stays below the cut, of
    a recount alone.
    """

    grain: float = 0.0
    straw: float = 0.0
    stem_count: int = 0
    area: float = 0.0
    grain_left: float = 0.0
    stubble: float = 0.0

    def __add__(self, other: "Cut") -> "Cut":
        return Cut(
            self.grain + other.grain,
            self.straw + other.straw,
            self.stem_count + other.stem_count,
            self.area + other.area,
            self.grain_left + other.grain_left,
            self.stubble + other.stubble,
        )


class StemIndex:
    """Stems of a library by the cut cell they stand on, for each prototype and mirroring.

    straw_exponent p: a share 1 - (1 - s)^p of a stem's straw lies below the relative height s.
    The ear of a stem is where the middle of its ear primitives (pods, cob) is, or its tip without any.
    is_crop: (n,) which stems are no weeds; weeds count as straw but not as stems.
    """

    def __init__(self, library: PlantLibrary, straw_exponent: float) -> None:
        self.library = library
        self.straw_exponent = straw_exponent
        self.ear_height = library.ear_height
        self.is_crop = ~library.is_weed

    def by_line(self) -> tuple[NDArray[np.uint64], NDArray[np.int32], NDArray[np.int32]]:
        """For each line of cells of each prototype, as it is and mirrored: a bit for each cell with a stem;
        its first row, and where the last one ends. Rows, cell by cell: stem, column in the tile.
        """
        library = self.library
        stem_tile = np.repeat(np.arange(library.tile_count), np.diff(library.stem_start))
        x, y = library.stem_xy[:, 0].astype(np.float64), library.stem_xy[:, 1].astype(np.float64)
        cells, stems = [], []
        for mirror in range(4):
            ix = cell_in_tile(x, library.tile_size, bool(mirror & 1))
            iy = cell_in_tile(y, library.tile_size, bool(mirror & 2))
            cells.append((stem_tile * 4 + mirror) * CELLS + iy * TILE_CELLS + ix)
            stems.append(np.arange(len(x)))
        cell, stem = np.concatenate(cells), np.concatenate(stems)
        order = np.argsort(cell, kind="stable")
        lines, column = library.tile_count * 4 * TILE_CELLS, cell % TILE_CELLS
        taken = np.zeros(lines, np.uint64)
        np.bitwise_or.at(taken, cell // TILE_CELLS, np.uint64(1) << column.astype(np.uint64))
        first = np.concatenate([[0], np.cumsum(np.bincount(cell // TILE_CELLS, minlength=lines))])
        at = np.stack([stem[order], column[order]], axis=1)
        return taken, first.astype(np.int32), at.astype(np.int32)


def cell_in_tile(x: Array, tile_size: float, is_mirrored: Any) -> Ints:
    """Cut cell (one axis) of a stem at x [m] in its prototype. is_mirrored: of all, or (n,) of each."""
    place = np.where(is_mirrored, tile_size - x, x)
    return np.clip(np.floor(place * (TILE_CELLS / tile_size)), 0, TILE_CELLS - 1).astype(np.int64)


def corners_of(polygon: Any, key: str = "polygon") -> list[Corner]:
    """Corners of a convex polygon (n, 2), counter-clockwise. Raises InputError on anything else."""
    try:
        rows = polygon.tolist() if isinstance(polygon, np.ndarray) else polygon
        corners: list[Corner] = [(float(x), float(y)) for x, y in rows]
    except (TypeError, ValueError) as error:
        raise InputError(key, polygon, "expected a list of [x, y]") from error
    if len(corners) < 3 or not all(map(isfinite, chain.from_iterable(corners))):
        raise InputError(key, polygon, "expected at least three finite [x, y]")
    edge, (ax, ay) = [], corners[-1]
    for x, y in corners:
        edge.append((x - ax, y - ay))
        ax, ay = x, y
    cross, (ax, ay) = [], edge[-1]
    for x, y in edge:
        cross.append(ax * y - ay * x)
        ax, ay = x, y
    if min(cross) < 0.0 < max(cross):
        tolerance = 1e-9 * max(1.0, *(max(x * x, y * y) for x, y in edge))
        if min(cross) < -tolerance and max(cross) > tolerance:
            raise InputError(key, polygon, "expected a convex polygon, the corners in order")
    return corners[::-1] if fsum(cross) < 0.0 else corners


def cells_inside(polygon: Array) -> tuple[Ints, Ints]:
    """Columns and rows (n,) of cells whose centre is in a convex counter-clockwise polygon in cell units."""
    ax, ay = polygon[:, 0], polygon[:, 1]
    ex, ey = np.roll(ax, -1) - ax, np.roll(ay, -1) - ay
    rows = np.arange(int(np.ceil(ay.min() - 0.5)), int(np.floor(ay.max() - 0.5)) + 1)
    y = rows + 0.5
    low, high = np.full(len(rows), -np.inf), np.full(len(rows), np.inf)
    for i in np.flatnonzero(ey):
        x = ax[i] + ex[i] / ey[i] * (y - ay[i])
        if ey[i] > 0.0:
            np.minimum(high, x, out=high)
        else:
            np.maximum(low, x, out=low)
    some = np.isfinite(low) & np.isfinite(high)
    rows = rows[some]
    first = np.ceil(low[some] - 0.5).astype(np.int64)
    after = np.floor(high[some] - 0.5).astype(np.int64) + 1
    count = np.maximum(after - first, 0)
    row, step = ranked(count)
    return first[row] + step, rows[row]
