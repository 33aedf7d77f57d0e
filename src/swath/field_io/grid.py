"""From cleaned records to maps: yield, moisture, stems per m2, crop height."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.field.maps.raster import Raster
from swath.field_io.clean import Cleaned
from swath.field_io.trade import STEMS

Array = NDArray[np.float64]
REACH_WIDTHS = 1.25  # header widths a record counts at most
FILL_WIDTHS = 2.5  # header widths a gap is filled from the records around it; farther there is no crop
MOST_CELLS = 4_000_000  # of a map: 100 km2 in cells of 5 m
CELLS_AT_ONCE = 50_000  # of a map, with their NEAREST records in memory
NEAREST = 48  # records that count for a cell


@dataclass(frozen=True)
class Maps:
    """Maps on the same cells, nan = no crop known. grain [kg/m2], stems [1/m2], moisture [share of wet mass].

    clipped_count: cells whose stems were clipped
    filled_count: cells between records, filled from farther
    """

    grain: Raster
    stems: Raster
    moisture: Raster
    clipped_count: int
    filled_count: int


def make_grid(bounds: tuple[float, float, float, float], cell: float, margin: float, epsg: int) -> Raster:
    """Empty map whose cell edges lie on multiples of the cell, around bounds (W, S, E, N) [m].

    InputError where it would have more than MOST_CELLS.
    """
    west, south = (np.floor((b - margin) / cell) * cell for b in bounds[:2])
    nx, ny = (int(np.ceil((b + margin - a) / cell)) for a, b in ((west, bounds[2]), (south, bounds[3])))
    if nx * ny > MOST_CELLS:
        size = f"{num(nx * cell / 1000.0)} x {num(ny * cell / 1000.0)} km"
        expected = (
            f"expected at most {num(MOST_CELLS * cell**2 / 1e6)} km2 around it, in cells of {num(cell)} m: "
            "is a corner far off, or are several fields in it?"
        )
        raise InputError("field", size, expected)
    values = np.full((ny, nx), np.nan, dtype=np.float32)
    return Raster(values, float(west + 0.5 * cell), float(south + 0.5 * cell), cell, epsg)


def make_maps(
    cleaned: Cleaned, grid: Raster, crop: NDArray[np.bool_], grain_kg_per_stem: float, usual_stems: float
) -> Maps:
    """Maps from the kept records.

    grid: cells in the log's system; crop: cells where crop can stand, shape (ny, nx). A cell is the mean of
    the nearest records weighted by exp(-(d / s)^2 / 2), s = half a header width, within REACH_WIDTHS;
    without one, of all within FILL_WIDTHS. Yield is as harvested (wet); stems = yield / grain_kg_per_stem,
    near usual_stems [1/m2].
    """
    kept = cleaned.kept
    width = float(np.median(cleaned.log.width[kept]))
    x, y = np.meshgrid(*grid.centres())
    cells = np.stack([x[crop], y[crop]], axis=1)
    xy = cleaned.log.position[kept]
    grain, moisture = cleaned.grain[kept], cleaned.log.moisture[kept]
    (values, moist), filled = _means(xy, cells, width, (grain, moisture))
    stems = values / grain_kg_per_stem
    low, high = (share * usual_stems for share in STEMS)
    outside = (stems < low) | (stems > high)
    return Maps(
        _onto(grid, crop, values),
        _onto(grid, crop, np.clip(stems, low, high)),
        _onto(grid, crop, moist),
        int(outside.sum()),
        int((filled & np.isfinite(values)).sum()),
    )


def crop_height(cleaned: Cleaned, grid: Raster, stems: Raster, default: float) -> Raster:
    """Height of the crop [m] where stems stand: from the log when most records have one, else the default."""
    crop = np.isfinite(stems.values)
    logged = cleaned.log.crop_height[cleaned.kept]
    if not len(logged) or np.isfinite(logged).mean() < 0.5:
        return _onto(grid, crop, np.full(int(crop.sum()), default))
    x, y = np.meshgrid(*grid.centres())
    width = float(np.median(cleaned.log.width[cleaned.kept]))
    cells = np.stack([x[crop], y[crop]], axis=1)
    (heights,), _ = _means(cleaned.log.position[cleaned.kept], cells, width, (logged,))
    return _onto(grid, crop, np.nan_to_num(heights, nan=default))


def _means(
    xy: Array, cells: Array, width: float, columns: Sequence[Array]
) -> tuple[list[Array], NDArray[np.bool_]]:
    """Weighted means of columns of records at cells, (n,) each, and cells that needed the wider reach."""
    from scipy.spatial import cKDTree

    tree = cKDTree(xy)
    means, filled = [np.zeros(len(cells)) for _ in columns], np.zeros(len(cells), dtype=bool)
    for first in range(0, len(cells), CELLS_AT_ONCE):
        part = slice(first, first + CELLS_AT_ONCE)
        near, weight, filled[part] = _weights(tree, cells[part], width)
        for mean, values in zip(means, columns, strict=True):
            mean[part] = _mean(values, near, weight)
    return means, filled


def _weights(tree: Any, cells: Array, width: float) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
    """Records near each cell, shape (n, k), their weights, and cells that needed the wider reach."""
    count = min(NEAREST, tree.n)
    distance, near = tree.query(cells, k=count, distance_upper_bound=FILL_WIDTHS * width)
    distance, near = distance.reshape(len(cells), count), near.reshape(len(cells), count)
    found = np.isfinite(distance)
    filled = distance[:, 0] > REACH_WIDTHS * width if len(cells) else np.zeros(0, dtype=bool)
    used = found & (filled[:, None] | (distance <= REACH_WIDTHS * width))
    spread = np.where(filled, width, 0.5 * width)[:, None]
    weight = np.where(used, np.exp(-0.5 * (np.where(found, distance, 0.0) / spread) ** 2), 0.0)
    return np.where(found, near, 0), weight, filled


def _mean(values: Array, near: NDArray[np.int64], weight: Array) -> Array:
    """Weighted means, shape (cells,); values that are nan do not count; nan where none counts."""
    known = np.isfinite(values)
    weight = np.where(known[near], weight, 0.0)
    total = weight.sum(axis=1)
    mean = (weight * np.where(known, values, 0.0)[near]).sum(axis=1) / np.where(total > 0.0, total, 1.0)
    return np.where(total > 0.0, mean, np.nan)


def _onto(grid: Raster, crop: NDArray[np.bool_], values: Array) -> Raster:
    full = np.full(grid.values.shape, np.nan, dtype=np.float32)
    full[crop] = values
    return Raster(full, grid.x0, grid.y0, grid.cell, grid.epsg)
