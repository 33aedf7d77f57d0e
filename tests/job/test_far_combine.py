"""Carts beside a combine that drives a far way, that stands for them, or that has cut its last pass."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.job import cart_ways, wait_ahead
from swath.control.job.calls import Calls
from swath.control.job.cart_ways import CartWays
from swath.control.job.passes import Pass
from swath.control.job.right_of_way import SHORT, Clearance, outline_of, own_outline, place_of
from swath.control.job.wait_ahead import WaitAhead
from swath.control.steer.guidance_line import GuidanceLine
from swath.control.steer.path import Segment
from swath.control.turns.dubins import Place
from swath.signals import Phase
from tests.job.test_beside_ways import CART, NORTHWARD, combine
from tests.job.test_cart_alone import CartBench
from tests.job.test_whole_field import NORTH

RING_NORTH = ((-6.0, 0.0), (19.0, 0.0), (19.0, 100.0), (-6.0, 100.0))
RING = ((10.0, 0.0), (300.0, 0.0), (300.0, 100.0), (10.0, 100.0))
ARC = 1.0 / 6.0  # 1/m
BACK = (  # the west side; east along the south side, back outside of it, north: axle 4 m behind the knife
    Pass(((16.0, 0.0), (16.0, 100.0))),
    Pass(
        ((40.0, 6.0), (300.0, 6.0)),
        cart_beside=False,
        turn=(Segment(np.pi / ARC, -ARC), Segment(262.0), Segment(0.5 * np.pi / ARC, -ARC)),
    ),
    Pass(((28.0, 4.0), (28.0, 100.0))),
)
WESTWARD = np.pi
LOOP = (  # the east side; west, back east outside of the field, round a loop on cut ground to the next pass
    Pass(((294.0, 0.0), (294.0, 100.0))),
    Pass(
        ((282.0, 6.0), (20.0, 6.0)),
        cart_beside=False,
        turn=(Segment(np.pi / ARC, ARC), Segment(270.0), Segment(12.0 * np.pi, 1.0 / 12.0)),
    ),
    Pass(((282.0, 18.0), (20.0, 18.0))),
)


def on_the_strip(points, beyond=8.0):
    """Which points lie on the far way back, 40 m off its ends."""
    return (points[:, 0] > 60.0) & (points[:, 0] < 256.0) & (np.abs(points[:, 1] + 6.0) < beyond)


@pytest.mark.parametrize(("speed", "phase", "keeps_off"), [
    (3.0, Phase.TURNS, True),
    (3.0, Phase.DONE, False),
])  # fmt: skip
def test_a_way_keeps_off_the_far_way_of_a_combine(speed, phase, keeps_off):
    """To the other end of the field, along its side."""
    ways = CartWays(BACK, RING, 12.2, 8.2, 9.0, [(-20.0, 50.0)])
    here = Place(250.0, -24.0, WESTWARD)
    said = combine(here, Place(285.0, -6.0, WESTWARD), phase, task=1, speed=speed)
    way = ways.to_place(here, (-20.0, 50.0), said)
    fine = np.array([GuidanceLine(way.points.tolist()).point(at) for at in np.arange(0.0, 250.0, 1.0)])
    assert not on_the_strip(fine).any() or not keeps_off
    # close to the field it is the shorter one
    assert (way.points[:, 1][way.points[:, 0] > 60.0].max() > -12.0) is not keeps_off


@pytest.mark.parametrize(("within", "along"), [(cart_ways.GETS_OUT, False), (cart_ways.BEGINS, True)])
def test_a_cart_in_a_loop_of_a_combine_gets_out_across_its_way(within, along, monkeypatch):
    """Not towards the combine, before which it would come to stand."""
    monkeypatch.setattr(cart_ways, "GETS_OUT", within)
    ring, goal = ((0.0, 0.0), (300.0, 0.0), (300.0, 100.0), (0.0, 100.0)), (120.0, -40.0)
    ways = CartWays(LOOP, ring, 12.2, 8.2, 9.0, [goal])
    here = Place(296.0, 14.0, -NORTHWARD)
    said = combine(here, Place(200.0, -6.0, 0.0), Phase.TURNS, task=1, speed=3.0)
    line = GuidanceLine(ways.to_place(here, goal, said).points.tolist())
    fine = np.array([line.point(at) for at in np.arange(0.0, line.length, 1.0)])
    assert bool(on_the_strip(fine).any()) is along


@pytest.mark.parametrize(("passes", "at", "speed", "phase", "is_found"), [
    (BACK, Place(280.0, -6.0, WESTWARD), 3.0, Phase.TURNS, True),
    (BACK, Place(280.0, -6.0, WESTWARD), 0.0, Phase.TURNS, False),  # it stands
    (BACK, Place(200.0, 6.0, 0.0), 3.0, Phase.CUTS, False),
    (BACK, Place(60.0, -6.0, WESTWARD), 3.0, Phase.TURNS, False),  # gone by
    (NORTH, Place(0.0, 103.0, NORTHWARD), 3.0, Phase.TURNS, False),  # no far way
])  # fmt: skip
def test_a_cart_looks_whether_a_far_way_leads_along_its_own(passes, at, speed, phase, is_found):
    task = len(passes) - 2
    ahead = WaitAhead(passes, own_outline(CART), Clearance(passes), Calls(passes, 15.0))
    here = Place(100.0, -30.0, 0.0)
    line = GuidanceLine([(100.0, -30.0), (130.0, -6.0), (240.0, -6.0), (240.0, -60.0)])
    until = ahead.on_far_way(here, line, 0.0, line.length, combine(here, at, phase, task=task, speed=speed))
    assert (until < np.inf) is is_found
    if is_found:
        x, y = line.point(until)
        assert 100.0 <= x < 130.0
        assert y < -6.0 - 6.1 - 2.0  # off the header


def test_a_cart_that_drives_on_a_far_way_gets_out_of_it(monkeypatch):
    """The combine begins its way back behind it; the turn is taken for one that does not swing out."""
    monkeypatch.setattr(wait_ahead, "swings_out", lambda work: False)
    bench = CartBench(BACK, RING)
    bench.at = Place(200.0, -8.0, WESTWARD)
    cuts = combine(bench.at, Place(140.0, 6.0, 0.0), Phase.CUTS, task=1, remaining=156.0, calls=True)
    assert bench.ends_in(cuts, 0.1).phase == Phase.DRIVES
    before = bench.part._points
    turns = combine(bench.at, Place(290.0, -6.0, WESTWARD), Phase.TURNS, task=1, calls=True, speed=3.0)
    for _ in range(8):
        job = bench.ends_in(turns, 0.1)
    assert job.phase == Phase.DRIVES
    for points, keeps_off in ((before, False), (bench.part._points, True)):
        line = GuidanceLine(points.tolist())
        fine = np.array([line.point(at) for at in np.arange(25.0, 140.0, 1.0)])
        assert bool(on_the_strip(fine).any()) is not keeps_off


def test_a_cart_in_front_of_a_combine_that_stands_for_it_drives_on():
    """Across its pass: while it comes up the cart stops before its way, else both would wait for good."""
    own, line = Place(-14.0, 20.0, 0.0), GuidanceLine([(-14.0, 20.0), (40.0, 20.0)])
    clearance = Clearance(NORTH)
    for speed, free in ((1.0, 14.0 - 6.1 - 3.0 - SHORT), (0.0, np.inf)):
        said = combine(own, Place(0.0, 0.0, NORTHWARD), Phase.CUTS, remaining=96.0, speed=speed)
        assert clearance.way(own, line, 0.0, 54.0, said, 1.0) == pytest.approx(max(free, 0.0), abs=1.0)


@pytest.mark.parametrize("phase", [Phase.TURNS, Phase.CUTS])
def test_behind_the_last_pass_one_of_three_combines_may_drive_on_60_m(phase):
    """A cart beside it, both at rest, that sets out to the truck comes by farther ahead."""
    other = Pass(((200.0, 0.0), (200.0, 40.0)), combine=1), Pass(((300.0, 0.0), (300.0, 40.0)), combine=2)
    passes = (Pass(((0.0, 0.0), (0.0, 100.0))), *other)
    ring = (-40.0, 0.0), (310.0, 0.0), (310.0, 100.0), (-40.0, 100.0)
    ways = CartWays(passes, ring, 12.2, 8.2, 9.0, [(60.0, 200.0)])
    here = Place(-8.2, 100.0, NORTHWARD)
    said = combine(here, Place(0.0, 98.0, NORTHWARD), phase, task=0, speed=0.0, remaining=0.0)
    way = ways.to_place(here, (60.0, 120.0), said)
    across = way.points[(np.abs(way.points[:, 0]) < 5.0), 1]
    assert bool(across.max() > 98.0 + 60.0 + 4.0 + 1.0) is (phase == Phase.TURNS)


@pytest.mark.parametrize(("task", "is_taken"), [(0, False), (1, True)])
def test_behind_its_last_pass_a_combine_may_stand_anywhere_ahead(task, is_taken):
    ways = CartWays(NORTH, RING_NORTH, 12.2, 8.2, 9.0)
    here = Place(-30.0, -20.0, 0.0)
    said = combine(here, Place(12.7, -4.0, -NORTHWARD), Phase.TURNS, task=task)
    stands = ways._stands(here, said)
    assert bool(stands) is is_taken
    way = ways.to_place(here, (45.0, -20.0), said)
    south = way.points[(way.points[:, 0] > 6.6) & (way.points[:, 0] < 18.8), 1]
    assert bool(south.max() < -16.0 - 4.0 - 3.0) is is_taken  # its header, 20 m behind the pass


@pytest.mark.parametrize(("away", "nearer", "free"), [
    (2.6, 0.05, True), (2.6, 0.5, False), (2.0, 0.05, False), (2.0, 0.0, True),
])  # fmt: skip
def test_a_cart_beside_a_combine_may_drive_by_that_stands(away, nearer, free):
    """Across in front of its header, nearer than it would come to it: some centimetres do not stop it."""
    own = Place(-3.0, 4.0 + away, 0.0)
    line = GuidanceLine([(-3.0, own.y), (3.0, own.y - nearer), (30.0, own.y + 3.0)])
    said = combine(own, Place(0.0, 0.0, NORTHWARD), Phase.STANDS, remaining=50.0, speed=0.0)
    assert (Clearance(NORTH).way(own, line, 0.0, 30.0, said, 0.0) == np.inf) is free


@pytest.mark.parametrize(("x", "y", "is_found"), [
    (-8.2, 60.0, False),  # on the line beside the pass
    (-14.0, 60.0, True),
    (-8.2, 140.0, True),  # behind its end
    (-8.2, -6.0, True),  # behind the cart
])  # fmt: skip
def test_a_line_beside_a_pass_is_taken_by_another_cart(x, y, is_found):
    ways = CartWays(NORTH, RING_NORTH, 12.2, 8.2, 9.0)
    here = Place(-8.2, 15.0, NORTHWARD)
    said = combine(here, Place(0.0, 50.0, NORTHWARD), Phase.CUTS, remaining=46.0)
    assert (ways.to_pass(here, 0, said, [(x, y, 3.0)]) is not None) is is_found


@pytest.mark.parametrize(("x", "phase", "line"), [
    (-0.5, Phase.CUTS, -8.7), (-0.5, Phase.STANDS, -8.7), (0.5, Phase.CUTS, -8.2), (-0.5, Phase.TURNS, -8.2),
])  # fmt: skip
def test_the_line_beside_a_pass_is_that_beside_the_combine_where_it_follows_the_edge(x, phase, line):
    """Left of its pass, towards the cart."""
    ways = CartWays(NORTH, RING_NORTH, 12.2, 8.2, 9.0)
    here = Place(-8.2, 15.0, NORTHWARD)
    said = combine(here, Place(x, 50.0, NORTHWARD), phase, remaining=46.0)
    points = ways.to_pass(here, 0, said).points
    assert points[-2:, 0] == pytest.approx(line)


SIDE_BY_SIDE = (  # another combine comes south beside the first pass of NORTH, on its way to another one
    *NORTH,
    Pass(((-12.0, 200.0), (-12.0, 120.0)), turn=(Segment(130.0),), combine=1),
    Pass(((-12.0, -20.0), (-12.0, -60.0)), combine=1),
)


def beside_the_first_pass(bench):
    """A cart at its station beside a combine, on the line to the end of the pass."""
    part, bench.at = bench.part, Place(-8.2, 50.0, NORTHWARD)
    part._phase, part._task, part._goal, part._number = Phase.BESIDE, 0, "combine", 1
    part._points = np.array([(-8.2, 20.0), (-8.2, 130.0)])


def on_the_line():
    """A cart on its way along that line."""
    bench = CartBench(SIDE_BY_SIDE)
    beside_the_first_pass(bench)
    part = bench.part
    part._phase, part._goal, part._retry_at = Phase.DRIVES, "combine", -np.inf
    part._lane, part._drives_to, part._way = 10.0, np.inf, 30.0
    return bench


def cart_at(own, at, phase=Phase.WAITS):
    return replace(combine(own, at, phase, task=-1, speed=0.0), header_width=np.nan)


@pytest.mark.parametrize(("at", "stays"), [
    (Place(-8.2, 66.0, -NORTHWARD), False),  # in front of it
    (Place(-20.0, 60.0, -NORTHWARD), True),
])  # fmt: skip
def test_beside_its_combine_a_cart_stops_before_another_one(at, stays):
    bench = CartBench(NORTH)
    beside_the_first_pass(bench)
    said = combine(
        bench.at, Place(0.0, 54.0, NORTHWARD), Phase.CUTS, remaining=42.0, calls=True, may_unload=True
    )
    job = bench.ends_in(said, 0.1, other_1=cart_at(bench.at, at))
    assert (job.phase == Phase.BESIDE) is stays
    assert job.by_station is stays


@pytest.mark.parametrize(("speed", "pours", "y", "stays"), [
    (0.0, False, 75.0, False), (0.0, True, 75.0, True), (2.0, False, 75.0, True), (0.0, False, 20.0, True),
])  # fmt: skip
def test_beside_a_combine_that_waits_a_cart_makes_room_for_another_one(speed, pours, y, stays):
    """Which stands in its turn, before the cart, and not where that is behind it."""
    bench = CartBench(SIDE_BY_SIDE)
    beside_the_first_pass(bench)
    said = combine(
        bench.at, Place(0.0, 54.0, NORTHWARD), Phase.CUTS, remaining=42.0, calls=True, may_unload=True,
        speed=speed, is_pouring=pours,
    )  # fmt: skip
    turns = combine(bench.at, Place(-12.0, y, -NORTHWARD), Phase.TURNS, task=2, speed=0.0)
    assert (bench.ends_in(said, 0.1, other_1=turns).phase == Phase.BESIDE) is stays


@pytest.mark.parametrize(("left", "calls", "dry_for", "stays"), [
    (-1.0, False, 40.0, False),
    (-1.0, True, 40.0, True),  # it stands for a cart
    (5.0, False, 40.0, True),
    (-1.0, False, 20.0, True),
])  # fmt: skip
def test_beside_a_combine_that_waits_a_cart_makes_room_for_one_that_cannot_begin_its_turn(
    left, calls, dry_for, stays
):
    """Its own one waits until that has turned, which does not while the cart is there."""
    bench = CartBench(SIDE_BY_SIDE)
    beside_the_first_pass(bench)
    bench.part._poured_at = -dry_for
    said = combine(
        bench.at, Place(0.0, 54.0, NORTHWARD), Phase.CUTS, remaining=42.0, calls=True, may_unload=True,
        speed=0.0,
    )  # fmt: skip
    stands = combine(
        bench.at, Place(-12.0, 75.0, -NORTHWARD), Phase.STANDS, task=2, remaining=left, calls=calls, speed=0.0
    )
    assert (bench.ends_in(said, 0.1, other_1=stands).phase == Phase.BESIDE) is stays


@pytest.mark.parametrize(
    ("y", "calls", "stays"), [(80.0, True, False), (80.0, False, True), (90.0, True, True)]
)
def test_beside_its_combine_a_cart_turns_aside_in_time_before_one_that_stands_for_a_cart(y, calls, stays):
    """On the next pass, over which the line beside its combine leads: at its rear it could not."""
    bench = CartBench(SIDE_BY_SIDE)
    beside_the_first_pass(bench)
    said = combine(
        bench.at, Place(0.0, 54.0, NORTHWARD), Phase.CUTS, remaining=42.0, calls=True, may_unload=True
    )
    stands = combine(
        bench.at, Place(-12.0, y, NORTHWARD), Phase.STANDS, task=3, remaining=1.0, calls=calls,
        may_unload=True, speed=0.0,
    )  # fmt: skip
    assert (bench.ends_in(said, 0.1, other_1=stands).phase == Phase.BESIDE) is stays


@pytest.mark.parametrize("y", [92.0, 95.0, 98.0, 102.0])
def test_beside_a_combine_that_stands_a_cart_finds_a_way_to_come_up_anew(y):
    """At 95 m the header's end is too near ahead to turn away from it there: straight on first."""
    ways = CartWays(NORTH, RING_NORTH, 12.2, 8.2, 9.0)
    here = Place(-8.0, y, NORTHWARD)
    said = combine(here, Place(0.0, 97.0, NORTHWARD), Phase.STANDS, remaining=-1.0, speed=0.0)
    points = ways.to_pass(here, 0, said).points
    assert points[:, 1].min() < 80.0  # from behind
    near = np.abs(points[:, 1] - 101.0) < 1.0
    assert points[near, 0].max() < -8.2 + 0.3


