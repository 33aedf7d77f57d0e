"""Where a combine will be next, by what it says and by its passes: a cart keeps clear of it."""

from collections.abc import Iterable, Sequence
from math import ceil, cos, hypot, inf, isfinite, pi, sin
from typing import NamedTuple

from swath.control.job.abreast import own_passes
from swath.control.job.ground import Point, beside
from swath.control.job.passes import RUN_OUT, Pass, Route, route_of
from swath.control.steer.guidance_line import GuidanceLine, wrapped
from swath.control.turns.dubins import Place
from swath.control.turns.limits import TurnLimits
from swath.signals import PeerState, Phase
from swath.signals.setup import MachineGeometry

EVERY = 2.0  # m along its way, at which its outline is looked at
ALONG = 0.5  # rad, less than which one beside another machine may be turned
SAME_WAY = pi / 3.0  # rad, of its heading from that of its way, where it is looked for in a turn
LIMITS = TurnLimits(7.0, 0.1)  # of turns that the plan does not give
KNIFE = 4.0  # m ahead of the axle, where no message tells it
FORE = 30.0  # m ahead of a combine, that are left to it
FAR_ON = 120.0  # m ahead of a combine, where a cart that has nothing to do makes room
SWEPT, NEARER = 0.8, 0.1  # m that a turn has to be clear of a machine, if it is not nearer already: half a
# metre, and what the tyres of a trailer stand out beyond its box
CLEARLY = 0.9  # m, likewise, of a cart that stands: more than the combine wants
KEEP = 3.0  # m from the middle of a machine to the outline of another one
KEEP_STRAIGHT = 2.2  # m, likewise, where the cart's way is straight
COMES = 0.3  # m, that one which is nearer than KEEP already may come nearer
LOOK, STEP = 12.0, 1.0  # m beyond the braking way; between two looks
SHORT = 6.5  # m kept between the axle and what is in the way: a tractor reaches 4.6 m ahead of its axle
TURNS_ABOUT = 5.0  # m more before a combine other than its own: from there it can still turn aside
GENTLE = 0.4  # m/s2, of braking
STILL = 0.1  # m/s
ROOM = 25.0  # m before a combine that stands in its turn, where a cart has room to turn about
BEYOND = 30.0  # m farther, from where on it is looked for
WELL = 5.0  # m from a combine's way, where a cart waits whose trailer may stand bent
CLOSE = 40.0  # m, beyond which two machines do not touch
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
    """Chassis, header and, straight behind, the box of the own data sheet."""
    boxes = [Box(*part) for part in of.outline]
    if of.box is not None:
        x = of.box.x + (of.hitch.x - of.hitch.drawbar if of.hitch is not None else 0.0)
        long, half = 0.5 * of.box.length, 0.5 * of.box.width
        boxes.append(Box(x - long, x + long, -half, half))
    return Outline(tuple(boxes))


def place_of(own: Place, said: PeerState) -> Place:
    """Where another machine is, by its message."""
    x, y = beside(own.x, own.y, own.heading, said.x, said.y)
    return Place(x, y, own.heading + said.heading)


