"""Whole jobs that were drawn: they end, nothing touches, no grain is lost; however the field lies."""

import math
from dataclasses import replace

import pytest

from swath.core.errors import InputError
from swath.fleet.files import FieldSettings, FleetSettings, read_job
from swath.fleet.schedule import schedule_of
from tests.fleet.check import looked_at
from tests.fleet.drawn import drawn_job

SMALL = (0.5, 1.0)  # ha


@pytest.mark.parametrize("seed", [130, 131])
def test_a_drawn_job_ends_with_all_grain_at_the_truck_and_no_contact(seed):
    found = looked_at(schedule_of(drawn_job(seed, SMALL)))
    assert found.contact == {}
    assert found.left < 0.005
    assert found.mass < 1e-9
    assert (found.hole, found.outside) == (0.0, 0.0)


def test_a_field_that_is_turned_and_moved_takes_the_same_time():
    job = drawn_job(131, SMALL)
    a = math.radians(31.0)

    def placed(points):
        c, s = math.cos(a), math.sin(a)
        return [(c * x - s * y + 5000.0, s * x + c * y) for x, y in points]

    ((x, y),) = placed([(job.truck.x_m, job.truck.y_m)])
    field = FieldSettings(
        placed(job.field.boundary_m), [placed(h) for h in job.field.holes_m],
        [placed(p) for p in job.field.parts_m], job.field.around_m, job.field.yield_t_ha,
    )  # fmt: skip
    turned = replace(job, field=field, truck=replace(job.truck, x_m=x, y_m=y))
    assert schedule_of(turned).ends == pytest.approx(schedule_of(job).ends, rel=0.002)


def test_a_dispatcher_of_ones_own_takes_the_place_of_the_built_in_one(tmp_path, code_allowed):
    (tmp_path / "mine.py").write_text(
        "class Never:\n"
        "    def decide(self, state):\n"
        "        return min(state.options, key=lambda o: (o.kind == 'beside', o.ends))\n"
    )
    job = replace(drawn_job(130, SMALL), fleet=FleetSettings("mine.py:Never"))
    made = schedule_of(job, tmp_path)
    assert made.delivered == pytest.approx(made.harvested)
    assert any(s.kind == "pours standing" for s in made.table.segments)


@pytest.mark.parametrize("name", ["nothing", "none.py:Class"])
def test_a_dispatcher_that_is_not_there_is_refused(name, tmp_path):
    with pytest.raises(InputError, match="dispatcher"):
        schedule_of(replace(drawn_job(130, SMALL), fleet=FleetSettings(name)), tmp_path)


def test_a_header_wider_than_the_pipe_reaches_is_refused():
    job = drawn_job(130, SMALL)
    combines = {"wide": replace(next(iter(job.combines.values())), machine="lexion-700", header_width_m=16.0)}
    with pytest.raises(InputError, match="expected a header of at most"):
        schedule_of(replace(job, combines=combines))


def test_a_job_file_names_key_and_line_of_what_is_wrong(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(
        "format: swath fleet 1\nfield:\n  boundary_m: [[0, 0], [90, 0], [90, 60]]\n  around_m: -3\n"
        "combines: {c: {machine: lexion-700}}\ntruck: {x_m: -30, y_m: 0}\n"
    )
    with pytest.raises(InputError, match=r"around_m = -3: expected >= 0.*job.yaml:4"):
        read_job(str(file))
