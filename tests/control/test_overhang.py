"""Feet behind the edge of tops: drawn stands against what is told of them."""

import numpy as np
import pytest

from swath.control.edge.feet.overhang import WALL
from swath.control.edge.profile import TOLERANCE
from tests.control.edge_rows import Overhang

NO_MODE = (0.0, 0.0, 0.0)
USUAL, PERCENT, LEAN_DEG, CUT_SD, HOLES_M = 0.9, 14.0, 20.0, 0.03, 2.0


def usual(**more):
    return Overhang(USUAL, **more)


def cut(hang, beside=0.1, bias=0.0, holes=0.0, metres=10, noise=0.0, rng=None):
    """Where the header says what feet `hang` behind the tops' edge leave of it, which it stands `beside`."""
    made = usual()
    for _ in range(metres):
        wrong = bias + noise * (rng.standard_normal() if rng else 0.0)
        made.cut(max(max(beside + hang, 0.0) + holes + wrong, 0.0), beside)
    return made


def stands(count, seed):
    """(height of the tops, hang) of stands as the driver expects them that show no ramp."""
    rng = np.random.default_rng(seed)
    while count:
        lean, turn = np.radians(min(rng.exponential(LEAN_DEG), 70.0)), rng.uniform(0.0, 2.0 * np.pi)
        out = np.tan(lean) * np.sin(turn)
        if out > -0.2:  # others show one
            seen = 0.965 + 0.03 * rng.standard_normal()
            tops = USUAL * max(1.0 + 0.01 * PERCENT * rng.standard_normal(), 0.4) * np.cos(lean) * seen
            yield tops, WALL * out * tops, rng
            count -= 1


@pytest.mark.parametrize("is_cut", [False, True])
def test_modes_and_deviations_of_drawn_stands_hold(is_cut):
    told, right, within = [], [], []
    for tops, hang, rng in stands(600, 5):
        header = usual()
        if is_cut:
            holes = rng.uniform(0.0, HOLES_M) if rng.uniform() < 0.1 else 0.0
            header = cut(hang, bias=CUT_SD * rng.standard_normal(), noise=0.05, holes=holes, rng=rng)
        found = header.of(tops, 0.0, 1.0, NO_MODE)
        told.append(found.within)
        right.append(abs(hang - found.told) <= TOLERANCE)
        within.append(abs(hang - found.told) <= 1.96 * found.sd)
    print(f"told {np.mean(told):.3f}, right {np.mean(right):.3f}, band {np.mean(within):.3f}")
    assert np.mean(told) == pytest.approx(np.mean(right), abs=0.06)
    assert 0.90 < np.mean(within) < 0.99
    assert np.mean(right) > (0.85 if is_cut else 0.5)
    unsure = np.array(told) < 0.5
    if unsure.sum() > 50:
        assert np.mean(np.array(right)[unsure]) < 0.6


@pytest.mark.parametrize("hang", [0.0, 0.2, 0.35])
@pytest.mark.parametrize("bias", [-0.05, 0.0, 0.05])
def test_a_header_that_is_not_full_shows_a_lean_out(hang, bias):
    """Alike in height: a short stand that stands, a tall one that leans out."""
    found = cut(hang, bias=bias).of(0.87, 0.02, 1.0, NO_MODE, 0.035)
    assert (found.leans > 0.5) == (hang > 0.0)
    assert abs(found.told - hang) < 2.0 * found.sd
    assert found.other < 0.5
    if hang == 0.0 and bias == 0.0:
        assert found.within > 0.93


def test_what_a_tramline_misses_is_no_lean():
    """Two wheel tracks in the header: the stand may stand or lean as before, only less surely."""
    before = usual().of(0.87, 0.02, 1.0, NO_MODE, 0.03)
    full = cut(0.0).of(0.87, 0.02, 1.0, NO_MODE, 0.03)
    assert full.within > 0.9
    for tracks in np.linspace(0.65, 1.15, 6):
        found = cut(0.0, holes=float(tracks)).of(0.87, 0.02, 1.0, NO_MODE, 0.03)
        assert found.told == pytest.approx(before.told, abs=0.03)
        assert found.within < full.within - 0.05


def test_a_ramp_that_the_header_contradicts_is_none():
    ramp = (1.0, 0.27, 0.05)
    alone = usual().of(0.8, 0.02, 1.0, ramp)
    against = cut(0.0).of(0.8, 0.02, 1.0, ramp)
    assert alone.told == pytest.approx(0.27, abs=0.02)
    assert abs(against.told) < 0.1


def test_a_lean_that_may_be_is_told_without_a_step():
    """Over heights from well below the usual one up to it, and over ramps, the deviation nowhere jumps."""
    hang = usual(percent=3.0)
    by_height = [hang.of(z, 0.03, 1.0, NO_MODE).sd for z in np.linspace(0.6, 0.95, 200)]
    ramps = [(share, -0.1, 0.03) for share in np.linspace(0.0, 1.0, 200)]
    by_ramp = [hang.of(0.6, 0.03, 1.0, ramp).sd for ramp in ramps]
    assert by_height[0] > 2.0 * by_height[-1]
    assert np.abs(np.diff(by_height)).max() < 0.02
    assert np.abs(np.diff(by_ramp)).max() < 0.03
    assert by_ramp[-1] < 0.4 * by_ramp[0]
    unknown = hang.of(float("nan"), 0.1, 0.0, NO_MODE)
    assert unknown.sd > 0.2  # not known how high it stands: nor how it leans


def test_a_height_says_less_of_a_thin_stand_and_of_one_that_ends_above_the_scanner():
    sure = {"percent": 3.0, "lean_deg": 10.0}
    low, thin, above = (
        usual(view=view, **sure).of(0.7, 0.03, stopped, NO_MODE).leans
        for view, stopped in ((3.0, 1.0), (3.0, 0.75), (0.75, 1.0))
    )
    assert low > 0.3
    assert max(thin, above) < 0.7 * low
    assert usual(**sure).lean(0.7, 1.0) > 0.5
    assert usual(**sure).lean(0.85, 1.0) == 0.0
