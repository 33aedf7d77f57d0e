"""A `HeightGrid` as its native code wants it: cells of a block side by side, quantiles on one cache line."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.height_grid import DEEP, NODE_CELLS, NODES, NONE, THICK, TILE, HeightGrid

FLATTEST = 0.18  # as in `beams/heights.cpp`
UNTOUCHED = 255  # stubble height of a cell that is as it was measured
HAS_PASSED, CLOSED = 1, 2  # bits of `lid`: `passed` counts; nothing goes on below the quantiles
UNSEEN = np.float32(1e-30)  # size of `passed` in cut cells where it was 0
REST = np.dtype([("deep", np.int16, DEEP), ("thickness", np.float32), ("passed", np.float32)])


class Cells:
    """What rays read of cells, each array in the order of `by_blocks`; see `Heights` in beams/kernel.py.

    quantiles: (n, EVEN) int16, lid: (n,) int16, rest: (n,) REST
    cut: (n,) uint8, UNTOUCHED or stubble height [cm]
    """

    def __init__(self, grid: HeightGrid) -> None:
        quantiles = by_blocks(grid.quantiles)
        self.quantiles, self.rest = _aligned(quantiles[:, DEEP:]), np.zeros(len(quantiles), REST)
        self.rest["deep"], self.rest["thickness"] = quantiles[:, :DEEP], by_blocks(grid.thickness)
        self.lid, self.cut = np.empty(len(quantiles), np.int16), np.empty(len(quantiles), np.uint8)
        size = np.abs(self.rest["thickness"])
        self._passed = np.where(size < THICK, np.exp(-size), 0.0).astype(np.float32)
        is_closed = (quantiles[:, 0] == quantiles[:, DEEP]) & (self.rest["thickness"] < 0.0)
        top = np.minimum(quantiles[:, -1].astype(np.int32) + 3 & ~3, 32764) | np.where(is_closed, CLOSED, 0)
        self._lid = np.where(quantiles[:, 0] == NONE, NONE, top).astype(np.int16)
        self.restore()

    def restore(self) -> None:
        """Restore all cells as they were measured."""
        self.cut[:] = UNTOUCHED
        self._summarise(slice(None))

    def cut_at(self, cell: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Stubble height [cm] of cells of the flattened pools, UNTOUCHED where they are as measured."""
        return self.cut[place_of(cell)]

    def lower(self, cell: NDArray[np.int64], stubble: NDArray[np.uint8]) -> None:
        """Cut cells of the flattened pools to a height [cm]; UNTOUCHED: they are as measured."""
        at = place_of(cell)
        self.cut[at] = stubble
        self._summarise(at)

    def _summarise(self, at: Any) -> None:
        is_cut, passed, lid = self.cut[at] != UNTOUCHED, self._passed[at], self._lid[at]
        self.rest["passed"][at] = np.where(is_cut, -np.maximum(passed, UNSEEN), passed)
        self.lid[at] = np.where((lid != NONE) & (is_cut | (passed != 0.0)), lid | HAS_PASSED, lid)


def by_blocks(cells: NDArray[Any]) -> NDArray[Any]:
    """(m, TILE, TILE, ...) as (m * TILE**2, ...), the NODE_CELLS x NODE_CELLS of a block side by side."""
    m, *_ = cells.shape
    blocks = cells.reshape(m, NODES, NODE_CELLS, NODES, NODE_CELLS, *cells.shape[3:]).swapaxes(2, 3)
    return np.ascontiguousarray(blocks.reshape(m * TILE**2, *cells.shape[3:]))


def place_of(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where `by_blocks` puts cells of the flattened pools."""
    slot, y, x = cell // TILE**2, cell // TILE % TILE, cell % TILE
    block = (slot * NODES + y // NODE_CELLS) * NODES + x // NODE_CELLS
    return np.asarray((block * NODE_CELLS + y % NODE_CELLS) * NODE_CELLS + x % NODE_CELLS)


def first_cells(grid: HeightGrid) -> NDArray[np.int32]:
    """(ty * NODES, tx * NODES): place of the first cell of each block, < 0 where none is held."""
    in_tile = np.arange(NODES**2, dtype=np.int32).reshape(NODES, NODES)
    ty, tx = grid.table.shape
    slot = grid.table.repeat(NODES, axis=0).repeat(NODES, axis=1)
    first = (slot * NODES**2 + np.tile(in_tile, (ty, tx))) * NODE_CELLS**2
    return np.where(slot >= 0, first, -1).astype(np.int32)


def patches(ground: NDArray[np.float32]) -> NDArray[np.float32]:
    """(blocks_y, blocks_x, 4): c of the height c0 + c1 u + (c2 + c3 u) v in each block."""
    a, b, c, d = ground[:-1, :-1], ground[:-1, 1:], ground[1:, :-1], ground[1:, 1:]
    return np.stack([a, b - a, c - a, d - b - c + a], axis=-1)


def _aligned(quantiles: NDArray[np.int16]) -> NDArray[np.int16]:
    """A copy, each cell on a cache line of its own."""
    room = np.empty(quantiles.size + 32, np.int16)
    first = -room.ctypes.data % 64 // 2
    copy = room[first : first + quantiles.size].reshape(quantiles.shape)
    copy[:] = quantiles
    return copy


def block_tops(grid: HeightGrid) -> NDArray[np.float32]:
    """(ty * NODES, tx * NODES): height above origin[2] [m] from which on no ray meets anything in a block.

    The highest surface of its cells, the ground where unmeasured, and what flat rays count as lower. What is
    cut only sinks below it.
    """
    g = grid.ground
    corners = np.max([g[:-1, :-1], g[:-1, 1:], g[1:, :-1], g[1:, 1:]], axis=0)
    m = len(grid.quantiles)
    cells = grid.quantiles[..., -1].reshape(m, NODES, NODE_CELLS, NODES, NODE_CELLS)
    above = np.zeros((*grid.table.shape, NODES, NODES))
    held = grid.table >= 0
    above[held] = np.maximum(cells.max(axis=(2, 4)) * 1e-3, 0.0)[grid.table[held]]
    flat = FLATTEST * np.sqrt(2.0) * grid.cell
    top = corners + above.transpose(0, 2, 1, 3).reshape(corners.shape) + flat + 1e-3
    return np.asarray(top, dtype=np.float32)
