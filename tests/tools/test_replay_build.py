"""From measured scans to a grid: sources, cells, ground, files; and the real scans of a vineyard."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.units import DEG
from swath.rays.height_grid import DEEP, EVEN, LEVELS, NONE, THICK, load_height_grid
from swath.rays.heights import MEASURED, UNMEASURED, HeightCaster
from swath.record.mcap_file import McapFile
from swath.record.read.mcap_log import CUT_OFF
from swath.tools.height_map.build import Settings, build_height_map, open_source
from swath.tools.height_map.gather import Gatherer, Samples, pool
from swath.tools.height_map.ground import around, grown
from swath.tools.height_map.passing import Passing, thicknesses
from swath.tools.height_map.poses import PoseTrack, make_track
from swath.tools.height_map.source import Wanted
from tests.rays.height_rays import cast_heights, cells_at, surface
from tests.shared_data import DATA

VINEYARD = DATA / "lms200_vineyard_protolidar" / "lms200_scans.npz"
MOUNT = Pose.from_euler((1.0, 0.0, 2.0), pitch=30 * DEG)
MOUNT_TEXT = "1,0,2,0,30,0"
SCANS, BEAMS = 60, 61
AZIMUTH = np.linspace(-30, 30, BEAMS)


def made_scans():
    """Ranges of a scanner that drives along x past a step at y = 0: 0.8 m high to its right, else bare.

    The wall is seen by the beams that meet it below its top.
    """
    x = 0.1 * np.arange(SCANS)
    a = AZIMUTH * DEG
    d = MOUNT.turn(np.stack([np.cos(a), np.sin(a), 0 * a], axis=1))
    y0 = 0.3  # left of the step
    top, ground = (2.0 - 0.8) / -d[:, 2], 2.0 / -d[:, 2]
    wall = np.where(d[:, 1] < 0, -y0 / np.minimum(d[:, 1], -1e-9), np.inf)
    ranges = np.where(wall > ground, ground, np.where(wall > top, wall, top))
    return x, np.tile(ranges, (SCANS, 1)), y0


def write_npz(path, **changes):
    x, ranges, y0 = made_scans()
    arrays = {
        "ranges_m": ranges,
        "angle_deg": AZIMUTH,
        "scan_time_s": 0.1 * np.arange(SCANS),
        "x_m": x,
        "y_m": np.full(SCANS, y0),
        "z_m": np.full(SCANS, 5.0),
    } | changes
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


def write_csv(path):
    x, ranges, y0 = made_scans()
    time = np.repeat(0.1 * np.arange(SCANS), BEAMS)
    table = np.column_stack([time, ranges.ravel(), np.tile(AZIMUTH, SCANS)])
    np.savetxt(path, table, delimiter=",", header="t_s,range_m,azimuth_deg", comments="", fmt="%.9g")
    poses = np.column_stack([0.1 * np.arange(SCANS), x, np.full(SCANS, y0), np.full(SCANS, 5.0)])
    track = path.with_name("poses.csv")
    np.savetxt(track, poses, delimiter=",", header="t_s,x_m,y_m,z_m", comments="", fmt="%.9g")
    return path, track


def write_mcap(path, *, cloud=False):
    """The same drive as a recording with /tf_static."""
    x, ranges, y0 = made_scans()
    file = McapFile(path)
    make, ns = file.make, 1_000_000_000
    turn = make(
        "geometry_msgs/msg/Transform",
        translation=make.vector(*MOUNT.position),
        rotation=make.quaternion(MOUNT),
    )
    link = make(
        "geometry_msgs/msg/TransformStamped",
        header=make.header(0, "base"),
        child_frame_id="lidar",
        transform=turn,
    )
    file.write("/tf_static", 0, make("tf2_msgs/msg/TFMessage", transforms=[link]))
    blank = np.zeros(36)
    for k in range(SCANS):
        t = k * ns // 10
        pose = Pose.from_euler((x[k], y0, 5.0))
        twist = make("geometry_msgs/msg/Twist", linear=make.vector(), angular=make.vector())
        file.write(
            "/odom",
            t,
            make(
                "nav_msgs/msg/Odometry",
                header=make.header(t, "map"),
                child_frame_id="base",
                pose=make("geometry_msgs/msg/PoseWithCovariance", pose=make.pose(pose), covariance=blank),
                twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=blank),
            ),
        )
        file.write(
            "/scan",
            t,
            make(
                "sensor_msgs/msg/LaserScan",
                header=make.header(t, "lidar"),
                angle_min=AZIMUTH[0] * DEG,
                angle_max=AZIMUTH[-1] * DEG,
                angle_increment=(AZIMUTH[1] - AZIMUTH[0]) * DEG,
                time_increment=0.0,
                scan_time=0.0,
                range_min=0.1,
                range_max=50.0,
                ranges=np.append(ranges[k, :-1], np.inf).astype(np.float32),
                intensities=np.full(BEAMS, 0.4, np.float32),
            ),
        )
    file.close()
    return path


def grid_of(path, poses=None, **keys):
    return build_height_map(open_source(path, Wanted(mount=MOUNT), poses), Settings(reach_m=8.0, **keys))


def test_heights_step_and_ground_of_a_made_drive(tmp_path):
    grid = grid_of(write_npz(tmp_path / "s.npz"))
    assert grid.about["scans"] == SCANS
    assert grid.about["echoes"] == SCANS * BEAMS
    x = np.linspace(4.8, 7.0, 23)
    assert np.allclose(surface(grid, x, np.full(23, -0.4), 0.5), 5.8, atol=0.011)
    assert np.allclose(surface(grid, x, np.full(23, 0.4), 0.5), 5.0, atol=0.011)
    assert np.allclose(grid.ground_height(x, 0 * x), 5.0, atol=1e-3)
    assert np.isnan(surface(grid, [0.0, 50.0], [0.0, 0.0], 0.5)).all()
    lit = cells_at(grid, 5.0, -0.4)
    assert grid.quantiles.reshape(-1, LEVELS)[lit, 0] != NONE


def test_npz_csv_and_recordings_say_the_same(tmp_path):
    npz = grid_of(write_npz(tmp_path / "s.npz"))
    path, poses = write_csv(tmp_path / "s.csv")
    csv = grid_of(path, poses)
    bag = build_height_map(open_source(write_mcap(tmp_path / "s.mcap"), Wanted()), Settings(reach_m=8.0))
    assert np.array_equal(npz.quantiles, csv.quantiles)
    assert np.array_equal(npz.table, csv.table)
    assert bag.about["beams_without_echo"] == SCANS  # the last beam of each
    assert bag.about["echoes"] == SCANS * (BEAMS - 1)
    at = np.linspace(4.0, 6.0, 21)
    for y in (-0.5, 0.5):
        a, b = (surface(g, at, np.full(21, y), 0.5) for g in (npz, bag))
        assert np.nanmax(np.abs(a - b)) < 0.003
    assert np.nanmean(bag.intensity) == pytest.approx(0.4, abs=1e-3)


def test_a_recording_that_breaks_off_is_read_up_to_there(tmp_path):
    whole = write_mcap(tmp_path / "whole.mcap").read_bytes()
    rng = np.random.default_rng(1)
    data = write_noisy_mcap(tmp_path / "big.mcap", rng)
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: int(0.6 * len(data))])
    grid = build_height_map(open_source(path, Wanted()), Settings(reach_m=8.0))
    [(note, count)] = [found for found in grid.about["notes"].items() if found[0].startswith(CUT_OFF)]
    assert note.startswith(f"{CUT_OFF} after ")
    assert note.endswith(" s")
    assert 6.0 < float(note.split()[-2]) < 16.0
    assert count == 1
    assert 60 < grid.about["scans"] < 200
    path.write_bytes(whole[:40])
    with pytest.raises(InputError, match="expected messages, there are none"):
        open_source(path, Wanted())


def write_noisy_mcap(path, rng):
    """Scans that do not compress, so that the file has several chunks."""
    file = McapFile(path)
    make = file.make
    for k in range(200):
        t = k * 100_000_000
        pose = make(
            "geometry_msgs/msg/PoseStamped",
            header=make.header(t, "map"),
            pose=make.pose(Pose.from_euler((0.05 * k, 0, 0))),
        )
        file.write("/pose", t, pose)
        count = 500
        table = np.zeros(count, [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
        table["x"], table["y"] = rng.uniform(1, 4, count), rng.uniform(-2, 2, count)
        table["z"] = rng.uniform(0, 0.8, count)
        fields = [
            make("sensor_msgs/msg/PointField", name=n, offset=4 * i, datatype=7, count=1)
            for i, n in enumerate("xyz")
        ]
        cloud = make(
            "sensor_msgs/msg/PointCloud2", header=make.header(t, ""), height=1, width=count, fields=fields,
            is_bigendian=False, point_step=12, row_step=12 * count, is_dense=True,
            data=np.frombuffer(table.tobytes(), np.uint8),
        )  # fmt: skip
        file.write("/points", t, cloud)
    file.close()
    return path.read_bytes()


def test_topics_and_mounting_are_asked_for_when_they_are_not_clear(tmp_path):
    path = write_mcap(tmp_path / "s.mcap")
    with pytest.raises(InputError, match=r"--scans = /nothing: expected one of /scan"):
        open_source(path, Wanted(scans="/nothing"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"expected a run folder, an \.mcap"):
        open_source(tmp_path / "empty", Wanted())
    with pytest.raises(InputError, match=r"expected a run folder, \.mcap"):
        open_source(tmp_path / "no.mcap", Wanted())
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(50))
    with pytest.raises(InputError, match="readable rosbag"):
        open_source(tmp_path / "x.bag", Wanted())
    (tmp_path / "x.mcap").write_bytes(b"hello")
    with pytest.raises(InputError, match="expected an MCAP file"):
        open_source(tmp_path / "x.mcap", Wanted())


@settings(max_examples=40)
@given(
    key=st.sampled_from(["ranges_m", "angle_deg", "scan_time_s", "x_m", "y_m", "z_m"]),
    how=st.sampled_from(["drop", "short", "text", "nan", "inf", "huge"]),
)
def test_broken_tables_are_named_or_counted(key, how, tmp_path_factory):
    path = write_npz(tmp_path_factory.mktemp("npz") / "s.npz")
    with np.load(path) as data:
        old = data[key]
    value = {
        "drop": None,
        "short": old[:-1],
        "text": np.full(old.shape, "a"),
        "nan": np.full(old.shape, np.nan),
        "inf": np.full(old.shape, np.inf),
        "huge": np.full(old.shape, 1e12),
    }[how]
    write_npz(path, **{key: value})
    if (key, how) == ("z_m", "drop"):
        assert grid_of(path).is_measured.any()
        return
    with pytest.raises(InputError):
        grid_of(path)


def test_some_bad_ranges_and_poses_are_left_out_and_counted(tmp_path):
    x, ranges, _ = made_scans()
    ranges[3, :] = np.nan
    ranges[4, :5] = 8191.0
    x[7] = np.nan
    grid = grid_of(write_npz(tmp_path / "s.npz", ranges_m=ranges, x_m=x))
    assert grid.about["beams_without_echo"] == BEAMS + 5
    assert grid.about["echoes"] == SCANS * BEAMS - BEAMS - 5


def test_rows_of_a_csv_are_counted_as_scans_whatever_times_their_beams_have(tmp_path):
    path, poses = write_csv(tmp_path / "s.csv")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    for times in (rows[:, 0], rows[:, 0] + 1e-4 * np.tile(np.arange(BEAMS), SCANS)):
        for table in (rows, rows.reshape(SCANS, BEAMS, 3)[:, ::-1].reshape(-1, 3)):
            table = np.column_stack([np.sort(times), table[:, 1:]])
            np.savetxt(path, table, delimiter=",", header="t_s,range_m,azimuth_deg", comments="", fmt="%.9g")
            assert grid_of(path, poses).about["scans"] == SCANS
    lines = path.read_text().splitlines()
    lines[7] = lines[7].replace(lines[7].split(",")[1], "-3.5")
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"range_m = -3.5: expected >= 0, .* \(.*s.csv:8\)"):
        grid_of(path, poses)


def test_csv_errors_are_named(tmp_path):
    path, poses = write_csv(tmp_path / "s.csv")
    with pytest.raises(InputError, match="--poses: expected a table of poses"):
        open_source(path, Wanted())
    poses.write_text("t_s,x\n1,2\n")
    with pytest.raises(InputError, match=r"columns = t_s, x: expected columns t_s, x_m, y_m.*poses.csv"):
        open_source(path, Wanted(), poses)
    poses.write_text("t_s,x_m,y_m\n1,2,north\n")
    with pytest.raises(InputError, match=r"y_m = north: expected a number such as 10.5 \(.*poses.csv:2\)"):
        open_source(path, Wanted(), poses)
    poses.write_text("t_s,x_m,y_m\n1,2,3\n1,2,3\n")
    with pytest.raises(InputError, match="at least two finite poses"):
        open_source(path, Wanted(), poses)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"columns = a, b"):
        open_source(path, Wanted(), poses)


def test_the_kept_sample_does_not_depend_on_the_parts_and_is_bounded():
    rng = np.random.default_rng(0)
    c, r = rng.integers(0, 5, 4000), rng.integers(0, 4, 4000)
    h, bright = rng.normal(500, 90, 4000), np.full(4000, np.nan)
    one, many = Gatherer(64, 8, 1), Gatherer(64, 8, 1, buffer=100)
    one.add(c, r, h, bright)
    for part in np.array_split(np.arange(4000), 13):
        many.add(c[part], r[part], h[part], bright[part])
    a, b = one.finish(), many.finish()
    assert np.array_equal(a.key, b.key)
    assert np.array_equal(a.height, b.height)
    assert len(a.key) == 20 * 8
    assert a.counts.sum() == 4000
    assert a.number.sum() == pytest.approx(4000)
    assert abs(a.height.mean() - 500) < 30


def test_stopped_beams_are_estimated_from_those_that_passed():
    # layers 0 and 3 of one cell: 10 of 20 beams stop in the upper one, all the rest in the lower one
    cell, layer = np.zeros(20, int), np.repeat([0, 3], 10)
    upper, whole = thicknesses(cell, layer, np.ones(20), np.repeat([10.0, 20.0], 10))
    above = 0.5 * (1 + 0.5 / 20)  # of the upper layer
    assert upper[-1] == pytest.approx(0.0)
    assert upper[layer == 0].min() == pytest.approx(above)
    assert whole[0] == pytest.approx(above + 1.0 * (1 + 0.5 / 10))
    assert (np.diff(upper) < 0.0).all()
    # ten times as many went through the upper layer: what was measured there weighs less
    few, _ = thicknesses(cell, layer, np.ones(20), np.repeat([10.0, 200.0], 10))
    assert few[layer == 0].min() == pytest.approx(0.05, rel=0.03)


def test_cells_keep_a_distribution_and_neighbours_lend_theirs():
    key = np.full(100, 5 * 256 + 40)
    height = np.sort(np.repeat([0, 800], 50)).astype(np.int16)
    samples = Samples(256, key, height, key[:1], np.array([100]), np.array([0.5]))
    block, thickness = pool(samples, 0, 0, along=0, across=0)
    assert block[5, 40, 0] == 0
    assert (block[5, 40, DEEP : DEEP + EVEN // 2] == 0).all()
    assert (block[5, 40, DEEP + EVEN // 2 :] == 800).all()
    assert (thickness[4:7, 39:42] <= -THICK).all()
    assert (block[4:7, 39:42] == block[5, 40]).all()
    assert (block[3, 40] == NONE).all()
    assert np.count_nonzero(block[..., 0] != NONE) == 9


def test_crop_is_not_lent_to_a_neighbour_that_beams_went_through():
    height = np.full(20, 800, np.int16)
    samples = Samples(
        256, np.repeat([5 * 256 + 10], 20), height, np.array([5 * 256 + 10]), np.array([20]), np.zeros(1)
    )
    passing = Passing(0, 256, 0, 64, 0.8)
    passing.times[5, 10, 16] = 25.0
    for through, held in ((0.0, 800), (3.0, NONE)):
        passing.times[6, 9:12, 10:] = through
        found, _ = pool(samples, 0, 0, along=1, across=0, fill=2, passing=passing)
        assert found[5, 10, -1] == 800
        assert found[6, 10, -1] == held
        assert found[4, 10, -1] == 800  # nobody knows better


def curtain(path, *, silent):
    """A scanner 1 m up that looks to the left and sweeps from above to below, past a curtain of leaves in
    the middle of a cell: between 0.5 m and 1.5 m half of the beams stop there, all others pass."""
    angle = np.arange(-60.0, 60.5, 0.5)
    rng = np.random.default_rng(5)
    rise = -np.sin(angle * DEG)
    flat = np.cos(angle * DEG)
    at = 1.0 + 1.025 * rise / flat  # height at the curtain
    stopped = (at > 0.5) & (at < 1.5) & (rng.random((80, len(angle))) < 0.5)
    with np.errstate(divide="ignore"):
        ground = np.where(rise < 0.0, 1.0 / -rise, np.inf)
    ranges = np.where(stopped, 1.025 / flat, ground)
    gone = ranges > 8.0
    arrays = {"no_return": gone.astype(np.uint8)} if silent else {}
    np.savez(
        path,
        ranges_m=np.where(gone, 8.19 if silent else np.nan, ranges),
        angle_deg=angle,
        scan_time_s=0.1 * np.arange(80),
        x_m=0.05 * np.arange(80),
        y_m=np.zeros(80),
        **arrays,
    )
    return path, angle, stopped


def test_a_curtain_stops_level_beams_and_those_that_rise_as_often_as_it_did(tmp_path):
    """Though there is much crop above them, and though what passed it met only the sky."""
    mount = Pose.from_euler((0.0, 0.0, 1.0), roll=-90 * DEG, yaw=90 * DEG)
    share = []
    for silent in (True, False):
        path, angle, stopped = curtain(tmp_path / "curtain.npz", silent=silent)
        grid = build_height_map(open_source(path, Wanted(mount=mount, range_max=8.0)), Settings(reach_m=8.0))
        d = mount.turn(np.stack([np.cos(angle * DEG), np.sin(angle * DEG), 0 * angle], axis=1))
        found = []
        for x in np.arange(0.5, 3.5, 0.05):
            hits = cast_heights(
                HeightCaster(grid),
                np.tile([x, 0.0, 1.0], (len(angle), 1)),
                d,
                range_max=8.0,
                seed=int(1000 * x),
            )
            at = 1.0 + hits.distance * d[:, 2]
            found.append((hits.what == MEASURED) & (hits.distance * d[:, 1] < 1.1) & (at > 0.3))
        rate, real = np.mean(found, axis=0), stopped.mean(axis=0)
        rise = np.arcsin(d[:, 2]) / DEG
        low, level, up = (rise > -40) & (rise < -29), (rise > -20) & (rise < -8), (rise > 3) & (rise < 20)
        assert rate[low].mean() < 0.05  # under it
        assert rate[level].mean() == pytest.approx(real[level].mean(), abs=0.08)
        share.append(rate[up].mean())
    assert share[0] == pytest.approx(0.5, abs=0.08)
    assert share[1] > 0.8  # nobody told what passed


def test_poses_between_rows_and_over_the_jump_of_the_heading():
    track = make_track(
        [2.0, 0.0, 1.0],
        [[2, 0, 0], [0, 0, 0], [1, 0, 0]],
        np.radians([[0, 0, -179], [0, 0, 179], [0, 0, 180]]),
    )
    place, turn, known = track.at(np.array([0.5, 1.5, 9.0]))
    assert np.allclose(place[:2, 0], [0.5, 1.5])
    assert np.degrees(np.arctan2(turn[1, 1, 0], turn[1, 0, 0])) == pytest.approx(-179.5)
    assert known.tolist() == [True, True, False]
    assert isinstance(track, PoseTrack)


def test_the_lowest_echoes_correct_the_ground(tmp_path):
    _, ranges, _ = made_scans()
    path = write_npz(tmp_path / "s.npz", z_m=np.full(SCANS, 5.2), ranges_m=ranges)  # poses 0.2 m too high
    by_pose, by_echoes = grid_of(path), grid_of(path, ground="echoes")
    assert float(by_pose.ground_height(5.0, 0.8)) == pytest.approx(5.2, abs=0.001)
    assert float(by_echoes.ground_height(5.0, 0.8)) == pytest.approx(5.2, abs=0.02)
    ranges = ranges * (2.2 / 2.0)  # now the ground really is 2.2 m below the scanner
    path = write_npz(tmp_path / "t.npz", ranges_m=ranges)
    assert float(grid_of(path, ground="echoes").ground_height(5.0, 0.8)) == pytest.approx(4.8, abs=0.02)


def test_settings_out_of_range_are_named():
    with pytest.raises(InputError, match=r"--cell-m = 0\.0: expected 0.01 to 5"):
        Settings(cell_m=0.0)
    with pytest.raises(InputError, match="--per-cell"):
        Settings(per_cell=0)
    with pytest.raises(InputError, match="--reach-m = nan"):
        Settings(reach_m=float("nan"))


@pytest.mark.drawn
def test_the_command_makes_file_and_picture_and_says_what_is_wrong(tmp_path, capsys):
    source, out = write_npz(tmp_path / "s.npz"), tmp_path / "made" / "grid.npz"
    args = ["height-map", "build", str(source), "--out", str(out), "--mount", MOUNT_TEXT, "--reach-m", "8"]
    assert main(args) == 0
    said = capsys.readouterr().out
    assert "level: replay" in said
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    first = out.read_bytes()
    assert load_height_grid(out).about["scans"] == SCANS
    assert main(args) == 0
    assert out.read_bytes() == first
    assert main([*args, "--mount", "1,2"]) == 2
    assert "--mount = 1,2: expected six numbers" in capsys.readouterr().err
    assert main(["height-map", "build", str(source), "--out", str(tmp_path / "x.txt")]) == 2


@pytest.mark.skipif(not VINEYARD.is_file(), reason="no real scans (set SWATH_DATA)")
def test_real_scans_of_a_vineyard_are_driven_past():
    mount = Pose.from_euler((0.0, 0.0, 0.9), roll=-90 * DEG, yaw=90 * DEG)  # looks to the left, sweeps down
    source = open_source(VINEYARD, Wanted(mount=mount, range_max=8.0))
    grid = build_height_map(source, Settings(along_m=0.15, fill_m=0.05, reach_m=8.0, ground="echoes"))
    with np.load(VINEYARD) as data:
        angle, place, silent, ranges = (
            data[k] for k in ("angle_deg", "pos_along_m", "no_return", "ranges_m")
        )
    assert grid.about["scans"] == 28
    assert grid.about["echoes"] + grid.about["beams_without_echo"] == 28 * 361
    assert grid.about["beams_without_echo"] == silent.sum()
    caster = HeightCaster(grid)
    d = mount.turn(np.stack([np.cos(angle * DEG), np.sin(angle * DEG), 0 * angle], axis=1))

    def scan(x, y):
        return cast_heights(caster, np.tile([x, y, 0.9], (361, 1)), d, range_max=8.0, seed=int(1000 * x))

    # where it was measured: most beams find what they found then
    again = [scan(x, 0.0) for x in place]
    both = np.array([(h.what == MEASURED) for h in again]) & ~silent
    error = np.array([h.distance for h in again])[both] - ranges[both]
    assert both.sum() > 0.92 * (~silent).sum()
    assert np.median(np.abs(error)) < 0.03
    # ... and as many of them meet the row, at every elevation: level ones are stopped, low ones pass below
    high = np.array([(h.what == MEASURED) & (0.9 + h.distance * d[:, 2] > 0.3) for h in again])
    row_before = ~silent & (0.9 + ranges * d[:, 2] > 0.3)
    hits = sum(int((h.what == MEASURED).sum()) for h in again)
    assert high.sum() / hits == pytest.approx(row_before.sum() / (~silent).sum(), abs=0.03)
    elevation = np.arcsin(d[:, 2]) / DEG
    for low in range(-50, 60, 10):
        part = (elevation >= low) & (elevation < low + 10)
        assert high[:, part].mean() == pytest.approx(row_before[:, part].mean(), abs=0.15)
    # 0.2 m nearer and at another speed: the row stands where it stood, and is as high
    nearer = [scan(x, 0.2) for x in np.arange(0.1, 1.8, 0.11)]

    def row(hits, y):
        """Distance of the row from the way that was measured [m]."""
        place = np.concatenate([(y + h.distance * d[:, 1])[h.what == MEASURED] for h in hits])
        height = np.concatenate([(0.9 + h.distance * d[:, 2])[h.what == MEASURED] for h in hits])
        return float(np.median(place[(height > 0.3) & (place > 0.3) & (place < 2.0)]))

    seen = ~silent & (0.9 + ranges * d[:, 2] > 0.3)
    measured = (ranges * d[:, 1])[seen]
    assert row(again, 0.0) == pytest.approx(float(np.median(measured[measured > 0.3])), abs=0.06)
    assert row(nearer, 0.2) == pytest.approx(row(again, 0.0), abs=0.06)
    z = np.concatenate([(0.9 + h.distance * d[:, 2])[h.what == MEASURED] for h in nearer])
    canopy = z[z > 0.3]
    assert 1.2 < np.quantile(canopy, 0.95) < 1.7  # 1.45 m measured above ground
    unknown = sum(int((h.what == UNMEASURED).sum()) for h in nearer)
    assert 0 < unknown < 0.2 * 361 * len(nearer)


@pytest.mark.parametrize("seed", range(4))
def test_ground_that_nobody_saw_is_filled_ring_by_ring(seed):
    rng = np.random.default_rng(seed)
    field = rng.normal(size=tuple(rng.integers(3, 40, 2)))
    field[rng.random(field.shape) < 0.95] = np.nan
    field[0, 0] = 1.0
    slow = field.copy()
    while np.isnan(slow).any():
        slow = np.where(np.isnan(slow), around(slow), slow)
    np.testing.assert_allclose(grown(field), slow, rtol=1e-12, atol=1e-12)


def test_means_around_nodes_of_a_wide_lattice_are_taken_some_rows_at_a_time():
    field = np.random.default_rng(1).normal(size=(2000, 1000))
    tracemalloc.start()
    mean = around(field)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert mean[700, 300] == pytest.approx(field[699:702, 299:302].mean())
    assert most < 5 * field.nbytes  # all windows are nine times a field
