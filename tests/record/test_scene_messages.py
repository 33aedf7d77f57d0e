"""A recording shows machine, scan, edge and field to other readers without any set-up."""

from xml.etree import ElementTree

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario

TEXT = """
format: swath scenario 2
name: shown
run: {distance_m: 20, max_duration_s: 1}
field:
  terrain: {level: formula, slope_percent: 5}
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight}
  boundary: {points_m: [[-60, -60], [60, -60], [60, 60], [-60, 60]]}
machines:
  combine:
    motion: {level: single_track, start_speed_kmh: 7}
    odometry: ideal
    lidar: {sub_rays: 1, sector_deg: [-40, 40], step_deg: 2.0, rate_hz: 25}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shown") / "run"
    run_job(parse_scenario(TEXT), folder)
    return folder


@pytest.fixture(scope="module")
def messages(run):
    """topic -> messages, as rosbags reads the run folder as a rosbag 2."""
    found = {}
    with AnyReader([run]) as reader:
        assert reader.message_count == sum(c.msgcount for c in reader.connections)
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found


def matrix(transform):
    """4 x 4 of a geometry_msgs/Transform."""
    q, p = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    made = np.eye(4)
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = p.x, p.y, p.z
    return made


def up_to_map(frame, links):
    """pose_map_frame through the tree, and the frames on the way."""
    pose, way = np.eye(4), [frame]
    while frame != "map":
        frame, link = links[frame]
        pose, way = link @ pose, [*way, frame]
    return pose, way


def test_frames_lead_from_the_scan_to_the_map_as_rep_105_has_them(messages):
    state = messages["/combine/motion/state"][-1]
    links = {}
    for message in (*messages["/tf_static"], messages["/tf"][-1]):
        for link in message.transforms:
            links[link.child_frame_id] = link.header.frame_id, matrix(link.transform)
    scan = messages["/combine/lidar/scan"][-1]
    pose, way = up_to_map(scan.header.frame_id, links)
    assert way == ["combine/lidar", "combine/base_link", "combine/odom", "map"]
    base, _ = up_to_map("combine/base_link", links)
    at = state.pose.pose.position
    assert base[:3, 3] == pytest.approx([at.x, at.y, at.z], abs=1e-9)
    assert pose[2, 3] - base[2, 3] > 1.0  # the scanner looks down from above


def test_the_body_is_that_of_the_data_sheet_in_the_frame_that_moves(messages):
    (message,) = messages["/robot_description"]
    robot = ElementTree.fromstring(message.data)
    (link,) = robot.findall("link")
    assert link.get("name") == "combine/base_link"
    header = next(v for v in link.findall("visual") if v.get("name") == "header")
    width = float(header.find("geometry/box").get("size").split()[1])
    assert width == 12.0
    assert len(link.findall("visual")) == 6


def test_edge_and_boundary_lie_on_the_ground(messages):
    (message,) = messages["/combine/field_markers"]
    lines = {m.ns: np.array([(p.x, p.y, p.z) for p in m.points]) for m in message.markers}
    assert set(lines) == {"edge", "boundary 0"}
    points = np.vstack(list(lines.values()))
    east, north, _ = np.linalg.lstsq(np.c_[points[:, :2], np.ones(len(points))], points[:, 2], rcond=None)[0]
    assert np.hypot(east, north) == pytest.approx(0.05, abs=1e-3)  # the slope of the field
    assert lines["boundary 0"][0].tolist() == lines["boundary 0"][-1].tolist()


def test_a_scan_says_its_period_and_its_range(messages):
    scan = messages["/combine/lidar/scan"][-1]
    assert scan.scan_time == pytest.approx(0.04)
    assert 0.0 < scan.range_min < 1.0
    assert 10.0 < scan.range_max < 200.0


def test_odometry_counts_from_where_the_machine_stood(messages):
    first, truth = messages["/combine/odometry/odometry"][0], messages["/combine/motion/state"]
    assert first.header.frame_id == "combine/odom"
    for measured, true in ((first, truth[0]), (messages["/combine/odometry/odometry"][-1], truth[-1])):
        a, b = measured.pose.pose.position, true.pose.pose.position
        assert (a.x, a.y) == pytest.approx((b.x, b.y), abs=0.05)


def test_the_clock_goes_along(messages):
    times = [m.clock.sec * 10**9 + m.clock.nanosec for m in messages["/clock"]]
    assert times[0] == 0
    assert set(np.diff(times)) == {20_000_000}
