"""Maps in UTM serve without a field folder: the middle of the first is the world's origin."""

import numpy as np
import pytest

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.maps.raster import Raster
from swath.runtime.field_setup import build_field
from swath.scenario.scenario import parse_scenario

TEXT = """
format: swath scenario 2
field:
  terrain: {level: dem, file: dem.tif}
  stand: {level: maps, density_file: density.tif}
  edge: {shape: straight}
machines:
  combine: {speed: {speed_kmh: 5}}
"""
EAST, NORTH = 564000.0, 5712000.0


def ground(folder, text=TEXT):
    section = parse_scenario(text, base=folder).field
    return build_field(section, stream=Stream(1, "field"), base=folder)


@pytest.fixture
def maps(tmp_path):
    """Heights that rise 1 in 100 to the east from 200 m; 300 stems/m2 in the west, 600 in the east."""
    x = np.broadcast_to(np.arange(100, dtype=np.float32), (80, 100))
    Raster(200.0 + 0.01 * x, EAST, NORTH, 1.0).to_geotiff(tmp_path / "dem.tif", 32632)
    density = np.where(x < 50, 300.0, 600.0).astype(np.float32)
    Raster(density, EAST, NORTH, 1.0).to_geotiff(tmp_path / "density.tif", 32632)
    return tmp_path


def test_the_middle_of_the_map_is_the_origin(maps):
    made = ground(maps)
    assert made.origin is not None
    assert (made.origin.epsg, made.origin.easting, made.origin.northing) == (32632, EAST + 50, NORTH + 40)
    assert made.origin.height == pytest.approx(200.5, abs=0.01)
    heights = made.field.terrain.height(np.array([-30.0, 30.0]), np.zeros(2))
    assert heights[1] - heights[0] == pytest.approx(0.6, abs=0.01)
    assert list(made.field.covers(np.array([-49.0, 49.0, 60.0]), np.zeros(3))) == [True, True, False]
    lon_lat = made.origin.to_lon_lat([[0.0, 0.0]])[0]
    assert made.origin.to_local([lon_lat])[0] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_maps_in_two_systems_are_refused(maps):
    Raster(np.full((80, 100), 300.0, np.float32), EAST, NORTH, 1.0).to_geotiff(maps / "density.tif", 32633)
    with pytest.raises(InputError, match=r"field\.stand\.density_file = EPSG:32633: expected EPSG:32632"):
        ground(maps)


def test_a_map_in_the_scenarios_own_metres_stays_where_it_is(maps):
    Raster(np.zeros((80, 100), np.float32), 0.0, -10.0, 1.0).to_geotiff(maps / "dem.tif", 32632)
    made = ground(maps, TEXT.replace("density_file: density.tif", "crop: wheat"))
    assert made.origin is None
    assert bool(made.field.covers(90.0, 0.0))
