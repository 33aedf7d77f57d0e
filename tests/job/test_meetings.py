"""Where ways of combines meet whose passes are shared out: they wait for each other, as with sensors."""

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import pytest

from swath.control.job.crossings import Crossing, GivesWay
from swath.control.job.passes import Pass
from swath.control.steer.path import Segment
from swath.job.engine import DRIVES_UP, Job
from swath.job.events import Events
from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.meetings import Held, Meetings
from swath.job.plan import Shared
from swath.job.work import plan_of
from swath.tools.fleet.work_plan import share_out
from tests.job.jobs import digests_of_copied, job_file
from tests.job.layouts import layout_file

TURN = (Segment(20.0, 0.0, 0.0),)
PASSES = (
    Pass(((0.0, 0.0), (0.0, 100.0)), turn=TURN),
    Pass(((40.0, 0.0), (40.0, 100.0)), turn=TURN, combine=1),
    Pass(((10.0, 0.0), (10.0, 100.0))),
    Pass(((30.0, 0.0), (30.0, 100.0)), combine=1),
)
FIRST = GivesWay(1, 110.0, 0, 105.0, 99.5)  # the second waits at the end of its pass
INSTEAD = GivesWay(0, 104.0, 1, 115.0, 99.5)


def at(number, index, left, phase="cut", before=-1):
    spec = SimpleNamespace(turn_speed=2.0)
    return SimpleNamespace(
        number=number, index=index, left=left, phase=phase, before=before, speed=0.0, spec=spec
    )


def heard(*combines, instead=()):
    made = Meetings(PASSES, [Crossing((FIRST,), instead)], combines)
    made.update(0.0, combines)
    return made


@pytest.mark.parametrize(("other", "free"), [
    (at(0, 0, 30.0), 79.5),  # 70 m come: to the end of its pass
    (at(0, 2, 17.0, "way", before=0), 79.5),  # 3 m behind the end of its pass
    (at(0, 2, 14.0, "way", before=0), math.inf),  # past
    (at(0, 2, 90.0), math.inf),
    (at(0, -1, 0.0, "done"), math.inf),
])  # fmt: skip
def test_who_gives_way_waits_until_the_other_one_is_past(other, free):
    own = at(1, 1, 80.0)
    held = heard(other, own).held(own)
    assert held.free == pytest.approx(free)
    assert held.by == (0 if math.isfinite(free) else -1)


@pytest.mark.parametrize(("own", "is_held"), [
    (at(1, 1, 0.55), True),
    (at(1, 1, 2.0), False),
    (at(1, 3, 20.0, "way", before=1), True),  # it stood for a cart at its end
    (at(1, 3, 17.0, "way", before=1), False),  # on its turn already: as far as the crossing
    (at(1, 1, 0.55, "stand"), False),  # for a cart
])  # fmt: skip
def test_it_stands_at_the_end_of_its_pass(own, is_held):
    assert heard(at(0, 0, 30.0), own).held(own).is_held is is_held


def test_the_next_pass_counts_too():
    own = at(1, 1, 80.0)
    made = Meetings(PASSES, [Crossing((GivesWay(3, 10.0, 0, 50.0),))], [at(0, 0, 60.0), own])
    made.update(0.0, [at(0, 0, 60.0), own])
    assert made.held(own).free == pytest.approx(80.0 + 20.0 + 10.0)


@pytest.mark.parametrize("instead", [(), (INSTEAD,)])
def test_one_that_waits_long_is_let_go_first(instead):
    """The other one has 90 m to go, and stands for a cart."""
    own, other = at(1, 1, 40.0), at(0, 0, 90.0, "stand")
    made = heard(other, own, instead=instead)
    assert made.held(own).free == pytest.approx(39.5)
    own.left = 0.5
    for slot in (1, 2, 3):
        made.update(3.0 * slot, [other, own])
    assert made.held(own).is_held is not bool(instead)
    other.phase = "cut"
    made.update(12.0, [other, own])
    assert made.held(other).by == (1 if instead else -1)


@pytest.fixture(scope="module")
def told():
    """Layout 18 with one cart: its file, and the passes shared out."""
    file = layout_file(18, 1)
    fleet = fleet_of(file)
    return file, share_out(file, plan_of(file, fleet, None), fleet)


def passed(file, shared, motion):
    """When each combine was how far, (task, come) by time, of a job in which one is slower than planned."""
    fleet, found = fleet_of(file), []
    slow, other = fleet.combines
    slower = replace(fleet, combines=(replace(slow, speed=0.7 * slow.speed), other))
    job = Job(file, shared, slower, motion())
    where = Meetings(shared.told, shared.crossings, job.combines)
    move = job.motion.move

    def noted(of):
        found.append((of.time, [where._messages.come(c) for c in of.combines]))
        return move(of)

    job.motion.move = noted
    job.run()
    return found


def when(found, number, task, way):
    """When a combine had come so far [s]; between two moments, evenly; inf: never."""
    for (since, was), (time, at) in pairwise(found):
        if at[number] >= (task, way):
            (before, begun), (now, come) = was[number], at[number]
            share = (way - begun) / (come - begun) if before == now == task else 1.0
            return since + share * (time - since)
    return math.inf


