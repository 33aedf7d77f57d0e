"""The bridge against processes that are written only with rclpy and standard messages."""

import json
import subprocess

import numpy as np
import pytest
from mcap.reader import make_reader
from pyarrow.parquet import read_table

from swath.runtime.changes import read_events
from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario
from tests.link.ros2_rig import HERE, Heard, all_taken, are_heard, domain, hashes_of, needs_ros2, node  # noqa: F401
from tests.waiting import PATIENCE_S, until

pytestmark = needs_ros2

TEXT = """
format: swath scenario 2
name: bridged
seed: 3
run: {distance_m: 100, max_duration_s: 2}
field:
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight}
  obstacles: [{kind: post, x_m: -1.5, y_m: 12}]
machines:
  combine:
    motion: {level: single_track, start_speed_kmh: 7}
    gnss: {level: ideal, rate_hz: 50}
    imu: {level: error, rate_hz: 50}
    lidar: {sub_rays: 1, sector_deg: [-40, 40], step_deg: 2.0, rate_hz: 50, echo: all, within: nearest}
"""
LISTENED = {
    "/combine/lidar/scan": "sensor_msgs/LaserScan",
    "/combine/lidar/scan_points": "sensor_msgs/PointCloud2",
    "/combine/odometry/odometry": "nav_msgs/Odometry",
    "/combine/motion/state": "nav_msgs/Odometry",
    "/combine/gnss/fix_odometry": "nav_msgs/Odometry",
    "/combine/imu/inertial": "sensor_msgs/Imu",
}


@pytest.fixture
def bridge():
    from swath.link.ros2.bridge import Bridge

    made = Bridge(is_paused=True)
    yield made
    made.close()


def recorded(folder, topic):
    with (folder / "run.mcap").open("rb") as file:
        return [(m.log_time, m.data) for _, _, m in make_reader(file).iter_messages(topics=[topic])]


def test_every_message_is_the_one_in_the_file_and_time_is_simulated(domain, bridge, tmp_path):  # noqa: F811
    report, out = tmp_path / "report.json", tmp_path / "run"
    pairs = [f"{topic}={kind}" for topic, kind in LISTENED.items()]
    scenario = parse_scenario(TEXT, sets=["run.max_duration_s=1"])
    with node(HERE / "ros2_listener.py", report, *pairs, stdin=subprocess.PIPE) as listener:
        summary = run_job(scenario, out, hooks=[bridge, Heard(bridge, LISTENED)]).summary
        sent = {topic: hashes_of(out, topic) for topic in LISTENED}
        last = {topic: hashes[-1] for topic, (_, hashes) in sent.items()}
        listener.communicate(json.dumps({**last, "/clock": 1_000_000_000}), timeout=600)
    found = json.loads(report.read_text())
    assert found["reply"] == "running at 0 s"
    for topic, got in found["got"].items():
        first, hashes = sent[topic]
        every = len(hashes) // 50  # of the machine's state, of which the file has 200 a second
        assert got[-50:] == hashes[every - 1 :: every], topic
        assert set(got[:-50]) <= set(first), topic
    assert summary["ros2"]["messages"] > 350
    clock = [t for t in found["clock"] if t > 0]
    assert clock == list(range(10_000_000, 1_000_000_001, 10_000_000))
    assert found["fired_in_pause"] == 0
    fired = np.array(found["fired"])
    assert 1 <= len(fired) <= 10  # every 0.1 s of a simulated one; a slow listener skips some, never adds any
    assert np.all(np.diff(fired) > 0)
    assert np.all(fired >= 100_000_000 * np.arange(1, len(fired) + 1))
    assert fired[-1] <= 1_000_000_000
    alone = run_job(scenario, tmp_path / "alone").summary
    assert alone["digest"] == summary["digest"]


def laser_scan(data):
    """The LaserScan of CDR bytes."""
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import LaserScan

    return deserialize_message(bytes(data), LaserScan)


def shortest(data):
    """The nearest echo of a LaserScan's CDR bytes [m]."""
    return float(np.min(laser_scan(data).ranges))


def act(bridge, tmp_path, *calls):
    """The run under these calls; (summary, replies)."""
    report, out = tmp_path / "replies.json", tmp_path / "run"
    with node(HERE / "ros2_caller.py", report, json.dumps(calls)) as caller:
        summary = run_job(parse_scenario(TEXT), out, hooks=[bridge]).summary
        assert caller.wait(PATIENCE_S) == 0
    return summary, json.loads(report.read_text())


