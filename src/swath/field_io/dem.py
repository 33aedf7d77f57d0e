"""A digital elevation model, in whatever system it comes, on the cells of a field."""

from pathlib import Path

import numpy as np

from swath.core.errors import InputError, MissingExtra
from swath.field.raster import Raster, open_geotiff

WARP_MB = 64  # of the file that are held at once: it may be far larger than the field
LEAST_KNOWN = 0.8  # share of the cells around the field that must have a height


def read_dem(path: Path, grid: Raster) -> tuple[Raster, float]:
    """Heights [m] of a GeoTIFF at the cells of grid (bilinear), and the share of cells it knows.

    Any system with a CRS will do, geographic ones too. Cells without a height take that of the nearest cell.
    Raises InputError when the file is unreadable, has no CRS, or covers less than LEAST_KNOWN of the grid.
    """
    try:
        import rasterio
        import rasterio.warp
        from scipy.ndimage import distance_transform_edt
    except ImportError as error:
        raise MissingExtra("geo", "reading a DEM") from error
    ny, nx = grid.values.shape
    west, _, _, north = grid.bounds
    target = rasterio.Affine(grid.cell, 0.0, west, 0.0, -grid.cell, north)
    values = np.full((ny, nx), np.nan, dtype=np.float32)
    with open_geotiff(path) as dataset:
        if dataset.crs is None:
            raise InputError("dem.crs", None, "expected a coordinate system, the file names none", file=path)
        system = dataset.crs.to_string()[:40]
        rasterio.warp.reproject(
            rasterio.band(dataset, 1), values, src_nodata=dataset.nodata, dst_transform=target,
            dst_crs=f"EPSG:{grid.epsg}", dst_nodata=np.nan, init_dest_nodata=True,
            resampling=rasterio.warp.Resampling.bilinear, warp_mem_limit=WARP_MB,
        )  # fmt: skip
    values = values[::-1]
    known = np.isfinite(values)
    share = float(known.mean())
    if share < LEAST_KNOWN:
        middle = f"{west + 0.5 * nx * grid.cell:.0f} E, {north - 0.5 * ny * grid.cell:.0f} N"
        expected = (
            f"expected heights for at least {LEAST_KNOWN:.0%} of the field and its margin; the field is at "
            f"{middle} (EPSG:{grid.epsg}), the file says {system}"
        )
        raise InputError("dem", f"{share:.0%}", expected, file=path)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return Raster(values[tuple(nearest)], grid.x0, grid.y0, grid.cell, grid.epsg), share
