"""Carts stop before ground that others drive over next; lines beside bent passes keep their distance."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from swath.job.cart_ways import shifted
from swath.job.drive import DrivenMachine, Follower
from swath.job.footprint import footprint_of
from swath.job.give_way import Traffic, must_stop
from swath.job.path import Pose, ahead_of, polyline
from swath.machine.machine_sheet import load_machine


def driving(sheet, pose, speed):
    """A machine that drives straight on."""
    machine = DrivenMachine(load_machine(sheet), pose, 0.2)
    machine.speed = speed
    path = polyline(np.array([pose[:2], ahead_of(pose, 200.0)[:2]]))
    return Traffic(machine, footprint_of(load_machine(sheet)), Follower(path, 0.1), speed)


@pytest.mark.parametrize(
    ("south", "stops"),
    [(-12.0, True), (-60.0, False), (40.0, False)],
    ids=["a combine crosses soon", "a combine is far off", "a combine is past"],
)
def test_a_cart_stops_before_what_a_combine_drives_over(south, stops):
    combine = driving("lexion-700", Pose(0.0, south, 0.5 * math.pi), 2.0)
    cart = driving("tractor-grain-cart", Pose(-16.0, 0.0, 0.0), 3.0)
    assert must_stop(cart, [combine]) is stops


def test_a_cart_that_is_in_the_way_already_goes_on():
    combine = driving("lexion-700", Pose(0.0, -12.0, 0.5 * math.pi), 2.0)
    assert not must_stop(driving("tractor-grain-cart", Pose(0.0, 0.0, 0.0), 3.0), [combine])


def test_a_line_beside_a_bent_pass_keeps_its_distance():
    line = np.array([[0.0, 0.0], [100.0, 0.0], [180.0, 30.0], [250.0, 20.0]])
    beside = shifted(line, 0.0, 8.2)
    for (a, b), (c, d) in zip(pairwise(line), pairwise(beside), strict=True):
        side, there = shapely.LineString([a, b]), shapely.LineString([c, d])
        middle = there.interpolate(0.5, normalized=True)
        assert side.distance(middle) == pytest.approx(8.2)
        ahead, turn = b - a, np.array([middle.x, middle.y]) - a
        assert ahead[0] * turn[1] - ahead[1] * turn[0] > 0.0
