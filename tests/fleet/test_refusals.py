"""The look of its own at refused jobs: it agrees where a job cannot be done, and not where it can."""

from dataclasses import replace

import pytest

from swath.core.errors import InputError
from swath.fleet.files import CartSettings, CombineSettings, FieldSettings, JobFile, TruckSettings
from swath.fleet.schedule import schedule_of
from tests.fleet.refusals import confirmed

FIELD = FieldSettings(boundary_m=[(0, 0), (90, 0), (90, 70), (0, 70)], around_m=20.0)


def job_of(combines=1, carts=1, field=FIELD, **combine):
    return JobFile(
        format="swath fleet 1", field=field, truck=TruckSettings(x_m=-30.0, y_m=20.0),
        combines={f"combine_{i}": CombineSettings(**combine) for i in range(combines)},
        carts={f"cart_{i}": CartSettings() for i in range(carts)},
    )  # fmt: skip


def test_a_header_that_the_pipe_does_not_reach_over():
    wide = job_of(header_width_m=16.0)
    with pytest.raises(InputError) as refused:
        schedule_of(wide)
    assert confirmed(wide, refused.value.key, refused.value.expected)[0]
    assert not confirmed(job_of(), refused.value.key, refused.value.expected)[0]


def test_a_truck_in_the_field():
    job = replace(job_of(), truck=TruckSettings(x_m=10.0, y_m=20.0))
    with pytest.raises(InputError) as refused:
        schedule_of(job)
    assert confirmed(job, refused.value.key, refused.value.expected)[0]
    assert not confirmed(job_of(), refused.value.key, refused.value.expected)[0]


@pytest.mark.parametrize(("around", "machines", "is_confirmed"), [(20.0, 4, False), (0.0, 30, True)])
def test_room_to_wait(around, machines, is_confirmed):
    """Four machines beside 0.6 ha with a strip of 20 m; sixty in the truck's yard alone."""
    job = job_of(machines // 2, machines // 2, replace(FIELD, around_m=around))
    assert confirmed(job, "field.around_m", "expected room for machines to wait")[0] is is_confirmed


@pytest.mark.parametrize(("gap", "is_confirmed"), [(30.0, False), (80.0, True)])
def test_a_second_part_that_no_ground_leads_to(gap, is_confirmed):
    """Strips of 20 m meet over a gap of 30 m, not over one of 80 m."""
    part = [(90.0 + gap, 0.0), (150.0 + gap, 0.0), (150.0 + gap, 70.0), (90.0 + gap, 70.0)]
    job = job_of(field=replace(FIELD, parts_m=[part]))
    assert confirmed(job, "field.around_m", "expected ground on which machines find a way")[0] is is_confirmed
