"""Every crop against its sheet and against what is published of it: sizes, places, masses, areas, memory."""

from functools import cache

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import DEG
from swath.documents.data_sheets import find_sheet, sheet_names
from swath.field.crop_sheet import Weeds, load_crop, weed_crop
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import Organ
from swath.field.plants import Drawing, make_plants
from swath.field.plants.cereal import AwnFacts, EarFacts
from swath.field.prototypes import _ear_heights, make_library
from swath.field.stand import maps, uniform
from swath.field.terrain import plane
from tests.changed_sheets import changed_sheet
from tests.field.made_field import STREAM, rectangle
from tests.field.silhouettes import silhouette_area

pytestmark = pytest.mark.usefixtures("code_allowed")

COUNT = 1500
CEREALS = ("wheat", "barley", "rye")
GRAIN = {
    "wheat": (8, 11),
    "barley": (6.8, 7.4),
    "rye": (5, 8),
    "rape": (3, 4),
    "maize": (9, 12),
    "soy": (3, 4),
}  # t/ha
STRAW_TO_GRAIN = {"wheat": (0.6, 0.7), "barley": (0.6, 0.8), "rye": (0.9, 1.2), "rape": (1.2, 2.0)}
HARVEST_INDEX = {"wheat": (0.5, 0.55), "barley": (0.48, 0.54), "rye": (0.4, 0.45), "rape": (0.28, 0.35)}


@cache
def grown(name):
    return load_crop(name), make_plants(load_crop(name), COUNT, np.random.default_rng(1))


@cache
def small(name, density=None, tiles=2, weeds=None):
    crop = load_crop(name)
    return make_library(
        crop,
        density_max=density or crop.stand.density,
        row_spacing=crop.stand.row_spacing,
        seed=Stream(1, "crops"),
        tile_count=tiles,
        weeds=None if weeds is None else weed_crop(weeds),
    )


def inclination(plants, organ):
    along = (plants.b - plants.a)[plants.organ == organ]
    return np.arccos(along[:, 2] / np.linalg.norm(along, axis=1))


@pytest.mark.parametrize("name", sheet_names("crops"))
def test_heights_are_the_sheet_s_and_reach_the_tip(name):
    crop, plants = grown(name)
    assert plants.height.mean() == pytest.approx(crop.stand.height, rel=0.015)
    assert plants.height.std() / plants.height.mean() == pytest.approx(crop.stand.height_cv, rel=0.08)
    solid = (plants.organ != Organ.AWN) & (plants.radius > 0.0)
    tip = np.zeros(COUNT)
    np.maximum.at(tip, plants.owner[solid], (np.maximum(plants.a, plants.b)[:, 2] + plants.radius)[solid])
    np.testing.assert_allclose(tip, plants.height, atol=0.03 if name in ("rape", "soy") else 0.006)


@pytest.mark.parametrize("name", GRAIN)
def test_yield_straw_and_harvest_index_are_the_published_ones(name):
    crop, plants = grown(name)
    grain = plants.grain_kg.mean() * crop.stand.density * 10.0
    assert GRAIN[name][0] <= grain <= GRAIN[name][1]
    assert plants.grain_kg.mean() == pytest.approx(crop.yields.grain_mass, rel=1e-12)
    assert plants.straw_kg.mean() == pytest.approx(crop.yields.straw_mass, rel=1e-12)
    assert (plants.grain_kg > 0).all()
    if name in STRAW_TO_GRAIN:
        above = 1.0 - crop.stand.stubble_height / crop.stand.height
        cut = 1.0 - above**crop.yields.straw_exponent
        through = crop.yields.straw_to_grain * (1.0 - cut)
        assert STRAW_TO_GRAIN[name][0] <= through <= STRAW_TO_GRAIN[name][1]
        index = 1.0 / (1.0 + crop.yields.straw_to_grain)
        assert HARVEST_INDEX[name][0] <= index <= HARVEST_INDEX[name][1]


