"""Rays against a grid of measured heights."""

from typing import Any

import numpy as np

from swath.field.memory_layout import Solids
from swath.kernels import filled, shared
from swath.rays.height_cells import Cells, block_tops, first_cells, patches
from swath.rays.height_grid import NODES, HeightGrid
from swath.rays.refusals import check_range, refuse_below
from swath.rays.single.buffers import MISPLACED, BeamBuffer

NOTHING, MEASURED, UNMEASURED, SOLID = range(4)


class HeightCaster:
    """Marches rays through a grid, every ray alone, with one random number each (`single/heights.cpp`).

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
        self._beams = BeamBuffer(0)
        self._launch: Any = None

    def set_scan(self, *, range_max: float, seed: int, share: float, grain: float) -> None:
        """What the next launches do.

        range_max: rays end there [m]; share: stop every ray where this share of the measured heights is still
        below it, or < 0: drawn by a hash of the seed and the cell of side `grain` [m] in which the ray would
        end on the ground. InputError on a range that is not > 0.
        """
        check_range(range_max)
        self._seed[0] = seed & 0xFFFFFFFF
        self._real[:] = share, grain, range_max

    def march(self, beams: BeamBuffer, solids: Solids | None = None) -> None:
        """Cast the beams of a buffer as `set_scan` said.

        Fills distance [m], nan = nothing, of UNMEASURED where the ground was reached; kind: NOTHING,
        MEASURED, UNMEASURED or SOLID; cell: index into the flattened pools of the grid, -1 = none; cosine and
        reflectance: of a solid, of what was measured 1 and the intensity. Raises ValueError on rays that are
        not finite, InputError on rays that start under the measured ground.
        """
        if beams is not self._beams or self._launch is None:
            self._beams, self._launch = beams, self._prepare(beams)
        self._whole[1] = beams.meet(solids, float(self._real[2]))
        if beams.count:
            self._launch.launch()
        if beams.take_flags() & MISPLACED:
            o = beams.origins[: beams.count]
            refuse_below(o, self.grid.ground_height(o[:, 0], o[:, 1]))

    def _prepare(self, beams: BeamBuffer) -> Any:
        from swath.rays.single.heights_kernel import cast_heights

        inputs = [self._make_scene(), shared(self._whole), shared(self._real), beams.struct()]
        return beams.record(cast_heights, inputs)

    def _make_scene(self) -> Any:
        from swath.rays.single.heights_kernel import Heights

        g, cells = self.grid, self.cells
        tops = block_tops(g) if self.skips else np.full(np.array(g.ground.shape) - 1, np.inf, np.float32)
        ty, tx = g.table.shape
        return filled(
            Heights,
            origin=tuple(g.origin.tolist()),
            turn=(np.cos(g.yaw), np.sin(g.yaw)),
            cell=g.cell,
            nodes_per_m=1.0 / g.node,
            first=first_cells(g).ravel(),
            ground=g.ground,
            block_top=tops.ravel(),
            top_bound=float(tops.max()),
            tile_top=tops.reshape(ty, NODES, tx, NODES).max(axis=(1, 3)).ravel(),
            patch=patches(g.ground).ravel(),
            quantiles=cells.quantiles.ravel(),
            lid=cells.lid,
            rest=cells.rest.view(np.int16),
            cut=cells.cut,
            intensity=g.intensity.reshape(-1),
        )
