"""Where grain goes, as a job says: a gate, ways between parts, several trucks, unloading at the headland."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.fleet.driven import driven
from swath.fleet.files import (
    CartSettings,
    CombineSettings,
    FieldSettings,
    JobFile,
    PlanSettings,
    TruckSettings,
)
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import body_of, machines_of
from swath.fleet.schedule import schedule_of
from swath.fleet.search import least_time
from tests.fleet.changed import turned
from tests.fleet.check import looked_at

RING = [(0.0, 0.0), (90.0, 0.0), (90.0, 60.0), (0.0, 60.0)]
OTHER = [(x + 230.0, y) for x, y in RING]


def job_of(field=None, truck=None, plan=None, carts=1):
    return JobFile(
        format="swath fleet 1", field=field or FieldSettings(RING), plan=plan or PlanSettings(),
        combines={"c": CombineSettings(header_width_m=9.0)},
        carts={f"k{i}": CartSettings() for i in range(carts)},
        truck=truck or TruckSettings(-30.0, 20.0),
    )  # fmt: skip


def ground_of(job):
    return Ground(job, body_of(machines_of(job).truck))


def test_parts_that_a_way_joins_are_worked_and_machines_keep_to_it():
    apart = job_of(FieldSettings(RING, parts_m=[OTHER]))
    with pytest.raises(InputError, match="expected ground that joins all parts"):
        schedule_of(apart)
    way = [(80.0, -8.0), (160.0, -30.0), (240.0, -8.0)]
    made = schedule_of(replace(apart, field=replace(apart.field, ways_m=[way])))
    found = looked_at(made, driven(made))
    assert (found.contact, found.outside, found.mass < 1e-9) == ({}, 0.0, True)
    assert found.left < 0.005
    line = shapely_here().LineString(way)
    between = [
        p
        for s in made.table.segments
        for p in made.ground.frame.to_map(s.path.track.places[:, :2])
        if 112.0 < p[0] < 208.0
    ]
    assert max(line.distance(shapely_here().Point(p)) for p in between) < 10.0


def test_machines_leave_by_the_gate_and_along_the_way_that_a_job_says():
    way = [(45.0, -20.0), (-30.0, -45.0), (-150.0, -40.0), (-160.0, 20.0)]
    truck = TruckSettings(-160.0, 20.0, gate_m=(45.0, -5.0))
    job = job_of(FieldSettings(RING, ways_m=[way]), truck)
    made = schedule_of(job)
    assert made.ground.frame.to_map([made.ground.gate]) == pytest.approx(np.array([[45.0, 0.0]]), abs=0.01)
    assert made.delivered == pytest.approx(made.harvested)
    far = np.concatenate([made.ground.frame.to_map(s.path.track.places[:, :2]) for s in made.table.segments])
    out = far[(far[:, 0] < -70.0) & (far[:, 0] > -120.0)]
    assert len(out)
    assert out[:, 1].max() < -25.0
    assert not [n for n in made.ground.notes if "ways_m" in n]
    again = schedule_of(turned(job, 51.0, 700.0))
    assert again.ends == pytest.approx(made.ends, rel=0.002)


@pytest.mark.parametrize("gate", [(45.0, 30.0), (90.2, 30.0), (45.0, -6400.0)])
def test_a_gate_in_the_field_or_far_from_it_is_refused(gate):
    with pytest.raises(InputError, match=r"truck\.gate_m = .*1 to 90 m outside"):
        ground_of(job_of(truck=TruckSettings(-30.0, 20.0, gate_m=gate)))


def trucks_of(made, volume):
    """When each truck begins to be filled and is full [s]."""
    found, room = [], 0.0
    for p in (p for p in made.poured if p.target == "truck"):
        if room < 1e-6:
            found.append([p.begins, p.ends])
            room = volume * made.machines.density
        room -= p.amount
        found[-1][1] = p.ends
        assert room > -1e-6
    return found


@pytest.fixture(scope="module")
def truck_bound():
    truck = TruckSettings(-30.0, 20.0, volume_m3=1.5, away_min=10.0)
    return {n: (job, schedule_of(job)) for n in (1, 2, 4) for job in [job_of(truck=replace(truck, trucks=n))]}


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_truck_is_away_for_its_time_and_others_come_meanwhile(count, truck_bound):
    job, made = truck_bound[count]
    rows = trucks_of(made, 1.5)
    kg = 0.8 * 90.0 * 60.0
    assert len(rows) == math.ceil(kg / (1.5 * made.machines.density))
    waits = [later[0] - full for (_, full), later in zip(rows, rows[count:], strict=False)]
    assert min(waits, default=600.0) >= 600.0 - 1e-6
    assert least_time(job, made.machines, made.ground) < made.ends
    if count == 1:
        assert min(waits) == pytest.approx(600.0)
        assert made.ends > 600.0 * (len(rows) - 1)
    else:
        assert made.ends < truck_bound[count // 2][1].ends - 300.0


@pytest.mark.parametrize("unload", ["anywhere", "headland"])
def test_tanks_are_emptied_off_the_lands_where_a_job_says_so(unload):
    combines = {"c": CombineSettings(header_width_m=9.0, tank_start_percent=55.0)}
    field = FieldSettings([(0.0, 0.0), (160.0, 0.0), (160.0, 90.0), (0.0, 90.0)], yield_t_ha=11.0)
    job = replace(job_of(field, plan=PlanSettings(headland_rounds=2, unload=unload)), combines=combines)
    made = schedule_of(job)
    worked = driven(made)
    found = looked_at(made, worked)
    assert (found.contact, found.mass < 1e-9) == ({}, True)
    lands = ground_of(job).field.buffer(-2.0 * 8.8 - 0.5, join_style="mitre")
    inside = []
    for p in worked.poured:
        if p.target != "truck":
            at = (worked.clock >= p.begins) & (worked.clock <= p.ends)
            xy = worked.places["c"][at, :2]
            inside.append(bool(shapely_here().contains_xy(lands, *xy.T).any()))
    assert len(inside) > 1
    assert any(inside) is (unload == "anywhere")


def test_a_way_that_ends_on_the_way_is_noted():
    way = [(45.0, -20.0), (-30.0, -45.0), (-100.0, -100.0)]
    truck = TruckSettings(-220.0, 20.0, gate_m=(45.0, -5.0))
    ground = ground_of(job_of(FieldSettings(RING, ways_m=[way]), truck))
    assert [n for n in ground.notes if "no way of field.ways_m leads from the gate to the truck" in n]
