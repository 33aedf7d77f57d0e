"""Echoes into cells: a bounded sample of the heights in every cell, whatever the length of the recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.hashing import hash_cells
from swath.rays.height_grid import DEEP, LEVELS, NONE, PER_THICKNESS, SHARES, THICK, THICKEST, TILE
from swath.signals import F32, F64, I64, Mask
from swath.tools.height_map.passing import Passing, thicknesses

BUFFER = 1 << 20  # echoes that are held before they are merged
CELLS_MAX = 20_000_000
FEWEST_BELOW = 0.25  # times that beams went below the lowest echo of a cell, for it to be open there
BLOCK = 8 * TILE  # columns that are pooled at once
TALL, WIDE = 1.0e4, 1.0e5  # apart lie cells in lists of thicknesses and of heights [mm]


@dataclass(frozen=True)
class Samples:
    """Heights by cell. key: row * width + column, rising, height [mm], both (n,).

    cells, counts, intensity: cells with echoes, rising; how many fell into each; their mean, nan = none
    """

    width: int
    key: I64
    height: NDArray[np.int16]
    cells: I64
    counts: I64
    intensity: F64

    @property
    def number(self) -> F64:
        """Echoes that each kept height stands for, (n,)."""
        kept = np.searchsorted(self.key, self.cells, side="right") - np.searchsorted(self.key, self.cells)
        return np.repeat(self.counts / np.maximum(kept, 1), kept)


class Gatherer:
    """Takes echoes, keeps at most `per_cell` heights of each cell: those with the smallest hashes of their
    number, which is a random sample that does not depend on how the echoes came in parts.

    buffer: echoes that are held before they are merged
    """

    def __init__(self, width: int, per_cell: int, seed: int, *, buffer: int = BUFFER) -> None:
        self.width, self.per_cell, self.seed, self.buffer = width, per_cell, seed, buffer
        self.echo_count = 0
        self._parts: list[tuple[I64, NDArray[np.int16], NDArray[np.uint32]]] = []
        self._bright: list[tuple[I64, F64]] = []
        self._waiting = 0
        empty = np.zeros(0, np.int64)
        self._key, self._height, self._rank = empty, np.zeros(0, np.int16), np.zeros(0, np.uint32)
        self._cells, self._counts = empty, empty
        self._sum, self._lit = np.zeros(0), empty

    def add(self, column: I64, row: I64, height_mm: F64, intensity: F64) -> None:
        """Echoes in cells, all (n,)."""
        key = row * self.width + column
        number = self.echo_count + np.arange(len(key))
        rank = (hash_cells(self.seed, number) >> np.uint64(32)).astype(np.uint32)
        self.echo_count += len(key)
        self._parts.append((key, np.round(height_mm).astype(np.int16), rank))
        self._bright.append((key, intensity))
        self._waiting += len(key)
        if self._waiting >= self.buffer:
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
    samples: Samples,
    column: int,
    row: int,
    *,
    along: int,
    across: int,
    fill: int = 1,
    passing: Passing | None = None,
) -> tuple[NDArray[np.int16], F32]:
    """Levels of a block of cells whose first is (column, row), (TILE, BLOCK, LEVELS), NONE = never measured,
    and their thickness, (TILE, BLOCK); as in a `HeightGrid`.

    A cell with an echo within `fill` rows and columns of it is measured. Its distribution is that of the
    echoes within `along` columns and `across` rows, `fill` of both where these hold none, less the layers
    that beams passed there; with `passing` corrected for the beams that passed.
    """
    reach = max(across, fill)
    limits = [(row - reach) * samples.width, (row + TILE + reach) * samples.width]
    low, high = np.searchsorted(samples.key, limits)
    r, c = np.divmod(samples.key[low:high], samples.width)
    wide = max(along, fill)
    near = (c >= column - wide) & (c < column + BLOCK + wide)
    r, c, h = r[near] - row, c[near] - column, samples.height[low:high][near].astype(np.int64)
    number = samples.number[low:high][near]
    block = _Block(column, row, r, c, h, number, passing)
    found = np.full((TILE * BLOCK, LEVELS), NONE, np.int16), np.zeros(TILE * BLOCK, np.float32)
    touched = _touched(r, c, fill)
    _fill(found, block, along, across, touched)
    empty = touched & (found[0][:, 0] == NONE)
    if empty.any():
        open_to = None if passing is None else passing.pooled(row, column, (TILE, BLOCK), along, across)
        _fill(found, block, wide, reach, empty, open_to)
    return found[0].reshape(TILE, BLOCK, LEVELS), found[1].reshape(TILE, BLOCK)


@dataclass(frozen=True)
class _Block:
    """Samples in and around a block: row, column in it, height [mm], number of echoes it stands for."""

    column: int
    row: int
    r: I64
    c: I64
    h: I64
    number: F64
    passing: Passing | None


def _touched(r: I64, c: I64, fill: int) -> Mask:
    """Cells of the block with an echo within `fill` rows and columns."""
    has = np.zeros((TILE + 4 * fill, BLOCK + 4 * fill), bool)
    close = (r >= -fill) & (r < TILE + fill) & (c >= -fill) & (c < BLOCK + fill)
    for dr in range(-fill, fill + 1):
        for dc in range(-fill, fill + 1):
            has[r[close] + dr + 2 * fill, c[close] + dc + 2 * fill] = True
    return has[2 * fill : -2 * fill, 2 * fill : -2 * fill].ravel()


def _fill(
    found: tuple[NDArray[np.int16], F32],
    b: _Block,
    along: int,
    across: int,
    which: Mask,
    open_to: F64 | None = None,
) -> None:
    """Levels and thickness of some cells from the window around them.

    open_to: times that beams passed the layers of cells that have no echo of their own: where they did,
    heights of others do not count. Else crop would grow sideways into what lies open beside it.
    """
    packed, numbers = [], []
    for dr in range(-across, across + 1):
        for dc in range(-along, along + 1):
            row, column = b.r + dr, b.c + dc
            inside = np.flatnonzero((row >= 0) & (row < TILE) & (column >= 0) & (column < BLOCK))
            cell = row[inside] * BLOCK + column[inside]
            wanted = which[cell]
            packed.append((cell[wanted] << 16) | (b.h[inside][wanted] + 32768))
            numbers.append(b.number[inside][wanted])
    both = np.concatenate(packed)
    if len(both) == 0:
        return
    order = np.argsort(both, kind="stable")
    cell, height = both[order] >> 16, (both[order] & 0xFFFF) - 32768
    weight = np.concatenate(numbers)[order]
    if open_to is not None and b.passing is not None:
        layer = np.maximum(np.floor(height * 1e-3 / b.passing.layer).astype(np.int64), 0)
        own = open_to.reshape(TILE * BLOCK, -1)
        kept = own[cell, np.minimum(layer, own.shape[1] - 1)] < FEWEST_BELOW
        cell, height, weight = cell[kept], height[kept], weight[kept]
        if len(cell) == 0:
            return
    first = np.flatnonzero(np.diff(cell, prepend=-1))
    count = np.diff(first, append=len(cell))
    if b.passing is None:
        upper, whole = _counted(first, count, weight), np.zeros(len(first))
        closed = np.ones(len(first), bool)
    else:
        layer = np.maximum(np.floor(height * 1e-3 / b.passing.layer).astype(np.int64), 0)
        times = b.passing.pooled(b.row, b.column, (TILE, BLOCK), along, across)
        layer = np.minimum(layer, times.shape[2] - 1)
        times = times.reshape(TILE * BLOCK, -1)
        upper, whole = thicknesses(cell, layer, weight, times[cell, layer])
        lower = np.cumsum(times, axis=1)[cell[first], layer[first]] - times[cell[first], layer[first]]
        closed = lower < FEWEST_BELOW  # nobody went further down: the lowest echoes stopped the rest
    whole = np.where(closed, upper[first], whole)
    heights = found[0]
    heights[cell[first], DEEP:] = height[
        _reaching(first, count, upper, np.minimum(-np.log(SHARES), whole[:, None]))
    ]
    heights[cell[first], 0] = height[first]
    heights[cell[first], 1:DEEP] = _between(first, count, height, upper, heights[cell[first], DEEP])
    found[1][cell[first]] = np.minimum(np.where(closed, -np.maximum(whole, THICK), whole), THICKEST)


def _reaching(first: I64, count: I64, upper: F64, wanted: F64) -> I64:
    """The lowest height of each cell whose upper side no more than a thickness lies above, both (n, k)."""
    rank = TALL * np.arange(len(first))
    sides = np.repeat(rank, count) - upper
    index = np.searchsorted(sides, (rank[:, None] - wanted - 1e-9).ravel()).reshape(wanted.shape)
    return np.clip(index, first[:, None], (first + count - 1)[:, None])


def _between(first: I64, count: I64, height: I64, upper: F64, middle: NDArray[np.int16]) -> F64:
    """Thickness above even heights between the lowest of each cell and `middle`, as in a `HeightGrid`."""
    part = np.arange(1, DEEP) / DEEP
    at = height[first][:, None] + (middle - height[first])[:, None] * part
    rank = WIDE * np.arange(len(first))
    index = np.searchsorted(np.repeat(rank, count) + height, (rank[:, None] + at).ravel()).reshape(at.shape)
    index = np.clip(index - 1, first[:, None], (first + count - 1)[:, None])  # the next lower height
    return np.round(PER_THICKNESS * np.minimum(upper[index], THICKEST))


def _counted(first: I64, count: I64, weight: F64) -> F64:
    """Thickness above the upper side of each height, where all echoes say the same."""
    run = np.cumsum(weight)
    before = np.repeat((run - weight)[first], count)
    whole = np.repeat(np.add.reduceat(weight, first), count)
    return np.asarray(-np.log(np.minimum((run - before) / whole, 1.0)))
