"""A map on a regular grid: north up, metres, in the local frame of a field.

World coordinates of a field are a projected (UTM) system minus an origin: a pure translation. Grid
convergence and point scale (below 0.04 % inside a UTM zone) are left in, so east and north are the grid's.
"""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swath.core.apart.call import apart, written_here
from swath.core.errors import Extra, InputError
from swath.core.files.read_file import check_readable
from swath.core.files.whole_file import new_file
from swath.documents.packed import readable
from swath.field.maps.band import PLAIN, Quantity, check_ground, horizontal, read_band

Array = NDArray[np.float64]
LIBRARIES = (
    "rasterio",
    "rasterio.crs",
    "rasterio.errors",
    "rasterio.warp",
    "rasterio.windows",
)  # of a reader
CELLS_MAX = 50_000_000  # of a map held in memory: 50 km2 in cells of 1 m


@dataclass(frozen=True)
class Raster:
    """Values on square cells.

    values: shape (ny, nx), float32, row 0 is the south, column 0 the west; nan = unknown.
    x0, y0: centre of the south-west cell [m]. cell: edge of a cell [m].
    epsg: of the system x and y are a translation of, None = none known.
    notes: what was assumed of the file it is of.
    """

    values: NDArray[np.float32]
    x0: float
    y0: float
    cell: float
    epsg: int | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.size == 0:
            raise InputError("raster.values", self.values.shape, "expected two dimensions, none empty")
        if not (np.isfinite([self.x0, self.y0, self.cell]).all() and self.cell > 0.0):
            raise InputError("raster.cell", (self.x0, self.y0, self.cell), "expected finite values, cell > 0")

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Outer edges of the outer cells (west, south, east, north) [m]."""
        ny, nx = self.values.shape
        half = 0.5 * self.cell
        west, south = self.x0 - half, self.y0 - half
        return west, south, west + nx * self.cell, south + ny * self.cell

    def centres(self) -> tuple[Array, Array]:
        """Cell centres: x [m], shape (nx,), and y [m], shape (ny,)."""
        ny, nx = self.values.shape
        x: Array = self.x0 + self.cell * np.arange(nx, dtype=float)
        y: Array = self.y0 + self.cell * np.arange(ny, dtype=float)
        return x, y

    def sample(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Value at points [m], bilinear between cell centres, in the shape of x and y broadcast.

        The cell a point lies in decides whether there is a value: outside the map or in a nan cell the
        result is nan. Elsewhere nan neighbours are left out and the other weights scaled up; in the outer
        half cell of the map the value is constant outwards.
        """
        corners, fx, fy, inside = self._corners(x, y)
        weights = np.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy])
        known = np.isfinite(corners)
        weights = np.where(known, weights, 0.0)
        total = np.where(inside, weights.sum(axis=0), 1.0)
        value = (weights * np.where(known, corners, 0.0)).sum(axis=0) / total
        return np.asarray(np.where(inside, value, np.nan))

    def shifted(self, dx: float, dy: float) -> "Raster":
        """The same map with its coordinates moved by (dx, dy) [m]."""
        return replace(self, x0=self.x0 + dx, y0=self.y0 + dy)

    @staticmethod
    def from_geotiff(
        path: Path | str,
        origin: tuple[float, float] | None = None,
        *,
        quantity: Quantity = PLAIN,
        may_be_empty: bool = False,
        band: int | None = None,
    ) -> "Raster":
        """A band of a GeoTIFF in SI. origin: (easting, northing) [m] to subtract, None = keep the file's.

        quantity: what its numbers are; their scale, offset, unit and nodata are applied, see `read_band`.
        Raises InputError naming the file when it cannot be read, has no projected system in metres, is
        rotated, has cells that are not square, numbers that cannot be meant, or, unless it `may_be_empty`,
        none at all.
        """
        return _read(Path(path), origin, quantity, may_be_empty, band)

    def to_geotiff(
        self,
        path: Path | str,
        epsg: int,
        origin: tuple[float, float] = (0.0, 0.0),
        *,
        name: str = "",
        unit: str = "",
    ) -> None:
        """Write as float32, deflate, nodata nan, with origin (easting, northing) [m] added back.

        name, unit: of the band, as GDAL and QGIS show them
        """
        rasterio = _rasterio()
        ny, nx = self.values.shape
        west = self.x0 - 0.5 * self.cell + origin[0]
        north = self.y0 + (ny - 0.5) * self.cell + origin[1]
        with new_file(Path(path)) as file, rasterio.MemoryFile() as memory, memory.open(
            driver="GTiff", height=ny, width=nx, count=1, dtype="float32", nodata=float("nan"),
            crs=rasterio.crs.CRS.from_epsg(epsg), compress="deflate", predictor=3,
            transform=rasterio.Affine(self.cell, 0.0, west, 0.0, -self.cell, north),
        ) as dataset:  # fmt: skip
            dataset.write(np.ascontiguousarray(self.values[::-1], dtype=np.float32), 1)
            dataset.set_band_description(1, name)
            dataset.set_band_unit(1, unit)
            dataset.close()
            file.write(memory.getbuffer())
        written_here(Path(path))

    def _corners(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array, Array, Any]:
        """Values of the four cells around each point, shape (4, ...): SW, SE, NW, NE;
        the fractions of a cell past the first in x and y; and where there is a value.
        """
        ny, nx = self.values.shape
        u, v = np.broadcast_arrays(self._index(x, self.x0), self._index(y, self.y0))
        inside = (u >= -0.5) & (u <= nx - 0.5) & (v >= -0.5) & (v <= ny - 0.5)
        u, v = np.clip(u, 0.0, nx - 1), np.clip(v, 0.0, ny - 1)
        i, j = np.minimum(u.astype(int), max(nx - 2, 0)), np.minimum(v.astype(int), max(ny - 2, 0))
        i1, j1 = np.minimum(i + 1, nx - 1), np.minimum(j + 1, ny - 1)
        grid = self.values
        corners = np.stack([grid[j, i], grid[j, i1], grid[j1, i], grid[j1, i1]]).astype(float)
        own = grid[np.floor(v + 0.5).astype(int), np.floor(u + 0.5).astype(int)]
        return corners, u - i, v - j, inside & np.isfinite(own)

    def _index(self, position: ArrayLike, start: float) -> Array:
        value = (np.asarray(position, dtype=float) - start) / self.cell
        return np.where(np.isfinite(value), value, -1e9)


