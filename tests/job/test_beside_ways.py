"""Carts and combines at the level with sensors: who waits, who drives off, who is called."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from swath.control.job import harvest
from swath.control.job.calls import Calls
from swath.control.job.cart_ways import ASIDE
from swath.control.job.ground import Ground
from swath.control.job.passes import Pass, swings_out
from swath.control.job.right_of_way import KEEP_STRAIGHT, Clearance, own_outline
from swath.control.job.ways import Search
from swath.control.steer.guidance_line import GuidanceLine, along_bends
from swath.control.steer.path import Segment
from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place
from swath.machine.machine_sheet import load_machine
from swath.signals import PeerState, Phase
from swath.tools.fleet import order
from swath.tools.fleet.order import DRIVES, LANDS, STANDS, WIDE, _way_through, crossings_of, ways_of
from swath.tools.fleet.uncut import uncut_before
from swath.tools.fleet.waits import Timing, at_pass_ends
from tests.job.test_whole_field import NORTH, Bench

CART = load_machine("tractor-grain-cart")
HEADER = {"header_width": 12.2, "header_front": 4.0, "header_left": 0.0}
CART_BODY = {"body_width": 2.5, "body_rear": -1.5, "body_front": 4.6}
BODY = {"body_width": 3.4, "body_rear": -5.0, "body_front": 4.0}
TO_THE_LEFT = (  # back on the other side of a cart that stands beside
    Pass(((0.0, 0.0), (0.0, 100.0)), turn=(Segment(40.0, np.pi / 40.0),)),
    Pass(((-25.5, 100.0), (-25.5, 0.0))),
)


def combine(own, at, phase, *, task=0, remaining=np.nan, speed=2.0, **told):
    """The message of a combine whose axle is at a place, as a cart hears it: x, y, heading of both."""
    c, s = np.cos(own.heading), np.sin(own.heading)
    dx, dy = at.x - own.x, at.y - own.y
    x, y = c * dx + s * dy, c * dy - s * dx
    return PeerState(
        0, True, 0.1, x, y, at.heading - own.heading, speed, 0.0, phase=phase, task=task, remaining=remaining,
        **HEADER, **BODY, **told,
    )  # fmt: skip


NORTHWARD = 0.5 * np.pi


@pytest.mark.parametrize(("passes", "x", "y", "is_in_way"), [
    (NORTH, -8.2, 84.0, False),  # beside the pass, where it broke off; the turn is to the right
    (NORTH, 6.0, 106.0, True),  # in the turn
    (NORTH, 12.7, 60.0, True),  # on the next pass
    (NORTH, 40.0, 60.0, False),
    (TO_THE_LEFT, -8.7, 106.0, True),
])  # fmt: skip
def test_a_cart_that_has_nothing_to_do_knows_that_it_is_in_the_way(passes, x, y, is_in_way):
    own = Place(x, y, NORTHWARD)
    said = combine(own, Place(0.0, 78.0, NORTHWARD), Phase.CUTS, remaining=18.0)
    assert Clearance(passes).is_soon_in_way(own, own_outline(CART), said) is is_in_way


@pytest.mark.parametrize(("x", "is_in_way"), [(0.0, True), (-9.0, False)])
def test_a_cart_ahead_in_the_pass_of_another_combine_is_in_the_way(x, is_in_way):
    """Not in that of its own one, where it waits to be come up to."""
    own = Place(x, 60.0, NORTHWARD)
    said = combine(own, Place(0.0, 0.0, NORTHWARD), Phase.CUTS, remaining=96.0)
    clearance, outline = Clearance(NORTH), own_outline(CART)
    assert clearance.is_soon_in_way(own, outline, said, in_pass=True) is is_in_way
    assert not clearance.is_soon_in_way(own, outline, said)


def test_a_cart_near_to_a_combine_that_stands_in_its_turn_is_in_the_way():
    own = Place(-20.0, 95.0, NORTHWARD)
    moves, stands = (combine(own, Place(0.0, 100.0, 1.0), Phase.TURNS, speed=v) for v in (1.5, 0.0))
    clearance, outline = Clearance(NORTH), own_outline(CART)
    assert not clearance.is_soon_in_way(own, outline, moves)
    assert clearance.is_soon_in_way(own, outline, stands)


def test_a_cart_that_waits_for_the_next_pass_keeps_all_of_the_way_there_free():
    """Along the line beside the next pass, which leads over the present one: as far as the combine comes."""
    passes = (Pass(((0.0, 0.0), (0.0, 100.0))), Pass(((11.9, 100.0), (11.9, 0.0))))
    own, line = Place(3.0, 130.0, -NORTHWARD), GuidanceLine([(3.0, 130.0), (3.0, 0.0)])
    said = combine(own, Place(0.0, 20.0, NORTHWARD), Phase.CUTS, remaining=76.0)
    clearance = Clearance(passes)
    assert clearance.way(own, line, 0.0, 130.0, said, 4.0) == np.inf  # the next 30 m of it are free
    free = clearance.way(own, line, 0.0, 130.0, said, 4.0, to_next=True)
    assert 0.0 <= free < 30.0


def test_a_combine_stops_in_its_turn_before_a_cart():
    """And goes on when that is gone; one that is beside does not stop it."""
    bench = Bench(NORTH)
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.2)
    assert bench.step(100.5, 0.2).phase == Phase.TURNS
    stopped = bench.step(100.6, 0.2, peer=(11.0, -4.0))
    assert (stopped.phase, stopped.speed) == (Phase.TURNS, 0.0)
    assert bench.step(100.6, 0.2, peer=(0.0, 9.0)).speed > 1.0
    assert bench.step(100.6, 0.2, peer=(60.0, 0.0)).speed > 1.0


@pytest.mark.parametrize(("speed", "away", "goes"), [
    (0.0, 36.0, False), (0.0, 50.0, True), (1.5, 36.0, True), (1.5, 16.0, False),
])  # fmt: skip
def test_a_combine_sets_off_in_its_turn_when_no_cart_comes_by_soon(speed, away, goes):
    """One at 4 m/s, across ahead of it, which lets a combine that stands be."""
    bench = Bench(NORTH)
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.2)
    assert bench.step(100.5, 0.2).phase == Phase.TURNS
    across = {"speed": 4.0, "heading": 0.5 * np.pi, "phase": int(Phase.DRIVES), **CART_BODY}
    job = bench.step(100.6, 0.2, peer=(8.0, 4.0 - away), told=across, speed=speed)
    assert job.phase == Phase.TURNS
    assert (job.speed > 0.0) is goes


def test_before_passes_without_a_cart_it_unloads_standing():
    """Where the tank would be full in them by what this pass has brought: it waits at its end for a cart."""
    blind = (NORTH[0], replace(NORTH[1], cart_beside=False))
    for passes, level, stands in ((blind, 0.6, True), (blind, 0.4, False), (NORTH, 0.6, False)):
        bench = Bench((*passes, NORTH[0]), call_percent=90.0)
        for north in np.arange(1.0, 100.2, 0.5):
            bench.step(north, level * north / 100.0)
        job = bench.step(100.35, level)
        assert (job.phase == Phase.STANDS) is stands
        assert job.may_unload is stands
        assert job.calls or not stands
        if stands:
            assert bench.step(100.35, 0.3, flow=92.0).phase == Phase.STANDS  # it fits, but grain flows
            phases = [bench.step(100.35, 0.3).phase for _ in range(20)]
            assert phases[-1] == Phase.TURNS


def test_a_cart_is_called_so_that_it_comes_to_the_last_pass_in_which_it_can_pour(monkeypatch):
    """What is left of this pass, the next one beside which a cart can be, and those after it without one."""
    monkeypatch.setattr(harvest, "CALLS_AHEAD", 0.0)
    first, then = (replace(work, cart_beside=False) for work in NORTH)
    for passes, brings, calls in (
        ((first, NORTH[1], NORTH[0]), 0.4, False),  # 0.24 + 0.16 + 0.4 at the end of the second
        ((first, NORTH[1], NORTH[0]), 0.7, True),
        ((first, NORTH[1], first, NORTH[1]), 0.4, True),
        ((NORTH[0], NORTH[1]), 0.7, False),  # in this one
        ((NORTH[0], then, NORTH[0]), 0.7, True),
    ):
        bench = Bench(passes, call_percent=95.0)
        for north in np.arange(1.0, 60.2, 0.5):
            job = bench.step(north, brings * north / 100.0)
        assert bool(job.calls) is calls


@pytest.mark.parametrize(("passes", "brings", "stands_in"), [
    ((*NORTH, *NORTH), 0.8, 41.8),  # full: 40 m, a turn of 20 m, 21 % of the next pass
    ((NORTH[0], replace(NORTH[1], cart_beside=False), *NORTH), 0.6, 20.6),  # at its end, before one without
    ((*NORTH, *NORTH, *NORTH), 0.2, 239.2),  # full in the fifth pass
])  # fmt: skip
def test_a_cart_is_called_before_the_combine_stands_for_it(passes, brings, stands_in):
    bench = Bench(passes, call_percent=95.0)
    for north in np.arange(1.0, 60.2, 0.5):
        job = bench.step(north, brings * north / 100.0)
    assert job.stands_in == pytest.approx(stands_in, abs=4.0)
    assert bool(job.calls) is (stands_in < harvest.CALLS_AHEAD)


def test_a_combine_whose_cart_has_left_does_not_call_before_its_tank_fills_up():
    bench = Bench((*NORTH, *NORTH, *NORTH), call_percent=60.0)
    beside = {"phase": Phase.BESIDE, "task": 0}
    for north in np.arange(1.0, 60.2, 0.5):
        job = bench.step(north, 0.002 * north)
    assert not job.calls
    assert bench.step(60.5, 0.61).calls
    assert bench.step(61.0, 0.1, told=beside).calls  # until its tank is empty
    assert not bench.step(61.5, 0.1, told={**beside, "task": -1}).calls


@pytest.mark.parametrize(("level", "calls"), [(0.03, True), (0.01, False)])
def test_driving_a_combine_needs_its_cart_no_more_with_an_empty_tank(level, calls):
    """Standing until the last of it is in the cart."""
    bench, beside = Bench((*NORTH, *NORTH, *NORTH), call_percent=60.0), {"phase": Phase.BESIDE, "task": 0}
    for north in np.arange(1.0, 60.2, 0.5):
        bench.step(north, 0.61, told=beside)
    assert bench.step(61.0, level, told=beside).calls == calls
    bench.step(61.5, 0.98, told=beside)
    assert bench.step(61.5, 0.97, told=beside, flow=92.0).phase == Phase.STANDS
    assert bench.step(61.5, level, told=beside, flow=92.0).calls


@pytest.mark.parametrize(("brings", "stands"), [(0.8, True), (0.3, False)])
def test_a_combine_tells_before_the_end_of_a_pass_that_it_will_stand_there(brings, stands):
    """Beside the boundary, too, where no grain is poured before it stands: a cart on its way comes on."""
    edge = Pass(((0.0, 0.0), (0.0, 100.0)), cart_beside=False, cart_standing=True, turn=NORTH[0].turn)
    bench = Bench((edge, replace(NORTH[1], cart_beside=False), NORTH[0]))
    may = [bench.step(north, brings * north / 100.0).may_unload for north in np.arange(1.0, 99.2, 0.5)]
    assert not any(may[:140])
    assert bool(may[-1]) is stands


def test_beside_the_boundary_a_cart_is_poured_into_standing_only():
    bench = Bench((Pass(((0.0, 0.0), (0.0, 100.0)), cart_beside=False, cart_standing=True), NORTH[1]))
    assert not bench.step(40.0, 0.5).may_unload
    full = bench.step(41.0, 0.98)
    assert (full.phase, full.may_unload) == (Phase.STANDS, True)
    assert bench.step(41.0, 0.5, flow=92.0).phase == Phase.STANDS  # until the pipe is dry
    assert bench.step(41.0, 0.3).phase == Phase.CUTS
    assert bench.part.end_reason(0) == ""


@pytest.mark.parametrize("most", [0.5, 0.98])
def test_what_is_left_behind_the_last_pass_goes_into_a_cart(most):
    """Where a cart comes only while it stands, too: also if it has stood there full before."""
    bench = Bench((Pass(((0.0, 0.0), (0.0, 100.0)), cart_beside=False, cart_standing=True),))
    bench.step(40.0, most)
    assert bench.step(41.0, 0.1).phase == Phase.CUTS
    for north in np.arange(42.0, 100.6, 0.5):
        job = bench.step(north, 0.2)
    assert (job.phase, job.calls, job.may_unload) == (Phase.STANDS, True, True)
    for _ in range(20):
        job = bench.step(100.4, 0.0)
    assert not job.calls
    assert job.phase != Phase.STANDS


def test_on_the_straights_of_a_long_way_it_drives_as_in_transport():
    far = Pass(((0.0, 0.0), (0.0, 100.0)), turn=(Segment(20.0), Segment(11.0, np.pi / 11.0), Segment(250.0)))
    near = replace(far, turn=(Segment(20.0), Segment(11.0, np.pi / 11.0), Segment(10.0)))
    for work, fastest in ((far, 12.0), (near, 7.0)):
        bench = Bench((work, NORTH[1]))
        for north in np.arange(1.0, 100.2, 0.5):
            bench.step(north, 0.0, peer=(-300.0, 0.0))
        speeds = [
            bench.step(north, 0.0, peer=(-300.0, 0.0)).speed * 3.6 for north in np.arange(100.5, 124.0, 0.5)
        ]
        assert speeds[0] == pytest.approx(fastest)
        assert speeds[-1] == pytest.approx(7.0)  # into the bend
        assert all(a >= b for a, b in pairwise(speeds))


CORNER = (
    Pass(((0.0, 0.0), (0.0, 100.0))),
    Pass(((5.0, 100.0), (90.0, 100.0))),
    Pass(((50.0, 0.0), (50.0, 90.0)), combine=1),
)


def test_who_stands_for_it_is_served_first():
    calls = Calls(CORNER, 15.0)
    said = combine(Place(0.0, 0.0, 0.0), Place(60.0, 0.0, 0.0), Phase.CUTS, remaining=50.0, calls=True)
    both = {0: said, 1: replace(said, task=2)}
    assert calls.neediest(10.0, both, [])[0] == 0
    both[1] = replace(both[1], phase=int(Phase.STANDS), may_unload=True)
    assert calls.neediest(12.0, both, []) == (1, 2.0)


@pytest.mark.parametrize(("stand_in", "more", "first"), [
    ((200.0, 100.0), 0.0, 1),  # the second would stand for 100 s, if it was not first
    ((100.0, 200.0), 0.0, 0),
    ((100.0, 200.0), 400.0, 0),  # the second can wait, though it has more to do
    ((140.0, 200.0), 400.0, 0),
    ((30.0, 30.0), 400.0, 1),  # both would stand: who has 200 s more to do does not
    ((np.nan, 200.0), 0.0, 1),  # the first one's tank does not fill up
])  # fmt: skip
def test_who_is_served_first(stand_in, more, first):
    """By when all are done, from when each would stand and what it has still to do."""
    there = Pass(((50.0, 0.0), (50.0, 100.0)), combine=1), Pass(((60.0, 0.0), (60.0, more)), combine=1)
    here = Pass(((0.0, 0.0), (0.0, 100.0))), Pass(((10.0, 0.0), (10.0, 0.01)))
    calls = Calls([here[0], there[0], here[1], there[1]], 15.0)
    own = Place(0.0, 0.0, 0.0)
    both = {
        k: combine(own, Place(90.0, 0.0, 0.0), Phase.CUTS, task=k, remaining=90.0, calls=True, stands_in=s)
        for k, s in enumerate(stand_in)
    }
    assert calls.neediest(10.0, both, [])[0] == first


@pytest.mark.parametrize(("turn", "stand_in", "alone", "first"), [
    (180.0, 400.0, 0, 1), (20.0, 400.0, 0, 0),  # on the way to the next pass, in which a cart can be beside
    (500.0, 400.0, -1, 1),  # later
    (500.0, 40.0, 0, 0),  # it stands before that
])  # fmt: skip
def test_a_cart_serves_another_one_before_it_would_wait_for_the_next_pass(turn, stand_in, alone, first):
    """Though the first one is as near, has called longer, and would stand before the other one."""
    blind = replace(NORTH[0], cart_beside=False, cart_standing=True, turn=(Segment(turn),))
    other = Pass(((50.0, 0.0), (50.0, 300.0)), combine=1)
    calls, own = Calls([blind, other, NORTH[1]], 15.0), Place(0.0, 0.0, 0.0)
    said = [
        combine(own, Place(60.0, 0.0, 0.0), Phase.CUTS, task=k, remaining=left, calls=True, stands_in=s)
        for k, (left, s) in enumerate([(90.0, stand_in), (250.0, 300.0)])
    ]
    assert calls.neediest(10.0, {0: said[0]}, [])[0] == alone
    assert calls.neediest(12.0, dict(enumerate(said)), [])[0] == first


@pytest.mark.parametrize(("away", "speed", "stand_in", "first"), [
    (10.0, 2.0, (30.0, 200.0), -1),  # its cart waits until it has driven off
    (10.0, 0.0, (30.0, 200.0), 1),  # it waits in its turn for another combine
    (20.0, 2.0, (30.0, 200.0), 0),
    (10.0, 2.0, (300.0, 20.0), 1),  # the other one needs a cart sooner
])  # fmt: skip
def test_a_cart_waits_for_a_combine_that_drives_off(away, speed, stand_in, first):
    """In its turn it is beside it still, and sets out when that is 16 m away: not to another one."""
    other = Pass(((50.0, 0.0), (50.0, 100.0)), combine=1)
    calls = Calls([NORTH[0], other, NORTH[1]], 15.0)
    own = Place(0.0, 0.0, 0.0)
    here, there = Place(away, 0.0, 0.0), Place(90.0, 0.0, 0.0)
    turns = combine(own, here, Phase.TURNS, task=0, speed=speed, calls=True, stands_in=stand_in[0])
    cuts = combine(own, there, Phase.CUTS, task=1, remaining=90.0, calls=True, stands_in=stand_in[1])
    assert calls.neediest(10.0, {0: turns, 1: cuts}, [])[0] == first


@pytest.mark.parametrize(("remaining", "first"), [(60.0, 1), (20.0, -1)])
def test_a_combine_that_goes_on_in_a_pass_without_a_cart_is_not_waited_for(remaining, first):
    """On a small field all are near; at the end of the pass it will soon be elsewhere."""
    blind, other = replace(NORTH[0], cart_beside=False), Pass(((50.0, 0.0), (50.0, 100.0)), combine=1)
    calls, own = Calls([blind, other, NORTH[1]], 15.0), Place(0.0, 0.0, 0.0)
    there = Place(30.0, 0.0, 0.0), Place(90.0, 0.0, 0.0)
    both = {
        k: combine(own, there[k], Phase.CUTS, task=k, remaining=left, calls=True, stands_in=stands_in)
        for k, (left, stands_in) in enumerate([(remaining, 30.0), (90.0, 200.0)])
    }
    assert calls.neediest(10.0, both, [])[0] == first


@pytest.mark.parametrize(("passes", "x", "y", "comes"), [
    (NORTH, 12.7 + 8.7 + 0.7, 85.0, False),  # beside the next pass
    (NORTH, 3.0, 85.0, True),  # beside the next pass back on the left of this one: it is cut now
    (CORNER, 30.0, 108.7, False),
    (CORNER, 4.0, 102.0, True),
])  # fmt: skip
def test_where_a_cart_waits_for_the_next_pass_the_combine_does_not_come_by(passes, x, y, comes):
    here, there = Place(-30.0, 20.0, NORTHWARD), Place(x, y, -NORTHWARD)
    said = combine(here, Place(0.0, 40.0, NORTHWARD), Phase.CUTS, remaining=56.0)
    assert Clearance(passes).comes_by(here, there, own_outline(CART), said) is comes


def test_a_turn_that_swings_out():
    loop = replace(CORNER[0], turn=(Segment(10.0), Segment(44.0, 1.5 * np.pi / 44.0)))
    assert swings_out(loop)
    assert not swings_out(NORTH[0])


def test_a_cart_sets_out_for_one_of_the_next_two_passes():
    """In which it can be poured into driving; else for the next one, where it can stand."""
    own = Place(-30.0, 60.0, NORTHWARD)
    turns = combine(own, Place(0.0, 100.0, NORTHWARD), Phase.TURNS)
    blind, standing = (replace(NORTH[1], cart_beside=False, cart_standing=v) for v in (False, True))
    for passes, task in (
        (NORTH, 1), ((NORTH[0], blind, NORTH[0]), 2), ((NORTH[0], standing, NORTH[0]), 2),
        ((NORTH[0], standing, blind), 1), ((NORTH[0], blind, blind, NORTH[0]), -1),
    ):  # fmt: skip
        assert Calls(passes, 15.0).next_task(turns) == task
    assert Calls((*NORTH, *NORTH), 15.0).between(0, 3) == [1, 2]


@pytest.mark.parametrize(("away", "remaining", "speed", "task"), [
    (60.0, 130.0, 2.0, 0), (60.0, 100.0, 2.0, 1),  # behind it
    (60.0, 100.0, 1.0, 0), (60.0, 31.0, 0.0, 0),
    (-60.0, 180.0, 2.0, 0), (-60.0, 160.0, 2.0, 1),  # ahead
])  # fmt: skip
def test_a_cart_that_would_come_too_late_sets_out_for_the_next_pass(away, remaining, speed, task):
    """It drives 3 m/s, and needs 20 s more to come up, from ahead 50 s; 30 m of the pass are left then."""
    long = tuple(Pass(((x, 0.0), (x, 300.0))) for x in (0.0, 8.7))
    own = Place(0.0, 300.0 - remaining - away, NORTHWARD)
    said = combine(own, Place(0.0, 300.0 - remaining, NORTHWARD), Phase.CUTS, remaining=remaining)
    assert Calls(long, 15.0).next_task(replace(said, speed=speed)) == task
    assert Calls(long[:1], 15.0).next_task(replace(said, speed=speed)) == 0  # there is no other one


@pytest.mark.parametrize(("stands_in", "task"), [(31.0, 0), (20.0, 0), (45.0, 2), (np.nan, 2)])
def test_a_cart_sets_out_to_the_pass_in_which_the_combine_will_stand(stands_in, task):
    """It has 60 m of it to go, 30.9 s: too few to be joined while it drives on, to the next but one."""
    lines = (((x, 0.0), (x, 300.0)) for x in (0.0, 12.7, 25.4))
    passes = [Pass(line, cart_beside=i != 1) for i, line in enumerate(lines)]
    own = Place(-60.0, 0.0, NORTHWARD)
    said = combine(own, Place(0.0, 236.0, NORTHWARD), Phase.CUTS, remaining=60.0, calls=True)
    assert Calls(passes, 25.0).next_task(replace(said, stands_in=stands_in)) == task


def test_a_place_that_an_earlier_pass_leads_over_is_not_free():
    passes = (*NORTH, Pass(((24.0, 0.0), (24.0, 100.0))))
    here, there = Place(-30.0, 20.0, NORTHWARD), Place(24.0 - 8.7, 20.0, NORTHWARD)
    said = combine(here, Place(0.0, 40.0, NORTHWARD), Phase.CUTS, remaining=56.0)
    clearance, outline = Clearance(passes), own_outline(CART)
    assert not clearance.comes_by(here, there, outline, said)
    assert clearance.comes_by(here, there, outline, said, [1])


def test_waits_on_a_long_way_are_moved_to_the_end_of_the_pass():
    """Where both come to their ends then, too, and not where each would wait for the other one for good."""
    long, back = Pass(((0.0, 0.0), (0.0, 60.0))), Pass(((300.0, 60.0), (300.0, 0.0)))
    other = Pass(((150.0, 110.0), (150.0, -40.0)), combine=1)
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    ways = ways_of((long, other, back), combines, [4.0, 4.0], [20.0, 20.0])
    assert crossings_of(ways, combines)  # the ways cross
    timing = Timing(ways)
    routes = {task: route for own in ways.routes for task, route in own.items()}
    length = ways.routes[0][0].length
    rule = {"task": 0, "way_m": length + 100.0, "other": 1, "other_m": 30.0}
    moved, end = at_pass_ends([{"first": [rule]}], routes, timing)
    assert moved == [{"first": [{**rule, "wait_m": round(length - 0.5, 3)}]}]
    assert timing.least < end < 1.02 * timing.end([timing.wait(rule)])
    # the other one waits for it to come beyond that end: it stays
    answer = {"task": 1, "way_m": 10.0, "other": 0, "other_m": length + 50.0}
    both = [{"first": [rule]}, {"first": [answer]}]
    assert at_pass_ends(both, routes, timing)[0] == both
    assert timing.end([timing.wait({**rule, "wait_m": length}), timing.wait(answer)]) == np.inf


@pytest.mark.parametrize("beside", [True, False])
def test_a_combine_between_two_passes_keeps_off_a_cart_beside_another_one(beside):
    """The cart reaches 5.2 m farther ahead than the header beside which it drives."""
    up, beyond = Pass(((0.0, 0.0), (0.0, 60.0)), cart_beside=beside), 67.5
    first, then = ((-60.0, beyond), (-40.0, beyond)), ((20.0, beyond), (40.0, beyond))
    passes = up, Pass(first, turn=(Segment(60.0),), combine=1), Pass(then, combine=1)
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    ways = ways_of(passes, combines, [4.0, 4.0], [2.0, 20.0])
    assert not crossings_of(ways, combines)
    assert bool(crossings_of(ways, combines, with_carts=True)) is beside


@pytest.mark.parametrize("room", [0.5, 1.0, 1.5, 2.0, 2.3, 2.4, 2.7, 3.0])
def test_a_cart_comes_by_a_combine_that_stands_between_two_passes_where_the_plan_lets_it(room):
    """Along the pass of another one, also on the line farther out. room: from the middle of the cart there to
    the header [m]
    """
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    sheet, line = combines[0].sheet, combines[0].pipe + LANDS + ASIDE
    x = -(line + room + 0.5 * sheet.header_width)
    turn = (Segment(300.0),)
    passes = (
        Pass(((0.0, 0.0), (0.0, 100.0))),
        Pass(((x, 240.0), (x, 220.0)), turn=turn, combine=1), Pass(((x, -80.0), (x, -100.0)), combine=1),
    )  # fmt: skip
    ways = ways_of(passes, combines, [4.0, 4.0], [20.0, 20.0])
    assert crossings_of(ways, combines) == []
    lets = crossings_of(ways, combines, with_carts=True) == []
    here = Place(-line, 20.0, NORTHWARD)
    said = combine(here, Place(x, 40.0, -NORTHWARD), Phase.TURNS, task=1, speed=0.0)
    said = replace(said, header_width=sheet.header_width)
    straight = GuidanceLine([(-line, 0.0), (-line, 100.0)])
    free = Clearance(passes).way(here, straight, 20.0, 100.0, said, 3.0, keep=KEEP_STRAIGHT)
    assert free == np.inf or not lets
    assert (free < np.inf) is (room < KEEP_STRAIGHT)
    assert lets is (room > 0.5 * WIDE + order.APART)


@pytest.mark.parametrize(("beyond", "standing", "meet"), [
    (80.0, True, True), (80.0, False, False), (100.0, True, False)
])  # fmt: skip
def test_a_combine_keeps_off_the_line_on_which_a_cart_leaves_another_one(beyond, standing, meet):
    """30 m ahead of the end of a pass; in a pass of its own, too."""
    up = Pass(((0.0, 0.0), (0.0, 60.0)), cart_beside=False, cart_standing=standing)
    passes = up, Pass(((-60.0, beyond), (60.0, beyond)), combine=1, cart_beside=False)
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    ways = ways_of(passes, combines, [4.0, 4.0], [2.0, 20.0])
    assert not crossings_of(ways, combines)
    assert bool(crossings_of(ways, combines, with_carts=True)) is meet


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("drives", [True, False])
def test_crop_is_cut_before_where_a_cart_is_to_come(first, drives):
    """By the pass on the left, as far as the cart reaches and a little more, if that is begun before.

    drives: beside the combine; else only while that stands
    """
    left, right = ((-4.3, 0.0), (-4.3, 100.0)), ((0.0, 0.0), (0.0, 100.0))
    lines = (left, right) if first == 0 else (right, left)
    told = {"cart_beside": drives, "cart_standing": not drives}
    passes = tuple(Pass(line, combine=int(line is right), **told) for line in lines)
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    ways = ways_of(passes, combines, [4.0, 4.0], [20.0, 20.0])
    mask, its = uncut_before(ways, combines, 0, 1), ways.samples[1]
    j = int(np.searchsorted(its.way, 20.0))
    cut = ways.samples[0].way[~mask[:, j]].min()  # as far as the other one's knife has come then at least
    axle = its.way[j] - combines[1].sheet.knife_x
    assert cut == pytest.approx(axle + 35.0 if first == 0 else -4.0, abs=2.1)  # m from sample to sample
    assert not mask[:, its.turns].any()


@pytest.mark.parametrize("standing", [True, False])
def test_beside_the_end_of_a_last_pass_crop_is_cut_whenever_that_is_begun(standing):
    """Of another combine: there it stands until a cart has come."""
    last = Pass(((0.0, 0.0), (0.0, 100.0)), combine=1, cart_beside=False, cart_standing=standing)
    passes = last, Pass(((-4.3, 0.0), (-4.3, 100.0)))
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    ways = ways_of(passes, combines, [4.0, 4.0], [20.0, 20.0])
    mask, its = uncut_before(ways, combines, 0, 1), ways.samples[1]
    before, end = (int(np.searchsorted(its.way, way)) for way in (50.0, 93.0))
    assert not mask[:, before].any()
    assert bool(mask[:, end].any()) is standing
    assert not standing or ways.samples[0].way[~mask[:, end]].min() > 90.0


@pytest.mark.parametrize(("apart", "is_free"), [(0.9, False), (1.7, True)])
def test_crop_is_cut_before_where_the_wheels_of_a_cart_are(apart, is_free):
    """Not on the line along its middle alone: the strip of the other pass begins `apart` left of that."""
    combines = [_Combine(load_machine("combine-5m")) for _ in range(2)]
    x = -(combines[1].pipe + LANDS + apart + 0.5 * combines[0].sheet.header_width)
    passes = (
        Pass(((x, 0.0), (x, 100.0))),
        Pass(((0.0, 0.0), (0.0, 100.0)), combine=1),
    )
    ways = ways_of(passes, combines, [4.0, 4.0], [20.0, 20.0])
    mask = uncut_before(ways, combines, 0, 1)
    assert not mask.any() if is_free else mask.any()


def test_a_combine_that_is_to_wait_does_so_in_a_pass_before_a_turn():
    """Where that takes no longer for both. Samples 4 to 7 of the first are between two passes."""
    blocked = np.zeros((12, 12), dtype=bool)
    blocked[6:9, 2:9] = True
    plain, turning = np.full(12, DRIVES), np.where((np.arange(12) > 3) & (np.arange(12) < 8), STANDS, DRIVES)
    for costs, allowed in ((turning, {0, 1, 2, 3}), (plain, set(range(12)))):
        way = _way_through(blocked, (costs.astype(np.int32), plain.astype(np.int32)))
        assert len(way) == 15  # three steps more than without the others: as few as it takes
        assert not blocked[way[:, 0], way[:, 1]].any()
        assert {i for (i, _), (then, _) in pairwise(way.tolist()) if then == i} <= allowed


class _Combine:
    def __init__(self, sheet):
        self.sheet, self.turn_speed, self.transport = sheet, 1.94, 3.33
        self.pipe = sheet.pipe.y + sheet.pipe.length


def test_a_long_way_along_a_field_is_found():
    """600 m against directions that steps of the search do not have: with more weight on what is left."""
    ground = Ground([(0.0, 0.0), (590.0, 27.0), (546.0, 182.0), (0.0, 182.0)])
    for line in (((0.0, 5.9), (590.0, 33.0)), ((5.9, 0.0), (5.9, 182.0)), ((0.0, 176.0), (546.0, 176.0))):
        ground.cut(line, 12.2)
    search = Search(ground, ground.clear_of(2.0), ground.clear_of(1.2), 9.0)
    start, goal = Place(505.3, -14.99, -0.0353), Place(-2.35, 141.96, NORTHWARD)
    way = search.way(start, [goal])
    points = np.array(along_bends(*start, bends_of(way, 9.0)))
    assert points[-1] == pytest.approx(goal[:2], abs=1e-6)
    assert not any(ground.is_in(ground.crop, *point) for point in points.tolist())
    assert np.hypot(*np.diff(points, axis=0).T).sum() < 900.0


@pytest.mark.parametrize(("x", "y", "heading", "phase", "stops"), [
    (14.0, 2.0, 0.0, Phase.WAITS, True),
    (13.0, -8.0, 1.8, Phase.DRIVES, True),  # across, into its way
    (30.0, 2.0, 0.0, Phase.WAITS, False),
    (8.0, 8.0, 0.05, Phase.DRIVES, False),  # on the line beside
    (2.0, 7.6, 0.6, Phase.BESIDE, False),
])  # fmt: skip
def test_a_combine_does_not_cut_into_a_cart(x, y, heading, phase, stops):
    bench = Bench(NORTH)
    for north in np.arange(1.0, 40.0, 0.5):
        bench.step(north, 0.2)
    told = {"heading": heading, "phase": int(phase), "task": 0, **CART_BODY}
    job = bench.step(40.0, 0.2, peer=(x, y), told=told)
    assert job.phase == Phase.CUTS
    assert (job.speed == 0.0) is stops


@pytest.mark.parametrize(("other", "dry_for", "phase"), [
    (Phase.CUTS, 20.0, Phase.TURNS), (Phase.CUTS, 60.0, Phase.DONE), (Phase.DONE, 20.0, Phase.DONE),
])  # fmt: skip
def test_before_a_combine_that_still_works_it_lets_a_cart_drive_off_and_drives_on_then(other, dry_for, phase):
    """Where it stands the other one, on the pass beside, would come by its header."""
    bench = Bench((*NORTH[:1], Pass(((-12.0, 0.0), (-12.0, 100.0)), combine=1)))
    works = combine(Place(0.0, 96.0, 0.5 * np.pi), Place(-12.0, 40.0, 0.5 * np.pi), other, task=1)
    near = (9.0, load_machine("lexion-700").header_width / 2.0 + 1.35)
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.02, flow=92.0, peer=near, others=(works,))
    for _ in range(round(10.0 * dry_for)):
        job = bench.step(100.5, 0.0, peer=near, others=(works,), speed=0.0)
    assert (job.phase, job.speed) == (phase, 0.0)
    drives_on = bench.step(100.5, 0.0, peer=(-30.0, 8.0), others=(works,), speed=0.0).speed > 0.0
    assert drives_on is (phase == Phase.TURNS)
