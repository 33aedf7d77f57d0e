"""A combine on a slope of 90 %: it tips over, the run says so and fails."""

import pytest

from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario

pytest.importorskip("mujoco", reason="needs the extra `multibody`")


def test_a_combine_that_rolls_over_ends_its_run(tmp_path):
    sets = [
        "run.distance_m=10",
        "combine.motion=multibody",
        "combine.lidar={level: empirical, rate_hz: 10, sector_deg: [-30, 0]}",
        "field.terrain={level: plane, slope_percent: 90, slope_azimuth_deg: 180}",
    ]
    result = run_job(load_scenario("straight", sets=sets), tmp_path / "run")
    assert result.exit_code == 1  # what ended a run is judged, on ground of 90 %, too
    summary = result.summary
    assert not summary["incomplete"]
    limit = next(e for e in summary["expect"] if e["name"] == "rollover_count")
    assert (limit["value"], limit["result"]) == (1.0, "fail")
    (event,) = [e for e in summary["incidents"] if e["kind"] == "rollover"]
    assert event["machine"] == "combine"
    assert 0.5 < event["t_s"] < 10.0
    assert any("the run ended at" in n and "combine: rolled over at" in n for n in summary["notes"])
    assert summary["ended"]["reason"] == "rollover"
