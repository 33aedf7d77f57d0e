"""What a page holds before anything happened on it: a pure function of its index."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.edges.boundary import Region
from swath.field.edges.edge import Edges, code_at, code_within
from swath.field.field_setup import Stand, Terrain
from swath.field.hashing import hash_cells
from swath.field.memory_layout import (
    MIRROR_X,
    MIRROR_Y,
    PAGE_CUT_CELLS,
    PAGE_NODES,
    PAGE_TILES,
    STANDING,
    PlantLibrary,
)
from swath.field.paging.pages import TILE_CELLS, Codes, PageData
from swath.field.paging.stored_changes import Key

Array = NDArray[np.float64]
NODES_PER_TILE = PAGE_NODES // PAGE_TILES
FEW = 8  # pieces of edges
BLOCKS = 64  # along a page: squares of cells that are looked at together


class PageMaker:
    """Makes pages from terrain, stand, edges and boundary. seed: of the hash that places prototypes."""

    def __init__(
        self,
        terrain: Terrain,
        stand: Stand,
        edges: Edges,
        boundary: Region | None,
        library: PlantLibrary,
        seed: int,
    ) -> None:
        self.terrain, self.stand, self.edges, self.boundary = terrain, stand, edges, boundary
        self.library, self.seed = library, seed
        is_plain = all(edge.is_plain for edge in edges.values())
        self._parts = (PAGE_TILES, BLOCKS, PAGE_CUT_CELLS) if is_plain else (PAGE_TILES, PAGE_CUT_CELLS)
        self._is_short = sum(len(edge.shape.pieces) for edge in edges.values()) <= FEW
        self.yaw = stand.row_heading
        self.tile = library.tile_size
        self.side = PAGE_TILES * library.tile_size
        self.cell = library.tile_size / TILE_CELLS
        self.node = library.tile_size / NODES_PER_TILE

    def make(self, keys: Sequence[Key]) -> list[PageData]:
        """The pages of indices (i, j)."""
        i, j = (np.array(k)[:, None, None] for k in zip(*keys, strict=True))
        step = np.arange(PAGE_TILES)
        tx, ty = PAGE_TILES * i + step, PAGE_TILES * j + step[:, None]
        ground = np.stack([self.ground(*key) for key in keys])
        stand = self.stand_at(*self.to_world((tx + 0.5) * self.tile, (ty + 0.5) * self.tile))
        arrays = ground.astype(np.float32), self._planes(ground).astype(np.float32), stand.astype(np.float32)
        return [
            PageData(*page) for page in zip(*arrays, self.prototypes(tx, ty), self.codes(keys), strict=True)
        ]

    def to_world(self, u: Any, v: Any) -> tuple[Array, Array]:
        """World coordinates of points of the stand frame."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
        return c * u - s * v, s * u + c * v

    def ground(self, i: int, j: int) -> Array:
        """Heights of the lattice nodes [m], (65, 65).

        Coordinates come from whole numbers of nodes, so both pages at a border see the same ones.
        """
        steps = np.arange(PAGE_NODES + 1)
        u: Array = np.asarray((PAGE_NODES * i + steps) * self.node, dtype=np.float64)
        v: Array = np.asarray((PAGE_NODES * j + steps) * self.node, dtype=np.float64)
        return self.terrain.lattice(u, v, self.yaw)

    def codes(self, keys: Sequence[Key]) -> list[Codes]:
        """Codes of the cut cells of pages at the start, by the centre of each cell, or of whole squares."""
        at = np.array(keys, dtype=np.int64)
        page = self.codes_within(*self.to_world(*((at + 0.5) * self.side).T), self.side * np.sqrt(0.5) + 1e-6)
        found: list[Codes] = page.tolist()
        mixed = np.flatnonzero(page < 0)
        together = len(mixed) if self._is_short else 1  # an edge of many pieces is looked at where it is near
        for first in range(0, len(mixed), max(together, 1)):
            some = mixed[first : first + together]
            for n, codes in zip(some.tolist(), self._codes_of_mixed(at[some]), strict=True):
                found[n] = int(codes[0, 0]) if (codes == codes[0, 0]).all() else codes
        return found

    def _codes_of_mixed(self, at: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Codes (n, 512, 512) of pages (n, 2) that may have several, square by square."""
        codes = np.full(
            (len(at), 1, 1), -1, np.int16
        )  # of squares that have a single one, -1 where there are several
        for parts in self._parts:
            side, radius = self.side / parts, self.side / parts * np.sqrt(0.5) + 1e-6
            n, ty, tx = np.nonzero(codes < 0)
            factor = parts // codes.shape[1]
            codes = np.repeat(np.repeat(codes, factor, axis=1), factor, axis=2)
            row, column = (t[:, None] * factor + np.arange(factor) for t in (ty, tx))
            u, v = (parts * at[n, :1] + column + 0.5) * side, (parts * at[n, 1:] + row + 0.5) * side
            x, y = self.to_world(u[:, None, :], v[:, :, None])
            found = self.codes_at(x, y) if parts == PAGE_CUT_CELLS else self.codes_within(x, y, radius)
            codes[n[:, None, None], row[:, :, None], column[:, None, :]] = found
        return codes.astype(np.uint8)

    def codes_at(self, x: Array, y: Array) -> NDArray[np.int16]:
        """Codes at the start of world points [m]."""
        found = code_at(self.edges, x, y)
        found[(found == STANDING) & self.stand.bare(x, y)] = 0
        if self.boundary is not None:
            found[~self.boundary.contains(x, y)] = 0
        return found

    def codes_within(self, x: Array, y: Array, radius: float) -> NDArray[np.int16]:
        """The one code of all points within the radius of points, -1 where there may be several."""
        codes = code_within(self.edges, x, y, radius)
        codes[(codes == STANDING) & self.stand.may_be_bare(x, y, radius)] = -1
        if self.boundary is not None:
            near = self.boundary.distance(x, y) <= radius
            codes[~near & ~self.boundary.contains(x, y)] = 0
            codes[near] = -1
        return codes

    def _planes(self, ground: Array) -> Array:
        """Least-squares plane of each tile's 9 x 9 nodes: height in the middle, slope_x, slope_y.

        ground: (pages, 65, 65)
        """
        n = NODES_PER_TILE
        blocks = np.lib.stride_tricks.sliding_window_view(ground, (n + 1, n + 1), axis=(1, 2))[:, ::n, ::n]
        offset = (np.arange(n + 1) - 0.5 * n) * self.node
        weight = offset / (np.sum(offset**2) * (n + 1))
        slope_x = (blocks * weight).sum(axis=(3, 4))
        slope_y = (blocks * weight[:, None]).sum(axis=(3, 4))
        return np.stack([blocks.mean(axis=(3, 4)), slope_x, slope_y], axis=-1)

    def stand_at(self, x: Array, y: Array) -> Array:
        """Scale, lean and density fraction of tiles.

        A plant that leans by a keeps its length: its height shrinks with cos a and its tip moves aside with
        sin a.
        """
        factor = self.stand.height_factor(x, y)
        angle, azimuth = self.stand.lean(x, y)
        fraction = self.stand.density(x, y) / self.library.density_max
        aside = factor * np.sin(angle)
        azimuth = azimuth - self.yaw
        lean = aside * np.cos(azimuth), aside * np.sin(azimuth)
        return np.stack([factor * np.cos(angle), *lean, np.clip(fraction, 0.0, 1.0)], axis=-1)

    def prototypes(self, tx: Any, ty: Any) -> NDArray[np.int32]:
        """Prototype numbers with mirror flags of tiles by their indices."""
        h = hash_cells(self.seed, tx, ty)
        number = (h % np.uint64(self.library.tile_count)).astype(np.int32)
        mirror_x = np.where(h & np.uint64(1 << 40), MIRROR_X, 0)
        mirror_y = np.where(h & np.uint64(1 << 41), MIRROR_Y, 0)
        return (number | mirror_x | mirror_y).astype(np.int32)
