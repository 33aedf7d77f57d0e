"""Guidance lines of a GeoJSON file."""

import json

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.maps.projection import origin_at
from swath.runtime.assembly import read_line

ORIGIN = origin_at(52.3, 10.4)
LINES = [[[0.0, 0.0], [100.0, 3.0]], [[5.0, 5.0], [5.0, 60.0], [20.0, 90.0]]]


@pytest.fixture
def file(tmp_path):
    world = [ORIGIN.to_lon_lat(line).tolist() for line in LINES]
    point = {"type": "Feature", "properties": None, "geometry": {"type": "Point", "coordinates": world[0][0]}}
    shapes = [
        {"type": "LineString", "coordinates": world[0]},
        {"type": "MultiLineString", "coordinates": [world[1], world[0]]},
    ]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    path = tmp_path / "lines.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [point, *features]}))
    return str(path)


def test_lines_are_counted_in_the_order_of_the_file(file):
    for index, line in enumerate([*LINES, LINES[0]]):
        assert np.allclose(read_line(ORIGIN, file, index), line, atol=1e-6)


def test_what_cannot_be_read_is_one_error(file, tmp_path):
    with pytest.raises(InputError, match="less than the 3 lines"):
        read_line(ORIGIN, file, 3)
    with pytest.raises(InputError, match="lies on Earth"):
        read_line(None, file, 0)
    broken = tmp_path / "broken.geojson"
    broken.write_text("{")
    with pytest.raises(InputError, match=r"broken\.geojson"):
        read_line(ORIGIN, str(broken), 0)
