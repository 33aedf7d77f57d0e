"""Rays against a grid of measured heights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import Solids
from swath.rays.beams.desk import ASTRAY, Desk
from swath.rays.checks import check_range, refuse_below
from swath.rays.device import start_warp
from swath.rays.height_grid import (
    DEEP,
    LEVELS,
    NODE_CELLS,
    NODES,
    NONE,
    SHARES,
    THICK,
    HeightGrid,
    lattice_height,
)

NOTHING, MEASURED, UNMEASURED, SOLID = range(4)
FLATTEST = 0.18  # as in `beams/heights.cpp`
UNTOUCHED = 255  # in `HeightCaster.cut`


@dataclass(frozen=True)
class HeightHits:
    """Nearest hits of n rays, all (n,).

    distance [m], nan = nothing; of UNMEASURED where the ground was reached; what: one of the four above
    cell: index into the flattened pools of the grid, -1 = none; cosine, reflectance: of a solid; of what was
    measured 1 and the intensity
    """

    distance: NDArray[np.float32]
    what: NDArray[np.int32]
    cell: NDArray[np.int32]
    cosine: NDArray[np.float32]
    reflectance: NDArray[np.float32]


class HeightCaster:
    """Marches rays through a grid, every ray alone, with one random number each (`beams/heights.cpp`).

    In an even stand the heights it reports are distributed as the measured ones. An own draw in every cell
    would let the highest of them win.

    cut: (m, TILE, TILE) uint8, UNTOUCHED or the stubble height [cm]; change it in place
    """

    def __init__(self, grid: HeightGrid, *, skips: bool = True) -> None:
        self.grid, self.skips = grid, skips
        self.cut = np.full(grid.count.shape, UNTOUCHED, np.uint8)
        self._whole, self._real = np.zeros(2, np.int32), np.zeros(3, np.float32)
        self._desk = Desk(0)
        self._kept: list[NDArray[Any]] = []  # arrays whose memory the launch reads
        self._launch: Any = None

    def cast(
        self,
        origins: Any,
        directions: Any,
        *,
        range_max: float,
        seed: int = 0,
        share: float = -1.0,
        grain: float = 0.05,
        solids: Solids | None = None,
    ) -> HeightHits:
        """Nearest hit of each ray. origins [m], directions (unit): (n, 3), world; rest as `cast_beams`."""
        n = len(origins)
        desk = self._desk if self._desk.count == n else Desk(n)
        desk.origins[:n], desk.directions[:n] = origins, directions
        if not (np.isfinite(desk.origins).all() and np.isfinite(desk.directions).all()):
            raise ValueError("expected finite origins and directions")
        self.cast_beams(desk, range_max=range_max, seed=seed, share=share, grain=grain, solids=solids)
        what, cell = desk.kind[:n].copy(), desk.cell[:n].copy()
        distance, cosine, albedo = (a[:n].copy() for a in (desk.distance, desk.cosine, desk.reflectance))
        return HeightHits(distance, what, cell, cosine, albedo)

    def cast_beams(
        self,
        desk: Desk,
        *,
        range_max: float,
        seed: int = 0,
        share: float = -1.0,
        grain: float = 0.05,
        solids: Solids | None = None,
    ) -> None:
        """Fill distance, kind, cell, cosine and reflectance of a desk, as in `HeightHits`.

        share: stop every ray where this share of the measured heights is still below it, or < 0: drawn by a
        hash of the seed and the cell of side `grain` [m] in which the ray would end on the ground. Raises
        ValueError on rays that are not finite, InputError on a range that is not > 0 and on rays that start
        under the measured ground.
        """
        check_range(range_max)
        if desk is not self._desk or self._launch is None:
            self._desk, self._launch = desk, self._prepare(desk)
        self._whole.view(np.uint32)[0] = seed & 0xFFFFFFFF
        self._whole[1] = desk.meet(solids, range_max)
        self._real[:] = share, grain, range_max
        if desk.count:
            self._launch.launch()
        if desk.take_fault() & ASTRAY:
            o = desk.origins[: desk.count]
            refuse_below(o, self.grid.ground_height(o[:, 0], o[:, 1]))

    def _prepare(self, desk: Desk) -> Any:
        wp = start_warp()
        from swath.rays.beams.kernel import Heights, cast_heights

        def share(array: NDArray[Any], kind: Any) -> Any:
            self._kept.append(array)
            return wp.array(array, dtype=kind, device="cpu", copy=False)

        g, scene = self.grid, Heights()
        self._kept = []
        scene.origin = wp.vec3d(*g.origin)
        scene.turn = wp.vec2d(np.cos(g.yaw), np.sin(g.yaw))
        scene.cell, scene.nodes_per_m = g.cell, 1.0 / g.node
        scene.table, scene.ground = share(g.table, wp.int32), share(g.ground, wp.float32)
        tops = block_tops(g) if self.skips else np.full(np.array(g.ground.shape) - 1, np.inf, np.float32)
        scene.block_top, scene.crest = share(tops.ravel(), wp.float32), float(tops.max())
        top = np.where(g.is_measured, g.quantiles[..., -1], NONE).astype(np.int16)
        scene.quantiles, scene.top = (
            share(_aligned(g.quantiles[..., DEEP:]), wp.int16),
            share(top.ravel(), wp.int16),
        )
        scene.deep = share(np.ascontiguousarray(g.quantiles[..., :DEEP]).ravel(), wp.int16)
        size = np.abs(g.thickness).astype(np.float32)
        passed = np.where(size < THICK, np.exp(-size), 0.0).astype(np.float32)
        scene.passed = share(passed.ravel(), wp.float32)
        scene.thickness = share(g.thickness.ravel(), wp.float32)
        scene.cut = share(self.cut.reshape(-1), wp.uint8)
        scene.intensity = share(g.intensity.reshape(-1), wp.float32)
        told = [share(self._whole, wp.int32), share(self._real, wp.float32)]
        rays = desk.shared("origins", "directions")
        out = desk.shared("distance", "kind", "cell", "cosine", "reflectance", "fault")
        inputs = [scene, *told, *rays, desk.count, *out]
        return wp.launch(cast_heights, dim=desk.pack_count, inputs=inputs, device="cpu", record_cmd=True)


def _aligned(quantiles: NDArray[np.int16]) -> NDArray[np.int16]:
    """Flat, each cell on a cache line of its own."""
    room = np.empty(quantiles.size + 32, np.int16)
    first = -room.ctypes.data % 64 // 2
    room[first : first + quantiles.size] = quantiles.ravel()
    return room[first : first + quantiles.size]


def block_tops(grid: HeightGrid) -> NDArray[np.float32]:
    """(ty * NODES, tx * NODES): height above origin[2] [m] from which on no ray meets anything in a block.

    The highest surface of its cells, the ground where unmeasured, and what flat rays count as lower. What is cut
    only sinks below it.
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


def surface(grid: HeightGrid, x: Any, y: Any, share: float) -> NDArray[np.float64]:
    """Height of the surface that a share of the heights lie below, in the world [m], nan where nothing was
    measured."""
    u, v = grid.to_local(x, y)
    cell = grid.cells_at(x, y)
    q = grid.quantiles.reshape(-1, LEVELS)[cell]
    height = np.where(
        (cell >= 0) & (q[..., 0] != NONE), q[..., DEEP + int(np.searchsorted(SHARES, share))] * 1e-3, np.nan
    )
    return np.asarray(grid.origin[2] + lattice_height(grid.ground, grid.node, u, v) + height)
