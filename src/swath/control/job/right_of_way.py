"""Where a combine will be next, by what it says and by its passes: a cart keeps clear of it."""

from collections.abc import Sequence
from math import ceil, cos, hypot, inf, isfinite, pi, sin
from typing import NamedTuple

from swath.control.job.abreast import own_passes
from swath.control.job.dubins import Place
from swath.control.job.ground import Point, beside
from swath.control.job.passes import Pass, Route, route_of
from swath.control.job.turn_limits import TurnLimits
from swath.control.steer.guidance_line import GuidanceLine, wrapped
from swath.signals import PeerState, Phase
from swath.signals.setup import MachineGeometry

EVERY = 2.0  # m along its way, at which its outline is looked at
SAME_WAY = pi / 3.0  # rad, of its heading from that of its way, where it is looked for in a turn
LIMITS = TurnLimits(7.0, 0.1)  # of turns that the plan does not give
KNIFE = 4.0  # m ahead of the axle, where no message tells it
FORE = 30.0  # m ahead of a combine, that are left to it
SWEPT, NEARER = 0.8, 0.1  # m that a turn has to be clear of a machine, if it is not nearer already: half a
# metre, and what the tyres of a trailer stand out beyond its box
KEEP = 3.0  # m from the middle of a machine to the outline of another one
LOOK, STEP = 8.0, 1.0  # m beyond the braking way; between two looks
SHORT = 6.5  # m kept between the axle and what is in the way: a tractor reaches 4.6 m ahead of its axle
GENTLE = 0.4  # m/s2, of braking
DEEP = 2.0  # m from the front of a header to its back


class Box(NamedTuple):
    """Part of an outline, in the machine's frame [m]; turned: about its middle [rad]"""

    rear: float
    front: float
    right: float
    left: float
    turned: float = 0.0

    def turn(self, ahead: float, left: float, turned: float) -> Point:
        """A point turned about the middle of the box by an angle [rad]; m."""
        x, y = 0.5 * (self.rear + self.front), 0.5 * (self.right + self.left)
        c, s = cos(turned), sin(turned)
        return x + c * (ahead - x) - s * (left - y), y + s * (ahead - x) + c * (left - y)


class Outline(NamedTuple):
    """Of a machine: its parts."""

    boxes: tuple[Box, ...]

    def away(self, at: Place, x: float, y: float) -> float:
        """Distance of a point from the machine at a place [m]; 0 = inside."""
        c, s = cos(at.heading), sin(at.heading)
        ahead, left = c * (x - at.x) + s * (y - at.y), c * (y - at.y) - s * (x - at.x)
        least = inf
        for box in self.boxes:
            to = box.turn(ahead, left, -box.turned) if box.turned else (ahead, left)
            dx = max(box.rear - to[0], 0.0, to[0] - box.front)
            dy = max(box.right - to[1], 0.0, to[1] - box.left)
            least = min(least, hypot(dx, dy))
        return least

    def least(self, places: Sequence[Place], x: float, y: float, most: float) -> float:
        """Least distance of a point from the machine at any of some places, at most `most` [m]."""
        far = most + max(_reach(box) for box in self.boxes)
        found = most
        for at in places:
            if hypot(x - at.x, y - at.y) < far:
                found = min(found, self.away(at, x, y))
        return found

    def points(self, at: Place) -> list[Point]:
        """Points of the outline of the machine at a place, at most EVERY apart [m]."""
        found: list[Point] = []
        for box in self.boxes:
            rear, front, right, left, turned = box
            long, wide = ceil((front - rear) / EVERY), ceil((left - right) / EVERY)
            rim = [(rear + (front - rear) * i / max(long, 1), side)
                   for i in range(long + 1) for side in (right, left)]  # fmt: skip
            rim += [
                (ahead, right + (left - right) * i / wide) for i in range(1, wide) for ahead in (rear, front)
            ]
            rim = [box.turn(*point, turned) for point in rim] if turned else rim
            found += [beside(*at, *point) for point in rim]
        return found


def _reach(box: Box) -> float:
    """Of a box from the machine's origin, at most [m]."""
    x, y = max(-box.rear, box.front), max(-box.right, box.left)
    return hypot(x, y) + (hypot(box.front - box.rear, box.left - box.right) if box.turned else 0.0)


def outline_of(said: PeerState) -> Outline:
    """Chassis, header and box, as a machine tells them."""
    boxes = []
    if isfinite(said.body_width):
        half = 0.5 * said.body_width
        boxes.append(Box(said.body_rear, said.body_front, -half, half))
    if isfinite(said.header_width):
        half, middle = 0.5 * said.header_width, said.header_left
        boxes.append(Box(said.header_front - DEEP, said.header_front, middle - half, middle + half))
    if isfinite(said.box_x):
        long, half = 0.5 * said.box_length, 0.5 * said.box_width
        turned = said.box_heading if isfinite(said.box_heading) else 0.0
        boxes.append(Box(said.box_x - long, said.box_x + long, said.box_y - half, said.box_y + half, turned))
    return Outline(tuple(boxes) or (Box(-1.0, 1.0, -1.0, 1.0),))


