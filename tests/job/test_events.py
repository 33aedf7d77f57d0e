"""A field worked off by events: mass, times, and what users report to go wrong."""

import math
from itertools import pairwise

import numpy as np
import pytest

from swath.core.errors import InputError, SwathError
from swath.job import engine, events
from swath.job.fleet import read_fleet
from swath.job.path import polyline
from swath.job.ride import Ride
from swath.job.timeline import Span
from swath.job.work import work_off
from swath.machine.machine_sheet import load_machine
from tests.job.jobs import finished, job_file, result

FILL_AND_EMPTY = {
    8.7: (0.09, 0.16),
    23.8: (0.26, 0.44),
}  # kg/s -> gain on the go: time to empty over time to fill
LENGTHS = (500, 540, 580, 600, 620, 640, 660, 700, 740)  # m


def spans(machine, state):
    return [s for s in machine.timeline.spans if s.state == state]


def gain_of(flow):
    """Time standing over time on the go, less 1, at a flow of grain [kg/s]; without turns, a cart at hand.

    Mean over lengths of the passes: where in a pass the tank is full moves single ones by 3 %.
    """
    gains = [
        time_of("standing", flow, length) / time_of("on_the_go", flow, length) - 1.0 for length in LENGTHS
    ]
    return math.fsum(gains) / len(gains)


def time_of(mode, flow, length):
    """Time in the passes [s] of a combine with three carts on lands of a length [m]."""
    file = job_file(
        boundary_m=[(0, 0), (length, 0), (length, 300), (0, 300)], carts=3,
        combine={"grain_kg_s": flow, "call_percent": 20.0, "speed_kmh": 15}, cart={"speed_kmh": 25.0},
        plan={"headland_rounds": 0, "order": "adjacent"}, unload={"mode": mode},
        truck={"x_m": 0.5 * length, "y_m": 150.0, "dock_s": 5.0},
    )  # fmt: skip
    line = finished(file, beside=True).combines[0].timeline
    return sum(line.time(s) for s in ("cut", "unload", "wait"))


@pytest.mark.parametrize("combines", [1, 2])
@pytest.mark.parametrize("together", ["own_lands", "echelon"])
@pytest.mark.parametrize("mode", ["on_the_go", "standing", "at_headland"])
def test_grain_and_ground_are_all_there_in_the_end(combines, together, mode):
    job = finished(job_file(combines, 1, unload={"mode": mode}, team={"together": together}))
    area = 600.0 * 300.0
    assert math.fsum(c.area for c in job.combines) == pytest.approx(area, rel=1e-9)
    assert job.at_truck == pytest.approx(area * 0.8, rel=1e-9)
    assert sorted(job.pass_times) == list(range(len(job.plan.passes)))
    for machine in (*job.combines, *job.carts):
        both = pairwise(machine.timeline.spans)
        assert all(a.end == b.start for a, b in both)


def test_without_carts_the_combine_drives_to_the_truck():
    job = finished(job_file(carts=0))
    assert job.at_truck == pytest.approx(600.0 * 300.0 * 0.8, rel=1e-9)
    assert spans(job.combines[0], "transport")


def test_a_cut_takes_length_over_speed():
    """One pass of 500 m at 2 m/s, from standing: 0.5 m/s2 up to 1.5 m/s in 3 s, then a lag of 1 s."""
    file = job_file(
        boundary_m=[(0, 0), (500, 0), (500, 11.7), (0, 11.7)], plan={"headland_rounds": 0},
        combine={"speed_kmh": 7.2}, yield_t_ha=1.0,
    )  # fmt: skip
    assert finished(file).combines[0].timeline.time("cut") == pytest.approx(
        250.0 + (0.5 * (2.0 + 0.5) * 3.0 + 0.5) / 2.0, abs=0.02
    )


def test_unloading_while_standing_takes_what_the_auger_needs():
    """A full tank of 12 m3 at 120 l/s: 100 s."""
    file = job_file(unload={"mode": "standing"}, boundary_m=[(0, 0), (950, 0), (950, 11.7), (0, 11.7)],
                    plan={"headland_rounds": 0}, yield_t_ha=12 * 0.77e4 / (950 * 11.7))  # fmt: skip
    job = finished(file)
    assert job.combines[0].timeline.time("unload") == pytest.approx(100.0, abs=0.5)


@pytest.mark.parametrize("flow", FILL_AND_EMPTY)
def test_on_the_go_gains_what_emptying_a_tank_takes_over_filling_it(flow):
    """In lands with cut ground on the left and a cart at hand; turns are left out of the ratio."""
    low, high = FILL_AND_EMPTY[flow]
    assert low < gain_of(flow) < high


