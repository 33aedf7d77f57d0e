"""Rays against a grid of measured heights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import Solids
from swath.rays.checks import check_range, refuse_below
from swath.rays.device import start_warp
from swath.rays.geometry import make_things
from swath.rays.height_grid import LEVELS, NODES, NONE, TILE, HeightGrid, lattice_height

NOTHING, MEASURED, UNMEASURED, SOLID = range(4)
UNTOUCHED = 255  # in `HeightCaster.cut`


@dataclass(frozen=True)
class HeightHits:
    """Nearest hits of n rays, all (n,).

    distance [m], nan = nothing; of UNMEASURED where the ground was reached; what: one of the four above
    cell: index into the flattened pools of the grid, -1 = none; cosine, reflectance: of a solid
    """

    distance: NDArray[np.float32]
    what: NDArray[np.int32]
    cell: NDArray[np.int32]
    cosine: NDArray[np.float32]
    reflectance: NDArray[np.float32]


class HeightCaster:
    """Marches rays through a grid, every ray alone, with one random number each (`kernel/heights.py`).

    In an even stand the heights it reports are distributed as the measured ones. An own draw in every cell
    would let the highest of them win.

    cut: (m, TILE, TILE) uint8, UNTOUCHED or the stubble height [cm]; change it in place
    """

    def __init__(self, grid: HeightGrid) -> None:
        self.grid = grid
        self.cut = np.full(grid.count.shape, UNTOUCHED, np.uint8)
        self._highest = grid.origin[2] + float(grid.ground.max(initial=0.0))
        self._scene: Any = None
        self._launch: Any = None
        self._size = -1

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
        """Nearest hit of each ray.

        origins [m], directions (unit): (n, 3), world. share: stop every ray where this share of
        the measured heights is still below it, or < 0: drawn by a hash of the seed and the cell of side
        `grain` [m] in which the ray would end on the ground. Raises ValueError on rays that are not finite,
        InputError on a range that is not > 0 and on rays that start under the measured ground.
        """
        check_range(range_max)
        wp = start_warp()
        from swath.rays.kernel.heights import cast_heights

        if self._scene is None:
            self._scene = self._make_scene(wp)
        if len(origins) != self._size:
            self._reserve(wp, len(origins))
        self._origins[:] = origins
        self._directions[:] = directions
        if not (np.isfinite(self._origins).all() and np.isfinite(self._directions).all()):
            raise ValueError("expected finite origins and directions")
        if self._size and self._origins[:, 2].min() < self._highest:
            refuse_below(self._origins, self.grid.ground_height(self._origins[:, 0], self._origins[:, 1]))
        self._draw.seed, self._draw.share, self._draw.grain = seed & 0xFFFFFFFF, share, grain
        things = make_things(wp, solids or Solids(), "cpu")
        if self._launch is None:
            inputs = [self._scene, things, self._draw, range_max, *self._shared]
            self._launch = wp.launch(
                cast_heights, dim=self._size, inputs=inputs, device="cpu", record_cmd=True
            )
        else:
            for index, value in ((1, things), (2, self._draw), (3, range_max)):
                self._launch.set_param_at_index(index, value)
        if self._size:
            self._launch.launch()
        distance, what, cell, cosine, reflectance = (a.copy() for a in self._out)
        return HeightHits(distance, what, cell, cosine, reflectance)

    def _reserve(self, wp: Any, n: int) -> None:
        from swath.rays.kernel.heights import Draw

        self._size, self._launch = n, None
        self._draw = Draw()
        self._origins, self._directions = np.zeros((n, 3)), np.zeros((n, 3))
        kinds = (np.float32, np.int32, np.int32, np.float32, np.float32)
        self._out: tuple[Any, ...] = tuple(np.zeros(n, k) for k in kinds)
        pairs: list[tuple[Any, Any]] = [(self._origins, wp.vec3d), (self._directions, wp.vec3d)]
        pairs += [(a, wp.float32 if a.dtype == np.float32 else wp.int32) for a in self._out]
        self._shared = [wp.array(a, dtype=t, device="cpu", copy=False) for a, t in pairs]

    def _make_scene(self, wp: Any) -> Any:
        from swath.rays.kernel.heights import Heights

        g = self.grid
        self._tops = tile_tops(g)
        scene = Heights()
        scene.origin = wp.vec3d(*g.origin)
        scene.turn = wp.vec2d(np.cos(g.yaw), np.sin(g.yaw))
        scene.cell, scene.tile, scene.levels, scene.none = g.cell, TILE, LEVELS, NONE
        scene.nodes_per_m = 1.0 / g.node
        for name, array, dtype in (
            ("table", g.table, wp.int32),
            ("tile_top", self._tops, wp.float32),
            ("quantiles", g.quantiles, wp.int16),
            ("cut", self.cut, wp.uint8),
            ("ground", g.ground, wp.float32),
        ):
            setattr(scene, name, wp.array(array, dtype=dtype, device="cpu", copy=False))
        return scene


def tile_tops(grid: HeightGrid) -> NDArray[np.float32]:
    """Highest surface in each tile above origin[2] [m], shape of the table; the ground where unmeasured."""
    ny, nx = grid.table.shape
    blocks = np.lib.stride_tricks.sliding_window_view(grid.ground, (NODES + 1, NODES + 1))[::NODES, ::NODES]
    top = blocks.max(axis=(2, 3)).astype(np.float64)
    highest = np.maximum(grid.quantiles[..., -1].max(axis=(1, 2)) * 1e-3, 0.0)
    ty, tx = np.nonzero(grid.table >= 0)
    top[ty, tx] += highest[grid.table[ty, tx]]
    assert top.shape == (ny, nx)
    return np.asarray(top + 1e-3, dtype=np.float32)


def surface(grid: HeightGrid, x: Any, y: Any, level: int) -> NDArray[np.float64]:
    """Height of the surface of one quantile in the world [m], nan where nothing was measured."""
    u, v = grid.to_local(x, y)
    cell = grid.cells_at(x, y)
    q = grid.quantiles.reshape(-1, LEVELS)[cell]
    height = np.where((cell >= 0) & (q[..., 0] != NONE), q[..., level] * 1e-3, np.nan)
    return np.asarray(grid.origin[2] + lattice_height(grid.ground, grid.node, u, v) + height)