def test_messages_of_every_kind_are_those_in_the_file(domain, bridge, tmp_path):  # noqa: F811
    """Radar, pose, objects, commands, images; a second scanner has its own name and frame."""
    report, out = tmp_path / "report.json", tmp_path / "run"
    listened = {  # topic: type, how many at least
        "/combine/radar/targets_points": ("sensor_msgs/PointCloud2", 13),
        "/combine/objects/objects_markers": ("visualization_msgs/MarkerArray", 6),
        "/combine/pose/pose": ("nav_msgs/Odometry", 32),
        "/combine/speed/command": ("geometry_msgs/TwistStamped", 6),
        "/combine/camera/image": ("sensor_msgs/Image", 3),
        "/combine/camera/image_depth": ("sensor_msgs/Image", 3),
        "/combine/camera/image_label": ("sensor_msgs/Image", 3),
        "/combine/camera/camera_info": ("sensor_msgs/CameraInfo", 3),
        "/combine/lidar/scan": ("sensor_msgs/LaserScan", 32),
        "/combine/lidar_rear/scan": ("sensor_msgs/LaserScan", 16),
    }
    sets = [
        "run.max_duration_s=0.65",
        "combine.radar={level: rays, sensor: radar-24ghz}",
        "combine.objects.level=radar",
        "combine.pose.level=ekf",
        "combine.camera={width_px: 61, height_px: 45, reach_m: 30}",
        "combine.lidar_rear={sub_rays: 1, step_deg: 1, mount: {at: axle, z_m: 3, yaw_deg: 180}}",
    ]
    pairs = [f"{topic}={kind}" for topic, (kind, _) in listened.items()]
    with node(HERE / "ros2_listener.py", report, *pairs, stdin=subprocess.PIPE) as listener:
        run_job(parse_scenario(TEXT, sets=sets), out, hooks=[bridge, Heard(bridge, listened)])
        sent = {topic: hashes_of(out, topic) for topic in listened}
        listener.communicate(
            json.dumps({topic: after[-1] for topic, (_, after) in sent.items()}), timeout=600
        )
    got = json.loads(report.read_text())["got"]
    for topic, (_, count) in listened.items():
        first, hashes = sent[topic]
        assert got[topic][-len(hashes) :] == hashes, topic
        assert set(got[topic][: -len(hashes)]) <= set(first), topic
        assert len(hashes) >= count, topic
    front, rear = (laser_scan(recorded(out, f"/combine/{s}/scan")[-1][1]) for s in ("lidar", "lidar_rear"))
    assert (front.header.frame_id, rear.header.frame_id) == ("combine/lidar", "combine/lidar_rear")
    assert list(front.ranges) != list(rear.ranges)


def test_services_act_on_the_run_and_what_they_did_can_be_done_again(domain, bridge, tmp_path):  # noqa: F811
    wall = "{kind: box, x_m: 0, y_m: 5, length_m: 14, width_m: 1, height_m: 3}"
    summary, replies = act(
        bridge,
        tmp_path,
        ["step"],
        ["set", "combine.speed.speed_kmh", 3],
        ["step"],
        ["reset"],
        ["set", "step_s", 0.5],
        ["step"],
        ["set", "combine.speed.speed_kmh", 4],
        ["set", "combine.edge.level", "otsu"],
        ["set", "obstacles.wall", wall],
        ["step"],
        ["set", "obstacles.wall", None],
        ["set", "obstacles.0", None],
        ["get", "combine.edge.level"],
        ["get", "combine.speed.speed_kmh"],
        ["pause", False],
    )
    assert [done for done, *_ in replies[:12]] == [True] * 12
    assert [text for _, text in (replies[0], replies[2], replies[3], replies[5], replies[9])] == [
        "at 0.02 s",
        "at 0.04 s",
        "reset at 0.04 s",
        "at 0.5 s",
        "at 1 s",
    ]
    assert replies[12][1] == "otsu"
    assert [(round(e["t_s"], 3), e["set"], e["value"]) for e in summary["events"]] == [
        (0.505, "combine.speed.speed_kmh", 4),
        (0.505, "combine.edge.level", "otsu"),
        (0.505, "obstacles.wall", wall),
        (1.005, "obstacles.wall", None),
        (1.005, "obstacles.0", None),
    ]
    tracks = read_table(tmp_path / "run" / "tracks.parquet")
    times, speeds = tracks["t_s"].to_numpy(), tracks["speed_m_s"].to_numpy()
    assert times[0] == 0.0
    assert np.all(np.diff(times) > 0)
    assert speeds[-1] < 0.8 * speeds[20]
    nearest = {}
    for t, data in recorded(tmp_path / "run", "/combine/lidar/scan"):
        nearest[t * 1e-9] = shortest(data)
    assert (
        max(r for t, r in nearest.items() if 0.51 < t <= 1.0)
        < min(r for t, r in nearest.items() if t > 1.02) - 1.0
    )
    again = run_job(parse_scenario(TEXT), tmp_path / "again", events=read_events(tmp_path / "run")).summary
    assert again["digest"] == summary["digest"]
    assert again["events"] == summary["events"]