@pytest.mark.parametrize(("calls", "dry_for", "speed", "stays"), [
    (True, 40.0, 0.0, False),
    (False, 40.0, 0.0, True),
    (True, 20.0, 0.0, True),
    (True, 40.0, 1.0, True),  # its own one drives
])  # fmt: skip
def test_a_cart_leaves_a_combine_that_waits_for_one_that_stands_for_a_cart(calls, dry_for, speed, stays):
    """Else both combines and the cart stand for good."""
    bench = CartBench(SIDE_BY_SIDE)
    beside_the_first_pass(bench)
    bench.part._poured_at = -dry_for
    said = combine(
        bench.at, Place(0.0, 54.0, NORTHWARD), Phase.CUTS, remaining=42.0, calls=True, may_unload=True,
        speed=speed,
    )  # fmt: skip
    stands = combine(
        bench.at, Place(-12.0, -55.0, -NORTHWARD), Phase.STANDS, task=3, remaining=1.0, calls=calls,
        may_unload=True, speed=0.0,
    )  # fmt: skip
    assert (bench.ends_in(said, 0.1, other_1=stands).phase == Phase.BESIDE) is stays


@pytest.mark.parametrize(("phase", "stays"), [(Phase.TURNS, False), (Phase.CUTS, True)])
def test_on_the_line_beside_a_pass_a_cart_makes_room_for_one_that_stands_in_its_turn(phase, stays):
    """Before it on that line: the combine that it drives to stands for it, and neither of the others goes."""
    bench = on_the_line()
    part = bench.part
    stands = combine(
        bench.at, Place(0.0, 94.0, NORTHWARD), Phase.STANDS, remaining=2.0, calls=True, may_unload=True,
        speed=0.0,
    )  # fmt: skip
    other = combine(bench.at, Place(-12.0, 75.0, -NORTHWARD), phase, task=2, remaining=40.0, speed=0.0)
    goals = set()
    for _ in range(40):
        bench.ends_in(stands, 0.1, other_1=other)
        goals.add(part._goal)
    assert (goals == {"combine"}) is stays


