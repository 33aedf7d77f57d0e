"""Rays through a field as runs make it: rough terrain, lodged patches, a cut strip with straw."""

import numpy as np
import pytest

from swath.field.memory_layout import Organ
from swath.field.stand import maps
from swath.field.terrain import formula
from swath.rays.engine import RayCaster
from tests.field.made_field import made_field, rectangle
from tests.rays.reference import cast_slowly

COUNT = 100


@pytest.fixture(scope="module")
def field():
    stand = maps.Params(
        stems_per_m2=300.0,
        row_azimuth_deg=20.0,
        lean_deg=8.0,
        patches=(maps.Patch(x_m=6.0, y_m=8.0, radius_m=2.5, lean_deg=55.0),),
        density_variation=maps.Variation(),
        height_variation=maps.Variation(),
    )
    made = made_field(terrain=formula.Params(slope_percent=4.0, roughness_class="C"), stand=stand)
    made.ensure(5.0, 6.0, 12.0)
    made.cut(rectangle(3.0, 0.0, 5.0, 9.0), 0.15)
    made.deposit_straw(rectangle(3.5, 0.0, 4.5, 8.0), 6.0)
    return made


def rays(field):
    """World rays from 2.5 to 3.5 m above points of the field, to any side, 15 to 80 deg down."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(2, 8, COUNT), rng.uniform(3, 10, COUNT)
    azimuth, depression = rng.uniform(-np.pi, np.pi, COUNT), np.radians(rng.uniform(25, 80, COUNT))
    d = np.c_[np.cos(azimuth), np.sin(azimuth), -np.tan(depression)] * np.cos(depression)[:, None]
    o = np.c_[x, y, np.asarray(field.ground_height(x, y)) + rng.uniform(1.2, 2.5, COUNT)]
    return o, d


def turned(vectors, angle):
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]).T


def test_the_same_as_every_primitive(field):
    o, d = rays(field)
    hits = RayCaster(field, threads=1).cast(o, d, range_max=7.0)
    yaw = field.stand_yaw
    distance, organ = cast_slowly(field.library, field.pages, turned(o, -yaw), turned(d, -yaw), 7.0)
    organ = np.where((organ == Organ.GROUND) & (hits.organ == Organ.STRAW), Organ.STRAW, organ)
    np.testing.assert_array_equal(hits.organ, organ)
    np.testing.assert_allclose(hits.distance, distance, atol=2e-5, equal_nan=True)
    assert {Organ.EAR, Organ.STEM, Organ.LEAF, Organ.GROUND} <= set(hits.organ)


def test_ground_hits_lie_on_the_ground_of_the_field(field):
    rng = np.random.default_rng(2)
    x, y = rng.uniform(3.1, 4.9, 800), rng.uniform(1, 8.5, 800)
    o = np.c_[x, y, np.full(800, 3.0)]
    hits = RayCaster(field, threads=1).cast(o, np.broadcast_to([0.0, 0.0, -1.0], o.shape), range_max=9.0)
    soil = hits.organ == Organ.GROUND
    assert soil.sum() > 100
    z = o[:, 2] - hits.distance
    error = z - np.asarray(field.ground_height(x, y))
    assert np.abs(error[soil]).max() < 0.0051  # straw thinner than 5 mm still shows the soil
    assert np.median(np.abs(error[soil])) < 1e-5
    straw = hits.organ == Organ.STRAW
    assert straw.sum() > 50
    assert error[straw].min() > 0.0049
    assert error[np.isin(hits.organ, [Organ.STUBBLE])].max() < 0.19
