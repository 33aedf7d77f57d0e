"""Task data without a yield, and boundaries of KML, make a field too."""

import json
import zipfile

import numpy as np
import pytest

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.field_io import folder
from swath.field_io.importer import Settings, import_log
from swath.field_io.outline import read_outlines
from swath.field_io.pass_scenario import write_pass_scenario
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario

PLAN = """<?xml version="1.0" encoding="UTF-8"?>
<ISO11783_TaskData VersionMajor="4" VersionMinor="2" DataTransferOrigin="1">
  <CTP A="CTP1" B="{crop}"/>
  <DVC A="DVC-1" B="Sprayer"><DPT A="1" B="0043" C="{width}" D="boom"/></DVC>
  <PFD A="PFD1" C="Hill" D="40000" G="CTP1">
    <PLN A="1">
      <LSG A="1"><PNT A="2" C="52.000" D="9.000"/><PNT A="2" C="52.004" D="9.000"/>
      <PNT A="2" C="52.004" D="9.003"/><PNT A="2" C="52.000" D="9.003"/></LSG>
      <LSG A="2"><PNT A="2" C="52.001" D="9.0022"/><PNT A="2" C="52.0015" D="9.0022"/>
      <PNT A="2" C="52.0015" D="9.0027"/><PNT A="2" C="52.001" D="9.0027"/></LSG>
    </PLN>
    <GGP A="GGP1"><GPN A="GPN1" C="1">
      <LSG A="5"><PNT A="6" C="52.001" D="9.001"/><PNT A="7" C="52.003" D="9.001"/></LSG>
    </GPN></GGP>
  </PFD>
  <PFD A="PFD2" C="Small" D="100"><PLN A="1"><LSG A="1"><PNT A="2" C="52.1" D="9.0"/>
  <PNT A="2" C="52.1005" D="9.0"/><PNT A="2" C="52.1005" D="9.0005"/></LSG></PLN></PFD>
</ISO11783_TaskData>
"""
NORTH_M, EAST_M = 111_266.0, 68_679.0  # of a degree at 52 deg N, WGS 84


def taskdata(path, *, crop="Winterweizen", width="9000"):
    path.mkdir()
    (path / "TASKDATA.XML").write_text(PLAN.format(crop=crop, width=width))
    return path


def test_boundary_guidance_line_and_width_of_a_sprayers_task_data_make_a_field(tmp_path):
    report = import_log(taskdata(tmp_path / "TASKDATA"), tmp_path / "f", progress=False)
    whole = 0.004 * NORTH_M * 0.003 * EAST_M
    hole = 0.0005 * NORTH_M * 0.0005 * EAST_M
    assert report.field["area_ha"] * 1e4 == pytest.approx(whole - hole, rel=2e-3)
    assert any("2 fields in it: the largest is taken, Hill" in note for note in report.notes)
    assert "\n".join(a + b + c for a, b, c in report.lines())
    field = folder.read(tmp_path / "f")
    assert field.crop == "wheat"
    assert len(field.holes) == 1
    (track,) = field.tracks
    assert track.header_width == 9.0
    assert track.length == pytest.approx(0.004 * NORTH_M, rel=2e-3)
    assert np.nanmin(field.stems.values) == np.nanmax(field.stems.values) == 500.0
    scenario = load_scenario(
        write_pass_scenario(tmp_path / "f"), sets=["combine.lidar=off", "combine.edge=truth"]
    )
    assert scenario.run.distance_m == 150.0
    assemble(scenario).close()


def test_a_plan_of_an_unknown_crop_or_without_a_width_asks_for_it(tmp_path):
    data = taskdata(tmp_path / "TASKDATA", crop="Hopfen", width="0")
    with pytest.raises(InputError, match=r"crop = Hopfen: expected one of wheat"):
        import_log(data, tmp_path / "f", progress=False)
    with pytest.raises(InputError, match="--header-width-m"):
        import_log(data, tmp_path / "f", settings=Settings(crop="barley"), progress=False)
    import_log(data, tmp_path / "f", settings=Settings(crop="barley", header_width_m=6.0), progress=False)
    assert folder.read(tmp_path / "f").crop == "barley"


KML = """<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
<name>Hill</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
9.0,52.0,0 9.003,52.0,0 9.003,52.004,0 9.0,52.004,0 9.0,52.0,0</coordinates></LinearRing></outerBoundaryIs>
<innerBoundaryIs><LinearRing><coordinates>9.001,52.001 9.0015,52.001 9.0015,52.0015 9.001,52.001</coordinates>
</LinearRing></innerBoundaryIs></Polygon></Placemark></Document></kml>"""


def test_a_boundary_that_lies_in_no_one_place_is_refused(tmp_path):
    file = taskdata(tmp_path / "TASKDATA") / "TASKDATA.XML"
    file.write_text(file.read_text().replace('C="52.004" D="9.003"', 'C="5e300" D="9.003"'))
    with pytest.raises(InputError, match="of one field"):
        import_log(file.parent, tmp_path / "f", progress=False)


@pytest.mark.parametrize("name", ["b.kml", "b.kmz", "b.geojson", "b.shp"])
def test_an_outline_alone_makes_a_field_of_an_even_crop(tmp_path, name):
    path = tmp_path / name
    corners = [[9.0, 52.0], [9.003, 52.0], [9.003, 52.004], [9.0, 52.004], [9.0, 52.0]]
    hole = [[9.001, 52.001], [9.0015, 52.001], [9.0015, 52.0015], [9.001, 52.001]]
    path.write_text(KML)
    if name == "b.kmz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("doc.kml", KML)
    elif name == "b.geojson":
        path.write_text(json.dumps({"type": "Polygon", "coordinates": [corners, hole]}))
    elif name == "b.shp":
        shapefile = pytest.importorskip("shapefile")
        with shapefile.Writer(path, shapeType=shapefile.POLYGON) as made:
            made.field("name", "C")
            made.poly([corners[::-1], hole])
            made.record("Hill")
    with pytest.raises(InputError, match="--header-width-m"):
        import_log(path, tmp_path / "f", progress=False)
    settings = Settings(crop="rye", header_width_m=9.0)
    report = import_log(path, tmp_path / "f", settings=settings, progress=False)
    expected = NORTH_M * EAST_M * (0.004 * 0.003 - 0.5 * 0.0005**2)
    assert report.field["area_ha"] * 1e4 == pytest.approx(expected, rel=2e-3)
    field = folder.read(tmp_path / "f")
    assert (field.crop, len(field.holes), field.tracks) == ("rye", 1, ())
    write_pass_scenario(tmp_path / "f")


def test_a_boundary_may_be_kml_or_kmz(tmp_path):
    (tmp_path / "b.kml").write_text(KML)
    with zipfile.ZipFile(tmp_path / "b.kmz", "w") as archive:
        archive.writestr("doc.kml", KML)
    expected = NORTH_M * EAST_M * (0.004 * 0.003 - 0.5 * 0.0005**2)
    for name in ("b.kml", "b.kmz"):
        assert read_outlines(tmp_path / name, 32632).areas[0].area == pytest.approx(expected, rel=2e-3)
    (tmp_path / "bad.kml").write_text(KML.replace("9.003,52.0,0", "here"))
    with pytest.raises(InputError, match="GeoJSON, KML or a polygon shapefile"):
        read_outlines(tmp_path / "bad.kml", 32632).areas[0]
