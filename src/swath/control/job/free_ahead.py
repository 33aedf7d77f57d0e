"""How far a cart may drive on along its way before a combine is in it, or will be."""

from collections.abc import Sequence
from math import inf

from swath.control.job.cart_ways import PULL_AHEAD
from swath.control.job.right_of_way import KEEP, KEEP_STRAIGHT, TURNS_ABOUT, Clearance
from swath.control.steer.guidance_line import GuidanceLine, wrapped
from swath.control.turns.dubins import Place
from swath.signals import PeerState

STRAIGHT_ON = 0.15  # rad, that a straight way may turn
BESIDE = 2.0  # m from the middle of a cart to the header beside which it drives, a little less


def free_ahead(
    clearance: Clearance,
    here: Place,
    line: GuidanceLine,
    at: float,
    lane: float,
    speed: float,
    peer: PeerState,
    rest: Sequence[PeerState],
    *,
    is_early: bool,
    to_next: bool,
) -> float:
    """Way [m] from `at` along a line, at a speed [m/s]; inf where all is free.

    lane: where the line beside the pass begins [m], inf = the way leads elsewhere; peer: the combine that it
    serves; rest: the others; is_early: that has not begun the pass yet; to_next: all of its way to it is kept
    free
    """
    in_lane, keep = at >= lane, BESIDE if _is_straight(line, at) else KEEP
    free = inf
    if is_early or not in_lane:
        until = line.length if in_lane else min(lane, line.length)
        free = clearance.way(here, line, at, until, peer, speed, to_next=to_next, keep=keep)
    for said in rest:
        between = KEEP_STRAIGHT if in_lane else keep
        way = clearance.way(here, line, at, line.length, said, speed, keep=between)
        free = min(free, way if in_lane else max(way - TURNS_ABOUT, 0.0))
    for said in (peer, *rest):
        free = min(free, clearance.before_standing(here, line, at, lane, said, keep))
    return free


def _is_straight(line: GuidanceLine, at: float) -> bool:
    """Whether a way begins straight on, past a combine beside it."""
    turned = wrapped(line.heading(at + PULL_AHEAD) - line.heading(at))
    return at < PULL_AHEAD and abs(turned) < STRAIGHT_ON
