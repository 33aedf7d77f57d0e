"""Box level `rim` against the truth, with a cart beside a combine, and what is no box.

Stations, headings, fills and seeds here are others than those that the level was made with.
"""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.box.grain_profile import BoxLook, at_wall, fill_of
from swath.control.box.rim_fit import edges_of, fit_rim
from tests.control.box_rig import DUST, MOUNT, THICK, errors, look

STATIONS = ((0.3, 8.6, 1.5), (-1.3, 8.2, -3.5), (1.1, 8.9, 6.5))
CASES = [
    (air, fill, *station)
    for k, (air, fill) in enumerate((a, f) for a in ("", DUST) for f in (0.0, 0.47, 1.05))
    for station in (STATIONS[k % 3],)
]


@pytest.mark.parametrize(("air", "fill", "ahead", "left", "heading"), CASES)
def test_rim_and_grain(air, fill, ahead, left, heading):
    """Rim within 0.10 m and 1 deg, grain within 0.10 m, all of it known at three of four places."""
    seen, truth = look(air=air, fill=fill, ahead=ahead, left=left, heading=heading, seed=11)
    assert seen.is_seen
    along, across, high, turn, grain, share = errors(seen, truth)
    assert max(abs(along), abs(across), abs(high)) <= 0.10
    assert abs(turn) <= 1.0
    assert grain <= 0.10
    assert share >= 0.75
    free = seen.freeboard - truth.freeboard
    assert np.nanmax(np.abs(free)) <= 0.15  # from strips beside the walls, not the walls' own cells
    assert abs(along) <= 4.0 * seen.x_sd
    assert abs(turn) <= np.degrees(4.0 * seen.heading_sd)


def test_not_seen_in_thick_dust():
    assert not look(air=THICK, fill=0.47, ahead=0.3, seed=11)[0].is_seen


def test_not_seen_when_there_is_no_cart():
    assert not look(ahead=-30.0, seed=11)[0].is_seen


def test_not_seen_half_in_the_picture():
    """The cart is too far back: the scanner sees its front end and two sides that run out of the picture."""
    seen, truth = look(ahead=-6.5, fill=0.47, seed=11)
    assert not seen.is_seen or abs(errors(seen, truth)[0]) <= 0.10


def test_another_size_than_said_is_not_taken_for_it():
    level = "{level: rim, length_m: 4.0, width_m: 2.2, rim_m: 3.6}"
    assert not look(f"combine.box={level}", seed=11)[0].is_seen


def test_a_scanner_of_one_line_sees_no_box():
    eye = "{level: empirical, sensor: sick-lms511-hr, rate_hz: 25, sector_deg: [-60, 60], mount: {%s}}"
    assert not look(f"combine.lidar={eye % MOUNT}", seed=11)[0].is_seen


@pytest.mark.parametrize("turn", [-0.31, 0.0, 0.24])
def test_the_fit_alone(turn):
    """Points on the lines of a box of 7 x 3.2 m, 1 cm of noise, a fifth of them astray."""
    rng = np.random.default_rng(5)
    half = 3.525, 1.625
    rows = []
    for k in range(600):
        u, side = rng.uniform(-1.0, 1.0), k % 4
        rows.append((u * half[0], half[1] * (side - 2)) if side % 2 else (half[0] * (side - 1), u * half[1]))
    points = np.array(rows) + rng.normal(0.0, 0.01, (600, 2))
    points[::5] += rng.uniform(-1.0, 1.0, (120, 2))
    c, s = np.cos(turn), np.sin(turn)
    there = points @ np.array([[c, s], [-s, c]]) + (0.7, 8.1)
    rim = fit_rim(np.column_stack([there, np.full(600, 3.4)]), 7.0, 3.2)
    assert (rim.x, rim.y, rim.height) == pytest.approx((0.7, 8.1, 3.4), abs=0.01)
    assert rim.heading == pytest.approx(turn, abs=np.radians(0.2))
    assert rim.wall_count == 4


def test_an_edge_is_the_nearer_of_two_neighbours():
    """4.0 before 9.0, 4.1 before 9.0 and before nothing, 9.1 beside nothing."""
    points = np.arange(18.0).reshape(3, 2, 3)
    away = np.array([[4.0, 4.0], [4.1, 9.0], [np.inf, 9.1]])
    found = edges_of(points, away)
    np.testing.assert_array_equal(found, [points[0, 1], points[1, 0], points[2, 1]])