@pytest.mark.parametrize("calls", [True, False])
def test_on_the_line_beside_a_pass_a_cart_turns_to_one_that_stands_for_it_in_its_way(calls):
    """While the combine that it drives to cuts on."""
    bench = on_the_line()
    part = bench.part
    cuts = combine(
        bench.at, Place(0.0, 70.0, NORTHWARD), Phase.CUTS, remaining=40.0, calls=True, may_unload=True
    )
    told = {"task": 2, "remaining": 0.0, "calls": calls, "may_unload": True, "speed": 0.0}
    stands = combine(bench.at, Place(-14.2, 58.0, 0.0), Phase.STANDS, **told)
    served = set()
    for _ in range(8):
        bench.ends_in(cuts, 0.1, other_1=stands)
        served.add(part._served)
    assert (1 in served) is calls


ROUND_ABOUT = (  # west, then in a turn to the right across the way that a cart comes up
    Pass(((200.0, 29.0), (23.6, 29.0)), turn=(Segment(4.0), Segment(20.0, -np.pi / 40.0), Segment(50.0))),
    Pass(((15.0, 100.0), (15.0, 200.0))),
)


@pytest.mark.parametrize(("x", "passes_by"), [(27.9, False), (30.0, True)])
def test_before_a_combine_that_stands_a_cart_keeps_off_its_turn_where_it_cannot_drive_by(x, passes_by):
    """The corner of the header, 4 m ahead of the axle, comes near to the cart's line, or not so far; in the
    turn all of it does.
    """
    own, line = Place(21.0, 5.0, NORTHWARD), GuidanceLine([(21.0, 5.0), (21.0, 200.0)])
    turns = combine(own, Place(x, 29.0, WESTWARD), Phase.TURNS, speed=0.0)
    done = replace(turns, phase=int(Phase.DONE))  # it does not drive on
    before, corner = (Clearance(ROUND_ABOUT).way(own, line, 0.0, 200.0, s, 3.0) for s in (turns, done))
    if passes_by:
        assert before == corner == np.inf
    else:
        assert before < corner - 1.0 < np.inf


