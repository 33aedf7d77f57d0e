"""The edge is judged against the crop as it stands now: gaps, second passes, strips left standing."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.edges.edge_defects import Gap
from swath.field.edges.present_edge import STEP_M, edges_of
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.signals import CropEdge, MachineState
from tests.evaluated import evaluation_of
from tests.fake_run import GEOMETRY, ArcEdge, GridField, machine

REFERENCE = 10.0
NAN = float("nan")


def judged(
    place, side="left", shape=lambda crop, x, y: crop, end=0.0, seconds=12.0, confidence=0.9, gaps=(), **held
):
    """A straight run at 2 m/s, the header end on y = end; place: x of the reference -> y reported.

    The crop is on y < 0 (header end on the left), or on y > 0; shape: changes which of its cells stand.
    """
    ground = GridField(ArcEdge(crop_on_right=side == "left"))
    ground.crop = shape(ground.crop, ground.x, ground.y)
    evaluation = evaluation_of(ground, machine(side, ground.nominal_edge), gaps=gaps)
    off = GEOMETRY.header_end(side)[1]
    for k in range(round(25 * seconds)):
        t, s = k * 40_000_000, 0.08 * k
        state = MachineState(t, Pose.from_euler([s, end - off, 0.0]), 2.0, 0.0, 0.0, 0.0, s)
        evaluation("combine.motion", t, {"state": state})
        y = place(s + REFERENCE) - end + off
        sure = 0.0 if np.isnan(y) else confidence
        edge = CropEdge(t, y, 0.0, 0.0, REFERENCE, sure, NAN, NAN, **held)
        evaluation("combine.edge", t, {"edge": edge})
    series = evaluation.find("combine", EdgeDetection).series()
    return evaluation.metrics("combine"), series


def gap(crop, x, y, start=20.0, end=30.0, depth=3.0):
    return crop & ~((x > start) & (x < end) & (np.abs(y) < depth))


def behind_the_gap(sign, error):
    return lambda x: sign * ((3.0 if 19.999 < x < 29.999 else 0.0) + error)


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
def test_a_detector_that_is_right_beside_a_gap_is_right(side, sign):
    """10 m long, 3 m deep: found within 20 cm, nothing is false, and every scan counts."""
    m, series = judged(behind_the_gap(sign, 0.2), side, gap)
    assert m["false_edge_share"] == 0.0
    assert m["edge_bias_m"] == pytest.approx(0.2, abs=0.06)
    assert m["detection_availability"] == 1.0
    assert m["edge_judged_share"] == 1.0
    assert len(series.t) == 300
    assert m["edge_sample_count"] == np.count_nonzero(series.distance >= 10.0) == 175
    assert m["sure_wrong_share"] == 0.0


HOLE = (Gap(20.0, 30.0, 3.0, 15),)


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
def test_across_a_hole_the_line_to_be_steered_along_is_the_true_edge(side, sign):
    """Told 10 cm inside of it throughout: right; what stands beside it, 3 m in, is the wall."""
    m, series = judged(lambda x: 0.1 * sign, side, gap, gaps=HOLE)
    assert series.error == pytest.approx(0.1, abs=0.03)
    assert m["edge_rmse_m"] == pytest.approx(0.1, abs=0.02)
    assert m["sure_wrong_share"] == m["false_edge_share"] == 0.0
    is_beside = np.abs(series.wall - series.true) > 0.1
    assert is_beside.mean() == pytest.approx(10 / 24, abs=0.02)
    assert sign * (series.wall - series.true)[is_beside] == pytest.approx(3.0, abs=0.03)
    nothing = judged(lambda x: NAN, side, gap, gaps=HOLE)[1]
    assert nothing.true == pytest.approx(series.true, abs=0.03)


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
def test_whoever_is_sure_of_the_wall_of_a_hole_is_wrong(side, sign):
    """Over the 10 m of it, of which the first samples are those of settling: 10 of 14 m. The wall is no
    phantom: an edge is there.
    """
    m, series = judged(behind_the_gap(sign, 0.0), side, gap, gaps=HOLE)
    assert m["sure_wrong_share"] == pytest.approx(10 / 14, abs=0.02)
    assert m["edge_rmse_m"] == pytest.approx(0.0, abs=0.03)  # over the rest
    assert m["false_edge_share"] == 0.0
    assert series.settled(10.0).episodes() == [pytest.approx((10.0, 20.0), abs=0.1)]
    unsure = judged(behind_the_gap(sign, 0.0), side, gap, gaps=HOLE, confidence=0.4)
    assert unsure[0]["sure_wrong_share"] == 0.0
    assert unsure[1].episodes() == []


def test_a_later_pass_and_the_end_of_the_crop_have_no_line_across_a_hole():
    """Cut to y = -7 before, the hole of 10 m goes on there; or it goes on to where the edge ends."""
    deep = (Gap(20.0, 30.0, 10.0, 15),)
    series = judged(lambda x: -7.0, end=-7.0, gaps=deep, shape=lambda crop, x, y: gap(crop, x, y, depth=10.0)
                    & (y < -7.0))[1]  # fmt: skip
    assert series.true == pytest.approx(series.wall, nan_ok=True)
    end = (Gap(20.0, 500.0, 50.0, 15),)
    m, series = judged(lambda x: 0.0, shape=lambda crop, x, y: gap(crop, x, y, 20.0, 500.0, 50.0), gaps=end)
    assert np.isnan(series.true[series.distance > 10.1]).all()
    assert m["sure_wrong_share"] == pytest.approx(1.0, abs=0.02)


def test_a_line_held_over_the_gap_is_no_edge_that_stands_there():
    """10 of the 14 m judged lie beside a gap that is none of the initial edge: false when claimed as seen,
    and sure; silent it only lacks.
    """
    straight_on = judged(lambda x: 0.0, shape=gap)[0]
    assert straight_on["false_edge_share"] == pytest.approx(10 / 14, abs=0.02)
    assert straight_on["sure_wrong_share"] == pytest.approx(10 / 14, abs=0.02)
    held = judged(lambda x: 0.0, shape=gap, confidence=0.3, is_held=True)[0]
    assert np.isnan(held["false_edge_share"])
    assert held["sure_wrong_share"] == 0.0
    silent = judged(lambda x: NAN if 19.999 < x < 29.999 else 0.0, shape=gap)[0]
    assert silent["false_edge_share"] == 0.0
    assert silent["detection_availability"] == pytest.approx(4 / 14, abs=0.02)


def test_there_is_no_duty_to_see_an_edge_far_off():
    """A gap deeper than the detector looks: neither false nor lacking."""
    m, _ = judged(
        lambda x: NAN if 19.999 < x < 29.999 else 0.0, shape=lambda c, x, y: gap(c, x, y, depth=7.0)
    )
    assert m["detection_availability"] == 1.0
    m, _ = judged(
        lambda x: -7.1 if 19.999 < x < 29.999 else 0.0, shape=lambda c, x, y: gap(c, x, y, depth=7.0)
    )
    assert m["false_edge_share"] == 0.0
    assert m["edge_judged_share"] == 1.0


def test_a_second_pass_is_judged_at_the_edge_that_the_first_one_left():
    """The crop was cut to y = -7, 7 m from the initial edge."""
    m, series = judged(lambda x: -6.95, end=-7.0, shape=lambda crop, x, y: crop & (y < -7.0))
    assert m["edge_bias_m"] == pytest.approx(-0.05, abs=0.03)
    assert m["detection_availability"] == 1.0
    assert series.true == pytest.approx(GEOMETRY.header_end("left")[1], abs=0.03)


def test_what_is_cut_on_the_way_counts_from_then_on():
    """Beyond x = 24 another machine takes 4 m while this one drives."""
    ground = GridField(ArcEdge())
    evaluation = evaluation_of(ground, machine())
    off = GEOMETRY.header_end("left")[1]
    for k in range(3):
        t = k * 40_000_000
        state = MachineState(t, Pose.from_euler([20.0, -off, 0.0]), 0.0, 0.0, 0.0, 0.0, 0.0)
        evaluation("combine.motion", t, {"state": state})
        evaluation("combine.edge", t, {"edge": CropEdge(t, off, 0.0, 0.0, REFERENCE, 0.9, NAN, NAN)})
        if k == 1:
            ground.cut(np.array([(24.0, -4.0), (40.0, -4.0), (40.0, 1.0), (24.0, 1.0)]))
    series = evaluation.find("combine", EdgeDetection).series()
    assert series.true == pytest.approx([off, off, off - 4.0], abs=0.03)


def test_narrow_strips_and_tracks_are_no_edges():
    def strip(crop, x, y):
        return crop | ((y > 1.0) & (y < 1.4))

    def tracks(crop, x, y):
        return crop & ~((y < -2.0) & (y > -2.6))

    for shape in (strip, tracks):
        m, series = judged(lambda x: 0.1, shape=shape)
        assert m["edge_bias_m"] == pytest.approx(-0.1, abs=0.03)
        assert np.isfinite(series.error).all()
    m, _ = judged(lambda x: 1.4, shape=lambda crop, x, y: strip(crop, x, y))
    assert abs(m["edge_bias_m"] + 1.4) < 0.05  # against the edge, not the strip


def test_of_several_edges_the_nearest_to_the_reported_one_counts():
    """A standing strip of 4 m between two cut ones: an edge each."""

    def island(crop, x, y):
        return crop & ~((y < -4.0) & (y > -8.0))

    assert judged(lambda x: -0.1, shape=island)[0]["edge_bias_m"] == pytest.approx(0.1, abs=0.03)
    m, _ = judged(lambda x: -7.9, shape=island)
    assert m["edge_bias_m"] == pytest.approx(-0.1, abs=0.03)
    assert m["detection_availability"] == 1.0


def test_the_start_does_not_count_against_a_detector_that_has_seen_nothing_yet():
    """Nothing is reported before 5 m are driven."""
    m, _ = judged(lambda x: NAN if x < REFERENCE + 5.0 else 0.0)
    assert m["detection_availability"] == 1.0
    m, _ = judged(lambda x: NAN if x < REFERENCE + 11.4 else 0.0)
    assert m["detection_availability"] == pytest.approx(0.9, abs=0.01)


def test_a_metric_over_few_scans_says_over_how_many():
    def seldom(x):
        return 0.0 if 20.0 < x < 22.4 else NAN

    m, _ = judged(seldom)
    assert m["edge_judged_share"] == pytest.approx(2.32 / 14, abs=0.01)
    ground = GridField(ArcEdge())
    evaluation = evaluation_of(ground, machine())
    for k in range(10):
        state = MachineState(k, Pose.from_euler([0.1 * k, -3.5, 0.0]), 2.0, 0.0, 0.0, 0.0, 10 + 0.1 * k)
        evaluation("combine.motion", k, {"state": state})
        y, sure = (3.5, 0.9) if k == 3 else (NAN, 0.0)
        evaluation("combine.edge", k, {"edge": CropEdge(k, y, 0.0, 0.0, REFERENCE, sure, NAN, NAN)})
    assert evaluation.notes() == ["combine: the edge error is over 1 of 10 edge samples"]


def test_a_run_that_ends_before_it_has_settled_is_not_judged():
    """As by the lateral error: no number, no note."""
    ground = GridField(ArcEdge())
    evaluation = evaluation_of(ground, machine())
    for k in range(5):
        state = MachineState(k, Pose.from_euler([0.1 * k, -3.5, 0.0]), 2.0, 0.0, 0.0, 0.0, 0.1 * k)
        evaluation("combine.motion", k, {"state": state})
        evaluation("combine.edge", k, {"edge": CropEdge(k, 3.5, 0.0, 0.0, REFERENCE, 0.9, NAN, NAN)})
    found = evaluation.metrics("combine")
    assert np.isnan([found["edge_rmse_m"], found["sure_wrong_share"], found["edge_judged_share"]]).all()
    assert found["edge_sample_count"] == 0
    assert evaluation.notes() == []


def test_places_are_those_of_the_best_split():
    line = np.zeros((3, 1000), dtype=bool)
    line[0, 400:] = True
    line[1, 400:] = True
    line[1, 392:395] = True  # frayed: a stem further out
    line[2, :600] = True  # crop first: no such edge
    assert [p.tolist() for p in edges_of(line)] == [[400.0], [400.0], []]
    assert STEP_M == 0.01


def test_edges_that_are_none_may_say_nowhere():
    """`reference_x` may be nan without an edge: availability counts them as missing, and the run goes on."""
    evaluation = evaluation_of(GridField(ArcEdge()), machine())
    for k in range(200):
        t, s = k * 40_000_000, 0.08 * k
        pose = Pose.from_euler([s, -GEOMETRY.header_end("left")[1], 0.0])
        evaluation("combine.motion", t, {"state": MachineState(t, pose, 2.0, 0.0, 0.0, 0.0, s)})
        evaluation("combine.edge", t, {"edge": CropEdge(t, NAN, NAN, NAN, NAN, 0.0, NAN, NAN)})
    found = evaluation.find("combine", EdgeDetection).metrics()
    assert found["edge_sample_count"] == 75
    assert found["detection_availability"] == 0.0
