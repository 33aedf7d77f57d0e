"""Ground that the knives of driven combines went over: what of it twice, and what is left.

The strip of a pass is the union of the quadrilaterals between its knife at one place and at the next, of
their convex hulls where the inner end moves backwards in a bend. In a strip ground counts once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.job.plan import shapely_here

Array = NDArray[np.float64]
Track = Sequence[
    tuple[float, float, float]
]  # of the middle of a knife while it cuts: x, y [m], heading [rad]
STRAIGHT = 0.005  # m, that a knife between two places that count may be beside their line
TURNED = 0.002  # rad, likewise: 1 cm at the end of a header of 10 m
SPECK = 0.01  # m2, below which ground that is left does not count


@dataclass(frozen=True)
class SweptGround:
    """once: ground in the field that a knife went over; twice: that another pass went over again, as often as
    that was; left: that none went over, [m2]; pieces: of that, rings (n, 2) [m], the largest first

    widest: diameter of the largest circle in a piece that is left [m]
    """

    once: float
    twice: float
    left: float
    widest: float
    pieces: tuple[Array, ...]


def swept_ground(
    tracks: Sequence[Track], width: float, boundary: Array, holes: tuple[Array, ...] = ()
) -> SweptGround:
    """Of the tracks of all passes in a field. width: of the header [m]. MissingExtra without shapely."""
    shapely = shapely_here()
    field = shapely.Polygon(boundary, holes)
    strips = [s.intersection(field) for t in tracks if (s := strip_of(t, width)) is not None]
    whole = shapely.union_all(strips) if strips else shapely.Polygon()
    left = field.difference(whole)
    pieces = [p for p in getattr(left, "geoms", [left]) if p.geom_type == "Polygon" and p.area > SPECK]
    pieces.sort(key=lambda p: (-p.area, p.bounds))
    twice = math.fsum(s.area for s in strips) - whole.area
    widest = max((2.0 * shapely.maximum_inscribed_circle(p).length for p in pieces), default=0.0)
    rings = tuple(np.asarray(p.exterior.coords) for p in pieces)
    return SweptGround(float(whole.area), max(float(twice), 0.0), float(left.area), float(widest), rings)


def strip_of(track: Track, width: float) -> Any:
    """Polygon that a knife of a width [m] goes over; None where it did not move."""
    shapely = shapely_here()
    if len(track) < 2:
        return None
    rows = _bends(np.asarray(track, dtype=float))
    half = 0.5 * width * np.column_stack([-np.sin(rows[:, 2]), np.cos(rows[:, 2])])
    left, right = rows[:, :2] + half, rows[:, :2] - half
    corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
    parts = shapely.convex_hull(shapely.multipoints(corners))
    made = shapely.union_all(parts[shapely.area(parts) > 0.0])
    return None if made.is_empty else made


def track_along(line: Array) -> Track:
    """Of a knife whose middle goes along a line (n, 2) [m]."""
    return [
        (x, y, math.atan2(v - b, u - a))
        for (a, b), (u, v) in pairwise(line.tolist())
        for x, y in ((a, b), (u, v))
    ]


def _bends(track: Array) -> Array:
    """Rows of a track without those between which the knife goes straight on."""
    kept, begin = [0], 0
    for k in range(2, len(track)):
        a, b = track[begin], track[k]
        inner = track[begin + 1 : k]
        way = b[:2] - a[:2]
        size = math.hypot(*way.tolist())
        away = inner[:, :2] - a[:2]
        across = np.abs(away[:, 0] * way[1] - away[:, 1] * way[0]) / max(size, 1e-9)
        share = (away * way).sum(axis=1) / max(size * size, 1e-9)
        turned = np.abs(inner[:, 2] - a[2] - share * (b[2] - a[2]))
        if float(across.max()) > STRAIGHT or float(turned.max()) > TURNED:
            kept.append(k - 1)
            begin = k - 1
    return track[[*kept, len(track) - 1]]
