from datetime import date

import numpy as np
import pytest

from swath.core.errors import InputError, MissingExtra
from swath.core.frames import Pose
from swath.field.maps.projection import Origin
from swath.signals import Scan, ScanTruth, beam_directions
from swath.tools.scan import point_cloud as module
from swath.tools.scan.point_cloud import make_cloud, write_las, write_ply
from swath.tools.scan.scan import check_formats

POSE = Pose.from_euler((1000.0, -2000.0, 2.5), 0.0, 0.3, 1.0)


def xyz(cloud):
    return np.stack([cloud[axis] for axis in "xyz"], axis=1)


def echoes(count=40):
    """A scan with up to two echoes per beam, and the cloud made of it."""
    rng = np.random.default_rng(5)
    azimuth = np.linspace(-1.0, 1.0, count)
    ranges = np.stack([rng.uniform(2, 9, count), rng.uniform(9, 12, count)], axis=1).astype(np.float32)
    ranges[::3, 1] = np.nan
    ranges[7] = np.nan
    intensity = np.where(np.isnan(ranges), np.nan, rng.uniform(0, 1.2, (count, 2))).astype(np.float32)
    scan = Scan(2_000_000_000, np.linspace(-0.01, 0, count), azimuth, np.zeros(count), ranges, intensity)
    origins = POSE.position + np.linspace(-0.02, 0, count)[:, None] * np.array([1.0, 0.0, 0.0])
    truth = ScanTruth(scan.t, np.full((count, 2, 3), np.nan), origins)
    return scan, truth, make_cloud(scan, truth, POSE)


def test_points_lie_where_the_beams_went():
    scan, truth, cloud = echoes()
    assert len(cloud) == np.isfinite(scan.ranges).sum()
    away = xyz(cloud) - truth.sensor_position[cloud["beam"]]
    expected = scan.ranges[cloud["beam"], cloud["echo"]]
    assert np.linalg.norm(away, axis=1) == pytest.approx(expected.astype(float))
    back = away @ POSE.rotation / expected[:, None]
    assert np.allclose(back, beam_directions(scan.azimuth, scan.elevation)[cloud["beam"]], atol=1e-9)
    assert set(cloud["echo_count"]) == {1, 2}
    assert cloud["time"].max() == pytest.approx(2.0)


def test_ply_is_read_by_another_program(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    _, _, cloud = echoes()
    path = write_ply(tmp_path / "scan.ply", cloud)
    read = trimesh.load(path)
    assert np.allclose(read.vertices, xyz(cloud), atol=1e-9)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    for name in ("intensity", "time", "beam", "echo", "echo_count"):
        assert np.array_equal(np.asarray(data[name]).ravel(), cloud[name])


@pytest.mark.parametrize("name", ["scan.las", "scan.laz"])
def test_las_is_read_by_another_program(tmp_path, name):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    _, _, cloud = echoes()
    path = write_las(tmp_path / name, cloud)
    las = laspy.read(path)
    assert las.header.version == "1.4"
    assert las.header.are_points_compressed == name.endswith("laz")
    assert np.allclose(las.xyz, xyz(cloud), atol=0.5 * module.LAS_STEP + 1e-9)
    assert np.allclose(las.gps_time, cloud["time"])
    assert np.allclose(las.intensity / 65535, np.minimum(cloud["intensity"], 1.0), atol=1e-5)
    assert np.array_equal(las.return_number, cloud["echo"] + 1)
    assert np.array_equal(las.number_of_returns, cloud["echo_count"])
    assert np.array_equal(las.beam, cloud["beam"])
    assert np.allclose(np.radians(las.scan_angle * 0.006), cloud["azimuth"], atol=1e-4)


EARTH = Origin(32632, 600_000.0, 5_790_000.0, 80.0)


@pytest.mark.parametrize("origin", [None, EARTH], ids=["made", "on Earth"])
def test_las_says_where_its_points_lie(tmp_path, origin):
    """As WKT, which point format 6 asks for; the day of its making is not that of today."""
    laspy, pyproj = pytest.importorskip("laspy"), pytest.importorskip("pyproj")
    _, _, cloud = echoes()
    las = laspy.read(write_las(tmp_path / "scan.las", cloud, origin))
    assert las.header.global_encoding.wkt
    assert las.header.creation_date == date(2024, 1, 1)
    (told,) = (v.string for v in las.header.vlrs.get("WktCoordinateSystemVlr"))
    shift = np.zeros(3) if origin is None else [origin.easting, origin.northing, origin.height]
    assert np.allclose(las.xyz, xyz(cloud) + shift, atol=0.5 * module.LAS_STEP + 1e-6)
    if origin is None:
        crs = pyproj.CRS.from_wkt(told)
        assert [axis.unit_name for axis in crs.axis_info][:2] == ["metre", "metre"]
        assert crs.to_epsg() is None
    else:
        assert las.header.parse_crs().to_epsg() == 32632


def test_same_cloud_same_bytes(tmp_path):
    pytest.importorskip("laspy")
    files = []
    for k in range(2):
        _, _, cloud = echoes()
        files.append([write(tmp_path / f"{k}{end}", cloud).read_bytes()
                      for write, end in ((write_ply, ".ply"), (write_las, ".las"))])  # fmt: skip
    assert files[0] == files[1]


def test_a_scan_without_echoes_is_an_empty_cloud(tmp_path):
    laspy = pytest.importorskip("laspy")
    scan, truth, _ = echoes()
    nothing = np.full_like(scan.ranges, np.nan)
    scan = Scan(scan.t, scan.beam_t, scan.azimuth, scan.elevation, nothing, nothing)
    cloud = make_cloud(scan, truth, POSE)
    assert b"element vertex 0\n" in write_ply(tmp_path / "none.ply", cloud).read_bytes()
    assert len(laspy.read(write_las(tmp_path / "none.las", cloud)).points) == 0


def test_formats_are_checked_before_anything_runs(monkeypatch):
    check_formats(["png", "ply"])
    with pytest.raises(InputError, match=r"--format = xyz: expected some of png, csv"):
        check_formats(["png", "xyz"])
    monkeypatch.setitem(__import__("sys").modules, "laspy", None)
    with pytest.raises(MissingExtra, match=r"swath\[las\]"):
        check_formats(["laz"])
