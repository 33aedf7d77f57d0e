"""Bad input: one clear line, exit code 2, nothing left behind."""

import pytest

from swath.commands.main import main
from tests.whole.small import TEXT

CASES = {
    "unknown key": ("combine.lidar.sub_ray=7", "did you mean 'sub_rays'"),
    "wrong unit": ("combine.speed.speed_mph=4", "speed_kmh"),
    "unit in the value": ("combine.speed.speed_kmh=7 km/h", "expected a number"),
    "negative density": ("field.stand.stems_per_m2=-5", "stems_per_m2 = -5: expected > 0"),
    "not finite": ("combine.speed.speed_kmh=.nan", "finite"),
    "infinite": ("field.stand.stems_per_m2=.inf", "expected"),
    "sensor below ground": ("combine.lidar.mount.z_m=-0.5", "mount.z_m = -0.5: expected"),
    "sensor file": ("combine.lidar.sensor=sick-lms511", "did you mean 'sick-lms"),
    "field smaller than the run": ("run.distance_m=5000", "run.distance_m = 5000"),
    "machine on the wrong side": ("combine.edge_side=right", "combine.edge_side = right"),
    "missing dem": ("field.terrain={level: dem, file: nowhere.tif}", "nowhere.tif"),
    "missing machine": ("combine.machine=lexion-900", "machine"),
    "sector": ("combine.lidar.sector_deg=[10, -10]", "sector_deg"),
    "offset beyond the period": ("combine.lidar.offset_ms=41", "combine.lidar.offset"),
    "wire to nowhere": ("combine.edge.wires={scan: camera.scan}", "camera"),
    "wrong wire": ("combine.steer.wires={edge: motion.state}", "combine.motion.state -> combine.steer.edge"),
    "unknown level": ("combine.edge.level=otzu", "did you mean 'otsu'"),
    "user level that is not there": ("combine.edge.level=mine.py:Mine", "there is no file"),
}


def refused(capsys, tmp_path, argv):
    out = tmp_path / "out"
    code = main([*argv, "--out", str(out)])
    printed = capsys.readouterr()
    assert code == 2, printed.err
    assert printed.err.startswith("swath: ")
    assert printed.err.count("\n") == 1
    assert not out.exists()
    return printed.err


@pytest.mark.parametrize("case", CASES)
def test_bad_values(case, capsys, tmp_path):
    override, words = CASES[case]
    file = tmp_path / "s.yaml"
    file.write_text(TEXT)
    assert words in refused(capsys, tmp_path, ["run", str(file), "--set", override])


def test_line_of_an_error_found_while_assembling(capsys, tmp_path):
    file = tmp_path / "s.yaml"
    file.write_text(TEXT.replace("sub_rays: 7,", "sub_rays: 7, mount: {z_m: -1},"))
    line = 1 + next(n for n, text in enumerate(TEXT.splitlines()) if "lidar" in text)
    assert f"s.yaml:{line})" in refused(capsys, tmp_path, ["run", str(file)])


def test_missing_scenario_file(capsys, tmp_path):
    assert "no such file" in refused(capsys, tmp_path, ["run", str(tmp_path / "none.yaml")])


def test_unreadable_geotiff(capsys, tmp_path):
    pytest.importorskip("rasterio")
    (tmp_path / "dem.tif").write_bytes(b"II*\x00 this is no picture")
    file = tmp_path / "s.yaml"
    file.write_text(TEXT)
    override = "field.terrain={level: dem, file: " + str(tmp_path / "dem.tif") + "}"
    assert "dem.tif" in refused(capsys, tmp_path, ["run", str(file), "--set", override])
