"""One combine and two carts that hear each other: one serves, the other waits; until all is empty."""

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely import LineString, Point

from swath.control.job import carts
from swath.control.job.calls import Calls
from swath.control.job.cart_ways import LESS, CartWays, _close
from swath.control.job.carts import AROUND, WAITS, OtherCart, discs_of, free_of, is_taken, way_left
from swath.control.job.passes import Pass
from swath.control.job.right_of_way import outline_of
from swath.control.steer.guidance_line import GuidanceLine
from swath.control.turns.dubins import Place
from swath.core.errors import InputError
from swath.job.machines import fleet_of
from swath.job.work import plan_of
from swath.signals import (
    GuidancePath,
    HeapState,
    JobState,
    MachineLoad,
    MachineState,
    PeerState,
    Phase,
    UnloadState,
)
from swath.tools.fleet.scenario import scenario_of
from swath.tools.fleet.waiting import APART, OFF_WAYS, axle_ways, waiting_places
from swath.tools.fleet.whole import share_uncut
from swath.tools.fleet.work_plan import work_plan
from tests.job.cheap import CheapRun
from tests.job.jobs import job_file
from tests.job.layouts import layout, layout_file

FIELD = [(0.0, 0.0), (50.0, 0.0), (50.0, 19.5), (0.0, 19.5)]
JOB = job_file(
    carts=2,
    boundary_m=FIELD,
    plan={"headland_rounds": 0},
    combine={"machine": "combine-5m", "call_percent": 5.0, "tank_start_percent": 8.0},
    cart={"leave_percent": 1.0},
    truck={"x_m": -25.0, "y_m": 25.0, "dock_s": 2.0},
)
CARTS = "cart_0", "cart_1"
MACHINES = "combine_0", *CARTS


class Run(CheapRun):
    """rows: at every step of the combine's job, time [s], phases and tasks of both carts, flow [kg/s]"""

    def __init__(self):
        self.rows = []
        super().__init__(JOB)
        self.table = np.array(self.rows)

    def see(self, slot, t):
        if slot == "combine_0.job" and ("combine_0", UnloadState) in self.latest:
            jobs = [self.latest[cart, JobState] for cart in CARTS]
            flow = self.latest["combine_0", UnloadState].flow
            self.rows.append((t * 1e-9, *(j.phase for j in jobs), *(j.task for j in jobs), flow))


@pytest.fixture(scope="module")
def run():
    return Run()


def test_the_field_gets_empty_and_both_carts_bring_grain(run):
    assert "the field is empty" in run.world.graph.ended
    assert share_uncut(run.world.field, run.plan) < 1e-3
    heaps = [run.latest[cart, HeapState] for cart in CARTS]
    assert all(heap.emptied > 100.0 for heap in heaps)
    assert sum(heap.grain for heap in heaps) == pytest.approx(0.0, abs=1e-6)
    assert run.latest["combine_0", MachineLoad].tank_level < 0.005
    metrics = run.evaluation.metrics("field")
    assert metrics["mass_balance_error"] < 1e-9
    assert metrics["spill_share"] <= 1e-3


def test_nothing_touches(run):
    """Tyres of a trailer abreast of the header of the 5 m combine would be 0.3 m off: 4.8 - 2.7 - 1.8 m."""
    for name in MACHINES:
        metrics = run.evaluation.metrics(name)
        assert metrics["contact_count"] == 0.0
        assert metrics["least_clearance_m"] > 0.5


def test_one_cart_at_a_time_serves_the_combine(run):
    """Of the other one the messages name no pass, within their delay; grain flows to a cart beside."""
    phases, tasks, flow = run.table[:, 1:3], run.table[:, 3:5], run.table[:, 5]
    assert ((tasks >= 0).sum(axis=1) < 2).all()
    assert ((phases == Phase.BESIDE).sum(axis=1) < 2).all()
    assert (flow > 0.0).sum() > 100
    assert (phases[flow > 0.0] == Phase.BESIDE).any(axis=1).all()


