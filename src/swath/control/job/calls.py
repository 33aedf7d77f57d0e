"""The combines that a cart hears: what is left of their work, and which of them is served next."""

from collections.abc import Collection, Mapping, Sequence
from itertools import permutations
from math import cos, fsum, hypot, inf, isfinite, sin

from swath.control.cooperate.peer_track import OTHERS
from swath.control.job.abreast import own_passes
from swath.control.job.carts import OtherCart
from swath.control.job.passes import Pass, way_along
from swath.control.job.right_of_way import place_of
from swath.control.turns.dubins import Place
from swath.core.component import KeepsState
from swath.core.units import KMH
from swath.signals import HeapState, PeerState, Phase

FORESIGHT = 2  # passes after the present one, for which it sets out
APART = 45.0  # m from a combine that cuts, from where on it sets out for a pass to come
CLEAR = 16.0  # m from a combine that turns, likewise; and from one that drives, before it sets out elsewhere
LEAST = 15.0  # m of a pass beside the combine, for which it sets out
JOINS, TURNS = 20.0, 50.0  # s, to come up beside a combine that drives on; from ahead of it. Estimates
EARLY = 120.0  # s, longer than which a cart would wait for one of several combines: it does not set out yet
AS_NEAR = 20.0  # m, less than that one of two carts is not nearer than the other one
BEHIND = -12.0  # m ahead of a cart: beside it a combine's axle is some 5 m behind the cart's
SPEED = 2.0  # m/s of a combine at work
CART_SPEED, SERVES, BETWEEN = 3.0, 120.0, 60.0  # m/s straight there; s beside, to the next: estimates
SOON = 3.0  # s, less than any turn
LEAVES = 0.3  # m/s, faster than which a combine drives off
NOBODY = -1, -inf
AGAIN = 30.0  # s, for which a combine that was put back goes last
PORTS = ("peer", *OTHERS)


def combines_of(heard: Mapping[str, PeerState]) -> dict[int, PeerState]:
    """The machines with a header, by their number as in `JobState.serves`."""
    return {PORTS.index(name): said for name, said in heard.items() if isfinite(said.header_width)}


def stands_for_cart(said: PeerState) -> bool:
    """Whether a combine stands and wants to unload there."""
    return said.phase == Phase.STANDS and said.calls and said.may_unload


def waits_behind(said: PeerState) -> bool:
    """Whether a combine stands for a cart that is too far ahead of it on the line beside its pass."""
    return stands_for_cart(said) and said.x < BEHIND


def nearest(combines: Mapping[int, PeerState]) -> int:
    """Number of the combine that is nearest."""
    return min(combines, key=lambda number: hypot(combines[number].x, combines[number].y))


