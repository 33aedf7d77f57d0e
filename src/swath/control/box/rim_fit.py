"""The rim of an open box in a laser scan: a rectangle of known size through edges that hide what is behind.

A beam that meets the top of a wall while its neighbour goes on past it marks the rim. Such points lie on four
straight lines. Their direction and place are searched for on histograms (both walls of a pair at the known
distance), then fitted by iterated least squares with Tukey's biweight (Beaton and Tukey 1974, Technometrics
16:147), so that points of other things do not move the rectangle.
"""

from dataclasses import dataclass
from math import cos, fsum, hypot, sin, sqrt

import numpy as np

from swath.core import portable
from swath.signals import F64, Scan

JUMP = 0.35  # between neighbouring beams, farther from the scanner: the nearer one is at an edge [m]
WALL = 0.05  # thickness of the walls [m]
BIN = 0.05  # of the histograms [m]
TURNS = [k * np.pi / 180.0 for k in range(-30, 31, 2)]  # headings that are tried [rad]
CUTS = (0.3, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1, 0.1)  # of the biweight, one for each step of the fit [m]
ON_WALL = 0.1  # a point so near to the fitted line belongs to the wall [m]
FEWEST = 12  # points that make a wall
SPAN = 0.3  # of a wall's length that its points cover at least
ALIKE = 5.0  # neighbouring points that err alike
SYSTEMATIC = 0.015  # half of what thickness and rounding of walls leave open [m]


@dataclass(frozen=True)
class Rim:
    """A rectangle. x, y: of its middle; height: of its rim, in the frame of the points [m]; heading [rad].

    sd: standard deviations of x, y [m] and heading [rad]; height_sd [m]
    wall_count: walls that were seen, 0..4
    share: of the edges near it that lie on it
    """

    x: float
    y: float
    heading: float
    height: float
    sd: tuple[float, float, float]
    height_sd: float
    wall_count: int
    share: float


def grid_of(scan: Scan, points: F64) -> tuple[F64, F64]:
    """The farthest echo of each beam (column, line, 3) in the frame of `points`, its range (column, line).

    points: (beam_count, echo_count, 3); nan, and range inf, without an echo. One line where the scanner's
    beams are in no such order.
    """
    lines = len(np.unique(scan.elevation))
    if lines > 1 and len(scan.elevation) % lines == 0:
        table = scan.elevation.reshape(-1, lines)
        lines = lines if bool((table == table[0]).all()) else 1
    else:
        lines = 1
    far = np.where(np.isfinite(scan.ranges), scan.ranges, -1.0)
    last = np.argmax(far, axis=1)
    rows = np.arange(len(far))
    away = np.where(far[rows, last] > 0.0, far[rows, last], np.inf).astype(np.float64)
    return points[rows, last].reshape(-1, lines, 3), away.reshape(-1, lines)


def edges_of(points: F64, away: F64) -> F64:
    """Points (n, 3) whose neighbour in the grid lies far behind, or has no echo; of what `grid_of` gives."""
    hides = np.zeros(away.shape, dtype=bool)
    hides[1:] |= away[:-1] > away[1:] + JUMP
    hides[:-1] |= away[1:] > away[:-1] + JUMP
    hides[:, 1:] |= away[:, :-1] > away[:, 1:] + JUMP
    hides[:, :-1] |= away[:, 1:] > away[:, :-1] + JUMP
    return np.asarray(points[hides & np.isfinite(away)])


def fit_rim(points: F64, length: float, width: float) -> Rim | None:
    """The rim through edge points (n, 3), inside length and width [m]; None where it is not seen.

    Points are those near the height of the rim. At least three walls have to be there.
    """
    if len(points) < 3 * FEWEST:
        return None
    long, wide = length + WALL, width + WALL
    x, y, heading = _begin(points, long, wide)
    matrix = np.eye(3)
    rms = 0.0
    for cut in CUTS:
        across, rows = _residuals(points, x, y, heading, long, wide)
        weight = np.where(np.abs(across) < cut, (1.0 - (across / cut) ** 2) ** 2, 0.0)
        if float(weight.sum()) < 2 * FEWEST:
            return None
        matrix = portable.product(rows.T * weight, rows) + 1e-9 * np.eye(3)
        step = portable.solve(matrix, portable.product(rows.T, weight * across))
        x, y, heading = x + float(step[0]), y + float(step[1]), heading + float(step[2])
        rms = sqrt(float((weight * across**2).sum() / weight.sum()))
    return _judged(points, (x, y, heading), (long, wide), portable.inverse(matrix), rms)


