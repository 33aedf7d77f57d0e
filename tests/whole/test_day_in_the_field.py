"""A scenario whose scanner and motion come from somebody's bag: the detector runs on real messages."""

import json

import numpy as np
import pytest
from bags import SPEED, START, write_bag

from swath.cli import main
from swath.sim.tracks import read_tracks

SCENARIO = """
name: field-day
run: {distance_m: 500, max_duration_s: 100}
field:
  terrain: plane
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight, length_m: 600}
drone:
  start: {x_m: 3, y_m: -1, heading_deg: 0}
  motion: {level: log, FILE, topics: {state: /odom}}
  lidar:
    level: log
    FILE
    topics: {scan: /scan}
    scale: {scan.intensity: 0.0078125}
  edge: {level: otsu}
  odometry: {level: log, FILE, topics: {odometry: /odom}, clock: stamp}
  speed: {level: log, FILE, topics: {command: /speed}, between: interpolate}
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
    assert main(["run", str(tmp_path / "day.yaml"), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "the run ended at 10.0" in printed
    assert "drone.motion: the log of state ended at 10.00 s" in printed
    summary = json.loads((out / "summary.json").read_text())
    assert summary["distance_m"] == pytest.approx(20.0)
    assert summary["incomplete"] is False
    tracks = read_tracks(out / "tracks.parquet")
    np.testing.assert_allclose(tracks["x_m"], START[0] + SPEED * tracks["t_s"], atol=1e-6)
    np.testing.assert_allclose(tracks["odometry_speed_m_s"][1:], SPEED)
    np.testing.assert_allclose(
        tracks["command_speed_m_s"][5::50], 1.5 + 0.1 * tracks["t_s"][5::50], atol=0.011
    )
    assert main(["replay", str(out), "--slots", "speed", "--out", str(tmp_path / "again")]) == 0
    assert "differs" not in capsys.readouterr().out
