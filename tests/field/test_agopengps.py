"""Fields of AgOpenGPS: what swath writes is what AgOpenGPS reads, and what that writes is a field here."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.field.maps.projection import ellipsoid
from swath.field_io import folder
from swath.field_io.agopengps import Plane, read_agopengps, write_agopengps
from swath.field_io.importer import Settings, import_log

LAT, LON = 52.1234567, 10.2345678
OUTER = [(-200.0, -150.0), (210.5, -140.25), (190.0, 160.0), (-180.0, 150.0)]
ISLAND = [(20.0, 20.0), (40.0, 20.0), (40.0, 45.0), (20.0, 45.0)]
INNER = [(-180.0, -130.0), (190.0, -120.0), (170.0, 140.0), (-160.0, 130.0)]
CURVE = [(-150.0 + 10.0 * i, -60.0 + 20.0 * math.sin(0.2 * i)) for i in range(31)]


def ring(points):
    return [str(len(points)), *(f"{e},{n},0.5" for e, n in points)]


def write(path, **files):
    path.mkdir(parents=True, exist_ok=True)
    for name, rows in files.items():
        (path / f"{name}.txt").write_text("\r\n".join(rows) + "\r\n", encoding="utf-8")
    return path


def as_agopengps_writes(path, **other):
    """As `FieldPlaneFiles`, `BoundaryFiles`, `HeadlandFiles` and `TrackFiles` save."""
    field = ["2026-July-15 09:12:33 AM", "$FieldDir", "FieldNew", "$Offsets", "0,0", "Convergence", "0"]
    tracks = ["$TrackLines", "AB 12.3", "0.21", "-100,-140", "-60.5,150.25", "0", "2", "True", "0"]
    tracks += ["Cu 1", "1.2", "-150,-60", "150,-60.1", "0.35", "4", "False", *ring(CURVE)]
    tracks += ["Pivot", "0", "0,0", "0,0", "0", "64", "True", "0"]
    files = {
        "Field": [*field, "StartFix", f"{LAT},{LON}"],
        "Boundary": ["$Boundary", "False", *ring(OUTER), "True", "True", *ring(ISLAND)],
        "Headland": ["$Headland", *ring(INNER), "0"],
        "TrackLines": tracks,
    }
    return write(path, **{**files, **other})


def test_a_field_of_agopengps_becomes_a_field_folder(tmp_path):
    import_log(
        as_agopengps_writes(tmp_path / "Back Forty"),
        tmp_path / "f",
        settings=Settings(header_width_m=9.0),
        progress=False,
    )
    field = folder.read(tmp_path / "f")
    plane = Plane(LAT, LON)

    def here(points):
        return field.origin.to_local(plane.to_lon_lat(np.array(points)))

    for given, found in ((OUTER, field.boundary), (ISLAND, field.holes[0])):
        assert len(found) == len(given)
        for point in here(given):
            assert np.hypot(*(found - point).T).min() < 2e-3
    lines = {t.machine: t for t in field.tracks}
    assert len(field.tracks) == 3
    assert np.hypot(*(lines["headland"].line - here(INNER)[:1]).T).min() < 2e-3
    assert lines["headland"].straights == ()
    straight, curve = (t for t in field.tracks if t.machine == "guidance line")
    a, b = here([(-100, -140), (-60.5, 150.25)])
    way = (b - a) / np.hypot(*(b - a))
    assert abs((straight.line[0] - a) @ [-way[1], way[0]]) < 2e-3
    assert np.hypot(*(curve.line[5] - here(CURVE)[5])) < 2e-3
    assert any("Pivot, water pivot" in note for note in field.info["notes"])
    assert any("1 islands that may be driven through" in note for note in field.info["notes"])


def test_its_plane_is_the_ellipsoid_to_a_centimetre_over_a_field():
    plane, geod = Plane(LAT, LON), ellipsoid()
    for east, north in ((300.0, 0.0), (0.0, 300.0), (-250.0, 200.0)):
        (lon, lat) = plane.to_lon_lat(np.array([[east, north]]))[0]
        bearing, _, distance = geod.inv(LON, LAT, lon, lat)
        assert abs(distance - math.hypot(east, north)) < 0.02
        assert abs(math.sin(math.radians(bearing) - math.atan2(east, north))) * distance < 0.02
    points = np.random.default_rng(1).uniform(-500, 500, (50, 2))
    np.testing.assert_allclose(plane.from_lon_lat(plane.to_lon_lat(points)), points, atol=1e-6)


def read_as_agopengps(path):
    """Its own loaders, line by line: `FieldPlaneFiles.LoadOrigin`, `BoundaryFiles.Load`, `HeadlandFiles.
    AttachLoad`, `TrackFiles.Load`."""
    rows = (path / "Field.txt").read_text().splitlines()
    lat, lon = map(float, rows[rows.index("StartFix") + 1].split(","))

    def block(rows):
        return [tuple(map(float, rows.pop(0).split(","))) for _ in range(int(rows.pop(0)))]

    rows, boundaries = (path / "Boundary.txt").read_text().splitlines(), []
    assert rows.pop(0) == "$Boundary"
    while rows:
        assert rows.pop(0) in ("True", "False")
        boundaries.append(block(rows))
    rows = (path / "Headland.txt").read_text().splitlines()
    assert rows.pop(0) == "$Headland"
    headlands = [block(rows) for _ in boundaries if rows]
    rows, tracks = (path / "TrackLines.txt").read_text().splitlines(), []
    assert rows.pop(0) == "$TrackLines"
    while rows:
        name, heading = rows.pop(0), float(rows.pop(0))
        a, b = (tuple(map(float, rows.pop(0).split(","))) for _ in range(2))
        nudge, mode, visible = float(rows.pop(0)), int(rows.pop(0)), rows.pop(0)
        assert (nudge, visible) == (0.0, "True")
        tracks.append((name, heading, a, b, mode, block(rows)))
    return (lat, lon), boundaries, headlands, tracks


def test_what_is_written_is_read_by_agopengps_and_comes_back(tmp_path):
    import_log(
        as_agopengps_writes(tmp_path / "a"),
        tmp_path / "f",
        settings=Settings(header_width_m=9.0),
        progress=False,
    )
    assert main(["field", "agopengps", str(tmp_path / "f"), "--out", str(tmp_path / "b")]) == 0
    field = folder.read(tmp_path / "f")
    origin, boundaries, headlands, tracks = read_as_agopengps(tmp_path / "b")
    lon, lat = field.origin.to_lon_lat([[0.0, 0.0]])[0]
    np.testing.assert_allclose(origin, (lat, lon), atol=1e-12)
    plane = Plane(*origin)
    for ring_, points in zip((field.boundary, *field.holes), boundaries, strict=True):
        there = plane.to_lon_lat(np.array(points)[:, :2])
        np.testing.assert_allclose(field.origin.to_local(there), ring_, atol=1e-3)
        heading = [math.atan2(b[0] - a[0], b[1] - a[1]) % (2 * math.pi) for a, b in pairwise(points)]
        np.testing.assert_allclose([p[2] for p in points[:-1]], heading, atol=1e-4)
    assert [len(h) for h in headlands] == [4, 0]
    assert sorted(mode for *_, mode, _ in tracks) == [2, 4]
    for _, heading, a, b, mode, points in tracks:
        assert abs(math.sin(heading - math.atan2(b[0] - a[0], b[1] - a[1]))) < 1e-4
        assert (points == []) == (mode == 2)
    again = read_agopengps(tmp_path / "b")
    assert len(again.rings) == 2
    assert {line.kind for line in again.lines} == {"1", "3"}


def test_nothing_else_is_overwritten(tmp_path):
    import_log(
        as_agopengps_writes(tmp_path / "a"),
        tmp_path / "f",
        settings=Settings(header_width_m=9.0),
        progress=False,
    )
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "x").write_text("x")
    with pytest.raises(InputError, match="expected a new or empty folder, or an earlier field of AgOpenGPS"):
        write_agopengps(folder.read(tmp_path / "f"), tmp_path / "mine")
    field = replace(folder.read(tmp_path / "f"), tracks=())
    write_agopengps(field, tmp_path / "a")
    assert read_agopengps(tmp_path / "a").lines == ()


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ({"Field": ["$FieldDir", "x"]}, r"StartFix: expected the origin .*Field.txt"),
        ({"Field": ["StartFix", "95,10"]}, r"expected latitude and longitude .*Field.txt:2"),
        ({"Boundary": ["$Boundary"]}, r"expected a boundary, it has none .*Boundary.txt"),
        ({"Boundary": ["$Boundary", "False", "4", "1,2,3"]}, r"the file ends here .*Boundary.txt"),
        ({"Boundary": ["$Boundary", "False", "99999999999"]}, r"how many points follow .*Boundary.txt:3"),
        (
            {"Boundary": ["$Boundary", "False", "3", "1,nan,3"]},
            r"expected 2 or 3 numbers between commas, with decimal points .*Boundary.txt:4",
        ),
        (
            {"Boundary": ["$Boundary", "False", "3", "1,5,2,5,0,1"]},
            r"1,5,2,5,0,1: expected 2 or 3 numbers between commas, with decimal points .*Boundary.txt:4",
        ),
        ({"Field": ["StartFix", "48,5,10,25"]}, r"expected 2 numbers between commas.*Field.txt:2"),
        ({"TrackLines": ["AB", "0"]}, r"expected [$]TrackLines .*TrackLines.txt:1"),
        (
            {"TrackLines": ["$TrackLines", "AB", "0", "0,0", "1,1", "0", "two"]},
            r"mode = two: .*TrackLines.txt:7",
        ),
    ],
)
def test_a_file_that_is_not_as_agopengps_writes_it_is_one_error(tmp_path, other, expected):
    with pytest.raises(InputError, match=expected):
        read_agopengps(as_agopengps_writes(tmp_path / "a", **other))


def test_older_files_are_told(tmp_path):
    path = as_agopengps_writes(tmp_path / "a")
    (path / "TrackLines.txt").rename(path / "ABLines.txt")
    assert "unused: ABLines.txt of an older version" in read_agopengps(path).notes[-1]
