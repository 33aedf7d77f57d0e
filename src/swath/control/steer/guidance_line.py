"""A path of points to be driven along: where it goes, how it bends, and how far a machine is beside it.

Between the points it is straight; its direction is that of its pieces, linear between their middles, so that
points on a curve give its tangent and its mean curvature. Beyond both ends it goes straight on.
"""

from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, cos, fsum, hypot, inf, pi, sin, tan
from typing import NamedTuple

from swath.core.errors import InputError
from swath.core.frames import wrapped

STEP = 0.25  # between the points of a curve [m]
LEAST = 1e-3  # between two points [m]
SHARP = 0.5  # distance over which a change of curvature counts as sudden [m]


class Beside(NamedTuple):
    """distance: along the line to its nearest point; left: of the line [m]."""

    distance: float
    left: float


class GuidanceLine:
    """points: (n, 2) [m], n >= 2. InputError where fewer differ.

    length [m]
    """

    def __init__(self, points: Sequence[Sequence[float]]) -> None:
        kept: list[tuple[float, float]] = []
        for x, y in points:
            if not kept or hypot(x - kept[-1][0], y - kept[-1][1]) > LEAST:
                kept.append((float(x), float(y)))
        if len(kept) < 2:
            raise InputError("points_m", None, "expected at least two different points")
        self._points, self._at = kept, [0.0]
        headings: list[float] = []
        for (ax, ay), (bx, by) in pairwise(kept):
            self._at.append(self._at[-1] + hypot(bx - ax, by - ay))
            heading = atan2(by - ay, bx - ax)
            headings.append(heading if not headings else headings[-1] + wrapped(heading - headings[-1]))
        self._headings = headings
        self._middles = [0.5 * (a + b) for a, b in pairwise(self._at)]
        self.length = self._at[-1]

    @cached_property
    def sharpest_bend(self) -> float:
        """Largest difference of the curvature over twice a distance of SHARP [1/m]."""
        count = ceil(self.length / SHARP) + 1
        here = [self.curvature(SHARP * i, SHARP) for i in range(count)]
        return max((abs(b - a) for a, b in zip(here, here[2:], strict=False)), default=0.0)

    def heading(self, distance: float) -> float:
        """Direction at a distance along it [rad], without jumps by a full turn."""
        middles, headings = self._middles, self._headings
        i = bisect_right(middles, distance)
        if i == 0 or i == len(middles):
            return headings[0] if i == 0 else headings[-1]
        share = (distance - middles[i - 1]) / (middles[i] - middles[i - 1])
        return headings[i - 1] + share * (headings[i] - headings[i - 1])

    def point(self, distance: float) -> tuple[float, float]:
        """The place at a distance along it [m]; beyond its ends straight on."""
        i = min(max(bisect_right(self._at, distance) - 1, 0), len(self._headings) - 1)
        (ax, ay), (bx, by) = self._points[i], self._points[i + 1]
        share = (distance - self._at[i]) / (self._at[i + 1] - self._at[i])
        return ax + share * (bx - ax), ay + share * (by - ay)

    def curvature(self, distance: float, reach: float) -> float:
        """Mean from `reach` before to `reach` behind a distance along it [1/m]."""
        return (self.heading(distance + reach) - self.heading(distance - reach)) / (2.0 * reach)

    def project(self, x: float, y: float, near: float | None = None, reach: float = 8.0) -> Beside:
        """The nearest point; of those within `reach` of the distance `near`, where that is given [m]."""
        first, last = 0, len(self._headings) - 1
        if near is not None:
            first = min(max(bisect_right(self._at, near - reach) - 1, 0), last)
            last = max(min(bisect_right(self._at, near + reach) - 1, last), first)
        piece, along, left, best = first, 0.0, inf, inf
        points, at, end = self._points, self._at, len(self._headings) - 1
        for i in range(first, last + 1):
            (ax, ay), (bx, by) = points[i], points[i + 1]
            size = at[i + 1] - at[i]
            ux, uy, dx, dy = (bx - ax) / size, (by - ay) / size, x - ax, y - ay
            ahead = ux * dx + uy * dy
            inside = 0.0 if ahead < 0.0 and i > 0 else size if ahead > size and i < end else ahead
            aside = ux * dy - uy * dx
            away = abs(aside) if inside == ahead else hypot(ahead - inside, aside)
            if away < best:
                piece, along, best = i, inside, away
                left = aside if inside == ahead else away if aside >= 0.0 else -away
        return Beside(at[piece] + along, left)


class Bend(NamedTuple):
    """A piece of a path: length [m], curvature at its begin and at its end [1/m], > 0 left; a clothoid
    where they differ.
    """

    length: float
    begin: float
    end: float


def along_bends(x: float, y: float, heading: float, bends: Sequence[Bend]) -> list[tuple[float, float]]:
    """Points every `STEP` along lines, arcs and clothoids from a place [m] and direction [rad].

    Each step's chord by three-point Gauss-Legendre quadrature of its direction.
    """
    points = [(x, y)]
    for bend in bends:
        count = max(ceil(bend.length / STEP), 1)
        h, slope = bend.length / count, (bend.end - bend.begin) / bend.length
        for i in range(count):
            at = [h * (i + 0.5 + share) for share in (-_NODE, 0.0, _NODE)]
            turns = [heading + s * (bend.begin + 0.5 * slope * s) for s in at]
            x += h * fsum(w * cos(a) for w, a in zip(_WEIGHTS, turns, strict=True))
            y += h * fsum(w * sin(a) for w, a in zip(_WEIGHTS, turns, strict=True))
            points.append((x, y))
        heading += 0.5 * bend.length * (bend.begin + bend.end)
    return points


_NODE = 0.5 * 0.6**0.5
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


def rounded(points: Sequence[Sequence[float]], radius: float) -> list[tuple[float, float]]:
    """The points with corners rounded to arcs, of a smaller radius [m] where the lines are short."""
    if radius <= 0.0 or len(points) < 3:
        return [(float(x), float(y)) for x, y in points]
    made = [(float(points[0][0]), float(points[0][1]))]
    for (ax, ay), (bx, by), (cx, cy) in zip(points, points[1:], points[2:], strict=False):
        first, second = hypot(bx - ax, by - ay), hypot(cx - bx, cy - by)
        if min(first, second) <= LEAST:
            continue
        heading = atan2(by - ay, bx - ax)
        turn = wrapped(atan2(cy - by, cx - bx) - heading)
        if abs(turn) < 1e-4 or abs(turn) > pi - 1e-3:
            made.append((float(bx), float(by)))
            continue
        half = tan(0.5 * abs(turn))
        trim = min(radius * half, 0.5 * first, 0.5 * second)
        length = trim / half * abs(turn)
        x, y = bx - trim * cos(heading), by - trim * sin(heading)
        made += along_bends(x, y, heading, [Bend(length, turn / length, turn / length)])
    made.append((float(points[-1][0]), float(points[-1][1])))
    return made
