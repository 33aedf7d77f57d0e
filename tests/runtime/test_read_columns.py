"""What limits say of columns is the same where only these are kept."""

import pytest

from swath.api import load_scenario
from swath.runtime.assembly import assemble
from swath.runtime.job import Running, run_job, run_unrecorded

SETS = {
    "combine.lidar.level": "profile",
    "combine.header.level": "profile",
    "combine.motion": {"level": "kinematic", "start_speed_kmh": 7},
    "combine.edge": "otsu",
    "run.distance_m": 4,
}
YAW = {"min": -0.03, "max": 0.03, "hold": "always"}  # as `straight` has it
SPEED = {"speed_m_s": {"min": 1.9, "hold": 0.5, "while": {"edge_confidence": {"min": 0.9}}, "from_m": 1}}
OF_ROWS = {"lateral_error_m": {"max": 1.0, "hold": "eventually"}}  # made of other columns


@pytest.mark.parametrize(
    ("expect", "columns"),
    [
        ({}, {"yaw_rate_rad_s", "distance_m", "t_s"}),
        (SPEED, {"yaw_rate_rad_s", "speed_m_s", "edge_confidence", "distance_m", "t_s"}),
        (OF_ROWS, None),
    ],
)
def test_limits_are_judged_alike_without_the_other_columns(expect, columns, tmp_path):
    scenario = load_scenario("straight", sets={**SETS, "expect": {"yaw_rate_rad_s": YAW, **expect}})
    whole = run_job(scenario, tmp_path / "run").summary
    alone = run_unrecorded(scenario)
    assert [entry["value"] for entry in alone["expect"]] == [entry["value"] for entry in whole["expect"]]
    assert None not in [entry["value"] for entry in whole["expect"]]
    kept = Running(assemble(scenario), None, None, (), ()).recorder.tracks["combine"]
    if columns is None:
        assert len(kept) > 40
    else:
        assert set(kept) == columns
