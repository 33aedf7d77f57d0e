"""Cutting: each cell once, masses that add up, edges that are found again."""

import math

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.cutting.cut_result import Cut
from swath.field.cutting.height_bounds import update_tops
from swath.field.edges.edge import GapParams, StraightEdge, TeethParams
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, different_pages
from swath.field.stand import maps, uniform
from tests.field.made_field import CROP, library, made_field, rectangle

ALL_CROP = StraightEdge(x_m=-1e4)
NORTH = uniform.Params(row_azimuth_deg=90.0)  # rows run east: the stand frame is the world


def turned(polygon, angle, about=(0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    return (np.asarray(polygon) - about) @ np.array([[c, s], [-s, c]]) + about


def total(cuts):
    result = Cut()
    for cut in cuts:
        result = result + cut
    return result


def same(a, b, rel=1e-9):
    for name in ("grain", "straw", "area", "grain_left"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=rel, abs=1e-9), name
    assert a.stem_count == b.stem_count


def stems_inside(field, x0, y0, x1, y1):
    """Every stem in a rectangle of the stand frame, by its own position. Ids and their tile's stand."""
    lib, t = field.library, field.library.tile_size
    found, stand = [], []
    for j in range(int(y0 // t) - 1, int(y1 // t) + 2):
        for i in range(int(x0 // t) - 1, int(x1 // t) + 2):
            slot = field.store.keys[(i // 8, j // 8)]
            prototype = int(field.pages.tile_prototype[slot, j % 8, i % 8])
            k = prototype & 0xFFFF
            ids = np.arange(lib.stem_start[k], lib.stem_start[k + 1])
            x, y = lib.stem_xy[ids].astype(float).T
            x = i * t + (t - x if prototype & MIRROR_X else x)
            y = j * t + (t - y if prototype & MIRROR_Y else y)
            of = field.pages.tile_stand[slot, j % 8, i % 8].astype(float)
            ids = ids[(x >= x0) & (x < x1) & (y >= y0) & (y < y1) & (lib.stem_rank[ids] < of[3])]
            found += ids.tolist()
            stand += [of] * len(ids)
    return np.array(found), np.array(stand)


def test_masses_are_those_of_the_stems_that_stand_there():
    stand = uniform.Params(row_azimuth_deg=90.0, height_factor=1.2, stems_per_m2=500.0)
    field = made_field(edge=ALL_CROP, stand=stand)
    field.ensure(0.0, 0.0, 20.0)
    cell = field.maker.cell
    box = np.array([-3.0, 2.0, 7.5, 4.0]) // cell * cell
    ids, _ = stems_inside(field, *box)
    cut = field.cut(rectangle(*box), 0.2)
    lib = field.library
    above = np.clip(1.0 - 0.2 / (lib.stem_height[ids] * 1.2), 0.0, 1.0) ** CROP.yields.straw_exponent
    assert cut.stem_count == len(ids)
    assert cut.grain == pytest.approx(lib.grain_kg[ids].sum(), rel=1e-9)
    assert cut.straw == pytest.approx(np.sum(lib.straw_kg[ids] * 1.2 * above), rel=1e-6)
    assert cut.area == pytest.approx(10.5 * 2.0, abs=0.3)
    assert cut.stem_count == pytest.approx(500.0 * cut.area, rel=0.02)
    assert cut.grain_left == 0.0


def test_grain_and_straw_of_a_hectare_are_what_the_crop_sheet_says():
    field = made_field(edge=ALL_CROP)
    cut = field.cut(turned(rectangle(0.0, 0.0, 12.0, 12.0), 0.3), 0.15)
    assert cut.grain / cut.area == pytest.approx(500.0 * CROP.yields.grain_mass, rel=0.05)
    below = 1.0 - (1.0 - 0.15 / CROP.stand.height) ** CROP.yields.straw_exponent
    expected = 500.0 * CROP.yields.grain_mass * CROP.yields.straw_to_grain * (1.0 - below)
    assert cut.straw / cut.area == pytest.approx(expected, rel=0.05)


def test_overlapping_random_cuts_take_every_cell_once():
    field = made_field(
        edge=StraightEdge(heading_deg=70.0, teeth=TeethParams(amplitude_m=0.5, wavelength_m=2.0))
    )
    rng = np.random.Generator(np.random.Philox(4))
    polygons, cuts = [], []
    for _ in range(25):
        middle, angle = rng.uniform(-4.0, 4.0, 2), rng.uniform(0.0, 2 * np.pi)
        size = rng.uniform(0.1, 2.0, 2)
        polygon = turned(rectangle(-size[0], -size[1], size[0], size[1]), angle) + middle
        polygons.append(polygon[:: rng.choice([-1, 1])])
    n = np.arange(-450, 450)
    x, y = field.maker.to_world((n + 0.5) * field.maker.cell, (n[:, None] + 0.5) * field.maker.cell)
    covered = np.zeros(x.shape, bool)
    for polygon in polygons:
        p = np.asarray(polygon)
        e = np.roll(p, -1, axis=0) - p
        side = [ex * (y - py) - ey * (x - px) for (px, py), (ex, ey) in zip(p, e, strict=True)]
        covered |= np.all(np.array(side) > 0.0, axis=0) | np.all(np.array(side) < 0.0, axis=0)
    stood = field.standing(x, y)
    cuts = [field.cut(polygon, 0.15) for polygon in polygons]
    stands = field.standing(x, y)
    wrong = stands != (stood & ~covered)
    assert wrong.sum() <= 2  # cells whose centre lies on a side to rounding
    assert total(cuts).area == pytest.approx((stood & ~stands).sum() * field.maker.cell**2, rel=1e-12)
    same(field.recount(), total(cuts))
    assert total(field.cut(polygon, 0.15) for polygon in polygons) == Cut()


def test_small_steps_take_as_much_as_one_large_cut():
    one, many = made_field(edge=ALL_CROP), made_field(edge=ALL_CROP)
    strip = turned(rectangle(0.0, 0.0, 4.0, 9.0), 0.4)
    whole = one.cut(strip, 0.15)
    along = (strip[3] - strip[0]) / 200
    steps = [many.cut([strip[0] + along * n, strip[1] + along * n, strip[1] + along * (n + 1.3),
                       strip[0] + along * (n + 1.3)], 0.15) for n in range(199)]  # fmt: skip
    last = many.cut(strip, 0.15)
    same(total([*steps, last]), whole)
    assert last.area == pytest.approx(0.7 / 200 * 36.0, abs=0.02)


def test_cutting_again_takes_what_is_left_above_the_lower_height():
    low, twice = made_field(edge=ALL_CROP), made_field(edge=ALL_CROP)
    place = turned(rectangle(0.0, 0.0, 3.0, 3.0), 0.2)
    direct = low.cut(place, 0.12)
    first, second = twice.cut(place, 0.34), twice.cut(place, 0.12)
    assert (second.stem_count, second.area, second.grain) == (0, 0.0, 0.0)
    assert second.straw > 0.05 * first.straw
    same(first + second, direct)
    assert twice.cut(place, 0.5) == Cut()
    same(twice.recount(), direct)


def test_ears_below_the_knife_stay_in_the_field():
    lodged = uniform.Params(lean_deg=75.0)
    field = made_field(edge=ALL_CROP, stand=lodged)
    cut = field.cut(rectangle(0.0, 0.0, 4.0, 4.0), 0.5)
    assert cut.grain == 0.0
    assert cut.grain_left == pytest.approx(cut.stem_count * CROP.yields.grain_mass, rel=0.05)
    deep = field.cut(rectangle(0.0, 0.0, 4.0, 4.0), 0.05)
    assert deep.grain == pytest.approx(-deep.grain_left)
    assert deep.grain == pytest.approx(cut.grain_left, rel=0.01)


def test_thin_stands_give_in_proportion():
    thin, dense = (
        made_field(edge=ALL_CROP, stand=maps.Params(stems_per_m2=n, height_variation=maps.Variation()))
        for n in (125.0, 500.0)
    )
    place = rectangle(0.0, 0.0, 20.0, 10.0)
    few, many = thin.cut(place, 0.15), dense.cut(place, 0.15)
    assert few.area == many.area
    assert few.stem_count / many.stem_count == pytest.approx(0.25, rel=0.02)
    same(thin.recount(), few)


def test_nothing_is_taken_outside_the_boundary_or_from_gaps():
    edge = StraightEdge(
        x_m=-49.0, gaps=(GapParams(start_m=2.0, end_m=6.0, depth_m=200.0, stubble_height_m=0.1),)
    )
    field = made_field(edge=edge, boundary=rectangle(-50.0, -20.0, 50.0, 20.0))
    assert field.cut(rectangle(51.0, -5.0, 60.0, 5.0), 0.15) == Cut()
    assert field.cut(rectangle(0.0, 2.1, 5.0, 5.9), 0.15) == Cut()
    assert field.standing_area(rectangle(40.0, 10.0, 60.0, 30.0)) == pytest.approx(100.0, rel=2e-3)
    assert field.cut(rectangle(40.0, 10.0, 60.0, 30.0), 0.15).area == pytest.approx(100.0, rel=2e-3)
    assert field.standing_area(rectangle(40.0, 10.0, 60.0, 30.0)) == 0.0


def test_tiny_polygons_cut_nothing_or_one_cell():
    field = made_field(edge=ALL_CROP)
    cell = field.maker.cell
    x, y = field.maker.to_world(10.5 * cell, 7.5 * cell)
    around = np.array([[-0.1, -0.1], [0.1, -0.1], [0.0, 0.1]]) * cell
    assert field.cut(around + np.array([x + 0.4 * cell, y]), 0.15).area == 0.0
    assert field.cut(around + np.array([x, y]), 0.15).area == pytest.approx(cell**2)


def drive(field, start, stop):
    """Steps of a header of 6 m along x = 0, with straw behind; what was cut."""
    cuts = []
    for n in range(start, stop):
        y = 0.25 * n
        cuts.append(field.cut(turned(rectangle(-0.2, y, 5.8, y + 0.35), 0.05), 0.15))
        field.deposit_straw(rectangle(2.0, y - 6.0, 3.4, y - 5.75), cuts[-1].straw, heading=np.pi / 2)
    return cuts


@pytest.mark.parametrize("corner_count", [3, 4, 9, 70])
def test_standing_area_counts_the_cells_whose_middle_is_inside(corner_count):
    """Over cut and uncut crop, in memory and not: all cells one by one, but those on a side to rounding."""
    field = made_field(edge=StraightEdge(teeth=TeethParams(amplitude_m=0.5, wavelength_m=2.0)))
    draw, cell = np.random.default_rng(corner_count), field.maker.cell
    field.cut(turned(rectangle(0.0, -3.0, 6.0, 2.0), 0.4), 0.15)
    n = np.arange(-330, 330)
    x, y = field.maker.to_world((n + 0.5) * cell, (n[:, None] + 0.5) * cell)
    stands = field.standing(x, y)
    for _ in range(3):
        at = np.sort(draw.uniform(0.0, 2 * np.pi, corner_count))
        size, middle = draw.uniform(1.0, 3.0), draw.uniform(-2.0, 2.0, 2)
        corners = size * np.column_stack([np.cos(at), np.sin(at)]) + middle
        sides = zip(corners, np.roll(corners, -1, axis=0) - corners, strict=True)
        inside = np.all([ex * (y - py) - ey * (x - px) > 0.0 for (px, py), (ex, ey) in sides], axis=0)
        area = field.standing_area(corners)
        assert area == pytest.approx((inside & stands).sum() * cell**2, abs=3 * cell**2)
        fresh = made_field(edge=StraightEdge(teeth=TeethParams(amplitude_m=0.5, wavelength_m=2.0)))
        fresh.cut(turned(rectangle(0.0, -3.0, 6.0, 2.0), 0.4), 0.15)
        assert fresh.standing_area(corners) == area


def test_a_resumed_field_is_byte_identical():
    through, first, second = (made_field(page_limit=60) for _ in range(3))
    expected = drive(through, 0, 120)
    head = drive(first, 0, 70)
    state = first.save()
    drive(first, 70, 90)  # must not leak into the saved state
    second.load(state)
    assert head + drive(second, 70, 120) == expected
    a, b = through.save(), second.save()
    assert np.array_equal(a["keys"], b["keys"])
    assert a["codes"] == b["codes"]
    assert a["straw"] == b["straw"]
    for key in {*through.store.keys} & {*second.store.keys}:
        s, t = through.store.keys[key], second.store.keys[key]
        assert np.array_equal(through.pages.straw[s], second.pages.straw[t])
        assert np.array_equal(through.store.codes_of(key), second.store.codes_of(key))
    same(second.recount(), total(expected))


def test_a_field_as_sown_saves_nothing():
    field = made_field()
    field.ensure(0.0, 0.0, 50.0)
    field.cut(rectangle(-20.0, 0.0, -10.0, 5.0), 0.15)
    assert len(field.save()["keys"]) == 0


def test_a_kilometre_in_a_field_of_100_hectares_hold_little_memory():
    field = made_field(boundary=rectangle(-20.0, 0.0, 980.0, 1000.0), page_limit=128)
    cuts, straw = [], 0.0
    for lane in range(2):
        x = 7.0 * lane
        for n in range(100):
            y = 5.0 * n
            cuts.append(field.cut(rectangle(x, y, x + 7.2, y + 5.01), 0.15))
            field.deposit_straw(rectangle(x + 3.0, y, x + 4.4, y + 5.0), cuts[-1].straw, heading=np.pi / 2)
            straw += cuts[-1].straw
            if n % 10 == 0:
                field.ensure(x, y, 40.0)
    assert field.store.byte_count < 50e6
    assert total(cuts).area == pytest.approx(14.2 * 500.0, rel=2e-3)
    same(field.recount(), total(cuts))
    assert field.straw_kg == pytest.approx(straw, rel=1e-9)


@pytest.mark.parametrize(
    "polygon",
    [
        [[0.0, 0.0], [1.0, 0.0]],
        [[0.0, 0.0], [2.0, 0.0], [1.0, 0.5], [2.0, 2.0], [0.0, 2.0]],
        [[0.0, 0.0], [np.inf, 0.0], [0.0, 1.0]],
        [[0.0, 0.0], [1e8, 0.0], [0.0, 1.0]],
        "here",
    ],
)
def test_polygons_that_cannot_be_cut_are_refused(polygon):
    field = made_field()
    for call in (lambda: field.cut(polygon, 0.15), lambda: field.standing_area(polygon)):
        with pytest.raises(InputError, match="expected"):
            call()


@pytest.mark.parametrize("height", [-0.1, 3.0, np.nan])
def test_heights_that_cannot_be_are_refused(height):
    with pytest.raises(InputError, match="height_m"):
        made_field().cut(rectangle(0.0, 0.0, 1.0, 1.0), height)


def test_the_library_of_the_tests_is_a_real_one():
    lib = library()
    assert lib.tile_count == 4
    assert np.all(np.diff(lib.stem_start) == round(500.0 * lib.tile_size**2))


def test_tops_after_a_cut_are_those_of_a_fresh_look():
    """The compiled cut renews only tiles that can have changed; looked at anew all tops are the same."""
    field = made_field(edge=ALL_CROP, stand=uniform.Params(lean_deg=40.0, row_azimuth_deg=70.0))
    field.ensure(0.0, 0.0, 25.0)
    rng = np.random.default_rng(4)
    lowered = 0
    for _ in range(12):
        middle = rng.uniform(-12.0, 12.0, 2)
        angle = rng.uniform(-np.pi, np.pi)
        field.cut(turned(rectangle(-3.0, -5.0, 3.0, 5.0), angle) + middle, rng.choice([0.0, 0.2, 0.4]))
        before = field.pages.tile_top.copy()
        update_tops(field.store, field.library, list(field.store.keys))
        np.testing.assert_array_equal(field.pages.tile_top, before)
        lowered = int(np.sum((before > 0.0) & (before < 0.5)))
    assert lowered > 20


def test_tops_are_those_of_the_crop_that_a_tile_shows():
    """Looked at tile by tile: STANDING where no page is, the highest code within the reach of what leans."""
    field = made_field(edge=ALL_CROP, stand=uniform.Params(lean_deg=40.0, row_azimuth_deg=70.0))
    field.ensure(0.0, 0.0, 20.0)
    rng = np.random.default_rng(7)
    for _ in range(15):
        middle, angle = rng.uniform(-12.0, 12.0, 2), rng.uniform(-np.pi, np.pi)
        field.cut(turned(rectangle(-3.0, -5.0, 3.0, 5.0), angle) + middle, rng.choice([0.0, 0.2, 0.4]))
    store, p, lib = field.store, field.pages, field.library
    highest = {
        (8 * i + u, 8 * j + v): int(store.code_max[slot, v, u])
        for (i, j), slot in store.keys.items() for v, u in np.ndindex(8, 8)
    }  # fmt: skip
    for (x, y), own in highest.items():
        at = store.keys[x // 8, y // 8], y % 8, x % 8
        scale, lean_x, lean_y, density = p.tile_stand[at].astype(float)
        reach = min(math.ceil((lib.reach + math.hypot(lean_x, lean_y) * lib.height_max) / lib.tile_size), 4)
        span = range(-reach, reach + 1)
        code = max(highest.get((x + a, y + b), 255) for a in span for b in span)
        top = min(lib.height_max * scale, 0.01 * code if code < 255 else np.inf) + 0.001
        assert p.tile_top[at] == np.float32(0.0 if code == 0 or density <= 0.0 else top), own


def test_a_cut_across_many_pages_is_the_sum_of_its_parts():
    """270 pages: more than one launch takes."""
    thin = uniform.Params(row_azimuth_deg=90.0, stems_per_m2=2.0, row_spacing_m=0.0)
    whole, parts = (made_field(edge=ALL_CROP, stand=thin) for _ in range(2))
    box = rectangle(-110.0, 5.0, 100.0, 85.0)
    taken = whole.cut(box, 0.2)
    cuts = [parts.cut(rectangle(x, 5.0, x + 35.0, 85.0), 0.2) for x in np.arange(-110.0, 100.0, 35.0)]
    same(taken, total(cuts))
    same(taken, whole.recount())
    assert taken.area == pytest.approx(210.0 * 80.0, rel=1e-3)
    assert taken.stem_count == pytest.approx(2.0 * 210.0 * 80.0, rel=0.02)


def test_a_cut_polygon_has_few_corners():
    turn = np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)
    field = made_field(edge=ALL_CROP)
    circle = np.c_[np.cos(turn), 8.0 + np.sin(turn)]
    with pytest.raises(InputError, match="polygon = 80: expected at most 64 corners"):
        field.cut(circle, 0.1)
    assert field.cut(circle[::2], 0.1).area == pytest.approx(np.pi, rel=0.01)


def test_the_pages_of_some_cells_are_each_named_once():
    i = np.array([3, 3, -2, -2, 3, -2])
    j = np.array([-7, -7, 4, 5, -7, 4])
    assert different_pages(i, j) == [(-2, 4), (-2, 5), (3, -7)]
    assert different_pages(i[:0], j[:0]) == []