def test_more_carts_are_never_slower_by_much_and_one_is_too_few_for_three_combines():
    hours = [finished(job_file(3, n, plan={"land_passes": 4})).time for n in (1, 2, 3)]
    assert hours[0] > 1.2 * hours[1]
    assert hours[2] < 1.02 * hours[1]


def test_calling_the_cart_at_95_percent_is_too_late():
    waits = {
        call: finished(job_file(combine={"call_percent": call})).combines[0].timeline.time("wait")
        for call in (40.0, 95.0)
    }
    assert waits[95.0] > 1.5 * waits[40.0]


def test_a_cart_never_drives_where_crop_stands_on_the_left():
    """The pipe is over standing crop, or the boundary: nothing is poured while such a pass is cut."""
    job = finished(job_file(unload={"at_row_end": "resume"}, combine={"call_percent": 20.0}))
    begun = {begin: kind for c in job.combines for begin, _, kind in c.loads}
    for begin, kind in begun.items():
        (span,) = [s for s in job.combines[0].timeline.spans if s.start <= begin < s.end][-1:]
        if kind == "on the go":
            assert job.passes[span.pass_index].cart_beside
    first_round = [i for i, p in enumerate(job.plan.passes) if p.kind == "headland" and p.round_index == 0]
    assert not any(job.plan.passes[i].cart_beside for i in first_round)
    assert set(begun.values()) == {"on the go", "standing"}


def test_the_direction_of_the_rounds_decides_whether_unloading_on_the_go_is_possible():
    beside = {}
    for turning in ("clockwise", "counterclockwise"):
        job = finished(job_file(plan={"headland": turning, "headland_rounds": 3}))
        rounds = [p for p in job.plan.passes if p.kind == "headland" and p.round_index > 0]
        beside[turning] = sum(p.cart_beside for p in rounds) / len(rounds)
    assert beside == {"clockwise": 1.0, "counterclockwise": 0.0}


def test_standing_crop_on_the_left_costs_a_pocket():
    """The first round: the tank fills once, and the cart needs the pocket's time."""
    waits = []
    for pocket in (0.0, 60.0):
        plan = {"headland_rounds": 0, "order": "adjacent"}
        file = job_file(boundary_m=[(0, 0), (950, 0), (950, 11.7), (0, 11.7)], plan=plan, yield_t_ha=10.0,
                        unload={"pocket_s": pocket, "mode": "standing"})  # fmt: skip
        waits.append(finished(file).combines[0].timeline.time("wait"))
    assert waits[1] - waits[0] == pytest.approx(60.0, abs=1e-6)


@pytest.mark.parametrize("at_end", ["finish", "resume"])
def test_a_load_that_the_end_of_a_pass_cuts_short_is_not_lost(at_end):
    job = finished(job_file(unload={"at_row_end": at_end, "finish_s": 600.0}, plan={"headland_rounds": 1}))
    standing = spans(job.combines[0], "unload")
    poured = math.fsum(load for _, load, _ in job.combines[0].loads)
    assert poured == pytest.approx(600.0 * 300.0 * 0.8, rel=1e-9)
    assert bool(standing) or at_end == "resume"
    others = finished(job_file(unload={"at_row_end": "resume"}, plan={"headland_rounds": 1}))
    if at_end == "finish":
        assert len(job.combines[0].loads) < len(others.combines[0].loads)


def test_a_cart_is_never_filled_beyond_its_load_and_never_serves_two():
    job = finished(job_file(2, 2, yield_t_ha=11.0))
    for cart in job.carts:
        assert cart.delivered <= cart.spec.load * len(spans(cart, "unload")) + 1e-6
    loads = [(s.start, s.end) for k in job.carts for s in spans(k, "load")]
    assert len(loads) > 4


def test_one_cart_at_a_time_at_the_truck_and_a_full_truck_is_waited_for():
    free = finished(job_file(2, 3))
    busy = [(s.start, s.end) for k in free.carts for s in spans(k, "unload")]
    busy.sort()
    assert all(a[1] <= b[0] + 1e-6 for a, b in pairwise(busy))
    slow = finished(job_file(2, 3, truck={"volume_m3": 35.0, "away_min": 30.0}))
    assert slow.time > free.time + 1800.0


def test_in_echelon_the_follower_stays_behind_and_on_the_next_pass():
    job = finished(job_file(2, 2, team={"together": "echelon", "lag_m": 40.0}, plan={"headland_rounds": 2}))
    passes, lag = job.plan.passes, 40.0 / job.combines[0].spec.speed
    later = 0
    for i, (first, second) in enumerate(pairwise(passes)):
        if math.cos(first.start.heading - second.start.heading) > 0.9:
            assert job.pass_times[i + 1][0] >= job.pass_times[i][0] + 0.6 * lag
            later += 1
    assert later > 8


