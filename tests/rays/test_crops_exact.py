"""Rays through one prototype of every crop against the plain float64 test of all its primitives."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.field.crop_sheet import Weeds, load_crop, weed_crop
from swath.field.memory_layout import Organ
from swath.field.prototypes import make_library
from swath.rays.engine import RayCaster
from tests.rays.hand_field import HandField, make_pages
from tests.rays.reference import cast_slowly

COUNT = 60
CROPS = {
    "barley": (150.0, {Organ.AWN, Organ.EAR, Organ.STEM}),
    "rye": (120.0, {Organ.EAR, Organ.STEM, Organ.LEAF}),
    "rape": (12.0, {Organ.POD, Organ.BRANCH}),
    "maize": (8.5, {Organ.LEAF, Organ.STEM, Organ.COB}),
    "stubble": (500.0, {Organ.STEM, Organ.WEED}),
}


@pytest.mark.parametrize("name", CROPS)
def test_every_crop_is_hit_where_it_is(name):
    density, organs = CROPS[name]
    crop = load_crop(name)
    weeds = weed_crop(Weeds(plants_per_m2=25.0, height_m=0.2)) if name == "stubble" else None
    library = make_library(
        crop,
        density_max=density,
        row_spacing=crop.stand.row_spacing,
        seed=Stream(1, "test"),
        tile_count=1,
        weeds=weeds,
    )
    pages = make_pages(library, pages=1, slope=(0.05, -0.1), lean=(0.1, 0.05))
    pages.cut_slot[:] = 0
    pages.cut[0] = (
        np.random.default_rng(1).choice([20, 255], (32, 32), p=[0.2, 0.8]).repeat(16, 0).repeat(16, 1)
    )
    rng = np.random.default_rng(3)
    height = rng.uniform(0.1, 1.1, COUNT) * crop.stand.height
    o = np.c_[rng.uniform(2, 6, (COUNT, 2)), height]
    o[:, 2] += 0.05 * o[:, 0] - 0.1 * o[:, 1]
    azimuth, fall = rng.uniform(-np.pi, np.pi, COUNT), rng.uniform(-0.1, 1.2, COUNT)
    d = np.c_[np.cos(azimuth) * np.cos(fall), np.sin(azimuth) * np.cos(fall), -np.sin(fall)]
    distance, organ = cast_slowly(library, pages, o, d, 2.0)
    hits = RayCaster(HandField(pages, library), threads=1).cast(o, d, range_max=2.0)
    np.testing.assert_array_equal(hits.organ, organ)
    np.testing.assert_allclose(hits.distance, distance, rtol=0, atol=5e-6, equal_nan=True)
    assert organs <= set(organ)
    np.testing.assert_allclose(hits.reflectance[organ > 0], library.reflectance[organ[organ > 0]], rtol=1e-6)