def in_box(points: F64, x: float, y: float, heading: float) -> F64:
    """Points (n, 3) in the frame of a box: along it, to its left, height as it is [m]."""
    c, s = cos(heading), sin(heading)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.stack([c * dx + s * dy, c * dy - s * dx, points[:, 2]], axis=1)


def _begin(points: F64, long: float, wide: float) -> tuple[float, float, float]:
    """Place and heading at which most edges lie on pairs of lines so far apart."""
    best, found = -1.0, (0.0, 0.0, 0.0)
    for turn in TURNS:
        turned = in_box(points, 0.0, 0.0, turn)
        along, much = _pair(turned[:, 0], long)
        aside, more = _pair(turned[:, 1], wide)
        if much + more > best:
            c, s = cos(turn), sin(turn)
            best, found = much + more, (c * along - s * aside, s * along + c * aside, turn)
    return found


def _pair(values: F64, apart: float) -> tuple[float, float]:
    """Middle of the two places so far apart with most values, and the sum of the roots of both numbers."""
    both, middles = values_apart(values, apart)
    k = int(np.argmax(both))
    return float(middles[k]), float(both[k])


def values_apart(values: F64, apart: float) -> tuple[F64, F64]:
    """Sums of the roots of the numbers of values at two places so far apart [m], and the middles between
    the places, in steps of BIN.
    """
    low = float(values.min()) - 0.5 * apart - 3 * BIN
    shift = round(apart / BIN)
    count = int((float(values.max()) - low) / BIN) + shift + 4
    number = np.bincount(((values - low) / BIN).astype(np.int64), minlength=count).astype(np.float64)
    near = np.sqrt(number + np.roll(number, 1) + np.roll(number, -1))
    both = near[: len(near) - shift] + near[shift:]
    middles = np.arange(len(both), dtype=np.float64) + 0.5
    return both, low + middles * BIN + 0.5 * shift * BIN


def _residuals(points: F64, x: float, y: float, heading: float, long: float, wide: float) -> tuple[F64, F64]:
    """Distance of each point from the nearest of the four lines, and how it falls with x, y, heading."""
    own = in_box(points, x, y, heading)
    c, s = cos(heading), sin(heading)
    end, side = np.abs(own[:, 0]) - 0.5 * long, np.abs(own[:, 1]) - 0.5 * wide
    beyond_side = np.maximum(side, 0.0)  # a point on the line of an end but past its corner
    beyond_end = np.maximum(end, 0.0)
    at_end = np.abs(end) + beyond_side < np.abs(side) + beyond_end
    sign = np.where(at_end, np.sign(own[:, 0]), np.sign(own[:, 1]))
    across = sign * np.where(at_end, end, side)
    astray = np.where(at_end, beyond_side, beyond_end) > 0.15
    rows = np.stack(
        [
            np.where(at_end, c, -s),
            np.where(at_end, s, c),
            np.where(at_end, -own[:, 1], own[:, 0]),
        ],
        axis=1,
    )
    return np.where(astray, 9.0, across), rows


def _judged(
    points: F64,
    pose: tuple[float, float, float],
    size: tuple[float, float],
    spread: F64,
    rms: float,
) -> Rim | None:
    """The fitted rim with its deviations; None where too few walls are there."""
    own = in_box(points, *pose)
    half = 0.5 * size[0], 0.5 * size[1]
    tops: list[float] = []
    is_on = np.zeros(len(own), dtype=bool)
    ends = sides = 0
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            near = np.abs(sign * own[:, axis] - half[axis]) < ON_WALL
            near &= np.abs(own[:, 1 - axis]) < half[1 - axis] + ON_WALL
            is_on |= near
            place = own[near, 1 - axis]
            if len(place) < FEWEST or float(np.ptp(place)) < SPAN * 2.0 * half[1 - axis]:
                continue
            ends, sides = ends + (axis == 0), sides + (axis == 1)
            tops.append(float(np.percentile(own[near, 2], 80.0)))
    if ends + sides < 3:
        return None
    around = (np.abs(own[:, 0]) < half[0] + 0.6) & (np.abs(own[:, 1]) < half[1] + 0.6)
    share = float(np.count_nonzero(is_on)) / max(float(np.count_nonzero(around | is_on)), 1.0)
    noise = max(rms, SYSTEMATIC) * sqrt(ALIKE)
    sd = [noise * sqrt(float(spread[k, k])) for k in range(3)]
    place_sd = [hypot(value, SYSTEMATIC) for value in sd[:2]]
    heading_sd = hypot(sd[2], SYSTEMATIC / half[0])
    height_sd = hypot(0.02, 0.5 * (max(tops) - min(tops)))
    middle = fsum(tops) / len(tops)
    return Rim(*pose, middle, (place_sd[0], place_sd[1], heading_sd), height_sd, ends + sides, share)