class CombineWays:
    """The ways of combines through their passes, of each made when it is asked for.

    run_out: how far each drives on behind its last pass, at most [m]
    """

    def __init__(self, passes: Sequence[Pass]) -> None:
        self._passes, self._routes = passes, dict[int, tuple[int, Route]]()
        self.run_out = RUN_OUT * len({work.combine for work in passes})

    def places(self, own: Place, said: PeerState, reach: float) -> list[Place]:
        """Where the axle of a combine is, and will be along its way, up to a reach [m]; one that stands, or
        lets a cart go first, stays there.
        """
        if said.phase not in (Phase.CUTS, Phase.TURNS) or said.speed < STILL:
            return [place_of(own, said)]
        return self.ahead(own, said, reach)

    def ahead(self, own: Place, said: PeerState, reach: float = inf) -> list[Place]:
        """Where the axle of a combine is, and will be when it drives on, up to a reach [m]; inf: to the end
        of its turn.
        """
        here = place_of(own, said)
        if said.task < 0:
            return [here]
        route = self._route(said)
        way = self._way(route, here, said)
        to_next = max(route.length + route.turn - way, 0.0)
        count = ceil((to_next if reach == inf else reach) / EVERY)
        ahead = [min(way + EVERY * (i + 1), route.line.length) for i in range(count)]
        return [here, *(Place(*route.line.point(w), route.line.heading(w)) for w in ahead)]

    def through(self, task: int, said: PeerState) -> list[Place]:
        """Where the axle of a combine will be in one of its passes and the turn behind it."""
        route = self._made(task, said)
        ways = [EVERY * i for i in range(ceil((route.length + route.turn) / EVERY) + 1)]
        return [Place(*route.line.point(w), route.line.heading(w)) for w in ways]

    def _route(self, said: PeerState) -> Route:
        combine = self._passes[said.task].combine
        task, route = self._routes.get(combine, (-1, None))
        if route is None or task != said.task:
            route = self._made(said.task, said)
            self._routes[combine] = said.task, route
        return route

    def _made(self, task: int, said: PeerState) -> Route:
        told = (said.header_front, said.header_left) if isfinite(said.header_front) else (KNIFE, 0.0)
        own = own_passes(self._passes, self._passes[task].combine)
        mine = [self._passes[i] for i in own]
        return route_of(mine, own.index(task), told[0], LIMITS, told[1], self.run_out)

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
    """Whether a machine that drives through the places of a way comes nearer to another one at one of its
    places than it is now, and nearer than `clear` [m]. The first place of both is where they are.
    """
    points = [point for place in places for point in other.points(place)]
    now = min(outline.least(way[:1], x, y, clear + NEARER) for x, y in other.points(places[0]))
    return any(outline.least(way, x, y, clear) < min(clear, now - NEARER) for x, y in points)


def free_way(
    here: Place,
    line: GuidanceLine,
    at: float,
    until: float,
    reach: float,
    outline: Outline,
    places: Sequence[Place],
    keep: float = KEEP,
) -> float:
    """Way [m] from `at` along a line, as far as `until` and a reach, before it comes near a machine that is
    at one of some places; inf where it does not. keep: from the own middle to the other's outline [m]; one
    that is nearer already may come nearer by COMES, down to KEEP_STRAIGHT
    """
    now = outline.least(places, here.x, here.y, keep)
    least = now if now == keep else min(now, max(now - COMES, KEEP_STRAIGHT))
    for i in range(ceil(reach / STEP)):
        way = STEP * (i + 1)
        if at + way > until:
            break
        if outline.least(places, *line.point(at + way), keep) < least:
            return max(way - SHORT, 0.0)
    return inf


def reach_at(speed: float) -> float:
    """How far ahead a cart has to look at a speed [m/s]; m."""
    return LOOK + speed * speed / (2.0 * GENTLE)


def _waits_to_turn(said: PeerState) -> bool:
    """Whether a combine stands at the end of a pass, not for a cart."""
    return said.phase == Phase.STANDS and not said.calls and said.remaining <= 0.0


