"""Maps of fields of other people: what is read of drawn ones, and what things say that they are."""

import json
import math
import zipfile

import numpy as np
import pytest

pytest.importorskip("rasterio")
pytest.importorskip("shapefile")

from swath.core.errors import InputError
from swath.documents.reasons import doubts, key_of
from swath.field.maps.projection import origin_at, transform
from swath.field_io.importer import Settings, import_log
from swath.field_io.outline import read_outlines
from swath.field_io.roles import BARE, FIELD, LINE, OTHER, PART, UNKNOWN, named, role_of
from swath.fleet.files import read_field
from tests.readers.drawn_jobs import draw, read
from tests.readers.verdict import verdict, without_key

ORIGIN = origin_at(48.0, 11.0)
HOME = [(0, 0), (200, 0), (200, 150), (0, 150), (0, 0)]
KML = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'


@pytest.mark.parametrize("seed", range(400, 415))
def test_a_drawn_map_is_read_truly_or_told_by_its_cause(seed):
    found = verdict(draw(seed), read)
    assert found.is_good, "\n".join(found.lines())
    assert not without_key([why.removeprefix("note: ") for why in found.why if why.startswith("note: ")])


SAID = {
    FIELD: [{"landuse": "farmland"}, {"Nutzung": "Acker"}, {"crop": "Winter wheat"}, {"fclass": "meadow"},
            {"kind": "field", "natural": "water"}],
    BARE: [{"highway": "track", "type": "way"}, {"kind": "Ponds"}, {"building": "yes"}, {"water": "Pond"},
           {"highway": "track", "type": "some word"}, {"fclass": "primary"}, {"highway": "residential"},
           {"power": "substation"}, {"building": 1}],
    LINE: [{"type": "AB_Line"}],
    PART: [{"type": "treatment zone"}],
    OTHER: [{"kind": "headland"}],
    UNKNOWN: [{"kind": "silage film"}, {"type": "Primary"}, {"crop": "Wood"}],
    "": [{}, {"name": "Am Feldweg"}, {"type": "Polygon"}, {"layer": "field"}, {"kind": None}, {"type": 3},
         {"building": "no"}, {"boundary": "yes"}, {"name": "Pond 2"}, {"folder": "Zones"}, {"layer": "zone"},
         {"water": 0}, {"water": 0.0}, {"building": "0"}, {"building": False}, {"power": "irrigated"},
         {"water": "none"}, {"highway": ""}],
}  # fmt: skip


@pytest.mark.parametrize("role", SAID)
def test_what_a_thing_says_makes_its_role(role):
    assert [role_of(said)[0] for said in SAID[role]] == [role] * len(SAID[role])


@pytest.mark.parametrize(
    ("said", "role"),
    [({"folder": "Guidance lines"}, LINE), ({"name": "AB 12"}, LINE), ({"name": "Pond 2"}, BARE), ({}, "")],
)
def test_a_name_says_what_a_line_is(said, role):
    assert named(said)[0] == role


def lon_lat(points):
    return ORIGIN.to_lon_lat(points).tolist()