class Calls(KeepsState):
    """passes: of all combines; break_off: before the end of a pass [m], but in a combine's last one; fills:
    of the largest heap, that a cart takes for sure
    """

    kept = ("_since", "_put", "_no_way")

    def __init__(self, passes: Sequence[Pass], break_off: float, fills: float = 0.75) -> None:
        self._passes, self._break_off, self._fills = passes, break_off, fills
        self._own = {work.combine: own_passes(passes, work.combine) for work in passes}
        self._rest = [0.0 for _ in passes]  # of the work behind each pass [m]
        for own in self._own.values():
            for task, then in zip(own[-2::-1], own[:0:-1], strict=True):
                then_on = self._rest[then] + way_along(passes[then].line_m)
                self._rest[task] = then_on + passes[task].turn_length
        self._since: dict[int, float] = {}
        self._put: dict[int, float] = {}  # when a combine was put back
        self._no_way: dict[int, tuple[float, float]] = {}  # since when there is no way to one, as last looked

    @property
    def combines(self) -> int:
        """How many combines there are."""
        return len(self._own)

    def reset(self) -> None:
        """Nobody calls."""
        self._since, self._put, self._no_way = {}, {}, {}

    def neediest(
        self, now: float, combines: Mapping[int, PeerState], others: Sequence[OtherCart]
    ) -> tuple[int, float]:
        """Number of the combine to serve first, of those that call and no other cart serves, and for how long
        it has called [s]. NOBODY = none, or one for which a cart would wait longer than EARLY, or one that is
        near and drives off: that is waited for.

        Of the orders in which one cart can serve them that by which all are done first, and who stands least,
        from what each has still to do, when it can be served and how long it would stand until then.
        """
        for number, said in combines.items():
            is_open = said.calls and not self.is_served(said, others) and self._is_open(said)
            self._since[number] = min(self._since.get(number, inf), now) if is_open else inf
        begins = {n: self._begins_in(combines[n]) for n, since in self._since.items() if since < inf}
        calling = [number for number, time in begins.items() if not self._is_early(combines[number], time)]
        fresh = [number for number in calling if now > self._put.get(number, -inf) + AGAIN]
        if not calling:
            return NOBODY
        left = {number: self._left(said) / SPEED for number, said in combines.items()}
        ready = {number: max(begins[number], self._way_in(number, now)) for number in calling}

        def cost(order: tuple[int, ...]) -> tuple[float, float, int]:
            stands, over = self._stands(order, combines, ready), dict(left)
            for number, time in zip(order, stands, strict=True):
                over[number] += time
            return max(over.values()) + fsum(stands) / len(over), self._since[order[0]], order[0]

        first = min(permutations(fresh or calling), key=cost)[0]
        if self.next_task(combines[first]) < 0:
            return NOBODY
        return first, now - self._since[first]

    def _is_open(self, said: PeerState) -> bool:
        """Whether a cart can set out to a combine, now or once that has driven off to its next pass."""
        ends = said.phase == Phase.TURNS or said.remaining < self.break_off(said.task) + LEAST
        return (self._task_of(said) if ends and said.speed > LEAVES else self.next_task(said)) >= 0

    def _stands(
        self, order: Sequence[int], combines: Mapping[int, PeerState], ready: Mapping[int, float]
    ) -> list[float]:
        """How long each combine stands for a cart if one cart serves them in an order [s]. ready: from when
        on each can be served [s]
        """
        found: list[float] = []
        time = 0.0
        for number in order:
            said = combines[number]
            time += BETWEEN if found else hypot(said.x, said.y) / CART_SPEED
            time = max(time, ready[number])
            until = 0.0 if stands_for_cart(said) else said.stands_in
            found.append(max(time - until, 0.0) if isfinite(until) else 0.0)
            time += SERVES
        return found

    def _is_early(self, said: PeerState, begins: float) -> bool:
        """Whether a cart would wait longer than EARLY for one of several combines. begins: `_begins_in`"""
        return self.combines > 1 and begins > hypot(said.x, said.y) / CART_SPEED + EARLY

    def _begins_in(self, said: PeerState) -> float:
        """When a cart can take grain of a combine: from the begin of the pass for which it sets out, or from
        when that stands [s].
        """
        task = self._task_of(said)
        if task <= said.task or stands_for_cart(said):
            return 0.0
        turned = 0.0  # m of the turn behind its pass
        if not isfinite(said.remaining):
            now = self._passes[said.task]
            come = said.come - way_along(now.line_m) if isfinite(said.come) else inf
            turned = min(come, now.turn_length)
        way = self._left(said) - turned - self._rest[task] - way_along(self._passes[task].line_m)
        return min(way / SPEED, said.stands_in if isfinite(said.stands_in) else inf)

    def _left(self, said: PeerState) -> float:
        """Of a combine's work [m]."""
        remaining = said.remaining if isfinite(said.remaining) else 0.0
        return remaining + self._rest[said.task] if said.task >= 0 else 0.0

    def no_way(self, number: int, now: float) -> None:
        """There is no way to a combine now: who else needs a cart as much goes before it."""
        since, last = self._no_way.get(number, (now, now))
        self._no_way[number] = since if now <= last + AGAIN else now, now
        self._since[number] = now

    def _way_in(self, number: int, now: float) -> float:
        """Until there may be a way to a combine again [s]: as long as there was none, and AGAIN more."""
        since, last = self._no_way.get(number, (-inf, -inf))
        return now - since + AGAIN if now <= last + AGAIN else 0.0

    def _put_back(self, number: int, now: float) -> None:
        """Who else calls goes before a combine."""
        self._since[number] = self._put[number] = now

    def is_served(self, combine: PeerState, others: Sequence[OtherCart]) -> bool:
        """Whether another cart serves a combine."""
        return any(self._serves(cart, combine) for cart in others)

    def has_room(
        self, heap: HeapState, combines: Collection[PeerState], others: Sequence[OtherCart], *, is_alone: bool
    ) -> bool:
        """Whether a cart takes half the tank of a combine that stands for it and is not served, or, alone,
        all that is to come.
        """
        if heap.level <= 0.0:
            return True
        room = (self._fills / heap.level - 1.0) * heap.grain
        waits = (c for c in combines if stands_for_cart(c) and not self.is_served(c, others))
        takes = any(room >= 0.5 * said.tank_grain for said in waits)
        return takes or (is_alone and fsum(said.to_come for said in combines) <= room)

    def is_spare(self, combines: Collection[PeerState], others: Sequence[OtherCart]) -> bool:
        """Whether every combine is done, or in its last pass with another cart."""
        last = (self._own[self._passes[said.task].combine][-1] for said in combines)
        return all(
            said.phase == Phase.DONE or (said.task == task and self.is_served(said, others))
            for said, task in zip(combines, last, strict=True)
        )

    def turns_to_standing(
        self,
        now: float,
        number: int,
        combines: Mapping[int, PeerState],
        others: Sequence[OtherCart],
        *,
        waits: bool,
    ) -> bool:
        """Whether a cart gives up its way to a pass for a combine that stands and wants to unload: the one
        with a number, which has not come to that pass, or, while the cart waits there, another one. That one
        then goes before the one with the number.
        """
        if stands_for_cart(combines[number]):
            return True
        unserved = (said for said in combines.values() if not self.is_served(said, others))
        if not waits or not any(stands_for_cart(said) for said in unserved):
            return False
        self._put_back(number, now)
        return True

    def gives_up_waiting(
        self, now: float, number: int, combines: Mapping[int, PeerState], others: Sequence[OtherCart]
    ) -> bool:
        """Whether a cart leaves a combine with a number, beside which it has had no grain for long: that
        stands for it, but its box is not below the pipe; or it waits, and another one stands for a cart,
        which goes before it then.
        """
        stands = combines[number].phase == Phase.STANDS
        return stands or self.turns_to_standing(now, number, combines, others, waits=True)

    def withdraws(self, combine: PeerState, here: Place, number: int, others: Sequence[OtherCart]) -> bool:
        """Whether another cart took the same call at the same time, and is nearer to the combine or, as near,
        before it by number.
        """
        at, away = place_of(here, combine), hypot(combine.x, combine.y)
        for cart in others:
            nearer = away - hypot(cart.at.x - at.x, cart.at.y - at.y)
            is_first = nearer > AS_NEAR or (nearer >= -AS_NEAR and cart.number < number)
            if is_first and self._serves(cart, combine):
                return True
        return False

    def _serves(self, cart: OtherCart, combine: PeerState) -> bool:
        of = self._passes[combine.task].combine
        return cart.said.task >= 0 and self._passes[cart.said.task].combine == of

    def next_task(self, peer: PeerState) -> int:
        """The combine's pass, where enough is left of it when a cart can be there, or it stands; else, once
        the combine has left its place, the first of the next FORESIGHT in which a cart can take grain
        driving, or the next; -1 = none.
        """
        task = self._task_of(peer)
        near = CLEAR if peer.phase == Phase.TURNS else APART
        return -1 if task != peer.task and hypot(peer.x, peer.y) < near else task

    def _task_of(self, peer: PeerState) -> int:
        """As `next_task`, wherever the combine is."""
        passes, least = self._passes, self.break_off(peer.task) + LEAST
        own = self._own[passes[peer.task].combine]
        then = own[own.index(peer.task) + 1 :][:FORESIGHT]
        found = next((i for i in then if passes[i].cart_beside), -1)
        stands = peer.phase == Phase.STANDS or self.will_stand(peer) or self._stands_soon(peer)
        is_here = passes[peer.task].cart_beside or (passes[peer.task].cart_standing and (stands or found < 0))
        way = peer.speed * _time_to_join(peer) if found >= 0 else 0.0
        if is_here and (stands or peer.remaining > least + way):
            return peer.task
        return then[0] if found < 0 and then and passes[then[0]].cart_standing else found

    def is_lost(self, peer: PeerState, task: int, *, is_beside: bool) -> bool:
        """Whether a combine has left the pass that a cart drives to, or is beside, or soon will."""
        if peer.task < task:
            return False
        if peer.task > task or peer.phase == Phase.TURNS:
            return True
        near_end = peer.remaining < self.break_off(peer.task)
        stays = peer.phase == Phase.STANDS or self.will_stand(peer)
        return near_end and not (peer.may_unload if is_beside else stays)

    def _stands_soon(self, peer: PeerState) -> bool:
        """Whether a combine, by its forecast, will stand for a cart in what is left of its pass, or at its
        end.
        """
        cuts = peer.phase == Phase.CUTS and peer.remaining > 0.0
        return cuts and peer.stands_in < peer.remaining / (self._passes[peer.task].speed_kmh * KMH) + SOON

    def will_stand(self, peer: PeerState) -> bool:
        """Whether a combine that calls comes to the end of its pass and unloads there before it goes on."""
        ends = peer.phase == Phase.CUTS and peer.remaining < self.break_off(peer.task)
        return ends and peer.calls and peer.may_unload

    def between(self, task: int, then: int) -> list[int]:
        """Numbers of a combine's passes between two of them."""
        return [i for i in self._own[self._passes[task].combine] if task < i < then]

    def break_off(self, task: int) -> float:
        """Before the end of a pass [m]; behind its last one a combine stands and does not turn."""
        return -inf if task == self._own[self._passes[task].combine][-1] else self._break_off


def _time_to_join(peer: PeerState) -> float:
    """Until a cart is beside a combine that drives on [s]: one that is ahead of it turns about behind it."""
    is_ahead = peer.x * cos(peer.heading) + peer.y * sin(peer.heading) < 0.0
    return hypot(peer.x, peer.y) / CART_SPEED + (TURNS if is_ahead else JOINS)