@pytest.mark.parametrize("name", CEREALS)
def test_silhouettes_of_cereals_follow_from_number_length_and_width(name):
    crop, plants = grown(name)
    area = {o: a / COUNT for o, a in silhouette_area(plants).items()}
    ear, awn = crop.organs[EarFacts], crop.organs.of(AwnFacts)
    middle = 0.5 * (crop.stem.diameter_base + crop.stem.diameter_top)
    assert 0.9 * crop.stand.height * middle < area[Organ.STEM] < 1.1 * crop.stand.height * middle
    assert area[Organ.EAR] == pytest.approx(ear.length * ear.diameter, rel=0.06)
    if awn is not None:
        assert area[Organ.AWN] == pytest.approx(awn.per_ear * awn.length * awn.diameter, rel=0.02)


def test_barley_nods_on_a_bent_neck_with_awns_beyond_its_ears():
    crop, plants = grown("barley")
    tilt = inclination(plants, Organ.EAR)
    assert np.mean((tilt > 60 * DEG) & (tilt < 130 * DEG)) > 0.93
    assert tilt.mean() == pytest.approx(95 * DEG, abs=2 * DEG)
    ear, stem = plants.organ == Organ.EAR, plants.organ == Organ.STEM
    pieces = stem.sum() // COUNT
    a, b = (v[stem].reshape(COUNT, pieces, 3) for v in (plants.a, plants.b))
    np.testing.assert_allclose(a[:, 1:], b[:, :-1], atol=1e-12)
    gap = np.linalg.norm(plants.a[ear] - b[:, -1], axis=1)
    np.testing.assert_allclose(gap, plants.radius[ear], atol=1e-9)
    awn = plants.organ == Organ.AWN
    assert awn.sum() == COUNT * crop.organs[AwnFacts].drawn
    assert np.linalg.norm((plants.b - plants.a)[awn], axis=1).mean() == pytest.approx(0.11, rel=0.01)
    axis = (plants.b - plants.a)[ear][plants.owner[awn]]
    along = (plants.b - plants.a)[awn]
    cos = (axis * along).sum(1) / np.linalg.norm(axis, axis=1) / np.linalg.norm(along, axis=1)
    np.testing.assert_allclose(cos, np.cos(12 * DEG), atol=1e-9)


def test_rye_is_tall_and_bends_over():
    crop, plants = grown("rye")
    tilt = inclination(plants, Organ.EAR)
    assert np.mean((tilt > 30 * DEG) & (tilt < 90 * DEG)) > 0.93
    assert 1.2 <= plants.height.mean() <= 1.6
    assert 0.004 <= crop.stem.diameter_base <= 0.005


def test_rape_carries_its_pods_in_a_layer_of_branches():
    crop, plants = grown("rape")
    pod = plants.organ == Organ.POD
    assert 6000 < pod.sum() / COUNT * crop.stand.density < 8000
    middle = 0.5 * (plants.a + plants.b)[pod, 2]
    assert np.mean((middle > 0.7) & (middle < 1.5)) > 0.9
    size = np.linalg.norm((plants.b - plants.a)[pod], axis=1) + 2 * plants.radius[pod]
    assert size.mean() == pytest.approx(0.07, rel=0.01)
    tilt = inclination(plants, Organ.POD)
    assert 45 * DEG < tilt.mean() < 60 * DEG
    length = np.bincount(plants.owner[pod], size, COUNT)
    assert np.corrcoef(length, plants.grain_kg)[0, 1] > 0.999
    branch = plants.organ == Organ.BRANCH
    number = np.bincount(plants.owner[branch], minlength=COUNT) / 3
    assert set(number) == {6.0, 7.0, 8.0, 9.0}
    a, b = (v[branch].reshape(-1, 3, 3) for v in (plants.a, plants.b))
    np.testing.assert_allclose(a[:, 1:], b[:, :-1], atol=1e-12)
    assert b[:, -1, 2].max() < 1.05 * plants.height.max()


