"""Several machines are several groups of slots; each is a solid to the other's sensors."""

import numpy as np
import pytest

from swath.field.memory_layout import Organ
from swath.rays.engine import RayCaster
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import ScanTruth
from tests.whole.small import TEXT

SECOND = """\
  other:
    start: {x_m: 6.0, y_m: 24.0, heading_deg: 90}
    motion: {level: kinematic, start_speed_kmh: 3.6}
    lidar: off
    edge: truth
    speed: {speed_kmh: 3.6}
"""


@pytest.fixture(scope="module")
def world():
    world = assemble(parse_scenario(TEXT + SECOND, sets=["run.max_duration_s=2"]))
    drive(world)
    return world


def test_both_drive_in_one_plan(world):
    names = [n.slot.name for n in world.graph.nodes]
    assert "combine.lidar" in names
    assert "other.motion" in names
    assert "other.lidar" not in names
    moved = world.graph.latest("other.motion", "state").pose.position - [6.0, 24.0, 0.0]
    assert 1.5 < moved[1] < 2.5


def test_the_scanner_sees_the_other_machine_where_it_is_now(world):
    truth = world.graph.latest("combine.lidar", "truth")
    assert isinstance(truth, ScanTruth)
    other = world.graph.latest("other.motion", "state").pose
    rear = other.position[1] + world.machines["other"].sheet.body[0]
    site = world.graph.nodes[[n.slot.name for n in world.graph.nodes].index("combine.lidar")].component.setup
    origin = world.graph.latest("combine.motion", "state").pose.apply([0.0, 0.0, 2.5])
    hits = RayCaster(world.field, threads=1).cast(
        origin[None], np.array([[0.0, 1.0, 0.0]]), range_max=60.0, solids=site.solids()
    )
    assert hits.organ[0] == Organ.SOLID
    gap = abs(rear - origin[1])
    assert hits.distance[0] == pytest.approx(gap, abs=1.0)  # the body's outline is turned a little


def test_no_machine_is_a_solid_to_itself(world):
    site = world.leader.parts["lidar"].setup
    assert len(site.bodies.others("combine").box_half) == 2
    assert len(site.bodies.others("nobody").box_half) == 4
