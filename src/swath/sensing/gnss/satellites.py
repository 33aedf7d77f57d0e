"""Where the satellites stand over a place on Earth, and how well their directions fix it.

Two Walker constellations on circles: GPS 24/6/1 at 55 deg, radius 26,560 km (IS-GPS-200), Galileo 24/3/1 at
56 deg, radius 29,600 km (Galileo OS SIS ICD). Real orbits are off from these by some degrees: their number,
their spread over the sky and how it turns are right, the single satellite is nobody's.
"""

from math import cos, hypot, pi, sin, sqrt

import numpy as np

from swath.core import portable
from swath.signals import F64

GRAVITY = 3.986004418e14  # of the Earth [m3/s2]
TURN = 7.2921151467e-5  # of the Earth [rad/s]
RADIUS = 6.371e6  # of the Earth [m]
# satellites, planes, phasing, inclination [rad], radius [m], node of the first plane [rad]
WALKERS = ((24, 6, 1, 55.0 * pi / 180.0, 26.56e6, 0.0), (24, 3, 1, 56.0 * pi / 180.0, 29.6e6, 0.6))


def directions(latitude: float, longitude: float, seconds: float) -> F64:
    """Unit vectors east, north, up (n, 3) to all satellites; those below the horizon have up < 0.

    latitude, longitude [rad]; seconds: of the day
    """
    places = np.concatenate([_orbit(*walker, seconds) for walker in WALKERS])
    angle = TURN * seconds
    c, s = cos(angle), sin(angle)
    x, y = c * places[:, 0] + s * places[:, 1], c * places[:, 1] - s * places[:, 0]
    sb, cb, sl, cl = sin(latitude), cos(latitude), sin(longitude), cos(longitude)
    here = RADIUS * np.array([cb * cl, cb * sl, sb])
    dx, dy, dz = x - here[0], y - here[1], places[:, 2] - here[2]
    east, north = -sl * dx + cl * dy, -sb * cl * dx - sb * sl * dy + cb * dz
    up = cb * cl * dx + cb * sl * dy + sb * dz
    away = np.stack([east, north, up], axis=-1)
    return np.asarray(away / np.linalg.norm(away, axis=1)[:, None])


def _orbit(
    count: int, planes: int, phasing: int, inclination: float, radius: float, node: float, seconds: float
) -> F64:
    """Positions in the frame that does not turn (count, 3) [m]."""
    per_plane = count // planes
    plane, slot = np.divmod(np.arange(count), per_plane)
    rate = sqrt(GRAVITY / radius**3)
    along = 2.0 * pi * (slot / per_plane + plane * phasing / count) + rate * seconds
    ascending = node + 2.0 * pi * plane / planes
    c, s, cn, sn = np.cos(along), np.sin(along), np.cos(ascending), np.sin(ascending)
    x = c * cn - s * cos(inclination) * sn
    y = c * sn + s * cos(inclination) * cn
    return radius * np.stack([x, y, s * sin(inclination)], axis=-1)


def dilution(seen: F64) -> tuple[float, float]:
    """Horizontal and vertical dilution of precision of unit vectors (n, 3); inf where they give no place."""
    if len(seen) < 4:
        return float("inf"), float("inf")
    rows = np.concatenate([-seen, np.ones((len(seen), 1))], axis=1)
    normal = portable.product(rows.T, rows)
    try:
        spread = np.diag(portable.inverse(normal))
    except ZeroDivisionError:
        return float("inf"), float("inf")
    if not np.all(np.isfinite(spread)) or float(spread.min()) < 0.0:
        return float("inf"), float("inf")
    return hypot(sqrt(float(spread[0])), sqrt(float(spread[1]))), sqrt(float(spread[2]))
