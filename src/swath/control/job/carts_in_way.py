"""Carts in the way of a combine: as it drives, and in the turn that it is to begin."""

from collections.abc import Collection, Sequence
from math import hypot

from swath.control.job.ground import beside
from swath.control.job.heard import SILENT, STOPS
from swath.control.job.passes import Route
from swath.control.job.right_of_way import ALONG, SWEPT, is_swept, outline_of, own_outline, place_of
from swath.control.job.turn_speed import EVERY
from swath.control.turns.dubins import Place
from swath.signals import PeerState, Phase
from swath.signals.setup import MachineGeometry

NEAR = 60.0  # m, beyond which another machine is not in the way of a turn
AHEAD = 45.0  # m of the way through a turn that have to be free
BEYOND, FAR = 10.0, 100.0  # m behind the turn, that have to be free, too, of carts that stand; not farther
# on: these make room for what comes within the next 120 m
STOPS_IN = 14.0  # m of the way that have to be free while it turns, and while it cuts
BUMPS = 0.2  # m from a cart ahead of it, that it stops before in a pass
SOON, SHORTLY = 6, 2  # s, for which another machine is taken to drive straight on, and for one that turns: a
# combine that sets off again comes before a cart that cannot stop any more
CAN_BE = 15.0  # m about a place where a silent machine may stand, that a turn takes
SETS_OFF = 1.5  # m/s, slower than which a cart may stop again, in the way of all of a turn
STANDS, RESTS = 0.3, 0.1  # m/s, slower than which another machine stands, and the own one


class CartsInWay:
    """own: the combine's geometry; passes: numbers of its passes. Of the methods: way: along the route, a
    pass and the turn behind it [m]; here: where the machine is; carts: as it hears them
    """

    def __init__(self, own: MachineGeometry, passes: Collection[int]) -> None:
        self._passes = frozenset(passes)
        self._outline, half = own_outline(own), 0.5 * own.header_width
        self._strip = own.header_y - half, own.header_y + half

    def is_blocked(
        self,
        route: Route,
        way: float,
        here: Place,
        carts: Sequence[PeerState],
        *,
        is_last: bool,
        clear: float = SWEPT,
    ) -> bool:
        """Whether a cart is in its way, in the turn that it is to begin, or, behind the last pass, straight
        on. clear: of it [m]
        """
        heard = [cart for cart in carts if cart.is_heard]
        return any(self._is_in_turn(route, way, here, cart, clear, is_last=is_last) for cart in heard)

    def stops_turn(
        self, route: Route, way: float, here: Place, carts: Sequence[PeerState], speed: float
    ) -> bool:
        """Whether a cart is in the next metres of its way through a turn, or soon. speed: the own [m/s]"""
        return self._comes_near(route, way, here, carts, SWEPT, SHORTLY if speed > RESTS else SOON)

    def stops_cutting(self, route: Route, way: float, here: Place, carts: Sequence[PeerState]) -> bool:
        """Whether a cart that does not stand or drive along beside it is in the next metres of its pass."""
        across = [cart for cart in carts if self._is_across(cart)]
        return self._comes_near(route, way, here, across, BUMPS, SHORTLY)

    def leaves_in_peace(self, route: Route, end: float, carts: Sequence[PeerState]) -> bool:
        """Whether the turn behind a pass keeps off carts that stand beside its end as beside it now."""
        there = _through(route, end, 0.0)[0]
        heard = [cart for cart in carts if cart.is_heard]
        return not any(self._sweeps(route, end, cart, [place_of(there, cart)]) for cart in heard)

    def _comes_near(
        self, route: Route, way: float, here: Place, carts: Sequence[PeerState], clear: float, soon: int
    ) -> bool:
        heard = [cart for cart in carts if cart.is_heard and cart.age <= SILENT]
        return any(self._is_in_way(route, way, here, cart, clear, soon, STOPS_IN) for cart in heard)

    def _is_across(self, cart: PeerState) -> bool:
        return cart.phase != Phase.BESIDE and not (abs(cart.heading) < ALONG and self._is_aside(cart))

    def _is_aside(self, cart: PeerState) -> bool:
        """Whether all of a cart is on one side of the strip that the header cuts."""
        aside = [y for _, y in outline_of(cart).points(Place(cart.x, cart.y, cart.heading))]
        return min(aside) > self._strip[1] or max(aside) < self._strip[0]

    def _is_in_turn(
        self, route: Route, way: float, here: Place, said: PeerState, clear: float, *, is_last: bool
    ) -> bool:
        if said.age > SILENT:
            return hypot(said.x, said.y) < STOPS + CAN_BE
        reach = AHEAD
        makes_room = said.phase != Phase.BESIDE or said.task in self._passes  # not beside another combine
        if said.speed < SETS_OFF and makes_room and not is_last:
            reach = min(max(reach, route.length + route.turn + BEYOND - way), FAR)
        begins = (), (here,)  # one that came to rest late is not yet turned as its route is there
        return any(self._is_in_way(route, way, here, said, clear, SOON, reach, begin) for begin in begins)

    def _is_in_way(
        self,
        route: Route,
        way: float,
        here: Place,
        said: PeerState,
        clear: float,
        soon: int,
        reach: float,
        begin: Sequence[Place] = (),
    ) -> bool:
        if hypot(said.x, said.y) > NEAR + reach - AHEAD + said.speed * (soon - SHORTLY):
            return False
        at = place_of(here, said)
        ahead = [0.0] if said.speed < STANDS else [said.speed * i for i in range(soon)]
        places = [Place(*beside(*at, on, 0.0), at.heading) for on in ahead]
        return self._sweeps(route, way, said, places, clear, reach, begin)

    def _sweeps(
        self,
        route: Route,
        way: float,
        said: PeerState,
        places: Sequence[Place],
        clear: float = SWEPT,
        reach: float = AHEAD,
        begin: Sequence[Place] = (),
    ) -> bool:
        ways = [*begin, *_through(route, way, reach)]
        return is_swept(self._outline, ways, outline_of(said), places, clear)


def _through(route: Route, way: float, reach: float) -> list[Place]:
    """Places of the next metres, as far as a reach, from so far along a route [m]."""
    ways = [way + EVERY * i for i in range(round(reach / EVERY) + 1)]
    return [Place(*route.line.point(w), route.line.heading(w)) for w in ways]
