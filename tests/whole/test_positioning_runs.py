"""Runs with a satellite receiver and an inertial unit: rates, played again, read by a part of one's own."""

import json

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.mcap_log import McapLog
from swath.record.tracks import read_tracks
from swath.runtime.job import run_job
from swath.tools.rerun.rerun import plan_rerun
from tests.foreign_bags import ANTENNA, GRAVITY, drive, fix
from tests.whole.small import small

pytestmark = pytest.mark.usefixtures("code_allowed_in_module")

LAW = '''
from swath.core.component import Port
from swath.signals import Fix, SpeedCommand


class Law:
    """Drives 2 m/s while there is a fix, else 1 m/s."""

    inputs = (Port("fix", Fix),)
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params, setup):
        pass

    def reset(self, stream):
        return {"command": SpeedCommand(0, 2.0)}

    def step(self, t, dt, inputs):
        return {"command": SpeedCommand(t + dt, 2.0 if inputs["fix"].quality == 4 else 1.0)}

    def save(self):
        return {}

    def load(self, state):
        pass
'''
BLIND = "run.record=full", "run.max_duration_s=1.5", "combine.lidar=off", "combine.edge=truth"
SETS = (
    *BLIND,
    "combine.gnss={level: error, losses: [{from_s: 0.7, to_s: 0.9}]}",
    "combine.imu=ideal",
)


@pytest.fixture(scope="module")
def positioned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("positioned")
    law = folder / "law.py"
    law.write_text(LAW)
    speed = f"combine.speed={{level: '{law}:Law', wires: {{fix: gnss.fix}}}}"
    run_job(small(*SETS, speed), folder / "run")
    return folder / "run"


def samples(folder, slot, output):
    log = McapLog(folder / "run.mcap")
    return list(exact_samples(log.messages((exact_topic(slot, output),))))


