"""A scanner at both header ends, and one detector that joins them."""

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario

CHEAP = [f"combine.lidar_{side}.{key}" for side in ("left", "right") for key in ("sub_rays=3", "step_deg=1")]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    scenario = load_scenario("two-scanners", sets=["run.distance_m=14", *CHEAP])
    return run_job(scenario, tmp_path_factory.mktemp("runs") / "two")


def test_the_joined_edge_steers(finished):
    summary = finished.summary
    assert summary["detection_availability"] > 0.9
    assert summary["lateral_p95_m"] < 0.15
    assert summary["mass_balance_error"] < 1e-9


def test_both_scanners_are_recorded_under_their_own_names(finished):
    with (finished.folder / "run.mcap").open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert {"/combine/lidar_left/scan", "/combine/lidar_right/scan"} <= topics
    assert "/combine/lidar/scan" not in topics
    assert "edge_offset_m" in pq.read_table(finished.folder / "tracks.parquet").column_names
