"""How fast a speed law lets the machine drive by what it sees of the edge."""

import random
from dataclasses import replace
from math import nan

import pytest

from swath.control.speed.constant import ConstantSpeed, Params
from swath.control.speed.edge_guard import EdgeGuard
from swath.control.speed.guard import Guard
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.sensing.odometry.error import Params as Errors
from swath.signals import CropEdge, Odometry
from tests.control.closed_loop import setup_of

STEP = NS // 10
SEEN = CropEdge(0, 6.0, 0.0, 0.0, 5.5, 0.99, 0.85, 0.15, 0.03, 0.01, 9.5)
LOST = CropEdge(0, nan, nan, 0.0, 5.5, 0.0, nan, nan)
FULL = 7 * KMH


def after(edge, *, metres=6.0, guard=None, speed=None):
    """(guard, speed, driven [m]) after driving on with one edge, as fast as it lets."""
    kept, driven, now = guard or EdgeGuard(Guard()), 0.0, FULL if speed is None else speed
    for _ in range(400):
        now = kept.limit(FULL, edge, Odometry(0, now, 0.0, 0.0), STEP)
        driven += now * 0.1
        if driven > metres:
            break
    return kept, now, driven


def test_full_speed_while_the_edge_is_sure():
    assert after(SEEN)[1] == FULL


@pytest.mark.parametrize(("confidence", "kmh"), [(0.5, 7.0), (0.4, 5.0), (0.3, 3.0), (0.05, 3.0)])
def test_slower_the_less_sure(confidence, kmh):
    assert after(replace(SEEN, confidence=confidence))[1] == pytest.approx(kmh * KMH)


@pytest.mark.parametrize(("away", "chance", "kmh"), [(0.5, 0.25, 6.0), (-0.5, 0.5, 5.0), (0.2, 0.5, 7.0)])
def test_slower_the_more_likely_another_place_is_beyond_the_room(away, chance, kmh):
    edge = replace(SEEN, other_offset=SEEN.offset + away, other_chance=chance)
    assert after(edge)[1] == pytest.approx(kmh * KMH)


def test_bends_are_driven_slowly():
    assert after(replace(SEEN, curvature=-1 / 12))[1] == pytest.approx((0.1 * 12) ** 0.5, rel=0.02)


UNKNOWN = replace(SEEN, confidence=0.08, offset_sd=0.7)  # seen, but it may lie anywhere


@pytest.mark.parametrize("edge", [LOST, replace(SEEN, confidence=0.2, seen_to=5.0), UNKNOWN])
def test_the_machine_stands_before_five_metres_are_driven_blind(edge):
    guard, speed, driven = after(edge, metres=20.0)
    assert speed < 0.05
    assert 3.5 < driven < 5.0
    assert "no crop edge seen for 4." in guard.reason
    assert "none known to 0.3 m" in guard.reason


def test_an_edge_that_is_known_to_the_room_there_is_is_driven_slowly():
    guard, speed, _ = after(replace(SEEN, confidence=0.2, offset_sd=0.4), metres=20.0)
    assert speed == pytest.approx(3.0 * KMH)
    assert guard.reason == ""
    assert (
        after(replace(SEEN, confidence=0.2, offset_sd=0.4), metres=20.0, guard=EdgeGuard(Guard(room_m=0.2)))[
            1
        ]
        < 0.05
    )


def test_noise_of_the_odometry_of_a_machine_at_rest_is_hardly_travel():
    """Ten minutes without an edge while it waits, with the noise of level `error`. All of it counted sums up
    to 9.6 m; of a normal distribution 1.2 % lie beyond 2.5 standard deviations, which sum up to 0.42 m.
    """
    guard, draw = EdgeGuard(Guard()), random.Random(1)
    for _ in range(6000):
        guard.limit(0.0, LOST, Odometry(0, draw.gauss(0.0, Errors().speed_noise_m_s), 0.0, 0.0), STEP)
    assert guard.reason == ""
    assert guard.blind == pytest.approx(0.42, abs=0.15)


def test_an_edge_seen_again_lets_it_go_on():
    guard = after(LOST, metres=3.0)[0]
    assert after(SEEN, guard=guard)[1] == FULL
    assert guard.blind == 0.0
    assert guard.reason == ""


@pytest.mark.parametrize(("choice", "kmh"), [("slow", 3.0), ("ignore", 7.0)])
def test_the_scenario_chooses(choice, kmh):
    guard, speed, driven = after(LOST, metres=20.0, guard=EdgeGuard(Guard(when_lost=choice)))
    assert speed == pytest.approx(kmh * KMH)
    assert driven > 20.0
    assert guard.reason == ""


def test_a_machine_without_an_edge_detector_drives_on():
    law = ConstantSpeed(Params(speed_kmh=7), setup_of())
    law.reset(Stream(1, "speed"))
    for k in range(100):
        command = law.step(k * STEP, STEP, {"edge": None, "odometry": None})["command"]
    assert command.speed == FULL
    assert law.end_reason(0) == ""


def test_a_saved_guard_goes_on():
    guard = after(LOST, metres=2.0)[0]
    other = EdgeGuard(Guard())
    other.load(guard.save())
    assert after(LOST, guard=other, speed=1.0)[1:] == after(LOST, guard=guard, speed=1.0)[1:]


@pytest.mark.parametrize("kmh", [5.0, 8.0, 10.0])
def test_a_drive_with_a_lag_stands_before_five_metres_too(kmh):
    guard, speed, driven = EdgeGuard(Guard()), kmh * KMH, 0.0
    for _ in range(400):
        bound = guard.limit(kmh * KMH, LOST, Odometry(0, speed, 0.0, 0.0), STEP)
        speed += (bound - speed) * 0.1 / 0.4
        driven += speed * 0.1
    assert guard.reason
    assert 3.5 < driven < 4.8