def test_fixes_come_at_their_rate_and_are_the_antenna_of_then(positioned):
    fixes = samples(positioned, "combine.gnss", "fix")
    assert [t for t, _ in fixes] == [k * NS // 10 for k in range(16)]
    states = dict(samples(positioned, "combine.motion", "state"))
    for t, sample in fixes[1:]:
        assert sample.t == t - 50_000_000
        lost = 0.7 * NS <= sample.t < 0.9 * NS
        assert (sample.quality == 0) == lost
        if not lost:
            antenna = states[sample.t].pose.apply([1.0, 0.0, 3.9])
            assert np.linalg.norm(antenna - (sample.x, sample.y, sample.z)) < 0.08
            assert sample.speed == pytest.approx(states[sample.t].speed, abs=0.15)


def test_an_inertial_unit_adds_up_to_what_the_machine_did(positioned):
    felt = samples(positioned, "combine.imu", "inertial")
    assert [t for t, _ in felt] == [k * NS // 100 for k in range(151)]
    states = dict(samples(positioned, "combine.motion", "state"))
    turn = sum(s.rate_z for _, s in felt) * 0.01
    assert turn == pytest.approx(states[NS * 3 // 2].pose.euler()[2] - states[0].pose.euler()[2], abs=2e-4)
    assert np.mean([s.force_z for _, s in felt]) == pytest.approx(9.81, abs=0.1)


def test_a_part_of_ones_own_reads_them(positioned):
    for t, command in samples(positioned, "combine.speed", "command")[2:]:
        assert (command.speed == 1.0) == (0.75 * NS <= t < 0.95 * NS)


@pytest.fixture(scope="module", params=["ekf", "raw"])
def steered(request, tmp_path_factory):
    """A run whose pose is made of a receiver that stands aside of the axle, wheels and an inertial unit."""
    folder = tmp_path_factory.mktemp(request.param)
    gnss = "combine.gnss={level: error, antenna: {x_m: -1.0, y_m: 0.4, z_m: 3.5}}"
    run_job(small(*BLIND, gnss, "combine.imu=ideal", f"combine.pose={request.param}"), folder / "run")
    return folder / "run"


SLOTS = None, ["combine.gnss"], ["gnss", "imu", "odometry"]


@pytest.mark.parametrize(
    ("steered", "slots"), [*zip(("ekf", "raw", "ekf"), SLOTS, strict=True)], indirect=["steered"]
)
def test_a_pose_is_the_same_on_a_recorded_receiver(steered, tmp_path, slots):
    plan = plan_rerun(steered, slots=slots, sets=["run.record=full"])
    assert "combine.gnss" in plan.played
    summary = plan.run(tmp_path / "out", report=False).summary
    assert summary["rerun"]["slots"]["combine.pose"]["samples"] > 70
    assert all(told["identical"] for told in summary["rerun"]["slots"].values())
    assert summary["digest"] == json.loads((steered / "summary.json").read_text())["digest"]


def test_a_pose_alone_is_the_same(steered, tmp_path, capsys):
    assert main(["part", "pose", "--input", str(steered), "--out", str(tmp_path / "part")]) == 0
    assert "combine.pose: identical to the recording" in capsys.readouterr().out


FOREIGN = """
format: swath scenario 2
name: foreign
run: {distance_m: 500, max_duration_s: 3}
field:
  terrain: plane
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight, length_m: 600}
machines:
  combine:
    start: {x_m: 3, y_m: -1, heading_deg: 0}
    lidar: off
    edge: truth
    motion: {level: log, folder: bag, topics: {state: /odom}}
    odometry: {level: log, folder: bag, topics: {odometry: /odom}}
    gnss:
      level: log
      folder: bag
      topics: {fix: /fix}
      origin: {lat_deg: 48.2, lon_deg: 11.5, height_m: 500}
      PLACE
    imu: {level: log, folder: bag, topics: {inertial: /imu}}
    pose: LEVEL
"""
PLACES = ("antenna_m: [-1.2, 0, 3.9]", "mount: {at: axle, x_m: -1.2, z_m: 3.9, pitch_deg: 0}", "")


@pytest.mark.parametrize(("level", "place"), [*zip(("raw", "raw", "ekf"), PLACES, strict=True)])
def test_a_receiver_of_somebody_elses_bag_feeds_a_pose(tmp_path, capsys, level, place):
    """NavSatFix has no course; the place of the antenna comes from the scenario, or else from /tf_static."""
    links = [("base_link", "gps", Pose.from_euler(ANTENNA))] if not place else []
    drive(
        tmp_path / "bag",
        links=links,
        seconds=3.5,
        fixes=lambda bag, t, at: fix(bag, t, at, variances=(1e-4, 1e-4, 4e-4)),
        force=lambda t: (0.0, 0.0, GRAVITY),
    )
    file, out = tmp_path / "foreign.yaml", tmp_path / "out"
    file.write_text(FOREIGN.replace("LEVEL", level).replace("PLACE", place))
    assert main(["run", str(file), "--out", str(out), "--no-report", "--no-replay"]) == 0
    tracks = read_tracks(out / "tracks.parquet")
    error = np.hypot(tracks["pose_x_m"] - tracks["x_m"], tracks["pose_y_m"] - tracks["y_m"])
    known = np.isfinite(error)
    assert known[tracks["t_s"] > 0.7].all()
    assert error[known].max() < 0.01


def test_a_receiver_without_a_place_is_refused_with_what_to_say(tmp_path, capsys):
    drive(tmp_path / "bag", fixes=fix, force=lambda t: (0.0, 0.0, GRAVITY))
    file = tmp_path / "foreign.yaml"
    file.write_text(FOREIGN.replace("LEVEL", "ekf").replace("PLACE", ""))
    assert main(["run", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "of a log antenna_m or mount says it" in capsys.readouterr().err


def test_it_is_played_again_to_the_last_bit(positioned, tmp_path):
    plan = plan_rerun(positioned, slots=None, sets=["run.record=full"])
    assert {"combine.gnss", "combine.imu"} <= set(plan.played)
    summary = plan.run(tmp_path / "out", report=False).summary
    assert all(told["identical"] for told in summary["rerun"]["slots"].values())
    assert summary["digest"] == json.loads((positioned / "summary.json").read_text())["digest"]