def features(path, *things, **more):
    """kind, points [m] and properties of each."""
    made = [
        {"type": "Feature", "properties": said,
         "geometry": {"type": kind, "coordinates": [lon_lat(at)] if kind == "Polygon" else lon_lat(at)}}
        for kind, at, said in things
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": made, **more}))
    return path


def area(field):
    return sum(a.area for a in field.areas) / 1e4


@pytest.mark.parametrize(
    ("line", "said", "turn"),
    [
        ([(20, 20), (90, 60)], {}, 29.7),
        ([(20, 20), (90, 60)], {"kind": "road"}, None),
        ([(20, 20), (90, 60)], {"kind": "silage film"}, None),
        ([(20, -80), (90, -40)], {}, None),
        ([(20, -80), (90, -40)], {"type": "AB line"}, 29.7),
    ],
)
def test_a_line_turns_the_passes_by_what_it_says_else_by_where_it_lies(tmp_path, line, said, turn):
    field = read_field(features(tmp_path / "a.json", ("Polygon", HOME, {}), ("LineString", line, said)), 9.0)
    is_told = any(note.startswith("unused: ") for note in field.notes)
    assert is_told == (turn is None)
    if turn is None:
        assert math.isnan(field.direction)
    else:
        assert math.degrees(field.direction) == pytest.approx(turn, abs=0.1)


@pytest.mark.parametrize(("word", "left", "doubt"), [
    ("pond", 2.4, []), ("silage film", 3.0, ["lost"]), ("field", 3.0, ["sources"]),
])  # fmt: skip
def test_an_area_in_a_field_is_what_it_says(tmp_path, word, left, doubt):
    inner = [(20, 20), (120, 20), (120, 80), (20, 80), (20, 20)]
    path = features(
        tmp_path / "a.json", ("Polygon", HOME, {"kind": "field"}), ("Polygon", inner, {"kind": word})
    )
    field = read_field(path, 9.0)
    assert area(field) == pytest.approx(left, rel=1e-3)
    assert doubts(field.notes) == doubt


@pytest.mark.parametrize(
    "said",
    [*({"name": name} for name in ("Quarry", "Pond", "River", "House", "Weg 3", "Zone 2", "Pass")),
     {"folder": "Zones"}, {"folder": "Tracks"}, {"layer": "zone"}, {"type": "Zone"}, {"type": "Primary"},
     {"crop": "Wood"}, {"water": 0}, {"power": "irrigated"}],
)  # fmt: skip
def test_the_only_area_is_the_field_whatever_its_name(tmp_path, said):
    path = features(tmp_path / "a.json", ("Polygon", HOME, said))
    (found,), notes = read_field(path, 9.0).areas, read_field(path, 9.0).notes
    assert found.area == pytest.approx(3e4, rel=1e-3)
    assert not doubts(notes)


BESIDE = [(320, 0), (420, 0), (420, 100), (320, 100), (320, 0)]
OVER = [(195, 0), (300, 0), (300, 100), (195, 100), (195, 0)]


@pytest.mark.parametrize(("first", "ring", "second", "taken", "doubt"), [
    ({"name": "Quarry"}, BESIDE, {"name": "Home"}, 3.0, ["sources"]),
    ({"name": "Home"}, BESIDE, {"name": "Pond"}, 3.0, []),
    ({"name": "Home"}, OVER, {"name": "Pond"}, 4.0, ["sources"]),
    ({"name": "Home"}, OVER, {"kind": "pond"}, 2.95, []),
    ({"name": "Pond"}, BESIDE, {"name": "Quarry"}, 3.0, []),
    ({"crop": "Wheat"}, BESIDE, {"crop": "Ginseng"}, 3.0, ["lost"]),
])  # fmt: skip
def test_a_name_takes_no_field_and_is_told(tmp_path, first, ring, second, taken, doubt):
    found = read_outlines(features(tmp_path / "a.json", ("Polygon", HOME, first), ("Polygon", ring, second)))
    field, notes = found.field()
    assert field.area == pytest.approx(1e4 * taken, rel=1e-3)
    assert doubts(notes) == doubt
    if ring is BESIDE and len(found.areas) == 2:  # the places of a log settle it
        inner = np.array(field.representative_point().coords)
        assert not doubts(found.field(inner)[1])


def test_of_a_job_all_fields_are_worked_and_a_pond_by_name_among_them_is_told(tmp_path):
    path = features(
        tmp_path / "a.json", ("Polygon", HOME, {"name": "Home"}), ("Polygon", BESIDE, {"name": "Pond"})
    )
    field = read_field(path, 9.0)
    assert area(field) == pytest.approx(4.0, rel=1e-3)
    assert doubts(field.notes) == ["sources"]


def test_words_of_a_shapefile_in_utf_8_are_known_without_a_cpg(tmp_path):
    import shapefile

    with shapefile.Writer(str(tmp_path / "a.shp"), shapeType=shapefile.POLYGON) as file:
        file.field("art", "C", 150)
        for word, ring in (("Acker", HOME), ("Straße", [(-9, 60), (210, 60), (210, 70), (-9, 70), (-9, 60)])):
            file.poly([lon_lat(ring)])
            file.record(word)
    assert sum(a.area for a in read_outlines(tmp_path / "a.shp").areas) == pytest.approx(28_000, rel=1e-3)


def test_a_closed_line_alone_is_an_outline_and_lines_of_other_kinds_are_none(tmp_path):
    assert area(read_field(features(tmp_path / "a.json", ("LineString", HOME, {})), 9.0)) == pytest.approx(
        3.0
    )
    with pytest.raises(InputError, match="tramline line: expected an area, or lines of passes") as error:
        read_field(features(tmp_path / "b.json", ("LineString", HOME[:2], {"kind": "tramline"})), 9.0)
    assert error.value.key == "unused"


def test_lines_of_kml_are_guidance_by_their_folder(tmp_path):
    def text(points):
        return f"<coordinates>{' '.join(f'{x:.9f},{y:.9f}' for x, y in lon_lat(points))}</coordinates>"

    ring = f"<outerBoundaryIs><LinearRing>{text(HOME)}</LinearRing></outerBoundaryIs>"
    line = f"<Placemark><LineString>{text([(0, 0), (0, 100)])}</LineString></Placemark>"
    made = f"<Placemark><Polygon>{ring}</Polygon></Placemark><Folder><name>AB Lines</name>{line}</Folder>"
    (tmp_path / "a.kml").write_text(KML.format(made))
    field = read_field(tmp_path / "a.kml", 9.0)
    assert math.degrees(field.direction) == pytest.approx(90.0)
    assert area(field) == pytest.approx(3.0, rel=1e-3)


def test_a_trace_of_two_rounds_is_its_field_and_is_told(tmp_path):
    again = [(1, 1), (201, -1), (199, 151), (-1, 149), (0, 0)]
    field = read_field(features(tmp_path / "a.json", ("Polygon", HOME[:-1] + again, {})), 9.0)
    assert area(field) == pytest.approx(3.0, rel=0.02)
    assert doubts(field.notes) == ["outline"]
    bridge = [(90, 150), (90, 80), (90, 30), (50, 30), (50, 80), (90, 80), (90, 150)]
    field = read_field(features(tmp_path / "b.json", ("Polygon", HOME[:3] + bridge + HOME[3:], {})), 9.0)
    assert area(field) == pytest.approx(2.8, rel=1e-3)
    assert not doubts(field.notes)


SYSTEMS = {"EPSG:32632": "EPSG:32632", "OGC:CRS84": "EPSG:4326", "EPSG:2249": "EPSG:32632", "": "EPSG:32632",
           "EPSG:25832": "EPSG:4326"}  # fmt: skip


@pytest.mark.parametrize("crs", SYSTEMS)
def test_places_lie_where_their_system_is_used(tmp_path, crs):
    """2249 counts in feet, and lies in Massachusetts; the last is of degrees that are said to be metres."""
    ring = transform(np.array(lon_lat(HOME)), "EPSG:4326", SYSTEMS[crs]).tolist()
    shape = {"type": "Polygon", "coordinates": [ring], "crs": {"type": "name", "properties": {"name": crs}}}
    (tmp_path / "a.json").write_text(json.dumps(shape))
    if crs in ("EPSG:32632", "OGC:CRS84"):
        assert read_outlines(tmp_path / "a.json").areas[0].area == pytest.approx(3e4, rel=1e-3)
    else:
        with pytest.raises(InputError) as error:
            read_outlines(tmp_path / "a.json")
        assert error.value.key == "place"


@pytest.mark.parametrize(
    ("crs", "lon", "lat", "key"),
    [("EPSG:25833", 5.7, 58.8, "place"), ("EPSG:25833", 30.9, 70.3, "place"),
     ("EPSG:32632", 18.4, 40.4, "place"), ("EPSG:32633", 29.0, 45.0, "place"),
     ("EPSG:25832", 15.0, 55.1, ""), ("EPSG:31467", 11.5, 48.5, "")],
)  # fmt: skip
def test_a_zone_that_is_kept_for_a_whole_country_is_read_and_told_where_far(tmp_path, crs, lon, lat, key):
    corner = transform([[lon, lat]], "EPSG:4326", crs)[0]
    ring = (np.array(HOME) + corner).tolist()
    shape = {"type": "Polygon", "coordinates": [ring], "crs": {"type": "name", "properties": {"name": crs}}}
    (tmp_path / "a.json").write_text(json.dumps(shape))
    found = read_outlines(tmp_path / "a.json")
    assert found.areas[0].area == pytest.approx(3e4, rel=0.05)
    assert doubts(found.notes) == [key] * bool(key)
    at = transform(np.array(found.areas[0].centroid.coords), f"EPSG:{found.epsg}", "EPSG:4326")[0]
    assert at == pytest.approx((lon, lat), abs=0.02)


def test_numbers_of_another_zone_of_gauss_krueger_and_north_first_are_refused_or_told(tmp_path):
    for name, of, turned in (("EPSG:31467", "EPSG:31468", False), ("EPSG:25833", "EPSG:25833", True)):
        ring = transform(np.array(lon_lat(HOME)), "EPSG:4326", of)[:, :: -1 if turned else 1].tolist()
        shape = {"type": "Polygon", "coordinates": [ring]}
        path = tmp_path / f"{turned}.json"
        path.write_text(json.dumps({**shape, "crs": {"type": "name", "properties": {"name": name}}}))
        if turned:
            assert [key_of(note) for note in read_outlines(path).notes] == ["reference"]
        else:
            with pytest.raises(InputError, match="expected places in") as error:
                read_outlines(path)
            assert error.value.key == "place"


@pytest.mark.parametrize("is_area", [False, True])
def test_features_with_a_yield_each_are_a_log(tmp_path, is_area):
    rows = [(9.0 * p, 2.0 * i if p % 2 == 0 else 200.0 - 2.0 * i) for p in range(6) for i in range(101)]
    made = []
    for n, (x, y) in enumerate(rows):
        around = [(x - 4.5, y - 1), (x + 4.5, y - 1), (x + 4.5, y + 1), (x - 4.5, y + 1), (x - 4.5, y - 1)]
        at = {"type": "Polygon", "coordinates": [lon_lat(around)]} if is_area else {
            "type": "Point", "coordinates": lon_lat([(x, y)])[0]}  # fmt: skip
        said = {"time": n + 20.0 * (n // 101), "yield_t_ha": 6.0, "width_m": 9.0}
        made.append({"type": "Feature", "properties": said, "geometry": at})
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": made}))
    report = import_log(path, tmp_path / "f", settings=Settings(crop="wheat"), progress=False)
    assert report.field["area_ha"] == pytest.approx(6 * 9 * 200 / 1e4, rel=0.03)
    with pytest.raises(InputError, match="606 records: expected an outline, each has a yield"):
        read_outlines(path)


def packed(path, name):
    with zipfile.ZipFile(path, "w") as made:
        made.writestr(name, "x")


FOREIGN = {
    "a.gpx": ("<gpx><trk/></gpx>", "GPX"), "a.wkt": ("POLYGON ((11 48, 11 49, 12 49, 11 48))", "WKT"),
    "a.geojson": ('{"geometryType": "esriGeometryPolygon", "features": []}', "Esri JSON"),
    "b.json": ('{"type": "Topology", "objects": {}}', "TopoJSON"), "a.gml": ("<gml:Polygon/>", "GML"),
    "a.xlsx": ("xl/workbook.xml", "an Excel workbook"), "a.zip": ("log.csv", "a zip archive with a table"),
    "c.json": ('{"type": "Point", "coordinates": [11, 48]}', "it has point alone; for a log export CSV"),
}  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_another_kind_is_refused_by_its_name(tmp_path, name):
    content, said = FOREIGN[name]
    path = tmp_path / name
    packed(path, content) if name in ("a.xlsx", "a.zip") else path.write_text(content)
    for reader in (lambda: read_outlines(path), lambda: import_log(path, tmp_path / "f", progress=False)):
        with pytest.raises(InputError, match=said):
            reader()


def test_every_note_of_an_outline_carries_a_key(tmp_path):
    inner = [(30, 30), (60, 30), (60, 60), (30, 60), (30, 30)]
    bow = [(x + 400, y) for x, y in (HOME[0], HOME[2], HOME[1], HOME[3], HOME[0])]
    path = features(
        tmp_path / "a.json", ("Polygon", HOME, {}), ("Polygon", HOME, {}), ("Polygon", inner, {}),
        ("Polygon", bow, {}), ("LineString", [(-50, -50), (-20, -50)], {"highway": "track"}),
    )  # fmt: skip
    _, notes = read_outlines(path).field()
    assert {key_of(note) for note in notes} == {"copies", "outline", "shape", "unused"}
