"""What is wrong in a field folder is said with key, value, expectation, file and line."""

import pytest

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.field_io.folder import read, read_origin
from tests.fuzz.kinds import KINDS

WRONG = [
    ("field.yaml", "easting_m: 533000.0", "easting_m: abc", "origin.easting_m = abc: expected a number in m"),
    ("field.yaml", "row_azimuth_deg", "row_azimut_deg", "row_azimuth_deg: expected a value"),
    ("field.yaml", "EPSG:32612", "EPSG:x", "crs = EPSG:x: expected"),
    ("field.yaml", "version: 1", "version: 2", "version = 2: expected one of 1"),
    ("tracks.geojson", '"azimuth_deg":', '"azimth_deg":', "features.0.properties.azimuth_deg: expected"),
    ("tracks.geojson", "LineString", "Point", "features.0.geometry.type = Point: expected one of LineString"),
    ("tracks.geojson", '"first":0', '"first":900', "expected first and last among the points"),
    ("boundary.geojson", "Polygon", "MultiPolygon", "features.0.geometry.type = MultiPolygon: expected"),
    ("boundary.geojson", '"features":[', '"features":[1,', "features.0 = 1: expected a mapping"),
    ("obstacles.geojson", '"coordinates":[', '"coordinates":["a",', "coordinates.0 = a: expected a number"),
]


@pytest.fixture
def folder(tmp_path):
    KINDS["field-folder"].make(tmp_path)
    return tmp_path / "field"


@pytest.mark.parametrize(("name", "old", "new", "said"), WRONG)
def test_every_entry_is_named(folder, name, old, new, said):
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read(folder)
    assert said in str(caught.value)
    assert name in str(caught.value)


def test_an_error_of_field_yaml_has_its_line(folder):
    file = folder / "field.yaml"
    lines = file.read_text().splitlines()
    number = next(i for i, line in enumerate(lines, 1) if "northing_m" in line)
    lines[number - 1] = lines[number - 1].replace("northing_m: ", "northing_m: north # ")
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=rf"origin\.northing_m = north: expected .*field\.yaml:{number}\)"):
        read_origin(folder)
