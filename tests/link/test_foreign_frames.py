"""Level `log` on recordings in other frames, units and datums: the true value, a note, or a refusal that says
what to state."""

from math import isnan, tan
from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.units import DEG
from swath.link.levels.log import GeoOrigin, LogPlayer, Params
from swath.record.read.files import open_log
from swath.record.read.frames import ground_frame, pose_between, static_links, static_mounting
from swath.record.read.motion import steer_angle
from swath.scenario.slots import SLOTS
from swath.sensing.mount import Mount
from swath.signals import FIX_QUALITIES
from swath.signals.setup import ControlSetup, LinkSetup
from tests.bags import KINDS, NS, PLANE, SPEED, START, Bag
from tests.fake_run import GEOMETRY
from tests.foreign_bags import ANTENNA, GRAVITY, drive, fix, imu, tree

ORIGIN = GeoOrigin(PLANE.lat, PLANE.lon, PLANE.height)


def flat(x, y):
    return np.zeros(len(x))


def player(path, slot, topics, *, ground=flat, **keys):
    kind = next(s for s in SLOTS if s.name == slot)
    control = ControlSetup(GEOMETRY, {}, "left", 0.02)
    setup = LinkSetup("combine", slot, (), kind.outputs, control, Path("/"), ground=ground)
    return LogPlayer(Params(folder=str(path), topics=topics, **keys), setup)


