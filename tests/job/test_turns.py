"""Turns reach where they should, keep their limits, and are as long as those that were measured."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.job.path import Piece, Pose, joined, path_of, polyline
from swath.job.turns import TurnLimits, clothoid, dubins, limits_of
from swath.job.turns.measure import measure
from swath.job.turns.tracked import drive, turn_limits
from swath.machine.machine_sheet import load_machine
from tests.job.measured_turns import driven, dubins_length, measured_or_skip, medians, rolling_turns

LIMITS = limits_of(3.9, 6.1, math.radians(15.0), 2.0)


def poses(seed, count, reach=50.0):
    draw = random.Random(seed)

    def pose():
        return Pose(draw.uniform(-reach, reach), draw.uniform(-reach, reach), draw.uniform(-4, 4))

    return [(pose(), pose()) for _ in range(count)]


@pytest.mark.parametrize("turn", [dubins, clothoid], ids=["dubins", "clothoid"])
@pytest.mark.parametrize("reach", [50.0, 8.0])
def test_it_ends_where_it_should(turn, reach):
    for start, end in poses(1, 60, reach):
        path = path_of(turn.plan(start, end, LIMITS), start)
        assert math.dist(path.end[:2], end[:2]) < 1e-6
        assert abs(math.sin(0.5 * (path.end.heading - end.heading))) < 1e-8


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("aside", "turned"), [(-0.001, -0.0001), (0.001, 0.0001), (0.0, 0.0)])
def test_a_place_straight_ahead_but_for_rounding_is_reached(aside, turned):
    """The first bend has no angle, or hardly one; none is negative."""
    limits = limits_of(3.9, 6.4, math.radians(15.0), 2.0)
    start, end = Pose(0.0, 0.0, 0.0), Pose(10.0, aside, turned)
    path = path_of(clothoid.plan(start, end, limits), start)
    assert math.dist(path.end[:2], end[:2]) < 1e-6


def test_lengths_of_dubins_paths_have_closed_forms():
    r = 6.1
    assert dubins.length(Pose(0, 0, 0), Pose(30, 0, 0), r) == pytest.approx(30.0)
    assert dubins.length(Pose(0, 0, 0), Pose(0, 2 * r, math.pi), r) == pytest.approx(math.pi * r)
    assert dubins.length(Pose(0, 0, 0), Pose(0, 30.0, math.pi), r) == pytest.approx(math.pi * r + 30 - 2 * r)
    shift = 11.9  # a bulb: pi + 4 acos((w + 2 r) / 4 r) radii
    bulb = r * (math.pi + 4 * math.acos((shift + 2 * r) / (4 * r)))
    assert dubins.length(Pose(0, 0, 0), Pose(0, shift, math.pi), r) == pytest.approx(bulb)


def test_a_clothoid_turn_keeps_radius_and_sharpness_and_is_no_shorter():
    for start, end in poses(2, 40):
        pieces = clothoid.plan(start, end, LIMITS)
        assert all(max(abs(p.first), abs(p.last)) <= 1 / LIMITS.radius + 1e-12 for p in pieces)
        assert all(abs(p.last - p.first) <= LIMITS.sharpness * p.length + 1e-9 for p in pieces)
        assert all(abs(a.last - b.first) < 1e-9 for a, b in pairwise(pieces))
        assert math.fsum(p.length for p in pieces) >= dubins.length(start, end, LIMITS.radius) - 1e-6


def test_with_a_steering_that_needs_no_time_it_is_the_dubins_path():
    fast = TurnLimits(6.1, 90.0)
    for start, end in poses(3, 20, 80.0):
        if math.dist(start[:2], end[:2]) > 40.0:
            length = math.fsum(p.length for p in clothoid.plan(start, end, fast))
            assert length == pytest.approx(dubins.length(start, end, 6.1), rel=2e-3)


def test_a_mirrored_turn_is_as_long():
    for start, end in poses(4, 20):
        there = math.fsum(p.length for p in clothoid.plan(start, end, LIMITS))
        mirror = [Pose(p.x, -p.y, -p.heading) for p in (start, end)]
        assert math.fsum(p.length for p in clothoid.plan(*mirror, LIMITS)) == pytest.approx(there, abs=1e-5)


def test_a_clothoid_is_that_of_fresnel():
    a = 8.0  # ends of the Euler spiral x + i y = int exp(i u^2 / (2 a^2)) at u = a
    path = path_of([Piece(0.0, 1 / a, a)], Pose(0, 0, 0))
    series = sum((-1) ** n / (math.factorial(2 * n) * (4 * n + 1) * 2 ** (2 * n)) for n in range(9))
    assert path.end.x == pytest.approx(a * series, abs=1e-9)
    assert path.end.heading == pytest.approx(0.5)


def test_paths_join_and_know_where_they_are():
    one = polyline(np.array([[0.0, 0.0], [10.0, 0.0]]))
    both = joined([one, path_of([Piece(0.1, 0.1, 5.0)], one.end)])
    assert both.length == pytest.approx(15.0)
    assert both.at(4.0) == pytest.approx((4.0, 0.0, 0.0))
    assert both.at(15.0).heading == pytest.approx(0.5)


def test_wrong_limits_and_tracks_without_a_turn_are_refused():
    with pytest.raises(InputError, match=r"turn.radius = 0.1: expected 0.5 to 200"):
        TurnLimits(0.1, 1.0)
    with pytest.raises(InputError, match="expected a track that turns through half a circle"):
        measure(np.arange(9.0), np.stack([np.arange(9.0), np.zeros(9)], axis=1))


@measured_or_skip
def test_figures_of_the_measured_tracks_are_those_of_their_summary():
    turns = rolling_turns()
    stated = medians([t.figures for t in turns])
    found = medians([measure(t.time, t.points) for t in turns])
    for key in ("duration", "path", "depth", "excursion"):
        assert found[key] == pytest.approx(stated[key], rel=0.03)


@measured_or_skip
def test_turns_in_closed_loop_are_as_long_as_the_measured_ones():
    turns = rolling_turns()
    found = medians([driven(t)[0] for t in turns])
    measured = medians([t.figures for t in turns])
    for key in ("duration", "path", "depth"):
        assert found[key] == pytest.approx(measured[key], rel=0.10), key


def test_a_planned_path_is_driven_within_a_quarter_metre():
    sheet, start = load_machine("lexion-700"), Pose(-30.0, 0.0, 0.0)
    limits = turn_limits(sheet, 6.4, 2.0)
    pieces = [Piece(0, 0, 30.0), *clothoid.plan(Pose(0, 0, 0), Pose(0, 11.9, math.pi), limits)]
    path = path_of([*pieces, Piece(0, 0, 20.0)], start)
    track = drive(sheet, path, 6.4, 2.0)
    off = [np.hypot(*(path.points - p).T).min() for p in track.points[::5]]
    assert max(off) < 0.25
    assert track.time[-1] == pytest.approx(path.length / 2.0, rel=0.02)


@measured_or_skip
def test_a_dubins_turn_is_some_27_percent_short():
    measured = medians([t.figures for t in rolling_turns()])
    short = 1.0 - dubins_length(11.9, 6.1) / measured["path"]
    assert 0.24 < short < 0.30
