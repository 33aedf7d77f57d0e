"""The job of a cart alone, by what it hears: when it leaves for the truck, and how far it sets out."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.job.bend_speed import bend_speed
from swath.control.job.calls import Calls
from swath.control.job.cart_ways import CartWays, Way
from swath.control.job.passes import Pass
from swath.control.job.right_of_way import ROOM, SHORT, Clearance, own_outline
from swath.control.job.shuttle import Params, Shuttle
from swath.control.job.wait_ahead import WaitAhead
from swath.control.steer.guidance_line import Bend, GuidanceLine, along_bends
from swath.control.steer.path import Segment
from swath.control.turns.dubins import Place
from swath.signals import HeapState, Odometry, Phase, PoseEstimate
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup
from tests.job.test_beside_ways import CART, NORTHWARD, combine
from tests.job.test_whole_field import NORTH, Bench

FULL = 20_000.0  # kg
HERE = Place(-20.0, 20.0, NORTHWARD)
RING = ((-6.0, 0.0), (19.0, 0.0), (19.0, 100.0), (-6.0, 100.0))
AWAY = Place(12.7, 40.0, -NORTHWARD)


class CartBench:
    """The level alone, which stands at a place: grain in its box as told; spot: where that is full."""

    def __init__(self, passes=NORTH, ring=RING, truck=(-25.0, -15.0), **more):
        params = Params(passes, ring, truck_m=truck, leave_percent=60.0, **more)
        self.part = Shuttle(params, ControlSetup(CART, {}, "left", 0.1))
        self.part.reset(None)
        self.t, self.at = 0, HERE

    def step(self, said, level, spot=None, **others):
        pose = PoseEstimate(self.t, *self.at, 0.0, 0.0, np.eye(4) * 1e-4, 0.0)
        heap = HeapState(self.t, level * FULL, level, 0.0, 1.0, np.zeros(3), np.zeros(3))
        is_full = spot is not None
        station = Wanted(self.t, is_full, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, spot or 0.0, is_full)
        inputs = {
            "pose": pose, "odometry": Odometry(self.t, 0.0, 0.0, 0.0), "peer": replace(said, t=self.t),
            "heap": heap, "station": station, **{name: replace(o, t=self.t) for name, o in others.items()},
        }  # fmt: skip
        self.t += 100_000_000
        return self.part.step(self.t, 100_000_000, inputs)["job"]

    def ends_in(self, said, level, **others):
        """What it does after a second. others: messages of other machines, by their input"""
        return [self.step(said, level, **others) for _ in range(10)][-1]


@pytest.mark.parametrize(("to_come", "level", "leaves"), [
    (700.0, 0.7, False),  # 15 t fit
    (1100.0, 0.7, True),
    (np.nan, 0.7, True),
    (9000.0, 0.5, False),  # not loaded
])  # fmt: skip
def test_a_loaded_cart_that_has_room_for_all_that_is_to_come_stays(to_come, level, leaves):
    said = combine(HERE, AWAY, Phase.CUTS, task=1, remaining=40.0, to_come=to_come)
    job = CartBench().ends_in(said, level)
    assert (job.phase, job.task) == ((Phase.DRIVES if leaves else Phase.WAITS), -1)


@pytest.mark.parametrize("level", [0.1, 0.7])
def test_when_all_is_cut_a_cart_brings_what_it_has(level):
    """Though a combine that is done keeps some grammes."""
    said = combine(HERE, AWAY, Phase.DONE, task=1, to_come=1e-3, speed=0.0)
    bench = CartBench()
    assert bench.ends_in(said, level).phase == Phase.DRIVES
    assert bench.part._goal == "truck"


def test_a_cart_that_stands_at_the_truck_turned_away_from_the_field_turns_about_there():
    """23 m outside: the least turn leads 9 m farther."""
    bench = CartBench(truck=(0.0, -23.0))
    bench.at = Place(0.0, -23.0, -NORTHWARD)
    said = combine(
        bench.at, AWAY, Phase.STANDS, task=1, remaining=40.0, to_come=9000.0, calls=True, may_unload=True,
        speed=0.0,
    )  # fmt: skip
    job = bench.ends_in(said, 0.0)
    assert (job.phase, job.task) == (Phase.DRIVES, 1)
    assert bench.part._points[:, 1].min() < -31.0


@pytest.mark.parametrize(("tank", "task"), [(1900.0, 1), (2100.0, -1)])
def test_a_loaded_cart_takes_half_of_the_tank_of_one_that_stands_for_it(tank, task):
    said = combine(
        HERE, AWAY, Phase.STANDS, task=1, remaining=40.0, to_come=90_000.0, tank_grain=tank, calls=True,
        may_unload=True, speed=0.0,
    )  # fmt: skip
    job = CartBench().ends_in(said, 0.7)
    assert (job.phase, job.task) == (Phase.DRIVES, task)


@pytest.mark.parametrize(
    ("fills", "tank", "task"), [(75.0, 2100.0, -1), (90.0, 7900.0, 1), (90.0, 8100.0, -1)]
)
def test_how_much_a_loaded_cart_takes_for_sure(fills, tank, task):
    said = combine(
        HERE, AWAY, Phase.STANDS, task=1, remaining=40.0, to_come=90_000.0, tank_grain=tank, calls=True,
        may_unload=True, speed=0.0,
    )  # fmt: skip
    assert CartBench(fill_percent=fills).ends_in(said, 0.7).task == task


@pytest.mark.parametrize(("level", "calls", "task"), [(0.0, True, 1), (0.0, False, -1), (0.65, True, -1)])
def test_a_cart_takes_a_call_on_its_way_to_where_it_waits(level, calls, task):
    """Not with a load that it brings."""
    bench = CartBench(wait_m=(-40.0, -20.0))
    said = combine(HERE, AWAY, Phase.CUTS, task=1, remaining=80.0, stands_in=100.0, may_unload=True)
    assert (bench.ends_in(said, level).phase, bench.ends_in(said, level).task) == (Phase.DRIVES, -1)
    said = replace(said, calls=calls)
    jobs = [bench.step(said, level) for _ in range(60)]
    assert (jobs[-1].phase, jobs[-1].task) == (Phase.DRIVES, task)


@pytest.mark.parametrize(("remaining", "drives"), [(80.0, True), (4.0, False)])
def test_a_cart_ahead_of_its_combine_does_not_drive_through_the_turn_of_that(remaining, drives):
    """On the line beside the next pass, to a place that is clear of that turn; 112 m north, southward."""
    bench, at = CartBench(), Place(6.0, 112.0, -NORTHWARD)
    bench.at = at
    lane = np.array([(6.0, 113.0), (6.0, 0.0)])
    kept = {
        "phase": Phase.DRIVES,
        "goal": "combine",
        "task": 1,
        "points": lane,
        "lane": 0.0,
        "is_clear": True,
    }
    bench.part.load({**bench.part.save(), **kept})
    there = Place(0.0, 100.0 - 4.0 - remaining, NORTHWARD)
    said = combine(at, there, Phase.CUTS, remaining=remaining, calls=True, may_unload=True)
    job = bench.step(said, 0.2)
    assert job.phase == Phase.DRIVES
    assert (job.speed > 1.0) is drives


@pytest.mark.parametrize(("flows", "stays"), [(True, True), (False, False)])
def test_a_cart_whose_box_is_not_below_the_pipe_comes_up_anew(flows, stays):
    """To a combine that stands for it and cannot pour: it drives off, and takes the call on its way."""
    bench, there = CartBench(), Place(HERE.x + 8.2, HERE.y, NORTHWARD)
    lane = np.array([HERE[:2], (HERE.x, 130.0)])
    bench.part.load({**bench.part.save(), "phase": Phase.BESIDE, "task": 0, "points": lane})
    told = {"calls": True, "may_unload": True, "speed": 0.0, "remaining": 80.0}
    said = combine(HERE, there, Phase.STANDS, is_pouring=True, **told)
    bench.step(said, 0.2)
    said = replace(said, is_pouring=flows)
    jobs = [bench.step(said, 0.2) for _ in range(295)]
    assert {job.phase for job in jobs} == {Phase.BESIDE}
    assert (bench.ends_in(said, 0.2).phase == Phase.BESIDE) is stays


@pytest.mark.parametrize(("calls", "others", "stays"), [
    (False, True, False), (False, False, True), (True, True, True)
])  # fmt: skip
def test_a_cart_leaves_one_that_needs_it_no_more_for_one_that_calls(calls, others, stays):
    passes = (
        *NORTH,
        Pass(((200.0, 0.0), (200.0, 100.0)), combine=1),
        Pass(((212.0, 100.0), (212.0, 0.0)), combine=1),
    )
    bench, there = CartBench(passes), Place(HERE.x + 8.2, HERE.y, NORTHWARD)
    lane = np.array([HERE[:2], (HERE.x, 130.0)])
    bench.part.load({**bench.part.save(), "phase": Phase.BESIDE, "task": 0, "points": lane})
    said = combine(HERE, there, Phase.CUTS, remaining=80.0, calls=calls, may_unload=True)
    other = combine(HERE, Place(200.0, 20.0, NORTHWARD), Phase.CUTS, task=2, remaining=80.0, calls=others)
    job = bench.step(said, 0.2, other_1=replace(other, may_unload=True, stands_in=50.0))
    assert (job.phase == Phase.BESIDE) is stays


@pytest.mark.parametrize(("speed", "is_cut"), [(2.0, True), (0.0, False)])
def test_where_a_combine_cuts_before_no_cart_waits_for_the_next_pass(speed, is_cut):
    """Beside the next pass, back on the neighbouring strip, is the end of the present one. It is free to wait
    there once that is cut.
    """
    passes = Pass(((0.0, 0.0), (0.0, 100.0))), Pass(((11.7, 100.0), (11.7, 0.0)))
    ways = CartWays(passes, RING, 12.0, 8.2, 9.0, [(-40.0, 0.0)])
    here, remaining = Place(-40.0, 0.0, NORTHWARD), 60.0 if is_cut else 0.0
    said = combine(here, Place(0.0, 100.0 - remaining, NORTHWARD), Phase.CUTS, task=0, remaining=remaining)
    said = replace(said, speed=speed, phase=int(Phase.CUTS if is_cut else Phase.TURNS))
    assert ways.is_cut_before(Place(3.5, 80.0, -NORTHWARD), 1, said) is is_cut
    assert not ways.is_cut_before(Place(-20.0, 80.0, -NORTHWARD), 1, said)


LOOP = (
    Pass(((0.0, 0.0), (0.0, 100.0)), turn=(Segment(10.0), Segment(44.0, -1.5 * np.pi / 44.0), Segment(9.0))),
    Pass(((-5.0, 105.0), (-90.0, 105.0))),
)


@pytest.mark.parametrize(("at", "phase", "least", "most"), [
    (Place(0.0, 40.0, NORTHWARD), Phase.CUTS, 100.0, 140.0),  # not into the loop
    (Place(0.0, 103.0, NORTHWARD), Phase.TURNS, 0.0, 0.0),
])  # fmt: skip
def test_behind_a_loop_a_cart_sets_out_as_far_as_that_is(at, phase, least, most):
    own = own_outline(CART)
    ahead = WaitAhead(LOOP, own, Clearance(LOOP), Calls(LOOP, 15.0))
    here = Place(-40.0, 0.0, NORTHWARD)
    way = Way(np.array([(-40.0, 0.0), (-40.0, 113.0), (60.0, 113.0), (60.0, 96.0), (-90.0, 96.0)]), 90.0)
    said = combine(here, at, phase, remaining=96.0 - at.y if phase == Phase.CUTS else np.nan)
    until = ahead.until(here, way, 1, said, is_clear=True)
    assert least <= until <= most
    ends = replace(LOOP[0], turn=NORTH[0].turn), LOOP[1]
    assert (
        WaitAhead(ends, own, Clearance(ends), Calls(ends, 15.0)).until(here, way, 1, said, is_clear=False)
        == np.inf
    )


def test_a_cart_stops_where_it_can_turn_about_before_a_combine_that_stands():
    own, line = Place(0.0, 0.0, 0.0), GuidanceLine([(0.0, 0.0), (100.0, 0.0)])
    clearance = Clearance(NORTH)
    for speed, phase, free in (
        (0.0, Phase.TURNS, True),
        (1.0, Phase.TURNS, False),
        (0.0, Phase.STANDS, True),
        (0.0, Phase.CUTS, False),
    ):
        said = combine(own, Place(50.0, 0.0, 2.0), phase, speed=speed)
        found = clearance.before_standing(own, line, 0.0, 100.0, said)
        assert (found < 50.0) is free
        if free:
            near = clearance.way(own, line, 0.0, 100.0, said, 6.0)
            assert found == pytest.approx(near + SHORT - ROOM)
    aside = combine(own, Place(50.0, 20.0, 0.0), Phase.TURNS, speed=0.0)
    assert clearance.before_standing(own, line, 0.0, 100.0, aside) == np.inf


def test_a_load_that_would_go_on_standing_is_not_broken_off():
    """Before passes without a cart, in which the tank would get full, it pours on to the end, and there."""
    blind = NORTH[0], replace(NORTH[1], cart_beside=False), NORTH[0]
    for passes, goes_on in ((blind, True), (NORTH, False)):
        bench = Bench(passes, finish_s=10.0)
        for north in np.arange(1.0, 60.2, 0.5):
            bench.step(north, 0.9 * north / 100.0)
        may = [bench.step(north, 0.9, flow=92.0).may_unload for north in np.arange(60.5, 100.0, 0.5)]
        assert may[20]
        assert bool(may[-1]) is goes_on
        assert (bench.step(100.35, 0.9, flow=92.0).phase == Phase.STANDS) is goes_on


@pytest.mark.parametrize(("width", "stands"), [(6.0, False), (11.9, True)])
def test_what_a_wider_pass_brings_is_forecast(width, stands):
    """0.4 of the tank in a pass 6 m wide: 0.8 from there on, or 1.19."""
    passes = (
        replace(NORTH[0], width_m=6.0), replace(NORTH[1], cart_beside=False, width_m=width), NORTH[0],
    )  # fmt: skip
    bench = Bench(passes, call_percent=90.0)
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.4 * north / 100.0)
    assert (bench.step(100.35, 0.4).phase == Phase.STANDS) is stands


def test_a_cart_sets_out_over_crop_that_is_cut_before():
    """Round a corner of a field whose west side is cut now: as far as the combine has not come by."""
    west = Pass(((5.9, 0.0), (5.9, 100.0)), turn=LOOP[0].turn)
    north = Pass(((20.0, 81.6), (90.0, 81.6)))
    passes = (Pass(((8.0, 93.8), (90.0, 93.8))), west, north)
    ring = ((0.0, 0.0), (90.0, 0.0), (90.0, 100.0), (0.0, 100.0))
    ways = CartWays(passes, ring, 12.2, 8.2, 9.0)
    here = Place(-12.0, -15.0, NORTHWARD)
    said = combine(here, Place(5.9, 16.0, NORTHWARD), Phase.CUTS, task=1, remaining=80.0)
    assert ways.to_pass(here, 2, said) is None
    ahead = WaitAhead(passes, own_outline(CART), Clearance(passes), Calls(passes, 15.0))
    found = ahead.found(ways, here, 2, said, [], [])
    assert found is not None
    x, y = GuidanceLine(found.way.points.tolist()).point(found.until)
    assert (x < 0.0) or (y > 100.0)  # outside, before the strip that is cut now
    assert 30.0 <= found.until < 130.0
    # and on, once the combine has come farther
    line, there = GuidanceLine(found.way.points.tolist()), Place(5.9, 80.0, NORTHWARD)
    said = combine(here, there, Phase.CUTS, task=1, remaining=16.0)
    assert ahead.further(here, line, 0.0, line.length - found.way.beside, 2, said) >= found.until


@pytest.mark.parametrize(("order", "is_clear"), [((0, 1, 2, 3), False), ((0, 2, 3, 1), True)])
def test_no_cart_waits_where_another_combine_cuts_before(order, is_clear):
    """Beside its pass lies one of the other combine, which begins that before, or afterwards; northward."""
    first = Pass(((80.0, 0.0), (80.0, 100.0))), Pass(((200.0, 100.0), (200.0, 0.0)))
    beside = Pass(((11.8, 100.0), (11.8, 0.0)), combine=1)  # comes against it
    own = Pass(((20.0, 0.0), (20.0, 100.0)))
    other = Pass(((300.0, 0.0), (300.0, 100.0)), combine=1)
    kinds = {0: other, 1: beside, 2: first[0], 3: own}
    passes = tuple(kinds[k] for k in order)
    at = {k: passes.index(kinds[k]) for k in kinds}
    here = Place(11.8, -40.0, NORTHWARD)
    ahead = WaitAhead(passes, own_outline(CART), Clearance(passes), Calls(passes, 15.0))
    way = Way(np.array([(11.8, -40.0), (11.8, -18.0), (11.8, 130.0)]), 148.0)
    peer = combine(here, Place(80.0, 20.0, NORTHWARD), Phase.CUTS, task=at[2], remaining=76.0)
    rest = combine(here, Place(300.0, 20.0, NORTHWARD), Phase.CUTS, task=at[0], remaining=76.0)
    assert ahead.is_clear(here, way, at[3], peer, [rest]) is is_clear
    assert (ahead.until(here, way, at[3], peer, [rest], is_clear=is_clear) == np.inf) is is_clear


@pytest.mark.parametrize(("task", "at", "is_clear"), [
    (0, Place(80.0, 20.0, NORTHWARD), False), (2, Place(12.0, 60.0, NORTHWARD), True),
])  # fmt: skip
def test_beside_a_pass_in_echelon_a_cart_waits_for_the_one_ahead_to_cut_there(task, at, is_clear):
    """Beside it the first combine cuts the same way, in the pass to come or in its present one; northward."""
    passes = tuple(
        Pass(((x, 0.0), (x, 100.0)), combine=i % 2) for i, x in enumerate((80.0, 92.0, 11.8, 20.0))
    )
    here = Place(11.8, -40.0, NORTHWARD)
    ahead = WaitAhead(passes, own_outline(CART), Clearance(passes), Calls(passes, 15.0))
    way = Way(np.array([(11.8, -40.0), (11.8, -18.0), (11.8, 130.0)]), 148.0)
    peer = combine(here, Place(92.0, 20.0, NORTHWARD), Phase.CUTS, task=1, remaining=76.0)
    first = combine(here, at, Phase.CUTS, task=task, remaining=96.0 - at.y)
    assert ahead.is_clear(here, way, 3, peer, [first]) is is_clear


def test_a_cart_in_the_way_of_a_combine_does_not_drive_into_it():
    """Head on: it is within the next metres of the combine, and may leave them, but not nearer to it."""
    own, line = Place(0.0, 20.0, -NORTHWARD), GuidanceLine([(0.0, 20.0), (0.0, -40.0)])
    said = combine(own, Place(0.0, 0.0, NORTHWARD), Phase.CUTS, remaining=96.0)
    free = Clearance(NORTH).way(own, line, 0.0, 60.0, said, 3.0)
    assert free == pytest.approx(20.0 - 4.0 - 3.0 - SHORT, abs=1.0)  # before its header
    away = GuidanceLine([(0.0, 20.0), (0.0, 80.0)])
    assert Clearance(NORTH).way(own, away, 0.0, 60.0, said, 3.0) == np.inf


@pytest.mark.parametrize(("behind", "comes_back"), [(22.0, True), (6.0, False)])
def test_a_cart_ahead_of_a_combine_that_stands_comes_from_behind(behind, comes_back):
    """It waited on the line beside the next pass; the combine is full at its begin, and does not come up."""
    bench = CartBench()
    bench.at = Place(-15.0, 60.0, NORTHWARD)
    turns = combine(bench.at, Place(0.0, 103.0, NORTHWARD), Phase.TURNS, calls=True)
    assert bench.ends_in(turns, 0.1).phase == Phase.DRIVES
    bench.at = Place(21.6, 74.0, -NORTHWARD)
    bench.part._way = bench.part._lane + 40.0
    stands = combine(
        bench.at, Place(12.7, 74.0 + behind, -NORTHWARD), Phase.STANDS, task=1, remaining=90.0, calls=True,
        may_unload=True, speed=0.0,
    )  # fmt: skip
    number = bench.part._number
    bench.ends_in(stands, 0.1)
    assert (bench.part._number > number) is comes_back


def test_a_cart_slows_down_where_arcs_to_both_sides_meet():
    """As its steering turns from one to the other at two thirds of its rate; in an arc by 0.8 m/s2."""
    radius = 9.0
    bends = [
        Bend(30.0, 0.0, 0.0),
        Bend(20.0, 1.0 / radius, 1.0 / radius),
        Bend(20.0, -1.0 / radius, -1.0 / radius),
    ]
    line = GuidanceLine(along_bends(0.0, 0.0, 0.0, bends))

    def slow(way):
        return bend_speed(line, way, 2.0, CART.wheelbase)

    assert slow(5.0) > 10.0
    assert slow(39.0) == pytest.approx(np.sqrt(0.8 * radius), rel=0.05)
    assert slow(50.0) < 1.3


@pytest.mark.parametrize("ahead", [-4.0, 0.0, 2.0])
@pytest.mark.parametrize("phase", [Phase.CUTS, Phase.STANDS])
def test_a_cart_leaves_a_combine_that_stands_beside_it(ahead, phase):
    """Straight on past its header, also one that waits in its pass for another combine."""
    there = Place(HERE.x + 8.2, HERE.y + ahead, NORTHWARD)
    said = combine(HERE, there, phase, speed=0.0, remaining=80.0, to_come=90_000.0)
    said = replace(said, header_width=12.3, tank_grain=100.0)
    assert CartBench().ends_in(said, 0.95).speed > 0.5


@pytest.mark.parametrize(("moves", "stays"), [(0.1, True), (0.0, False)])
def test_a_cart_is_full_when_it_moves_on_to_no_other_place(moves, stays):
    """With room farther back in its box it stays, though no grain flows until that is below the pipe."""
    bench, there = CartBench(), Place(HERE.x + 8.2, HERE.y, NORTHWARD)
    lane = np.array([HERE[:2], (HERE.x, 130.0)])
    bench.part.load({**bench.part.save(), "phase": Phase.BESIDE, "task": 0, "points": lane})
    said = combine(HERE, there, Phase.CUTS, calls=True, may_unload=True, speed=2.0, remaining=80.0)
    jobs = [bench.step(said, 0.7, 2.0 - moves * 0.1 * i) for i in range(60)]
    assert jobs[30].phase == Phase.BESIDE
    assert (jobs[-1].phase == Phase.BESIDE) is stays


def test_behind_a_combine_that_stands_it_comes_onto_the_line_of_the_pipe():
    """From the line farther out, on which it had set out; it stops before what is there as on that."""
    bench, at = CartBench(), Place(-8.9, 20.0, NORTHWARD)
    bench.at = at
    lane = np.array([at[:2], (at.x, 130.0)])
    kept = {
        "phase": Phase.DRIVES,
        "goal": "combine",
        "task": 0,
        "points": lane,
        "lane": 0.0,
        "is_clear": True,
    }
    bench.part.load({**bench.part.save(), **kept})
    said = combine(
        at, Place(0.0, 90.0, NORTHWARD), Phase.STANDS, calls=True, may_unload=True, speed=0.0, remaining=6.0
    )
    jobs = [bench.step(said, 0.2) for _ in range(3)]
    assert {job.phase for job in jobs} == {Phase.DRIVES}
    saved = bench.part.save()
    assert saved["points"][1:, 0] == pytest.approx(-8.2)
    assert saved["number"] == 1


@pytest.mark.parametrize(("around", "is_left"), [(200.0, True), (60.0, False)])
def test_a_cart_leaves_a_long_way_around_once_there_is_a_shorter_one(around, is_left):
    """About a combine that was in the way, and has driven on since."""
    bench = CartBench(wait_m=(-40.0, -20.0))
    said = combine(HERE, AWAY, Phase.CUTS, task=1, remaining=80.0, stands_in=100.0, may_unload=True)
    assert bench.ends_in(said, 0.0).phase == Phase.DRIVES
    part = bench.part
    part._points = np.array([HERE[:2], (HERE.x, HERE.y + 0.5 * around), (-40.0, HERE.y + 0.5 * around),
                             (-40.0, -20.0)])  # fmt: skip
    part._way, part._line, part._looks_at, before = 0.0, None, -np.inf, part._points
    for _ in range(10):
        assert bench.step(said, 0.0).phase == Phase.DRIVES
    assert (part._points is not before) is is_left
    assert part._points[-1] == pytest.approx((-40.0, -20.0))


@pytest.mark.parametrize(("may_unload", "speed", "phase", "leaves"), [
    (False, 0.0, Phase.STANDS, True),
    (True, 0.0, Phase.STANDS, False),
    (False, 2.0, Phase.STANDS, False),
    (False, 0.0, Phase.CUTS, False),
])  # fmt: skip
def test_a_cart_behind_a_combine_that_is_held_up_turns_to_one_that_stands(may_unload, speed, phase, leaves):
    """That may wait for the other one, which stands for a cart at the end of its last pass."""
    passes = (*NORTH, Pass(((200.0, 0.0), (200.0, 100.0)), combine=1))
    bench, there = CartBench(passes), Place(HERE.x + 8.2, HERE.y + 8.0, NORTHWARD)
    lane = {"points": np.array([HERE[:2], (HERE.x, 130.0)]), "lane": 0.0}
    kept = {"phase": Phase.DRIVES, "goal": "combine", "task": 0, "is_clear": True, **lane}
    bench.part.load({**bench.part.save(), **kept})
    said = combine(HERE, there, Phase.CUTS, remaining=70.0, calls=True, may_unload=may_unload, speed=speed)
    told = {"task": 2, "remaining": 0.0, "calls": True, "may_unload": True, "speed": 0.0}
    job = bench.step(said, 0.2, other_1=combine(HERE, Place(200.0, 96.0, NORTHWARD), phase, **told))
    assert (job.phase == Phase.WAITS) is leaves


@pytest.mark.parametrize(("level", "goal"), [(0.3, "truck"), (0.0, "place")])
def test_a_cart_on_its_way_to_its_place_brings_what_it_has_once_nobody_needs_it(level, goal):
    bench = CartBench(wait_m=(-40.0, -20.0))
    said = combine(HERE, AWAY, Phase.CUTS, task=1, remaining=80.0, stands_in=100.0, may_unload=True)
    assert bench.ends_in(said, level).phase == Phase.DRIVES
    assert bench.part._goal == "place"
    jobs = [bench.step(replace(said, phase=Phase.DONE, speed=0.0), level) for _ in range(60)]
    assert jobs[-1].phase == Phase.DRIVES
    assert bench.part._goal == goal
