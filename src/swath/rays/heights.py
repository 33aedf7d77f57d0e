"""Rays against a grid of measured heights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Solids
from swath.rays.device import start_warp
from swath.rays.height_cells import Cells, block_tops, first_cells, patches
from swath.rays.height_grid import DEEP, LEVELS, NODES, NONE, SHARES, HeightGrid, lattice_height
from swath.rays.refusals import check_range, refuse_below
from swath.rays.single.buffers import ASTRAY, Desk

NOTHING, MEASURED, UNMEASURED, SOLID = range(4)


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

    cells: what rays read of the grid, and what was cut of it since
    skips: steps over blocks where a ray is above all that was measured; the hits are the same without
    """

    def __init__(self, grid: HeightGrid, *, skips: bool = True) -> None:
        self.grid, self.skips = grid, skips
        self.cells = Cells(grid)
        self._whole, self._real = np.zeros(2, np.int32), np.zeros(3, np.float32)
        self._seed = self._whole.view(np.uint32)
        self._desk = Desk(0)
        self._kept: list[NDArray[Any]] = []  # arrays whose memory the launch reads
        self._launch: Any = None
        self._scene: Any = None

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
        self.tell(range_max=range_max, seed=seed, share=share, grain=grain)
        self.march(desk, solids)

    def tell(self, *, range_max: float, seed: int, share: float, grain: float) -> None:
        """What a scan wants of the next launches, as in `cast_beams`."""
        check_range(range_max)
        self._seed[0] = seed & 0xFFFFFFFF
        self._real[:] = share, grain, range_max

    def march(self, desk: Desk, solids: Solids | None = None) -> None:
        """`cast_beams` with what `tell` was told."""
        if desk is not self._desk or self._launch is None:
            self._desk, self._launch = desk, self._prepare(desk)
        self._whole[1] = desk.meet(solids, float(self._real[2]))
        if desk.count:
            self._launch.launch()
        self.check(desk)

    def check(self, desk: Desk) -> None:
        """Raises on rays of a desk that could not be cast, see `cast_beams`."""
        if desk.take_fault() & ASTRAY:
            o = desk.origins[: desk.count]
            refuse_below(o, self.grid.ground_height(o[:, 0], o[:, 1]))

    def told(self) -> list[Any]:
        """Arguments of kernels that march: the grid, and what `tell` sets (whole and real numbers)."""
        wp = start_warp()
        if self._scene is None:
            self._scene = self._make_scene()
        whole = wp.array(self._whole, dtype=wp.int32, device="cpu", copy=False)
        return [self._scene, whole, wp.array(self._real, dtype=wp.float32, device="cpu", copy=False)]

    def _prepare(self, desk: Desk) -> Any:
        wp = start_warp()
        from swath.rays.single.kernel import cast_heights

        rays = desk.shared("origins", "directions")
        out = desk.shared("distance", "kind", "cell", "cosine", "reflectance", "fault")
        inputs = [*self.told(), *rays, desk.count, *out]
        return wp.launch(cast_heights, dim=desk.pack_count, inputs=inputs, device="cpu", record_cmd=True)

    def _make_scene(self) -> Any:
        wp = start_warp()
        from swath.rays.single.kernel import Heights

        def share(array: NDArray[Any], kind: Any) -> Any:
            self._kept.append(array)
            return wp.array(array, dtype=kind, device="cpu", copy=False)

        g, scene = self.grid, Heights()
        scene.origin = wp.vec3d(*g.origin)
        scene.turn = wp.vec2d(np.cos(g.yaw), np.sin(g.yaw))
        scene.cell, scene.nodes_per_m = g.cell, 1.0 / g.node
        scene.first, scene.ground = share(first_cells(g).ravel(), wp.int32), share(g.ground, wp.float32)
        tops = block_tops(g) if self.skips else np.full(np.array(g.ground.shape) - 1, np.inf, np.float32)
        ty, tx = g.table.shape
        tile_tops = tops.reshape(ty, NODES, tx, NODES).max(axis=(1, 3))
        scene.block_top, scene.crest = share(tops.ravel(), wp.float32), float(tops.max())
        scene.tile_top = share(tile_tops.ravel(), wp.float32)
        scene.patch = share(patches(g.ground).ravel(), wp.float32)
        cells = self.cells
        scene.quantiles, scene.lid = share(cells.quantiles.ravel(), wp.int16), share(cells.lid, wp.int16)
        scene.rest, scene.cut = share(cells.rest.view(np.int16), wp.int16), share(cells.cut, wp.uint8)
        scene.intensity = share(g.intensity.reshape(-1), wp.float32)
        return scene


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
