"""Beams against bodies: solids, ground, and the canopy with a drawn depth. One ray per beam."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.field.field import Field
from swath.field.memory_layout import Solids
from swath.kernels import filled
from swath.rays.device import start_warp
from swath.rays.field_arrays import LiveScene
from swath.rays.refusals import check_origins, check_range
from swath.rays.single.buffers import CLAMPED, MISPLACED, BeamBuffer, share
from swath.rays.spread import Spread, SpreadTable, double_log

TOP_ROOM = 0.12  # measured heights lie up to this share above the top of the crop
PITCH = 0.08  # longest step along a beam through crop [m]: stems lean that far over the edge anyway
EMPTY = 2e-6  # less projected area than this above a height stops no beam [m2]


class BodyCaster:
    """Casts the beams of a buffer, one ray each; how deep one goes into crop is drawn by its normal number.

    beams: their memory
    apart: angle to the neighbour on the line [rad], (count,)
    line_count: lines of the scanner, beams ordered by azimuth, then by line; 0 = neighbours draw
        independently
    table: of the spread
    crop_height: of the field's crop at scale 1 [m]; exit [m], divergence [rad]: of the beam, mean of both
        directions
    pitch: step through crop [m]
    """

    def __init__(
        self,
        field: Field,
        table: SpreadTable,
        beams: BeamBuffer,
        apart: Any,
        *,
        line_count: int,
        crop_height: float,
        exit_diameter: float,
        divergence: float,
        pitch: float = PITCH,
    ) -> None:
        self.field = field
        self.scene = LiveScene(field, "cpu", top_room=TOP_ROOM + 1e-3, has_plants=False)
        self.table, self.beams, self.line_count = table, beams, line_count
        self._apart = np.zeros(len(beams.score), np.float32)
        self._apart[: beams.count] = apart
        self._numbers = {
            "crop_height": crop_height,
            "exit_diameter": exit_diameter,
            "divergence": divergence,
            "pitch": pitch,
        }
        self._launch: Any = None
        self._made_for = -1  # version of the scene
        self._called = (0.0, 0)  # range and flag of solids it has
        self._kept: tuple[Any, ...] = ()  # what it reads

    def cast_beams(self, *, range_max: float, solids: Solids | None = None) -> int:
        """Nearest body of each beam within range_max [m]: fills distance, kind (organ), cosine, reflectance.

        Returns a number whose bit k is set when some beam left axis k of the standing crop's grid, bit 4 + k
        of the stubble's, bit 8 when one met crop that leans by more than 20 deg. Raises as `RayCaster.cast`.
        """
        check_range(range_max)
        if self.beams.count == 0:
            return 0
        wp = start_warp()
        scene = self.scene.refresh(wp)
        has_solids = int(self.beams.meet(solids, range_max))
        if self._made_for != self.scene.version:
            self._prepare(scene, range_max, has_solids)
        elif self._called != (range_max, has_solids):
            self._launch.set_param_at_index(5, range_max)
            self._launch.set_param_at_index(6, has_solids)
        self._called = range_max, has_solids
        self._launch.launch()
        found = self.beams.take_flags()
        if found & MISPLACED:
            check_origins(self.field, self.beams.origins[: self.beams.count])
        return found >> CLAMPED

    def _prepare(self, scene: Any, range_max: float, has_solids: int) -> None:
        """The launch that is repeated until the field's memory moves."""
        from swath.rays.single.kernel import cast_bodies

        self._kept = self._kept or (
            pack_canopy(self.table, self.field, **self._numbers),
            share(self._apart),
        )
        canopy, apart = self._kept
        inputs = [scene, canopy, self.beams.struct(), apart, self.line_count, range_max, has_solids]
        self._launch = self.beams.record(cast_bodies, inputs, threads=1)
        self._made_for = self.scene.version


def pack_canopy(
    table: SpreadTable,
    field: Field,
    *,
    crop_height: float,
    exit_diameter: float,
    divergence: float,
    pitch: float = PITCH,
) -> Any:
    """The table as native code reads it; numbers as in `BodyCaster`."""
    from swath.rays.single.kernel import Canopy

    depth, top_bound = below_top_bound(table)
    row = field.library.row_spacing
    return filled(
        Canopy,
        standing=_pack_grid(table.standing),
        stubble=_pack_grid(table.stubble),
        depth=np.ascontiguousarray(depth.ravel(), np.float32),
        depth_steps=depth.shape[1],
        view=np.ascontiguousarray(_between(table.view), np.float32),
        aside=np.ascontiguousarray(table.aside.ravel(), np.float32),
        aside_step=table.aside_step,
        aside_levels=len(table.aside),
        row=row,
        from_row=np.ascontiguousarray(_from_row(table.aside, row / crop_height), np.float32),
        side_axes=np.r_[table.side.height, portable.log(table.side.spot)].astype(np.float32),
        side_size=table.side.factor.shape[1:],
        side_factor=np.ascontiguousarray(table.side.factor.ravel(), np.float32),
        side_median=portable.log(table.side.median).astype(np.float32),
        node_count=table.standing.quantile.shape[-1],
        top_bound=crop_height * top_bound,
        stubble_bound=min(max(float(table.stubble.quantile.max()), 1.0), 1.0 + TOP_ROOM),
        fine=table.fine,
        height=crop_height,
        exit=exit_diameter,
        divergence=divergence,
        pitch=pitch,
        density_max=field.library.density_max,
        cosine=table.cosine,
        correlation=tuple(table.correlation),
    )


def _from_row(aside: NDArray[np.float64], row: float) -> NDArray[np.float64]:
    """Share of places aside that is left across the rows when feet go to the middle of their rows, (levels,).

    That move alone spreads them by row^2 / 12 (Sheppard's correction); row: over the crop's height.
    """
    variance = np.maximum(0.5 * np.square(aside).sum(axis=2).mean(axis=1), 1e-12)
    return np.asarray(np.sqrt(np.maximum(1.0 - row**2 / (12.0 * variance), 0.0)))


def _between(view: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tangents at which the next depression is the nearer one, in the logarithm."""
    log_tangent = portable.log(portable.tan(view))
    return portable.exp(0.5 * (log_tangent[1:] + log_tangent[:-1]))


def _pack_grid(grid: Spread) -> Any:
    """One grid of the table as native code reads it."""
    from swath.rays.single.kernel import Grid

    axes = grid.scaled_axes()
    arrays = {
        "axes": np.concatenate(axes),
        "quantile": grid.quantile,
        "ground": double_log(grid.ground_share),
        "lift": grid.ground_lift,
    }
    return filled(
        Grid,
        **{name: np.ascontiguousarray(array.ravel(), np.float32) for name, array in arrays.items()},
        size=tuple(len(a) for a in axes),
        densities=tuple(grid.density[[0, -1]]),
        tangents=tuple(portable.exp(axes[2][[0, -1]])),
    )


def below_top_bound(table: SpreadTable) -> tuple[NDArray[np.float64], float]:
    """Projected area of a stem above equal steps of the relative height [m2], from each depression, 0 from
    its bound on; the bound.

    No echo of the table lies above the bound, relative to the crop's height, and what a beam passes counts
    from there.
    """
    last = table.silhouette.shape[1] - 1
    reached = 1 + int(np.flatnonzero((table.silhouette > EMPTY).any(axis=0)).max())
    highest = math.ceil(float(table.standing.quantile.max()) / table.fine - 1e-6)
    top_bound = min(max(reached, highest), last)
    above = np.maximum(table.silhouette - table.silhouette[:, top_bound, None], 0.0)
    return above, table.fine * top_bound
