"""The passes of a field as a machine is told them, and its way along a pass and the turn behind it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, fsum, hypot, pi, sin
from typing import Annotated

from annotated_types import Ge, Gt, Le, MinLen

from swath.control.steer.guidance_line import Bend, GuidanceLine, along_bends
from swath.control.steer.path import Segment
from swath.control.turns import clothoid
from swath.control.turns.dubins import Place
from swath.control.turns.limits import TurnLimits

Coordinate = Annotated[float, Ge(-1e6), Le(1e6)]
Point = tuple[float, float]
RUN_OUT = 20.0  # straight on behind the last pass [m], unless told otherwise
SHORTEST = 1e-6  # piece of a turn [m]
STRAIGHT = 3.0  # behind a turn, on the line of the next pass before its begin [m]


@dataclass(frozen=True)
class Pass:
    """line_m: middle of the header from begin to end of the crop, [x, y] each; cart_beside: a cart can drive
    on its left and take grain; speed_kmh: in it, at most; combine: number of the one that cuts it, of several
    cart_standing: a cart can drive there, but takes grain only where both stand: outside of the field
    width_m: that is cut in it, on the average: what it brings against other passes

    turn: of the fixed axle, from where it is when the knife is at the end of the pass to where it is when the
    knife is at the begin of the next; none = the shortest of clothoids, arcs and straights at the turn's
    radius and steering rate
    """

    line_m: Annotated[tuple[tuple[Coordinate, Coordinate], ...], MinLen(2)]
    cart_beside: bool = True
    speed_kmh: Annotated[float, Gt(0), Le(40)] = 7.0
    turn: tuple[Segment, ...] = ()
    combine: Annotated[int, Ge(0), Le(3)] = 0
    cart_standing: bool = False
    width_m: Annotated[float, Gt(0), Le(30)] = 1.0

    @property
    def turn_length(self) -> float:
        """Of the turn that is given [m]."""
        return fsum(segment.length_m for segment in self.turn)

    @property
    def has_cart(self) -> bool:
        """Whether a cart can come beside."""
        return self.cart_beside or self.cart_standing


@dataclass(frozen=True)
class Route:
    """The way along a pass, the turn behind it, and the next pass. length, turn: of pass and turn [m]"""

    line: GuidanceLine
    points: tuple[Point, ...]
    length: float
    turn: float


def route_of(
    passes: Sequence[Pass],
    index: int,
    knife: float,
    limits: TurnLimits,
    header_y: float = 0.0,
    run_out: float = RUN_OUT,
) -> Route:
    """The way of the fixed axle, which the knife is ahead of and header_y to the left of [m]; limits: of
    turns that are not given; run_out: straight on behind the last pass [m].
    """
    own = axle_line(passes[index], knife, header_y)
    end = place_at_end(own)
    if index + 1 == len(passes):
        beyond = end.x + run_out * cos(end.heading), end.y + run_out * sin(end.heading)
        return _made(own, [], [own[-1], beyond])
    then = axle_line(passes[index + 1], knife, header_y)
    (ax, ay), (bx, by) = then[:2]
    course = atan2(by - ay, bx - ax)
    begin = Place(ax - STRAIGHT * cos(course), ay - STRAIGHT * sin(course), course)
    bends = [segment.bend for segment in passes[index].turn]
    if not bends:
        planned = [b for b in clothoid.plan(end, begin, limits) if b.length > SHORTEST]
        bends = [*planned, Bend(STRAIGHT, 0.0, 0.0)]
    return _made(own, along_bends(*end, bends), then)


def _made(own: list[Point], turn: list[Point], then: list[Point]) -> Route:
    length = way_along(own)
    joined = [*own, *turn, *then]
    way = way_along([own[-1], *turn, then[0]])
    return Route(GuidanceLine(joined), tuple(joined), length, way)


def axle_line(of: Pass, knife: float, header_y: float = 0.0) -> list[Point]:
    """Where the fixed axle drives while the knife goes along a pass. header_y: of its middle, leftward [m]"""
    line = [(float(x), float(y)) for x, y in of.line_m]
    courses = [atan2(by - ay, bx - ax) for (ax, ay), (bx, by) in pairwise(line)]
    behind = [knife, *[0.0] * (len(line) - 2), knife]
    made = []
    for (x, y), course, back in zip(line, [*courses, courses[-1]], behind, strict=True):
        c, s = cos(course), sin(course)
        made.append((x - back * c + header_y * s, y - back * s - header_y * c))
    return made


def swings_out(work: Pass) -> bool:
    """Whether a machine turns by clearly more than half a circle behind a pass: outside of a corner."""
    turned = fsum(bend.length * 0.5 * (bend.begin + bend.end) for bend in (s.bend for s in work.turn))
    return abs(turned) > 1.1 * pi


def place_at_end(line: Sequence[Point]) -> Place:
    """End and direction of a line."""
    (ax, ay), (bx, by) = line[-2:]
    return Place(bx, by, atan2(by - ay, bx - ax))


def way_along(points: Sequence[Point]) -> float:
    """Length of a line through points [m]."""
    return fsum(hypot(bx - ax, by - ay) for (ax, ay), (bx, by) in pairwise(points))