def test_a_sample_says_that_it_knows_nothing():
    seen, _ = look(air=THICK, seed=11)
    assert np.isnan([seen.x, seen.y, seen.heading, seen.rim_height, seen.x_sd]).all()
    assert seen.confidence == 0.0
    assert replace(seen, t=0).is_seen is False


@pytest.mark.parametrize("angle", [0.0, 20.0, 25.0])
def test_grain_at_the_wall_of_a_heap_that_slopes_down_to_it(angle):
    """Points 3 to 25 cm from the wall, noise of 2 cm: their median is up to 7 cm too high there."""
    rng = np.random.default_rng(3)
    slope = np.tan(np.radians(angle))
    off = []
    for _ in range(50):
        away = rng.uniform(0.03, 0.25, 40)
        along = rng.uniform(-0.25, 0.25, 40)
        heights = 1.2 + slope * away + 0.1 * (along - 0.25) + 0.02 * rng.standard_normal(40)
        off.append(at_wall(away, along, heights, 0.5) - 1.2)
    assert abs(np.mean(off)) < 0.02
    assert np.std(off) < 0.02
    assert np.isnan(at_wall(away[:3], away[:3], away[:3], 0.5))


def test_grain_that_the_wall_hides():
    """The wall hides 20 cm beside it: the slope of the 22 cm behind them is carried on to the wall."""
    rng = np.random.default_rng(4)
    away, along = rng.uniform(0.2, 0.5, 60), rng.uniform(-0.25, 0.25, 60)
    heights = 1.2 + 0.46 * away + 0.005 * rng.standard_normal(60)
    assert at_wall(away, along, heights, 0.5) == pytest.approx(1.2, abs=0.025)


@pytest.mark.parametrize("end", [-1.0, 1.0])
def test_grain_at_the_end_of_a_box_where_a_cone_touches_it(end):
    """A cone 1.25 m before an end reaches the rim there in its middle; at the corners it is 0.33 m lower."""
    rng = np.random.default_rng(8)
    x, y = rng.uniform(-3.0, 3.0, 6000), rng.uniform(-1.5, 1.5, 6000)
    slope = np.tan(np.radians(25.0))
    cone = slope * (1.25 - np.hypot(x - 1.75 * end, y))
    points = np.column_stack([x, y, 2.0 + np.maximum(cone, -0.4) + 0.01 * rng.standard_normal(6000)])
    free = fill_of(points, BoxLook(6.0, 3.0, 2.0, 0.005), 12).freeboard
    beside = 10 if end > 0.0 else 1
    assert free[-1 if end > 0.0 else 0] == pytest.approx(0.0, abs=0.03)
    assert free[beside] == pytest.approx(slope * 0.25, abs=0.03)
    assert free[11 - beside] == pytest.approx(0.4, abs=0.03)


def part_of_a_heap(keeps, seed=9):
    """Profile and its deviations of a heap that falls by 25 deg to both sides, at 0.5 m on the middle line,
    and by 20 deg along the box; points with 1 cm of noise, where `keeps` (along, aside) is true.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-3.0, 3.0, 8000), rng.uniform(-1.5, 1.5, 8000)
    fall, along = np.tan(np.radians([25.0, 20.0]))
    z = 2.5 - fall * np.abs(y) - along * x + 0.01 * rng.standard_normal(8000)
    points = np.column_stack([x, y, z])[keeps(x, y)]
    fill = fill_of(points, BoxLook(6.0, 3.0, 2.0, 0.005), 12)
    return fill.height - (0.5 - along * (np.arange(12) - 5.5) * 0.5), fill.sd


def test_the_ridge_of_a_heap_is_not_averaged_away():
    """Points within 15 cm of it lie 3.5 cm lower in their median."""
    off, sd = part_of_a_heap(lambda x, y: x == x)
    assert np.abs(off).max() < 0.015
    assert sd.max() < 0.03


def test_a_place_of_which_only_a_part_is_seen():
    """A side of the ridge, half of the length: of their median the one is 3.5 and the other 4.5 cm off."""
    half = lambda x, y: (y < -0.04) & (x % 0.5 > 0.25)  # noqa: E731
    off, sd = part_of_a_heap(half)
    assert np.abs(off).max() < 0.045
    assert (np.abs(off) < 3.0 * sd).all()
    sliver = lambda x, y: (y > 0.12) & (x % 0.5 > 0.44)  # noqa: E731
    assert np.isnan(part_of_a_heap(sliver)[0]).all()
