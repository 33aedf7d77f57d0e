"""Who cuts which pass with sensors: of several ways of sharing out the one that is over first."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.job import engine
from swath.job.machines import fleet_of
from swath.job.work import plan_of
from swath.signals import HeapState, JobState, MachineLoad, MachineState, Phase, UnloadState
from swath.tools.fleet import lands
from swath.tools.fleet import work_plan as work_plan_of
from swath.tools.fleet.whole import Watch, _notes, _Seen
from swath.tools.fleet.work_plan import (
    MOST_TRIES,
    ROOM,
    TRIES,
    _too_much,
    passes_of,
    told_passes,
    work_plan,
)
from tests.job.jobs import finished, job_file
from tests.job.layouts import layout_file


def shared_out(file, plan, fleet):
    """As at `events`."""
    return lands.with_turns(lands.taken_by_events(file, plan, fleet), fleet.combines)


def test_two_combines_that_would_wait_for_whole_passes_share_out_otherwise():
    """As at `events` there is no order in which they keep clear of each other and crop is always cut before
    where a cart comes beside them.
    """
    file = layout_file(7, 1)
    fleet = fleet_of(file)
    plan, combines = plan_of(file, fleet, None), fleet.combines
    work = work_plan(file, plan, fleet)
    first = shared_out(file, plan, fleet)
    rows = [passes_of(made, combines, file) for made in (work.shared, first)]
    chosen, as_events = (lands.team_of(told_passes(r), combines) for r in rows)
    assert as_events is None
    assert chosen.end < 1.07 * chosen.least
    assert work.team == chosen.members
    cut = sorted(tuple(sorted(map(tuple, p.line.tolist()))) for p in work.shared.plan.passes)
    assert cut == sorted(tuple(sorted(map(tuple, p.line.tolist()))) for p in plan.passes)


def test_the_way_of_sharing_out_that_is_over_first_is_driven(monkeypatch):
    """Of those that have an order: by events, with what combines wait for each other."""
    file, asked, hours = layout_file(4, 2), [], {}
    fleet, hours_of = fleet_of(file), lands.hours_of
    waits = [500.0, None, *(10.0 * (n % 4) for n in range(20))]  # the second one has no order

    def team_of(passes, combines):
        asked.append(passes)
        waited = waits[len(asked) - 1]
        return None if waited is None else lands.Team([], 2000.0, waited, 1000.0)

    def noted(file, of, fleet):
        index = asked.index(told_passes(passes_of(of, fleet.combines, file)))
        hours[index] = hours_of(file, of, fleet)
        return hours[index]

    monkeypatch.setattr(lands, "team_of", team_of)
    monkeypatch.setattr(lands, "hours_of", noted)
    monkeypatch.setattr(lands, "CUTS", 0.0)
    monkeypatch.setattr(lands, "CARTS", 0.0)
    monkeypatch.setattr(engine, "DRIVES_UP", 0.0)
    work = work_plan(file, plan_of(file, fleet, None), fleet)
    assert len(hours) > 3
    assert told_passes(work.rows) == asked[min(hours, key=lambda n: hours[n] + waits[n])]
    assert hours[0] == pytest.approx(evenly(finished(file)), abs=1.0)  # the first is that of `events`


@pytest.mark.parametrize("first", [True, False])
def test_a_way_of_sharing_out_that_leaves_a_combine_without_a_pass_is_left_out(first, monkeypatch):
    """first: the one as at `events` is fine."""
    file = layout_file(4, 2)
    fleet = fleet_of(file)
    plan = plan_of(file, fleet, None)
    as_events = lands.taken_by_events(file, plan, fleet)

    def taken(_, __, tried):
        return as_events if tried is fleet and first else as_events._replace(by=[0] * len(as_events.by))

    monkeypatch.setattr(lands, "taken_by_events", taken)
    if first:
        found = work_plan(file, plan, fleet).shared
        assert found._replace(told=(), crossings=()) == lands.with_turns(as_events, fleet.combines)
        assert len(found.told) == len(found.plan.passes)
        assert found.crossings
    else:
        with pytest.raises(InputError, match="a pass for every combine"):
            work_plan(file, plan, fleet)


def test_hours_are_the_mean_of_draws_of_speeds(monkeypatch):
    """Not those of one run, which a few seconds make longer or shorter by several percent."""
    file = layout_file(4, 2)
    fleet = fleet_of(file)
    made, jobs = shared_out(file, plan_of(file, fleet, None), fleet), []

    class Noted(lands.Job):
        def run(self):
            super().run()
            jobs.append(self)

    monkeypatch.setattr(lands, "Job", Noted)
    hours = lands.hours_of(file, made, fleet)
    assert hours == lands.hours_of(file, made, fleet)
    drawn = jobs[: lands.DRAWS]
    assert len({job.time for job in drawn}) == lands.DRAWS
    assert hours == pytest.approx(np.mean([evenly(job) for job in drawn]))
    assert hours == pytest.approx(np.mean([job.time for job in drawn]), rel=0.1)


def evenly(job):
    """When a job is over if combines stand for carts as long as each other."""
    stands = [sum(c.timeline.time(state) for state in ("wait", "unload")) for c in job.combines]
    ends = [c.timeline.end for c in job.combines]
    works = max(np.subtract(ends, stands))
    return works + np.mean(stands) + job.time - max(ends)


@pytest.mark.parametrize(("beside", "owner", "kg"), [
    ([True, False, False, True], [0, 0, 0, 0], 2000.0),
    ([True, False, False, True], [0, 0, 1, 1], 0.0),  # shared out
    ([False, True, False, True], [0, 0, 0, 0], 0.0),  # emptied in between
    ([False, False, False, True], [0, 0, 0, 0], 7000.0),
])  # fmt: skip
def test_tanks_have_room_for_passes_beside_which_no_cart_can_be(beside, owner, kg):
    """Four of 5 t each."""
    passes = [SimpleNamespace(area=5000.0, cart_beside=b) for b in beside]
    of = SimpleNamespace(plan=SimpleNamespace(passes=passes), by=owner)
    combines = [SimpleNamespace(tank=8000.0 / ROOM)] * 2
    assert max(_too_much(of, [False] * 4, combines, 10.0), 0.0) == pytest.approx(kg)


def test_a_tank_that_is_full_before_a_cart_can_come_is_told_before_the_job():
    file = job_file(combines=2, carts=1, boundary_m=[(0, 0), (600, 0), (600, 120), (0, 120)], yield_t_ha=16.0)
    fleet = fleet_of(file)
    small = replace(fleet, combines=tuple(replace(c, tank=0.4 * c.tank) for c in fleet.combines))
    with pytest.raises(InputError, match="room for a cart"):
        work_plan(file, plan_of(file, fleet, None), small)


@pytest.mark.parametrize("fits_from", [TRIES + 4, MOST_TRIES])
def test_more_ways_of_sharing_out_are_made_as_long_as_no_tank_has_room(fits_from, monkeypatch):
    """One more than asked for fits, or none."""
    file, asked = layout_file(4, 2), []
    fleet = fleet_of(file)

    def too_much(*of):
        asked.append(of)
        return 0.0 if len(asked) > fits_from else 1e4

    monkeypatch.setattr(work_plan_of, "_too_much", too_much)
    monkeypatch.setattr(lands, "team_of", lambda *_: lands.Team([], 1000.0, 0.0, 1000.0))
    if fits_from < MOST_TRIES:
        work = work_plan(file, plan_of(file, fleet, None), fleet)
        assert work.shared.by == asked[-1][0].by
        assert len(asked) == fits_from + 1
    else:
        with pytest.raises(InputError, match="10000 kg too much"):
            work_plan(file, plan_of(file, fleet, None), fleet)
        assert len(asked) == MOST_TRIES


def test_what_a_combine_pours_counts_in_loads():
    """In the report of a job with sensors, as by events."""
    watch = Watch(None)
    watch.machines = {"combine": _Seen()}
    nothing = [0.0] * 6
    for i, flow in enumerate((0.0, 90.0, 92.0, 0.0, 90.0, 0.0, 0.0, 0.0, 90.0)):  # every 6 s
        watch._see("combine.unload", 6 * i * NS, {"unload": UnloadState(6 * i * NS, 0.0, flow, *nothing)})
    assert watch.machines["combine"].loads == 2


def test_a_job_is_over_with_the_last_grain_at_the_truck():
    """As at the other levels, not once the cart has driven away from there."""
    watch, none = Watch(None), np.zeros(3)
    watch.machines = {"first": _Seen(), "second": _Seen()}
    emptied = {"first": [0.0, 0.0, 300.0, 900.0, 900.0], "second": [0.0, 250.0, 250.0, 250.0, 250.0]}
    for i in range(5):
        for name in watch.machines:
            heap = HeapState(10 * i * NS, 0.0, 0.0, 0.0, 0.0, none, none, emptied=emptied[name][i])
            watch._see(f"{name}.heap", 10 * i * NS, {"heap": heap})
    assert watch.brought_at == 30.0


@pytest.mark.parametrize(
    ("speed", "flow", "ends"), [(0.02, 0.0, True), (1.0, 0.0, False), (0.0, 90.0, False)]
)
def test_a_job_in_which_nothing_moves_any_more_ends_with_where_each_stands(speed, flow, ends):
    watch = Watch(None)
    watch._world = SimpleNamespace(graph=SimpleNamespace(ended=""))
    watch.machines = {"combine": _Seen()}
    state = MachineState(0, Pose.from_euler((12.0, 3.5, 0.0)), speed, 0.0, 0.0, 0.0, 0.0)
    for i in range(0, 1300, 10):
        pipe = UnloadState(i * NS, 0.0, flow, *[0.0] * 6)
        job = JobState(i * NS, Phase.TURNS, 7, 0.0, math.nan)
        watch._see("combine.x", i * NS, {"state": state, "job": job, "pipe": pipe})
    told = "nothing moves for 1200 s: combine turns (pass 7) at 12.0, 3.5 m"
    assert watch._world.graph.ended == (told if ends else "")


def test_a_result_tells_what_is_not_at_the_truck():
    """In a tank, and in a box."""
    watch = Watch(None)
    load, none = MachineLoad(0, 2099.0, *[0.0] * 6), np.zeros(3)
    heap = HeapState(0, 401.0, 0.02, 0.0, 1.0, none, none)
    watch.machines = {"combine": _Seen(), "cart": _Seen()}
    watch.machines["combine"].latest[MachineLoad], watch.machines["cart"].latest[HeapState] = load, heap
    told = _notes(watch, {"machines": {"combine": {}, "cart": {}}, "field": {}})
    assert "2500 kg of grain are not at the truck" in told