def are_kept(rules, shared, found):
    """Whether nobody who gives way by some rules was past before the other one had come there."""
    past = (when(found, shared.by[rule.task], rule.task, rule.way_m + 1.0) for rule in rules)
    come = (when(found, shared.by[rule.other], rule.other, rule.other_m - 1.0) for rule in rules)
    return all(t >= other for t, other in zip(past, come, strict=True))


@pytest.mark.parametrize("motion", [Events, Kinematic])
def test_at_each_crossing_one_of_both_orders_is_kept(told, motion):
    """Not so where combines do not know of them."""
    file, shared = told

    def broken(of):
        found = passed(file, of, motion)
        return [
            k for k in shared.crossings
            if not any(are_kept(rules, shared, found) for rules in (k.first, k.instead) if rules)
        ]  # fmt: skip

    assert not broken(shared)
    assert broken(shared._replace(crossings=()))


def test_a_job_that_is_saved_knows_who_was_let_first(told):
    again, whole = digests_of_copied(*told, at=1500.0)
    assert again == whole


def two_and_two(told, motion=Events):
    """A job of two combines and two carts at its begin. told: as with passes shared out"""
    file = job_file(2, 2)
    fleet = fleet_of(file)
    plan = plan_of(file, fleet, None)
    by = [i % 2 for i in range(len(plan.passes))]
    return Job(file, Shared(plan, by, {}, told=PASSES if told else ()), fleet, motion())


@pytest.mark.parametrize(("told", "waited", "drives_up"), [
    (True, True, DRIVES_UP), (True, False, 0.0), (False, True, 0.0),
])  # fmt: skip
def test_a_cart_that_waited_for_another_one_at_the_truck_drives_up(told, waited, drives_up):
    job = two_and_two(told)
    first, second = job.carts
    second.phase, second.grain = "queue", 1000.0
    if waited:
        first.phase, first.timer, first.grain = "emptying", 10.0, 1000.0
        job._cart(second)
        assert second.phase == "queue"
    first.phase, first.timer, first.grain = "idle", 0.0, 0.0
    job._cart(second)
    assert second.phase == "emptying"
    assert second.timer == pytest.approx(job.file.truck.dock_s + drives_up)


@pytest.mark.parametrize("holds_up", [True, False])
def test_one_in_its_last_pass_that_holds_up_another_one_is_served_as_one_that_stands(holds_up, monkeypatch):
    job = two_and_two(told=True)
    last, _ = job.combines
    last.phase, last.is_last, last.since, last.tank, job.time = "stand", True, 100.0, 1000.0, 300.0
    before = job._need((job.carts[0], last))
    held = {0: Held(), 1: Held(0.0, 0) if holds_up else Held()}
    monkeypatch.setattr(job, "held", lambda c: held[c.number])
    assert (job._need((job.carts[0], last)) < before) is holds_up
    last.is_last = False
    assert (job._need((job.carts[0], last)) < before) is True


@pytest.mark.parametrize("is_held", [True, False])
def test_a_driven_combine_claims_its_turn_unless_it_has_to_wait_in_it(is_held, monkeypatch):
    job = two_and_two(told=True, motion=Kinematic)
    while all(c.phase != "way" or c.before < 0 or c.spec.name in job.motion._corners for c in job.combines):
        job.run(job.time + 1.0)
    turns = next(c for c in job.combines if c.phase == "way" and c.before >= 0)
    monkeypatch.setattr(job, "held", lambda _: Held(0.0, 1 - turns.number) if is_held else Held())
    assert job.motion._mover_of_combine(job, turns).turns is not is_held


@pytest.mark.parametrize("motion", [Events, Kinematic])
@pytest.mark.parametrize(("held", "phase", "goes"), [
    (True, "stand", True), (False, "stand", False), (True, "cut", False),
])  # fmt: skip
def test_the_cart_of_one_that_has_to_wait_goes_to_one_that_stands(held, phase, goes, motion, monkeypatch):
    job = two_and_two(told=False, motion=motion)
    job.run(60.0)
    full, waits = job.combines
    cart, other = job.carts
    other.phase = "to_truck"
    job.hand_over(cart, waits)
    cart.phase = "beside"
    monkeypatch.setattr(job, "held", lambda c: Held(0.0, 0) if held and c is waits else Held())
    full.phase, full.tank = phase, full.spec.tank
    assert job._calls() is goes
    assert cart.combine is (full if goes else waits)
    assert waits.called is not goes
    assert not job._calls()


def test_a_driven_cart_knows_whom_its_combine_lets_go_first(monkeypatch):
    job = two_and_two(told=False, motion=Kinematic)
    job.run(60.0)
    first, waits = job.combines
    cart = job.carts[0]
    job.hand_over(cart, waits)
    monkeypatch.setattr(job, "held", lambda c: Held(0.0, first.number) if c is waits else Held())
    assert job.motion._mover_of_cart(job, cart).after == first.spec.name
