"""Ordinary fields of a few hectares: notches with two inner corners, many machines, one alone."""

import pytest
from benchmarks.fleet_baseline import baseline_hours
from benchmarks.fleet_jobs import drawn

from swath.fleet.files import CartSettings, CombineSettings, FieldSettings, JobFile, TruckSettings
from swath.fleet.schedule import PARAMS, Scheduler
from swath.fleet.worked import by_events


def notched(x, y, at, wide, deep, skew=0.0):
    """Points of a rectangle [m] with a notch in its south side, narrower inside on both sides by a skew."""
    a, b = at - 0.5 * wide, at + 0.5 * wide
    return [(0, 0), (a, 0), (a + skew, deep), (b - skew, deep), (b, 0), (x, 0), (x, y), (0, y)]


def made(ring, combines, carts, truck):
    job = JobFile(
        format="swath fleet 1", field=FieldSettings(ring, yield_t_ha=8.0),
        combines={f"c{i}": CombineSettings(header_width_m=9.0) for i in range(combines)},
        carts={f"k{i}": CartSettings() for i in range(carts)}, truck=TruckSettings(*truck),
    )  # fmt: skip
    return job, Scheduler(job, None)


JOBS = {
    "notch, 1 + 1": (notched(170, 120, 80, 70, 45), 1, 1, (-30.0, 60.0)),
    "skew notch, 2 + 1": (notched(190, 120, 110, 80, 40, 12.0), 2, 1, (90.0, 150.0)),
    "rectangle, 3 + 3": ([(0, 0), (160, 0), (160, 110), (0, 110)], 3, 3, (80.0, -25.0)),
    "rectangle, 1 alone": ([(0, 0), (150, 0), (140, 80), (0, 90)], 1, 0, (-30.0, 40.0)),
}


@pytest.mark.parametrize("name", JOBS)
def test_ordinary_fields_end_with_all_machines_and_near_simple_rules(name):
    job, scheduler = made(*JOBS[name])
    assert [k.name for k in scheduler.machines.carts] == list(job.carts)  # none is left out
    ends_near(job, scheduler, 1.15)


def test_all_that_is_granted_is_done_before_anybody_makes_room():
    """Ground that others cut may be all that is waited for."""
    job, scheduler = made(*JOBS["skew notch, 2 + 1"])
    usual, usual_room, granted, refused = scheduler.goes_on, scheduler.makes_room, [], []

    def are_behind():
        return any(c.time < scheduler.late() for c in scheduler.combines if not c.is_done)

    def goes_on(busy, patience=1):
        if len(granted) == 6 and are_behind():
            refused.append(patience)
            return False
        granted.append(patience)
        return usual(busy, patience)

    def makes_room(turn):
        assert not are_behind()
        return usual_room(turn)

    scheduler.goes_on, scheduler.makes_room = goes_on, makes_room
    ends_near(job, scheduler, 1.5)
    assert refused == [1, PARAMS.tries]


@pytest.mark.draws
def test_a_notch_of_ten_hectares_keeps_nobody_waiting_for_a_way():
    job, scheduler = made(notched(400, 260, 150, 90, 70), 2, 1, (-40.0, 130.0))
    worked = ends_near(job, scheduler, 1.15)
    waits = {name: worked.minutes(name, "waits for ground") for name in worked.spans}
    assert max(waits.values()) < 20.0  # of 80; a way that is not found costs each of them an hour


@pytest.mark.draws
@pytest.mark.parametrize("seed", [18, 34])  # passes end at the pond, between crop
def test_who_has_cut_a_pass_to_a_pond_comes_out_again(seed):
    job = drawn(seed, (4.0, 8.0))
    assert job.field.holes_m
    ends_near(job, Scheduler(job, None), 1.6)


def ends_near(job, scheduler, most):
    """Fails where a job does not end, leaves crop or grain, or takes so many times what simple rules take."""
    scheduler.run()
    worked = by_events(scheduler.schedule)
    assert worked.mass_error < 1e-9
    assert scheduler.ground.remaining.area < 0.005 * scheduler.ground.field.area
    assert worked.ends / 3600.0 < most * baseline_hours(job)
    return worked
