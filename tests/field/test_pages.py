"""The page store: what comes and goes, and what must never change by it."""

import gc
import tracemalloc

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from swath.core.errors import InputError
from swath.field.edges.edge import CurveEdge, GapParams, StraightEdge, TeethParams, make_edge
from swath.field.field import make_field
from swath.field.maps.raster import Raster
from swath.field.memory_layout import DROPPED, MIRROR_X, MIRROR_Y, REVISION, STANDING
from swath.field.stand import maps, uniform
from swath.field.terrain import dem, formula, plane
from tests.field.made_field import CROP, SETUP, STREAM, library, made_field, rectangle

ROUGH = formula.Params(slope_percent=2.0, roughness_class="D")
TOOTHED = StraightEdge(x_m=3.3, heading_deg=80.0, teeth=TeethParams(amplitude_m=1.0, wavelength_m=3.0))


def page_bytes(field, key):
    """Everything a ray can read of a page."""
    p, slot = field.pages, field.store.keys.get(key, -1)
    codes = field.store.codes_of(key)
    codes = np.full((512, 512), codes, np.uint8) if isinstance(codes, int) else codes
    arrays = (p.ground, p.straw, p.tile_plane, p.tile_stand, p.tile_prototype, p.tile_bump)
    return [a[slot].tobytes() for a in arrays] + [codes.tobytes()]


def test_pages_within_the_radius_are_there_and_the_table_finds_them():
    field = made_field(terrain=ROUGH)
    field.ensure(70.0, -45.0, 25.0)
    rng = np.random.Generator(np.random.Philox(2))
    angle, far = rng.uniform(0.0, 2 * np.pi, 500), 25.0 * np.sqrt(rng.random(500))
    u, v = field.to_stand(70.0 + far * np.cos(angle), -45.0 + far * np.sin(angle))
    i, j = (np.floor(a / field.maker.side).astype(int) for a in (u, v))
    p = field.pages
    slot = p.table[j - p.table_y, i - p.table_x]
    assert (slot >= 0).all()
    assert all(field.store.keys[(a, b)] == s for a, b, s in zip(i, j, slot, strict=True))
    assert len(field.store.keys) < 60


def test_nothing_changes_when_everything_needed_is_there():
    field = made_field(terrain=ROUGH)
    field.ensure(0.0, 0.0, 30.0)
    before, arrays = int(field.pages.counters[REVISION]), [id(field.pages.ground), id(field.pages.table)]
    field.ensure(0.0, 0.0, 30.0)
    field.standing([1.0, 2.0], [3.0, 4.0])
    field.ground_height(5.0, 5.0)
    assert field.pages.counters[REVISION] == before
    assert arrays == [id(field.pages.ground), id(field.pages.table)]


def test_a_page_is_the_same_whatever_was_visited_before():
    one, two = made_field(terrain=ROUGH, edge=TOOTHED), made_field(terrain=ROUGH, edge=TOOTHED)
    one.ensure(0.0, 0.0, 20.0)
    for x in (300.0, -80.0, 12.0, 0.0):
        two.ensure(x, 0.0, 20.0)
    for key in one.store.keys:
        assert page_bytes(one, key) == page_bytes(two, key)


def test_pages_made_in_advance_are_those_that_would_have_been_made_and_not_made_again():
    plain, ahead = made_field(terrain=ROUGH, edge=TOOTHED), made_field(terrain=ROUGH, edge=TOOTHED)
    made, make = [], ahead.store.make
    ahead.store.make = lambda keys: made.extend(keys) or make(keys)
    for x in range(0, 60, 4):
        for field in (plain, ahead):
            field.ensure(float(x), 0.0, 15.0)
            field.cut(rectangle(x - 2.0, -1.0, x + 2.0, 1.0), 0.1)
        before = len(made)
        while ahead.prepare():
            assert len(made) < before + 60  # it comes to an end
        assert not ahead.prepare()
        assert list(ahead.store.keys) == list(plain.store.keys)
    assert all(page_bytes(plain, key) == page_bytes(ahead, key) for key in plain.store.keys)
    assert len(set(made)) == len(made)
    waiting = len(made)
    field.ensure(64.0, 0.0, 15.0)
    assert len(made) == waiting