def test_the_same_job_gives_the_same_bytes():
    one, two = result(job_file(2, 2)), result(job_file(2, 2))
    assert [m.timeline.spans for m in one.machines] == [m.timeline.spans for m in two.machines]
    assert one.litres_per_ha == two.litres_per_ha


@pytest.mark.parametrize("name", ["harvest-field", "echelon"])
def test_bundled_jobs_end_with_all_grain_at_the_truck(name):
    file, _ = read_fleet(name)
    made = work_off(file)
    assert made.mass_error < 1e-9
    assert abs(made.plan.area_left) < 1e-3 * made.plan.area
    assert made.area == pytest.approx(made.plan.area, rel=1e-3)
    assert 0.6 < made.field_efficiency < 0.9
    assert 5.0 < made.litres_per_ha < 25.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (("field.yield_t_ha=-1",), r"field.yield_t_ha = -1: expected > 0"),
        (("combines.combine.speed=5",), "did you mean 'speed_kmh'"),
        (("carts=null",), "carts"),
        (("unload.mode=flying",), "expected one of on_the_go, standing, at_headland"),
        (("carts={}",), "expected a cart to unload into"),
        (("combines.combine.machine=grain-truck",), "expected a machine with a header and a pipe"),
        (("carts.cart.machine=lexion-700",), "expected a machine with a box"),
        (("field.boundary_m=[[0,0],[10,10],[10,0],[0,10]]",), "expected a ring that does not cross itself"),
        (("plan.overlap_m=2.9", "combines.combine.machine=combine-5m"), "expected less than half the header"),
    ],
)
def test_wrong_input_is_one_clear_error(changes, said):
    with pytest.raises(SwathError, match=said):
        work_off(read_fleet("harvest-field", changes)[0])


def test_an_unknown_level_is_refused():
    with pytest.raises(InputError, match="expected one of events"):
        work_off(read_fleet("echelon")[0], level="guess")


def test_spans_join_and_leave_no_gap():
    from swath.job.timeline import Timeline

    line = Timeline()
    line.add("cut", 0.0, 1.0, 3)
    line.add("cut", 1.0, 2.0, 3)
    line.add("wait", 2.0, 2.0)
    line.add("turn", 2.0, 5.0)
    assert line.spans == [Span("cut", 0.0, 2.0, 3), Span("turn", 2.0, 5.0)]
    assert line.time("cut") == 2.0


def test_in_the_last_pass_a_cart_is_called_at_once(monkeypatch):
    """A tank that would not be full before the end is emptied on the go."""
    monkeypatch.setattr(engine, "is_needed_soon", lambda job, c: False)
    field = [(0.0, 0.0), (600.0, 0.0), (600.0, 36.0), (0.0, 36.0)]
    job = finished(job_file(boundary_m=field, plan={"headland_rounds": 0}, combine={"call_percent": 100.0}))
    full, last = job.combines[0].loads
    assert full[2] == "standing"
    assert last[2] == "on the go"
    assert last[0] < max(end for _, end in job.pass_times.values())


@pytest.mark.parametrize("combines", [1, 2, 3])
def test_a_way_takes_longer_the_more_others_are_at_work(monkeypatch, combines):
    """Half of the turns that are no corners and of far ways by that, others by what it waits then, too."""
    file, lines = job_file(combines, 1, yield_t_ha=1.0), []
    for loses in ((0.7, 2.2, 5.0), (0.0, 0.0, 0.0)):  # no cart but one
        monkeypatch.setattr(events, "TURN_LOSES", loses)
        monkeypatch.setattr(events, "FAR_LOSES", loses)
        lines.append([s.end - s.start for s in finished(file).combines[0].timeline.spans])
    longer = [a - b for a, b in zip(*lines, strict=False) if abs(a - b) > 1e-3]
    assert np.median(longer) == pytest.approx(0.7 + 2.2 * (combines - 1), abs=1e-6)


def test_time_that_is_lost_first_is_all_that_a_ride_takes_longer():
    path, sheet = polyline(np.array([[0.0, 0.0], [100.0, 0.0]])), load_machine("tractor-grain-cart")
    rides = [Ride(path, np.full(len(path.distance), 4.0), sheet, 2.0, lost) for lost in (0.0, 7.3)]
    times = [r.drive(1000.0, lambda _: 4.0, lambda _, r=r: r.left) for r in rides]
    assert times[1] - times[0] == pytest.approx(7.3, abs=1e-9)
    assert rides[1].lost == 0.0
