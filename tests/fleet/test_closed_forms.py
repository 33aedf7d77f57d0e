"""Times and loads of a schedule against sums of a notebook: cutting, pouring, the truck."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.fleet.driven import driven
from swath.fleet.files import CartSettings, CombineSettings, FieldSettings, JobFile, TruckSettings
from swath.fleet.machines import beside
from swath.fleet.schedule import schedule_of
from swath.fleet.worked import TRUCK, WAITS, by_events

JOB = JobFile(
    format="swath fleet 1",
    field=FieldSettings(boundary_m=[(0, 0), (140, 0), (140, 62), (0, 62)], yield_t_ha=9.0),
    combines={"combine": CombineSettings(tank_start_percent=30.0, grain_kg_s=12.0)},
    carts={"cart": CartSettings()},
    truck=TruckSettings(x_m=30.0, y_m=-25.0, volume_m3=10.0, away_min=4.0),
)


@pytest.fixture(scope="module")
def schedule():
    return schedule_of(JOB)


def test_a_cut_takes_length_over_speed_and_speed_is_what_the_threshing_takes(schedule):
    (combine,) = schedule.machines.combines
    full = 0
    for s in schedule.table.segments:
        if s.kind != "cut":
            continue
        d = s.path.track.distance
        length = float(d[s.path.last[s.index]] - d[s.path.first[s.index]])
        flow = schedule.grain[s.number] / s.spent
        assert length / s.spent <= combine.speed + 1e-9
        assert flow <= 12.0 * 1.02  # grain is shared out when it is cut, by strips as they then are
        if abs(length / s.spent - combine.speed) > 1e-6:
            assert flow == pytest.approx(12.0, rel=0.02)
        full += flow > 8.0
    assert full > 10


def test_pouring_takes_grain_over_the_auger_and_no_cart_takes_more_than_it_holds(schedule):
    (combine,), (cart,) = schedule.machines.combines, schedule.machines.carts
    loads = [p for p in schedule.poured if p.target == "cart"]
    assert loads
    for p in loads:
        kind = schedule.table.segments[p.during[0]].kind
        if kind == "pours standing":
            assert p.ends - p.begins == pytest.approx(p.amount / combine.auger)
        else:
            assert p.ends - p.begins >= p.amount / combine.auger - 1e-6
    for p in schedule.poured:
        if p.target == "truck":
            assert p.ends - p.begins == pytest.approx(p.amount / cart.out)
    assert cart.out == pytest.approx(0.350 * schedule.machines.density)


def test_a_full_truck_is_waited_for_and_the_wait_is_no_unloading(schedule):
    """10 m3 a truck: the field has more than one load of grain, each further truck is four minutes off."""
    room = 10.0 * schedule.machines.density
    into = [p for p in schedule.poured if p.target == "truck"]
    assert max(p.amount for p in into) <= room + 1e-6
    assert math.fsum(p.amount for p in into) == pytest.approx(schedule.harvested)
    for worked in (by_events(schedule), driven(schedule)):
        waits = worked.minutes("cart", WAITS[2])
        trucks = math.ceil(schedule.harvested / room)
        assert waits > 3.0
        assert waits <= 4.0 * trucks
        pours = math.fsum(p.ends - p.begins for p in into) / 60.0
        docks = (len({p.during for p in into}) - 0.5) * JOB.truck.dock_s / 60.0  # it drives off at the end
        assert worked.minutes("cart", TRUCK) == pytest.approx(pours + docks, abs=0.1)


def test_a_cart_stands_or_drives_where_the_stream_meets_its_box(schedule):
    (combine,), (cart,) = schedule.machines.combines, schedule.machines.carts
    ahead, left = beside(combine, cart)
    for a, b in schedule.table.together:
        one, two = (schedule.table.segments[n] for n in (a, b))
        p, q = (s.path.track.places[s.path.last[s.index]] for s in (one, two))
        c, s = math.cos(p[2]), math.sin(p[2])
        off = (q[0] - p[0]) * c + (q[1] - p[1]) * s - ahead, (q[1] - p[1]) * c - (q[0] - p[0]) * s - left
        assert np.hypot(*off) < 0.3


def test_a_second_truck_that_is_always_there_is_not_waited_for(schedule):
    endless = schedule_of(replace(JOB, truck=replace(JOB.truck, volume_m3=None)))
    worked = by_events(endless)
    assert worked.minutes("cart", WAITS[2]) == 0.0
    assert endless.ends < schedule.ends


@pytest.mark.parametrize(("volume", "away"), [(9.0, 25.0), (3.0, 11.0)])
def test_a_truck_that_is_long_away_is_waited_for_to_the_end(volume, away):
    """Longer than machines may stand without a word; a truck may also take less than a load."""
    made = schedule_of(replace(JOB, truck=replace(JOB.truck, volume_m3=volume, away_min=away)))
    for worked in (by_events(made), driven(made)):
        into = [p for p in worked.poured if p.target == "truck"]
        assert max(p.amount for p in into) <= volume * made.machines.density + 1e-6
        assert math.fsum(p.amount for p in into) == pytest.approx(made.harvested, rel=1e-9)
        assert worked.minutes("cart", WAITS[2]) > 10.0
