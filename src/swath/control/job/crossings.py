"""Where ways of combines meet: who goes first there, as planned, or since the other one let it.

The order is a planned one. A combine that stands, for a cart, holds up all that wait for it. So whoever is
to go first at a crossing and has not come to it lets the one that waits there go first, if all are done
earlier for it, by what all have told; that one may do the same then. It must not bring them to wait for
each other for good: that is known from the times at which all are done, which are infinite then. Only one
combine may do that in a slot of time, and the others hear of it before the next slot.
"""

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import fsum, inf, isfinite
from typing import Annotated, NamedTuple

from annotated_types import Ge, Le, MinLen

from swath.control.job.passes import Pass, way_along
from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.signals import PeerState, Phase

SLOT = 3.0  # s, in which only one combine may let another one go first
HEARD = 1.0  # s, of the newest messages of all, for that
TELLS = 0.2  # s, for which one of the crossings is told, in turn
EARLIER = 20.0  # s, that all together are done earlier, at least
STANDS = 60.0  # s, that one which stands goes on standing, as far as anybody knows
MOST = 4  # crossings at which one lets another one go first at once
WAITS = 5.0  # m before the place where it has to wait: it waits there
SLOW = 0.3  # m/s, likewise
PAST = 1.0  # m, less than which one that waits has come too far
SURE = 2.0  # m before the crossing, where who lets another one go first can come to rest
STILL, SHORT = 0.05, 0.3  # m/s of one that stands already; m, that it may have come too far
BEYOND = 200.0  # m behind the last pass, at most, that a combine drives on
BEFORE = 0.1  # s, that who waits stands before the place
NONE = -1
Metres = Annotated[float, Ge(-1e5), Le(1e5)]
Task = Annotated[int, Ge(0), Le(100_000)]


@dataclass(frozen=True)
class GivesWay:
    """Not farther than way_m along the pass with the number `task`, and the turn behind it, before the other
    combine has come other_m along its pass `other`, and the turn behind that
    wait_m: where it waits, unless it is past that: at the end of the pass, where carts do not come by
    """

    task: Task
    way_m: Metres
    other: Task
    other_m: Metres
    wait_m: Metres | None = None

    def hold(self, task: int, way: float) -> float:
        """Where one waits that is so far along a pass [m]."""
        if self.wait_m is None or (task == self.task and way > self.wait_m + PAST):
            return self.way_m
        return self.wait_m


@dataclass(frozen=True)
class Crossing:
    """first: how one combine waits for the other there, as planned; instead: how this one waits where it lets
    the other one go first; none = it must not
    """

    first: Annotated[tuple[GivesWay, ...], MinLen(1)]
    instead: tuple[GivesWay, ...] = ()


class Wait(NamedTuple):
    """at: of the own way; until: of that of another machine, with its number [s, if nothing stops them]; of
    none: it stands for so long
    """

    at: float
    other: int
    until: float


def done_at(
    now: Sequence[float], whole: Sequence[float], late: Sequence[float], waits: Sequence[Sequence[Wait]]
) -> list[float]:
    """When machines come to the ends of their ways, if each drives on whenever it may [s]; inf: never.

    now: how far each has come; whole: how far each has to go; late: for how long each stands before it goes
    on [s]; waits: of each, in their order along the way
    """
    numbers = range(len(now))
    places = [[at] for at in now]  # where each was known to be, and when it left there
    times = [[float(stood)] for stood in late]
    reached = [own[0].at if own else end for own, end in zip(waits, whole, strict=True)]
    gone = [0 for _ in numbers]

    def comes(n: int, at: float) -> float:
        if at <= now[n]:
            return 0.0
        k = bisect_left(places[n], at) - 1
        return times[n][k] + at - places[n][k]

    moved = True
    while moved:
        moved = False
        for n in numbers:
            while gone[n] < len(waits[n]):
                at, other, until = waits[n][gone[n]]
                arrives = times[n][-1] + max(at - places[n][-1], 0.0)
                if other == NONE:
                    leaves = arrives + until
                else:
                    comes_to = reached[other] - (BEFORE if gone[other] < len(waits[other]) else 0.0)
                    if until > now[other] and until > comes_to:
                        break
                    leaves = max(arrives, comes(other, until))
                places[n].append(max(at, places[n][-1]))
                times[n].append(leaves)
                gone[n] += 1
                reached[n] = waits[n][gone[n]].at if gone[n] < len(waits[n]) else whole[n]
                moved = True
    return [comes(n, whole[n]) if gone[n] == len(waits[n]) else inf for n in numbers]