def test_they_wait_in_places_of_their_own(run):
    """In the end each stands there, or beside the truck."""
    places = [np.array(run.world.machines[cart].parts["job"]._p.wait_m) for cart in CARTS]
    ends = [run.latest[cart, MachineState].pose.position[:2] for cart in CARTS]
    assert all(np.hypot(*(end - place)) < 7.0 for end, place in zip(ends, places, strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_waiting_places_lie_off_the_ways_of_the_combine(seed):
    file = job_file(**layout(seed))
    fleet = fleet_of(file)
    made = work_plan(file, plan_of(file, fleet, None), fleet).shared
    truck = file.truck.x_m, file.truck.y_m
    ways = [axle_ways(made, i, c, 20.0) for i, c in enumerate(fleet.combines)]
    places = waiting_places(made.plan, ways, truck, 2)
    for place in places:
        assert min(np.hypot(*(way - place).T).min() for way in ways) >= OFF_WAYS - 0.1
        assert math.dist(place, truck) >= APART
    assert math.dist(*places) >= APART


@pytest.mark.parametrize(
    ("truck", "stays"), [((100.0, 40.0), False), ((100.0, -5.0), False), ((100.0, -16.0), True)]
)
def test_a_truck_in_the_field_or_near_it_stands_farther_out(truck, stays):
    """Where headers of opening rounds and turns do not come; as far as at the other levels."""
    file = job_file(truck=dict(zip(("x_m", "y_m"), truck, strict=True)), plan={"land_passes": 2})
    fleet = fleet_of(file)
    cart = scenario_of(file, work_plan(file, plan_of(file, fleet, None), fleet), fleet)["machines"]["cart_0"]
    place = tuple(cart["job"]["truck_m"])
    assert place == (cart["start"]["x_m"], cart["start"]["y_m"])
    assert place == pytest.approx(truck if stays else (100.0, -20.0))


@pytest.mark.parametrize("carts", [1, 2])
def test_a_truck_near_the_ways_of_combines_stands_off_them(carts):
    """A cart at it stopped a combine in its turn, and had no way past it to the other one: for good."""
    file = layout_file(7, carts)
    at = file.truck.x_m, file.truck.y_m
    fleet = fleet_of(file)
    work = work_plan(file, plan_of(file, fleet, None), fleet)
    ways = [axle_ways(work.shared, i, c, 20.0) for i, c in enumerate(fleet.combines)]

    def off_ways(place):
        return min(LineString(way).distance(Point(place)) for way in ways)

    assert off_ways(at) < OFF_WAYS - 2.0
    made = scenario_of(file, work, fleet)["machines"]
    places = [made[f"cart_{n}"]["job"]["truck_m"] for n in range(carts)]
    assert places == [places[0]] * carts
    assert OFF_WAYS - 0.1 <= off_ways(places[0]) < OFF_WAYS + 0.1
    assert math.dist(places[0], at) < 20.0


def test_without_room_to_wait_a_job_is_refused():
    fleet = fleet_of(JOB)
    made = work_plan(JOB, plan_of(JOB, fleet, None), fleet).shared
    way = axle_ways(made, 0, fleet.combines[0], 20.0)
    with pytest.raises(InputError, match="room beside the field"):
        waiting_places(made.plan, [way], (1000.0, 1000.0), 2)


def said(phase, task=-1, x=50.0, y=0.0):
    return PeerState(0, True, 0.1, x, y, 0.0, 2.0, 0.0, phase=phase, task=task)


def other(number, phase, task=-1, at=(50.0, 0.0), way=()):
    path = GuidancePath(0, np.array([x for x, _ in way]), np.array([y for _, y in way]), 1)
    return OtherCart(number, said(phase, task, *at), Place(*at, 0.0), path)


def test_a_call_that_both_take_is_left_to_the_first():
    calls, combine = Calls([Pass(((0.0, 0.0), (0.0, 50.0)))] * 4, 15.0), said(Phase.CUTS, task=1)
    here = Place(0.0, 0.0, 0.0)  # 50 m from the combine
    as_near = {"task": 3, "at": (35.0, 40.0)}
    assert calls.withdraws(combine, here, 1, [other(0, Phase.DRIVES, **as_near)])
    assert not calls.withdraws(combine, here, 0, [other(1, Phase.DRIVES, **as_near)])
    assert not calls.withdraws(combine, here, 1, [other(0, Phase.DRIVES)])


@pytest.mark.parametrize(("x", "number", "own", "withdraws"), [(25.0, 1, 0, True), (125.0, 0, 1, False)])
def test_a_call_that_both_take_is_left_to_the_nearer_one(x, number, own, withdraws):
    """25 and 75 m from the combine, the own one 50 m."""
    calls, combine = Calls([Pass(((0.0, 0.0), (0.0, 50.0)))] * 4, 15.0), said(Phase.CUTS, task=1)
    cart = other(number, Phase.DRIVES, task=3, at=(x, 0.0))
    assert calls.withdraws(combine, Place(0.0, 0.0, 0.0), own, [cart]) is withdraws


@pytest.mark.parametrize(("phase", "task", "serves", "is_spare"), [
    (Phase.CUTS, 3, 3, True),
    (Phase.CUTS, 3, -1, False),  # the other one serves nobody
    (Phase.CUTS, 2, 2, False),  # it is not its last pass
    (Phase.DONE, 3, -1, True),
])  # fmt: skip
def test_a_cart_is_spare_where_another_one_serves_in_the_last_pass(phase, task, serves, is_spare):
    calls = Calls([Pass(((0.0, 0.0), (0.0, 50.0)))] * 4, 15.0)
    carts = [other(0, Phase.BESIDE, task=serves)]
    assert calls.is_spare([said(phase, task=task)], carts) is is_spare
    assert not calls.is_spare([said(phase, task=task), said(Phase.CUTS, task=1)], carts)


@pytest.mark.parametrize(("number", "left", "taken"), [
    (1, 75.0, True), (1, 55.0, False), (1, 25.0, False),  # the other one, number 2, has 48 m to go
    (3, 75.0, True), (3, 55.0, True), (3, 25.0, False),
])  # fmt: skip
def test_the_truck_is_taken_by_who_is_nearer_on_its_way_there(number, left, taken):
    comes = other(2, Phase.DRIVES, at=(48.0, 0.0), way=[(48.0, 0.0), (2.0, 0.0)])
    assert is_taken((0.0, 0.0), number, left, [comes]) is taken


def test_the_truck_is_taken_by_who_stands_there():
    assert is_taken((0.0, 0.0), 0, 5.0, [other(1, Phase.EMPTIES, at=(3.0, 0.0))])
    assert not is_taken((0.0, 0.0), 0, 90.0, [other(1, Phase.WAITS)])


def test_a_way_to_the_combine_leads_on_along_the_line_beside_the_pass():
    x, y = np.array([0.0, 10.0, 20.0, 90.0]), np.zeros(4)
    path, here = GuidancePath(0, x, y, 1), Place(9.0, 0.0, 0.0)
    to_pass = way_left(here, said(Phase.DRIVES, task=2), path)
    assert to_pass[0] == (10.0, 0.0)
    assert to_pass[-1] == pytest.approx((60.0, 0.0))  # the pass ends 30 m before that line
    in_lane = way_left(Place(40.0, 0.0, 0.0), said(Phase.DRIVES, task=2), path)
    assert in_lane[0] == pytest.approx((40.0, 0.0), abs=1.5)
    assert np.diff([x for x, _ in in_lane]).max() <= 3.0
    assert way_left(here, said(Phase.DRIVES), path)[-1] == (90.0, 0.0)
    told = replace(said(Phase.DRIVES), body_front=4.6)  # it stands there as far as it reaches ahead
    assert way_left(here, told, path)[-1] == pytest.approx((94.6, 0.0))
    assert way_left(here, said(Phase.WAITS), path) == []
    beside = way_left(here, said(Phase.BESIDE, task=2), path)
    assert beside[0] == (9.0, 0.0)
    assert beside[-1] == pytest.approx((60.0, 0.0))
    assert np.diff([x for x, _ in beside]).max() <= 3.0
    assert way_left(Place(85.0, 0.0, 0.0), said(Phase.BESIDE, task=2), path)[-1] == (85.0, 0.0)


@pytest.mark.parametrize(("first", "own", "free"), [(0, 1, 7.0), (1, 0, math.inf)])
def test_of_two_carts_whose_ways_cross_the_first_goes_on(first, own, free):
    """The other one comes from the left and crosses the own way 17 m ahead. Its outline of 2 m, 3 m kept and
    6.5 m before the own axle leave 6.5 m, looked at every metre.
    """
    comes = other(first, Phase.DRIVES, at=(17.0, 14.0), way=[(17.0, 14.0 - 3.0 * i) for i in range(10)])
    comes = comes._replace(at=Place(17.0, 14.0, -0.5 * math.pi), said=replace(comes.said, speed=4.0))
    line = GuidanceLine([(0.0, 0.0), (60.0, 0.0)], "path")
    found = free_of([comes], Place(0.0, 0.0, 0.0), line, 0.0, 4.0, own)
    assert found == pytest.approx(free, abs=1.0)


def test_a_cart_that_comes_by_a_little_off_its_way_is_not_taken_to_turn():
    """Northward, 10 m beside one that drives south: a point of its way lies abreast of it, 0.1 m off."""
    box = {"box_x": -5.5, "box_y": 0.0, "box_length": 6.0, "box_width": 3.0, "box_heading": 0.0}
    way = [(10.1, 16.02), *((10.1, 16.0 + 3.0 * i) for i in range(1, 10))]
    comes = other(0, Phase.DRIVES, at=(10.0, 16.0), way=way)
    comes = comes._replace(
        at=Place(10.0, 16.0, 0.5 * math.pi), said=replace(comes.said, speed=4.2, x=16.0, y=10.0, **box)
    )
    line, here = GuidanceLine([(0.0, 32.0), (0.0, -30.0)], "path"), Place(0.0, 32.0, -0.5 * math.pi)
    assert free_of([comes], here, line, 0.0, 2.0, 2) == math.inf


def test_a_trailer_that_stands_bent_counts_where_it_is():
    at, box = Place(0.0, 0.0, 0.0), {"box_x": -7.0, "box_y": -2.0, "box_length": 6.0, "box_width": 3.0}
    bent = outline_of(
        replace(said(Phase.WAITS), **box, box_heading=0.5 * math.pi)
    )  # y -5 to 1, x -8.5 to -5.5
    assert bent.away(at, -7.0, -5.5) == pytest.approx(0.5)
    assert bent.least([at], -4.5, -2.0, 3.0) == pytest.approx(1.0)
    rim = np.array(bent.points(at))  # x -8.5 to -5.5, y -5 to 1
    assert rim.min(axis=0) == pytest.approx([-8.5, -5.0])
    assert rim.max(axis=0) == pytest.approx([-5.5, 1.0])
    assert max(bent.away(at, x, y) for x, y in rim) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("taken", [False, True])
def test_a_cart_that_is_to_stand_has_room_ahead(taken):
    """East of its place another one drives by."""
    passes = (Pass(((6.0, 0.0), (6.0, 80.0))),)
    ways = CartWays(
        passes, [(0.0, 0.0), (12.0, 0.0), (12.0, 80.0), (0.0, 80.0)], 12.0, 8.2, 9.0, [(50.0, 90.0)]
    )
    others = [(66.0, y, 3.5) for y in range(60, 100, 3)] if taken else []
    way = ways.to_place(
        Place(-20.0, 40.0, 0.5 * math.pi), (60.0, 80.0), said(Phase.CUTS, task=0, x=90.0), others
    )
    (ax, ay), (bx, by) = way.points[-2:]
    east = (bx - ax) / math.hypot(bx - ax, by - ay)
    assert bool(east < 0.6) is taken


@pytest.mark.parametrize(("present", "x"), [(0, 18.0 - 8.2 - 0.7), (1, 18.0 - 8.2)])
def test_where_the_header_comes_by_its_trailer_a_cart_waits_farther_out(present, x):
    """Ahead of the combine, on the line beside a pass to come; behind it the line leads under the pipe."""
    passes = (Pass(((6.0, 0.0), (6.0, 80.0))), Pass(((18.0, 0.0), (18.0, 80.0))))
    ways = CartWays(passes, [(0.0, 0.0), (24.0, 0.0), (24.0, 80.0), (0.0, 80.0)], 12.0, 8.2, 9.0)
    combine = said(Phase.TURNS, task=present, x=90.0)
    way = ways.to_pass(Place(10.0, -25.0, 0.5 * math.pi), 1, combine)
    assert way.points[-2:, 0] == pytest.approx([x, x])


def test_carts_that_stand_are_passed_nearer_where_there_is_no_other_way():
    """Not the ways that they drive; and from near by only as far as the cart is from them."""
    taken = [(20.0, 0.0, AROUND), (30.0, 0.0, 3.5), (4.0, 0.0, AROUND)]
    start = Place(0.0, 0.0, 0.0)
    assert [size for *_, size in _close(start, taken, 0.0)] == [AROUND, 3.5, pytest.approx(2.55)]
    assert [size for *_, size in _close(start, taken, LESS)] == [AROUND - LESS, 3.5, AROUND - LESS]


@pytest.mark.parametrize(("size", "gets_out"), [(carts.APART, False), (WAITS, True)])
def test_a_cart_gets_out_of_the_way_over_that_of_one_which_stands(size, gets_out):
    """To a place, where there is no other way; it does not set out to a combine so."""
    passes = (Pass(((6.0, 0.0), (6.0, 80.0))),)
    ways = CartWays(passes, [(0.0, 0.0), (12.0, 0.0), (12.0, 80.0), (0.0, 80.0)], 12.0, 8.2, 9.0)
    here, peer = Place(-15.0, 60.0, 0.5 * math.pi), said(Phase.CUTS, task=0, x=90.0)
    across = [(float(x), -5.0, size) for x in range(-60, 70, 3)]
    assert ways.to_place(here, (6.0, -20.0), peer) is not None
    assert (ways.to_place(here, (6.0, -20.0), peer, across) is not None) is gets_out
    beyond, near = Place(-20.0, -20.0, 0.0), replace(peer, x=30.0, y=30.0)
    assert ways.to_pass(beyond, 0, near) is not None
    assert ways.to_pass(beyond, 0, near, across) is None


@pytest.mark.parametrize(("speed", "size"), [(0.0, WAITS), (2.0, carts.APART)])
def test_the_way_of_a_cart_is_told_from_that_of_one_which_stands(speed, size):
    path = GuidancePath(0, np.array([0.0, 40.0]), np.zeros(2))
    at = Place(0.0, 0.0, 0.0)
    cart = OtherCart(1, replace(said(Phase.DRIVES, task=-1), speed=speed), at, path)
    sizes = [disc[2] for disc in discs_of([cart])]
    assert set(sizes) == {AROUND, size}


def comes_by(to, speed=4.0):
    """Another cart that drives north, from 20 m before (60, 80), past that or so far."""
    path = GuidancePath(0, np.array([60.0, 60.0]), np.array([60.0, to]))
    drives = replace(said(Phase.DRIVES, task=-1), speed=speed)
    return OtherCart(0, drives, Place(60.0, 60.0, 0.5 * math.pi), path)


@pytest.mark.parametrize(("to", "speed", "away", "is_left_out"), [
    (140.0, 4.0, 60.0, True),
    (140.0, 4.0, 30.0, False),  # it would be there before
    (140.0, 0.0, 60.0, False),  # the other one stands
    (80.0, 4.0, 60.0, True),
    (80.0, 4.0, 10.0, True),  # it comes there later
])  # fmt: skip
def test_about_a_place_where_others_are_past_before_a_cart_comes_they_do_not_count(
    to, speed, away, is_left_out
):
    place = 60.0, 80.0
    near = [
        disc for disc in discs_of([comes_by(to, speed)], place, away) if math.dist(disc[:2], place) < 12.0
    ]
    assert bool(near) is not is_left_out
    assert any(math.dist(disc[:2], place) < 12.0 for disc in discs_of([comes_by(to, speed)]))


def test_a_cart_finds_a_way_to_where_another_one_drives_by_before():
    passes = (Pass(((6.0, 0.0), (6.0, 80.0))),)
    ways = CartWays(
        passes, [(0.0, 0.0), (12.0, 0.0), (12.0, 80.0), (0.0, 80.0)], 12.0, 8.2, 9.0, [(60.0, 80.0)]
    )
    here, place, peer = Place(-20.0, 40.0, 0.5 * math.pi), (60.0, 80.0), said(Phase.CUTS, task=0, x=90.0)
    around = [
        (60.0 + 5.0 * math.cos(a), 80.0 + 5.0 * math.sin(a)) for a in np.linspace(0.0, 6.0, 13).tolist()
    ]
    now = [(x, y, carts.APART) for x, y in around]
    assert ways.to_place(here, place, peer, now) is None
    assert ways.to_place(here, place, peer, now, past=[]).points[-1] == pytest.approx(place)
