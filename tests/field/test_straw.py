"""Straw on the ground: mass kept, shape of the ridge, borders of pages."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.edges.edge import StraightEdge
from swath.field.stand import uniform
from tests.field.made_field import CROP, made_field, rectangle

NORTH = uniform.Params(row_azimuth_deg=90.0)  # the stand frame is the world


def depth_at(field, x, y):
    """Depth of straw [m] at the lattice node nearest to points, from the pages that rays read."""
    u, v = field.to_stand(x, y)
    i, j = np.round(u / field.maker.node).astype(int), np.round(v / field.maker.node).astype(int)
    p = field.pages
    slot = p.table[j // 64 - p.table_y, i // 64 - p.table_x]
    return p.straw[slot, j % 64, i % 64]


def test_mass_is_kept_and_depth_holds_it():
    field = made_field()
    laid = 0.0
    rng = np.random.Generator(np.random.Philox(3))
    for n in range(200):
        mass = float(rng.uniform(0.0, 0.5))
        field.deposit_straw(rectangle(2.0, 0.1 * n, 3.4, 0.1 * (n + 1)), mass, heading=np.pi / 2)
        laid += mass
    assert field.straw_kg == pytest.approx(laid, rel=1e-12)
    own = field.pages.straw[list(field.store.keys.values()), :64, :64]
    volume = float(own.sum(dtype=np.float64)) * field.maker.node**2
    assert volume * CROP.yields.swath_density == pytest.approx(laid, rel=1e-5)


def test_a_ridge_is_highest_in_the_middle_and_gone_outside():
    field = made_field(stand=NORTH)
    field.deposit_straw(rectangle(-1.0, 0.0, 1.0, 12.0), 24.0, heading=np.pi / 2)
    x = np.arange(-2.0, 2.001, field.maker.node)
    depth = np.mean([depth_at(field, x, np.full(x.shape, y)) for y in (4.0, 5.0, 6.0, 7.0)], axis=0)
    per_area = 24.0 / (2.0 * 12.0) / CROP.yields.swath_density
    expected = 1.5 * per_area * np.clip(1.0 - x**2, 0.0, None)
    assert np.abs(depth - expected).max() < 0.08 * per_area
    assert np.all(depth[np.abs(x) > 1.0 + field.maker.node] == 0.0)


def test_even_straw_is_even():
    field = made_field(stand=NORTH)
    field.deposit_straw(rectangle(-3.0, -3.0, 3.0, 3.0), 36.0)
    x, y = np.meshgrid(np.arange(-2.5, 2.6, 0.125), np.arange(-2.5, 2.6, 0.125))
    assert depth_at(field, x, y) == pytest.approx(1.0 / CROP.yields.swath_density, rel=0.25)
    assert depth_at(field, x, y).mean() == pytest.approx(1.0 / CROP.yields.swath_density, rel=0.01)


def test_pages_show_the_same_depth_on_their_shared_border():
    field = made_field()
    field.ensure(0.0, 0.0, 25.0)
    for n in range(30):
        polygon = rectangle(-6.0 + 0.4 * n, -8.0 + 0.5 * n, -4.6 + 0.4 * n, -7.5 + 0.5 * n)
        field.deposit_straw(polygon, 0.3, heading=0.9)
    p, shared = field.pages, 0.0
    for (i, j), slot in field.store.keys.items():
        for (a, b), mine, theirs in (((1, 0), np.s_[:, 64], np.s_[:, 0]), ((0, 1), np.s_[64], np.s_[0])):
            other = field.store.keys.get((i + a, j + b), -1)
            if other >= 0:
                assert np.array_equal(p.straw[slot][mine], p.straw[other][theirs])
                shared += float(p.straw[slot][mine].sum())
    assert shared > 0.0


def test_straw_lifts_the_surface_of_its_tiles():
    field = made_field(edge=StraightEdge())
    field.deposit_straw(rectangle(-2.0, -2.0, 2.0, 2.0), 40.0)
    slot = list(field.store.keys.values())
    assert field.pages.tile_bump[slot].max() == pytest.approx(field.pages.straw[slot].max(), abs=1e-4)
    assert field.ground_height(0.0, 0.0) == 0.0


def test_bumps_are_what_ground_and_straw_rise_above_the_plane_of_each_tile():
    rng, field = np.random.Generator(np.random.Philox(5)), made_field()
    for x, y, heading in rng.uniform(-20.0, 20.0, (40, 3)):
        field.deposit_straw(rectangle(x, y, x + 1.4, y + 2.0), 3.0, heading=heading)
    p, size, n = field.pages, field.library.tile_size, 8
    offset = (np.arange(n + 1) / n - 0.5) * size
    for slot in field.store.keys.values():
        surface = (p.ground[slot] + p.straw[slot]).astype(float)
        for row, column in np.ndindex(8, 8):
            height, slope_x, slope_y = p.tile_plane[slot, row, column].astype(float)
            nodes = surface[n * row : n * row + n + 1, n * column : n * column + n + 1]
            bump = (nodes - (height + slope_x * offset + slope_y * offset[:, None])).max()
            assert p.tile_bump[slot, row, column] == np.float32(bump)


def test_a_polygon_larger_than_the_memory_that_is_kept_is_laid_whole():
    whole, parts = made_field(stand=NORTH), made_field(stand=NORTH)
    whole.deposit_straw(rectangle(-6.0, -40.0, 6.0, 40.0), 100.0)
    for k in range(80):
        parts.deposit_straw(rectangle(-6.0, k - 40.0, 6.0, k - 39.0), 1.25)
    assert whole.straw_kg == pytest.approx(100.0, rel=1e-9)
    places = np.meshgrid(np.arange(-5.0, 5.0), np.arange(-38.0, 38.0))
    assert depth_at(whole, *places) == pytest.approx(depth_at(parts, *places), rel=0.3)


def test_straw_that_cannot_be_is_refused_and_none_is_nothing():
    field = made_field()
    place = rectangle(0.0, 0.0, 1.0, 1.0)
    field.deposit_straw(place, 0.0)
    assert field.straw_kg == 0.0
    for mass in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="mass_kg"):
            field.deposit_straw(place, mass)
    with pytest.raises(InputError, match="polygon"):
        field.deposit_straw([[0.0, 0.0], [1.0, 1.0]], 1.0)
