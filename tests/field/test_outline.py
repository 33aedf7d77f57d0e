"""Outlines as people hold them: islands, several fields, rings either way round."""

import json
import zipfile

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.field.maps.projection import origin_at, transform
from swath.field_io.logs.shapefiles import read_points
from swath.field_io.outline import read_outlines
from swath.field_io.plan import is_outline

pytest.importorskip("shapefile")
pytest.importorskip("shapely")
ORIGIN = origin_at(48.0, 11.0)


def box(x0, x1, y0, y1):
    """A closed ring of lon/lat, counter-clockwise, of metres from the origin."""
    ring = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    return ORIGIN.to_lon_lat(ring).tolist()


HOME, POND, BESIDE = box(0, 200, 0, 150), box(50, 90, 30, 80), box(300, 380, 0, 150)  # 3.00, 0.20, 1.2 ha
ISLET, TOUCHING, INNER = box(60, 70, 40, 60), box(200, 260, 0, 150), box(10, 190, 10, 140)  # 0.02, 0.90, 2.34
WORKED = box(100, 109, 0, 150), box(110, 119, 0, 150)  # 0.27 ha
ZONES = [box(50 * k, 50 * k + 50, 0, 150) for k in range(4)]


def geojson(path, *polygons, names=()):
    features = [
        {"type": "Feature", "properties": {"Name": names[k]} if k < len(names) else None,
         "geometry": {"type": "Polygon", "coordinates": p}}
        for k, p in enumerate(polygons)
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def multi(path, *polygons):
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": list(polygons)}))
    return path


def kml_polygon(outer, *inner, name=""):
    def ring(points):
        places = " ".join(f"{x:.9f},{y:.9f},0" for x, y in points)
        return f"<LinearRing><coordinates>{places}</coordinates></LinearRing>"

    holes = "".join(f"<innerBoundaryIs>{ring(r)}</innerBoundaryIs>" for r in inner)
    around = f"<outerBoundaryIs>{ring(outer)}</outerBoundaryIs>"
    return f"<Placemark><name>{name}</name><Polygon>{around}{holes}</Polygon></Placemark>"


def kml(path, *parts):
    text = f'<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(parts)}</Document></kml>'
    if path.suffix == ".kmz":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
            made.writestr("doc.kml", text)
    else:
        path.write_text(text)
    return path


def shape(path, *records):
    """A polygon shapefile byte by byte, with its rings as they stand (ESRI white paper of 1998)."""
    import struct

    body = b""
    for number, rings in enumerate(records, 1):
        points = [p for ring in rings for p in ring]
        starts = np.cumsum([0, *map(len, rings)])[:-1].tolist()
        west, south = np.min(points, axis=0)
        east, north = np.max(points, axis=0)
        content = struct.pack("<i4d2i", 5, west, south, east, north, len(rings), len(points))
        content += struct.pack(f"<{len(starts)}i", *starts)
        content += b"".join(struct.pack("<2d", *p) for p in points)
        body += struct.pack(">2i", number, len(content) // 2) + content
    head = struct.pack(">7i", 9994, 0, 0, 0, 0, 0, (100 + len(body)) // 2) + struct.pack(
        "<2i8d", 1000, 5, *[0.0] * 8
    )
    path.write_bytes(head + body)
    path.with_suffix(".prj").write_text(
        'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
        'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]'
    )
    return path


def clockwise(ring):
    return ring[::-1]


CASES = {  # file, area in ha, what the user is told
    "KML, one within another as AgOpenGPS writes it": (
        lambda f: kml(f / "a.kml", kml_polygon(HOME), kml_polygon(POND)), 2.80,
        "0.2 ha within the field is an island"
    ),
    "KML, inner boundary": (lambda f: kml(f / "a.kml", kml_polygon(HOME, POND)), 2.80, ""),
    "KML, two islands and ground in one": (
        lambda f: kml(f / "a.kml", *map(kml_polygon, (ISLET, HOME, POND, box(100, 120, 30, 80)))),
        2.70,
        "2 areas of 0.3 ha within the field are islands without crop unused: the field of 2.7 ha is taken",
    ),
    "KML, worked ground in a folder of its own": (
        lambda f: kml(f / "a.kml", f"<Folder>{kml_polygon(HOME)}{kml_polygon(POND)}</Folder>",
                      f"<Folder>{kml_polygon(WORKED[0])}{kml_polygon(WORKED[1])}</Folder>"),
        2.80, "unused: polygons of another folder within the field, 0.27 ha",
    ),
    "KML, two fields": (
        lambda f: kml(f / "a.kml", kml_polygon(HOME, name="Hill"), kml_polygon(BESIDE, name="Dale")),
        3.00, "the field 'Hill' of 3 ha is taken, another area of 1.2 ha is left out: 'Dale'",
    ),
    "KML, a field to a folder": (
        lambda f: kml(f / "a.kml",
        f"<Folder>{kml_polygon(BESIDE)}</Folder><Folder>{kml_polygon(HOME)}</Folder>"),
        3.00, "another area of 1.2 ha is left out",
    ),
    "KMZ, two fields and an island": (
        lambda f: kml(f / "a.kmz", *map(kml_polygon, (HOME, POND, BESIDE))), 2.80,
        "another area of 1.2 ha is left out"
    ),
    "KML with blanks after commas, not closed": (
        lambda f: (f / "a.kml").write_text(
            "<kml><Polygon><outerBoundaryIs><LinearRing><coordinates>"
            + " ".join(f"{x:.9f}, {y:.9f}" for x, y in HOME[:-1])
            + "</coordinates></LinearRing></outerBoundaryIs></Polygon></kml>") and f / "a.kml", 3.00, "",
    ),
    "GeoJSON, MultiPolygon": (lambda f: multi(f / "a.geojson", [HOME], [BESIDE]), 3.00,
        "1.2 ha is left out"),
    "GeoJSON, hole": (lambda f: geojson(f / "a.geojson", [HOME, clockwise(POND)]), 2.80, ""),
    "GeoJSON, one within another": (lambda f: geojson(f / "a.geojson", [POND], [HOME]), 2.80, "is an island"),
    "GeoJSON, a field in the hole of another": (
        lambda f: geojson(f / "a.geojson", [HOME, clockwise(POND)], [ISLET]), 2.80,
        "another area of 0.02 ha is left out"
    ),
    "GeoJSON, the same twice": (lambda f: geojson(f / "a.geojson", [HOME], [HOME]), 3.00, "copies: 1 of 2"),
    "GeoJSON, zones of a field": (lambda f: geojson(f / "a.geojson", *[[z] for z in ZONES]), 3.00,
        "4 polygons that touch"),
    "GeoJSON, a field and its zones": (
        lambda f: geojson(f / "a.geojson", [HOME], *[[z] for z in ZONES]), 3.00, "too large to be islands"
    ),
    "GeoJSON, a field and the line of its headland": (
        lambda f: geojson(f / "a.geojson", [HOME], [INNER]), 3.00, "too large to be islands"
    ),
    "GeoJSON, two that touch": (
        lambda f: geojson(f / "a.geojson", [HOME], [TOUCHING]), 3.90,
        "2 polygons that touch are one field (3 + 0.9 ha)"
    ),
    "GeoJSON, three fields by name": (
        lambda f: geojson(f / "a.geojson", [BESIDE], [HOME], [box(500, 600, 0, 100)], names=("Dale",
        "Hill", "Moor")),
        3.00, "the field 'Hill' of 3 ha is taken, 2 other areas of 2.2 ha are left out",
    ),
    "GeoJSON, GeometryCollection": (
        lambda f: (f / "a.geojson").write_text(json.dumps({"type": "GeometryCollection", "geometries": [
            {"type": "Point", "coordinates": HOME[0]}, {"type": "Polygon", "coordinates": [HOME]},
            {"type": "Polygon", "coordinates": [POND]}]})) and f / "a.geojson", 2.80, "is an island",
    ),
    "GeoJSON, a bow tie": (
        lambda f: geojson(f / "a.geojson", [[HOME[0], HOME[2], HOME[1], HOME[3], HOME[0]]]), 0.75,
        "another area of 0.75 ha is left out",
    ),
    "shapefile, rings as they should be": (lambda f: shape(f / "a.shp", [clockwise(HOME), POND]), 2.80, ""),
    "shapefile, rings the wrong way round": (lambda f: shape(f / "a.shp", [HOME, clockwise(POND)]), 2.80, ""),
    "shapefile, all rings one way": (lambda f: shape(f / "a.shp", [HOME, POND]), 2.80, ""),
    "shapefile, hole before its field": (lambda f: shape(f / "a.shp", [POND, clockwise(HOME)]), 2.80, ""),
    "shapefile, two parts in one record": (
        lambda f: shape(f / "a.shp", [clockwise(HOME), clockwise(BESIDE)]), 3.00, "1.2 ha is left out"
    ),
    "shapefile, two records, one within the other": (
        lambda f: shape(f / "a.shp", [clockwise(HOME)], [clockwise(POND)]), 2.80, "is an island"
    ),
    "shapefile, two fields": (
        lambda f: shape(f / "a.shp", [clockwise(BESIDE)], [clockwise(HOME)]), 3.00, "1.2 ha is left out"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_area_is_true_and_what_is_left_out_is_told(name, tmp_path, capfd):
    make, area, said = CASES[name]
    polygon, notes = read_outlines(make(tmp_path)).field()
    assert polygon.area / 1e4 == pytest.approx(area, rel=2e-3)
    assert said in " ".join(notes) if said else not notes
    assert capfd.readouterr() == ("", "")


def test_records_say_which_field_is_meant(tmp_path):
    found = read_outlines(geojson(tmp_path / "a.geojson", [HOME], [BESIDE]), 32632)
    east, north = ORIGIN.easting, ORIGIN.northing
    places = np.array([[east + 340.0, north + 10.0 * k] for k in range(12)])
    polygon, notes = found.field(places)
    assert polygon.area / 1e4 == pytest.approx(1.20, rel=2e-3)
    assert "another area of 3 ha is left out" in " ".join(notes)


@pytest.mark.parametrize("suffix", [".kml", ".kmz", ".geojson"])
def test_an_outline_that_is_none_is_refused_in_one_line(suffix, tmp_path):
    file = tmp_path / f"a{suffix}"
    for data in (
        b"",
        b"{}",
        b"<kml/>",
        b"PK\x03\x04",
        b"<!DOCTYPE a><kml/>",
        b'{"type": "Point", "coordinates": [1, 2]}',
    ):
        file.write_bytes(data)
        with pytest.raises(InputError, match=f"a{suffix}"):
            read_outlines(file)


FIELDS = {
    "an island": ([[HOME], [POND]], 2.80, 1),
    "a hole": ([[HOME, clockwise(POND)]], 2.80, 1),
    "two fields": ([[HOME], [BESIDE]], 4.20, 2),
}


@pytest.mark.parametrize("name", FIELDS)
def test_a_job_takes_all_outlines_and_leaves_islands_out(name, tmp_path):
    from swath.fleet.files import read_field

    polygons, area, parts = FIELDS[name]
    field = read_field(geojson(tmp_path / "a.geojson", *polygons), 9.0)
    assert sum(a.area for a in field.areas) / 1e4 == pytest.approx(area, rel=2e-3)
    assert len(field.areas) == parts


URN = "urn:ogc:def:crs:EPSG::"
ORDERS = {  # system, north first -> the field lies there, what is said
    ("4326", False): ("here", "then swap its numbers"),
    ("4326", True): ("elsewhere", "the other way round it lies at 48.00"),
    ("3035", True): ("elsewhere", "the other way round it lies at 48.00"),
    ("31468", True): ("here", "as nothing else fits"),
    ("25832", False): ("here", ""),
}


@pytest.mark.parametrize("case", ORDERS)
@pytest.mark.parametrize("of_log", [False, True])
def test_the_order_of_axes_that_a_urn_leaves_open(tmp_path, case, of_log):
    """By the log beside it, else as GeoJSON has it, with the other place named."""
    code, is_flipped = case
    ring = transform(np.array(HOME), "EPSG:4326", f"EPSG:{code}")
    path = geojson(tmp_path / "a.geojson", [(ring[:, ::-1] if is_flipped else ring).tolist()])
    told = json.loads(path.read_text())
    told["crs"] = {"type": "name", "properties": {"name": URN + code}}
    path.write_text(json.dumps(told))
    found = read_outlines(path, ORIGIN.epsg if of_log else None)
    where, said = ORDERS[case]
    if of_log or where == "here":
        assert found.areas[0].area == pytest.approx(30_000, rel=0.01)
        assert found.epsg == ORIGIN.epsg
    if of_log and code in ("4326", "3035"):
        said = "as nothing else fits" if is_flipped else ""
    assert said in " ".join(found.notes)
    assert bool(said) == bool(found.notes)


def strips(path, *, names):
    """Polygons of 120 steps of a header of 9 m, with a yield and other attributes."""
    features = [
        {"type": "Feature", "properties": dict.fromkeys(names, 5.4),
         "geometry": {"type": "Polygon", "coordinates": [box(0, 9, 2 * k, 2 * k + 2)]}}
        for k in range(120)
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_polygons_with_a_yield_each_are_records(tmp_path):
    import shapefile

    with pytest.raises(InputError, match="120 records: expected an outline, each has a yield"):
        read_outlines(strips(tmp_path / "a.geojson", names=("Yield_t_ha", "Moisture")))
    assert len(read_outlines(strips(tmp_path / "b.geojson", names=("Zone", "Moisture"))).areas) == 1
    with shapefile.Writer(str(tmp_path / "c.shp"), shapeType=shapefile.POLYGON) as file:
        file.field("Yield_t_ha", "N", 12, 4)
        for k in range(120):
            file.poly([box(0, 9, 2 * k, 2 * k + 2)])
            file.record(5.4)
    assert not is_outline(tmp_path / "c.shp")
    columns, points, *_ = read_points(tmp_path / "c.shp", "log")
    assert columns["Yield_t_ha"] == [5.4] * 120
    np.testing.assert_allclose(ORIGIN.to_local(points[:2]), [(4.5, 1.0), (4.5, 3.0)], atol=1e-3)


def test_an_outline_alone_says_where_it_crosses_itself_and_draws_no_records(tmp_path, capsys, monkeypatch):
    from matplotlib.figure import Figure

    drawn = []
    made = Figure.add_subplot
    monkeypatch.setattr(Figure, "add_subplot", lambda *a, **k: drawn.append(a) or made(*a, **k))
    ring = [[10.45, 52.28], [10.453, 52.283], [10.453, 52.28], [10.45, 52.282], [10.45, 52.28]]
    path = tmp_path / "bow.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    line = ["field", "import", str(path), "--header-width-m", "9"]
    assert main([*line, "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr()
    assert "an outline crosses itself at 598 998, 5 793 307" in told.out
    assert "function test" not in told.out
    assert len(drawn) == 2
    path.write_text("{")
    assert main([*line, "--out", str(tmp_path / "no")]) == 2
    assert capsys.readouterr().err.startswith("swath: ")  # no empty line before it