def test_uniform_pages_need_no_cells():
    field = made_field(edge=StraightEdge(x_m=1.0, stubble_height_m=0.2, crop_begins_m=None))
    field.ensure(0.0, 0.0, 60.0)
    codes = {key: field.store.codes_of(key) for key in field.store.keys}
    mixed = [key for key, code in codes.items() if not isinstance(code, int)]
    plain = {code for code in codes.values() if isinstance(code, int)}
    assert plain == {20, STANDING}
    across = {field.maker.to_world(*(np.array(key) * field.maker.side))[0] // 8.0 for key in mixed}
    assert len(across) <= 2
    assert len(mixed) == pytest.approx(120.0 / field.maker.side, abs=2)


def test_forgotten_pages_come_back_as_they_were_with_their_changes():
    field = made_field(terrain=ROUGH, edge=TOOTHED, page_limit=40)
    strip = rectangle(-1.0, 0.0, 9.0, 3.0)
    taken = field.cut(strip, 0.1)
    field.deposit_straw(rectangle(4.0, 0.0, 5.5, 3.0), 2.0, heading=np.pi / 2)
    field.ensure(0.0, 0.0, 12.0)
    before = {key: page_bytes(field, key) for key in field.store.keys}
    field.ensure(500.0, 0.0, 25.0)
    assert not set(before) & set(field.store.keys)
    assert len(field.store.keys) <= 60
    assert field.recount().grain == pytest.approx(taken.grain, rel=1e-12)
    field.ensure(0.0, 0.0, 12.0)
    for key, expected in before.items():
        assert page_bytes(field, key) == expected
    assert field.cut(strip, 0.1).area == 0.0
    assert field.straw_kg == pytest.approx(2.0, rel=1e-12)


def test_a_page_that_is_cut_all_over_needs_no_cells_any_more():
    field = made_field(edge=StraightEdge(x_m=-200.0))
    field.ensure(0.0, 0.0, 5.0)
    corners = (
        np.stack(field.maker.to_world([0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]), -1) * field.maker.side
    )
    field.cut(corners * 0.6, 0.15)
    assert not isinstance(field.store.codes_of((0, 0)), int)
    field.cut(corners, 0.15)
    assert field.store.codes_of((0, 0)) == 15
    reused = len(field.pages.cut)
    for step in range(1, 12):
        field.cut(corners + step * (corners[1] - corners[0]), 0.15)
    assert len(field.pages.cut) == reused


def test_tops_cover_everything_that_stands_and_fall_when_it_is_cut():
    field = made_field(edge=StraightEdge(x_m=-200.0))
    field.ensure(0.0, 0.0, 20.0)
    p = field.pages
    slot = field.store.keys[(0, 0)]
    full = field.library.height_max
    assert p.tile_top[slot] == pytest.approx(full, abs=2e-3)
    side = field.maker.side
    corners = np.stack(field.maker.to_world([-1.0, 2.0, 2.0, -1.0], [-1.0, -1.0, 2.0, 2.0]), -1) * side
    field.cut(corners, 0.15)
    assert p.tile_top[slot] == pytest.approx(0.15, abs=2e-3)
    edge_page = field.store.keys[(1, 0)]  # its right half is near crop that still stands in page (2, 0)
    assert p.tile_top[edge_page][:, :4] == pytest.approx(0.15, abs=2e-3)
    assert p.tile_top[edge_page][:, 7] == pytest.approx(full, abs=2e-3)


def test_tops_know_crop_on_a_page_that_comes_later():
    one, two = made_field(edge=StraightEdge(x_m=0.3)), made_field(edge=StraightEdge(x_m=0.3))
    one.ensure(0.0, 0.0, 40.0)
    for x, y in ((-12.0, 0.0), (0.0, 20.0), (9.0, -9.0), (0.0, 0.0)):
        two.ensure(x, y, 12.0)
    two.ensure(0.0, 0.0, 40.0)
    for key, slot in one.store.keys.items():
        if max(abs(key[0] + 0.5), abs(key[1] + 0.5)) < 3:
            there = two.store.keys[key]
            assert np.array_equal(one.pages.tile_top[slot], two.pages.tile_top[there])


def test_prototypes_are_even_and_mirrored_at_random():
    field = made_field()
    field.ensure(0.0, 0.0, 60.0)
    found = field.pages.tile_prototype[list(field.store.keys.values())].ravel()
    number = np.bincount(found & 0xFFFF, minlength=4) / len(found)
    assert number == pytest.approx(0.25, abs=0.02)
    assert np.mean(found & MIRROR_X > 0) == pytest.approx(0.5, abs=0.03)
    assert np.mean(found & MIRROR_Y > 0) == pytest.approx(0.5, abs=0.03)
    assert np.mean((found & MIRROR_X > 0) == (found & MIRROR_Y > 0)) == pytest.approx(0.5, abs=0.03)


def test_lean_keeps_the_length_of_plants():
    stand = uniform.Params(height_factor=1.1, lean_deg=60.0, lean_azimuth_deg=40.0, row_azimuth_deg=10.0)
    field = made_field(stand=stand)
    field.ensure(0.0, 0.0, 1.0)
    scale, lean_x, lean_y, fraction = field.pages.tile_stand[field.store.keys[(0, 0)]][0, 0]
    assert scale == pytest.approx(1.1 * 0.5, rel=1e-5)
    assert np.hypot(lean_x, lean_y) == pytest.approx(1.1 * np.sin(np.pi / 3), rel=1e-5)
    east, north = field.maker.to_world(lean_x, lean_y)
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(40.0, abs=1e-3)
    assert fraction == pytest.approx(1.0)


def test_maps_reach_the_tiles_and_tramlines_the_cells():
    density = Raster(np.array([[100.0, 100.0], [400.0, np.nan]], np.float32), -50.0, -50.0, 100.0)
    params = maps.Params(tramlines=maps.Tramlines(spacing_m=12.0, offset_m=2.0))
    stand = maps.Maps.from_rasters(params, SETUP, density, None)
    assert stand.density_max == 400.0
    field = make_field(
        plane.Plane(plane.Params(), SETUP),
        stand,
        make_edge(StraightEdge(x_m=-95.0, y_m=-90.0), SETUP),
        crop=CROP,
        library=library(400.0),
        stream=STREAM,
    )
    field.ensure(-50.0, 50.0, 1.0)
    slots = list(field.store.keys.values())
    assert field.pages.tile_stand[slots][..., 3].max() == pytest.approx(1.0)
    assert not field.standing(60.0, 60.0)
    x = np.arange(-20.0, -4.0, 0.01)
    bare = ~field.standing(x, np.full(x.shape, -30.0))
    left = -x - 2.0
    expected = np.abs(np.abs(left - 12.0 * np.round(left / 12.0)) - 1.0) <= 0.225
    assert np.mean(bare == expected) > 0.98
    assert bare.mean() == pytest.approx(2 * 0.45 / 12.0, abs=0.04)


def test_an_edge_beside_the_maps_is_refused():
    density = Raster(np.full((4, 4), 300.0, np.float32), 0.0, 0.0, 10.0)
    heights = Raster(np.zeros((4, 4), np.float32), 2000.0, 0.0, 10.0)
    stand = maps.Maps.from_rasters(maps.Params(), SETUP, density, None)
    flat, mapped = plane.Plane(plane.Params(), SETUP), dem.Dem.from_raster(heights)
    options = {"crop": CROP, "library": library(300.0), "stream": STREAM}
    make_field(flat, stand, make_edge(StraightEdge(length_m=30.0), SETUP), **options)
    with pytest.raises(InputError, match="crop beside it"):
        make_field(flat, stand, make_edge(StraightEdge(x_m=500.0), SETUP), **options)
    with pytest.raises(InputError, match="map of the terrain"):
        make_field(mapped, stand, make_edge(StraightEdge(length_m=30.0), SETUP), **options)


def test_random_lodging_covers_its_share_with_one_azimuth_per_patch():
    params = maps.Params(lodging=maps.Lodging(share_percent=10.0, azimuth_deg=45.0))
    stand = maps.Maps.from_rasters(params, SETUP, None, None)
    x, y = np.meshgrid(np.arange(0.0, 600.0, 1.5), np.arange(0.0, 600.0, 1.5))
    angle, azimuth = stand.lean(x, y)
    lodged = angle > 0.0
    assert lodged.mean() == pytest.approx(0.10, abs=0.02)
    headings = np.unique(azimuth[lodged])
    assert 100 < len(headings) < 1000
    assert np.degrees(np.std(headings)) == pytest.approx(20.0, abs=4.0)
    listed = maps.Params(patches=(maps.Patch(x_m=5.0, y_m=5.0, radius_m=2.0, azimuth_deg=0.0),))
    angle, azimuth = maps.Maps.from_rasters(listed, SETUP, None, None).lean([5.0, 8.0], [5.0, 5.0])
    assert np.degrees(angle) == pytest.approx([60.0, 0.0])
    assert np.degrees(azimuth[0]) == pytest.approx(90.0)


def test_places_that_are_nowhere_are_refused():
    field = made_field()
    for call in (
        lambda: field.ensure(np.nan, 0.0, 5.0),
        lambda: field.ensure(0.0, 0.0, -1.0),
        lambda: field.ground_height(np.inf, 0.0),
        lambda: field.standing(0.0, 1e9),
        lambda: field.cut([[0.0, 0.0], [1.0, 0.0], [np.nan, 1.0]], 0.1),
    ):
        with pytest.raises(InputError, match="expected"):
            call()


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (uniform.Params, {"stems_per_m2": -5.0}),
        (uniform.Params, {"lean_deg": 89.0}),
        (maps.Params, {"tramlines": {"width_m": 5.0}}),
        (maps.Params, {"lodging": {"share_percent": 80.0}}),
        (maps.Params, {"patches": [{"x_m": 0.0, "y_m": 0.0, "radius_m": -1.0}]}),
    ],
)
def test_parameters_out_of_range_are_refused(kind, data):
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(data)