def own_outline(of: MachineGeometry) -> Outline:
    """Chassis and header of the own data sheet."""
    return Outline(tuple(Box(*part) for part in of.outline))


def place_of(own: Place, said: PeerState) -> Place:
    """Where another machine is, by its message."""
    x, y = beside(own.x, own.y, own.heading, said.x, said.y)
    return Place(x, y, own.heading + said.heading)


class CombineWays:
    """The ways of combines through their passes, of each made when it is asked for."""

    def __init__(self, passes: Sequence[Pass]) -> None:
        self._passes, self._routes = passes, dict[int, tuple[int, Route]]()

    def places(self, own: Place, said: PeerState, reach: float) -> list[Place]:
        """Where the axle of a combine is, and will be along its way, up to a reach [m]; one that stands
        stays there.
        """
        here = place_of(own, said)
        if said.phase not in (Phase.CUTS, Phase.TURNS) or said.task < 0:
            return [here]
        route = self._route(said)
        way = self._way(route, here, said)
        count = ceil(reach / EVERY)
        ahead = [min(way + EVERY * (i + 1), route.line.length) for i in range(count)]
        return [here, *(Place(*route.line.point(w), route.line.heading(w)) for w in ahead)]

    def _route(self, said: PeerState) -> Route:
        combine = self._passes[said.task].combine
        task, route = self._routes.get(combine, (-1, None))
        if route is None or task != said.task:
            told = (said.header_front, said.header_left) if isfinite(said.header_front) else (KNIFE, 0.0)
            own = own_passes(self._passes, combine)
            passes = [self._passes[i] for i in own]
            route = route_of(passes, own.index(said.task), told[0], LIMITS, told[1])
            self._routes[combine] = said.task, route
        return route

    def _way(self, route: Route, here: Place, said: PeerState) -> float:
        """How far it has come along its way [m]."""
        if isfinite(said.remaining):
            return route.length - said.remaining
        best, found = inf, route.length
        for i in range(ceil(route.turn / EVERY) + 1):
            way = route.length + EVERY * i
            x, y = route.line.point(way)
            away = hypot(x - here.x, y - here.y)
            if away < best and abs(wrapped(route.line.heading(way) - here.heading)) < SAME_WAY:
                best, found = away, way
        return found


def is_swept(
    outline: Outline, way: Sequence[Place], other: Outline, places: Sequence[Place], clear: float = SWEPT
) -> bool:
    """Whether a machine that drives through the places of a way, the first of them its own, comes nearer to
    another one at one of its places than it is now, and nearer than `clear` [m].
    """
    points = [point for place in places for point in other.points(place)]
    now = min(outline.least(way[:1], x, y, clear + NEARER) for x, y in points)
    return any(outline.least(way, x, y, clear) < min(clear, now - NEARER) for x, y in points)


def free_way(
    here: Place,
    line: GuidanceLine,
    at: float,
    until: float,
    reach: float,
    outline: Outline,
    places: Sequence[Place],
) -> float:
    """Way [m] from `at` along a line, as far as `until` and a reach, before it comes near a machine that is
    at one of some places; inf where it does not.
    """
    now = outline.least(places, here.x, here.y, KEEP)
    for i in range(ceil(reach / STEP)):
        way = STEP * (i + 1)
        if at + way > until:
            break
        if outline.least(places, *line.point(at + way), KEEP) < now:
            return max(way - SHORT, 0.0)
    return inf


def reach_at(speed: float) -> float:
    """How far ahead a cart has to look at a speed [m/s]; m."""
    return LOOK + speed * speed / (2.0 * GENTLE)


class Clearance:
    """How far a cart can drive on its way before it comes near a combine, or into the next of the way of one
    that drives. passes: of the combine
    """

    def __init__(self, passes: Sequence[Pass]) -> None:
        self._ways = CombineWays(passes)

    def way(
        self, here: Place, line: GuidanceLine, at: float, until: float, said: PeerState, speed: float
    ) -> float:
        """Free way [m] from `at` along a line, as far as `until`, at a speed [m/s]; inf where all is free.

        A machine that it is near to already does not keep it from driving on, unless it comes nearer.
        """
        reach = reach_at(speed)
        if hypot(said.x, said.y) > reach + FORE + 20.0:
            return inf
        return free_way(here, line, at, until, reach, outline_of(said), self._ways.places(here, said, FORE))

    def is_in_way(self, here: Place, said: PeerState) -> bool:
        """Whether it is near to the combine, or in its way."""
        places = self._ways.places(here, said, FORE)
        return outline_of(said).least(places, here.x, here.y, KEEP) < KEEP
