"""Echoes into cells: a bounded sample of the heights in every cell, whatever the length of the recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.hashing import hash_cells
from swath.rays.height_grid import LEVELS, NONE, TILE

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
BUFFER = 1 << 20  # echoes that wait to be merged
CELLS_MAX = 20_000_000
BLOCK = 8 * TILE  # columns that are pooled at once


@dataclass(frozen=True)
class Samples:
    """Heights by cell. key: row * width + column, rising, height [mm], both (n,)

    cells, counts, intensity: cells with echoes, rising; how many fell into each; their mean, nan = none
    """

    width: int
    key: Ints
    height: NDArray[np.int16]
    cells: Ints
    counts: Ints
    intensity: Array


class Gatherer:
    """Takes echoes, keeps at most `per_cell` heights of each cell: those with the smallest hashes of their
    number, which is a random sample that does not depend on how the echoes came in parts.
    """

    def __init__(self, width: int, per_cell: int, seed: int) -> None:
        self.width, self.per_cell, self.seed = width, per_cell, seed
        self.echo_count = 0
        self._parts: list[tuple[Ints, NDArray[np.int16], NDArray[np.uint32]]] = []
        self._bright: list[tuple[Ints, Array]] = []
        self._waiting = 0
        empty = np.zeros(0, np.int64)
        self._key, self._height, self._rank = empty, np.zeros(0, np.int16), np.zeros(0, np.uint32)
        self._cells, self._counts = empty, empty
        self._sum, self._lit = np.zeros(0), empty

    def add(self, column: Ints, row: Ints, height_mm: Array, intensity: Array) -> None:
        """Echoes in cells, all (n,)."""
        key = row * self.width + column
        number = self.echo_count + np.arange(len(key))
        rank = (hash_cells(self.seed, number) >> np.uint64(32)).astype(np.uint32)
        self.echo_count += len(key)
        self._parts.append((key, np.round(height_mm).astype(np.int16), rank))
        self._bright.append((key, intensity))
        self._waiting += len(key)
        if self._waiting >= BUFFER:
            self._merge()

    def finish(self) -> Samples:
        """What was kept."""
        self._merge()
        order = np.lexsort((self._height, self._key))
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = self._sum / self._lit
        return Samples(self.width, self._key[order], self._height[order], self._cells, self._counts, mean)

    def _merge(self) -> None:
        key = np.concatenate([self._key, *(p[0] for p in self._parts)])
        height = np.concatenate([self._height, *(p[1] for p in self._parts)])
        rank = np.concatenate([self._rank, *(p[2] for p in self._parts)])
        order = np.lexsort((rank, key))
        key = key[order]
        first = np.flatnonzero(np.diff(key, prepend=-1))
        place = np.arange(len(key)) - np.repeat(first, np.diff(first, append=len(key)))
        keep = place < self.per_cell
        self._key, self._height, self._rank = key[keep], height[order][keep], rank[order][keep]
        self._count()
        self._parts, self._bright, self._waiting = [], [], 0
        if len(self._cells) > CELLS_MAX:
            expected = (
                f"expected larger cells, the echoes lie in more than {CELLS_MAX // 10**6} million of them"
            )
            raise InputError("--cell-m", None, expected)

    def _count(self) -> None:
        new = np.concatenate([k for k, _ in self._bright]) if self._bright else np.zeros(0, np.int64)
        bright = np.concatenate([b for _, b in self._bright]) if self._bright else np.zeros(0)
        lit = np.isfinite(bright)
        cells = np.unique(np.concatenate([self._cells, new]))
        old, at = np.searchsorted(cells, self._cells), np.searchsorted(cells, new)
        counts, shone = np.zeros(len(cells), np.int64), np.zeros(len(cells), np.int64)
        total = np.zeros(len(cells))
        counts[old], shone[old], total[old] = self._counts, self._lit, self._sum
        counts += np.bincount(at, minlength=len(cells))
        shone += np.bincount(at[lit], minlength=len(cells))
        total += np.bincount(at[lit], bright[lit], minlength=len(cells))
        self._cells, self._counts, self._lit, self._sum = cells, counts, shone, total


def pool(
    samples: Samples, column: int, row: int, *, along: int, across: int
) -> NDArray[np.int16]:  # (TILE, BLOCK, LEVELS)
    """Quantiles [mm] of a block of cells whose first is (column, row), NONE = never measured.

    A cell with an echo in itself or in one of its eight neighbours is measured. Its distribution is that of
    the echoes within `along` columns and `across` rows of it; one row more where that holds none.
    """
    reach = max(across, 1)
    low, high = np.searchsorted(
        samples.key, [(row - reach) * samples.width, (row + TILE + reach) * samples.width]
    )
    r, c = np.divmod(samples.key[low:high], samples.width)
    near = (c >= column - along - 1) & (c < column + BLOCK + along + 1)
    r, c, h = r[near] - row, c[near] - column, samples.height[low:high][near].astype(np.int64)
    found = np.full((TILE * BLOCK, LEVELS), NONE, np.int16)
    _fill(found, r, c, h, along, across, _touched(r, c))
    empty = _touched(r, c) & (found[:, 0] == NONE)
    if empty.any():
        _fill(found, r, c, h, max(along, 1), across + 1, empty)
    return found.reshape(TILE, BLOCK, LEVELS)


def _touched(r: Ints, c: Ints) -> NDArray[np.bool_]:
    """Cells of the block with an echo in them or beside them."""
    has = np.zeros((TILE + 4, BLOCK + 4), bool)
    close = (r >= -1) & (r <= TILE) & (c >= -1) & (c <= BLOCK)
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            has[r[close] + dr + 2, c[close] + dc + 2] = True
    return has[2:-2, 2:-2].ravel()


def _fill(
    found: NDArray[np.int16], r: Ints, c: Ints, h: Ints, along: int, across: int, which: NDArray[np.bool_]
) -> None:
    packed = []
    for dr in range(-across, across + 1):
        for dc in range(-along, along + 1):
            row, column = r + dr, c + dc
            inside = (row >= 0) & (row < TILE) & (column >= 0) & (column < BLOCK)
            cell = row[inside] * BLOCK + column[inside]
            wanted = which[cell]
            packed.append((cell[wanted] << 16) | (h[inside][wanted] + 32768))
    both = np.sort(np.concatenate(packed))
    if len(both) == 0:
        return
    cell, height = both >> 16, (both & 0xFFFF) - 32768
    first = np.flatnonzero(np.diff(cell, prepend=-1))
    count = np.diff(first, append=len(cell))
    share = (np.arange(LEVELS) + 0.5) / LEVELS
    found[cell[first]] = height[first[:, None] + (count[:, None] * share).astype(np.int64)]
