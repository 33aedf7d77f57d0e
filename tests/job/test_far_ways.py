"""Far ways of combines with lands of their own, held against the crop that stands then."""

import pytest
import shapely
from shapely.ops import substring

from swath.job.engine import Job
from swath.job.events import Events
from swath.job.machines import fleet_of
from swath.job.path import path_of
from swath.job.work import plan_of
from swath.tools.fleet import lands
from swath.tools.fleet.combine_turns import axle_at, shared
from tests.job.layouts import layout_file

NARROW = 5.5  # m to both sides of a header of 12.2 m: cells of the ground are up to 1.1 m
ENDS = 16.0  # m of the begin and end of a way, beside crop


def crossed(plan, pieces, by, ends, i, combine):
    """Area of standing crop that the header goes over on the way behind a pass [m2]."""
    standing = shapely.Polygon(plan.boundary)
    for p, end in zip(plan.passes, ends, strict=True):
        if end <= ends[i]:
            standing = standing.difference(shapely.LineString(p.line).buffer(6.4, cap_style="flat"))
    way = shapely.LineString(path_of(pieces, axle_at(plan.passes[i].end, combine)).points)
    middle = substring(way, ENDS, way.length - ENDS)
    return middle.buffer(NARROW).intersection(standing.buffer(-0.5)).area


@pytest.mark.parametrize("seed", [4, 12])
def test_far_ways_lead_around_standing_crop(seed):
    """And the shortest ways along headland and passes do not."""
    file = layout_file(seed, 1)
    fleet = fleet_of(file)
    made = lands.with_turns(lands.taken_by_events(file, plan_of(file, fleet, None), fleet), fleet.combines)
    job = Job(file, plan_of(file, fleet, None), fleet, Events())
    job.run()
    ends = [job.pass_times[index][1] for index, _ in job.passes.taken]
    direct = shared(made.plan, made.by, fleet.combines)
    others = [i for i, pieces in made.turns.items() if pieces != direct.turns[i]]
    assert len(others) >= 4

    def over(turns):
        return [crossed(made.plan, turns[i], made.by, ends, i, fleet.combines[made.by[i]]) for i in others]

    assert max(over(made.turns)) == pytest.approx(0.0, abs=1.0)
    assert max(over(direct.turns)) > 500.0
