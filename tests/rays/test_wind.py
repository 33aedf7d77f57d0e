"""Crop that sways: rays against every primitive, the closed form of the shift, time, tops of tiles."""

from dataclasses import replace

import numpy as np
import pytest

from swath.field.cutting.height_bounds import update_tops
from swath.field.memory_layout import REVISION, Organ
from swath.field.stand import uniform
from swath.field.wind import Sway, Wind, make_sway
from swath.rays.engine import RayCaster
from tests.field.made_field import made_field, rectangle
from tests.rays.hand_field import HandField, make_pages, small_library
from tests.rays.reference import cast_slowly

S = 1_000_000_000  # ns
WIND = Wind(azimuth_deg=50.0, sway_deg=7.0, steady_deg=4.0, wavelength_m=3.0, period_s=1.6)


GALE = replace(WIND, sway_deg=12.8, steady_deg=12.8)  # at 8 m/s


def expected_slope(x, y, seconds, wind=WIND):
    """Slope along a wind at world points, written out."""
    steady, sway = np.tan(np.radians(wind.steady_deg)), np.tan(np.radians(wind.sway_deg))
    east, north = np.sin(np.radians(50.0)), np.cos(np.radians(50.0))
    ahead = x * east + y * north
    aslant = x * np.sin(np.radians(20.0)) + y * np.cos(np.radians(20.0))
    return (
        steady
        + 0.7 * sway * np.sin(2 * np.pi * (ahead / 3.0 - seconds / 1.6))
        + 0.3 * sway * np.sin(2 * np.pi * (aslant / 12.0 - seconds / 6.4))
    )


def swaying(wind):
    made = made_field(
        stand=uniform.Params(
            stems_per_m2=300.0,
            row_azimuth_deg=20.0,
            lean_deg=8.0,
            lean_azimuth_deg=300.0,
            height_factor=0.9,
            wind=wind,
        )
    )
    made.ensure(-1.0, 5.0, 12.0)
    made.cut(rectangle(-2.0, 0.0, 0.0, 9.0), 0.15)
    return made


@pytest.fixture(scope="module")
def field():
    return swaying(WIND)


def world_rays(count, seed):
    rng = np.random.default_rng(seed)
    o = np.c_[rng.uniform(-4, 1, count), rng.uniform(2, 8, count), rng.uniform(0.9, 1.6, count)]
    azimuth, depression = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.3, 1.5, count)
    d = np.c_[np.cos(azimuth), np.sin(azimuth), -np.tan(depression)] * np.cos(depression)[:, None]
    return o, d


def turned(vectors, angle):
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]).T


def lean_tiles(field, seconds, wind):
    """Writes the wind's lean into the tiles themselves; returns what stood there."""
    p, size, before = field.pages, field.library.tile_size, field.pages.tile_stand.copy()
    aside = turned(np.array([[np.sin(np.radians(50.0)), np.cos(np.radians(50.0)), 0.0]]), -field.stand_yaw)[0]
    for j, i in np.argwhere(p.table >= 0):
        slot = p.table[j, i]
        u, v = np.meshgrid(8 * (i + p.table_x) + np.arange(8), 8 * (j + p.table_y) + np.arange(8))
        middle = np.stack([(u + 0.5) * size, (v + 0.5) * size, 0.0 * u], axis=-1)
        world = turned(middle, field.stand_yaw)
        lean = expected_slope(world[..., 0], world[..., 1], seconds, wind) * before[slot, ..., 0]
        p.tile_stand[slot, ..., 1] += lean * aside[0]
        p.tile_stand[slot, ..., 2] += lean * aside[1]
    return before


@pytest.mark.parametrize(("wind", "seconds"), [(WIND, 0.0), (WIND, 2.37), (GALE, 0.0), (GALE, 2.37)])
def test_the_same_as_every_primitive(wind, seconds):
    field = swaying(wind)
    o, d = world_rays(100, 1)
    hits = RayCaster(field, threads=1).cast(o, d, range_max=4.0, t=round(seconds * S))
    still = field.pages.tile_stand
    before = lean_tiles(field, seconds, wind)
    yaw = field.stand_yaw
    distance, organ = cast_slowly(field.library, field.pages, turned(o, -yaw), turned(d, -yaw), 4.0)
    still[...] = before
    np.testing.assert_array_equal(hits.organ, organ)
    np.testing.assert_allclose(hits.distance, distance, rtol=0, atol=1e-5, equal_nan=True)
    assert {Organ.EAR, Organ.STEM, Organ.LEAF, Organ.GROUND} <= set(hits.organ)


def test_the_field_knows_its_slope(field):
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-500, 500, (2, 50))
    slope = field.wind.slope(*field.to_stand(x, y), round(2.37 * S))
    np.testing.assert_allclose(slope, expected_slope(x, y, 2.37), atol=1e-9)
    assert np.abs(slope).max() <= field.wind.slope_max


