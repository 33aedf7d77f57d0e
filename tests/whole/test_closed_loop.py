"""The circle closed on real stems: the bundled scenarios, shortened, keep the limits they are made for."""

import pytest

from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from tests.evaluated import metrics_of


def judged(name, *sets):
    world = assemble(load_scenario(name, sets=list(sets)))
    evaluation = make_evaluation(world)
    drive(world, [evaluation])
    return metrics_of(evaluation)


def test_straight_edge_at_7_kmh():
    m = judged("straight", "run.distance_m=26")
    assert m["edge_rmse_m"] <= 0.05
    assert m["lateral_rms_m"] <= 0.05
    assert m["detection_availability"] > 0.95
    assert m["mass_balance_error"] < 1e-9
    assert m["uncut_area_m2"] < 0.05


def test_bend_of_40_m_radius():
    m = judged("bend", "run.distance_m=36", "field.edge.run_in_m=10")
    assert m["lateral_p95_m"] <= 0.10
    assert m["edge_rmse_m"] <= 0.03
    assert m["mass_balance_error"] < 1e-9


@pytest.mark.parametrize(
    ("side", "angle"), [("left", 40), pytest.param("right", -40, marks=pytest.mark.draws)]
)
def test_bend_past_a_gap_over_rolling_ground(side, angle):
    """Where the ground ahead begins to rise the crop seems lower: it is not lodged, the line bends."""
    crop, azimuth = ("right", 30) if side == "left" else ("left", 150)
    m = judged(
        "bend", "seed=3", "run.distance_m=44", "combine.start.along_edge_m=20", f"combine.edge_side={side}",
        "field.edge={shape: curve, run_in_m: 45, radius_m: 60,"
        f" angle_deg: {angle}, crop_side: {crop},"
        " gaps: [{start_m: 28, end_m: 30.5, depth_m: 0.8, stubble_height_m: 0.15}]}",
        "field.terrain.slope_percent=2",
        f"field.terrain.waves=[{{amplitude_m: 0.12, wavelength_m: 25, azimuth_deg: {azimuth}}}]",
    )  # fmt: skip
    assert m["lateral_p95_m"] <= 0.15
    assert m["edge_lost_count"] == 0


@pytest.mark.parametrize("level", ["kinematic", "single_track"])
def test_right_header_end_and_every_motion_level(level):
    m = judged(
        "straight",
        "run.distance_m=20",
        "combine.edge_side=right",
        "field.edge.crop_side=left",
        f"combine.motion.level={level}",
        "combine.lidar.sub_rays=7",
    )
    assert m["edge_rmse_m"] <= 0.06
    assert m["lateral_rms_m"] <= 0.08
