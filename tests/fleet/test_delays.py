"""Driven machines that are delayed: nothing touches, no grain is lost, everything ends."""

import numpy as np
import pytest
from benchmarks.fleet_delays import Delayed, with_delays

from swath.fleet.driven import Grants
from tests.fleet.check import looked_at
from tests.fleet.drawn import scheduled

FLEETS = {126: (1, 4), 129: (2, 4), 132: (4, 1)}  # combines and carts of seeds
SIZE = (0.5, 0.8)  # ha


@pytest.mark.draws
@pytest.mark.parametrize("seed", FLEETS)
def test_delays_at_any_places_bring_nobody_together(seed):
    schedule = scheduled(seed, SIZE)
    assert (len(schedule.machines.combines), len(schedule.machines.carts)) == FLEETS[seed]
    worked, seconds = with_delays(schedule, 200, np.random.default_rng(seed))
    found = looked_at(schedule, worked)
    assert (found.contact, found.hole, found.outside) == ({}, 0.0, 0.0)
    assert found.mass < 1e-9
    assert schedule.ends + 0.1 * seconds < worked.ends < schedule.ends + 1.1 * seconds


@pytest.mark.parametrize("late", ["combine_1", "cart_1"])
def test_one_that_breaks_down_for_ten_minutes_delays_the_others(late):
    schedule = scheduled(132, SIZE)
    own = [s.kind for s in schedule.table.segments if s.machine == late]
    work = own.index("cut" if late == "combine_1" else "to combine")
    worked = Delayed(schedule, {late: [(work, 0.5, 600.0)]}).run()
    found = looked_at(schedule, worked)
    assert (found.contact, found.mass) == ({}, pytest.approx(0.0, abs=1e-9))
    assert worked.ends > schedule.ends + 100.0


def test_without_the_order_at_shared_places_delayed_bodies_touch(monkeypatch):
    monkeypatch.setattr(Grants, "waits_for", lambda *_: None)
    schedule = scheduled(132, SIZE)
    worked, _ = with_delays(schedule, 200, np.random.default_rng(132))
    assert looked_at(schedule, worked).contact
