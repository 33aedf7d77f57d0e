"""How grain lies in a box whose rim is known, from the points of a scan."""

from dataclasses import dataclass
from math import hypot

import numpy as np

from swath.core import portable
from swath.signals import F64

MIDDLE = 0.15  # to both sides of the middle line, where the profile is taken [m]
NEAREST = 0.03  # to a wall, where grain is looked for [m]
STRIP = 0.22  # and from the nearest grain that is seen so far on [m]
WEAK = 0.005  # of points that show no slope, in the squares of their distances [m2]
HIDDEN = 0.45  # a wall hides grain so far behind it at most, or it lies low [m]
STEEPEST = 0.58  # tangent of 30 deg, above all angles of repose
FEWEST = 6  # points that make a place of the profile
SLOPE = 0.35  # of grain about the middle line, as a standard deviation, to either side and along
EXACT = 0.015  # least scatter of points about such planes [m]
FITS = 3  # of them, each without what lies astray
LIES = 0.02  # how far grain lies from them, as a standard deviation [m]
MOST_SD = 0.05  # of a height that is reported: two of them are 0.10 m
SCATTER = 0.12  # of heights at one place, as a standard deviation; more is dust [m]
ABOVE, BELOW = 1.5, 2.5  # the rim: beyond there is no grain [m]


@dataclass(frozen=True)
class Fill:
    """Places along a box, rear to front, (station,) [m], nan where nothing was seen.

    height: of the grain along the middle line above the rim, < 0 below it
    sd: of that
    freeboard: rim above the grain beside the walls, the least of both
    lean: left wall above right one, 0 where one of them is not seen
    """

    height: F64
    sd: F64
    freeboard: F64
    lean: float


@dataclass(frozen=True)
class BoxLook:
    """A box, and how the sensor that looks into it measures heights.

    length, width: inside
    rim: height of its rim
    rim_sd: standard deviation of that [m]
    steepest: tangent of the slope at which grain may fall towards a wall
    alike: number of points that err alike
    """

    length: float
    width: float
    rim: float
    rim_sd: float
    steepest: float = STEEPEST
    alike: float = 1.0


def fill_of(points: F64, look: BoxLook, count: int) -> Fill:
    """Grain among points (n, 3) of the box's frame [m], at so many places.

    A strip beside a wall that is not seen is hidden by that wall: grain lies low there.
    """
    length, width, rim, rim_sd = look.length, look.width, look.rim, look.rim_sd
    inside = np.abs(points[:, 0]) < 0.5 * length - NEAREST
    inside &= np.abs(points[:, 1]) < 0.5 * width - NEAREST
    inside &= (points[:, 2] < rim + ABOVE) & (points[:, 2] > rim - BELOW)
    points = points[inside]
    place = np.minimum(((points[:, 0] / length + 0.5) * count).astype(np.int64), count - 1)
    middle = np.abs(points[:, 1]) < MIDDLE
    height, sd, sides = np.full(count, np.nan), np.full(count, np.nan), np.full((2, count), np.nan)
    for k in range(count):
        own = place == k
        from_middle = points[:, 0] - ((k + 0.5) / count - 0.5) * length
        on_line = own & middle
        found = _at_middle(from_middle[on_line], points[on_line, 1], points[on_line, 2], look.alike)
        if found is not None and hypot(rim_sd, LIES, found[1]) <= MOST_SD:
            height[k], sd[k] = found[0] - rim, hypot(rim_sd, LIES, found[1])
        along = from_middle[own]
        for side, sign in enumerate((1.0, -1.0)):
            away = 0.5 * width - sign * points[own, 1]
            sides[side, k] = at_wall(away, along, points[own, 2], length / count, look.steepest) - rim
    there = np.isfinite(sides)
    highest = np.where(there.any(axis=0), np.where(there, sides, -np.inf).max(axis=0), np.nan)
    for k, sign in ((0, -1.0), (count - 1, 1.0)):
        away = 0.5 * length - sign * points[:, 0]
        at_end = _at_end(away, points, width, length / count, look.steepest)
        highest[k] = float(np.fmax(highest[k], at_end - rim))
    both = there.all(axis=0)
    lean = float((sides[0, both] - sides[1, both]).mean()) if bool(both.any()) else 0.0
    return Fill(height, sd, -highest, lean)