def outputs(part, seconds):
    """Samples of the only output."""
    found = [part.reset(Stream(1, "x"))]
    found += [part.step(k * NS // 50, NS // 50, {}) for k in range(round(seconds * 50))]
    part.close()
    return [sample for out in found for sample in out.values()]


OVER = Pose.from_euler((0.0, 0.0, 1.0), roll=180 * DEG)
FORCES = {
    "as REP 145": ((0.0, 0.0, GRAVITY), None, ""),
    "side slope of 10 %": ((0.0, GRAVITY * 0.0995, GRAVITY * 0.995), None, ""),
    "NED": ((0.0, 0.0, -9.6), None, "z down, as in NED.*roll_deg: 180"),
    "on a slope, NED": ((-1.2, 0.9, -9.6), None, "roll_deg: 180"),
    "x up": ((9.75, 0.1, 0.3), None, "x up.*pitch_deg: -90"),
    "y down": ((0.1, -9.75, 0.3), None, "y down.*roll_deg: -90"),
    "aslant": ((5.7, 5.7, -5.6), None, "aslant"),
    "in g": ((0.0, 0.01, 1.0), None, "in g: `scale"),
    "without gravity": ((0.02, 0.0, 0.1), None, "gravity is left out"),
    "in cm/s2": ((0.0, 0.0, 981.0), None, "another unit"),
    "NED, as its link says": ((0.0, 0.0, -9.6), OVER, ""),
    "not as its link says": ((0.0, 0.0, 9.8), OVER, "z up, but turned"),
}


@pytest.mark.parametrize("name", FORCES)
def test_gravity_tells_the_axes_of_an_inertial_unit(tmp_path, name):
    force, link, said = FORCES[name]
    shaking = np.random.default_rng(3).normal(0.0, 0.2 * np.abs(force).max(), (201, 3))
    links = [] if link is None else [("base_link", "imu", link)]
    path = drive(
        tmp_path / "bag", links=links, seconds=2.0, force=lambda t: np.add(force, shaking[round(100 * t)])
    )
    if not said:
        assert len(outputs(player(path, "imu", {"inertial": "/imu"}), 1.0)) > 40
        return
    with pytest.raises(InputError, match=said) as caught:
        player(path, "imu", {"inertial": "/imu"})
    assert "..." not in str(caught.value)


@pytest.mark.parametrize(
    ("force", "mount"),
    [
        ((0.0, 0.0, -9.8), Mount("axle", roll_deg=180.0, pitch_deg=0.0)),
        ((9.8, 0.0, 0.0), Mount("axle", pitch_deg=-90.0)),
        ((-9.8, 0.0, 0.0), Mount("axle", pitch_deg=90.0)),
        ((0.0, 9.8, 0.0), Mount("axle", roll_deg=90.0, pitch_deg=0.0)),
        ((0.0, -9.8, 0.0), Mount("axle", roll_deg=-90.0, pitch_deg=0.0)),
    ],
)
def test_what_the_refusal_says_makes_it_upright(tmp_path, force, mount):
    path = drive(tmp_path / "bag", seconds=2.0, force=lambda t: force)
    with pytest.raises(InputError, match=f"deg: {mount.roll_deg or mount.pitch_deg:g}"):
        player(path, "imu", {"inertial": "/imu"})
    part = player(path, "imu", {"inertial": "/imu"}, mount=mount)
    np.testing.assert_allclose(part.mounting.turn([force])[0], (0.0, 0.0, 9.8), atol=1e-9)


LIFTS = {"ellipsoid": 46.6, "geoid": -31.2, "right": 0.0, "within its errors": 0.3}


@pytest.mark.parametrize("name", LIFTS)
def test_heights_of_another_datum_are_taken_off_and_said(tmp_path, name):
    """True: the machine stands on the ground, on a field that rises 2 % eastward."""
    lift = LIFTS[name]
    rising = lambda x, y: 0.02 * x  # noqa: E731

    def fixes(bag, t, place):
        return fix(bag, t, (*place[:2], 0.02 * (place[0] - ANTENNA[0]) + ANTENNA[2]), lift=lift)

    def odometry(bag, t):
        x = START[0] + SPEED * t
        return bag.odometry(t, Pose.from_euler((x, START[1], 0.02 * x + lift)), SPEED, 0.0)

    path = drive(tmp_path / "bag", seconds=6.0, fixes=fixes, odometry=odometry)
    for topic, keys in (("/fix", {"antenna_m": ANTENNA, "origin": ORIGIN}), ("/odom", {})):
        part = player(path, "motion", {"state": topic}, ground=rising, **keys)
        said = [note for note in part.notes if "the terrain" in note]
        state = outputs(part, 5.0)[-1]
        off = state.pose.position[2] - 0.02 * state.pose.position[0]
        assert abs(off) <= (0.05 if abs(lift) > 0.5 else abs(lift) + 0.05)
        assert bool(said) == (abs(lift) > 0.5)
        if said:
            assert f"{abs(lift):.1f} m {'above' if lift > 0 else 'below'} the terrain" in said[0]


def test_an_antenna_that_nobody_gave_is_seen_in_the_heights(tmp_path):
    path = drive(tmp_path / "bag", fixes=fix)
    part = player(path, "motion", {"state": "/fix"}, origin=ORIGIN)
    assert any("3.9 m above the terrain" in note for note in part.notes)
    assert outputs(part, 3.0)[-1].pose.position[2] == pytest.approx(0.0, abs=0.01)


def test_a_track_of_another_field_is_put_on_the_terrain(tmp_path):
    hilly = lambda x, y: 3.0 * np.sin(0.2 * x)  # noqa: E731
    part = player(drive(tmp_path / "bag"), "motion", {"state": "/odom"}, ground=hilly)
    assert any("put on the terrain" in note for note in part.notes)
    for state in outputs(part, 9.0)[::100]:
        x, _, z = state.pose.position
        assert z == pytest.approx(3.0 * np.sin(0.2 * x))


def test_fixes_far_above_the_antennas_place_are_said(tmp_path):
    path = drive(
        tmp_path / "bag",
        fixes=lambda bag, t, place: fix(bag, t, place, variances=(1e-4, 1e-4, 4e-4), lift=46.6),
    )
    part = player(path, "gnss", {"fix": "/fix"}, antenna_m=ANTENNA, origin=ORIGIN)
    assert any("46.6 m above the terrain" in note for note in part.notes)
    assert outputs(part, 1.0)[-1].z == pytest.approx(50.5, abs=0.01)  # what was measured stays


SPREADS = {  # status, variances, type of covariance -> quality, horizontal and vertical sd
    "UM980: status 2, nothing said": (2, None, 0, "dgps", np.nan, np.nan),
    "zeros of a known type": (2, (0.0, 0.0, 0.0), 2, "dgps", np.nan, np.nan),
    "u-blox: status 0, 1 cm": (0, (1e-4, 1e-4, 4e-4), 2, "fix", 0.01, 0.02),
    "u-blox: status 0, 2 m": (0, (4.0, 4.0, 9.0), 2, "single", 2.0, 3.0),
    "status 2, 20 cm": (2, (0.04, 0.04, 0.09), 2, "float", 0.2, 0.3),
    "status 1, 80 cm": (1, (0.64, 0.64, 1.0), 1, "dgps", 0.8, 1.0),
    "status 0, nothing said": (0, None, 0, "single", np.nan, np.nan),
    "horizontal alone": (2, (1e-4, 1e-4, 0.0), 2, "fix", 0.01, np.nan),
    "variances of an unknown type": (2, (1e-4, 1e-4, 1e-4), 0, "dgps", np.nan, np.nan),
    "negative": (1, (-1.0, -1.0, -1.0), 2, "dgps", np.nan, np.nan),
    "nan": (2, (np.nan, np.nan, np.nan), 2, "dgps", np.nan, np.nan),
    "no fix": (-1, (1e-4, 1e-4, 1e-4), 2, "none", np.nan, np.nan),
    "a status of a later version": (3, None, 0, "dgps", np.nan, np.nan),
}


@pytest.mark.parametrize("name", SPREADS)
def test_what_a_fix_does_not_know_stays_unknown(tmp_path, name):
    status, variances, kind, quality, wide, high = SPREADS[name]
    path = drive(
        tmp_path / "bag",
        seconds=2.0,
        fixes=lambda bag, t, place: fix(bag, t, place, status=status, variances=variances, kind=kind),
    )
    part = player(path, "gnss", {"fix": "/fix"}, antenna_m=ANTENNA, origin=ORIGIN)
    made = outputs(part, 1.0)[-1]
    assert FIX_QUALITIES[made.quality] == quality
    np.testing.assert_allclose((made.horizontal_sd, made.vertical_sd), (wide, high))
    said = any("without their accuracy" in note for note in part.notes)
    assert said == (isnan(wide) and quality != "none")


@pytest.mark.parametrize("speed", [2.0, -2.0])
@pytest.mark.parametrize("yaw_rate", [0.1, -0.3])
def test_the_angle_of_wheels_from_speed_and_yaw_rate(speed, yaw_rate):
    """tan(angle) = wheelbase times curvature, also in reverse."""
    assert tan(steer_angle(3.8, speed, yaw_rate)) == pytest.approx(3.8 * yaw_rate / speed)
    assert isnan(steer_angle(3.8, 0.0, yaw_rate))


def test_an_odometry_of_zeros_is_no_rtk(tmp_path):
    part = player(drive(tmp_path / "bag"), "gnss", {"fix": "/odom"}, antenna_m=ANTENNA)
    made = outputs(part, 1.0)[-1]
    assert FIX_QUALITIES[made.quality] == "single"
    assert isnan(made.horizontal_sd)
    assert isnan(made.speed_sd)
    assert isnan(made.course)
    assert any("without their accuracy" in note for note in part.notes)


def test_an_inertial_unit_that_does_not_know_its_noise(tmp_path):
    part = player(drive(tmp_path / "bag", force=lambda t: (0, 0, GRAVITY)), "imu", {"inertial": "/imu"})
    assert isnan(outputs(part, 0.5)[-1].rate_sd)


UP, ASIDE = Pose.from_euler((0.0, 0.0, 0.6)), Pose.from_euler((0.0, 0.0, 2.0), pitch=0.2)
TREES = {  # links (parent, child, pose) -> frame of the machine, height of the laser in it [m]
    "footprint above": (
        [("base_footprint", "base_link", UP), ("base_link", "laser", ASIDE)],
        "base_footprint",
        2.6,
    ),
    "footprint below": (
        [("base_link", "base_footprint", UP.inverse()), ("base_link", "laser", ASIDE)],
        "base_footprint",
        2.6,
    ),
    "none": ([("base_link", "laser", ASIDE)], "base_link", 2.0),
    "over a mast": (
        [("base_footprint", "base_link", UP), ("base_link", "mast", UP), ("mast", "laser", ASIDE)],
        "base_footprint",
        3.2,
    ),
    "below odom": (
        [("odom", "base_footprint", UP), ("base_footprint", "base_link", UP), ("base_link", "laser", ASIDE)],
        "base_footprint",
        2.6,
    ),
    "of a robot": (
        [("r1/base_footprint", "r1/base_link", UP), ("r1/base_link", "laser", ASIDE)],
        "r1/base_footprint",
        2.6,
    ),
    "two robots": (
        [
            ("map", "r2/base_footprint", UP), ("map", "r1/base_footprint", UP),
            ("r1/base_footprint", "r1/base_link", UP), ("r1/base_link", "laser", ASIDE),
        ],
        "r1/base_footprint",
        2.6,
    ),
    "turned": (
        [
            ("base_footprint", "base_link", Pose.from_euler((0, 0, 0.6), yaw=1.0)),
            ("base_link", "laser", ASIDE),
        ],
        "base_footprint",
        2.6,
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "kind"),
    [*((name, "mcap") for name in TREES), *(("over a mast", kind) for kind in KINDS if kind != "mcap")],
)
def test_a_sensor_sits_over_the_frame_on_the_ground(tmp_path, name, kind):
    links, ground, height = TREES[name]
    path = tmp_path / ("bag.bag" if kind == "rosbag1" else "bag")
    bag = Bag(path, kind)
    bag.write("/tf_static", 0.0, tree(bag, *links[:1]))
    bag.write("/tf_static", 0.1, tree(bag, *links[1:]))
    bag.write("/scan", 0.2, bag.laser(0.2, np.full(61, 5.0, np.float32)))
    bag.close()
    found, first = static_links(open_log(path), "/scan")
    assert first.header.frame_id == "laser"
    named, pose = static_mounting(found, "laser", "combine")
    assert named == ground
    assert pose.position[2] == pytest.approx(height)
    assert pose.euler()[1] == pytest.approx(0.2)


def test_frames_that_nothing_leads_to():
    links = {"laser": ("base_link", ASIDE), "a": ("b", UP), "b": ("a", UP)}
    assert pose_between(links, "base_footprint", "laser") is None
    assert ground_frame(links, "a") is None
    assert static_mounting(links, "camera", "combine") is None
    twins = {"x/base_link": ("map", UP), "y/base_link": ("map", UP), "laser": ("map", UP)}
    assert ground_frame(twins, "laser") is None  # of which, nobody says
    assert ground_frame(twins, "laser", "y") == "y/base_link"


def test_a_scanner_above_base_link(tmp_path):
    """The player's mounting is that above ground, and a note says by which frame."""
    bag = Bag(tmp_path / "bag", "mcap")
    bag.write("/tf_static", 0.0, tree(bag, *TREES["footprint above"][0]))
    for k in range(10):
        bag.write("/scan", 0.1 * k, bag.laser(0.1 * k, np.full(61, 5.0, np.float32)))
    bag.close()
    part = player(tmp_path / "bag", "lidar", {"scan": "/scan"})
    np.testing.assert_allclose(part.mounting.position, (0.0, 0.0, 2.6))
    assert any("2.60 m in base_footprint by /tf_static" in note for note in part.notes)


def test_an_antenna_by_its_link(tmp_path):
    links = [("base_footprint", "base_link", UP), ("base_link", "gps", Pose.from_euler((-1.2, 0.0, 3.3)))]
    path = drive(tmp_path / "bag", links=links, fixes=fix)
    part = player(path, "gnss", {"fix": "/fix"}, origin=ORIGIN)
    np.testing.assert_allclose(part.mounting.position, ANTENNA)
    state = outputs(player(path, "motion", {"state": "/fix"}, origin=ORIGIN), 2.0)[-1]
    np.testing.assert_allclose(state.pose.position, (START[0] + SPEED * 2.0, START[1], 0.0), atol=0.01)


def test_a_place_is_said_once(tmp_path):
    path = drive(tmp_path / "bag", fixes=fix)
    with pytest.raises(InputError, match="mount or antenna_m, not both"):
        player(path, "gnss", {"fix": "/fix"}, antenna_m=ANTENNA, mount=Mount("axle"))


def test_stamps_on_another_clock_are_said(tmp_path):
    def old(bag, t):
        message = bag.odometry(t, Pose.identity(), SPEED, 0.0)
        message.header.stamp.sec -= 86_400
        return message

    path = drive(tmp_path / "bag", odometry=old)
    part = player(path, "odometry", {"odometry": "/odom"})
    outputs(part, 1.0)
    assert any("not on the clock of the log" in note for note in part.notes)


def test_a_list_of_topics_begins_with_the_likely_ones(tmp_path):
    bag = Bag(tmp_path / "bag", "mcap")
    for k in range(40):
        bag.write(f"/sick_lms_1xx/some_number_{k}", 0.0, bag.make("std_msgs/Float64", data=1.0))
    bag.write("/sick_lms_1xx/scan", 0.1, bag.laser(0.1, np.full(61, 5.0, np.float32)))
    bag.close()
    for topics in ({}, {"scan": "/scan"}):
        with pytest.raises(InputError, match=r"/sick_lms_1xx/scan.* and \d\d more") as caught:
            player(tmp_path / "bag", "lidar", topics, mount=Mount("axle"))
        assert "..." not in str(caught.value).partition(" (/")[0]
        assert len(str(caught.value)) <= 300


def test_odometry_of_a_unit_that_sits_elsewhere_and_looks_back(tmp_path):
    """True: the machine turns on a circle of 10 m around (0, 10) at 2 m/s, from the origin eastward."""
    unit = Pose.from_euler((3.0, 0.5, 2.5), yaw=np.pi)
    rate = 0.2

    def odometry(bag, t):
        at = Pose.from_euler((10 * np.sin(rate * t), 10 - 10 * np.cos(rate * t), 0.0), yaw=rate * t)
        made = bag.odometry(t, at @ unit, 0.0, rate)
        velocity = unit.rotation.T @ (np.array([2.0, 0.0, 0.0]) + np.cross((0, 0, rate), unit.position))
        made.twist.twist.linear.x, made.twist.twist.linear.y = velocity[:2]
        made.child_frame_id = "unit"
        return made

    path = drive(tmp_path / "bag", links=[("base_link", "unit", unit)], odometry=odometry)
    part = player(path, "motion", {"state": "/odom"})
    state = outputs(part, 5.0)[-1]
    np.testing.assert_allclose(state.pose.position, (10 * np.sin(1.0), 10 - 10 * np.cos(1.0), 0.0), atol=1e-6)
    assert state.pose.euler()[2] == pytest.approx(1.0)
    assert (state.speed, state.lateral_speed, state.yaw_rate) == pytest.approx((2.0, 0.0, rate), abs=1e-9)
    assert any("poses of unit brought down to base_link, 2.50 m below it" in note for note in part.notes)
    assert not any("the terrain" in note for note in part.notes)
    made = outputs(player(path, "odometry", {"odometry": "/odom"}), 1.0)[-1]
    assert made.speed == pytest.approx(2.0)


def test_one_scanner_of_a_topic_is_played(tmp_path):
    bag = Bag(tmp_path / "bag", "mcap")
    bag.write("/tf_static", 0.0, tree(bag, ("base_link", "laser", UP), ("base_link", "rear", ASIDE)))
    for k in range(20):
        message = bag.laser(0.1 * k, np.full(61, 5.0 if k % 2 == 0 else 7.0, np.float32))
        message.header.frame_id = "rear" if k % 2 else "laser"
        bag.write("/scan", 0.1 * k, message)
    bag.close()
    for keys, far, height in (({}, 5.0, 0.6), ({"frame": "rear"}, 7.0, 2.0)):
        part = player(tmp_path / "bag", "lidar", {"scan": "/scan"}, **keys)
        assert part.mounting.position[2] == pytest.approx(height)
        assert {float(scan.ranges[0, 0]) for scan in outputs(part, 1.5)} == {far}
        assert any("`frame: " in note for note in part.notes)
    with pytest.raises(InputError, match="messages of frame roof in the recording"):
        player(tmp_path / "bag", "lidar", {"scan": "/scan"}, frame="roof", mount=Mount("axle", pitch_deg=0.0))


def winding(path, scale, *, has_track=True, seconds=7.0):
    """A machine at 2 m/s that winds left and right by half a radian; scale: of what its unit says."""
    bag = Bag(path, "mcap")
    for k in range(round(seconds * 50)):
        t = 0.02 * k
        if has_track:
            made = bag.odometry(t, Pose.from_euler((2.0 * t, 0.0, 0.0), yaw=0.5 * np.sin(t)), 2.0, 0.0)
            bag.write("/odom", t, made)
        bag.write("/imu", t, imu(bag, t, (0.0, 0.0, GRAVITY), (0.0, 0.0, scale * 0.5 * np.cos(t))))
    bag.close()
    return path


RATES = {  # scale, with a track -> what is said, whether it is refused
    "rad/s": (1.0, True, "", False),
    "deg/s": (1.0 / DEG, True, "57.3 times .*in deg/s: .*inertial.rate_z: 0.017453", True),
    "deg/s, alone": (1.0 / DEG, False, "rad/s: .*in deg/s, .*inertial.rate_z: 0.017453", True),
    "rad/s, alone": (1.0, False, "", False),
    "15 % off": (1.15, True, "1.15 times those of the positions", False),
    "z down": (-1.0, True, "", False),  # no turn of this machine: what gravity says counts
    "half": (0.4, True, "0.4 times .*`scale`", True),
}


@pytest.mark.parametrize("name", RATES)
def test_turns_of_an_inertial_unit_are_those_of_the_track(tmp_path, name):
    scale, has_track, said, is_refused = RATES[name]
    path = winding(tmp_path / "bag", scale, has_track=has_track)
    if not is_refused:
        part = player(path, "imu", {"inertial": "/imu"})
        assert bool(said) == any("times those of the positions" in note for note in part.notes)
        assert any(said in note for note in part.notes)
        return
    with pytest.raises(InputError, match=said):
        player(path, "imu", {"inertial": "/imu"})
    cure = {f"inertial.rate_{n}": 1.0 / scale for n in "xyz"}
    part = player(path, "imu", {"inertial": "/imu"}, scale=cure)
    assert outputs(part, 1.0)[-1].rate_z == pytest.approx(0.5 * np.cos(1.0), abs=0.02)


def test_commands_of_two_senders_are_played_and_a_blank_frame_is_no_other(tmp_path):
    """Frames part sensors and machines, not senders."""
    bag = Bag(tmp_path / "bag", "mcap")
    for k in range(40):
        command = bag.make(
            "geometry_msgs/TwistStamped",
            header=bag.header(0.02 * k, ("teleop", "planner")[k % 2]),
            twist=bag.twist(1.0 + k % 2, 0.0),
        )
        bag.write("/cmd", 0.02 * k, command)
        bag.write(
            "/imu", 0.02 * k, imu(bag, 0.02 * k, (0, 0, GRAVITY), (0, 0, 0.1 * (k > 0)), "imu" * (k > 4))
        )
    bag.close()
    found = outputs(player(tmp_path / "bag", "speed", {"command": "/cmd"}), 0.5)
    assert {sample.speed for sample in found} == {1.0, 2.0}
    part = player(tmp_path / "bag", "imu", {"inertial": "/imu"})
    assert outputs(part, 0.5)[-1].rate_z == pytest.approx(0.1)
    assert not any("left out" in note for note in part.notes)
