"""A machine that leaves its field, its edge, or the end of its edge says so, with place and way."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.edges.track import EdgeShape, polyline
from swath.signals import CropFlow, MachineState
from tests.evaluated import evaluation_of
from tests.fake_run import GEOMETRY, ArcEdge, GridField, machine

OFF = GEOMETRY.header_end("left")[1]
KNIFE = GEOMETRY.knife_x


def driven(path, edge=None, cuts=True):
    """path: y of the header end over x of the knife, every 0.1 m; the grid of the field ends at x = 100."""
    ground = GridField(edge or ArcEdge())
    evaluation = evaluation_of(ground, machine(edge=edge))
    before = None
    for k, (x, y) in enumerate(path):
        t, s = k * 50_000_000, 0.1 * k
        state = MachineState(t, Pose.from_euler([x - KNIFE, y - OFF, 0.0]), 2.0, 0.0, 0.0, 0.0, s)
        evaluation("combine.motion", t, {"state": state})
        knife = np.array([(x, y), (x, y - 2.0 * OFF)])
        if before is not None and cuts:
            cut = ground.cut(np.array([before[0], knife[0], knife[1], before[1]]))
            fill = cut.area / 0.7
            flow = CropFlow(t, cut.grain, cut.straw, cut.area, cut.stem_count, fill, 0.05)
            evaluation("combine.header", t, {"flow": flow})
        before = knife
    return evaluation


def straight(begin, end, y=0.0):
    return [(x, y) for x in np.arange(begin, end, 0.1)]


def test_beyond_the_boundary_is_an_event_with_place_and_way():
    evaluation = driven([*straight(60.0, 106.0), *straight(106.0, 96.0)[::-1]])
    (left,) = evaluation.events("combine")
    assert left.kind == "left_the_field"
    assert left.x == pytest.approx(100.0, abs=0.6)
    assert left.distance == pytest.approx(40.0, abs=0.6)
    assert left.end_t is None
    assert left.text == "left the field, beyond its boundary"
    m = evaluation.metrics("combine")
    assert m["left_the_field_count"] == 1.0
    assert m["left_the_field_m"] == pytest.approx(6.0, abs=0.5)
    assert evaluation.notes() == [f"combine: left the field, beyond its boundary at {left.distance:.1f} m"]


def test_off_on_the_cut_side_and_back():
    """The whole header 10 m beside the edge for 10 m; 2.5 m out is still at the crop."""
    path = [*straight(0.0, 20.0, 2.5), *straight(20.0, 30.0, 17.0), *straight(30.0, 40.0)]
    evaluation = driven(path)
    (left,) = evaluation.events("combine")
    assert left.text == "left the field, more than 2 m beside its edge, for 10.0 m"
    assert left.end_distance - left.distance == pytest.approx(10.0, abs=0.6)
    assert evaluation.metrics("combine")["left_the_field_m"] == pytest.approx(10.0, abs=0.6)


def test_a_machine_off_the_field_does_not_use_its_header():
    """10 of 20 m after settling in the crop, 10 off the field: half of the header's way."""
    evaluation = driven([*straight(0.0, 20.0), *straight(20.0, 30.0, 24.0 + 2.0 * OFF)])
    assert evaluation.metrics("combine")["header_use"] == pytest.approx(0.5, abs=0.02)


def test_a_machine_that_stands_uses_its_header_no_less():
    path = [*straight(0.0, 20.0)]
    evaluation = driven(path)
    before = evaluation.metrics("combine")["header_use"]
    for k in range(100):
        evaluation("combine.header", 10**10 + k, {"flow": CropFlow(10**10 + k, 0.0, 0.0, 0.0, 0, 0.0, 0.05)})
    assert before == pytest.approx(1.0, abs=0.01)
    assert evaluation.metrics("combine")["header_use"] == before


def test_no_field_to_leave_without_a_header():
    evaluation = driven(straight(60.0, 120.0), cuts=False)
    assert evaluation.events("combine") == []
    assert "left_the_field_count" not in evaluation.metrics("combine")


def test_the_end_of_the_edge_is_an_event_and_what_lies_beyond_is_not_judged():
    """The edge is 30 m long; beyond it the machine swerves by 5 m."""
    edge = ArcEdge(length=30.0)
    evaluation = driven([*straight(0.0, 30.0, 0.1), *straight(30.0, 40.0, -5.0)], edge)
    (end,) = evaluation.events("combine")
    assert (end.kind, end.end_t) == ("edge_end", end.t)
    assert end.x == pytest.approx(30.0, abs=0.6)
    m = evaluation.metrics("combine")
    assert m["lateral_p95_m"] == pytest.approx(0.1, abs=1e-6)
    assert evaluation.notes() == [f"combine: passed the end of its edge at {end.distance:.1f} m"]


def test_straight_past_the_corner_of_a_closed_edge_is_off_it():
    """A block of 40 m, driven along its last side and on: off the edge, off the field, and no use."""
    corners = [[80.0, -10.0], [80.0, -20.0], [40.0, -20.0], [40.0, -10.0], [80.0, -10.0]]
    path = [(x, y - 10.0) for x, y in straight(42.0, 98.0)]
    evaluation = driven(path, EdgeShape(polyline(corners), "right"))
    (left,) = evaluation.events("combine")
    assert left.text == "left the field, more than 2 m beside its edge"
    assert left.x == pytest.approx(82.0, abs=0.6)
    m = evaluation.metrics("combine")
    assert m["lateral_p95_m"] > 10.0
    assert m["header_use"] == pytest.approx(28.0 / 46.0, abs=0.02)