class Clearance:
    """How far a cart can drive on its way before it comes near a combine, or into the next of the way of one
    that drives. passes: of the combine
    """

    def __init__(self, passes: Sequence[Pass]) -> None:
        self._ways = CombineWays(passes)

    def way(
        self,
        here: Place,
        line: GuidanceLine,
        at: float,
        until: float,
        said: PeerState,
        speed: float,
        *,
        to_next: bool = False,
        keep: float = KEEP,
    ) -> float:
        """Free way [m] from `at` along a line, as far as `until`, at a speed [m/s]; inf where all is free.

        A machine that it is near to already, or in the way of, does not keep it from driving on, unless it
        comes nearer, to where that is, too. By a combine that stands it drives where there is room; where
        there is none, it keeps off the next of that one's way.
        to_next: all of the combine's way to the begin of its next pass is kept free; keep: as `free_way`
        """
        reach = reach_at(speed)
        if to_next:
            places = self._ways.ahead(here, said)
        elif hypot(said.x, said.y) > reach + FORE + 20.0:
            return inf
        else:
            places = self._ways.places(here, said, FORE)
        looks = [places, places[:1]] if len(places) > 1 else [places]  # and to where it is now
        outline = outline_of(said)
        free = min(free_way(here, line, at, until, reach, outline, p, keep) for p in looks)
        if free == inf or len(places) > 1 or said.phase not in (Phase.CUTS, Phase.TURNS):
            return free
        ahead = self._ways.ahead(here, said, FORE)  # it cannot drive by: it keeps off that, too
        return min(free, free_way(here, line, at, until, reach, outline, ahead, keep))

    def comes_by(
        self, here: Place, there: Place, own: Outline, said: PeerState, between: Sequence[int] = ()
    ) -> bool:
        """Whether the combine, on its way to its next pass, or in and behind some of its passes after that,
        comes near a machine with an outline that stands at another place. here: where the machine is now
        """
        places = self._ways.ahead(here, said)
        for task in between:
            places += self._ways.through(task, said)
        outline = outline_of(said)
        return any(outline.least(places, x, y, CLEARLY) < CLEARLY for x, y in own.points(there))

    def holds_up(
        self, here: Place, own: Outline, combines: Sequence[PeerState], *, before_turn: bool = False
    ) -> bool:
        """Whether a machine with an outline is in the way of a combine that stands in its turn near it, or
        before it, at the end of a pass, and wants no cart.
        """
        stand = (said for said in combines if said.speed < STILL)
        near = (c for c in stand if c.phase == Phase.TURNS or (before_turn and _waits_to_turn(c)))
        return any(self.comes_by(here, here, own, c) for c in near if hypot(c.x, c.y) < FORE)

    def before_standing(
        self,
        here: Place,
        line: GuidanceLine,
        at: float,
        until: float,
        said: PeerState,
        keep: float = KEEP,
    ) -> float:
        """Way [m] from `at` along a line, as far as `until`, to where a cart still has room to turn about
        before a combine that stands in its turn or for a cart; inf where none is in its way. keep: as
        `free_way`
        """
        stands = said.phase in (Phase.TURNS, Phase.STANDS) and said.speed < STILL
        if not stands or hypot(said.x, said.y) > ROOM + BEYOND:
            return inf
        places = [place_of(here, said)]
        way = free_way(here, line, at, until, ROOM + BEYOND, outline_of(said), places, keep)
        return max(way + SHORT - ROOM, 0.0)

    def is_close(self, here: Place, line: GuidanceLine, at: float, combines: Iterable[PeerState]) -> bool:
        """Whether a cart on a line, so far along it [m], has just room to turn about before one of some
        combines that stand in its way.
        """
        ways = (self.before_standing(here, line, at, line.length, said) for said in combines)
        return any(way <= 0.0 for way in ways)

    def until_near(
        self,
        here: Place,
        line: GuidanceLine,
        at: float,
        most: float,
        own: Outline,
        said: PeerState,
        between: Sequence[int] = (),
        clear: float = WELL,
    ) -> float:
        """How far along a line, from `at` to `most` [m], a machine with an outline can drive to stand `clear`
        off the combine's way, as in `comes_by` [m]. here: where the machine is
        """
        places = self._ways.ahead(here, said)
        for task in between:
            places += self._ways.through(task, said)
        outline = outline_of(said)
        for i in range(int((most - at) / EVERY) + 1):
            way = at + EVERY * i
            x, y = line.point(way)
            close = [p for p in places if hypot(p.x - x, p.y - y) < CLOSE]
            points = own.points(Place(x, y, line.heading(way))) if close else []
            if any(outline.least(close, *q, clear) < clear for q in points):
                return way - EVERY
        return most

    def way_to_next(self, here: Place, said: PeerState) -> float:
        """Of a combine to the end of its turn, about [m]."""
        return EVERY * (len(self._ways.ahead(here, said)) - 1)

    def is_in_way(self, here: Place, said: PeerState) -> bool:
        """Whether it is near to the combine, or in its way."""
        places = self._ways.places(here, said, FORE)
        return outline_of(said).least(places, here.x, here.y, KEEP) < KEEP

    def is_soon_in_way(self, here: Place, own: Outline, said: PeerState, *, in_pass: bool = False) -> bool:
        """Whether a machine with an outline stands in the way of the combine behind its pass, up to FAR_ON,
        or near to one that stands in its turn. in_pass: or in what is left of the pass
        """
        if said.phase == Phase.TURNS and said.speed < STILL and hypot(said.x, said.y) < FORE:
            return True
        places = self._ways.ahead(here, said, FAR_ON)
        left_out = ceil(said.remaining / EVERY) if said.remaining > 0.0 and not in_pass else 0
        return is_swept(outline_of(said), [places[0], *places[1 + left_out :]], own, [here], CLEARLY)