def _cost(ends: Sequence[float]) -> float:
    """When the last one is done, and all in the mean, together [s]."""
    return max(ends) + fsum(ends) / len(ends)


class Crossings(KeepsState):
    """Of all combines, as one of them knows them. passes: of all; number: of this one; speed: in turns
    [m/s]
    """

    kept = ("_turned", "_told", "_slot")

    def __init__(
        self, passes: Sequence[Pass], number: int, crossings: Sequence[Crossing], speed: float
    ) -> None:
        self._passes, self._number, self._crossings, self._speed = passes, number, crossings, speed
        self._count = 1 + max(work.combine for work in passes)
        self._lengths = [way_along(work.line_m) for work in passes]
        self._begins, self._whole = [0.0 for _ in passes], [0.0 for _ in range(self._count)]
        for i, work in enumerate(passes):
            self._begins[i] = self._whole[work.combine]
            turn = work.turn_length or BEYOND
            self._whole[work.combine] += self._lengths[i] / (work.speed_kmh * KMH) + turn / speed
        self._on: dict[int, list[tuple[int, int, GivesWay]]] = {}  # by pass: crossing, whether turned, rule
        for k, crossing in enumerate(crossings):
            for is_turned, rules in enumerate((crossing.first, crossing.instead)):
                for rule in rules:
                    self._on.setdefault(rule.task, []).append((k, is_turned, rule))
        self.reset()

    def reset(self) -> None:
        """As planned."""
        self._turned = [0 for _ in self._crossings]  # how often another one was let first, at each of them
        self._told: list[int] = []  # numbers of those at which this one did so, while it is told
        self._slot = NONE

    @property
    def turned(self) -> list[int]:
        """How often another one was let first, at each crossing."""
        return self._turned

    def hear(self, turned: Sequence[int]) -> None:
        """What another one knows of that, as `turned`."""
        self._turned = [max(both) for both in zip(self._turned, turned, strict=True)]

    def rules(self, task: int) -> Iterator[GivesWay]:
        """That hold now along a pass."""
        for k, is_turned, rule in self._on.get(task, ()):
            if self._turned[k] % 2 == is_turned:
                yield rule

    def update(self, t: int, own: PeerState, others: Sequence[PeerState]) -> int:
        """Listens to the others, and lets one of them go first. own: what this one tells. Returns what it
        tells of that at t [ns]: the number of a crossing, and their count for each time that one was let
        first there before; NONE where there is nothing to tell.
        """
        count = len(self._crossings)
        for said in others:
            if said.lets_first != NONE and count:
                times, k = divmod(said.lets_first, count)
                self._turned[k] = max(self._turned[k], times + 1)
        told = {self._passes[said.task].combine: said for said in (own, *others) if said.task >= 0}
        slot = int(t / NS / SLOT)
        is_new, self._slot = slot != self._slot, slot
        is_heard = len(told) == self._count and all(said.is_heard and said.age < HEARD for said in others)
        if is_new and is_heard and slot % self._count == self._number:
            self._let_first(told)
        self._told = [k for k in self._told if self._has_to_tell(k, told)]
        if not self._told:
            return NONE
        k = self._told[int(t / NS / TELLS) % len(self._told)]
        return k + (self._turned[k] - 1) * count

    def has_come(self, rule: GivesWay, told: Mapping[int, PeerState]) -> bool:
        """Whether the other combine has come so far that it need not be waited for. told: by each"""
        said = told.get(self._passes[rule.other].combine)
        if said is None:
            return False
        come = said.come if isfinite(said.come) else -inf
        return said.phase == Phase.DONE or (said.task, come) >= (rule.other, rule.other_m)

    def _has_to_tell(self, k: int, told: Mapping[int, PeerState]) -> bool:
        """Whether it waits there still for the one that it let go first."""
        rules = self._rules(k)
        is_own = self._passes[rules[0].task].combine == self._number
        return is_own and not all(self.has_come(rule, told) for rule in rules)

    def _let_first(self, told: Mapping[int, PeerState]) -> None:
        """One combine, where it waits, and at crossings after that: where all are done earliest for it."""
        waits = [k for k in range(len(self._crossings)) if self._may(k, told) and self._is_waited_at(k, told)]
        best, then = _cost(self._ends(told)) - EARLIER if waits else -inf, list[int]()
        for chain in (chain for k in waits for chain in self._chains(k, told)):
            cost = _cost(self._ends(told, chain))
            if cost < best:
                best, then = cost, chain
        for k in then:
            self._turned[k] += 1
        self._told += [k for k in then if k not in self._told]

    def _chains(self, k: int, told: Mapping[int, PeerState]) -> Iterator[list[int]]:
        """A crossing, and with it the next ones of the same two combines along the way of the other one."""
        begin, waits = self._begin(k), self._passes[self._rules(k)[0].task].combine
        mine = [
            j for j in range(len(self._crossings))
            if self._begin(j) > begin and self._may(j, told)
            and self._passes[self._rules(j)[0].task].combine == waits
        ]  # fmt: skip
        after = sorted(mine, key=self._begin)[: MOST - 1]
        for count in range(len(after) + 1):
            yield [k, *after[:count]]

    def _begin(self, k: int) -> tuple[int, float]:
        """Where the one that waits at a crossing comes to it."""
        return min((rule.task, rule.way_m) for rule in self._rules(k))

    def _may(self, k: int, told: Mapping[int, PeerState]) -> bool:
        """Whether this combine may let another one go first at a crossing, which it has not come to."""
        instead, own = self._rules(k, turned=True), told[self._number]
        if not instead or self._passes[instead[0].task].combine != self._number or own.phase == Phase.DONE:
            return False
        return all(self._can_wait(own, rule) for rule in instead)

    def _can_wait(self, own: PeerState, rule: GivesWay) -> bool:
        """Whether it comes to rest before where it has to wait, or stands there already."""
        place = rule.hold(own.task, own.come)
        past = SHORT if place == rule.way_m else PAST
        braking = SURE + own.speed**2 if own.speed > STILL else -past
        return (own.task, own.come + braking) <= (rule.task, place)

    def _is_waited_at(self, k: int, told: Mapping[int, PeerState]) -> bool:
        return any(self._waits(rule, told) for rule in self._rules(k))

    def _waits(self, rule: GivesWay, told: Mapping[int, PeerState]) -> bool:
        said = told[self._passes[rule.task].combine]
        if said.task != rule.task or said.speed > SLOW or self.has_come(rule, told):
            return False
        return -PAST <= rule.hold(said.task, said.come) - said.come < WAITS

    def _ends(self, told: Mapping[int, PeerState], turned: Sequence[int] = ()) -> list[float]:
        """When all are done [s], with some crossings at which the other one than now goes first."""
        numbers = range(self._count)
        now = [self._time(told[n].task, told[n].come) for n in numbers]
        late = [STANDS if told[n].phase == Phase.STANDS else 0.0 for n in numbers]
        waits: list[list[Wait]] = [[] for _ in numbers]
        for rule in (r for k in range(len(self._crossings)) for r in self._rules(k, turned=k in turned)):
            n, other = (self._passes[task].combine for task in (rule.task, rule.other))
            hold = rule.hold(told[n].task, told[n].come)
            if not self.has_come(rule, told) and (told[n].task, told[n].come - PAST) <= (rule.task, hold):
                at, until = self._time(rule.task, hold), self._time(rule.other, rule.other_m)
                waits[n].append(Wait(at, other, until))
        return done_at(now, self._whole, late, [sorted(own) for own in waits])

    def _time(self, task: int, way: float) -> float:
        """From the begin of a combine's first pass, if nothing stops it [s]."""
        if not isfinite(way):
            way = 0.0
        in_pass = min(way, self._lengths[task])
        found = self._begins[task] + in_pass / (self._passes[task].speed_kmh * KMH)
        found += (way - in_pass) / self._speed
        return min(found, self._whole[self._passes[task].combine])

    def _rules(self, k: int, *, turned: bool = False) -> Sequence[GivesWay]:
        """Of a crossing, as now. turned: as if the other one went first"""
        crossing = self._crossings[k]
        return crossing.instead if (self._turned[k] % 2 == 1) != turned else crossing.first