def _at_middle(along: F64, aside: F64, heights: F64, alike: float) -> tuple[float, float] | None:
    """Height at the middle of a place on the middle line, and its standard deviation [m]; None as of
    `_height`.

    Two planes that meet on the middle line, by least squares through what is seen of the place: so far along
    it and aside [m]. Grain lies about level, to slopes of SLOPE as a standard deviation: where only a part is
    seen, or one side of a ridge, that says how uncertain the middle is. alike: points that err alike
    """
    keeps, scatter = np.isfinite(heights), EXACT
    rows = np.column_stack([np.ones(len(heights)), along, aside, np.abs(aside)])
    level = np.diag([1e-9, *(SLOPE**-2,) * 3])
    for _ in range(FITS):
        if np.count_nonzero(keeps) < FEWEST:
            return None
        own, weight = rows[keeps], 1.0 / (alike * scatter**2)
        middle = float(heights[keeps].mean())
        matrix = weight * portable.product(own.T, own) + level
        found = portable.solve(matrix, weight * portable.product(own.T, heights[keeps] - middle))
        residual = heights - middle - portable.product(rows, found)
        seen = _height(residual[keeps])
        if seen is None:
            return None
        scatter = max(seen[1], EXACT)
        keeps = np.abs(residual) <= 3.0 * scatter
    sd = float(portable.solve(matrix, np.eye(4)[0])[0]) ** 0.5
    return middle + float(found[0]), sd


def _at_end(away: F64, points: F64, width: float, part: float, steepest: float) -> float:
    """Height of the grain at the wall of an end where it stands highest [m]; nan where it is not seen.

    Taken in parts of the width [m]: a heap before the end touches that wall in its middle, not all along it.
    """
    count = max(1, round(width / part))
    place = np.minimum(((points[:, 1] / width + 0.5) * count).astype(np.int64), count - 1)
    highest = float("nan")
    for k in range(count):
        own = place == k
        along = points[own, 1] - ((k + 0.5) / count - 0.5) * width
        highest = float(np.fmax(highest, at_wall(away[own], along, points[own, 2], width / count, steepest)))
    return highest


def at_wall(away: F64, along: F64, heights: F64, part: float, steepest: float = STEEPEST) -> float:
    """Height of the grain at a part of a wall where it stands highest [m]; nan where it is not seen.

    A plane, by least squares, through the points beside the wall: so far away from it, and along it from the
    middle of the part [m]; where the wall hides what is beside it through the nearest that is seen. Towards
    the wall it rises nowhere, and falls no steeper than grain lies. Two standard deviations come on top.
    part: length of the part [m]; steepest: tangent
    """
    near = away < HIDDEN
    if np.count_nonzero(near) < FEWEST:
        return float("nan")
    near = away < float(np.partition(away[near], FEWEST - 1)[FEWEST - 1]) + STRIP
    away, along, heights = away[near], along[near], heights[near]
    keeps = np.abs(heights - np.median(heights)) < STRIP
    for _ in range(2):
        x, y, z = away[keeps], along[keeps], heights[keeps]
        if len(z) < FEWEST:
            return float("nan")
        slope, tilt = _plane(x - x.mean(), y - y.mean(), z - z.mean())
        slope, tilt = min(max(slope, 0.0), steepest), min(max(tilt, -STEEPEST), STEEPEST)
        heights_at_wall = heights - slope * away - tilt * along
        wall = _height(heights_at_wall[keeps])
        if wall is None:
            return float("nan")
        level, scatter = wall
        keeps &= np.abs(heights_at_wall - level) <= max(3.0 * scatter, 0.03)
    return float(level + 0.5 * abs(tilt) * part + 2.0 * scatter / float(len(z)) ** 0.5)


def _plane(x: F64, y: F64, z: F64) -> tuple[float, float]:
    """Slopes of the plane through points about their middle."""
    xx, yy, xy = float((x * x).sum()) + WEAK, float((y * y).sum()) + WEAK, float((x * y).sum())
    xz, yz = float((x * z).sum()), float((y * z).sum())
    whole = xx * yy - xy * xy
    return (xz * yy - yz * xy) / whole, (yz * xx - xz * xy) / whole


def _height(heights: F64) -> tuple[float, float] | None:
    """Median and scatter of the heights at one place [m]; None where there are too few, or dust."""
    if len(heights) < FEWEST:
        return None
    middle = float(np.median(heights))
    scatter = float(np.median(np.abs(heights - middle))) * 1.4826
    return (middle, scatter) if scatter <= SCATTER else None