@pytest.fixture(scope="module")
def strip():
    """Upright plants on half a metre along y, in the middle of a column of tiles; wind across it."""
    library = small_library(500, tiles=4, upright=True, leaves=False, row_spacing=0.0)
    pages = make_pages(library, pages=1, mixed=2)
    pages.cut_slot[:] = 0
    pages.cut[0, :, 3 * 64 + 16 : 3 * 64 + 48] = 255
    wave = Sway((1.0, 0.0), 0.05, 0.2, (0.25, 0.0), (0.05, 0.0), 2 * S)
    return HandField(pages, library, wind=wave), HandField(pages, library)


@pytest.mark.parametrize("seconds", [0.0, 0.6, 1.5])
def test_hits_move_aside_by_lean_times_height(strip, seconds):
    """Vertical rays: the mean x of hits at a height is that of the still strip plus slope times height."""
    swaying, still = strip
    x, y = np.meshgrid(np.linspace(2.6, 4.4, 350), np.linspace(0.5, 7.5, 700))
    o = np.c_[x.ravel(), y.ravel(), np.full(x.size, 1.5)]
    d = np.broadcast_to([0.0, 0.0, -1.0], o.shape)
    cycles = 3.5 / 4.0 - seconds / 2.0, 3.5 / 20.0 - seconds / 8.0
    slope = 0.05 + 0.14 * np.sin(2 * np.pi * cycles[0]) + 0.06 * np.sin(2 * np.pi * cycles[1])
    means = []
    for field in (swaying, still):
        hits = RayCaster(field, threads=1).cast(o, d, range_max=2.0, t=round(seconds * S))
        ears = hits.organ == Organ.EAR
        z = o[ears, 2] - hits.distance[ears]
        means.append((o[ears, 0].mean(), z.mean(), ears.sum()))
    (moved_x, height, count), (still_x, _, _) = means
    assert count > 2500
    assert 0.6 < height < 0.9
    assert moved_x - still_x == pytest.approx(slope * height, abs=0.004)


def test_comes_again_after_four_periods(strip):
    field, _ = strip
    rng = np.random.default_rng(5)
    o = np.c_[rng.uniform(2.6, 4.4, 3000), rng.uniform(1, 7, 3000), np.full(3000, 1.2)]
    d = np.broadcast_to([0.0, 0.0, -1.0], o.shape)
    caster = RayCaster(field, threads=1)
    first, later, again = (caster.cast(o, d, range_max=2.0, t=round(s * S)).distance for s in (0.3, 2.3, 8.3))
    np.testing.assert_array_equal(first, again)
    assert np.mean(first != later) > 0.05  # the gust differs


def test_threads_and_order_change_nothing(field):
    o, d = world_rays(6000, 2)
    t = round(1.1 * S)
    first = RayCaster(field, threads=1).cast(o, d, range_max=6.0, t=t)
    second = RayCaster(field, threads=3).cast(o, d, range_max=6.0, t=t)
    order = np.random.default_rng(3).permutation(len(o))
    shuffled = RayCaster(field, threads=1).cast(o[order], d[order], range_max=6.0, t=t)
    for a, b, c in (
        (getattr(h, n) for h in (first, second, shuffled)) for n in ("distance", "organ", "cosine")
    ):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a[order], c)


def test_no_ray_misses_crop_that_leans_over_a_bare_tile():
    """Tops of tiles against no tops at all, in a storm; without the wind's reach rays would miss crop.

    Crop stands east of x = 0; at t = 0 a crest is 1.5 m west of it.
    """
    wind = Wind(azimuth_deg=-90.0, sway_deg=30.0, steady_deg=30.0, wavelength_m=6.0)
    field = made_field(stand=uniform.Params(stems_per_m2=300.0, height_factor=1.6, wind=wind))
    field.ensure(0.0, 8.0, 14.0)
    field.cut(rectangle(-8.0, -8.0, 0.0, 24.0), 0.0)
    rng = np.random.default_rng(6)
    o = np.c_[rng.uniform(-3, 0.5, 8000), rng.uniform(2, 14, 8000), np.full(8000, 2.0)]
    d = np.broadcast_to([0.0, 0.0, -1.0], o.shape)

    def cast():
        return RayCaster(field, threads=1).cast(o, d, range_max=5.0).organ

    with_tops = cast()
    keys = list(field.store.keys)
    update_tops(field.store, field.library, keys)
    too_near = cast()
    field.pages.tile_top[:] = 2.0 * field.library.height_max
    field.pages.counters[REVISION] += 1
    everywhere = cast()
    np.testing.assert_array_equal(with_tops, everywhere)
    assert np.sum(too_near != everywhere) > 10


def test_wind_that_moves_nothing_is_no_wind():
    assert make_sway(None, 0.0) is None
    assert make_sway(Wind(speed_m_s=0.0), 0.0) is None
    assert make_sway(Wind(sway_deg=0.0, steady_deg=1.0), 0.0) is not None


@pytest.mark.parametrize(("speed", "degrees"), [(2.0, 0.8), (5.0, 5.0), (20.0, 15.0)])
def test_sway_from_speed(speed, degrees):
    sway = make_sway(Wind(speed_m_s=speed), 0.3)
    assert np.degrees(np.arctan([sway.steady, sway.amplitude])) == pytest.approx([degrees, degrees])
    assert sway.toward == pytest.approx(
        (np.cos(0.3), -np.sin(0.3))
    )  # east, seen from rows 0.3 rad to its left
