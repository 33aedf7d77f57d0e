"""How far plants reach aside of their feet, against closed forms."""

import numpy as np
import pytest

from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import Organ, Shape
from swath.field.plants import make_plants
from swath.field.plants.parts import Plants
from swath.tools.calibrate.overhang import COUNT, LEVELS, STEP, VIEW, overhang


def rods(ends, radius=0.002, parts=10):
    """Plants of one rod each, in parts, from the foot to these ends (n, 3) [m]."""
    count = len(ends)
    none, share = np.zeros(count), np.arange(parts)[None, :, None] / parts
    a = (share * ends[:, None]).reshape(-1, 3)
    return Plants(
        height=ends[:, 2],
        grain_kg=none,
        straw_kg=none,
        shape=np.full(len(a), Shape.CAPSULE, np.uint8),
        organ=np.full(len(a), Organ.STEM, np.uint8),
        a=a,
        b=a + np.repeat(ends / parts, parts, axis=0),
        radius=np.full(len(a), radius),
        width=np.zeros((len(a), 3)),
        owner=np.repeat(np.arange(count, dtype=np.int32), parts),
    )


def test_rods_that_lean_alike_reach_aside_as_far_as_they_rise_and_more_across_the_beam():
    """A rod shows |rod x beam| of itself: that, not its length, weighs its place."""
    slope = 1.2
    angle = 2.0 * np.pi * (np.arange(4000) + 0.5) / 4000
    ends = np.stack([slope * np.cos(angle), slope * np.sin(angle), np.ones(4000)], axis=1)
    found = overhang(rods(ends), 1.0)
    assert found.shape == (LEVELS, COUNT, 2)
    beam = np.array([np.cos(VIEW), 0.0, -np.sin(VIEW)])
    seen = np.linalg.norm(np.cross(ends, beam), axis=1)
    wanted = np.average(np.abs(slope * np.sin(angle)), weights=seen)
    for level in (5, 12, 18):
        z = (level + 0.5) * STEP
        assert np.hypot(*found[level].T) == pytest.approx(slope * z, abs=slope * STEP)
        assert np.abs(found[level, :, 1]).mean() == pytest.approx(wanted * z, rel=0.04)
        assert found[level, :, 1].mean() == pytest.approx(0.0, abs=1e-9)
        first = found[level, :4, 1]  # any few in a row lie on both sides
        assert (first > 0).sum() == 2


def test_what_stands_upright_reaches_nowhere_and_nothing_above_the_top_is_made_up():
    up = np.tile([0.0, 0.0, 0.8], (200, 1))
    assert np.abs(overhang(rods(up), 1.0)).max() == 0.0
    lean = np.tile([0.4, 0.0, 0.8], (200, 1))
    found = overhang(rods(lean), 1.0)
    assert np.array_equal(found[-1], found[15])  # 0.75 to 0.8: the highest level with something in it


def test_branches_of_rape_reach_further_than_its_stem_leans():
    crop = load_crop("rape")
    found = overhang(make_plants(crop, 200, np.random.default_rng(1)), crop.stand.height)
    rms = np.sqrt(np.square(found).sum(axis=2).mean(axis=1)) * crop.stand.height
    assert rms[6] < 0.05  # the stem below its branches
    assert rms[16] > 0.2  # their tips