def test_what_cannot_be_done_is_refused_with_a_reason_and_changes_nothing(domain, bridge, tmp_path):  # noqa: F811
    summary, replies = act(
        bridge,
        tmp_path,
        ["set", "combine.speed.speed_kmhh", 3],
        ["set", "combine.edge.level", "sharp"],
        ["set", "combine.motion.level", "kinematic"],
        ["set", "combine.lidar.rate_hz", 10],
        ["set", "obstacles.pole", "{kind: post}"],
        ["set", "obstacles.pole", None],
        ["set", "seed", 3],
        ["pause", False],
        ["step"],
    )
    reasons = [text for done, text in replies[:-2]]
    assert [done for done, *_ in replies[:-2]] == [False] * 7
    expected = (
        "speed_kmh'",
        "expected one of joined, likelihood_ratio",
        "to exchange",
        "rhythm",
        "x_m",
        "there: 0",
        "slot.level",
    )
    for reason, words in zip(reasons, expected, strict=True):
        assert words in reason, reason
    assert replies[-1] == [False, "expected a paused run: pause it first"]
    assert "events" not in summary


def test_a_recorded_run_is_published_again(domain, tmp_path, monkeypatch):  # noqa: F811
    from swath.link.ros2 import player

    def clock(node):
        made = whole_clock(node)
        until(lambda: are_heard(node, {*LISTENED, "/clock"}), "all topics have a listener")
        return made

    def close_node(node):
        all_taken(node)
        whole_close(node)

    whole_clock, whole_close = player.Clock, player.close_node
    monkeypatch.setattr(player, "Clock", clock)
    monkeypatch.setattr(player, "close_node", close_node)
    out, report = tmp_path / "run", tmp_path / "report.json"
    pairs = [f"{topic}={kind}" for topic, kind in LISTENED.items()]
    with node(HERE / "ros2_listener.py", report, "--no-pause", *pairs, stdin=subprocess.PIPE) as listener:
        run_job(parse_scenario(TEXT, sets=["run.max_duration_s=1"]), out)
        count = player.play(out / "run.mcap", factor=0.5, wait_s=0.0)
        sent = {topic: [each for part in hashes_of(out, topic) for each in part] for topic in LISTENED}
        last = {topic: hashes[-1] for topic, hashes in sent.items()}
        listener.communicate(json.dumps({**last, "/clock": 1_000_000_000}), timeout=600)
    found = json.loads(report.read_text())
    assert count > 120
    assert found["got"] == sent
    assert found["clock"] == list(range(0, 1_000_000_001, 10_000_000))


def test_a_node_saves_and_goes_back_with_a_change(domain, tmp_path):  # noqa: F811
    from swath.link.ros2.bridge import Bridge
    from swath.runtime.run_control import RunControl
    from swath.runtime.saves import Saves

    saves = Saves(100.0)
    made = Bridge(control=RunControl(is_paused=True, saves=saves))
    calls = [
        ["save"], ["set", "step_s", 0.4], ["step"], ["save"], ["step"],
        ["set", "branch_set", ["combine.speed.speed"]], ["branch"],
        ["set", "branch_set", ["combine.speed.speed_kmh=5"]], ["branch"], ["pause", False],
    ]  # fmt: skip
    report, scenario = tmp_path / "replies.json", parse_scenario(TEXT, sets=["run.max_duration_s=1"])
    try:
        with node(HERE / "ros2_caller.py", report, json.dumps(calls)) as caller:
            result = run_job(scenario, tmp_path / "run", hooks=[saves, made])
            assert caller.wait(PATIENCE_S) == 0
    finally:
        made.close()
    replies = json.loads(report.read_text())
    assert replies[0][0] is False
    assert "nothing to save" in replies[0][1]
    assert replies[3] == [True, "saved at 0.4 s"]
    assert replies[6][0] is False
    assert "KEY=VALUE" in replies[6][1]
    assert replies[8][0] is True, replies[8]
    assert result.folder == tmp_path / "run-branch"
    assert result.summary["branch"] == {"of": "run", "at_s": 0.400000001, "saved_s": 0.4}
    events = [{"t_s": 0.405, "set": "combine.speed.speed_kmh", "value": "5"}]  # the tick behind the save
    assert [e["t_s"] for e in result.summary["events"]] == [0.405]
    fresh = run_job(scenario, tmp_path / "fresh", events=events).summary
    assert fresh["digest"] == result.summary["digest"]
