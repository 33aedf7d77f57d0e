"""The kernel against a plain float64 test of every primitive: same organ, same range."""

import numpy as np
import pytest

from swath.field.memory_layout import Organ
from swath.rays.engine import RayCaster
from tests.rays.hand_field import HandField, make_pages, set_bumps, small_library
from tests.rays.reference import cast_slowly

LIBRARY = small_library(300, tiles=2)
COUNT = 120


def rays(seed, low, high, *, up=-0.2, down=1.5):
    """Origins over the middle of a page at heights low..high [m], any azimuth, depressions up..down [rad]."""
    rng = np.random.default_rng(seed)
    o = np.c_[rng.uniform(1, 7, (COUNT, 2)), rng.uniform(low, high, COUNT)]
    azimuth, depression = rng.uniform(-np.pi, np.pi, COUNT), rng.uniform(up, down, COUNT)
    d = np.c_[np.cos(azimuth), np.sin(azimuth), np.zeros(COUNT)] * np.cos(depression)[:, None]
    d[:, 2] = -np.sin(depression)
    return o, d


def check(pages, o, d, reach=3.0):
    """All rays agree; returns the organs hit."""
    distance, organ = cast_slowly(LIBRARY, pages, o, d, reach)
    hits = RayCaster(HandField(pages, LIBRARY), threads=1).cast(o, d, range_max=reach)
    np.testing.assert_array_equal(hits.organ, organ)
    np.testing.assert_allclose(hits.distance, distance, rtol=0, atol=5e-6, equal_nan=True)
    return organ


@pytest.mark.parametrize("heights", [(1.2, 1.5), (0.05, 0.9)], ids=["above", "inside"])
def test_standing_crop(heights):
    organ = check(make_pages(LIBRARY, pages=1, mixed=1), *rays(5, *heights))
    assert {Organ.GROUND, Organ.STEM, Organ.EAR, Organ.LEAF} <= set(organ)


@pytest.mark.parametrize("lean", [(0.5, -0.9), (3.2, -2.0)], ids=["46 deg", "75 deg"])
def test_slope_lean_and_scale(lean):
    pages = make_pages(LIBRARY, pages=1, mixed=1, slope=(0.1, -0.05), lean=lean, scale=0.8)
    check(pages, *rays(6, 1.2, 1.8))


def test_density_thins_by_rank():
    organ = check(make_pages(LIBRARY, pages=1, mixed=1, density=75), *rays(7, 1.0, 1.5))
    full = check(make_pages(LIBRARY, pages=1, mixed=1), *rays(7, 1.0, 1.5))
    assert np.sum(organ == Organ.GROUND) > np.sum(full == Organ.GROUND) + 10


def test_cut_cells_leave_stubble():
    pages = make_pages(LIBRARY, pages=1, mixed=1, lean=(0.2, 0.3))
    pages.cut_slot[:] = 0
    codes = np.random.default_rng(1).choice([0, 15, 30, 255], (32, 32))
    pages.cut[0] = codes.repeat(16, 0).repeat(16, 1)
    organ = check(pages, *rays(8, 0.5, 1.5))
    assert np.sum(organ == Organ.STUBBLE) > 3


def test_all_cut_is_stubble_below_its_height():
    pages = make_pages(LIBRARY, pages=1, code=20)
    pages.tile_top[:] = 0.2
    o, d = rays(9, 0.5, 1.0, up=0.2)
    check(pages, o, d)
    hits = RayCaster(HandField(pages, LIBRARY), threads=1).cast(o, d, range_max=5)
    z = (o[:, 2] + hits.distance * d[:, 2])[hits.organ == Organ.STUBBLE]
    assert len(z) > 5
    assert z.max() < 0.2 + 0.5 * 0.006
    assert not np.isin(hits.organ, [Organ.EAR, Organ.STEM]).any()


@pytest.mark.parametrize("direction", [(0, 0, -1), (1, 0, 0), (0, -1, 0), (0, 0, 1)])
@pytest.mark.parametrize("on_sides", [False, True])
def test_rays_along_the_axes(direction, on_sides):
    o, d = rays(10, 0.05, 0.9)
    d[:] = direction
    if on_sides:
        o[:, :2] = np.round(o[:, :2])
    check(make_pages(LIBRARY, pages=1, mixed=1), o, d, reach=2.0)


def test_bumpy_ground():
    def hills(x, y):
        return 0.06 * np.sin(5.0 * x) * np.cos(4.0 * y) + 0.1 * x

    pages = make_pages(LIBRARY, pages=1, ground=hills)
    pages.tile_plane[..., 1] = 0.1
    pages.straw[:, 10:30, 20:40] = 0.07
    set_bumps(pages, LIBRARY.tile_size)
    pages.tile_top[:] = 0.0
    o, d = rays(11, 1.5, 2.0, up=0.05)
    distance, organ = cast_slowly_ground(pages, o, d)
    hits = RayCaster(HandField(pages, LIBRARY), threads=1).cast(o, d, range_max=6.0)
    np.testing.assert_array_equal(hits.organ > 0, organ > 0)
    np.testing.assert_allclose(hits.distance, distance, rtol=0, atol=1e-5, equal_nan=True)
    assert {Organ.GROUND, Organ.STRAW} <= set(hits.organ)


def cast_slowly_ground(pages, o, d):
    """The reference with no plants on the tiles."""
    bare = pages.tile_stand.copy()
    pages.tile_stand[..., 3] = 0.0
    result = cast_slowly(LIBRARY, pages, o, d, 6.0)
    pages.tile_stand[...] = bare
    return result


def test_far_from_the_origin_and_turned():
    """The same field 20 km away, turned and lifted: ranges stay within a few float32 steps."""
    here = make_pages(LIBRARY, pages=1, mixed=1)
    o, d = rays(12, 1.2, 1.5)
    near = RayCaster(HandField(here, LIBRARY), threads=1).cast(o, d, range_max=4)
    there = make_pages(LIBRARY, pages=1, mixed=1, first=2500, ground=lambda x, y: 431.0 + 0.0 * x)
    yaw = 0.7
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
    moved = (o + np.array([20000.0, 20000.0, 431.0])) @ turn.T
    far = RayCaster(HandField(there, LIBRARY, yaw), threads=1).cast(moved, d @ turn.T, range_max=4)
    same = near.organ == far.organ
    assert same.mean() > 0.99
    np.testing.assert_allclose(far.distance[same], near.distance[same], atol=1e-4)


def test_rays_that_leave_the_known_pages_are_lost():
    pages = make_pages(LIBRARY, pages=1)
    o = np.array([[4.0, 4.0, 2.0], [4.0, 4.0, 0.5]])
    d = np.array([[np.cos(0.1), 0.0, -np.sin(0.1)], [0.0, 0.0, 1.0]])
    hits = RayCaster(HandField(pages, LIBRARY), threads=1).cast(o, d, range_max=50)
    assert not hits.is_hit[0]
    assert np.isnan(hits.distance[0])
    assert hits.organ[0] == Organ.NONE
