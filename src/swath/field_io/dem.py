"""A digital elevation model, in whatever system it comes, on the cells of a field."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.apart.call import apart
from swath.core.errors import Extra, InputError
from swath.core.number_text import num, percent_of
from swath.documents.witness import Pair, judge, ratio
from swath.field.maps.band import GROUND, check_ground, horizontal, read_band
from swath.field.maps.projection import transform
from swath.field.maps.raster import LIBRARIES, Raster, open_geotiff
from swath.field_io.heights import carry_on
from swath.field_io.logs.log import Log

Array = NDArray[np.float64]
MOST_READ = 16_000_000  # cells of the file held at once: a finer one is read by means
APART, RISES = 2.0, 1.0  # m, and times more: heights of a log and of a DEM farther apart are reported
ALIKE = 0.2, 0.7  # that the correlation of both heights lacks to 1, above which it is noted, and refused
FEWEST_HEIGHTS = 100  # of a log that say something of a DEM
OTHER_PASS = 60.0  # s between records of two passes
LEAST_KNOWN = 0.8  # share of the cells around the field that must have a height


@apart("dem", "a readable GeoTIFF", libraries=LIBRARIES, records=(Raster,))
def read_dem(path: Path, grid: Raster) -> tuple[Raster, float]:
    """Heights [m] of a GeoTIFF at the cells of grid (bilinear), and the share of cells it knows.

    Any system with a CRS will do, geographic ones too. Cells without a height carry on smoothly those around
    them. notes of the raster: what was assumed, see `band.read_band`.
    Raises InputError when the file is unreadable, has no CRS, covers less than LEAST_KNOWN of the grid, or
    holds what cannot be ground.
    """
    with Extra("geo", "reading a DEM"):
        import rasterio
        import rasterio.warp
    ny, nx = grid.values.shape
    west, _, _, north = grid.bounds
    target = rasterio.Affine(grid.cell, 0.0, west, 0.0, -grid.cell, north)
    values, notes = np.full((ny, nx), np.nan, dtype=np.float32), list[str]()
    with open_geotiff(path) as dataset:
        if dataset.crs is None:
            raise InputError("dem.crs", None, "expected a coordinate system, the file names none", file=path)
        flat = horizontal(dataset.crs)
        window = _window(dataset, flat, grid)
        if window is not None:
            coarser = max(1, int(np.ceil(np.sqrt(window.width * window.height / MOST_READ))))
            shape = (-(-window.height // coarser), -(-window.width // coarser))
            band = read_band(dataset, path, GROUND, window=window, shape=shape)
            across, down = window.width / shape[1], window.height / shape[0]
            a, b, c, d, e, f = tuple(dataset.transform)[:6]
            c, f = a * window.col_off + b * window.row_off + c, d * window.col_off + e * window.row_off + f
            place = rasterio.Affine(a * across, b * down, c, d * across, e * down, f)
            rasterio.warp.reproject(
                band.values, values, src_transform=place,
                src_crs=flat.to_wkt(), src_nodata=np.nan, dst_transform=target,
                dst_crs=f"EPSG:{grid.epsg}", dst_nodata=np.nan, init_dest_nodata=True,
                resampling=rasterio.warp.Resampling.bilinear,
            )  # fmt: skip
            notes = list(band.notes)
    values = values[::-1]
    known = np.isfinite(values)
    share = float(known.mean())
    if share < LEAST_KNOWN:
        middle = f"{num(west + 0.5 * nx * grid.cell)} E, {num(north - 0.5 * ny * grid.cell)} N"
        expected = (
            f"expected heights for at least {percent_of(LEAST_KNOWN)} of the field and its margin; the field "
            f"is at {middle} (EPSG:{grid.epsg}), the file says {flat.name[:40]}"
        )
        raise InputError("place", percent_of(share), expected, file=path)
    notes += check_ground(values, grid.cell, path)
    if share < 1.0:
        notes.append(
            f"heights: {percent_of(1.0 - share)} of the ground has none in {path.name}: carried on around it"
        )
    filled = carry_on(values.astype(np.float64)).astype(np.float32)
    return replace(grid, values=filled, notes=tuple(notes)), share


def against_log(raster: Raster, log: Log, path: Path) -> Raster:
    """A DEM, with notes where the heights of a log lie elsewhere or rise otherwise.

    Raises InputError where both have hills, and not the same ones.
    """
    there = raster.sample(*log.position.T)
    known = np.isfinite(there) & np.isfinite(log.elevation)
    if known.sum() < FEWEST_HEIGHTS:
        return raster
    dem, logged = there[known], log.elevation[known]
    off = float(np.median(logged - dem))
    rises = [float(np.subtract(*np.percentile(heights, [90, 10]))) for heights in (dem, logged)]
    alike = float(np.corrcoef(dem, logged)[0, 1]) if min(rises) > APART else np.nan
    alike /= max(_repeated(log.position[known], logged, log.time[known]), 0.1)
    place = f"the log's heights lie {num(abs(off))} m {'above' if off > 0 else 'below'} the DEM's"
    rise = f"the log's heights rise {num(rises[1] / max(rises[0], 1e-9))} times as far as the DEM's"
    steeper = ratio(*rises) if rises[0] > APART else np.nan
    hills = f"of the log's hills it shows r = {num(alike)}"
    pairs = (
        Pair("heights", hills, 1.0 - alike, *ALIKE, "is the file turned, or of another field?"),
        Pair("heights", place, abs(off), APART, entry="geoid against ellipsoid, or a unit?"),
        Pair("heights", rise, steeper, RISES, entry="is one in another unit?"),
    )
    return replace(raster, notes=(*raster.notes, *judge(pairs, path)))


def _repeated(position: Array, height: Array, time: Array) -> float:
    """Correlation of heights with the truth, by those that another pass has beside them; 1 without such."""
    from scipy.spatial import cKDTree

    some = np.unique(np.linspace(0, len(time) - 1, 2000).astype(int))
    beside = cKDTree(position).query(position[some], k=min(30, len(time)))[1]
    is_other = np.abs(time[beside] - time[some, None]) > OTHER_PASS
    rank, found = is_other.argmax(axis=1), is_other.any(axis=1)
    if found.sum() < FEWEST_HEIGHTS:
        return 1.0
    pairs = height[np.stack([some, beside[np.arange(len(some)), rank]])[:, found]]
    return float(max(np.corrcoef(pairs)[0, 1], 0.0) ** 0.5)


def _window(dataset: Any, flat: Any, grid: Raster) -> Any:
    """The part of a file, in whole cells, around a grid; None where they do not meet."""
    from rasterio.windows import Window

    west, south, east, north = grid.bounds
    along = np.linspace(0.0, 1.0, 11)
    x, y = np.meshgrid(west + (east - west) * along, south + (north - south) * along)
    places = transform(np.stack([x.ravel(), y.ravel()], axis=1), f"EPSG:{grid.epsg}", flat)
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return None
    a, b, c, d, e, f = tuple(~dataset.transform)[:6]
    column, row = a * places[:, 0] + b * places[:, 1] + c, d * places[:, 0] + e * places[:, 1] + f
    ends = []
    for value, size in ((column, dataset.width), (row, dataset.height)):
        first, last = np.clip([value.min() - 3.0, value.max() + 4.0], 0, size).astype(int).tolist()
        ends.append((first, last - first))
    (left, width), (top, height) = ends
    return Window(left, top, width, height) if width > 0 and height > 0 else None
