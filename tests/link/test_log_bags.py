"""Level `log` on real bags of ROS 1 and 2: what comes out, when, and how it ends."""

from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError, MissingExtra
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.link.levels.log import GeoOrigin, LogPlayer, Params
from swath.record.read.files import open_log
from swath.record.read.fixes import TangentPlane
from swath.scenario.slots import SLOTS
from swath.sensing.mount import Mount
from swath.signals import MachineState, Odometry, Scan, SpeedCommand, SteerCommand, SteerState
from swath.signals.setup import ControlSetup, LinkSetup
from tests.bags import (
    AZIMUTH,
    BEGIN,
    KINDS,
    MOUNT,
    NS,
    PLANE,
    SECONDS,
    SPEED,
    START,
    Bag,
    on_earth,
    place_at,
    ranges_at,
    write_bag,
)
from tests.fake_run import GEOMETRY


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    return {k: write_bag(folder / ("drive.bag" if k == "rosbag1" else k), k) for k in KINDS}


def player(path, slot, topics, *, rate_hz=50.0, **keys):
    kind = next(s for s in SLOTS if s.name == slot)
    control = ControlSetup(GEOMETRY, {"scan": Pose.identity()}, "left", 1.0 / rate_hz)
    setup = LinkSetup("combine", slot, (), kind.outputs, control, Path("/"))
    where = {"folder": str(path)} if path.is_dir() else {"file": str(path)}
    return LogPlayer(Params(**where, topics=topics, **keys), setup)