def test_a_cart_that_finds_no_way_to_one_that_calls_makes_room_for_it():
    """The combine's way back leads over where it waits, and ends where the cart would drive up."""
    bench = CartBench(BACK, ((0.0, 0.0), *RING[1:3], (0.0, 100.0)))  # the truck is near it
    bench.at = Place(150.0, -8.0, 0.0)
    bench.part._ahead.found = lambda *args: None
    turns = combine(bench.at, Place(250.0, -6.0, WESTWARD), Phase.TURNS, task=1, calls=True, speed=3.0)
    for _ in range(7):
        job = bench.ends_in(turns, 0.1)
    assert job.phase == Phase.DRIVES
    assert bench.part._goal == "truck"


CORNER = (  # the south-west one, its outer round cut: three combines; axle 4 m behind the knife
    Pass(((220.0, 5.8), (0.0, 5.8))),
    Pass(((5.8, 0.0), (5.8, 300.0)), combine=1),
    Pass(((200.0, 17.5), (11.7, 17.5))),
    Pass(((17.5, 16.5), (17.5, 300.0)), combine=1),
    Pass(((200.0, 29.2), (23.4, 29.2)), combine=2),
    Pass(((29.2, 23.4), (29.2, 300.0))),
)


@pytest.mark.parametrize(("phase", "is_found"), [(Phase.STANDS, True), (Phase.CUTS, False)])
def test_a_cart_comes_up_nearer_behind_a_combine_that_stands_where_another_one_leaves_no_room(
    phase, is_found
):
    ways = CartWays(CORNER, ((0.0, 0.0), (220.0, 0.0), (220.0, 300.0), (0.0, 300.0)), 12.2, 8.2, 9.0)
    here = Place(71.0, 15.5, WESTWARD)
    full = combine(here, Place(17.5, 51.0, NORTHWARD), phase, task=3, remaining=245.0, speed=0.0)
    ended = combine(here, Place(15.7, 17.5, WESTWARD), Phase.TURNS, task=2, speed=0.0)
    waits = combine(here, Place(75.0, 29.2, WESTWARD), Phase.CUTS, task=4, remaining=47.6, speed=0.0)
    way = ways.to_pass(here, 3, full, (), [ended, waits])
    assert (way is not None) is is_found
    if way is not None:
        outline = outline_of(ended)
        at = place_of(here, ended)
        to_line = way.points[:-1]
        assert min(outline.away(at, x, y) for x, y in to_line) > 3.0
        assert to_line[-1] == pytest.approx((9.3, 51.0 - 8.0 - 14.0), abs=0.2)
    free = replace(ended, x=ended.x - 80.0)
    assert ways.to_pass(here, 3, full, (), [free, waits]).points[-2, 1] == pytest.approx(12.0, abs=0.2)