def test_density_maps_that_cannot_be_are_refused(tmp_path):
    bad = Raster(np.array([[-5.0, 10.0]], np.float32), 0.0, 0.0, 1.0)
    with pytest.raises(InputError, match="density_file"):
        maps.Maps.from_rasters(maps.Params(), SETUP, bad, None)
    tall = Raster(np.array([[9.0, 1.0]], np.float32), 0.0, 0.0, 1.0)
    with pytest.raises(InputError, match="height_file"):
        maps.Maps.from_rasters(maps.Params(), SETUP, None, tall)
    stand = uniform.Uniform(uniform.Params(stems_per_m2=600.0), SETUP)
    with pytest.raises(InputError, match="600"):
        make_field(
            plane.Plane(plane.Params(), SETUP),
            stand,
            make_edge(StraightEdge(), SETUP),
            crop=CROP,
            library=library(),
            stream=STREAM,
        )


def test_pages_that_nobody_asks_for_go_out_of_memory_and_come_back_as_they_were():
    field = made_field()
    field.cut([(1.0, -1.0), (4.0, -1.0), (4.0, 3.0), (1.0, 3.0)], 0.15)
    key = min(field.store.recut)
    codes, first = field.store.codes_of(key).copy(), field.recount()
    counts = []
    for x in range(0, 700, 8):
        field.ensure(float(x), 0.0, 20.0)
        counts.append(len(field.store.keys))
    assert key not in field.store.keys
    assert max(counts[-20:]) <= max(counts[30:50])  # no more however far it goes on
    field.ensure(0.0, 0.0, 10.0)
    np.testing.assert_array_equal(field.store.codes_of(key), codes)
    assert field.recount() == first


