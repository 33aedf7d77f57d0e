"""Beams against bodies: solids, ground, and the canopy with a drawn depth. One ray per beam."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.field.field import Field
from swath.kernels import filled
from swath.rays.spread import Spread, SpreadTable, double_log

TOP_ROOM = 0.12  # measured heights lie up to this share above the top of the crop
PITCH = 0.08  # longest step along a beam through crop [m]: stems lean that far over the edge anyway
EMPTY = 2e-6  # less projected area than this above a height stops no beam [m2]


def pack_canopy(
    table: SpreadTable,
    field: Field,
    *,
    crop_height: float,
    exit_diameter: float,
    divergence: float,
    pitch: float = PITCH,
) -> Any:
    """The table as native code reads it.

    crop_height: of the field's crop at scale 1 [m]; exit_diameter [m], divergence [rad]: of the beam, mean of
    both directions; pitch: step through crop [m]
    """
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
