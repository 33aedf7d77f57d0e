"""Outlines: the same field however it is written down, and as large as it was."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import body_of, machines_of
from swath.fleet.outlines import TOLERANCE
from swath.fleet.plan import plan_of
from swath.fleet.schedule import schedule_of
from tests.fleet.changed import SAME, other_machines
from tests.fleet.drawn import SMALL, drawn_job, scheduled


def planned(job):
    machines = machines_of(job)
    ground = Ground(job, body_of(machines.truck))
    return ground, plan_of(ground, machines.combines, job.plan)


def traced(seed, points):
    """A job on an outline as it is driven: a bent ring with noise, and a pond."""
    rng = np.random.default_rng(seed)
    angle = np.arange(points) / points * 2.0 * math.pi
    phase = rng.uniform(0.0, 6.0, 3)
    radius = 45.0 * (1.0 + sum(0.12 / k * np.sin(k * angle + phase[k - 1]) for k in (1, 2, 3)))
    radius += rng.normal(0.0, 0.05, points)
    ring = [
        (float(1.6 * r * math.cos(a)), float(r * math.sin(a))) for r, a in zip(radius, angle, strict=True)
    ]
    pond = [(12.0 * math.cos(a) + 10.0, 9.0 * math.sin(a)) for a in angle[:: max(points // 20, 1)]]
    job = drawn_job(seed)
    return replace(
        job, field=replace(job.field, boundary_m=ring, parts_m=[], holes_m=[pond]),
        truck=replace(job.truck, x_m=-120.0, y_m=10.0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def as_written():
    jobs = drawn_job(8, SMALL), traced(3, 30)
    return [(job, *planned(job)) for job in jobs]


@pytest.mark.parametrize("change", SAME)
def test_a_field_written_down_otherwise_has_the_same_passes(change, as_written):
    for job, ground, plan in as_written:
        other, same = planned(SAME[change](job))
        assert shapely_here().equals_exact(ground.field, other.field, 1e-6)
        assert len(plan.passes) == len(same.passes)
        for p, q in zip(plan.passes, same.passes, strict=True):
            assert (p.start, p.end) == (pytest.approx(q.start), pytest.approx(q.end))
            assert (p.kind, p.land, p.combine) == (q.kind, q.land, q.combine)


def test_a_field_written_down_otherwise_takes_the_same_time():
    other = drawn_job(130, SMALL)
    for change in ("reversed", "another first point", "points every 17 m", "machines"):
        other = SAME[change](other)
    assert schedule_of(other).ends == pytest.approx(scheduled(130).ends, rel=1e-4)


@pytest.mark.parametrize("points", [24, 200])
def test_few_points_lie_on_a_traced_outline_and_keep_its_area(points):
    job = traced(5, points)
    ground, _ = planned(job)
    shapely = shapely_here()
    before = shapely.Polygon(ground.frame.to_field(job.field.boundary_m))
    after = shapely.Polygon(ground.field.exterior)
    assert after.area == pytest.approx(before.area, rel=1e-5)
    assert ground.holes.area == pytest.approx(shapely.Polygon(job.field.holes_m[0]).area, rel=1e-4)
    assert before.exterior.hausdorff_distance(after.exterior) < 2.0 * TOLERANCE
    if points == 200:
        assert shapely.get_num_coordinates(after) < 0.5 * points
        assert "outlines are drawn with" in ground.notes[0]


def test_neither_names_nor_the_order_of_machines_decide_but_tables_have_the_order_of_the_file():
    job = drawn_job(130)
    one, two = machines_of(job), machines_of(other_machines(job))
    assert [c.width * c.speed for c in one.combines] == [c.width * c.speed for c in two.combines]
    assert [k.load for k in one.carts] == [k.load for k in two.carts]
    assert list(one.by_name) == [*job.combines, *job.carts]


SQUARE = [(0.0, 0.0), (150.0, 0.0), (150.0, 100.0), (0.0, 100.0)]


@pytest.mark.parametrize(
    ("field", "truck", "expected"),
    [
        ({"boundary_m": [(8.1, 50.2), (8.2, 50.2), (8.2, 50.3)]}, (8.0, 50.0), "are these degrees?"),
        ({"holes_m": [[(-1, -1), (151, -1), (151, 101), (-1, 101)]]}, (-40, 50), "leave some of the field"),
        ({"parts_m": [[(400.0, 0.0), (500.0, 0.0), (450.0, 90.0)]]}, (-40, 50), "joins all parts"),
        ({"boundary_m": [(0, 0), (100, 100), (100, 0), (0, 90)]}, (-40, 50), "does not cross itself"),
    ],
)
def test_outlines_that_are_no_field_are_refused_with_the_reason(field, truck, expected):
    job = drawn_job(130)
    job = replace(
        job, field=replace(job.field, **{"boundary_m": SQUARE, "parts_m": [], "holes_m": [], **field}),
        truck=replace(job.truck, x_m=truck[0], y_m=truck[1]),
    )  # fmt: skip
    with pytest.raises(InputError, match=expected):
        planned(job)


def test_a_pond_outside_is_told():
    job = drawn_job(130)
    pond = [(170.0, 10.0), (180.0, 10.0), (180.0, 20.0)]
    field = replace(job.field, boundary_m=SQUARE, parts_m=[], holes_m=[pond])
    ground, _ = planned(replace(job, field=field, truck=replace(job.truck, x_m=-40.0, y_m=50.0)))
    assert any("are outside of the field" in note for note in ground.notes)
