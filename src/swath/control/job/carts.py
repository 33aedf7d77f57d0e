"""Several carts: where those drive and wait that serve no combine, or another one.

A cart serves while its messages name a pass (`task`), from setting out to the combine until it sets out to
the truck. Each tells the way that it drives; whoever plans a way later keeps clear of those.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import atan2, ceil, cos, hypot, inf, isfinite, sin
from typing import NamedTuple

from swath.control.job.ground import Point, beside
from swath.control.job.right_of_way import free_way, outline_of, place_of, reach_at
from swath.control.steer.guidance_line import GuidanceLine
from swath.control.turns.dubins import Place
from swath.core.component import Inputs
from swath.signals import GuidancePath, PeerState, Phase, Station

LATER = 1.0  # s, that a cart waits for each one before it by number to take a call
AT_TRUCK = 12.0  # m from the truck's place: it is taken
AS_NEAR = 20.0  # m, less than that one of two carts is not nearer to it than the other one
APART, WAITS = 3.5, 3.4  # m about the way of another cart, beyond the own half width; of one that stands
AROUND = 3.0  # m about the outline of one that stands, likewise: where arcs to the right and to the left meet
# a cart leaves its way by up to 1 m
EVERY = 3.0  # m between places of a way
OVER = 15.0  # m about a place where a cart is to stand, in which others do not drive
BEYOND = 30.0  # m behind the end of a pass, where the line beside it ends
SOON, NEAR = 4.0, 20.0  # s, m
STANDS = 0.1  # m/s
IN_LINE, TURNED, IN_PLACE = 1.0, 0.2094, 4.0  # m, rad (12 deg), m: from there on it keeps the station
Disc = tuple[float, float, float]


class OtherCart(NamedTuple):
    """number: in the order of the carts; at: where it is; path: that it tells"""

    number: int
    said: PeerState
    at: Place
    path: GuidancePath | None

    def way(self) -> list[Point]:
        """That it drives, from there on [m]; looked for among all points of its path."""
        return way_left(self.at, self.said, self.path)


def others_of(
    here: Place, heard: Mapping[str, PeerState], inputs: Inputs, own_number: int
) -> list[OtherCart]:
    """The other carts, in the order of the inputs `other_1` and so on, of those that have been heard."""
    found = []
    for i, (name, said) in enumerate((n, m) for n, m in heard.items() if n != "peer"):
        if said.is_heard:
            at = place_of(here, said)
            path = inputs.get(name.replace("other", "way"))
            found.append(OtherCart(i + (i >= own_number), said, at, path))
    return found


def way_left(at: Place, said: PeerState, path: GuidancePath | None) -> list[Point]:
    """What a cart still has to drive, places EVERY apart: to a combine, or beside one, as far as the line
    beside its pass leads to the end of that; to a place as far as its front reaches there.
    """
    if path is None or len(path.x) < 2:
        return []
    points: list[Point] = list(zip(path.x.tolist(), path.y.tolist(), strict=True))
    if said.phase == Phase.BESIDE:
        return list(_thinned(_lane_left((at.x, at.y), points[-1])))
    if said.phase != Phase.DRIVES:
        return []
    if said.task >= 0:
        points[-1:] = _thinned(_lane_left(*points[-2:]))
    elif isfinite(said.body_front):
        points.append(_beyond(points, said.body_front))
    begin = min(range(len(points)), key=lambda i: hypot(points[i][0] - at.x, points[i][1] - at.y))
    return list(_thinned(points[begin:])) if begin + 1 < len(points) else []


def _beyond(points: Sequence[Point], way: float) -> Point:
    """Straight on behind the last of some points [m]."""
    (ax, ay), (bx, by) = points[-2:]
    share = way / max(hypot(bx - ax, by - ay), 1e-3)
    return bx + share * (bx - ax), by + share * (by - ay)


def _lane_left(at: Point, end: Point) -> list[Point]:
    """From a place on the line beside a pass to the end of the pass, BEYOND before that of the line."""
    (ax, ay), (bx, by) = at, end
    share = 1.0 - BEYOND / max(hypot(bx - ax, by - ay), BEYOND)
    return [at, (ax + share * (bx - ax), ay + share * (by - ay))]


def _thinned(points: Sequence[Point]) -> Iterator[Point]:
    """Places at most EVERY apart."""
    last: Point | None = None
    for x, y in points:
        if last is not None:
            away = hypot(x - last[0], y - last[1])
            if away < EVERY and (x, y) != points[-1]:
                continue
            for i in range(1, ceil(away / EVERY)):
                share = i * EVERY / away
                yield last[0] + share * (x - last[0]), last[1] + share * (y - last[1])
        last = x, y
        yield last


def discs_of(others: Sequence[OtherCart], place: Point | None = None, away: float = 0.0) -> list[Disc]:
    """Circles (x, y, radius) that a way has to keep clear of: of radius AROUND about carts, APART about ways
    that they drive, WAITS about ways on which they stand. place: so far away [m]; others are not counted
    about it that drive by there before a cart can come, nor those on their way there that are farther off
    """
    found: list[Disc] = []
    for cart in others:
        found += [(x, y, AROUND) for x, y in outline_of(cart.said).points(cart.at)]
        way, drives = cart.way(), cart.said.speed >= STANDS
        if drives and place is not None:
            way = _still_there(way, place, away)
        found += [(x, y, APART if drives else WAITS) for x, y in way]
    return found


def _still_there(way: list[Point], place: Point, away: float) -> list[Point]:
    """What counts of another one's way for a cart that is so far away from its place [m]."""
    near = [hypot(x - place[0], y - place[1]) for x, y in way]
    if near and near[-1] < AT_TRUCK and EVERY * len(way) > away:
        return []  # to the same place, later
    last = max((i for i, off in enumerate(near) if off < OVER), default=len(way))
    return way if EVERY * last >= away else [q for q, off in zip(way, near, strict=True) if off >= OVER]