def test_maize_has_one_cob_at_its_height_and_rows_of_75_cm():
    plants = grown("maize")[1]
    cob = plants.organ == Organ.COB
    assert np.array_equal(plants.owner[cob], np.arange(COUNT))
    foot = plants.a[cob, 2] - plants.radius[cob] * np.cos(inclination(plants, Organ.COB))
    assert foot.mean() == pytest.approx(1.1, abs=0.02)
    assert np.mean((foot > 0.9) & (foot < 1.3)) > 0.95
    assert plants.b[plants.organ == Organ.LEAF, 2].min() > -0.05
    library = small("maize", tiles=8)
    assert library.tile_size == 1.5
    row = library.stem_xy[:, 1] / 0.75 % 1.0 - 0.5
    assert np.abs(row).max() * 0.75 < 0.05
    assert 8.5 <= library.density_max < 9.0
    assert len(library.stem_xy) / 8 == round(library.density_max * 1.5**2)
    for rows in np.split(library.stem_xy, 8):
        along = np.sort(rows[rows[:, 1] < 0.75, 0])
        gap = np.diff(np.r_[along, along[0] + 1.5])
        assert gap.max() < 2.0 * gap.mean()


@pytest.mark.parametrize("name", [n for n in sheet_names("crops") if n != "wheat"])
def test_points_on_primitives_are_listed_and_copies_complete(name):
    library = small(name, density=min(load_crop(name).stand.density, 120.0))
    size = library.tile_size
    rng = np.random.default_rng(1)
    index = rng.integers(0, len(library.owner), 4000)
    a, b, w = (x[index].astype(float) for x in (library.a, library.b, library.width))
    direction = rng.normal(size=a.shape)
    direction *= (library.radius[index] / np.linalg.norm(direction, axis=1))[:, None]
    point = a + rng.random((4000, 1)) * (b - a) + rng.uniform(-1, 1, (4000, 1)) * w + direction
    inside = ((point[:, :2] >= 0) & (point[:, :2] < size)).all(axis=1)
    ix, iy, iz = np.floor(point / [size / 20, size / 20, library.bin_height]).astype(int).T
    iz = np.clip(iz, 0, library.bins - 1)
    tile = np.searchsorted(library.stem_start, library.owner[index], side="right") - 1
    cell = ((tile * 20 + iy) * 20 + ix) * library.bins + iz
    listed = [
        i in library.cell_items[library.cell_start[c] : library.cell_start[c + 1]]
        for i, c in zip(index[inside], cell[inside], strict=True)
    ]
    assert len(listed) > 1000
    assert all(listed)
    shift = np.round((library.base - library.stem_xy[library.owner]) / size).astype(int)
    reach = library.radius[:, None] + np.abs(library.width[:, :2])
    low = np.minimum(library.a, library.b)[:, :2] - reach - shift * size
    high = np.maximum(library.a, library.b)[:, :2] + reach - shift * size
    key = np.c_[library.owner, library.organ, library.a[:, 2], library.b[:, 2]]
    _, piece = np.unique(key, axis=0, return_inverse=True)
    for move in ((-1, 0), (1, 0), (0, 1), (1, 1)):
        overlaps = (
            (low + np.multiply(move, size) < size - 1e-3) & (high + np.multiply(move, size) > 1e-3)
        ).all(axis=1)
        assert set(piece[overlaps]) <= set(piece[(shift == move).all(axis=1)])


@pytest.mark.parametrize("name", sheet_names("crops"))
def test_the_library_of_sixteen_tiles_stays_below_25_mb(name):
    library = small(name)
    size = sum(v.nbytes for v in vars(library).values() if isinstance(v, np.ndarray))
    assert 16 / library.tile_count * size < 25e6


def grow(stand, setup=None):
    setup = setup or FieldSetup(STREAM)
    ground = plane.Plane(plane.Params(), setup)
    edge = make_edge(StraightEdge(x_m=-60.0), setup)
    return make_field(ground, stand, edge, crop=load_crop(stand.crop), stream=setup.stream)


@pytest.mark.parametrize("kind", [uniform, maps])
def test_density_and_rows_come_from_the_sheet_unless_given(kind):
    make = uniform.Uniform if kind is uniform else maps.Maps
    own = make(kind.Params(crop="maize"), FieldSetup())
    assert (float(own.density(0.0, 0.0)), own.row_spacing) == (8.5, 0.75)
    given = make(kind.Params(crop="maize", stems_per_m2=7.0, row_spacing_m=0.5), FieldSetup())
    assert (float(given.density(0.0, 0.0)), given.row_spacing) == (7.0, 0.5)


