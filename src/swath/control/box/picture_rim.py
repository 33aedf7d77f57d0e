"""The rim of an open box in a picture: a rectangle of known size through edges that lie as it does.

Each edge is thrown onto a level plane at the height of the rim. There walls are four straight lines: heading
and place are searched for among edges of the right direction (both lines of a pair at the known distance),
then place, heading and height are fitted by iterated least squares with Tukey's biweight. Height shows in the
size: a plane too high makes the box too small.
"""

from dataclasses import dataclass
from math import cos, fsum, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from swath.control.box.picture_edges import Edges
from swath.control.box.rim_fit import WALL, Rim, values_apart
from swath.control.box.view import View
from swath.core import portable
from swath.signals import F64

TURNS = [k * np.pi / 180.0 for k in range(-30, 31)]  # headings that are tried [rad]
ALIKE = 6.0 * np.pi / 180.0  # an edge of a wall lies as the wall within this [rad]
CUTS = (0.3, 0.25, 0.2, 0.15, 0.12, 0.1, 0.08, 0.06, 0.06, 0.05, 0.05, 0.05)  # of the biweight [m]
BOTH = 5  # steps of the fit after which both edges of a wall count, inner and outer
FEWEST = 60  # edges that make a rim
STRIP = 0.1  # parts of a wall that are looked at for an edge [m]
ON_WALL = 0.02  # an edge so near to the inner or outer one of a wall is on it [m]
BESIDE = (-0.35, -0.25, 0.25, 0.35)  # lines beside a wall, of which none has as many edges [m]
SEEN = 0.5  # of the parts of a wall that is seen have an edge
OUTDOES = 0.2  # and so many more than on the lines beside it
WHOLE = 0.97  # or nearly all of them
NEIGHBOURS = 5.0  # edges next to each other that err alike
SYSTEMATIC = 0.015  # half of what thickness and rounding of walls leave open [m]
AROUND = 0.6  # beyond the walls, from where on edges do not count [m]
PEAKS, PEAK_WIDTH = 3, 5  # places that a fit begins at, and bins about each
STIFF = 0.1  # spread of the height that was said [m]


Start = tuple[float, float, float]  # place [m] and heading [rad]


@dataclass(frozen=True)
class OnPlane:
    """Edges on a level plane. points: (n, 2) [m]; course: of the edge there [rad]; eye: the camera (3,)"""

    points: F64
    course: F64
    eye: F64


def on_plane(edges: Edges, view: View, height: float, reach: float) -> OnPlane:
    """Edges of a picture on the plane at a height, at most so far from the camera [m]."""
    rays, eye = view.rays(), view.pose.position
    down = np.where(rays[..., 2] < -0.05, rays[..., 2], np.nan)
    way = (height - float(eye[2])) / down
    places = eye[:2] + way[..., None] * rays[..., :2]
    far = np.where(way <= reach, 0.0, np.nan)
    by_row, by_column = (np.asarray(d) for d in np.gradient(places + far[..., None], axis=(0, 1)))
    row, column = edges.row, edges.column
    u, v = -edges.across[:, 1:], edges.across[:, :1]  # along the edge
    along = u * by_column[row, column] + v * by_row[row, column]
    points = places[row, column]
    known = np.isfinite(along).all(axis=1) & np.isfinite(points).all(axis=1)
    course = portable.arctan2(along[known, 1], along[known, 0])
    return OnPlane(points[known], course, eye)


def rim_in(found: OnPlane, length: float, width: float, height: float) -> Rim | None:
    """The rim among edges on the plane of the height that was said [m]; None where it is not seen."""
    if len(found.points) < FEWEST:
        return None
    long, wide = length + WALL, width + WALL
    best: Rim | None = None
    for start in _starts(found, long, wide):
        rim = _fitted(_near(found, start, long, wide), start, long, wide, height)
        if rim is not None and (best is None or _total(rim) > _total(best)):
            best = rim
    return best


def _total(rim: Rim) -> float:
    return rim.wall_count * rim.share


def _near(found: OnPlane, start: Start, long: float, wide: float) -> OnPlane:
    """Edges about a rectangle, those inside of it, too."""
    own = np.abs(_in_box(found.points, *start))
    near = (own[:, 0] < 0.5 * long + AROUND) & (own[:, 1] < 0.5 * wide + AROUND)
    return OnPlane(found.points[near], found.course[near], found.eye)


def _fitted(found: OnPlane, start: Start, long: float, wide: float, height: float) -> Rim | None:
    """The rectangle through the edges, from a start; None where too few lie on it."""
    pose = np.array([*start, 0.0])  # place, heading, height above the plane
    matrix, rms = np.eye(4), 0.0
    for step, cut in enumerate(CUTS):
        across, rows, is_on = _residuals(found, pose, long, wide, height, both=step >= BOTH)
        weight = np.where(is_on & (np.abs(across) < cut), (1.0 - (across / cut) ** 2) ** 2, 0.0)
        if float(weight.sum()) < FEWEST:
            return None
        said = np.zeros((4, 4))
        said[3, 3] = (0.02 / STIFF) ** 2 * NEIGHBOURS
        matrix = portable.product(rows.T * weight, rows) + said + 1e-9 * np.eye(4)
        right = portable.product(rows.T, weight * across) - said[:, 3] * pose[3]
        pose = pose + portable.solve(matrix, right)
        rms = sqrt(float((weight * across**2).sum() / weight.sum()))
    return _judged(found, pose, (long, wide), height, portable.inverse(matrix), rms)


