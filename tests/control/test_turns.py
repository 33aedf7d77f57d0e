"""Turns reach where they should, keep their limits, and have the lengths of closed forms."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest

from swath.control.turns import TurnLimits, clothoid, dubins, limits_of
from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place, shortest
from swath.core.errors import InputError

LIMITS = limits_of(3.9, 6.1, math.radians(15.0), 2.0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def end_of(bends, start):
    """Where pieces with linear curvature end: their courses are parabolas, places by Gauss and Legendre."""
    x, y, course = start
    for length, first, last in bends:
        s = 0.5 * length * (NODES + 1.0)
        angle = course + first * s + 0.5 * (last - first) / max(length, 1e-12) * s * s
        x += 0.5 * length * float((WEIGHTS * np.cos(angle)).sum())
        y += 0.5 * length * float((WEIGHTS * np.sin(angle)).sum())
        course += 0.5 * (first + last) * length
    return x, y, course


def by_dubins(start, end, limits):
    return bends_of(shortest(start, end, limits.radius), limits.radius)


def length_of(bends):
    return math.fsum(b.length for b in bends)


def dubins_length(end, radius):
    return length_of(by_dubins(Place(0, 0, 0), end, TurnLimits(radius, 1.0)))


def places(seed, count, reach=50.0):
    draw = random.Random(seed)

    def place():
        return Place(draw.uniform(-reach, reach), draw.uniform(-reach, reach), draw.uniform(-4, 4))

    return [(place(), place()) for _ in range(count)]


@pytest.mark.parametrize("turn", [by_dubins, clothoid.plan], ids=["dubins", "clothoid"])
@pytest.mark.parametrize("reach", [50.0, 8.0])
def test_it_ends_where_it_should(turn, reach):
    for start, end in places(1, 60, reach):
        x, y, course = end_of(turn(start, end, LIMITS), start)
        assert math.dist((x, y), end[:2]) < 1e-6
        assert abs(math.sin(0.5 * (course - end.heading))) < 1e-8


def test_words_move_as_their_pieces():
    for start, end in places(5, 20):
        at = start
        for word, size in shortest(start, end, 6.1):
            at = dubins.moved(at, word, size, 6.1)
        assert math.dist(at[:2], end[:2]) < 1e-9


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("aside", "turned"), [(-0.001, -0.0001), (0.001, 0.0001), (0.0, 0.0)])
def test_a_place_straight_ahead_but_for_rounding_is_reached(aside, turned):
    """The first bend has no angle, or hardly one; none is negative."""
    limits = limits_of(3.9, 6.4, math.radians(15.0), 2.0)
    start, end = Place(0.0, 0.0, 0.0), Place(10.0, aside, turned)
    assert math.dist(end_of(clothoid.plan(start, end, limits), start)[:2], end[:2]) < 1e-6


def test_lengths_of_dubins_paths_have_closed_forms():
    r = 6.1
    assert dubins_length(Place(30, 0, 0), r) == pytest.approx(30.0)
    assert dubins_length(Place(0, 2 * r, math.pi), r) == pytest.approx(math.pi * r)
    assert dubins_length(Place(0, 30.0, math.pi), r) == pytest.approx(math.pi * r + 30 - 2 * r)
    shift = 11.9  # a bulb: pi + 4 acos((w + 2 r) / 4 r) radii
    bulb = r * (math.pi + 4 * math.acos((shift + 2 * r) / (4 * r)))
    assert dubins_length(Place(0, shift, math.pi), r) == pytest.approx(bulb)


def test_a_clothoid_turn_keeps_radius_and_sharpness_and_is_no_shorter():
    for start, end in places(2, 40):
        bends = clothoid.plan(start, end, LIMITS)
        assert all(max(abs(b.begin), abs(b.end)) <= 1 / LIMITS.radius + 1e-12 for b in bends)
        assert all(abs(b.end - b.begin) <= LIMITS.sharpness * b.length + 1e-9 for b in bends)
        assert all(abs(a.end - b.begin) < 1e-9 for a, b in pairwise(bends))
        assert length_of(bends) >= length_of(by_dubins(start, end, LIMITS)) - 1e-6


def test_with_a_steering_that_needs_no_time_it_is_the_dubins_path():
    fast = TurnLimits(6.1, 90.0)
    for start, end in places(3, 20, 80.0):
        if math.dist(start[:2], end[:2]) > 40.0:
            length = length_of(clothoid.plan(start, end, fast))
            assert length == pytest.approx(length_of(by_dubins(start, end, fast)), rel=2e-3)


def test_a_mirrored_turn_is_as_long():
    for start, end in places(4, 20):
        there = length_of(clothoid.plan(start, end, LIMITS))
        mirror = [Place(p.x, -p.y, -p.heading) for p in (start, end)]
        assert length_of(clothoid.plan(*mirror, LIMITS)) == pytest.approx(there, abs=1e-5)


def test_wrong_limits_are_refused():
    with pytest.raises(InputError, match=r"turn.radius = 0.1: expected 0.5 to 200"):
        TurnLimits(0.1, 1.0)
