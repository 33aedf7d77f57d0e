"""Ground that knives go over: closed forms, and a field whose plan cuts all of it."""

import math

import numpy as np
import pytest

from swath.job.swept import strip_of, swept_ground

FIELD = np.array([(0.0, 0.0), (200.0, 0.0), (200.0, 40.0), (0.0, 40.0)])


def straight(y, length=200.0, step=2.0):
    return [(x, y, 0.0) for x in np.arange(0.0, length + 0.5 * step, step).tolist()]


def test_two_parallel_tracks_that_overlap():
    """Headers of 12 m, 11.7 m apart: 0.3 m twice; 40 m less 23.7 m are left."""
    found = swept_ground([straight(6.0), straight(17.7)], 12.0, FIELD)
    assert found.twice == pytest.approx(0.3 * 200.0, abs=1e-6)
    assert found.once == pytest.approx(23.7 * 200.0, abs=1e-6)
    assert found.left == pytest.approx(16.3 * 200.0, abs=1e-6)
    assert found.widest == pytest.approx(16.3, abs=0.1)


def test_a_strip_between_two_tracks_is_left():
    tracks = [straight(6.0), straight(18.25), straight(30.0), straight(34.0)]
    found = swept_ground(tracks, 12.0, FIELD)
    assert found.left == pytest.approx(0.25 * 200.0, abs=1e-6)
    assert found.widest == pytest.approx(0.25, abs=0.01)
    assert len(found.pieces) == 1
    assert found.twice == pytest.approx((12.0 - 11.75 + 12.0 - 4.0) * 200.0, abs=1e-6)


def test_a_track_beyond_the_boundary_cuts_nothing_there():
    found = swept_ground([straight(0.0, 260.0)], 12.0, FIELD)
    assert found.once == pytest.approx(6.0 * 200.0, abs=1e-6)
    assert found.twice == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("angle", [math.pi / 2.0, math.pi])
def test_a_bend(angle):
    """A sector of a ring: angle times radius times width; its chords, each of 2 degrees, lose 2e-4 of it."""
    radius, width = 20.0, 12.0
    turns = np.linspace(0.0, angle, round(math.degrees(angle) / 2.0) + 1)
    track = [(radius * math.sin(a), -radius * math.cos(a), a) for a in turns.tolist()]
    assert strip_of(track, width).area == pytest.approx(angle * radius * width, rel=4e-4)


def test_a_bend_narrower_than_half_of_the_header():
    """The inner end moves backwards: a half disk of the outer end, and one of the inner end."""
    radius, width = 4.0, 12.0
    turns = np.linspace(0.0, math.pi, 181)
    track = [(radius * math.sin(a), -radius * math.cos(a), a) for a in turns.tolist()]
    expected = 0.5 * math.pi * ((radius + 0.5 * width) ** 2 + (0.5 * width - radius) ** 2)
    assert strip_of(track, width).area == pytest.approx(expected, rel=5e-3)


def test_two_tracks_in_a_bend_overlap_by_a_ring():
    """Radii 20 and 31.5 m, 12 m wide, a quarter: 0.5 m of them twice, about 25.75 m."""
    turns = np.linspace(0.0, 0.5 * math.pi, 91)
    tracks = [[(r * math.sin(a), -r * math.cos(a), a) for a in turns.tolist()] for r in (20.0, 31.5)]
    found = swept_ground(tracks, 12.0, np.array([(-1.0, -40.0), (40.0, -40.0), (40.0, 1.0), (-1.0, 1.0)]))
    assert found.twice == pytest.approx(0.5 * math.pi * 25.75 * 0.5, rel=0.01)


def test_a_knife_that_wanders_is_not_straightened():
    """A sine of 5 cm over 40 m: a neighbour on the straight line at 12 m leaves half-waves of it."""
    bent = [
        (x, 6.0 - 0.05 * math.sin(math.pi * x / 20.0), -0.05 * math.pi / 20.0 * math.cos(math.pi * x / 20.0))
        for x in np.arange(0.0, 201.0, 2.0).tolist()
    ]
    rest = [straight(18.0), straight(30.0), straight(34.0)]
    found = swept_ground([bent, *rest], 12.0, FIELD)
    lens = 0.05 * 40.0 / math.pi * 5.0  # of five half-waves between the tracks
    assert found.left == pytest.approx(2.0 * lens, rel=0.1)  # and as many at the boundary
