"""A run's yield log: what it weighs is what the machine took in, and an import reads it back."""

import numpy as np
import pytest

pytest.importorskip("pyproj")

from swath import load_scenario
from swath.commands.main import main
from swath.core.errors import InputError
from swath.field_io.log import read_log
from swath.record.tracks import read_tracks
from swath.runtime.job import run_job
from swath.tools.yield_log.records import records_of


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """45 s along the straight edge: long enough that grain has passed the whole machine."""
    out = tmp_path_factory.mktemp("run") / "r"
    sets = ["run.distance_m=80", "combine.lidar=off", "combine.edge=truth", "expect={}"]
    run_job(load_scenario("straight", sets=sets), out, progress=False)
    return out


def test_the_log_holds_the_grain_that_came_into_the_tank(run):
    log, tracks = records_of(run), read_tracks(run / "tracks.parquet")
    grown = tracks["tank_grain_kg"][-1] - tracks["tank_grain_kg"][0]
    assert log.grain_kg == pytest.approx(grown, rel=0.06)  # of the last second only the whole ones
    assert log.crop == "wheat"


def test_a_sensor_further_on_shifts_the_flow_alone(run):
    near, far = records_of(run), records_of(run, delay=4.0)
    np.testing.assert_allclose(far.flow[4:], near.flow[:-4], atol=1e-9)
    np.testing.assert_array_equal(far.lat, near.lat)


@pytest.mark.parametrize("name", ["log.csv", "TASKDATA"])
def test_an_import_reads_back_what_was_written(run, tmp_path, capsys, name):
    assert main(["yield-log", str(run), "--out", str(tmp_path / name), "--at", "48.1,11.2"]) == 0
    assert "records" in capsys.readouterr().out
    made, log = records_of(run, at=(48.1, 11.2)), read_log(tmp_path / name)
    assert log.crop == "wheat"
    np.testing.assert_allclose(log.width, made.width, atol=1e-3)
    np.testing.assert_allclose(log.speed, made.speed, atol=2e-3)
    np.testing.assert_allclose(log.flow, np.where(made.working, made.flow, 0.0), atol=1e-4)
    tracks = read_tracks(run / "tracks.parquet")
    driven = np.hypot(np.diff(log.east), np.diff(log.north)).sum()
    assert driven == pytest.approx(tracks["distance_m"][-1], rel=0.05)
    assert 48.09 < np.median(made.lat) < 48.11


def test_what_is_no_run_or_no_place_is_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"tracks\.parquet"):
        records_of(tmp_path)
    with pytest.raises(InputError, match="expected a harvester of the run: combine"):
        records_of(run, machine="cart")
    assert main(["yield-log", str(run), "--out", str(tmp_path / "x.csv"), "--at", "here"]) == 2
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter").write_text("dear")
    assert main(["yield-log", str(run), "--out", str(tmp_path / "full")]) == 2
