"""Terrain: a slope of 4 %. Stand: wheat of 400 stems/m2, cut."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.maps.raster import Raster
from swath.field.stand import uniform
from swath.field.stand.bands import Band
from swath.field.terrain import plane
from tests.field.made_field import CROP, STREAM, library, made_field, rectangle
from tests.levels.limits import each_level, make

DENSITY = 400.0


@each_level("terrain")
def test_heights_of_a_slope(level, limit, tmp_path):
    params = {"slope_percent": 4.0, "slope_azimuth_deg": 90.0}
    if level == "formula":
        params["roughness_class"] = "none"
    elif level == "dem":
        east, _ = np.meshgrid(np.arange(101.0) - 50.0, np.arange(101.0) - 50.0)
        file = tmp_path / "slope.tif"
        Raster((0.04 * east).astype(np.float32), -50.0, -50.0, 1.0).to_geotiff(file, 32632)
        params = {"file": str(file), "datum_m": 0.0}
    terrain = make("terrain", level, FieldSetup(STREAM), **params)
    x, y = np.random.default_rng(1).uniform(-40.0, 40.0, (2, 200))
    assert np.abs(terrain.height(x, y) - 0.04 * x).max() <= limit


@each_level("stand")
def test_what_an_even_stand_yields(level, limit):
    """A level that can do more grows the same stems as `uniform` where nothing changes."""
    params = {"stems_per_m2": DENSITY}
    if level == "bands":
        params["bands"] = (Band(5.0, DENSITY),)
    setup = FieldSetup(Stream(7, "field"))
    stand = make("stand", level, setup, **params)
    field = make_field(
        plane.Plane(plane.Params(), setup),
        stand,
        make_edge(StraightEdge(), setup),
        crop=CROP,
        library=library(DENSITY),
        stream=setup.stream,
    )
    place = rectangle(2.0, 1.0, 14.0, 11.0)
    cut, reference = field.cut(place, 0.15), even().cut(place, 0.15)
    assert cut.stem_count == pytest.approx(DENSITY * 120.0, rel=0.03)
    assert abs(cut.stem_count - reference.stem_count) <= limit
    assert cut.grain == pytest.approx(reference.grain, rel=1e-12)


def even():
    return made_field(stand=uniform.Params(stems_per_m2=DENSITY))
