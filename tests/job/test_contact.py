"""Bodies of a job's machines held against each other: closed forms."""

import math

import pytest

from swath.job.contact import ContactWatch
from swath.job.footprint import clearance, footprint_of
from swath.job.path import Pose
from swath.machine.machine_sheet import load_machine

EAST, NORTH = 0.0, 0.5 * math.pi


@pytest.fixture(scope="module")
def combine():
    return footprint_of(load_machine("lexion-700"))


@pytest.fixture(scope="module")
def cart():
    return footprint_of(load_machine("tractor-grain-cart"))


def between(a, at_a, b, at_b):
    return clearance(a.at(at_a, at_a.heading), b.at(at_b, at_b.heading))


def test_two_that_pass_are_apart_by_the_distance_of_their_sides(combine, cart):
    """Header 12 m wide, wheels of the cart 3.6 m."""
    beside = Pose(0.0, 8.2, EAST)
    assert between(combine, Pose(0.0, 0.0, EAST), cart, beside) == pytest.approx(8.2 - 6.0 - 1.3, abs=1e-9)
    ahead = Pose(9.0, 8.2, EAST)  # its wheels, 5.8 m behind the tractor's axle, beside the header
    assert between(combine, Pose(0.0, 0.0, EAST), cart, ahead) == pytest.approx(8.2 - 6.0 - 1.8, abs=1e-9)


def test_a_corner_is_as_far_from_a_corner_as_pythagoras_says(combine):
    """Two headers, knife to back 1.6 m: the second 15 m to the left and 10 m ahead."""
    found = between(combine, Pose(0.0, 0.0, EAST), combine, Pose(10.0, 15.0, EAST))
    assert found == pytest.approx(math.hypot(15.0 - 6.0 - 1.65, 10.0 - 5.9 - 4.0), abs=1e-9)


def test_overlapping_headers_touch_and_a_pipe_does_not(combine, cart):
    assert between(combine, Pose(0.0, 0.0, EAST), combine, Pose(0.0, 11.7, EAST)) == 0.0
    assert between(combine, Pose(0.0, 0.0, EAST), combine, Pose(-2.0, 11.7, EAST)) == pytest.approx(0.4)
    under_the_pipe = Pose(-0.6 + 5.5, 8.2, EAST)
    assert between(combine, Pose(0.0, 0.0, EAST), cart, under_the_pipe) > 0.3


def test_a_crossing_lasts_as_long_as_both_bodies_are_long(combine):
    """One stands, the other crosses at 2 m/s behind it, header over tail."""
    watch = ContactWatch()
    watch.add("stands", combine)
    watch.add("crosses", combine)
    for i in range(600):
        x = -60.0 + 0.2 * i
        watch.look(
            0.1 * i, 0.1, {"stands": (Pose(0.0, 0.0, NORTH), NORTH), "crosses": (Pose(x, -8.0, EAST), EAST)}
        )
    (pair,) = watch.pairs
    # header 6 m to the left reaches y = -2; the standing one's tail, 3.3 m wide, y = -5.9
    expected = (2 * 1.65 + 1.6) / 2.0
    assert pair.touched == pytest.approx(expected, abs=0.11)
    assert len(pair.times) == 1
    assert pair.least == 0.0


def test_what_is_never_near_has_a_lower_bound_of_its_clearance(combine, cart):
    watch = ContactWatch()
    watch.add("a", combine)
    watch.add("b", cart)
    for i in range(100):
        watch.look(
            float(i), 1.0, {"a": (Pose(0.0, 0.0, EAST), EAST), "b": (Pose(200.0 - i, 0.0, EAST), EAST)}
        )
    (pair,) = watch.pairs
    true = 101.0 - 5.8 - 2.7 - 4.0
    assert 5.0 < pair.least <= true
    assert pair.touched == 0.0
