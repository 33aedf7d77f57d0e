"""Which combine takes which side and land: shared out, whoever is done a moment earlier."""

import math
from itertools import permutations

import numpy as np
import pytest

from swath.job.engine import Job
from swath.job.events import Events
from swath.job.machines import fleet_of
from swath.job.path import Pose
from swath.job.plan import PlannedPass, Shared
from swath.job.states import way_between
from swath.job.team import LEAD
from swath.job.work import plan_of
from tests.job.jobs import job_file


def job_of(combines, rounds, **field):
    """A job whose combines all cut, and end it at made-up places."""
    file = job_file(combines, 1, plan={"headland_rounds": rounds, "land_passes": 4}, **field)
    fleet = fleet_of(file)
    return Job(file, plan_of(file, fleet, None), fleet, Events())


def ends_at(job, places):
    for c, (x, y) in zip(job.combines, places, strict=True):
        c.task = PlannedPass(np.array([[x - 50.0, y], [x, y]]))
        c.place = Pose(x - 50.0, y, 0.0)


def shortest(job, firsts):
    """Least sum of the ways from the ends of what combines cut to passes, each to another one [m]."""
    ends = [c.task.end for c in job.combines]
    return min(
        math.fsum(way_between(e, job.passes[i].start) for e, i in zip(ends, order, strict=True))
        for order in permutations(firsts, len(ends))
    )


@pytest.mark.parametrize("places", [[(590, 20), (10, 280)], [(300, 290), (320, 10)], [(10, 150), (12, 160)]])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_lands_are_those_to_which_ways_are_shortest_together_whoever_asks_first(places, order):
    job = job_of(2, 0)
    firsts = [next(i for i, p in enumerate(job.plan.passes) if p.land == land) for land in (0, 1)]
    ends_at(job, places)
    total = shortest(job, firsts)
    ends = [c.task.end for c in job.combines]
    taken = {n: job.passes.take(job.combines[n]) for n in order}
    assert sorted(taken.values()) == firsts
    assert math.fsum(way_between(ends[n], job.passes[i].start) for n, i in taken.items()) == pytest.approx(
        total
    )


def test_passes_that_are_shared_out_before_are_cut_as_told():
    """By whom, and in which order."""
    file = job_file(2, 1, plan={"headland_rounds": 1, "land_passes": 4})
    fleet = fleet_of(file)
    plan = plan_of(file, fleet, None)
    by = [int(i % 3 == 0) for i in range(len(plan.passes))]
    job = Job(file, Shared(plan, by, {}), fleet, Events())
    job.run()
    assert sorted(job.passes.taken) == list(enumerate(by))
    for n in range(2):
        own = [i for i, number in job.passes.taken if number == n]
        assert own == sorted(own)


@pytest.mark.parametrize(("come", "follows"), [(LEAD + 1.0, True), (LEAD - 1.0, False)])
def test_a_combine_follows_one_that_is_well_ahead_round_the_field(come, follows):
    """It ends where that one has begun a side, the other ones left are at the other end of the field."""
    job = job_of(2, 2)
    ahead, behind = job.combines
    sides = [i for i, p in enumerate(job.plan.passes) if p.kind == "headland"]
    outer = [i for i in sides if job.plan.passes[i].round_index == 0]
    first = outer[0]
    (inner,) = (i for i in sides if job.passes._outside[i] == {first})
    start = job.plan.passes[first].start
    for index in (first, outer[-1]):
        job.passes._headland.remove(index)
    ends_at(job, [(start.x, start.y)] * 2)
    ahead.task, ahead.index, ahead.phase = job.plan.passes[first], first, "cut"
    ahead.left = ahead.task.length - come
    assert (job.passes.take(behind) == inner) is follows