def is_in_line(station: Station) -> bool:
    """Whether a cart is so near to its station that it can keep it from now on."""
    aside, ahead = abs(station.left) < IN_LINE, abs(station.ahead) < IN_PLACE
    return station.is_active and aside and ahead and abs(station.heading) < TURNED


def is_taken(truck: Point, own_number: int, left: float, others: Sequence[OtherCart]) -> bool:
    """Whether another cart is at the truck, or drives there and is the first: nearer, or as near and before
    it by number. left: of the own way there [m]
    """
    for cart in others:
        if hypot(cart.at.x - truck[0], cart.at.y - truck[1]) < AT_TRUCK:
            return True
        way = cart.way()
        if way and hypot(way[-1][0] - truck[0], way[-1][1] - truck[1]) < AT_TRUCK:
            nearer = left - EVERY * len(way)
            if nearer > AS_NEAR or (nearer >= -AS_NEAR and cart.number < own_number):
                return True
    return False


def free_of(
    others: Sequence[OtherCart], here: Place, line: GuidanceLine, at: float, speed: float, own_number: int
) -> float:
    """Way [m] from `at` along a line, at a speed [m/s], before it comes near another cart; inf where it does
    not. One that keeps a station or comes to rest is taken to drive on for SOON, and one on its way, which is
    before it by number.
    """
    free, reach = inf, reach_at(speed)
    for cart in others:
        drives = cart.said.phase == Phase.DRIVES
        ahead = 0.0 if drives and cart.number > own_number else max(cart.said.speed, 0.0) * SOON
        if hypot(cart.said.x, cart.said.y) < reach + ahead + NEAR:
            places = _along(cart.at, cart.way(), ahead) if drives else _straight_on(cart.at, ahead)
            free = min(free, free_way(here, line, at, line.length, reach, outline_of(cart.said), places))
    return free


def _straight_on(at: Place, way: float) -> list[Place]:
    """Where a cart is, halfway and at the end of a way [m]."""
    return [Place(*beside(*at, ahead, 0.0), at.heading) for ahead in (0.0, 0.5 * way, way)]


def _along(at: Place, points: Sequence[Point], way: float) -> list[Place]:
    """Where a cart is and will be at some points of its path, as far as a way [m].

    It is never just on its path: a point abreast of it does not tell where it heads for.
    """
    found, come = [at], 0.0
    for x, y in points:
        dx, dy = x - found[-1].x, y - found[-1].y
        if dx * cos(found[-1].heading) + dy * sin(found[-1].heading) < 0.5 * EVERY:
            continue
        come += hypot(dx, dy)
        if come > way:
            break
        found.append(Place(x, y, atan2(dy, dx)))
    return found