def test_few_plants_per_tile_still_meet_the_density():
    field = grow(uniform.Uniform(uniform.Params(crop="maize"), FieldSetup()))
    cut = field.cut(rectangle(0.0, 0.0, 30.0, 20.0), 0.3)
    assert cut.stem_count / cut.area == pytest.approx(8.5, rel=0.02)
    assert cut.grain / cut.area * 10.0 == pytest.approx(10.7, rel=0.04)
    assert cut.grain_left == 0.0


@pytest.mark.parametrize(("name", "height", "left"), [("rape", 0.6, 0.0), ("maize", 1.7, 1.0)])
def test_a_cut_above_pods_or_cobs_leaves_the_grain(name, height, left):
    field = grow(uniform.Uniform(uniform.Params(crop=name), FieldSetup()))
    cut = field.cut(rectangle(0.0, 0.0, 6.0, 6.0), height)
    assert cut.grain_left / (cut.grain + cut.grain_left) == pytest.approx(left, abs=0.02)


def test_weeds_stand_beside_an_unchanged_crop():
    weeds = Weeds(plants_per_m2=30.0, height_m=0.3)
    plain, weedy = small("wheat", 200.0), small("wheat", 200.0, weeds=weeds)
    is_weed = np.zeros(len(weedy.stem_xy), dtype=bool)
    is_weed[weedy.owner[weedy.organ == Organ.WEED]] = True
    assert plain.stem_xy.tobytes() == weedy.stem_xy[~is_weed].tobytes()
    assert plain.stem_rank.tobytes() == weedy.stem_rank[~is_weed].tobytes()
    assert is_weed.sum() == 60
    assert (weedy.stem_rank[is_weed] == 0.0).all()
    assert (weedy.grain_kg[is_weed] == 0.0).all()
    assert weedy.stem_height[is_weed].mean() == pytest.approx(0.3, rel=0.08)
    tile = np.searchsorted(weedy.stem_start, np.arange(len(weedy.stem_xy)), side="right") - 1
    assert np.array_equal(np.bincount(tile[is_weed]), [30, 30])
    assert plain.reflectance[Organ.WEED] == pytest.approx(0.47)


def test_a_cut_takes_what_of_the_weeds_is_above_it():
    setup = FieldSetup(STREAM)
    stand = {"stems_per_m2": 60.0}
    weeds = Weeds(plants_per_m2=30.0, height_m=0.3)
    plain = grow(uniform.Uniform(uniform.Params(**stand), setup))
    weedy = grow(uniform.Uniform(uniform.Params(**stand, weeds=weeds), setup))
    place = rectangle(0.0, 0.0, 8.0, 4.0)
    high = [field.cut(place, 0.6) for field in (plain, weedy)]
    assert high[0] == high[1]
    low = [field.cut(place, 0.05) for field in (plain, weedy)]
    assert low[1].stem_count == low[0].stem_count == 0
    mass = load_crop("weed").yields.bare_mass * (0.3 / 0.4) ** 2 * 30.0 * high[0].area
    assert 0.6 * mass < low[1].straw - low[0].straw < mass
    again, gone = weedy.recount(), high[1] + low[1]
    assert (again.stem_count, again.area) == (gone.stem_count, pytest.approx(gone.area))
    assert again.straw == pytest.approx(gone.straw, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "key", "change", "message"),
    [
        (
            "rape",
            "habit",
            "bushy",
            "habit = bushy: expected one of branched, cereal, maize, ",
        ),
        ("rape", "pod", None, "pod: expected a value, the key is missing"),
        ("rape", "branch.foot_max_percent", {"value": 10}, "branch.foot_max_percent = 10: expected at least"),
        ("rape", "pod.per_plant", {"value": 1.5}, "pod.per_plant = 1.5: expected a whole number"),
        ("barley", "awn.length_mm", {"value": 900}, "awn.length_mm = 900: expected <= 300"),
        ("maize", "stand.row_spacing_cm", {"value": 150}, "stand.row_spacing_cm = 150: expected <= 100"),
        ("maize", "reflectance.cob", None, "reflectance.cob: expected a value, the key is missing"),
        ("wheat", "ear.length_mm", {"value": 8}, "ear.length_mm = 8: expected longer than wide"),
        ("wheat", "leaf.count_max", {"value": 1}, "leaf.count_max = 1: expected at least leaf.count_min = 2"),
        ("wheat", "stand.density_per_m2", {"value": -5}, "stand.density_per_m2 = -5: expected >= 1"),
        ("wheat", "stand.height_cm", {"unit": "m"}, "stand.height_cm.unit = m: unknown key"),
        (
            "wheat",
            "yield.grains_per_ear",
            {"tag": "X"},
            "yield.grains_per_ear.tag = X: expected one of S seen",
        ),
        (
            "wheat",
            "yield.straw_below_height_cm",
            {"value": 80},
            "yield.straw_below_height_cm = 80: expected at most",
        ),
    ],
)
def test_a_bad_sheet_names_key_and_line(tmp_path, name, key, change, message):
    if key == "reflectance.cob" and name == "wheat":
        path = changed_sheet(tmp_path, "crops", name, "reflectance", {"cob": change})
    else:
        path = changed_sheet(tmp_path, "crops", name, key, change)
    with pytest.raises(InputError) as caught:
        load_crop(str(path))
    assert str(caught.value).startswith(message)
    assert "own.yaml:" in str(caught.value)


