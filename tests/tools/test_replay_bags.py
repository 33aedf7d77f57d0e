"""`swath height-map build` from real bags of ROS 1 and 2, with poses and with positions of a receiver."""

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.rays.height_grid import load_height_grid
from swath.record.read.files import open_log
from swath.tools.height_map.build import Settings, build_height_map, open_source
from swath.tools.height_map.poses import make_track
from swath.tools.height_map.source import Wanted
from tests.bags import BEGIN, KINDS, MOUNT, NS, PLANE, START, Bag, ranges_at, write_bag
from tests.foreign_bags import ANTENNA, WALL, cloud, drive, fix, heading_for_a_wall, tree
from tests.rays.height_rays import surface


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    return {k: write_bag(folder / ("drive.bag" if k == "rosbag1" else k), k) for k in KINDS}


def check(grid):
    """The wall at y = -1.3, 0.8 m high, on both sides of where the scanner looked."""
    x = np.linspace(10.0, 18.0, 33)
    assert np.allclose(surface(grid, x, np.full(33, -1.6), 0.5), 0.8, atol=0.03)
    assert np.allclose(surface(grid, x, np.full(33, -0.6), 0.5), 0.0, atol=0.03)
    assert np.allclose(grid.ground_height(x, 0 * x - 1.0), 0.0, atol=0.01)


@pytest.mark.parametrize(("kind", "topic"), [*((kind, "/scan") for kind in KINDS), ("rosbag1", "/points")])
def test_heights_from_a_bag(bags, kind, topic):
    source = open_source(bags[kind], Wanted(scans=topic, poses="/odom"))
    np.testing.assert_allclose(source.mounting.position, MOUNT.position)
    grid = build_height_map(source, Settings(reach_m=6.0))
    assert grid.about["scans"] == 251
    assert grid.about["notes"] == {}
    check(grid)


def test_heights_along_positions(bags):
    wanted = Wanted(scans="/scan", poses="/gps/fix", to_local=PLANE, antenna=(-1.2, 0.0, 3.9))
    source = open_source(bags["sqlite"], wanted)
    np.testing.assert_allclose(source.track.position[0], [*START, 0.0], atol=1e-4)
    assert source.track.length == pytest.approx(20.0, abs=0.01)
    check(build_height_map(source, Settings(reach_m=6.0)))


def test_on_the_command_line(bags, tmp_path, capsys):
    origin = f"--origin={PLANE.lat},{PLANE.lon},{PLANE.height}"
    args = ["--scans", "/scan", "--poses", "/gps/fix", origin, "--antenna=-1.2,0,3.9", "--reach-m", "6"]
    out = tmp_path / "h.npz"
    assert main(["height-map", "build", str(bags["rosbag1"]), "--out", str(out), *args]) == 0
    check(load_height_grid(out))
    capsys.readouterr()
    for more, text in (
        (["--origin", "1"], "--origin = 1: expected three numbers lat,lon[,height]"),
        (["--antenna", "1,2"], "--antenna = 1,2: expected three numbers x,y,z"),
        ([origin, "--field", str(tmp_path)], "expected --field or --origin, not both"),
        (["--field", str(tmp_path)], "field.yaml"),
    ):
        args = ["--scans", "/scan", "--poses", "/gps/fix", *more]
        assert main(["height-map", "build", str(bags["mcap"]), "--out", str(out), *args]) == 2
        assert text in capsys.readouterr().err


def test_a_receiver_that_stands_or_has_no_fix(tmp_path):
    for name, places, status, text in (
        ("stands", [(0.0, 0.0, 0.0)] * 9, 0, "expected a machine that moves"),
        ("blind", [(0.1 * k, 0.0, 0.0) for k in range(9)], -1, "at least two positions"),
    ):
        bag = Bag(tmp_path / name, "sqlite")
        bag.write("/tf_static", 0.0, bag.mounting())
        for k, place in enumerate(places):
            bag.write("/fix", 0.1 * k, bag.fix(0.1 * k, place, status=status))
            bag.write("/scan", 0.1 * k, bag.laser(0.1 * k, ranges_at(*START)))
        bag.close()
        with pytest.raises(InputError, match=text):
            open_source(tmp_path / name, Wanted())


UP, MAST = Pose.from_euler((0.3, 0.0, 0.6)), Pose.from_euler((-0.3, 0.0, 1.9))
LINKS = {  # of a scanner 2.5 m above the ground, over base_link, which is 0.6 m up and 0.3 m ahead
    "above": [("base_footprint", "base_link", UP), ("base_link", "laser", MAST)],
    "below": [("base_link", "base_footprint", UP.inverse()), ("base_link", "laser", MAST)],
}


def points_of(source):
    found = []
    for echoes in source.sweeps():
        place, rotation, known = source.track.at(echoes.time)
        mounting = echoes.mounting or source.mounting
        found.append((place + np.einsum("nij,nj->ni", rotation, mounting.apply(echoes.points)))[known])
    return np.concatenate(found)


def times(stamp, late):
    return [("time", "f4", late)]


