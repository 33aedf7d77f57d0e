"""The ways of a cart on ground that is cut: to the line beside a pass, and to the truck."""

from collections.abc import Sequence
from math import atan2, cos, hypot, isfinite, pi, sin
from typing import NamedTuple

import numpy as np

from swath.control.job.clothoid import bends_of
from swath.control.job.dubins import Place
from swath.control.job.ground import Ground, Point, beside
from swath.control.job.passes import Pass, way_along
from swath.control.job.right_of_way import place_of
from swath.control.job.ways import Search, moved
from swath.control.steer.guidance_line import along_bends
from swath.signals import F64, PeerState, Phase

HALF, NARROW = 2.0, 1.2  # m, of the machine to either side, and of that about start and goal
HEADER = 4.0  # m, of a combine's knife ahead of its axle
COME_UP = 25.0  # m behind the combine, where it comes onto the line beside the pass
STRAIGHT = 14.0  # m before that on the same line: the trailer is straight behind
BEGIN = -4.0  # m from the begin of a pass, where the line beside it begins
BEYOND = 30.0  # m behind the end of a pass, where that line ends
PULL_AHEAD = 10.0  # m straight on before it turns away from a combine beside it
NEAR = 18.0  # m from a combine, where it does so
MOVES = 0.3  # m/s, faster than which a combine will be elsewhere


class Way(NamedTuple):
    """points: (n, 2) [m]; beside: length of its last piece, the line beside a pass [m], 0 = none"""

    points: F64
    beside: float


class CartWays:
    """passes, boundary: of the field; header: width of the combines' [m]; left: of a pass, where the cart
    drives [m]; radius: of its tightest turn [m]
    """

    def __init__(
        self, passes: Sequence[Pass], boundary: Sequence[Point], header: float, left: float, radius: float
    ) -> None:
        self._passes, self._boundary = passes, boundary
        self._header, self._left, self._radius = header, left, radius

    def to_place(self, here: Place, place: Point, combine: PeerState) -> Way | None:
        """To a place, in any direction."""
        goals = [Place(*place, 2.0 * pi * i / 12) for i in range(12)]
        ahead = PULL_AHEAD if hypot(combine.x, combine.y) < NEAR else 0.0
        return self._found(here, combine, goals, [], ahead)

    def to_pass(self, here: Place, task: int, combine: PeerState) -> Way | None:
        """Onto the line beside a pass behind the combine, and along it."""
        (ax, ay), (bx, by) = line = self._beside(self._passes[task])
        length = way_along(line)
        course = atan2(by - ay, bx - ax)
        ux, uy = cos(course), sin(course)
        at = place_of(here, combine)
        come = (at.x - ax) * ux + (at.y - ay) * uy
        begin = min(max(come - COME_UP - STRAIGHT, BEGIN - STRAIGHT), length)
        if task > combine.task:
            begin = BEGIN - STRAIGHT
        goal = Place(ax + ux * begin, ay + uy * begin, course)
        beyond = bx + BEYOND * ux, by + BEYOND * uy
        return self._found(here, combine, [goal], [beyond], 0.0)

    def _found(
        self,
        here: Place,
        combine: PeerState,
        goals: list[Place],
        rest: list[Point],
        ahead: float,
    ) -> Way | None:
        """Straight on, to the goal, and through the rest; None where there is none now."""
        ground = self._ground(combine)
        discs = self._discs(here, combine)
        search = Search(ground, ground.clear_of(HALF, discs), ground.clear_of(NARROW, discs), self._radius)
        straight = moved(here, "S", ahead, self._radius)
        way = search.way(straight, goals)
        if way is None:
            return None
        first = [here[:2]] if ahead > 0.0 else []
        points = np.array([*first, *along_bends(*straight, bends_of(way, self._radius)), *rest])
        last = hypot(rest[0][0] - goals[0].x, rest[0][1] - goals[0].y) if rest else 0.0
        return Way(points, last)

    def _discs(self, here: Place, combine: PeerState) -> list[tuple[float, float, float]]:
        """What a combine that stands takes up; one that moves is waited for."""
        if combine.speed > MOVES:
            return []
        at, half = place_of(here, combine), 0.5 * self._header
        discs = [(*beside(*at, ahead, 0.0), 1.7) for ahead in (-5.0, -3.0, -1.0, 1.0)]
        return discs + [(*beside(*at, HEADER, half * (i / 4.0 - 1.0)), 0.3) for i in range(9)]

    def _ground(self, combine: PeerState) -> Ground:
        """Crop as it stands now, by the passes that are done and the way in the present one."""
        ground = Ground(self._boundary)
        for i, done in enumerate(self._passes[: combine.task + 1]):
            size = None
            if i == combine.task and isfinite(combine.remaining):
                size = max(way_along(done.line_m) - combine.remaining - 4.0, 0.0)
            if i < combine.task or size is not None or combine.phase != Phase.CUTS:
                ground.cut(done.line_m, self._header, size)
        return ground

    def _beside(self, of: Pass) -> list[Point]:
        """A pass's line, to its left at begin and end [m]."""
        (ax, ay), (bx, by) = of.line_m[0], of.line_m[-1]
        course = atan2(by - ay, bx - ax)
        return [beside(x, y, course, 0.0, self._left) for x, y in ((ax, ay), (bx, by))]