TOY = """
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from swath.documents.sheet_fields import Quantity
from swath.field.crop import BareYield, Habit
from swath.field.memory_layout import Organ
from swath.field.plants.parts import assemble, rods


@dataclass(frozen=True, kw_only=True)
class SpikeFacts:
    radius: Annotated[float, Quantity("mm", 1, 50)]


def make(crop, count, rng, how):
    height = rng.uniform(0.9, 1.1, count) * crop.stand.height
    foot, tip = np.zeros((count, 3)), np.stack([0 * height, 0 * height, height], axis=-1)
    spike = rods(Organ.STEM, foot, tip, np.full(count, crop.organs[SpikeFacts].radius), np.arange(count))
    return assemble(height, np.zeros(count), np.full(count, crop.yields.straw_mass), [spike])


HABIT = Habit(make, yields=BareYield, organs={"spike": SpikeFacts})
"""


def test_a_habit_of_the_user_is_one_file_and_a_sheet(tmp_path):
    """Asparagus: two files beside each other, and nothing else is touched."""
    sheet = find_sheet("crops", "stubble").read_text().replace("habit: stubble", "habit: toy.py")
    sheet += "spike:\n  radius_mm: {value: 12, tag: E, source: a ruler}\n"
    (tmp_path / "asparagus.yaml").write_text(sheet)
    (tmp_path / "toy.py").write_text(TOY)
    crop = load_crop("asparagus.yaml", tmp_path)
    library = make_library(crop, density_max=40.0, row_spacing=0.0, seed=Stream(1, "toy"), tile_count=2)
    assert set(library.organ) == {Organ.STEM}
    np.testing.assert_allclose(library.radius, 0.012, rtol=1e-6)
    assert len(list(tmp_path.iterdir())) - ((tmp_path / "__pycache__").is_dir()) == 2
    (tmp_path / "toy.py").write_text(TOY.replace("HABIT", "HABITS"))
    with pytest.raises(InputError, match=r"toy.py: expected a file that defines HABIT.*asparagus.yaml:4"):
        load_crop("asparagus.yaml", tmp_path)
    with pytest.raises(InputError, match=r"habit = toys.py: expected a Python file"):
        load_crop(str(changed_sheet(tmp_path, "crops", "stubble", "habit", "toys.py")))


@pytest.mark.parametrize("name", GRAIN)
def test_what_a_header_needs_of_stems_is_that_of_whole_plants(name):
    crop, plants = grown(name)
    light = make_plants(crop, COUNT, np.random.default_rng(1), Drawing(fruit_only=True))
    for part in ("height", "grain_kg", "straw_kg"):
        np.testing.assert_array_equal(getattr(light, part), getattr(plants, part), strict=True)
    np.testing.assert_array_equal(_ear_heights(light), _ear_heights(plants), strict=True)
    assert (len(light.shape) < len(plants.shape)) == crop.habit.fruit_only
