"""Carts that drive straight over cut ground where that is shorter."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from swath.job import ways
from swath.job.cart_ways import box_behind, box_offset, way_beside
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.ground import CutGround
from swath.job.machines import fleet_of
from swath.job.path import Pose
from swath.job.plan import PlannedPass
from swath.job.states import at
from swath.job.truck_ways import STRAIGHT_IN, way_into_lane
from swath.job.turns import dubins
from swath.job.work import plan_of
from tests.job.jobs import job_file
from tests.job.layouts import layout_file

WIDTH, KEEP = 6.0, 2.0
TRUCK = Pose(0.0, -50.0, 0.0)


def lines(rng, count):
    """Passes at random: straight ones, and two with a bend."""
    for i in range(count):
        x, y, course, length = *rng.uniform(0.0, 200.0, 2), rng.uniform(0.0, 6.3), rng.uniform(20.0, 150.0)
        u, v = x + length * math.cos(course), y + length * math.sin(course)
        line = np.array([[x, y], [u, v], [u + 20.0, v + 5.0]])
        yield PlannedPass(line if i < 2 else line[:2])


def strip(line, width=WIDTH):
    """Pieces of a pass, each as wide as the header and `KEEP` more on all sides."""
    pieces = [shapely.LineString(pair) for pair in pairwise(line)]
    boxes = [shapely.buffer(p, 0.5 * width, cap_style="flat") for p in pieces]
    return shapely.union_all([shapely.buffer(b, KEEP, join_style="mitre") for b in boxes])


@pytest.mark.parametrize("seed", range(5))
def test_where_crop_stands_is_where_no_pass_is_done(seed):
    """Against shapely: done passes, one that is being cut, and the others."""
    rng = np.random.default_rng(seed)
    passes = tuple(lines(rng, 7))
    ground = CutGround(passes, WIDTH, 8.0)
    for index in (1, 3, 4):
        ground.cut(index)
    rest = np.array([passes[5].at(0.4 * passes[5].length)[:2], passes[5].line[-1]])
    stands = shapely.union_all(
        [strip(line) for line in (passes[0].line, passes[2].line, passes[6].line, rest)]
    )
    points = rng.uniform(-20.0, 260.0, (800, 2))
    found = [not ground.is_clear(p[None], KEEP, [(5, rest)]) for p in points]
    inside = shapely.contains_xy(stands, points)
    assert (np.array(found) == inside).all()
    assert 10 < inside.sum() < 400
    assert ground.is_clear(points[~inside], KEEP, [(5, rest)])
    assert not ground.is_clear(points, KEEP, [(5, rest)])


@pytest.fixture
def job():
    """A combine that has cut 300 m of a pass of 400 m to the east, and a cart, 150 m to the left."""
    file = job_file(1, 1)
    fleet = fleet_of(file)
    made = Job(file, plan_of(file, fleet, None), fleet, Events())
    c = made.combines[0]
    c.task = PlannedPass(np.array([[0.0, 0.0], [400.0, 0.0]]))
    c.phase, c.left, c.per_metre = "cut", 100.0, 9.0
    return made


@pytest.mark.parametrize("phase", ["cut", "stand"])
def test_a_cart_comes_straight_to_behind_its_place(job, phase):
    c, cart, here = job.combines[0], job.carts[0].spec, Pose(200.0, 150.0, -0.5)
    c.phase = phase
    along = way_beside(here, c, cart, TRUCK)
    path, base, length, onto = way_beside(here, c, cart, TRUCK, is_free=lambda way: True)
    goal = base + 300.0
    assert goal < along.begin + 300.0 - 150.0
    place = 300.0 - box_offset(c.spec) + box_behind(cart)
    assert path.at(goal).x == pytest.approx(place, abs=0.1)
    assert goal < dubins.length(here, Pose(place - 8.0, path.at(goal).y, 0.0), 8.0) + 8.0 + 25.0
    assert length == 400.0
    assert path.at(onto).y == pytest.approx(path.at(goal).y, abs=0.01)
    assert np.abs(path.curvature).max() < 1.0 / 7.9


def test_it_comes_clear_of_its_combine(job):
    """From ahead of it, on its left: round behind it."""
    c = job.combines[0]
    path, base, *_ = way_beside(
        Pose(390.0, 20.0, math.pi), c, job.carts[0].spec, TRUCK, is_free=lambda way: True
    )
    header = at(c)
    box = shapely.box(header.x - 9.0, -3.5, header.x + 1.0, 3.5)
    there = path.points[path.distance < base + 295.0]
    assert shapely.distance(shapely.LineString(there), box) > 1.9
    assert base + 300.0 < 200.0


def test_over_standing_crop_it_comes_as_before(job):
    c, cart, here = job.combines[0], job.carts[0].spec, Pose(200.0, 150.0, -0.5)
    before = way_beside(here, c, cart, TRUCK)
    blocked = way_beside(here, c, cart, TRUCK, is_free=lambda way: False)
    assert (blocked.path.points == before.path.points).all()


@pytest.mark.parametrize(("x", "course"), [(-150.0, 0.0), (150.0, math.pi), (-90.0, 2.0)])
def test_to_the_truck_from_the_side_that_is_nearer(x, course):
    here, place = Pose(x, 200.0, course), Pose(0.0, -20.0, 0.0)
    before = way_into_lane(here, place)
    way = way_into_lane(here, place, is_free=lambda way: True)
    ends = [Pose(side * -STRAIGHT_IN, -20.0, 0.0 if side > 0 else math.pi) for side in (1, -1)]
    shortest = min(dubins.length(here, end, 8.0) for end in ends) + STRAIGHT_IN
    assert way.length == pytest.approx(shortest, abs=0.1)
    assert way.length < before.length - 10.0
    assert (way.end.x, way.end.y, math.sin(way.end.heading)) == pytest.approx((0.0, -20.0, 0.0), abs=0.05)


def test_a_cart_turns_about_to_the_left_where_no_way_is_over_cut_ground():
    """Beside a combine that goes on: not across in front of that, as on layout 10 with one cart."""
    here, place = Pose(0.0, 0.0, 3.068), Pose(20.3, -141.0, 0.013)
    to_cut = shapely.box(-200.0, 3.0, 1.0, 15.0)

    def is_off(way):
        return shapely.distance(shapely.LineString(way.points), to_cut) > 0.0

    before = way_into_lane(here, place, is_beside=True)
    way = way_into_lane(here, place, is_beside=True, is_free=lambda way: False, is_off=is_off)
    assert not is_off(before)
    assert is_off(way)
    assert (way.end.x, way.end.y) == pytest.approx((20.3, -141.0), abs=0.05)
    assert way.at(20.0)[:2] == pytest.approx((20.0 * math.cos(3.068), 20.0 * math.sin(3.068)), abs=1e-6)


@pytest.mark.parametrize("seed", [3, 5])
def test_ways_that_lead_straight_cross_no_crop_in_a_whole_job(seed, monkeypatch):
    """Held against what is cut then, by shapely; and the job is over sooner."""
    file = layout_file(seed, 1)
    fleet = fleet_of(file)
    job = Job(file, plan_of(file, fleet, None), fleet, Events())
    free, taken = ways.is_free, []

    def is_free(job, place, way):
        found = free(job, place, way)
        if found:
            left = [(c.index, c) for c in job.combines if c.phase in ("cut", "stand") and c.left > 1e-6]
            begun = dict(left)
            done = {i for i, (_, end) in job.pass_times.items() if not math.isnan(end)}
            half = 0.5 * fleet.combines[0].sheet.header_width
            crop = []
            for i in range(len(job.plan.passes)):
                if i in done:
                    continue
                p = job.passes[i] if i not in begun else begun[i].task
                begin = p.length - begun[i].left if i in begun else 0.0
                line = shapely.ops.substring(shapely.LineString(p.line), begin, p.length)
                crop.append(shapely.buffer(line, half, cap_style="flat"))
            taken.append(shapely.distance(shapely.LineString(way.points), shapely.union_all(crop)))
        return found

    monkeypatch.setattr(ways, "is_free", is_free)
    job.run()
    assert len(taken) > 4
    assert min(taken) > ways.CROP - 0.2  # between points of the way that are looked at
    monkeypatch.setattr(ways, "is_free", lambda *_: False)
    before = Job(file, job.plan, fleet, Events())
    before.run()
    assert job.time < before.time
