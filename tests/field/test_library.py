"""The tile library: places, ranks, periodic copies, and a search index that misses nothing."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import Organ, Shape
from swath.field.prototypes import make_library

WHEAT = load_crop("wheat")
LIBRARY = make_library(WHEAT, density_max=400, row_spacing=0.125, seed=Stream(1, "test"), tile_count=2)


def test_counts_places_and_ranks():
    assert LIBRARY.tile_size == 1.0
    assert LIBRARY.stem_start.tolist() == [0, 400, 800]
    assert ((LIBRARY.stem_xy >= 0) & (LIBRARY.stem_xy < 1)).all()
    for k in range(2):
        rank = np.sort(LIBRARY.stem_rank[LIBRARY.stem_start[k] : LIBRARY.stem_start[k + 1]])
        assert ((rank >= np.arange(400) / 400) & (rank < (np.arange(400) + 1) / 400 + 1e-6)).all()
    assert LIBRARY.grain_kg.mean() == pytest.approx(WHEAT.yields.grain_mass)


def test_stems_stand_in_rows_along_x():
    off = (LIBRARY.stem_xy[:, 1] / 0.125) % 1.0 - 0.5
    assert np.abs(off).mean() * 0.125 == pytest.approx(0.8 * 0.012, rel=0.15)  # mean |normal| = 0.8 sd
    row = np.floor(LIBRARY.stem_xy[:, 1] / 0.125)
    assert np.bincount(row.astype(int)).min() > 60
    along = np.histogram(LIBRARY.stem_xy[:, 0], bins=5, range=(0, 1))[0]
    assert along.min() > 100


CROPS = [("barley", 775), ("barley", 400), ("rye", 500), ("wheat", 500)]


@pytest.mark.parametrize(("name", "density"), CROPS)
def test_rows_of_a_tile_are_alike_whatever_the_stems_of_a_plant(name, density):
    """Barley has 2.75 stems a plant: plants of three and of two stand among each other, not in rows apart."""
    library = make_library(
        load_crop(name),
        density_max=density,
        row_spacing=0.125,
        seed=Stream(1, "test"),
        tile_count=8,
        leaves=False,
        ears=False,
    )
    row = np.floor(library.stem_xy[:, 1] / 0.125).astype(int)
    count = np.bincount(row, minlength=8)
    assert count.min() > 0.94 * count.mean()
    assert count.max() < 1.06 * count.mean()


def test_rows_fit_a_tile_of_about_a_metre():
    library = make_library(WHEAT, density_max=50, row_spacing=0.15, seed=Stream(1, "t"), tile_count=1)
    assert library.tile_size == pytest.approx(1.05)
    free = make_library(WHEAT, density_max=50, row_spacing=0.0, seed=Stream(1, "t"), tile_count=1)
    assert free.tile_size == 1.0


def test_copies_complete_a_periodic_tile():
    """Every piece that overlaps the tile, moved by any period, is there exactly once."""
    shift = np.round(LIBRARY.base - LIBRARY.stem_xy[LIBRARY.owner]).astype(int)
    np.testing.assert_allclose(LIBRARY.base - shift, LIBRARY.stem_xy[LIBRARY.owner], atol=1e-6)
    ends = np.stack([LIBRARY.a, LIBRARY.b])
    reach = LIBRARY.radius[:, None] + np.abs(LIBRARY.width[:, :2]) + 2e-5
    low, high = ends[..., :2].min(axis=0) - reach, ends[..., :2].max(axis=0) + reach
    assert ((low < 1) & (high > 0)).all()
    key = np.c_[
        LIBRARY.owner, LIBRARY.organ, LIBRARY.a[:, 2], LIBRARY.b[:, 2]
    ]  # what copies share to the bit
    _, piece = np.unique(key, axis=0, return_inverse=True)
    plain_low, plain_high = low - shift, high - shift
    for move in ((-1, 0), (1, 0), (0, 1), (0, -1), (0, 0), (1, 1)):
        overlaps = ((plain_low + move < 0.999) & (plain_high + move > 0.001)).all(axis=1)
        there = (shift == move).all(axis=1)
        assert set(piece[overlaps]) <= set(piece[there])
        assert len(piece[there]) == len(set(piece[there]))


def test_points_on_primitives_are_listed_in_their_cell():
    rng = np.random.default_rng(1)
    index = rng.integers(0, len(LIBRARY.owner), 20_000)
    a, b, w = (x[index].astype(float) for x in (LIBRARY.a, LIBRARY.b, LIBRARY.width))
    s, v = rng.random((len(index), 1)), rng.uniform(-1, 1, (len(index), 1))
    direction = rng.normal(size=a.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    point = a + s * (b - a) + v * w + LIBRARY.radius[index][:, None] * direction
    inside = ((point[:, :2] >= 0) & (point[:, :2] < 1)).all(axis=1)
    side = np.array([1 / LIBRARY.columns] * 2 + [LIBRARY.bin_height])
    ix, iy, iz = np.floor(point / side).astype(int).T
    iz = np.clip(iz, 0, LIBRARY.bins - 1)
    tile = LIBRARY.owner[index] // 400
    cell = ((tile * LIBRARY.columns + iy) * LIBRARY.columns + ix) * LIBRARY.bins + iz
    listed = [
        i in LIBRARY.cell_items[LIBRARY.cell_start[c] : LIBRARY.cell_start[c + 1]]
        for i, c in zip(index[inside], cell[inside], strict=True)
    ]
    assert len(listed) > 10_000
    assert all(listed)


def test_the_index_is_tight():
    """Few items per cell: 0.4 m2 of ribbon and rod in 5 cm cells cannot need many."""
    per_cell = len(LIBRARY.cell_items) / (len(LIBRARY.cell_start) - 1)
    assert per_cell < 4.0
    assert LIBRARY.bins * LIBRARY.bin_height == pytest.approx(LIBRARY.height_max)
    assert LIBRARY.height_max > LIBRARY.stem_height.max() - 1e-3
    assert (LIBRARY.radius[LIBRARY.shape == Shape.RIBBON] == 0).all()
    assert LIBRARY.reflectance[Organ.GROUND] == pytest.approx(0.27)


def test_reproducible_and_seeded():
    again = make_library(WHEAT, density_max=400, row_spacing=0.125, seed=Stream(1, "test"), tile_count=2)
    for name, value in vars(LIBRARY).items():
        if isinstance(value, np.ndarray):
            assert value.tobytes() == getattr(again, name).tobytes(), name
    other = make_library(WHEAT, density_max=400, row_spacing=0.125, seed=Stream(2, "test"), tile_count=2)
    assert other.stem_xy.tobytes() != LIBRARY.stem_xy.tobytes()


@pytest.mark.parametrize(
    ("name", "share"), [("wheat", 0.75), ("barley", 0.85), ("maize", 1.0), ("rape", 1.0)]
)
def test_reduced_plants_are_the_same_ones_of_fewer_primitives(name, share):
    """Feet, heights and masses to the bit; stems and ears too; leaves keep their area."""
    crop = load_crop(name)
    full, less = (
        make_library(
            crop, density_max=40, row_spacing=0.125, seed=Stream(1, "test"), tile_count=2, detail=detail
        )
        for detail in ("full", "reduced")
    )
    for kept in ("stem_xy", "stem_rank", "stem_height", "grain_kg", "straw_kg"):
        assert getattr(full, kept).tobytes() == getattr(less, kept).tobytes()
    assert len(less.owner) / len(full.owner) == pytest.approx(share, abs=0.04)
    rest = [lib.a[lib.organ != Organ.LEAF] for lib in (full, less)]
    assert sorted(rest[0].tolist()) == sorted(rest[1].tolist())


@pytest.mark.parametrize(
    ("density", "spacing"), [(-5.0, 0.1), (0.0, 0.1), (float("nan"), 0.1), (100.0, -1.0)]
)
def test_bad_stands_are_refused(density, spacing):
    with pytest.raises(InputError):
        make_library(WHEAT, density_max=density, row_spacing=spacing, seed=Stream(1, "t"))
