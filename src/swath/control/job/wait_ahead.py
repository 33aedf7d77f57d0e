"""How far a cart drives that has set out to a pass which its combine has not begun."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple

from swath.control.job.calls import Calls
from swath.control.job.cart_ways import BEGIN, FAR, MOVES, STRAIGHT, CartWays, Way
from swath.control.job.carts import Disc
from swath.control.job.passes import Pass, swings_out
from swath.control.job.right_of_way import SHORT, Clearance, Outline
from swath.control.steer.guidance_line import GuidanceLine
from swath.control.turns.dubins import Place
from swath.signals import PeerState, Phase

AHEAD = STRAIGHT - BEGIN + 20.0  # m along the line beside a pass, where it waits for the combine to come up
NEARER = 30.0  # m that it comes at least, to set out
BEFORE = 6.0  # m before a place by which the combine comes, where it waits
LAST = 40.0  # m before the line beside a pass, where the combine's way leads, too
LEAVES = 25.0  # m of way, on which a cart leaves that of a combine
BY = 2.0  # m between the outlines of both, where it drives by


class Found(NamedTuple):
    """is_clear: its place beside the pass is off the ways of combines; until: as `WaitAhead.until`"""

    way: Way
    is_clear: bool
    until: float


class WaitAhead:
    """passes: of all combines; own: outline of the cart"""

    def __init__(self, passes: Sequence[Pass], own: Outline, clearance: Clearance, calls: Calls) -> None:
        self._passes, self._own, self._clearance, self._calls = passes, own, clearance, calls

    def found(
        self,
        ways: CartWays,
        here: Place,
        task: int,
        peer: PeerState,
        discs: Sequence[Disc],
        rest: Sequence[PeerState],
    ) -> Found | None:
        """The way to a pass, where it may set out; to one that the combine has not begun also over crop that
        is cut before. discs, rest: as `CartWays.to_pass`
        """
        way = ways.to_pass(here, task, peer, discs, rest)
        soon = way is None and task > peer.task
        if soon and peer.phase == Phase.CUTS:
            way = ways.to_pass(here, task, peer, discs, rest, soon=True)
        if way is None:
            return None
        soon |= task > peer.task and ways.is_cut_before(_place(way), task, peer)
        is_clear = not soon and self.is_clear(here, way, task, peer, rest)
        until = self.until(here, way, task, peer, rest, is_clear=is_clear, soon=soon)
        return Found(way, is_clear, until) if until > 0.0 else None

    def is_clear(
        self, here: Place, way: Way, task: int, peer: PeerState, rest: Sequence[PeerState] = ()
    ) -> bool:
        """Whether its place beside the pass is off the combine's way till then, and off those of the rest
        through the passes that they begin before.
        """
        if task <= peer.task:
            return True
        there = _place(way)
        between = self._calls.between(peer.task, task)
        ways = [(peer, between), *((said, self._before(task, said)) for said in rest)]
        return not any(self._clearance.comes_by(here, there, self._own, said, then) for said, then in ways)

    def _before(self, task: int, said: PeerState) -> list[int]:
        """Passes of another combine, after its present one, that are begun before a pass."""
        return self._calls.between(said.task, task) if said.task >= 0 else []

    def until(
        self,
        here: Place,
        way: Way,
        task: int,
        peer: PeerState,
        rest: Sequence[PeerState] = (),
        *,
        is_clear: bool,
        soon: bool = False,
    ) -> float:
        """How far it drives before the combine has begun the pass [m]; inf: to its place there, or as far as
        it keeps clear of the ways of combines; 0 = it does not set out. is_clear: that place is, by
        `is_clear`; soon: crop stands on the way yet, which the combine cuts before

        To the next pass it may wait on the combine's way, but not behind a turn that swings out, nor set out
        while the combine is in that.
        """
        between = self._calls.between(peer.task, task)
        waits = between or any(self._before(task, said) for said in rest)
        is_free = is_clear if waits else not swings_out(self._passes[peer.task])
        if task <= peer.task or (is_free and not soon):
            return inf
        if peer.phase == Phase.TURNS:
            return 0.0
        line = GuidanceLine(way.points.tolist(), "path")
        found = self.further(here, line, 0.0, line.length - way.beside, task, peer, rest)
        return found if found >= NEARER else 0.0

    def further(
        self,
        here: Place,
        line: GuidanceLine,
        at: float,
        most: float,
        task: int,
        peer: PeerState,
        rest: Sequence[PeerState] = (),
    ) -> float:
        """How far along its way it keeps clear of that of the combine till then, and of those of the rest
        that begin a pass before, from `at` to `most` [m].
        """
        ways = [(peer, self._calls.between(peer.task, task))]
        ways += [(said, then) for said in rest if (then := self._before(task, said))]
        near = (self._clearance.until_near(here, line, at, most, self._own, *way) for way in ways)
        return min(near) - BEFORE

    def on_far_ways(
        self, here: Place, line: GuidanceLine, at: float, lane: float, combines: Mapping[int, PeerState]
    ) -> float:
        """How far along its way, from `at`, a cart keeps off the far ways of all combines [m]."""
        end = min(lane, line.length + LAST)
        return min(self.on_far_way(here, line, at, end, said) for said in combines.values())

    def on_far_way(self, here: Place, line: GuidanceLine, at: float, lane: float, peer: PeerState) -> float:
        """How far along its way, from `at`, a cart keeps off the far way that the combine drives to its next
        pass [m]; inf where it does so as far as LAST before the line beside the pass, `lane` [m], or behind
        the next LEAVES metres.
        """
        drives = peer.phase == Phase.TURNS and peer.speed > MOVES
        if not drives or self._clearance.way_to_next(here, peer) < FAR:
            return inf
        most = lane - LAST

        def until(begin: float) -> float:
            return self._clearance.until_near(here, line, begin, most, self._own, peer, clear=BY)

        free = until(at)
        if free < at + SHORT:  # it is on that way: does it leave it?
            return inf if until(at + LEAVES) >= most else at
        return free if free < most else inf


def _place(way: Way) -> Place:
    """Beside the pass, where a cart waits for its combine."""
    line = GuidanceLine(way.points.tolist(), "path")
    at = line.length - way.beside + AHEAD
    return Place(*line.point(at), line.heading(at))
