"""`swath compare scans`: closed forms, noise, clouds that were turned and moved, wrong frames and units."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.compare_scans.clouds import Cloud, Reading, cloud_of, read_cloud
from swath.tools.compare_scans.compare import Grid, compare_clouds
from swath.tools.height_map.poses import make_track
from swath.tools.height_map.source import Wanted
from tests.levels.limits import make
from tests.sensing.replay_rig import drive, small_world, source_of

COUNT = 12_000


def test_empirical_against_plants_is_what_the_level_states():
    """In the crop of one stand, seen on one drive: W1 2 cm (`swath levels lidar`, tests/levels)."""
    world = small_world()
    plants = world.leader.parts["lidar"]
    empirical = make("lidar", "empirical", plants.setup, sector_deg=(-25, 25), noise="none")
    how = Reading(Wanted(), reach_m=25.0)
    clouds = []
    for lidar in (plants, empirical):
        outs, states = drive(lidar, world, offset=0.3, speed=3.0, length=12.0)
        clouds.append(cloud_of(source_of(lidar, outs, states), how))
    made = compare_clouds(*clouds, grid=Grid(cell_m=0.5))
    crop = [row for row in made.cells if row["mean_m_a"] > 0.6]
    assert len(crop) > 3
    assert np.mean([row["w1_m"] for row in crop]) < 0.02
    assert made.number("w1_m").difference < 0.02
    itself = compare_clouds(clouds[0], clouds[0])
    assert itself.number("w1_m").difference == itself.number("ks").difference == 0.0


def track(length=30.0, yaw=0.0, at=(0.0, 0.0), radius=None):
    """A machine that drives straight, or to the left with a radius."""
    s = np.linspace(0.0, length, 200)
    bend = s / radius if radius else 0.0 * s
    x = radius * np.sin(bend) if radius else s
    y = radius * (1.0 - np.cos(bend)) if radius else 0.0 * s
    c, si = np.cos(yaw), np.sin(yaw)
    place = np.stack([at[0] + c * x - si * y, at[1] + si * x + c * y, 0 * s], axis=1)
    return make_track(s / 2.0, place, np.stack([0 * s, 0 * s, yaw + bend], axis=1))


def stand(seed, *, shift=0.0, top=1.0, low=0.0, edge=0.0, move=(0.0, 0.0), yaw=0.0, count=COUNT, **more):
    """Heights uniform from low to top left of the edge, stubble to its right. shift: of all heights [m]"""
    rng = np.random.default_rng(seed)
    s, d = rng.uniform(0.0, 30.0, count), rng.uniform(-4.0, 4.0, count)
    height = np.where(d > edge, rng.uniform(low, top, count), rng.uniform(0.0, 0.15, count)) + shift
    c, si = np.cos(yaw), np.sin(yaw)
    points = np.stack([move[0] + c * s - si * d, move[1] + si * s + c * d, height], axis=1)
    given = {"track": track(yaw=yaw, at=move), "intensity": np.full(count, np.nan), "white": np.nan}
    given |= {"silent_count": 0, "scan_count": 100, "notes": [], **more}
    return Cloud("drawn", points, height, **given)


def test_a_cloud_against_itself_differs_by_nothing():
    one = stand(1, intensity=np.random.default_rng(0).uniform(0.1, 0.9, COUNT))
    made = compare_clouds(one, one)
    assert [n.difference for n in made.numbers] == [0.0] * 9
    assert all(np.abs(n.spread).max() < 1e-12 for n in made.numbers if n.spread)
    assert made.number("intensity").a == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("shift", [-0.02, 0.3])
def test_uniform_stands_that_are_shifted(shift):
    """W1 of two uniform distributions that are moved against each other is the shift, KS shift over width."""
    kinds = {"low": 0.2, "edge": -9.0}
    made = compare_clouds(stand(1, **kinds), stand(1, shift=shift, **kinds))
    assert made.number("w1_m").difference == pytest.approx(abs(shift), abs=1e-9)
    assert made.number("mean_m").difference == pytest.approx(shift, abs=1e-9)
    assert made.number("ks").difference == pytest.approx(abs(shift) / 0.8, abs=0.04)
    other = compare_clouds(stand(1, **kinds), stand(2, shift=shift, **kinds))
    assert other.number("w1_m").difference == pytest.approx(abs(shift), abs=0.012)
    low, high = other.number("mean_m").spread
    assert low < shift < high < low + 0.02
    assert other.number("w1_m").difference > other.number("w1_m").spread[0]


@pytest.mark.draws
def test_what_is_noise_is_called_so():
    """Of two draws of one stand the distance is below its noise as often as 95 % asks, and the intervals of
    what does not differ hold 0.
    """
    inside = {"w1_m": 0, "ks": 0, "mean_m": 0, "ground_share": 0}
    for seed in range(20):
        a, b = (stand(2 * seed + k, count=3000) for k in (0, 1))
        made = compare_clouds(a, b, grid=Grid(cell_m=1.0), seed=seed)
        for name in inside:
            n = made.number(name)
            is_in = n.difference <= n.spread[0] if len(n.spread) == 1 else n.spread[0] <= 0 <= n.spread[1]
            inside[name] += bool(is_in)
    assert all(n >= 17 for n in inside.values()), inside  # of 20: 98 % for a true rate of 95 %


def test_ground_depth_and_returns():
    rng = np.random.default_rng(3)
    open_to = np.where(rng.random(COUNT) < 0.3, 0.0, rng.uniform(0.5, 1.0, COUNT))
    a = stand(3, edge=-9.0, low=0.5)
    b = Cloud("gaps", a.points, open_to, a.intensity, a.track, np.nan, COUNT // 4, 100, [])
    made = compare_clouds(a, b, grid=Grid(cell_m=0.5))
    assert made.number("ground_share").a == 0.0
    assert made.number("ground_share").b == pytest.approx(0.3, abs=0.01)
    assert made.number("penetration_m").a == pytest.approx(0.225, abs=0.005)  # top at 0.975, mean at 0.75
    assert made.number("returns_per_m2").a == pytest.approx(COUNT / (30 * 8), rel=0.02)
    assert made.facts["beams without crop return"][1] == pytest.approx(0.2 + 0.8 * 0.3, abs=0.01)


def test_means_are_over_the_cells_that_both_have():
    """Only A has crop echoes right of the edge, 0.05 m deep: the depth of both is that of the stand."""
    a, b = stand(7, low=0.5), stand(8, low=0.5, top=1.1)
    b = replace(b, height=np.where(b.height < 0.3, 0.0, b.height))
    number = compare_clouds(a, b, grid=Grid(cell_m=0.5)).number("penetration_m")
    assert number.a == pytest.approx(0.225, abs=0.005)
    assert number.difference == pytest.approx(0.045, abs=0.006)
    low, high = number.spread
    assert 0.0 < low < number.difference < high


@pytest.mark.parametrize("seed", range(2))
def test_turned_and_moved_stands_are_the_same(seed):
    """Both in other coordinates, or only B where paths align them: the numbers are those of before."""
    rng = np.random.default_rng(seed)
    where = {"move": tuple(rng.uniform(-5e4, 5e4, 2)), "yaw": float(rng.uniform(-3.1, 3.1))}
    edge = float(rng.uniform(-1.0, 1.0))
    plain = compare_clouds(stand(1, edge=edge), stand(2, edge=edge, top=0.9))
    both = compare_clouds(stand(1, edge=edge, **where), stand(2, edge=edge, top=0.9, **where))
    one = compare_clouds(stand(1, edge=edge), stand(2, edge=edge, top=0.9, **where), align="path")
    for made in (both, one):
        for name in ("w1_m", "ks", "mean_m", "ground_share"):
            expected = plain.number(name).difference
            assert made.number(name).difference == pytest.approx(expected, abs=2e-4), name
    with pytest.raises(InputError, match="expected one place"):
        compare_clouds(stand(1, edge=edge), stand(2, edge=edge, top=0.9, **where))


def test_along_a_bend_the_edge_stays_straight():
    """A stand whose edge follows a bend of 60 m: its cells hold crop or stubble, none of them both."""
    rng = np.random.default_rng(7)
    s, d = rng.uniform(2.0, 28.0, COUNT), rng.uniform(-4.0, 4.0, COUNT)
    radius = 60.0
    angle = s / radius
    points = np.stack([(radius - d) * np.sin(angle), radius - (radius - d) * np.cos(angle), 0 * s], axis=1)
    height = np.where(d > 0.0, 0.8, 0.1)
    cloud = Cloud("bend", points, height, np.full(COUNT, np.nan), track(radius=radius), np.nan, 0, 9, [])
    made = compare_clouds(cloud, cloud)
    both = [row for row in made.cells if 0.12 < row["mean_m_a"] < 0.78]
    assert all(abs(row["left_m"]) < 0.2 for row in both)


def test_a_shift_across_and_feet_are_told():
    a = stand(1, top=0.9, low=0.7)
    made = compare_clouds(a, stand(2, top=0.9, low=0.7, edge=0.5))
    assert any("B moved -0.5 m to the left fits better" in note for note in made.notes)
    feet = stand(2, top=0.9, low=0.7)
    feet = Cloud("feet", feet.points, feet.height / 0.3048, feet.intensity, feet.track, np.nan, 0, 100, [])
    assert any("is B in feet?" in n for n in compare_clouds(a, feet).notes)


def test_intensity_is_compared_on_one_scale_or_not_at_all():
    light = np.random.default_rng(0).uniform(0.2, 0.9, COUNT)
    a, b = stand(1, intensity=light), stand(2, intensity=255.0 * light)
    made = compare_clouds(a, b)
    assert any("not compared: --white" in n for n in made.notes)
    assert "intensity" not in [n.name for n in made.numbers]
    made = compare_clouds(a, b, white=(1.0, 255.0))
    assert made.number("intensity_w1").difference < 0.05
    assert made.number("intensity").difference == pytest.approx(0.0, abs=0.01)
    las = stand(2, intensity=65535.0 * light, white=65535.0)
    assert compare_clouds(a, las).number("intensity").difference == pytest.approx(0.0, abs=0.01)


@pytest.fixture
def las(tmp_path):
    laspy = pytest.importorskip("laspy", reason="extra las")

    def write(name, cloud, *, wkt=None, scale=1.0):
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = np.full(3, 1e-4 * scale), np.zeros(3)
        if wkt:
            header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
            header.global_encoding.wkt = True
        data = laspy.LasData(header)
        tilt = 0.05 * cloud.points[:, 0] + 100.0  # the ground of the field rises
        data.x, data.y, data.z = scale * np.stack([*cloud.points[:, :2].T, cloud.height + tilt])
        data.write(str(tmp_path / name))
        return tmp_path / name

    return write


@pytest.mark.drawn
def test_las_against_las(las, tmp_path, capsys):
    a, b = (las(f"{k}.laz", stand(k, top=0.9 + 0.05 * k)) for k in (1, 2))
    out = tmp_path / "out"
    assert main(["compare", "scans", str(a), str(b), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "neither has a path" in said
    assert "heights are above its lowest echoes" in said
    found = json.loads((out / "results.json").read_text())
    crop = [row for row in found["cells"] if row["left_m"] > 0.5]
    assert np.mean([row["top_m_b"] - row["top_m_a"] for row in crop]) == pytest.approx(0.05 * 0.95, abs=0.01)
    assert (out / "profiles.png").stat().st_size > 10_000
    assert "Two sets of scans" in (out / "report.html").read_text()
    assert main(["compare", "scans", str(a), str(b), "--align", "path"]) == 2
    assert "expected poses in both" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wkt", "scale", "text"),
    [
        ('GEOGCS["WGS 84",UNIT["degree",0.0174532925199433]]', 1.0, "they are degrees"),
        ('PROJCS["x",GEOGCS["y",UNIT["degree",0.01]],UNIT["US survey foot",0.3048]]', 1.0, "US survey foot"),
        (None, 1000.0, "expected metres, 5 %"),
    ],
)
def test_wrong_units_are_refused(las, wkt, scale, text):
    with pytest.raises(InputError, match=text):
        read_cloud(las("wrong.las", stand(1), wkt=wkt, scale=scale), Reading(Wanted()))


def test_icp_finds_what_was_moved():
    pytest.importorskip("trimesh", reason="extra mesh")
    a = stand(1, top=0.9, low=0.8, count=8000)
    turned = 0.01
    c, s = np.cos(turned), np.sin(turned)
    x, y = (a.points[:, :2] - 5.0).T
    points = np.stack([5.0 + c * x - s * y + 0.02, 5.0 + s * x + c * y + 0.03, a.points[:, 2]], axis=1)
    b = Cloud("moved", points, a.height, a.intensity, a.track, np.nan, 0, 100, [])
    made = compare_clouds(a, b, align="icp")
    assert any(n.startswith("ICP moves moved by") for n in made.notes)
    assert made.number("w1_m").difference < 0.5 * compare_clouds(a, b).number("w1_m").difference
    far = Cloud(
        "far", points + np.array([0.0, 0.0, 30.0]), a.height, a.intensity, a.track, np.nan, 0, 100, []
    )
    with pytest.raises(InputError, match="expected two clouds of one place"):
        compare_clouds(a, far, align="icp")


def test_points_that_are_no_one_field_are_refused(las):
    cloud = stand(1)
    cloud.points[:2, :2] = (40_000.0, 0.0), (0.0, 4_000.0)
    with pytest.raises(InputError, match=r"at most 2.68 km2 .* they spread over \d\d \d{3} x \d \d{3} m"):
        read_cloud(las("far.las", cloud), Reading(Wanted()))


@pytest.mark.parametrize("offset", [np.inf, np.nan, 1e300, -1e9])
@pytest.mark.parametrize("at", [155, 163, 171])
def test_points_at_no_place_on_earth_are_refused(las, capfd, offset, at):
    file = las("away.las", stand(1, count=300))
    data = bytearray(file.read_bytes())
    struct.pack_into("<d", data, at, offset)  # LAS 1.4 R15: offsets of x, y, z in the head
    file.write_bytes(data)
    with pytest.raises(InputError, match="expected points at places on earth"):
        read_cloud(file, Reading(Wanted()))
    assert capfd.readouterr().out == ""


@pytest.mark.draws
def test_points_over_a_field_of_36_hectares_are_read(las):
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 600.0, (20_000, 3)) * (1.0, 1.0, 0.001)
    file = las("field.las", replace(stand(1), points=points, height=points[:, 2]))
    cloud = read_cloud(file, Reading(Wanted()))
    assert np.ptp(cloud.points[:, :2], axis=0) == pytest.approx([600.0, 600.0], abs=1.0)
    assert 0.0 <= np.median(cloud.height) < 0.7
