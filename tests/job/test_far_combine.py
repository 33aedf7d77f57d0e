"""Carts beside a combine that drives a far way, that stands for them, or that has cut its last pass."""

import numpy as np
import pytest

from swath.control.job import wait_ahead
from swath.control.job.calls import Calls
from swath.control.job.cart_ways import CartWays
from swath.control.job.dubins import Place
from swath.control.job.passes import Pass
from swath.control.job.right_of_way import SHORT, Clearance, own_outline
from swath.control.job.wait_ahead import WaitAhead
from swath.control.steer.guidance_line import GuidanceLine
from swath.control.steer.path import Segment
from swath.signals import Phase
from tests.job.test_beside_ways import CART, NORTHWARD, combine
from tests.job.test_cart_alone import CartBench
from tests.job.test_whole_field import NORTH

RING = ((10.0, 0.0), (300.0, 0.0), (300.0, 100.0), (10.0, 100.0))
ARC = 1.0 / 6.0  # 1/m
BACK = (  # the west side; east along the south side, back outside of it, north: axle 4 m behind the knife
    Pass(((16.0, 0.0), (16.0, 100.0))),
    Pass(
        ((40.0, 6.0), (300.0, 6.0)),
        cart_beside=False,
        turn=(Segment(np.pi / ARC, -ARC), Segment(262.0), Segment(0.5 * np.pi / ARC, -ARC)),
    ),
    Pass(((28.0, 4.0), (28.0, 100.0))),
)
WESTWARD = np.pi


def on_the_strip(points, beyond=8.0):
    """Which points lie on the far way back, 40 m off its ends."""
    return (points[:, 0] > 60.0) & (points[:, 0] < 256.0) & (np.abs(points[:, 1] + 6.0) < beyond)


@pytest.mark.parametrize(("speed", "phase", "keeps_off"), [
    (3.0, Phase.TURNS, True),
    (3.0, Phase.DONE, False),
])  # fmt: skip
def test_a_way_keeps_off_the_far_way_of_a_combine(speed, phase, keeps_off):
    """To the other end of the field, along its side."""
    ways = CartWays(BACK, RING, 12.2, 8.2, 9.0, [(-20.0, 50.0)])
    here = Place(250.0, -24.0, WESTWARD)
    said = combine(here, Place(285.0, -6.0, WESTWARD), phase, task=1, speed=speed)
    way = ways.to_place(here, (-20.0, 50.0), said)
    fine = np.array([GuidanceLine(way.points.tolist()).point(at) for at in np.arange(0.0, 250.0, 1.0)])
    assert not on_the_strip(fine).any() or not keeps_off
    # close to the field it is the shorter one
    assert (way.points[:, 1][way.points[:, 0] > 60.0].max() > -12.0) is not keeps_off


@pytest.mark.parametrize(("passes", "at", "speed", "phase", "is_found"), [
    (BACK, Place(280.0, -6.0, WESTWARD), 3.0, Phase.TURNS, True),
    (BACK, Place(280.0, -6.0, WESTWARD), 0.0, Phase.TURNS, False),  # it stands
    (BACK, Place(200.0, 6.0, 0.0), 3.0, Phase.CUTS, False),
    (BACK, Place(60.0, -6.0, WESTWARD), 3.0, Phase.TURNS, False),  # gone by
    (NORTH, Place(0.0, 103.0, NORTHWARD), 3.0, Phase.TURNS, False),  # no far way
])  # fmt: skip
def test_a_cart_looks_whether_a_far_way_leads_along_its_own(passes, at, speed, phase, is_found):
    task = len(passes) - 2
    ahead = WaitAhead(passes, own_outline(CART), Clearance(passes), Calls(passes, 15.0))
    here = Place(100.0, -30.0, 0.0)
    line = GuidanceLine([(100.0, -30.0), (130.0, -6.0), (240.0, -6.0), (240.0, -60.0)])
    until = ahead.on_far_way(here, line, 0.0, line.length, combine(here, at, phase, task=task, speed=speed))
    assert (until < np.inf) is is_found
    if is_found:
        x, y = line.point(until)
        assert 100.0 <= x < 130.0
        assert y < -6.0 - 6.1 - 2.0  # off the header


def test_a_cart_that_drives_on_a_far_way_gets_out_of_it(monkeypatch):
    """The combine begins its way back behind it; the turn is taken for one that does not swing out."""
    monkeypatch.setattr(wait_ahead, "swings_out", lambda work: False)
    bench = CartBench(BACK, RING)
    bench.at = Place(200.0, -8.0, WESTWARD)
    cuts = combine(bench.at, Place(140.0, 6.0, 0.0), Phase.CUTS, task=1, remaining=156.0, calls=True)
    assert bench.ends_in(cuts, 0.1).phase == Phase.DRIVES
    before = bench.part._points
    turns = combine(bench.at, Place(290.0, -6.0, WESTWARD), Phase.TURNS, task=1, calls=True, speed=3.0)
    for _ in range(8):
        job = bench.ends_in(turns, 0.1)
    assert job.phase == Phase.DRIVES
    for points, keeps_off in ((before, False), (bench.part._points, True)):
        line = GuidanceLine(points.tolist())
        fine = np.array([line.point(at) for at in np.arange(25.0, 140.0, 1.0)])
        assert bool(on_the_strip(fine).any()) is not keeps_off


def test_a_cart_in_front_of_a_combine_that_stands_for_it_drives_on():
    """Across its pass: while it comes up the cart stops before its way, else both would wait for good."""
    own, line = Place(-14.0, 20.0, 0.0), GuidanceLine([(-14.0, 20.0), (40.0, 20.0)])
    clearance = Clearance(NORTH)
    for speed, free in ((1.0, 14.0 - 6.1 - 3.0 - SHORT), (0.0, np.inf)):
        said = combine(own, Place(0.0, 0.0, NORTHWARD), Phase.CUTS, remaining=96.0, speed=speed)
        assert clearance.way(own, line, 0.0, 54.0, said, 1.0) == pytest.approx(max(free, 0.0), abs=1.0)


@pytest.mark.parametrize(("task", "is_taken"), [(0, False), (1, True)])
def test_behind_its_last_pass_a_combine_may_stand_anywhere_ahead(task, is_taken):
    ways = CartWays(NORTH, [(-6.0, 0.0), (19.0, 0.0), (19.0, 100.0), (-6.0, 100.0)], 12.2, 8.2, 9.0)
    here = Place(-30.0, -20.0, 0.0)
    said = combine(here, Place(12.7, -4.0, -NORTHWARD), Phase.TURNS, task=task)
    stands = ways._stands(here, said)
    assert bool(stands) is is_taken
    way = ways.to_place(here, (45.0, -20.0), said)
    south = way.points[(way.points[:, 0] > 6.6) & (way.points[:, 0] < 18.8), 1]
    assert bool(south.max() < -16.0 - 4.0 - 3.0) is is_taken  # its header, 20 m behind the pass
