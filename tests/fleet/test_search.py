"""The best of several plans: what is compared, what is kept, and the bound below all of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.fleet import search
from swath.fleet.files import (
    CartSettings,
    CombineSettings,
    FieldSettings,
    FleetSettings,
    JobFile,
    TruckSettings,
)
from swath.fleet.schedule import Late, Scheduler
from swath.fleet.search import best_of, least_time
from tests.fleet.drawn import drawn_job


def job_of(combines: int, carts: int, plans: int) -> JobFile:
    return JobFile(
        format="swath fleet 1", field=FieldSettings([(0, 0), (90, 0), (90, 60), (0, 60)]),
        combines={f"c{i}": CombineSettings("lexion-700") for i in range(combines)},
        carts={f"k{i}": CartSettings() for i in range(carts)},
        truck=TruckSettings(-30.0, 20.0), fleet=FleetSettings(plans=plans),
    )  # fmt: skip


@pytest.fixture(scope="module")
def made():
    return Scheduler(job_of(2, 3, 1), None)


@pytest.fixture
def ends_of(monkeypatch, made):
    """What a plan takes is told by a function of the job; no plan is decided. Until when each was let go."""
    until: list[float] = []

    def given(ends):
        class Told:
            machines, ground = made.machines, made.ground

            def __init__(self, job, base, like=None):
                self.job = job

            def run(self, best=None):
                limit = math.inf if best is None else best.ends
                until.append(limit)
                time = ends(self.job)
                if time is None:
                    raise InputError("field", None, "expected another one")
                if time >= limit:
                    raise Late
                self.schedule = replace(made.schedule, ends=time, notes=[])

        monkeypatch.setattr(search, "Scheduler", Told)
        monkeypatch.setattr(search, "by_events", lambda schedule: schedule)
        return until

    return given


@pytest.mark.parametrize("seed", range(4))
def test_the_best_of_drawn_times_is_kept_within_the_budget(seed, ends_of):
    rng, plans = np.random.default_rng(seed), 9
    drawn: list[float | None] = []

    def ends(job):
        drawn.append(None if rng.random() < 0.2 else float(rng.uniform(1e4, 2e4)))
        return drawn[-1]

    until = ends_of(ends)
    _, best = best_of(job_of(2, 2, plans))
    known = [t for t in drawn if t is not None]
    assert len(drawn) == plans
    assert best.ends == min(known)
    assert min(t for _, t in best.compared) == min(known)
    assert until[1:] == [min([math.inf, *(t for t in drawn[:i] if t is not None)]) for i in range(1, plans)]


def test_machines_of_no_use_stay_away_and_it_is_said(ends_of):
    ends_of(lambda job: 1e4 + 1e3 * len(job.carts) - 500.0 * len(job.combines))
    own, best = best_of(job_of(2, 3, 12))
    assert (len(own.combines), len(own.carts)) == (2, 1)
    assert [n for n in best.notes if n.startswith("not used: k")]


def test_each_plan_is_another_job(ends_of):
    seen = []
    ends_of(lambda job: seen.append(job) or 1e4)
    best_of(job_of(2, 2, 12))
    assert len(seen) == 12
    assert all(a != b for i, a in enumerate(seen) for b in seen[:i])


def test_a_job_without_a_plan_that_ends_is_refused_with_the_first_reason(ends_of):
    ends_of(lambda job: None)
    with pytest.raises(InputError, match="field: expected another one"):
        best_of(job_of(1, 1, 3))


@pytest.mark.parametrize(("carts", "volume"), [(1, None), (0, None), (1, 5.0)])
def test_the_bound_is_what_cutting_or_the_truck_takes_alone(carts, volume):
    job = job_of(1, carts, 1)
    job = replace(job, truck=replace(job.truck, volume_m3=volume))
    made = Scheduler(job, None)
    (c,), kg = made.machines.combines, 0.8 * 90.0 * 60.0
    cut = 5400.0 / (c.width * c.speed_in(0.8 * c.width)) + (0.0 if carts else kg / c.auger)
    k = made.machines.carts[0] if carts else c
    trucks = math.ceil(kg / (volume * made.machines.density)) if volume else 1
    truck = kg / (k.out if carts else c.auger) + 22.5 + 2400.0 * (trucks - 1)
    way = made.ground.truck_m / k.drive.straight
    assert least_time(job, made.machines, made.ground) == pytest.approx(way + max(cut, truck))


def test_a_plan_that_falls_behind_is_given_up_and_its_own_equal_is_not():
    job = drawn_job(130, (0.5, 1.0))
    made = Scheduler(job, None)
    made.run()
    best = made.schedule
    assert least_time(job, made.machines, made.ground) < best.ends
    assert 0.5 * best.ends < max(least for _, least in best.pace) <= best.ends
    half = replace(best, ends=0.5 * best.ends)  # it cannot end before that
    ahead = replace(best, pace=[(left, least - 0.2 * best.ends) for left, least in best.pace])
    for other in (half, ahead):
        again = Scheduler(job, None, like=made)
        with pytest.raises(Late):
            again.run(other)
        assert again.schedule.pace == best.pace[: len(again.schedule.pace)]
        assert again.ground.remaining.area > made.ground.remaining.area + 100.0
    assert not best.is_behind(replace(best, ends=best.ends + 1.0))
