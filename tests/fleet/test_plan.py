"""Plans: what passes cut, on fields with holes, dents and parts, however they lie on the map."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.fleet.files import CombineSettings, FieldSettings, JobFile, PlanSettings, TruckSettings
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import body_of, machines_of
from swath.fleet.plan import HEADLAND, LAND, PARAMS, Pass, Plan, plan_of, strip_of, track_along
from tests.fleet.drawn import drawn_job

SQUARE = [(0.0, 0.0), (150.0, 0.0), (150.0, 100.0), (0.0, 100.0)]
DENT = [
    (0.0, 0.0),
    (200.0, 0.0),
    (200.0, 150.0),
    (140.0, 150.0),
    (140.0, 60.0),
    (60.0, 60.0),
    (60.0, 150.0),
    (0.0, 150.0),
]
POND = [(60.0, 40.0), (85.0, 35.0), (90.0, 60.0), (66.0, 66.0)]


def job(ring=SQUARE, holes=(), parts=(), widths=(7.5,), rounds=1, truck=(-40.0, 50.0), **plan):
    return JobFile(
        format="swath fleet 1",
        field=FieldSettings(list(ring), [list(h) for h in holes], [list(p) for p in parts]),
        combines={f"c{i}": CombineSettings(header_width_m=w) for i, w in enumerate(widths)},
        plan=PlanSettings(headland_rounds=rounds, **plan),
        truck=TruckSettings(*truck),
    )


def planned(made):
    machines = machines_of(made)
    ground = Ground(made, body_of(machines.truck))
    return ground, plan_of(ground, machines.combines, made.plan)


@pytest.mark.parametrize("rounds", [0, 1, 2])
@pytest.mark.parametrize(
    "what",
    [{}, {"ring": DENT}, {"holes": [POND]}, {"parts": [[(170.0, 10.0), (230.0, 0.0), (220.0, 90.0)]]}],
    ids=["square", "dent", "pond", "parts"],
)
def test_passes_cut_the_field_and_keep_off_holes(what, rounds):
    ground, plan = planned(job(widths=(7.5, 9.0), rounds=rounds, **what))
    strips = shapely_here().union_all([strip_of(p) for p in plan.passes])
    left = ground.field.difference(strips).area
    outlines = [shapely_here().Polygon(part.exterior) for part in shapely_here().get_parts(ground.field)]
    is_convex = all(each.convex_hull.area < each.area + 1e-6 for each in outlines)
    swing = 1e-6 if is_convex else PARAMS.least_m2  # of bends about inner corners, out of their strips
    assert plan.left - swing <= left <= plan.left + 1e-6
    assert left < 0.005 * ground.field.area
    assert strips.intersection(ground.holes).area < 1e-6
    assert ground.field.area == pytest.approx(area_of(what), rel=1e-6)


def area_of(what):
    shapely = shapely_here()
    area = shapely.Polygon(what.get("ring", SQUARE)).area
    area += sum(shapely.Polygon(p).area for p in what.get("parts", ()))
    return area - sum(shapely.Polygon(h).area for h in what.get("holes", ()))


@pytest.mark.parametrize("degrees", [17.0, 90.0, 133.0])
def test_a_field_that_is_turned_and_moved_has_the_same_plan(degrees):
    a = math.radians(degrees)

    def placed(points):
        c, s = math.cos(a), math.sin(a)
        return [(5000.0 + c * x - s * y, s * x + c * y - 3000.0) for x, y in points]

    here = job(ring=DENT, widths=(7.5, 9.0))
    ((x, y),) = placed([(-40.0, 50.0)])
    there = replace(here, field=FieldSettings(placed(DENT)), truck=TruckSettings(x, y))
    one, other = planned(here)[1], planned(there)[1]
    assert len(one.passes) == len(other.passes)
    for p, q in zip(one.passes, other.passes, strict=True):
        assert np.allclose([p.start, p.end], [q.start, q.end], atol=1e-3)


def test_each_combine_has_passes_by_what_it_can_cut():
    _, plan = planned(
        job(ring=[(0.0, 0.0), (300.0, 0.0), (300.0, 200.0), (0.0, 200.0)], widths=(6.0, 12.0), rounds=0)
    )
    area = {c: sum(p.length * p.width for p in plan.passes if p.combine == c) for c in (0, 1)}
    wide = max(plan.passes, key=lambda p: p.width).combine
    assert area[wide] / area[1 - wide] == pytest.approx(2.0, rel=0.1)


def test_a_plan_is_written_whole(tmp_path):
    _, plan = planned(job(holes=[POND]))
    plan.write(tmp_path / "plan.json")
    rows = json.loads((tmp_path / "plan.json").read_text())
    ends = ({**row, "start": tuple(row["start"]), "end": tuple(row["end"])} for row in rows["passes"])
    passes = [Pass(**row | {"via": tuple(map(tuple, row["via"]))}) for row in ends]
    assert Plan(tuple(passes), rows["area_m2"], rows["left_m2"]) == plan


def test_a_truck_in_the_crop_is_refused():
    with pytest.raises(InputError, match="truck = 50, 50: expected a place at least 4 m outside"):
        planned(job(truck=(50.0, 50.0)))


def test_an_outline_that_crosses_itself_is_refused():
    with pytest.raises(InputError, match="boundary_m"):
        planned(job(ring=[(0.0, 0.0), (100.0, 100.0), (100.0, 0.0), (0.0, 100.0)]))


@pytest.mark.parametrize("order", ["lands", "adjacent", "skip"])
def test_passes_come_in_the_order_that_the_plan_says(order):
    """As on a notebook, from the one that is farthest north: 0, 1, 2 ... strips southwards."""
    _, plan = planned(job(rounds=0, order=order, land_passes=200))
    inner = [p for p in plan.passes if p.kind == LAND]
    rows = sorted({round(p.start[1], 3) for p in inner}, reverse=True)
    found = [rows.index(round(p.start[1], 3)) for p in inner]
    n = len(rows)
    expected = {
        "lands": sorted(range(n), key=lambda i: min(2 * i, 2 * (n - i) - 1)),
        "adjacent": list(range(n)),
        "skip": [*range(0, n, 2), *reversed(range(1, n, 2))],
    }
    assert found == expected[order]
    eastwards = [p.end[0] > p.start[0] for p in inner]
    assert eastwards == [i % 2 == 0 for i in range(n)]


def test_rounds_go_the_other_way_where_the_plan_says_so():
    one, other = (planned(job(rounds=2, headland=way))[1] for way in ("clockwise", "counterclockwise"))
    ends = [{(p.start, p.end) for p in plan.passes if p.kind == HEADLAND} for plan in (one, other)]
    assert ends[0] == {(end, start) for start, end in ends[1]}
    middle = np.array([75.0, 50.0])
    for start, end in ends[0]:  # clockwise: the middle of the field is on the right
        a, b = np.subtract(end, start), middle - start
        assert a[0] * b[1] - a[1] * b[0] < 0.0


def test_all_is_cut_beside_the_straight_sides_of_a_pond():
    """But for the gap that headers keep off it."""
    ground, plan = planned(drawn_job(700, (0.6, 2.5)))
    around = ground.holes.buffer(1.1 * GAPS.rim_m)
    assert 0.0 < plan.left < around.area - ground.holes.area


def test_a_round_without_corners_is_driven_through_its_bends():
    """Pieces follow each other where they end, and no bend is sharper than a combine can turn."""
    angle = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    far = 70.0 + 12.0 * np.cos(3.0 * angle)
    ring = np.column_stack([1.4 * far * np.cos(angle), far * np.sin(angle)])
    made = job(ring=ring.tolist(), rounds=2, truck=(-150.0, 0.0))
    _, plan = planned(made)
    (c,) = machines_of(made).combines
    for number in (0, 1):
        rounds = [p for p in plan.passes if p.kind == HEADLAND and p.land == number]
        assert all(p.via for p in rounds)
        for one, two in pairwise([*rounds, rounds[0]]):
            end, start = track_along(one, c).end, track_along(two, c).start
            assert math.dist(end[:2], start[:2]) < 0.01
            assert abs(math.sin(end.heading - start.heading)) < 0.002
        sharpest = max(np.abs(track_along(p, c).bends).max() for p in rounds)
        assert 0.0 < sharpest < 1.0 / c.drive.radius
    assert plan.left < 0.001 * plan.area


def test_what_is_left_of_a_pass_begins_at_a_point_on_it():
    bent = Pass((0.0, 0.0), (50.0, 40.0), 6.0, HEADLAND, via=((30.0, 0.0), (50.0, 20.0)))
    assert bent.behind(10.0, 0.0).line == ((10.0, 0.0), *bent.line[1:])
    assert bent.behind(40.0, 10.0).line == ((40.0, 10.0), (50.0, 20.0), (50.0, 40.0))
    assert bent.reversed().reversed() == bent
