"""A `HeightGrid` as its native code wants it: cells of a block side by side, one cache line of quantiles each."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.height_grid import NODE_CELLS, NODES, NONE, THICK, TILE, HeightGrid

FLATTEST = 0.18  # as in `beams/heights.cpp`
UNSEEN = 1e-30  # `passed` of cut cells where it was 0


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


def lids(grid: HeightGrid) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """`lid` and `passed` of `Heights` in beams/kernel.py."""
    size = np.abs(by_blocks(grid.thickness)).astype(np.float32)
    passed = np.concatenate([[0.0], np.where(size < THICK, np.exp(-size), 0.0)]).astype(np.float32)
    top = by_blocks(grid.quantiles[..., -1]).astype(np.int32)
    lid = np.minimum((top + 1) & ~1, 32766) | (passed[1:] != 0.0)
    lid = np.where(by_blocks(grid.is_measured), lid, NONE)
    return lid.astype(np.int16), passed


def patches(ground: NDArray[np.float32]) -> NDArray[np.float32]:
    """(blocks_y, blocks_x, 4): c of the height c0 + c1 u + (c2 + c3 u) v in each block."""
    a, b, c, d = ground[:-1, :-1], ground[:-1, 1:], ground[1:, :-1], ground[1:, 1:]
    return np.stack([a, b - a, c - a, d - b - c + a], axis=-1)


def aligned(quantiles: NDArray[np.int16]) -> NDArray[np.int16]:
    """Flat, each cell on a cache line of its own."""
    room = np.empty(quantiles.size + 32, np.int16)
    first = -room.ctypes.data % 64 // 2
    room[first : first + quantiles.size] = quantiles.ravel()
    return room[first : first + quantiles.size]


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
