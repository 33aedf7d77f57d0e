"""Local metres of positions on the ellipsoid.

Those of a field folder (its projected system and origin), or of the plane that touches the ellipsoid at an
origin: east, north, up from Earth-centred coordinates (WGS 84; Misra and Enge, Global Positioning System, 2nd
ed., ch. 4.A).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path

import numpy as np

from swath.core.portable import product
from swath.signals import F64

AXIS = 6_378_137.0  # semi-major axis of WGS 84 [m]
FLATTENING = 1.0 / 298.257223563

ToLocal = Callable[[F64], F64]  # (n, 3) longitude, latitude [deg], height [m] -> (n, 3) east, north, up [m]


@dataclass(frozen=True)
class TangentPlane:
    """East, north and up from a point. lon, lat [deg], height above the ellipsoid [m]."""

    lon: float
    lat: float
    height: float = 0.0

    def __call__(self, points: F64) -> F64:
        """Longitude, latitude [deg] and height [m], (n, 3), as east, north, up [m], (n, 3)."""
        away = _earth_centred(points) - _earth_centred(self._origin)
        return np.asarray(product(away, self._axes.T))

    @property
    def _origin(self) -> F64:
        return np.array([[self.lon, self.lat, self.height]])

    @property
    def _axes(self) -> F64:
        """Rows: east, north, up in Earth-centred axes."""
        sl, cl = sin(radians(self.lon)), cos(radians(self.lon))
        sp, cp = sin(radians(self.lat)), cos(radians(self.lat))
        return np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


def field_plane(folder: Path) -> ToLocal:
    """The local metres of a field folder. InputError where it is none, MissingExtra without pyproj."""
    from swath.field_io.folder import read_origin

    origin = read_origin(folder)
    return lambda p: np.column_stack([origin.to_local(p[:, :2]), p[:, 2] - origin.height])


def _earth_centred(points: F64) -> F64:
    """From Earth's centre [m], (n, 3)."""
    lon, lat = np.radians(points[:, 0]), np.radians(points[:, 1])
    squared = FLATTENING * (2.0 - FLATTENING)
    across = AXIS / np.sqrt(1.0 - squared * np.sin(lat) ** 2)
    flat = (across + points[:, 2]) * np.cos(lat)
    up = (across * (1.0 - squared) + points[:, 2]) * np.sin(lat)
    return np.stack([flat * np.cos(lon), flat * np.sin(lon), up], axis=1)