def _starts(found: OnPlane, long: float, wide: float) -> list[Start]:
    """Places and headings at which many edges lie on pairs of lines so far apart."""
    none: tuple[float, ...] = (0.0,)
    best, tried = -1.0, (0.0, none, none)
    for turn in TURNS:
        at_side = np.abs(np.sin(found.course - turn)) < sin(ALIKE)
        at_end = np.abs(np.cos(found.course - turn)) < sin(ALIKE)
        if min(np.count_nonzero(at_side), np.count_nonzero(at_end)) < 2:
            continue
        turned = _in_box(found.points, 0.0, 0.0, turn)
        along, much = _pairs(turned[at_end, 0], long)
        aside, more = _pairs(turned[at_side, 1], wide)
        if much + more > best:
            best, tried = much + more, (turn, along, aside)
    turn, along, aside = tried
    c, s = cos(turn), sin(turn)
    return [(c * x - s * y, s * x + c * y, turn) for y in aside for x in along[:2]]


def _pairs(values: F64, apart: float) -> tuple[tuple[float, ...], float]:
    """Middles of places so far apart with most values, the best first, and the sum of the roots of the
    numbers at the best.
    """
    both, places = values_apart(values, apart)
    most, middles = float(both.max()), []
    for _ in range(PEAKS):
        k = int(np.argmax(both))
        middles.append(float(places[k]))
        both[max(k - PEAK_WIDTH, 0) : k + PEAK_WIDTH + 1] = 0.0
    return tuple(middles), most


def _residuals(
    found: OnPlane, pose: F64, long: float, wide: float, height: float, *, both: bool
) -> tuple[F64, F64, NDArray[np.bool_]]:
    """Distance of each edge from the nearest line, how that falls with the pose, and whether it may be on it.

    both: inner and outer edge of the walls are lines of their own
    """
    x, y, heading, above = pose.tolist()
    lift = above / (float(found.eye[2]) - height)
    points = found.points + lift * (found.eye[:2] - found.points)
    own = _in_box(points, x, y, heading)
    c, s = cos(heading), sin(heading)
    end, side = np.abs(own[:, 0]) - 0.5 * long, np.abs(own[:, 1]) - 0.5 * wide
    from_end, from_side = np.abs(np.cos(found.course - heading)), np.abs(np.sin(found.course - heading))
    at_end = from_end < from_side
    is_on = (np.minimum(from_end, from_side) < sin(ALIKE)) & (np.where(at_end, side, end) < 0.1)
    sign = np.where(at_end, np.sign(own[:, 0]), np.sign(own[:, 1]))
    across = np.where(at_end, end, side)
    if both:
        across = across - 0.5 * WALL * np.sign(across)
    normal = np.stack([np.where(at_end, c, -s), np.where(at_end, s, c)], axis=1)
    rise = (normal * (found.eye[:2] - found.points)).sum(axis=1) / (float(found.eye[2]) - height)
    turn = np.where(at_end, -own[:, 1], own[:, 0])
    rows = np.stack([normal[:, 0], normal[:, 1], turn, -rise], axis=1)
    return sign * across, rows, is_on


def _in_box(points: F64, x: float, y: float, heading: float) -> F64:
    """Points (n, 2) in the frame of a box: along it, to its left [m]."""
    c, s = cos(heading), sin(heading)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.stack([c * dx + s * dy, c * dy - s * dx], axis=1)


def _judged(
    found: OnPlane, pose: F64, size: tuple[float, float], height: float, spread: F64, rms: float
) -> Rim | None:
    """The fitted rim with its deviations; None where too few walls are seen."""
    x, y, heading, above = pose.tolist()
    lift = above / (float(found.eye[2]) - height)
    own = _in_box(found.points + lift * (found.eye[:2] - found.points), x, y, heading)
    course = found.course - heading
    walls = []
    for axis in (0, 1):
        alike = np.abs(np.cos(course) if axis == 0 else np.sin(course)) < sin(ALIKE)
        half, long = 0.5 * size[axis], size[1 - axis]
        for sign in (-1.0, 1.0):
            away, place = sign * own[alike, axis] - half, own[alike, 1 - axis]
            share = _covered(np.abs(np.abs(away) - 0.5 * WALL) < ON_WALL, place, long)
            rest = max(_covered(np.abs(np.abs(away - b) - 0.5 * WALL) < ON_WALL, place, long) for b in BESIDE)
            if share >= SEEN and share >= min(rest + OUTDOES, WHOLE):
                walls.append(share)
    count = len(walls)
    if count < 3:
        return None
    noise = max(rms, 0.5 * SYSTEMATIC) * sqrt(NEIGHBOURS)
    sd = [noise * sqrt(float(spread[k, k])) for k in range(4)]
    place_sd = [hypot(value, SYSTEMATIC) for value in sd[:2]]
    heading_sd = hypot(sd[2], SYSTEMATIC / (0.5 * size[0]))
    share = fsum(walls) / count
    return Rim(
        x,
        y,
        heading,
        height + above,
        (place_sd[0], place_sd[1], heading_sd),
        hypot(sd[3], 0.02),
        count,
        share,
    )


def _covered(is_on: NDArray[np.bool_], place: F64, long: float) -> float:
    """Share of the parts of a wall that have an edge on it."""
    count = max(1, round(long / STRIP))
    part = ((place[is_on] / long + 0.5) * count).astype(np.int64)
    return len(np.unique(part[(part >= 0) & (part < count)])) / count
