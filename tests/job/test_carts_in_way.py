"""Carts in the way of a combine that cuts."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.job.carts_in_way import CartsInWay
from swath.control.job.passes import Pass, route_of
from swath.control.steer.path import Segment
from swath.control.turns.dubins import Place
from swath.control.turns.limits import TurnLimits
from swath.machine.machine_sheet import load_machine
from swath.signals import PeerState, Phase

COMBINE = load_machine("lexion-700")
HALF = 0.5 * COMBINE.header_width


def cart(ahead, left, heading, phase=Phase.DRIVES, speed=0.0):
    """As a combine hears it: a tractor that stands."""
    return PeerState(
        0, True, 0.1, ahead, left, heading, speed, 0.0,
        body_rear=-1.3, body_front=4.6, body_width=2.6, phase=phase,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("said", "stops"),
    [
        (cart(10.0, HALF + 2.5, -0.48), True),  # beside it, its front in the strip that is cut
        (cart(10.0, HALF + 2.5, 0.0), False),  # along beside it
        (cart(10.0, HALF + 4.5, -0.48), False),
        (cart(10.0, -HALF - 2.5, 0.48), True),  # on the other side
        (cart(10.0, -HALF - 2.5, -0.48), False),
        (cart(10.0, 0.0, 0.0), True),
        (cart(10.0, HALF + 2.5, -0.48, Phase.BESIDE), False),  # keeps its station
        (cart(40.0, HALF + 2.5, -0.48), False),  # far ahead
    ],
)
def test_a_combine_stops_before_a_cart_in_the_strip_that_it_cuts(said, stops):
    """However little that is turned from its course, and wherever its axle is."""
    route = route_of([Pass(((0.0, 0.0), (400.0, 0.0)))], 0, COMBINE.knife_x, TurnLimits(7.0, 0.1))
    here = Place(*route.line.point(200.0), 0.0)
    assert CartsInWay(COMBINE, [0]).stops_cutting(route, 200.0, here, [said]) is stops


@pytest.mark.parametrize(("speed", "blocks"), [(0.0, True), (0.7, True), (3.0, False)])
def test_a_combine_does_not_begin_a_turn_that_leads_back_over_a_cart_that_sets_off(speed, blocks):
    """Behind 45 m of the turn; one that drives off will be gone."""
    turn = (Segment(30.0), Segment(22.0, np.pi / 22.0), Segment(30.0))
    passes = [Pass(((0.0, 0.0), (100.0, 0.0)), turn=turn), Pass(((100.0, 14.0), (0.0, 14.0)))]
    route = route_of(passes, 0, COMBINE.knife_x, TurnLimits(7.0, 0.1))
    here = Place(*route.line.point(route.length), 0.0)
    said = cart(6.0, 12.0, 0.0, speed=speed)  # on the way back
    in_way = CartsInWay(COMBINE, [0, 1])
    assert in_way.is_blocked(route, route.length, here, [said], is_last=False) is blocks
    beside, other = (replace(said, phase=Phase.BESIDE, task=task) for task in (0, 7))
    assert in_way.is_blocked(route, route.length, here, [beside], is_last=False) is blocks  # leaves it soon
    assert not in_way.is_blocked(route, route.length, here, [other], is_last=False)  # beside another one


@pytest.mark.parametrize("late", [0.0, 0.5, 0.93])
def test_a_combine_that_came_to_rest_late_does_not_begin_its_turn_beside_a_cart_that_sets_off(late):
    """Not yet turned as its route is there, it is farther from the trailer than that says."""
    turn = (Segment(31.4, 0.1, 0.1),)
    passes = [Pass(((0.0, 0.0), (100.0, 0.0)), turn=turn), Pass(((100.0, 20.0), (0.0, 20.0)))]
    route = route_of(passes, 0, COMBINE.knife_x, TurnLimits(7.0, 0.1))
    here = Place(100.0 - COMBINE.knife_x + late, 0.0, 0.0)
    said = replace(
        cart(5.28, 7.95, 0.03, speed=0.96),
        box_x=-5.5, box_y=0.15, box_heading=-0.035, box_length=6.0, box_width=3.0,
    )  # fmt: skip
    in_way = CartsInWay(COMBINE, [0, 1])
    assert in_way.is_blocked(route, route.length + late, here, [said], is_last=False)
