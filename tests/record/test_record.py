"""The recording, read back by packages that did not write it."""

import os
import signal
import struct
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from swath.record.mcap_file import Container
from swath.record.message_factory import definition
from swath.record.read.files import open_log
from swath.record.recorder import Recorder
from swath.record.scan_messages import is_laser_scan
from swath.record.tracks import Column, read_tracks
from swath.signals import F64, MachineState, Odometry, Scan, Signal
from tests.fake_run import MOUNTING, ArcEdge, GridField, drive, machine


def speed_of(latest):
    return latest[MachineState].distance + 0.0 * latest[Odometry].speed if Odometry in latest else np.nan


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    samples = []
    columns = Column("one", "-", "always 1", lambda _: 1.0), Column("v", "m/s", "at its row", speed_of)
    with Recorder(folder, [machine()], extra={"combine": columns}) as recorder:
        assert not recorder.is_late
        drive([lambda *s: samples.append(s), recorder], GridField(ArcEdge(40.0)), seconds=2.0)
    return folder, samples


EXACT = (
    "motion/state",
    "header/flow",
    "process/load",
    "lidar/scan",
    "odometry/odometry",
    "edge/edge",
    "steer/command",
    "speed/command",
    "steering/steering",
)


def read_mcap(path):
    """topic -> [(log time, decoded message)], by the mcap project's own ROS 2 decoder."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    found = {}
    with path.open("rb") as stream:
        for _, channel, message, decoded in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def of_kind(samples, kind):
    return [s for _, _, outputs in samples for s in outputs.values() if isinstance(s, kind)]


def test_scans_come_back_as_they_were(recorded):
    folder, samples = recorded
    scans = of_kind(samples, Scan)
    messages = read_mcap(folder / "run.mcap")["/combine/lidar/scan"]
    assert len(messages) == len(scans) == 51
    for (log_time, message), scan in zip(messages, scans, strict=True):
        assert log_time == scan.t
        first_beam = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert first_beam == max(scan.t - 10_000_000, 0)
        assert message.header.frame_id == "combine/lidar"
        ranges = np.array(message.ranges, dtype=np.float32)
        np.testing.assert_array_equal(
            ranges, np.where(np.isnan(scan.ranges[:, 0]), np.inf, scan.ranges[:, 0])
        )
        angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
        np.testing.assert_allclose(angles, scan.azimuth, atol=1e-6)


def test_every_topic_is_there_and_types_are_the_standard_ones(recorded):
    from rosbags.rosbag2.storage_mcap import McapReader

    folder, _ = recorded
    reader = McapReader(folder / "run.mcap")
    reader.open()
    found = {c.topic: c.msgtype for c in reader.connections}
    reader.close()
    assert found == {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/robot_description": "std_msgs/msg/String",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/combine/motion/state": "nav_msgs/msg/Odometry",
        "/combine/header/flow": "swath_msgs/msg/CropFlow",
        "/combine/process/load": "swath_msgs/msg/MachineLoad",
        "/combine/lidar/scan": "sensor_msgs/msg/LaserScan",
        "/combine/lidar/truth": "sensor_msgs/msg/PointCloud2",
        "/combine/odometry/odometry": "nav_msgs/msg/Odometry",
        "/combine/edge/edge": "swath_msgs/msg/CropEdge",
        "/combine/edge/edge_marker": "visualization_msgs/msg/Marker",
        "/combine/steer/command": "swath_msgs/msg/SteerCommand",
        "/combine/speed/command": "geometry_msgs/msg/TwistStamped",
        "/combine/steering/steering": "ackermann_msgs/msg/AckermannDriveStamped",
    } | {f"/combine/{output}_exact": "swath_msgs/msg/Samples" for output in EXACT}


def test_poses_and_transforms_agree_with_the_truth(recorded):
    folder, samples = recorded
    topics = read_mcap(folder / "run.mcap")
    states = {s.t: s for s in of_kind(samples, MachineState)}
    moved = [(t, f) for t, m in topics["/tf"] for f in m.transforms]
    assert len(moved) == len(states) == 201  # every sample
    for (t, transform), (_, odometry) in zip(moved, topics["/combine/motion/state"], strict=True):
        state = states[t]
        q = transform.transform.rotation
        yaw = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        assert yaw == pytest.approx(state.pose.euler()[2], abs=1e-12)
        p = odometry.pose.pose.position
        np.testing.assert_array_equal([p.x, p.y, p.z], state.pose.position)
    static = {f.child_frame_id: f for _, m in topics["/tf_static"] for f in m.transforms}
    assert set(static) == {"combine/lidar", "combine/odom"}
    p = static["combine/lidar"].transform.translation
    np.testing.assert_array_equal([p.x, p.y, p.z], MOUNTING.position)


def test_a_cloud_holds_the_true_points(recorded):
    folder, samples = recorded
    t, cloud = read_mcap(folder / "run.mcap")["/combine/lidar/truth"][1]
    truth = next(o["truth"] for _, at, o in samples if at == t and "truth" in o)
    assert [f.name for f in cloud.fields] == ["x", "y", "z", "beam", "echo"]
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("beam", "<u4"), ("echo", "<u2")]
    table = np.frombuffer(bytes(cloud.data), dtype=np.dtype(kinds, align=True))
    assert [f.offset for f in cloud.fields] == [table.dtype.fields[n][1] for n in table.dtype.names]
    assert cloud.point_step == table.dtype.itemsize == 20
    points = truth.points[:, 0]
    seen = np.isfinite(points[:, 0])
    np.testing.assert_array_equal(table["beam"], np.nonzero(seen)[0])
    np.testing.assert_allclose(table["y"], points[seen, 1].astype(np.float32))


def test_dead_reckoning_runs_ahead_at_the_measured_speed(recorded):
    folder, _ = recorded
    _, last = read_mcap(folder / "run.mcap")["/combine/odometry/odometry"][-1]
    assert last.header.frame_id == "combine/odom"
    assert last.pose.pose.position.x == pytest.approx(4.0)


def test_tracks_have_units_and_fifty_rows_a_second(recorded):
    import pyarrow.parquet as pq

    folder, samples = recorded
    tracks = read_tracks(folder / "tracks.parquet")
    states = {s.t: s for s in of_kind(samples, MachineState)}
    assert len(tracks["t_s"]) == 101
    assert set(tracks["machine"]) == {"combine"}
    np.testing.assert_array_equal(tracks["one"], 1.0)
    np.testing.assert_array_equal(tracks["v"], tracks["distance_m"])
    row = 37
    state = states[round(tracks["t_s"][row] * 1e9)]
    np.testing.assert_array_equal(
        [tracks["x_m"][row], tracks["y_m"][row], tracks["yaw_rad"][row]],
        [*state.pose.position[:2], state.pose.euler()[2]],
    )
    schema = pq.read_schema(folder / "tracks.parquet")
    for name in schema.names:
        assert schema.field(name).metadata[b"unit"], name
    assert schema.field("steer_rad").metadata[b"unit"] == b"rad"


def test_a_row_holds_what_was_published_in_its_own_tick(recorded):
    folder, samples = recorded
    tracks = read_tracks(folder / "tracks.parquet")
    edges = {t: o["edge"] for slot, t, o in samples if slot == "combine.edge"}
    at = np.round(tracks["t_s"] * 1e9).astype(int)
    same = np.isin(at, list(edges))
    assert same.sum() == 51
    np.testing.assert_array_equal(tracks["edge_offset_m"][same], [edges[t].offset for t in at[same]])
    np.testing.assert_array_equal(tracks["edge_t_s"][same], tracks["t_s"][same])


def test_many_beams_become_a_cloud():
    a = np.linspace(-1, 1, 32)
    ranges = np.ones((32, 1), dtype=np.float32)
    assert is_laser_scan(Scan(0, a, a, 0 * a, ranges, ranges))
    assert not is_laser_scan(Scan(0, a, a, 0 * a + 0.1, ranges, ranges))
    assert not is_laser_scan(Scan(0, a, a**3, 0 * a, ranges, ranges))


def test_no_topic_is_declared_that_is_never_sent(tmp_path):
    """Of a scanner of one line and one echo no cloud is announced, to a tap (ROS 2) neither."""
    declared = set()

    class Tap:
        def declare(self, topic, message, is_latched):
            declared.add(topic)

        def __call__(self, topic, t, data, build, is_latched):
            declared.add(topic)

    with Recorder(tmp_path, [machine()]) as recorder:
        recorder.file.taps.append(Tap())
        drive([recorder], GridField(ArcEdge()), seconds=1.0)
    log = open_log(tmp_path)
    sent = {topic for topic, _, _ in log.messages(log.topics())}
    assert set(log.topics()) == sent
    assert declared <= sent
    assert not [topic for topic in declared if topic.endswith("_points")]


def test_several_echoes_are_kept_in_a_cloud(tmp_path):
    a = np.linspace(-1, 1, 4)
    ranges = np.array([[1, 2], [3, np.nan], [np.nan, np.nan], [4, 5]], dtype=np.float32)
    with Recorder(tmp_path, [machine()]) as recorder:
        recorder("combine.lidar", 0, {"scan": Scan(0, a - 1, a, 0 * a, ranges, ranges / 10)})
    topics = read_mcap(tmp_path / "run.mcap")
    _, cloud = topics["/combine/lidar/scan_points"][0]
    kinds = [(n, "<f4") for n in ("x", "y", "z", "intensity", "time")]
    kinds += [("beam", "<u4"), ("ring", "<u2"), ("echo", "<u2")]
    table = np.frombuffer(bytes(cloud.data), dtype=np.dtype(kinds, align=True))
    assert cloud.point_step == 28
    assert [f.name for f in cloud.fields] == list(table.dtype.names)
    assert [(int(r["beam"]), int(r["echo"])) for r in table] == [(0, 0), (0, 1), (1, 0), (3, 0), (3, 1)]
    np.testing.assert_allclose(np.hypot(table["x"], table["y"]), [1, 2, 3, 4, 5], rtol=1e-6)
    np.testing.assert_allclose(table["intensity"], [0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-6)


def test_a_sample_of_a_user_is_recorded_by_its_fields(tmp_path):
    @dataclass(frozen=True)
    class Moisture(Signal):
        share: float
        profile: F64
        is_dry: bool

    assert definition(Moisture) == ("std_msgs/Header header\nfloat64 share\nfloat64[] profile\nbool is_dry\n")
    with Recorder(tmp_path, [machine()]) as recorder:
        recorder("combine.moisture", 3, {"moisture": Moisture(3, 0.14, np.arange(3.0), True)})
    [(t, message)] = read_mcap(tmp_path / "run.mcap")["/combine/moisture/moisture"]
    assert (t, message.share, list(message.profile), message.is_dry) == (3, 0.14, [0, 1, 2], True)


def test_an_exception_leaves_whole_files(tmp_path):
    ground = GridField(ArcEdge())

    def stop(slot, t, outputs):
        if t > 10**9:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), Recorder(tmp_path, [machine()]) as recorder:
        drive([recorder, stop], ground, seconds=3.0)
    assert len(read_mcap(tmp_path / "run.mcap")["/combine/lidar/scan"]) == 26
    assert read_tracks(tmp_path / "tracks.parquet")["t_s"][-1] == pytest.approx(1.0, abs=0.03)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["metadata.yaml", "run.mcap", "tracks.parquet"]


def test_an_interruption_within_a_chunk_costs_this_chunk_only(tmp_path, monkeypatch):
    ground, write, put = GridField(ArcEdge()), Container.flush, Container._put
    sizes = []

    def flush(self):
        sizes.append(len(self._open))
        write(self)

    def torn(self, record):
        if type(record).__name__ == "Chunk" and len(sizes) == 3:
            self._stream.write(struct.pack("<BQ", 6, 100_000) + b"half")
            raise KeyboardInterrupt
        return put(self, record)

    monkeypatch.setattr(Container, "flush", flush)
    monkeypatch.setattr(Container, "_put", torn)
    with pytest.raises(KeyboardInterrupt), Recorder(tmp_path, [machine()], detail="standard") as recorder:
        drive([recorder], ground, seconds=12.0)
    assert len(sizes) == 3
    assert read_until_torn(tmp_path / "run.mcap") == sizes[0] + sizes[1]
    assert (tmp_path / "tracks.parquet").exists()


def test_a_file_cut_anywhere_is_readable_up_to_its_last_whole_chunk(recorded, tmp_path):
    data = (recorded[0] / "run.mcap").read_bytes()
    whole = read_until_torn(recorded[0] / "run.mcap")
    counts = []
    for share in (0.3, 0.5, 0.7, 0.9, 1.0):
        part = tmp_path / f"{share}.mcap"
        part.write_bytes(data[: int(share * len(data))])
        counts.append(read_until_torn(part))
    assert counts[-1] == whole
    assert counts == sorted(counts)
    assert counts[3] > 0.3 * whole


def read_until_torn(path):
    from mcap.exceptions import EndOfFile
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    count = 0
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                count += isinstance(record, Message)
        except (EndOfFile, struct.error):  # torn between records, or within one's length
            pass
    return count


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs a signal that cannot be caught")
def test_a_killed_run_leaves_a_readable_file(tmp_path):
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from tests.fake_run import *\n"
        "from swath.record.recorder import Recorder\n"
        "def stop(slot, t, outputs):\n"
        "    if t > 3 * 10**9: os.kill(os.getpid(), signal.SIGKILL)\n"
        "drive([Recorder(Path(sys.argv[1]), [machine()]), stop], GridField(ArcEdge()), seconds=9.0)\n"
    )
    tests = str(Path(__file__).parents[2])
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([tests, *sys.path])}
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], env=env, check=False)
    assert done.returncode == -signal.SIGKILL
    assert read_until_torn(tmp_path / "run.mcap") > 100
    assert not (tmp_path / "tracks.parquet").exists()


def test_layers_of_a_scanner_become_rings_as_its_driver_numbers_them(tmp_path):
    """velodyne_pointcloud: `ring` counts from the lowest laser, UINT16; `time` and `intensity` FLOAT32."""
    elevation = np.radians(np.tile([15.0, -15.0, 1.0], 70_000))
    azimuth = np.linspace(-3, 3, len(elevation))
    ranges = np.full((len(elevation), 1), 10.0, dtype=np.float32)
    with Recorder(tmp_path, [machine()]) as recorder:
        scan = Scan(0, azimuth / 100 - 0.03, azimuth, elevation, ranges, ranges / 100)
        recorder("combine.lidar", 0, {"scan": scan})
    _, cloud = read_mcap(tmp_path / "run.mcap")["/combine/lidar/scan_points"][0]
    by_name = {f.name: (f.datatype, f.offset) for f in cloud.fields}
    assert {n: kind for n, (kind, _) in by_name.items()} == {
        **dict.fromkeys(("x", "y", "z", "intensity", "time"), 7),
        **dict.fromkeys(("ring", "echo"), 4),
        "beam": 6,
    }
    raw = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)
    ring = raw[:, by_name["ring"][1] :][:, :2].copy().view("<u2")[:, 0]
    beam = raw[:, by_name["beam"][1] :][:, :4].copy().view("<u4")[:, 0]
    np.testing.assert_array_equal(ring, np.tile([2, 0, 1], 70_000))
    np.testing.assert_array_equal(beam, np.arange(210_000))  # more than 16 bits
