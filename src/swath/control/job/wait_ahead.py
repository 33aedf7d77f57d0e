"""How far a cart drives that has set out to a pass which its combine has not begun."""

from collections.abc import Sequence
from math import inf

from swath.control.job.calls import Calls
from swath.control.job.cart_ways import BEGIN, STRAIGHT, Way
from swath.control.job.dubins import Place
from swath.control.job.passes import Pass, swings_out
from swath.control.job.right_of_way import Clearance, Outline
from swath.control.steer.guidance_line import GuidanceLine
from swath.signals import PeerState, Phase

AHEAD = STRAIGHT - BEGIN + 20.0  # m along the line beside a pass, where it waits for the combine to come up
NEARER = 30.0  # m that it comes at least, to set out
BEFORE = 6.0  # m before a place by which the combine comes, where it waits


class WaitAhead:
    """passes: of all combines; own: outline of the cart"""

    def __init__(self, passes: Sequence[Pass], own: Outline, clearance: Clearance, calls: Calls) -> None:
        self._passes, self._own, self._clearance, self._calls = passes, own, clearance, calls

    def is_clear(self, here: Place, way: Way, task: int, peer: PeerState) -> bool:
        """Whether its place beside the pass is off the combine's way till then."""
        if task <= peer.task:
            return True
        line = GuidanceLine(way.points.tolist(), "path")
        at = line.length - way.beside + AHEAD
        there = Place(*line.point(at), line.heading(at))
        between = self._calls.between(peer.task, task)
        return not self._clearance.comes_by(here, there, self._own, peer, between)

    def until(self, here: Place, way: Way, task: int, peer: PeerState, *, is_clear: bool) -> float:
        """How far it drives before the combine has begun the pass [m]; inf: to its place there, or as far as
        it keeps clear of the combine's way; 0 = it does not set out. is_clear: that place is, by `is_clear`

        To the next pass it may wait on the combine's way, but not behind a turn that swings out, nor set out
        while the combine is in that.
        """
        between = self._calls.between(peer.task, task)
        if task <= peer.task or (is_clear if between else not swings_out(self._passes[peer.task])):
            return inf
        if peer.phase == Phase.TURNS:
            return 0.0
        line = GuidanceLine(way.points.tolist(), "path")
        most = line.length - way.beside
        found = self._clearance.until_near(here, line, most, self._own, peer, between) - BEFORE
        return found if found >= NEARER else 0.0
