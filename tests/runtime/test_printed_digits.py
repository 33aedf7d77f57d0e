"""What is printed after a run: a level's error beside them, no inputs."""

import pytest

from swath.field.maps.projection import Origin
from swath.judge.catalogue import load_evaluators
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario
from swath.terminal.outcome import _rows
from swath.tools.function_test.judging.verdict import lower_bound


def test_errors_of_levels_stand_beside_and_inputs_are_left_out():
    told = {"level_errors": {"lateral_rms_m": 0.03}, "given": ["mean_loss_percent"]}
    metrics = {"lateral_rms_m": 0.021739, "mean_loss_percent": 1.0, "header_use": 0.98765}
    fails = {"name": "header_use", "limit": {"min": 0.9877}, "result": "fail", "value": 0.98765}
    known = load_evaluators().metrics
    rows = {row[0]: row[1:] for row in _rows(known, metrics, [fails], told)}
    assert rows["lateral_rms_m"] == ("0.021739 ± 0.03", "m", "", "")
    assert rows["header_use"] == (
        "0.98765",
        "",
        "min 0.9877",
        "fail",
    )  # told from the limit
    assert "mean_loss_percent" not in rows
    limit = {"name": "mean_loss_percent", "limit": {"max": 2.0}, "result": "pass", "value": 1.0}
    assert "mean_loss_percent" in {row[0] for row in _rows(known, metrics, [limit], told)}


def test_what_is_0_and_could_not_be_better_is_left_to_the_page():
    """Unless there is a limit on it; a 0 that is bad news, and what is neither good nor bad, is printed."""
    known = load_evaluators().metrics
    values = {"edge_lost_count": 0, "detection_availability": 0.0, "distance_m": 25.0, "ray_count": 7}
    assert [row[0] for row in _rows(known, values, [], {})] == ["detection_availability", "distance_m"]
    limit = {"name": "edge_lost_count", "limit": {"max": 0}, "result": "pass", "value": 0}
    assert ("edge_lost_count", "0", "", "max 0", "pass") in _rows(known, values, [limit], {})


def test_a_run_says_what_its_levels_are_given():
    for process, given in (("constant", ["mean_loss_percent", "peak_loss_percent"]), ("threshing", [])):
        blind = ["combine.lidar=off", "combine.edge=truth", "combine.speed.guard={}"]
        sets = ["run.distance_m=1", f"combine.process={process}", *blind]
        summary = run_unrecorded(load_scenario("straight", sets=sets))
        assert summary["credibility"]["given"] == given
        assert "map_grid" not in summary


@pytest.mark.parametrize(
    ("passed", "count", "percent"), [(10, 10, 74), (59, 59, 95), (92, 93, 95), (31, 50, 49)]
)
def test_figures_of_the_page_on_verdicts(passed, count, percent):
    from pathlib import Path

    page = (Path(__file__).parents[2] / "docs/how-to/function-tests.md").read_text(encoding="utf-8")
    assert int(100.0 * lower_bound(passed, count, 0.95)) == percent
    assert f"| {passed} of {count} | {percent} % |" in page


def test_the_grid_of_the_map_is_told():
    """Osnabrueck: 0.95 deg west of the zone's meridian, sin(52.28 deg) of it."""
    pytest.importorskip("pyproj", reason="needs the extra `geo`")
    from swath.field.maps.projection import origin_at

    grid = origin_at(52.28, 8.05).grid()
    assert grid["epsg"] == 32632
    assert grid["convergence_deg"] == pytest.approx(-0.95 * 0.7910, abs=0.001)
    assert grid["scale"] == pytest.approx(1.0 - 345e-6, abs=5e-6)
    middle = Origin(32632, 500_000.0, 5_800_000.0).grid()
    assert middle["convergence_deg"] == pytest.approx(0.0, abs=1e-6)
    assert middle["scale"] == pytest.approx(0.9996, abs=1e-7)
