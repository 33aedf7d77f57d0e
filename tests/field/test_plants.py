"""Plants against the crop's facts: organ sizes, silhouettes, masses."""

import re

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.units import DEG
from swath.documents.data_sheets import find_sheet, sheet_names
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import Organ, Shape
from swath.field.plants import Drawing, make_plants
from tests.changed_sheets import changed_sheet
from tests.field.silhouettes import silhouette_area

WHEAT = load_crop("wheat")
COUNT = 4000
PLANTS = make_plants(WHEAT, COUNT, np.random.default_rng(1))


def part(organ):
    return PLANTS.organ == organ


def test_heights_reach_from_the_ground_to_the_tip():
    assert PLANTS.height.mean() == pytest.approx(0.85, abs=0.005)
    assert PLANTS.height.std() / PLANTS.height.mean() == pytest.approx(0.08, abs=0.005)
    tip = np.full(COUNT, -1.0)
    solid = part(Organ.EAR) | part(Organ.STEM)
    ends = np.maximum(PLANTS.a[:, 2], PLANTS.b[:, 2]) + PLANTS.radius
    np.maximum.at(tip, PLANTS.owner[solid], ends[solid])
    np.testing.assert_allclose(tip, PLANTS.height, atol=0.003)


def test_silhouettes_match_the_published_area_index():
    """At 500/m2: stalks 1.24, ears 0.54, both 1.8, dried leaves 0.3-0.8 m2/m2."""
    area = {organ: value / COUNT * 500 for organ, value in silhouette_area(PLANTS).items()}
    assert area[Organ.STEM] == pytest.approx(1.24, rel=0.05)
    assert area[Organ.EAR] == pytest.approx(0.54, rel=0.1)
    assert area[Organ.STEM] + area[Organ.EAR] == pytest.approx(1.8, rel=0.06)
    assert 0.3 < area[Organ.LEAF] < 0.8


def test_ears_have_their_length_and_nod():
    along = (PLANTS.b - PLANTS.a)[part(Organ.EAR)]
    length = np.linalg.norm(along, axis=1) + 2 * PLANTS.radius[part(Organ.EAR)]
    assert length.mean() == pytest.approx(0.09, rel=0.01)
    assert length.std() / length.mean() == pytest.approx(0.12, abs=0.01)
    tilt = np.arccos(along[:, 2] / np.linalg.norm(along, axis=1))
    assert tilt.mean() == pytest.approx(20 * DEG, abs=1.5 * DEG)


def test_stalks_taper_lean_and_carry_the_ear():
    stalk = part(Organ.STEM)
    a, b, r = (x[stalk].reshape(COUNT, 2, -1) for x in (PLANTS.a, PLANTS.b, PLANTS.radius))
    np.testing.assert_allclose(a[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(b[:, 0], a[:, 1])
    assert (r[:, 1] < r[:, 0]).all()
    top = b[:, 1]
    lean = np.arctan2(np.hypot(top[:, 0], top[:, 1]), top[:, 2])
    assert lean.mean() == pytest.approx(6.5 * DEG, abs=0.7 * DEG)
    foot = PLANTS.a[part(Organ.EAR)]
    gap = np.linalg.norm(foot - top, axis=1) - PLANTS.radius[part(Organ.EAR)]
    np.testing.assert_allclose(gap, 0.0, atol=1e-9)


def test_leaves_are_connected_ribbons():
    leaf = part(Organ.LEAF)
    assert (PLANTS.shape[leaf] == Shape.RIBBON).all()
    a, b, w = (x[leaf].reshape(-1, 3, 3) for x in (PLANTS.a, PLANTS.b, PLANTS.width))
    np.testing.assert_allclose(b[:, :2], a[:, 1:])
    np.testing.assert_allclose(w[:, 0], w[:, 2])
    number = np.bincount(PLANTS.owner[leaf], minlength=COUNT) / 3
    assert set(number) == {2.0, 3.0, 4.0}


def test_masses_match_the_yield():
    """40 grains of 45 mg per ear: 9 t/ha at 500 ears/m2; straw at a 15 cm cut 0.65 of the grain."""
    assert PLANTS.grain_kg.mean() == pytest.approx(40 * 45e-6, rel=1e-12)
    assert PLANTS.straw_kg.mean() == pytest.approx(0.85 * 40 * 45e-6, rel=1e-12)
    assert (PLANTS.grain_kg > 0).all()
    assert (PLANTS.straw_kg > 0).all()
    below = 1.0 - (1.0 - 0.15 / 0.85) ** WHEAT.yields.straw_exponent
    assert below == pytest.approx(0.225)
    assert 0.85 * (1 - below) == pytest.approx(0.65, abs=0.02)


def test_upright_stems_for_closed_forms():
    plants = make_plants(WHEAT, 50, np.random.default_rng(2), Drawing(leaves=False, upright=True))
    assert (plants.a[:, :2] == 0).all()
    assert (plants.b[:, :2] == 0).all()
    assert set(plants.organ) == {Organ.STEM, Organ.EAR}
    bare = make_plants(WHEAT, 50, np.random.default_rng(2), Drawing(leaves=False, ears=False, upright=True))
    assert set(bare.organ) == {Organ.STEM}


def test_the_same_generator_gives_the_same_plants():
    one, two = (make_plants(WHEAT, 20, np.random.default_rng(3)) for _ in range(2))
    assert one.a.tobytes() == two.a.tobytes()
    other = make_plants(WHEAT, 20, np.random.default_rng(4))
    assert one.a.shape != other.a.shape or one.a.tobytes() != other.a.tobytes()


def test_a_missing_key_and_an_unknown_crop(tmp_path):
    path = changed_sheet(tmp_path, "crops", "wheat", "ear.width_mm", None)
    with pytest.raises(InputError, match=r"ear\.width_mm: expected a value, the key is missing"):
        load_crop(str(path))
    with pytest.raises(InputError, match="did you mean 'wheat'"):
        load_crop("weat")


@pytest.mark.parametrize("crop", sheet_names("crops"))
def test_sizes_that_vary_by_half_stay_sizes(tmp_path, crop):
    text = find_sheet("crops", crop).read_text(encoding="utf-8")
    varied, count = re.subn(r"(?<=_cv_percent: {value: )[\d.]+", "50", text)
    (tmp_path / "own.yaml").write_text(varied, encoding="utf-8")
    plants = make_plants(load_crop(str(tmp_path / "own.yaml")), COUNT, np.random.default_rng(1))
    least = [plants.height.min(), plants.radius[plants.shape != Shape.RIBBON].min(initial=1.0)]
    assert count
    assert min(least) > 0.0
    assert np.isfinite(plants.a).all()
    assert plants.grain_kg.min() >= 0.0
    assert plants.straw_kg.min() >= 0.0