def play(part, seconds, rate_hz=50.0):
    """[(time [ns], outputs)] from t = 0 on, up to where the log ends the run."""
    period = round(NS / rate_hz)
    found = [(0, part.reset(Stream(1, "x")))]
    for k in range(int(seconds * rate_hz)):
        t = k * period
        if part.ends_at is not None and t + period >= part.ends_at:
            break
        found.append((t + period, part.step(t, period, {})))
    part.close()
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("topic", ["/scan", "/points"])
def test_scans(bags, kind, topic):
    part = player(bags[kind], "lidar", {"scan": topic}, rate_hz=25)
    assert [p.name for p in part.outputs] == ["scan"]
    np.testing.assert_allclose(part.mounting.position, MOUNT.position)
    np.testing.assert_allclose(part.mounting.rotation, MOUNT.rotation, atol=1e-12)
    played = play(part, 20.0, 25.0)
    scans = [(t, o["scan"]) for t, o in played if o]
    assert isinstance(scans[0][1], Scan)
    assert played[0][1]["scan"].t == 0  # the first scan came 6.5 ms later, it stands for the start
    assert len(scans) == 252  # all 251, and the first one twice
    for t, scan in scans[1::50]:
        begin = scan.t - 6_000_000  # sixty beams, 0.1 ms each
        assert 0 <= t - scan.t < 40_000_000 + 500_001
        assert begin % 40_000_000 == 0
        np.testing.assert_allclose(scan.ranges[:, 0], ranges_at(*place_at(begin / NS)), rtol=1e-6)
        np.testing.assert_allclose(scan.azimuth, AZIMUTH, atol=1e-6)
        np.testing.assert_allclose(scan.beam_t, 0.0001 * np.arange(-60, 1), atol=1e-9)
        np.testing.assert_allclose(scan.intensity, 128.0)
        np.testing.assert_allclose(scan.elevation, 0.0, atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_poses_speeds_and_angles(bags, kind):
    motion = play(player(bags[kind], "motion", {"state": "/odom"}), 20.0)
    assert len(motion) == 501
    for t, outputs in motion[::100]:
        state = outputs["state"]
        assert isinstance(state, MachineState)
        assert state.t == t
        np.testing.assert_allclose(state.pose.position, [*place_at(t / NS), 0.0], atol=1e-9)
        assert (state.speed, state.yaw_rate) == (SPEED, 0.0)
        assert state.distance == pytest.approx(SPEED * t / NS)
    twist = play(player(bags[kind], "odometry", {"odometry": "/speed"}), 20.0)
    sample = twist[50][1]["odometry"]
    assert isinstance(sample, Odometry)
    assert sample.speed == pytest.approx(1.6)
    assert np.tan(sample.steer_angle) == pytest.approx(GEOMETRY.wheelbase * 0.2 / 1.6)
    speed = play(player(bags[kind], "speed", {"command": "/drive"}), 1.0)
    assert speed[0][1]["command"] == SpeedCommand(0, 2.5)
    steering = play(player(bags[kind], "steering", {"steering": "/drive"}), 1.0)
    assert steering[0][1]["steering"] == SteerState(0, float(np.float32(0.1)), 0.0)
    steer = play(player(bags[kind], "steer", {"command": "/drive"}), 1.0)
    expected = np.tan(np.float32(0.1)) / GEOMETRY.wheelbase
    assert steer[0][1]["command"].curvature == pytest.approx(float(expected))


def test_number_by_number_with_another_unit(bags):
    topics = {"command.curvature": "/curvature:data"}
    known = {"command.is_engaged": True}
    part = player(bags["mcap"], "steer", topics, constants=known, scale={"command.curvature": 1e-3})
    assert not [note for note in part.notes if "`values`" in note]
    played = {t: o["command"] for t, o in play(part, 20.0) if o}
    assert played[2 * NS] == SteerCommand(2 * NS, pytest.approx(0.007), True)
    topics = {"odometry.speed": "/speed:twist.linear.x", "odometry.yaw_rate": "/odom:twist.twist.angular.z"}
    part = player(bags["mcap"], "odometry", topics, values={"odometry.steer_angle": 0.0})  # the older name
    assert [note for note in part.notes if "`values` is now `constants`" in note]
    played = {t: o["odometry"] for t, o in play(part, 3.0) if o}
    assert played[2 * NS].speed == pytest.approx(1.7)


def test_between_samples_the_old_one_or_a_line(bags):
    held = play(player(bags["mcap"], "odometry", {"odometry": "/speed"}), 1.0)
    assert [t for t, o in held if o] == [k * NS // 10 for k in range(11)]
    line = play(player(bags["mcap"], "odometry", {"odometry": "/speed"}, between="interpolate"), 1.0)
    assert all(o for _, o in line)
    for t, outputs in line:
        assert outputs["odometry"].speed == pytest.approx(1.5 + 0.1 * t / NS)
        assert outputs["odometry"].t == t


def test_the_end_of_the_log_is_the_end(bags):
    part = player(bags["sqlite"], "motion", {"state": "/odom"})
    played = play(part, 60.0)
    assert played[-1][0] == round(SECONDS * NS)
    assert part.ends_at == round((SECONDS + 0.02) * NS)
    assert part.ending == "the log of state ended at 10.00 s"
    sparse = player(bags["sqlite"], "motion", {"state": "/odom"}, end="log")
    assert play(sparse, 60.0)[-1][0] == round((SECONDS + 0.02) * NS)  # the last scan came 6.5 ms later


def test_a_start_within_the_log(bags):
    part = player(bags["rosbag1"], "motion", {"state": "/odom"}, start_s=4.0)
    played = play(part, 60.0)
    assert played[-1][0] == round(6.0 * NS)
    first, last = played[0][1]["state"], played[-1][1]["state"]
    np.testing.assert_allclose(first.pose.position[:2], place_at(4.0), atol=1e-9)
    assert first.distance == 0.0
    assert last.distance == pytest.approx(12.0)
    assert last.t == 6 * NS


def test_gaps_are_told(tmp_path):
    path = write_bag(tmp_path / "gap", "mcap", gap=(3.01, 5.0))
    part = player(path, "motion", {"state": "/odom"})
    played = play(part, 60.0)
    assert next(t for t, o in played if not o) == round(3.02 * NS)
    assert any("motion.state: lost: 1 gaps in the log, the longest 2.00 s at 3.00 s" in n for n in part.notes)
    quiet = player(path, "motion", {"state": "/odom"}, gap_s=3.0)
    play(quiet, 60.0)
    assert not any("gaps in the log" in n for n in quiet.notes)


def test_faster_than_the_slot_is_told(bags):
    part = player(bags["mcap"], "motion", {"state": "/odom"}, rate_hz=25.0)
    play(part, 20.0, 25.0)
    assert any("250 samples came faster than rate_hz" in n for n in part.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_positions_become_local_metres(bags, kind):
    """The course of a machine that drives straight east; the antenna sits 1.2 m behind the axle, 3.9 m up."""
    origin = GeoOrigin(PLANE.lat, PLANE.lon, PLANE.height)
    part = player(
        bags[kind],
        "motion",
        {"state": "/gps/fix"},
        origin=origin,
        antenna_m=(-1.2, 0.0, 3.9),
        between="interpolate",
    )
    played = play(part, 60.0)
    for t, outputs in played[10:-10:50]:
        state = outputs["state"]
        np.testing.assert_allclose(state.pose.position, [*place_at(t / NS), 0.0], atol=1e-4)
        assert state.pose.euler()[2] == pytest.approx(0.0, abs=1e-5)
        assert state.speed == pytest.approx(SPEED, abs=1e-4)
        assert state.distance == pytest.approx(SPEED * t / NS, abs=0.02)
    first = player(bags[kind], "motion", {"state": "/gps/fix"})
    np.testing.assert_allclose(first.reset(Stream(1, "x"))["state"].pose.position, 0.0, atol=1e-6)
    first.close()


def test_the_plane_agrees_with_proj():
    """Against PROJ's own topocentric conversion (EPSG method 9837), 3 km around the origin."""
    pyproj = pytest.importorskip("pyproj")
    chain = (
        f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={PLANE.lon} +lat_0={PLANE.lat} +h_0={PLANE.height}"
    )
    rng = np.random.default_rng(1)
    lon, lat = PLANE.lon + rng.uniform(-0.04, 0.04, 50), PLANE.lat + rng.uniform(-0.027, 0.027, 50)
    points = np.column_stack([lon, lat, rng.uniform(400, 600, 50)])
    theirs = np.column_stack(pyproj.Transformer.from_pipeline(chain).transform(*points.T))
    np.testing.assert_allclose(PLANE(points), theirs, atol=1e-6)
    np.testing.assert_allclose(PLANE(on_earth(theirs)), theirs, atol=1e-6)
    assert np.abs(theirs[:, :2]).max() > 2000


def test_the_metres_of_a_field_folder(bags, tmp_path):
    pytest.importorskip("pyproj")
    from swath.field.maps.projection import transform, utm_epsg

    epsg = utm_epsg(PLANE.lon, PLANE.lat)
    corner = transform([[PLANE.lon, PLANE.lat]], "EPSG:4326", f"EPSG:{epsg}")[0]
    (tmp_path / "field.yaml").write_text(
        f"format: swath field\nversion: 1\ncrs: EPSG:{epsg}\norigin: {{easting_m: {corner[0]}, northing_m: "
        f"{corner[1]}, height_m: 500}}\n"
    )
    try:
        part = player(
            bags["mcap"],
            "motion",
            {"state": "/gps/fix"},
            field_folder=str(tmp_path),
            antenna_m=(-1.2, 0, 3.9),
        )
    except MissingExtra:
        pytest.skip("needs swath[geo]")
    states = [o["state"] for _, o in play(part, 60.0) if o]
    start, end = states[10], states[-1]
    # UTM shrinks, and turns: 2.5 degrees of longitude east of the middle of zone 32 the meridian leans left
    length = np.hypot(*(end.pose.position - start.pose.position)[:2])
    assert length == pytest.approx(SPEED * (end.t - start.t) / NS, rel=1e-3)
    turn = 2.5 * np.sin(np.radians(PLANE.lat))
    assert np.degrees(end.pose.euler()[2]) == pytest.approx(turn, abs=0.01)
    assert end.pose.position[2] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("slot", "topics", "keys", "text"),
    [
        ("lidar", {}, {}, "expected topics for scan, truth, the recording has no combine.lidar; it has"),
        ("lidar", {"scan": "/scans"}, {}, "topics = /scans: expected one of"),
        ("lidar", {"scan": "/odom"}, {}, r"expected a topic of LaserScan, PointCloud2, swath_msgs/Scan"),
        ("lidar", {"picture": "/scan"}, {}, "expected output or output.number; outputs: scan, truth"),
        ("lidar", {"scan": "/scan"}, {"between": "interpolate"}, "expected hold, the beam_t, azimuth"),
        ("lidar", {"scan": "/scan"}, {"scale": {"scan.loudness": 2.0}}, "scale = scan.loudness"),
        ("steer", {"command.curvature": "/curvature"}, {}, "expected topics or constants for is_engaged too"),
        ("steer", {"command.bend": "/curvature"}, {}, "expected one of curvature, is_engaged after command."),
        (
            "steer",
            {"command.curvature": "/odom:pose.nothing"},
            {"values": {"command.is_engaged": 1.0}},
            "expected a number at 'pose.nothing' of nav_msgs/msg/Odometry",
        ),
        ("motion", {"state": "/odom"}, {"start_s": 30.0}, "start_s = 30.0: expected a start before"),
    ],
)
def test_what_does_not_fit_is_said(bags, slot, topics, keys, text):
    with pytest.raises(InputError) as caught:
        player(bags["mcap"], slot, topics, **keys)
    assert text in str(caught.value)


def test_a_first_message_that_comes_late_is_said(tmp_path):
    path = write_bag(tmp_path / "late", "sqlite", gap=(-1.0, 3.0))
    with pytest.raises(
        InputError, match=r"expected a first message on /odom near the start, it comes 3\.00 s on"
    ):
        player(path, "motion", {"state": "/odom"})
    assert player(path, "motion", {"state": "/odom"}, start_s=3.0).notes


def test_a_scan_without_a_mounting(tmp_path):
    from tests.bags import Bag

    bag = Bag(tmp_path / "bare", "mcap")
    for k in range(5):
        bag.write("/scan", 0.04 * k, bag.laser(0.04 * k, ranges_at(*START)))
    bag.close()
    with pytest.raises(InputError, match="mount: expected where the sensor sits"):
        player(tmp_path / "bare", "lidar", {"scan": "/scan"})
    mount = Mount(at="axle", x_m=1.0, z_m=2.0, pitch_deg=30.0)
    part = player(
        tmp_path / "bare", "lidar", {"scan": "/scan"}, mount=mount, scale={"scan.intensity": 1 / 128}
    )
    np.testing.assert_allclose(part.mounting.position, MOUNT.position)
    scan = part.reset(Stream(1, "x"))["scan"]
    np.testing.assert_allclose(scan.intensity, 1.0)
    assert scan.intensity.dtype == np.float32
    part.close()


def test_one_of_file_and_folder(bags):
    kind = next(s for s in SLOTS if s.name == "motion")
    control = ControlSetup(GEOMETRY, {"scan": Pose.identity()}, "left", 0.02)
    setup = LinkSetup("combine", "motion", (), kind.outputs, control, Path("/"))
    for keys in ({}, {"file": "a", "folder": "b"}):
        with pytest.raises(InputError, match="expected either file or folder"):
            LogPlayer(Params(**keys), setup)


def test_a_plain_storage_file_and_a_folder_without_metadata(bags, tmp_path):
    [db3] = bags["sqlite"].glob("*.db3")
    assert len(play(player(db3, "motion", {"state": "/odom"}), 20.0)) == 501
    [inner] = bags["mcap"].glob("*.mcap")
    (tmp_path / "killed").mkdir()
    whole = inner.read_bytes()
    (tmp_path / "killed" / "x_0.mcap").write_bytes(whole[: len(whole) * 2 // 3])  # as ros2 bag leaves it
    part = player(tmp_path / "killed", "motion", {"state": "/odom"})
    played = play(part, 20.0)
    assert 10 < len(played) < 501
    assert any("recording broke off after" in n for n in part.notes)


@pytest.mark.parametrize("topics", [{"gnss": {"fix": "/fix"}}, {"motion": {"state": "/fix"}}])
@pytest.mark.parametrize("far", [0.0, 1850.0])
def test_positions_out_of_reach_are_told_and_played_as_they_are(tmp_path, topics, far):
    bag = Bag(tmp_path / "drive.bag", "rosbag1")
    for k in range(60):
        bag.write("/fix", 0.2 * k, bag.fix(0.2 * k, (0.4 * k, far * (k % 10 == 5), 3.9)))
    bag.close()
    ((slot, of_slot),) = topics.items()
    part = player(tmp_path / "drive.bag", slot, of_slot, rate_hz=5.0)
    played = [next(iter(outputs.values())) for _, outputs in play(part, 15.0, 5.0) if outputs]
    side = [s.y if slot == "gnss" else s.pose.position[1] for s in played]
    assert np.ptp(side) == pytest.approx(far, rel=1e-3, abs=0.01)
    told = [note for note in part.notes if "place: positions that lie" in note]
    assert [note.rpartition("(")[2] for note in told] == (["6)"] if far else [])


def test_begin_and_end_of_a_bag(bags):
    for kind in KINDS:
        log = open_log(bags[kind])
        assert log.begin() == BEGIN
        assert log.end() == BEGIN + round(10.0065 * NS)
    assert TangentPlane(0.0, 0.0)(np.array([[0.0, 0.0, 5.0]])).tolist() == [[0.0, 0.0, 5.0]]
