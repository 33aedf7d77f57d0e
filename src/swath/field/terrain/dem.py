"""Terrain level `dem`: measured heights from a GeoTIFF, bilinear between cell centres.

Outside the map the height of its nearest edge holds; cells without a value take the mean of known neighbours,
ring by ring. What is finer than the map's cells can be added as ISO 8608 roughness.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.registry import Level
from swath.field.field_setup import FieldSetup
from swath.field.ground.waves import ROUGHNESS_CLASSES, Waves, make_roughness
from swath.field.maps.band import GROUND
from swath.field.maps.raster import Raster

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Params:
    """A measured elevation model.

    file: GeoTIFF of heights with their unit and scale, in a projected system. Its middle is x = y = 0 unless
        there is a field folder
    datum_m: height above sea level of z = 0; none = the mean of the map
    roughness_class: ISO 8608 class of the roughness added to the map, or `none`
    waviness: exponent w of the spectrum of that roughness [1]
    """

    file: str
    datum_m: Annotated[float, Ge(-500.0), Le(9000.0)] | None = None
    roughness_class: Literal["none", "A", "B", "C", "D", "E", "F"] = "none"
    waviness: Annotated[float, Gt(0.5), Le(4.0)] = 2.0


class Dem:
    """Heights on a raster.

    datum: height above sea level that z = 0 stands for [m]
    notes: what was assumed of its file
    gd_n0: displacement spectral density of the added roughness [m3]
    """

    gd_n0 = 0.0

    def __init__(self, params: Params, setup: FieldSetup) -> None:
        raster = Raster.from_geotiff(setup.folder / params.file, setup.origin, quantity=GROUND)
        self._take(raster, params.datum_m)
        self.waves = Waves.none()
        if params.roughness_class != "none":
            self.gd_n0 = ROUGHNESS_CLASSES[params.roughness_class]
            self.waves = make_roughness(self.gd_n0, params.waviness, setup.stream.child("roughness"))

    @staticmethod
    def from_raster(raster: Raster, datum: float | None = 0.0) -> "Dem":
        """Terrain of a raster in world coordinates; datum None = its mean."""
        dem = Dem.__new__(Dem)
        dem.waves = Waves.none()
        dem._take(raster, datum)
        return dem

    def _take(self, raster: Raster, datum: float | None) -> None:
        values = raster.values.astype(np.float64)
        self.datum = float(np.nanmean(values)) if datum is None else datum
        if not abs(float(np.nanmean(values)) - self.datum) < 2000.0:
            expected = f"expected near the map's mean of {float(np.nanmean(values)):.0f} m"
            raise InputError("field.terrain.datum_m", self.datum, expected)
        filled = (fill_gaps(values) - self.datum).astype(np.float32)
        self.raster, self.notes = replace(raster, values=filled), raster.notes

    def height(self, x: Any, y: Any) -> Array:
        """Height [m] above the datum at world points."""
        return self._map(np.asarray(x, dtype=float), np.asarray(y, dtype=float)) + self.waves.height(x, y)

    def lattice(self, u: Array, v: Array, yaw: float) -> Array:
        """Height [m] at the crossings of u and v in a frame turned by yaw, shape (len(v), len(u))."""
        c, s = np.cos(yaw), np.sin(yaw)
        x, y = c * u[None, :] - s * v[:, None], s * u[None, :] + c * v[:, None]
        return self._map(x, y) + self.waves.lattice(u, v, yaw)

    def covers(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True where the map has cells around a world point."""
        r = self.raster
        ny, nx = r.values.shape
        u, v = (np.asarray(x) - r.x0) / r.cell, (np.asarray(y) - r.y0) / r.cell
        return np.asarray((u >= -0.5) & (u <= nx - 0.5) & (v >= -0.5) & (v <= ny - 0.5))

    def _map(self, x: Array, y: Array) -> Array:
        r = self.raster
        ny, nx = r.values.shape
        x = np.clip(x, r.x0, r.x0 + (nx - 1) * r.cell)
        y = np.clip(y, r.y0, r.y0 + (ny - 1) * r.cell)
        return r.sample(x, y)


def fill_gaps(values: Array) -> Array:
    """Fill nan cells with the mean of their known neighbours, ring by ring from the known ones."""
    padded = np.pad(values, 1, constant_values=np.nan)
    flat, (ny, nx) = padded.reshape(-1), values.shape
    is_missing = np.zeros(padded.shape, dtype=bool)
    is_missing[1:-1, 1:-1] = np.isnan(values)
    steps = [(nx + 2) * j + i for j in (-1, 0, 1) for i in (-1, 0, 1)]
    beside = np.zeros(values.shape, dtype=bool)
    for j in range(3):
        for i in range(3):
            beside |= np.isfinite(padded[j : j + ny, i : i + nx])
    row, column = np.nonzero(beside & is_missing[1:-1, 1:-1])
    missing, ring = is_missing.reshape(-1), (nx + 2) * (row + 1) + column + 1
    while len(ring):
        known, total = np.zeros(len(ring)), np.zeros(len(ring))
        for step in steps:
            value = flat[ring + step]
            known += np.isfinite(value)
            total += np.nan_to_num(value)
        flat[ring] = total / known
        missing[ring] = False
        around = np.concatenate([ring + step for step in steps])
        ring = np.unique(around[missing[around]])
    return padded[1:-1, 1:-1].copy()


LEVEL = Level(
    Dem,
    Params,
    "measured heights from a GeoTIFF",
    cost="0.5 ms per page of 8 m x 8 m",
    tolerance="bilinear between cell centres",
)