@pytest.mark.parametrize(("combines", "rounds"), [(2, 2), (2, 3), (3, 2), (3, 3)])
def test_no_side_is_begun_before_the_one_outside_of_it_is_cut_or_well_ahead(combines, rounds):
    job = job_of(combines, rounds)
    job.run()
    fastest = max(c.speed for c in job.fleet.combines)
    sides = [i for i, p in enumerate(job.plan.passes) if p.kind == "headland"]
    inner = [i for i in sides if job.plan.passes[i].round_index > 0]
    assert all(len(job.passes._outside[i]) == 1 for i in inner)
    begun = 0
    for i in inner:
        (outside,) = job.passes._outside[i]
        begin, (before, end) = job.pass_times[i][0], job.pass_times[outside]
        assert begin >= min(end, before + LEAD / fastest)
        begun += begin < end
    assert begun > 0 or combines == 2


def test_a_cart_may_drive_on_what_the_one_ahead_has_cut():
    """Beside the second round, clockwise, under the pipe."""
    job = job_of(3, 3)
    job.run()
    for i, p in enumerate(job.plan.passes):
        if p.kind == "headland" and p.round_index > 0:
            assert job.passes[i].cart_beside


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_sides_of_a_round_are_shared_out_whoever_asks_first(order):
    job = job_of(3, 1)
    ends_at(job, [(595, 10), (300, 295), (5, 290)])
    taken = {n: job.passes.take(job.combines[n]) for n in order[:1]}
    sides = [i for i, p in enumerate(job.plan.passes) if p.kind == "headland"]
    best = min(
        permutations(sides, 3),
        key=lambda found: sum(
            way_between(c.task.end, job.plan.passes[i].start)
            for c, i in zip(job.combines, found, strict=True)
        ),
    )
    assert taken == {order[0]: best[order[0]]}


def test_with_more_combines_than_sides_each_takes_the_nearest():
    job = job_of(3, 1)
    first = {job.passes.take(c) for c in job.combines}
    ends_at(job, [(595, 10), (300, 295), (5, 290)])
    (last,) = {i for i, p in enumerate(job.plan.passes) if p.kind == "headland"} - first
    assert job.passes.take(job.combines[1]) == last


@pytest.mark.parametrize(("combines", "count", "tried"), [(3, 9, True), (6, 9, False)])
def test_where_there_are_too_many_orders_each_takes_the_nearest(monkeypatch, combines, count, tried):
    """Three have 504 orders of nine passes, six 60,480."""
    job, asked = job_of(combines, 2), []
    ends_at(job, [(90.0 * i, 20.0 * i) for i in range(combines)])
    monkeypatch.setattr("swath.job.team.permutations", lambda *a: asked.append(a) or permutations(*a))
    taken = job.passes._shared(job.combines[0], job.combines, list(range(count)))
    assert bool(asked) is tried
    if not tried:
        end = job.combines[0].task.end
        assert taken == min(range(count), key=lambda i: way_between(end, job.passes[i].start))


@pytest.mark.parametrize(("cuts", "helps"), [(20.0, False), (50.0, True)])
def test_the_only_pass_left_is_taken_where_the_helper_is_there_first_with_its_turn(cuts, helps):
    """Its way takes 30 s; each of the two turns before it."""
    job = job_of(2, 0)
    helper, own = job.combines
    land = max(job.passes._lands)
    for queue in job.passes._lands.values():
        queue.clear()
    job.passes._lands[land].append(len(job.plan.passes) - 1)
    job.passes._own = {own.number: land}
    start = job.plan.passes[-1].start
    helper.place = Pose(start.x, start.y - 30.0 * helper.spec.transport, 0.0)
    own.phase, own.pace, own.left = "cut", 2.0, 2.0 * cuts
    assert (job.passes.take(helper) is not None) is helps


def test_who_comes_too_late_in_one_land_helps_in_another_one():
    job = job_of(3, 0)
    helper, soon, later = job.combines
    lands = sorted(job.passes._lands)[:2]
    for queue in job.passes._lands.values():
        queue.clear()
    for land, index in zip(lands, (0, len(job.plan.passes) - 1), strict=True):
        job.passes._lands[land].append(index)
    job.passes._own = {soon.number: lands[0], later.number: lands[1]}
    helper.place = Pose(300.0, 150.0, 0.0)
    for c, left in ((soon, 2.0), (later, 1000.0)):
        c.phase, c.pace, c.left = "cut", 2.0, left
    assert job.passes.take(helper) == len(job.plan.passes) - 1
    assert job.passes.take(helper) is None
