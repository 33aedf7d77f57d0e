"""Windows and events of made runs: 2 m/s along a straight edge, a gap from 14 m to 17 m."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.edges.edge_defects import Gap
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Limit
from swath.signals import CropEdge, MachineState, SteerCommand
from tests.evaluated import evaluation_of
from tests.fake_run import GEOMETRY, ArcEdge, GridField, drive, machine

KNIFE = GEOMETRY.knife_x


def judged(*limits, gaps=(), **run):
    """Results of limits on a run, and the evaluation."""
    ground = GridField(ArcEdge())
    expect = [Expectation("combine", name, Limit.model_validate(keys)) for name, keys in limits]
    evaluation = evaluation_of(ground, machine(), expect=expect, gaps=gaps)
    drive([evaluation], ground, **run)
    metrics = {"combine": evaluation.metrics("combine"), "field": {}}
    return evaluation.check(metrics, {})[: len(limits)], evaluation


def test_a_metric_of_a_stretch_sees_only_its_samples():
    """7 m header, 2 m/s: 7 m2 per metre."""
    limits = [
        ("area_cut_m2", {"min": 0, "from_m": 4, "to_m": 10}),
        ("distance_m", {"min": 0, "from_s": 2, "to_s": 5}),
    ]
    (area, way), _ = judged(*limits, seconds=6.0)
    assert area["value"] == pytest.approx(6 * 7.0, abs=0.3)
    assert area["window"] == {"from_m": 4.0, "to_m": 10.0}
    assert way["value"] == pytest.approx(6.0, abs=0.03)


def test_windows_do_not_settle():
    limits = [{"max": 1, "from_m": 1, "to_m": 5}, {"max": 1, "from_m": 99}]
    (entry, never), _ = judged(*(("lateral_rms_m", limit) for limit in limits), lateral=0.1, seconds=4.0)
    assert entry["value"] == pytest.approx(0.1, abs=1e-6)
    assert never["result"] == "fail"
    assert "never opened" in never["reason"]


def test_a_gap_is_an_event_and_opens_windows_after_and_before():
    gaps = (Gap(14.0, 17.0, 2.0, 0), Gap(20.0, 21.0, 2.0, 0))
    limits = [
        ("distance_m", {"min": 1.9, "after": "gap", "within_m": 2}),
        ("distance_m", {"min": 1.4, "max": 1.6, "after": "gap", "from_m": 0.5, "within_s": 1}),
        ("area_cut_m2", {"min": 0, "max": 7.5, "before": "gap", "within_m": 1}),
        ("distance_m", {"min": 1.9, "after": "contact", "within_m": 2}),
    ]
    (after, later, before, never), evaluation = judged(*limits, gaps=gaps, seconds=10.0)
    first, second = evaluation.events()
    assert (first.kind, first.machine) == ("gap", "combine")
    assert first.x == pytest.approx(14.0, abs=0.1)
    assert first.distance == pytest.approx(14.0 - KNIFE, abs=0.1)
    assert first.end_distance - first.distance == pytest.approx(3.0, abs=0.1)
    assert second.x == pytest.approx(20.0, abs=0.1)
    assert [e["result"] for e in (after, later, before)] == ["pass"] * 3
    assert before["value"] == pytest.approx(7.0, abs=0.2)
    assert never["reason"] == "the window never opened: there was no event contact"


def test_an_edge_lost_while_steering_is_an_event_with_duration():
    evaluation = evaluation_of(GridField(ArcEdge()), machine())

    def tick(t, found, engaged=True):
        stamp = round(t * 1e9)
        state = MachineState(stamp, Pose.from_euler([2.0 * t, -3.5, 0.0]), 2.0, 0.0, 0.0, 0.0, 2.0 * t)
        confidence, offset = (0.9, 3.5) if found else (0.0, np.nan)
        evaluation("combine.motion", stamp, {"state": state})
        evaluation(
            "combine.edge", stamp, {"edge": CropEdge(stamp, offset, 0.0, 0.0, 5.0, confidence, 0.8, 0.1)}
        )
        evaluation("combine.steer", stamp, {"command": SteerCommand(stamp, 0.0, engaged)})

    for k in range(200):
        t = 0.1 * k
        tick(t, found=not (3.0 <= t < 3.8 or 5.0 <= t < 7.95 or t > 15.0), engaged=5.5 > t > 0.5 or t > 8.0)
    lost, last = evaluation.events("combine")
    assert (lost.kind, lost.t, lost.end_t) == ("edge_lost", 5_000_000_000, 8_000_000_000)
    assert lost.x == pytest.approx(10.0 + KNIFE)
    assert lost.text == "no edge for 3.0 s"
    assert last.end_t is None
    assert last.text == "no edge for 4.8 s, and none since"
    m = evaluation.metrics("combine")
    assert m["edge_lost_count"] == 2.0
    assert m["edge_lost_s"] == pytest.approx(3.0 + 4.8)
    assert m["edge_lost_m"] == pytest.approx(6.0 + 9.6)
    assert "combine: the edge was lost 2 times, for 7.8 s and 15.6 m" in evaluation.notes()