@apart("raster", "a readable GeoTIFF", libraries=LIBRARIES, records=(Raster,))
def _read(
    path: Path, origin: tuple[float, float] | None, quantity: Quantity, may_be_empty: bool, band: int | None
) -> Raster:
    """As `Raster.from_geotiff`."""
    with open_geotiff(path) as dataset:
        epsg = _metric_epsg(dataset.crs, path)
        cell = _cell(dataset.transform, path)
        _check_cells(dataset, path)
        read = read_band(dataset, path, quantity, band=band)
        west, north = float(dataset.transform.c), float(dataset.transform.f)
    values, notes = np.ascontiguousarray(read.values[::-1]), read.notes
    if not (may_be_empty or np.isfinite(values).any()):
        raise InputError("raster", None, "expected at least one number, every cell is empty", file=path)
    if quantity.is_ground:
        notes += check_ground(values, cell, path)
    east0, north0 = origin if origin is not None else (0.0, 0.0)
    y0 = north - (values.shape[0] - 0.5) * cell - north0
    return Raster(values, west + 0.5 * cell - east0, y0, cell, epsg, notes)


def _rasterio() -> Any:
    with Extra("geo", "reading and writing GeoTIFF"):
        import rasterio
        import rasterio.crs
        import rasterio.errors
    return rasterio


@contextmanager
def open_geotiff(path: Path) -> Iterator[Any]:
    """An open rasterio dataset. Raises InputError naming the file for whatever goes wrong with it.

    Only GDAL's driver of GeoTIFF looks at it, and no file beside it is read: others, such as VRT and WMS,
    are texts that name further files and addresses, and GDAL goes by the content, not by the name.
    """
    rasterio = _rasterio()
    check_readable(path, "raster", "a GeoTIFF")
    with readable("raster", "a readable GeoTIFF", path), warnings.catch_warnings(), _damaged_messages():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        alone = rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR")
        with alone, rasterio.open(path, driver="GTiff") as dataset:
            yield dataset


@contextmanager
def _damaged_messages() -> Iterator[None]:
    """GDAL quotes what is no text in a damaged file; rasterio cannot log that and prints a traceback."""
    before = sys.unraisablehook

    def hook(what: Any) -> None:
        if not isinstance(what.exc_value, UnicodeDecodeError):
            before(what)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


def _check_cells(dataset: Any, path: Path) -> None:
    if dataset.width * dataset.height > CELLS_MAX:
        expected = f"expected at most {CELLS_MAX} cells: cut it to the field, or take larger cells"
        raise InputError("raster", f"{dataset.width} x {dataset.height}", expected, file=path)


def _metric_epsg(crs: Any, path: Path) -> int | None:
    if crs is None:
        raise InputError("raster.crs", None, "expected a coordinate system, the file names none", file=path)
    flat = horizontal(crs)
    if not flat.is_projected or abs(flat.axis_info[0].unit_conversion_factor - 1.0) > 1e-9:
        raise InputError("raster.crs", flat.name, "expected a projected system in metres (UTM)", file=path)
    epsg = flat.to_epsg()
    return None if epsg is None else int(epsg)


def _cell(transform: Any, path: Path) -> float:
    a, b, _, d, e, _ = (float(v) for v in tuple(transform)[:6])
    if b != 0.0 or d != 0.0 or a <= 0.0 or e >= 0.0:
        raise InputError(
            "raster.transform", tuple(transform)[:6], "expected north up, not rotated", file=path
        )
    if abs(a + e) > 1e-6 * a:
        raise InputError("raster.cell", (a, -e), "expected square cells", file=path)
    return a
