"""Between lon/lat (WGS 84), a UTM zone and the local frame of a field."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swath.core.errors import Extra, InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Origin:
    """Where local (0, 0, 0) lies: easting, northing [m] in the projected system epsg, height [m]."""

    epsg: int
    easting: float
    northing: float
    height: float = 0.0

    def grid(self) -> dict[str, float]:
        """How the axes of the world, those of the grid, lie on Earth: `epsg`; `convergence_deg`, by which the
        grid's north is turned clockwise from true north; `scale`, metres of the grid for one on the ground.
        """
        pyproj = _pyproj()
        lon, lat = self.to_lon_lat([[0.0, 0.0]])[0].tolist()
        at = pyproj.Proj(f"EPSG:{self.epsg}").get_factors(lon, lat)
        return {"epsg": self.epsg, "convergence_deg": round(at.meridian_convergence, 4),
                "scale": round(at.meridional_scale, 7)}  # fmt: skip

    def to_local(self, lon_lat: ArrayLike) -> Array:
        """Lon/lat [deg], shape (n, 2), as local east and north [m], shape (n, 2)."""
        return transform(lon_lat, "EPSG:4326", f"EPSG:{self.epsg}") - (self.easting, self.northing)

    def to_field(self, places: ArrayLike) -> Array:
        """Lon/lat [deg] and height [m], shape (n, 3), as local east, north and up [m], shape (n, 3)."""
        places = np.asarray(places, dtype=float)
        return np.column_stack([self.to_local(places[:, :2]), places[:, 2] - self.height])

    def to_lon_lat(self, local: ArrayLike) -> Array:
        """Local east and north [m], shape (n, 2), as lon/lat [deg], shape (n, 2)."""
        grid = np.asarray(local, dtype=float) + np.array([self.easting, self.northing])
        return transform(grid, f"EPSG:{self.epsg}", "EPSG:4326")


def origin_at(lat: float, lon: float, height: float = 0.0) -> Origin:
    """The origin at a place [deg, m], in the UTM zone there. Axes are those of its grid."""
    epsg = utm_epsg(lon, lat)
    east, north = transform([[lon, lat]], "EPSG:4326", f"EPSG:{epsg}")[0]
    return Origin(epsg, float(east), float(north), height)


def utm_epsg(lon: float, lat: float) -> int:
    """EPSG of the WGS 84 / UTM zone of a point [deg]; the exceptions of Norway and Svalbard are not made."""
    zone = int(np.clip((lon + 180.0) // 6.0 + 1, 1, 60))
    return (32600 if lat >= 0.0 else 32700) + zone


def transform(points: ArrayLike, source: Any, target: Any) -> Array:
    """Points, shape (n, 2) as (x or lon, y or lat), from one system to another; inf where there is no image.

    Raises InputError when a system is unknown.
    """
    pyproj = _pyproj()
    try:
        transformer = pyproj.Transformer.from_crs(source, target, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise InputError("crs", str(source), "expected a known coordinate system, like EPSG:32612") from error
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    x, y = transformer.transform(points[:, 0], points[:, 1])
    return np.stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)], axis=1)


def ellipsoid() -> Any:
    """The ellipsoid of WGS 84, with `fwd` and `inv` of its geodesics (pyproj.Geod)."""
    return _pyproj().Geod(ellps="WGS84")


def known_crs(text: str) -> Any:
    """A coordinate system from EPSG:code, WKT or PROJ text. Raises InputError when it is none."""
    pyproj = _pyproj()
    try:
        return pyproj.CRS.from_user_input(text)
    except pyproj.exceptions.ProjError as error:
        raise InputError("crs", text, "expected a known coordinate system, like EPSG:32612") from error


def _pyproj() -> Any:
    with Extra("geo", "a map projection"):
        import pyproj
        import pyproj.exceptions
    return pyproj
