"""Ways of carts where passes are shared out before the job: those that carts with sensors find."""

import copy
import math

import numpy as np
import pytest
import shapely

from swath.control.job.passes import way_along
from swath.job import shared_ways
from swath.job.cart_ways import beside
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.messages import Messages
from swath.job.path import Pose, path_of, polyline, through
from swath.job.states import at
from swath.job.turns import TurnLimits, dubins
from swath.job.work import plan_of
from swath.signals import Phase
from swath.tools.fleet.work_plan import share_out
from tests.job.jobs import digests_of_copied, job_file

FIELD = [(0.0, 0.0), (400.0, 0.0), (400.0, 200.0), (0.0, 200.0)]


@pytest.fixture(scope="module")
def told():
    """Two combines that have to wait for their one cart: their file, and the passes shared out."""
    file = job_file(2, 1, boundary_m=FIELD, truck={"x_m": 200.0, "y_m": -20.0})
    fleet = fleet_of(file)
    return file, share_out(file, plan_of(file, fleet, None), fleet)


def found(told, motion=Events, until=math.inf):
    """The job, and of each way that a cart found to its combine: the way, its length to the cart's place and
    that of the one known, what stands of the field then (shapely), where the cart is, and the combine.
    """
    file, shared = told
    job, ways = Job(file, shared, fleet_of(file), motion()), []
    search = job.shared_ways.to_combine

    def noted(cart, here, out, combines, known):
        made = search(cart, here, out, combines, known)
        if made is not None:
            c = copy.copy(cart.combine)
            ways.append((made, made.place(c), known.place(c), standing(job), here, c))
        return made

    job.shared_ways.to_combine = noted
    job.run(until)
    return job, ways


def standing(job):
    """Ground that no combine has cut, less the overlap."""
    cut = []
    for i, p in enumerate(job.plan.passes):
        of = next((c for c in job.combines if c.index == i and c.phase in ("cut", "stand")), None)
        done = p.length - of.left if of else p.length if i in job.pass_times and job.pass_times[i][1] else 0.0
        if done > 0.5:
            line = shapely.LineString([p.start[:2], p.at(done)[:2]])
            cut.append(line.buffer(0.5 * job.plan.width + 0.2, cap_style="flat"))
    return shapely.Polygon(job.plan.boundary).difference(shapely.union_all(cut))


@pytest.fixture(scope="module")
def searched(told):
    return found(told)


def test_a_way_that_is_found_is_shorter_and_leads_over_cut_ground(searched):
    _, ways = searched
    assert len(ways) >= 3
    assert any(c.phase == "stand" for *_, c in ways)
    for made, long, before, crop, _, _ in ways:
        assert long < before - shared_ways.SHORTER
        to_line = made.path.points[made.path.distance <= made.onto]
        assert shapely.LineString(to_line).distance(crop) > 1.0


def test_it_leads_from_where_the_cart_is_to_its_place_and_to_the_end_of_the_pass(searched):
    """There its box is below the pipe, up to 0.7 m farther out."""
    job, ways = searched
    cart = job.carts[0].spec
    for made, long, _, _, here, c in ways:
        assert made.path.start[:2] == pytest.approx(here[:2], abs=1e-6)
        places = [(made.path.at(long), beside(at(c), c.spec, cart))]
        if c.task is not None:
            places.append((made.path.at(made.begin + made.length), beside(c.task.end, c.spec, cart)))
        for pose, place in places:
            assert math.hypot(pose.x - place.x, pose.y - place.y) < 0.75
            assert math.cos(pose.heading - place.heading) > 0.999


def test_the_job_is_over_sooner(told, searched, monkeypatch):
    file, shared = told
    monkeypatch.setattr(shared_ways.SharedWays, "to_combine", lambda *_: None)
    without = Job(file, shared, fleet_of(file), Events())
    without.run()
    assert searched[0].time < 0.98 * without.time


def test_driven_machines_take_as_long_and_touch_nothing(told, searched):
    job, ways = found(told, Kinematic)
    assert ways
    assert job.time == pytest.approx(searched[0].time, rel=0.05)
    assert [p for p in job.motion.watch.pairs if p.touched > 0.0] == []


def test_a_job_that_is_saved_goes_on_with_its_ways(told):
    again, whole = digests_of_copied(*told, at=1500.0)
    assert again == whole


def test_a_cart_hears_where_its_combine_is(told):
    job, _ = found(told, until=900.0)
    c = next(c for c in job.combines if c.phase in ("cut", "stand"))
    messages = Messages(told[1].told)
    here = Pose(30.0, 40.0, 2.0)
    said = messages.to_cart(c, here)
    cos, sin = math.cos(here.heading), math.sin(here.heading)
    x, y = here.x + cos * said.x - sin * said.y, here.y + sin * said.x + cos * said.y
    knife = at(c)
    assert math.hypot(knife.x - x, knife.y - y) == pytest.approx(c.spec.sheet.knife_x)
    assert math.remainder(here.heading + said.heading - knife.heading, 2.0 * math.pi) == pytest.approx(0.0)
    assert (said.task, said.phase) == (c.index, Phase.CUTS if c.phase == "cut" else Phase.STANDS)
    assert said.remaining == pytest.approx(c.left, abs=1e-6)
    assert said.come + said.remaining == pytest.approx(way_along(told[1].told[c.index].line_m))


def test_a_path_through_points_of_bends_has_their_direction_and_curvature():
    """Against the path of the same turns by quadrature; straights have points at their ends only."""
    limits = TurnLimits(9.0, 1.0)
    exact = path_of(dubins.plan(Pose(0.0, 0.0, 0.3), Pose(60.0, 25.0, 2.0), limits), Pose(0.0, 0.0, 0.3))
    turns = np.abs(exact.curvature) > 0.0
    keep = turns | np.roll(turns, 1) | np.roll(turns, -1)
    made = through(exact.points[keep], 9.0)
    assert made.length == pytest.approx(exact.length, abs=0.01)
    assert np.diff(made.distance).max() <= 1.0 + 1e-9
    for s in np.linspace(0.0, exact.length, 40):
        a, b = exact.at(s), made.at(s)
        assert math.hypot(a.x - b.x, a.y - b.y) < 0.02
        assert math.remainder(a.heading - b.heading, 2.0 * math.pi) == pytest.approx(0.0, abs=0.03)
    inner = np.interp(made.distance, exact.distance, exact.curvature)
    assert np.median(np.abs(made.curvature - inner)) < 1e-3
    assert np.abs(made.curvature).max() <= 1.0 / 9.0


def test_a_path_through_a_straight_has_no_curvature():
    made = through(np.array([(0.0, 0.0), (0.0, 0.0), (30.0, 40.0)]), 9.0)
    plain = polyline(np.array([(0.0, 0.0), (30.0, 40.0)]))
    assert made.length == pytest.approx(plain.length) == pytest.approx(50.0)
    assert not made.curvature.any()
    assert made.end == pytest.approx(plain.end)