TEETH, GAP = TeethParams(amplitude_m=0.7, wavelength_m=3.0), GapParams(start_m=3.0, end_m=6.0, depth_m=2.0)


@pytest.mark.parametrize(
    "edge",
    [
        StraightEdge(heading_deg=70.0, crop_begins_m=2.5, teeth=TEETH, gaps=(GAP,)),
        CurveEdge(
            run_in_m=6.0, radius_m=7.0, angle_deg=-85.0, crop_begins_m=4.0
        ),  # pages reach beyond its arc
        CurveEdge(run_in_m=6.0, radius_m=9.0, angle_deg=80.0, crop_side="left"),
    ],
    ids=["straight", "right", "left"],
)
def test_codes_found_for_whole_squares_are_those_of_every_cell(edge):
    maker = made_field(edge=edge).maker
    cell = maker.side / 512
    squares = 0
    for i, j in [(0, 0), (-1, 0), (0, -1), (0, 1), (1, 0), (-2, 1), (2, 2)]:
        u, v = (512 * i + np.arange(512) + 0.5) * cell, (512 * j + np.arange(512) + 0.5) * cell
        wanted = maker.codes_at(*maker.to_world(*np.meshgrid(u, v)))
        found = maker.codes([(i, j)])[0]
        squares += isinstance(found, int)
        np.testing.assert_array_equal(np.broadcast_to(found, wanted.shape), wanted)
    assert 0 < squares < 7


def test_memory_does_not_grow_with_the_way():
    field, straw = made_field(page_limit=24), []

    def mow(first, end):
        for n in range(first, end):
            done = field.cut(rectangle(1.0, 4.0 * n, 8.2, 4.0 * n + 4.01), 0.15)
            laid = rectangle(3.0, 4.0 * n, 4.4, 4.0 * n + 4.0)
            field.deposit_straw(laid, done.straw, heading=np.pi / 2)
            straw.append(done.straw)

    tracemalloc.start()
    mow(0, 100)
    gc.collect()  # what waits to be collected does not count
    held, left = tracemalloc.get_traced_memory()[0], int(field.store.counters[DROPPED])
    mow(100, 200)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - held
    tracemalloc.stop()
    assert int(field.store.counters[DROPPED]) - left > 80
    assert grown < 150_000  # bytes of 400 m; all that was done to the pages takes three times as much
    assert field.straw_kg == pytest.approx(sum(straw), rel=1e-9)
    again = made_field(page_limit=24)
    again.load(field.save())
    assert again.straw_kg == field.straw_kg
    field.ensure(4.0, 20.0, 10.0)
    again.ensure(4.0, 20.0, 10.0)
    assert len(again.store.keys) >= 4
    for key in again.store.keys:
        assert page_bytes(again, key) == page_bytes(field, key)