@pytest.mark.parametrize(("name", "pose_z"), [("above", 0.6), ("below", 0.0)])
def test_poses_above_the_ground_are_brought_down(tmp_path, name, pose_z):
    """Of an odometry in the plane, and of one in space: the step is 1 m high and lies where it is."""
    path = heading_for_a_wall(tmp_path / "bag", times, links=LINKS[name], pose_z=pose_z)
    source = open_source(path, Wanted())
    np.testing.assert_allclose(source.mounting.position, (0.0, 0.0, 2.5), atol=1e-12)
    points = points_of(source)
    ground = source.track.position[:, 2].mean()
    assert ground == pytest.approx(pose_z - 0.6)
    assert (points[:, 2].min(), points[:, 2].max()) == pytest.approx((ground, ground + 1.0), abs=1e-5)
    on_wall = points[(points[:, 2] > ground + 0.05) & (points[:, 2] < ground + 0.95), 0]
    assert on_wall.max() == pytest.approx(WALL - 0.3, abs=1e-4)  # the poses are those of a point ahead
    assert on_wall.min() == pytest.approx(WALL - 0.3, abs=1e-4)
    grid = build_height_map(source, Settings(reach_m=6.0))
    assert [note for note in grid.about["notes"] if "brought down to base_footprint, 0.60 m" in note]
    assert not [note for note in grid.about["notes"] if "lowest echoes" in note]


def set_back(t):
    return t - 2.0 if t > 2.5 else t


CLOCKS = {  # stamps of poses and of sweeps -> what is said
    "computer set back": ((set_back, set_back), "set back by 2.00 s"),
    "poses set back": ((set_back, float), "odom (Odometry) was set back by 2.00 s"),
    "scanner in TAI": ((float, lambda t: t + 37.0), "37 s ahead: TAI"),
    "all in GPS time": ((lambda t: t + 18.0,) * 2, "18 s ahead: GPS time"),
    "recorded again": ((lambda t: t - 1e6,) * 2, "not on the clock of the log"),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_the_wall_stands_where_it_is_whatever_the_clocks(tmp_path, name):
    clocks, said = CLOCKS[name]
    absolute = lambda stamp, late: [("timestamp", "f8", stamp / NS + late)]  # noqa: E731
    source = open_source(heading_for_a_wall(tmp_path / "bag", absolute, clocks=clocks), Wanted())
    points = points_of(source)
    on_wall = points[(points[:, 2] > 0.05) & (points[:, 2] < 0.95), 0]
    assert len(on_wall) > 1000
    np.testing.assert_allclose(on_wall, WALL, atol=0.01)
    assert [note for note in source.notes if said in note]


def test_poses_of_the_scanner_and_two_scanners_on_a_topic(tmp_path):
    links = [("base_link", "laser", Pose.from_euler((3.0, 0.0, 2.5)))]
    path = heading_for_a_wall(tmp_path / "bag", times, links=links, child="laser", pose_z=2.5)
    source = open_source(path, Wanted())
    np.testing.assert_allclose(source.track.position[0], (-3.0, 0.0, 0.0), atol=1e-12)
    next(source.sweeps())
    assert any("laser brought down to base_link, 2.50 m below it and 3.00 m" in n for n in source.notes)
    two = Bag(tmp_path / "two", "mcap")
    two.write(
        "/tf_static", 0.0, tree(two, *links, ("laser", "rear", Pose.from_euler((-6.0, 0, 0), yaw=np.pi)))
    )
    for topic, t, message in open_log(path).messages(("/odom", "/points")):
        two.write(topic, (t - BEGIN) / NS, message)
        if topic == "/points":
            stamp = (t - BEGIN) / NS - 0.1
            two.write(topic, stamp + 0.11, cloud(two, stamp, np.array([[20.0, 3.0, 0.5]]), frame="rear"))
    two.close()
    points = points_of(open_source(tmp_path / "two", Wanted()))
    behind = points[points[:, 0] < -10.0]
    assert len(behind) > 30
    np.testing.assert_allclose(behind[:, 1:], [(-3.0, 3.0)] * len(behind), atol=1e-6)
    np.testing.assert_allclose(points[(points[:, 2] > 0.05) & (points[:, 2] < 0.95), 0], WALL, atol=0.01)


def test_poses_above_the_ground_are_seen_where_no_frame_says_so(tmp_path):
    links = [("base_link", "laser", Pose.from_euler((0.0, 0.0, 2.2)))]
    path = heading_for_a_wall(tmp_path / "bag", times, links=links)
    notes = build_height_map(open_source(path, Wanted()), Settings(reach_m=6.0)).about["notes"]
    assert [note for note in notes if "lowest echoes lie 0.3 m below the ground" in note]


def test_an_antenna_by_its_link(tmp_path):
    links = [("base_link", "laser", MOUNT), ("base_link", "gps", Pose.from_euler(ANTENNA))]
    path = drive(tmp_path / "drive", links=links, fixes=fix)
    bag = Bag(tmp_path / "bag", "mcap")
    for topic, t, message in open_log(path).messages(("/tf_static", "/fix")):
        bag.write(topic, (t - BEGIN) / NS, message)
    bag.write("/scan", 5.0, bag.laser(5.0, ranges_at(*START)))
    bag.close()
    source = open_source(tmp_path / "bag", Wanted(to_local=PLANE))
    np.testing.assert_allclose(source.track.position[0], [*START, 0.0], atol=1e-4)


def test_beams_beyond_the_last_pose_go_on_with_the_machine():
    track = make_track(np.arange(11) * 0.1, np.arange(11)[:, None] * (0.3, 0.0, 0.01), np.zeros((11, 3)))
    place, _, known = track.at(np.array([-0.2, -0.05, 0.55, 1.05, 1.2]))
    assert known.tolist() == [False, True, True, True, False]
    np.testing.assert_allclose(place[1:4, 0], (-0.15, 1.65, 3.15))
    np.testing.assert_allclose(place[1:4, 2], (-0.005, 0.055, 0.105))
