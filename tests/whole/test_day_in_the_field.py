"""A scenario whose scanner and motion come from somebody's bag: the detector runs on real messages."""

import json

import numpy as np
import pytest

from swath.commands.main import main
from swath.record.tracks import read_tracks
from tests.bags import SPEED, START, write_bag

BEGIN = START[0] + SPEED * 7.0  # east, where the run starts within the log [m]
SCENARIO = """
format: swath scenario 2
name: field-day
run: {distance_m: 500, max_duration_s: 100}
field:
  terrain: plane
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight, length_m: 600}
machines:
  drone:
    start: {x_m: 17, y_m: -1, heading_deg: 0}
    motion: {level: log, FILE, start_s: 7, topics: {state: /odom}}
    lidar:
      level: log
      FILE
      start_s: 7
      topics: {scan: /scan}
      scale: {scan.intensity: 0.0078125}
    edge: {level: otsu}
    odometry: {level: log, FILE, start_s: 7, topics: {odometry: /odom}, clock: stamp}
    speed: {level: log, FILE, start_s: 7, topics: {command: /speed}, between: interpolate}
"""


@pytest.mark.parametrize("kind", ["rosbag1", "mcap"])
def test_a_run_along_a_bag(tmp_path, capsys, kind):
    bags = tmp_path / "bags"
    bags.mkdir()
    path = write_bag(bags / ("day.bag" if kind == "rosbag1" else "day"), kind)
    text = SCENARIO
    for key, form in (
        ("motion: {level: log, FILE", "{}"),
        ("odometry: {level: log, FILE", "{}"),
        ("FILE", "{}"),
    ):
        text = text.replace(key, key.replace("FILE", form))
    where = f"{'file' if path.is_file() else 'folder'}: bags/{path.name}"
    (tmp_path / "day.yaml").write_text(text.replace("{}", where))
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "day.yaml"), "--no-report", "--no-replay", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "the run ended at 3.0" in printed
    assert "drone.motion: the log of state ended at 3.00 s" in printed
    summary = json.loads((out / "summary.json").read_text())
    assert summary["distance_m"] == pytest.approx(6.0)
    assert summary["incomplete"] is False
    tracks = read_tracks(out / "tracks.parquet")
    np.testing.assert_allclose(tracks["x_m"], BEGIN + SPEED * tracks["t_s"], atol=1e-6)
    np.testing.assert_allclose(tracks["odometry_speed_m_s"][1:], SPEED)
    np.testing.assert_allclose(
        tracks["command_speed_m_s"][5::50], 2.2 + 0.1 * tracks["t_s"][5::50], atol=0.011
    )
    if kind == "mcap":
        assert main(["rerun", str(out), "--slots", "speed", "--out", str(tmp_path / "again")]) == 0
        assert "differs" not in capsys.readouterr().out


def test_a_picture_of_a_real_scan(tmp_path):
    """Nobody knows what a real scan truly hit; everything else is shown."""
    write_bag(tmp_path / "day.bag", "rosbag1")
    text = SCENARIO.replace("    FILE\n", "    file: day.bag\n").replace("FILE", "file: day.bag")
    (tmp_path / "day.yaml").write_text(text)
    out = tmp_path / "scan"
    formats = ["--format", "png,csv,ply,npz"]
    assert main(["scan", str(tmp_path / "day.yaml"), "--at", "2", "--out", str(out), *formats]) == 0
    arrays = np.load(out / "scan.npz")
    assert np.isnan(arrays["points_true_m"]).all()
    x = np.frombuffer((out / "scan.ply").read_bytes().split(b"end_header\n")[1][:8], "<f8")[0]
    assert BEGIN + SPEED * 2.0 < x < BEGIN + SPEED * 2.0 + 6.0  # ahead of where the machine is then
