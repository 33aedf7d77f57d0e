"""Who may drive on, who steers aside and who makes room; lines beside bent passes keep their distance."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from swath.job.cart_ways import shifted
from swath.job.driver import Driver
from swath.job.footprint import clearance, overlap
from swath.job.give_way import GiveWay
from swath.job.path import Pose, ahead_of, polyline
from swath.job.standoff import manoeuvre, way_out
from swath.job.states import CartState
from swath.job.traffic import LOOKS, Mover, look, steer_aside
from swath.machine.machine_sheet import load_machine

COMBINE, CART = "lexion-700", "tractor-grain-cart"
STEP = 0.2


def driving(sheet, pose, speed, name="", way=200.0):
    """A machine that drives straight on."""
    driver = Driver(load_machine(sheet), pose, STEP)
    driver.take(polyline(np.array([pose[:2], ahead_of(pose, way)[:2]])), 0.1)
    driver.machine.speed = speed
    return Mover(name or sheet, driver, speed)


def drive(movers, time, fixed=None):
    """All for a time [s]; least clearance of the first two [m]."""
    least = math.inf
    for i in range(round(time / STEP)):
        if i % LOOKS == 0:
            steer_aside(movers, fixed or {})
            for m in movers:
                m.blocked, m.claim = "", None
            look(movers, fixed or {})
        for m in movers:
            if m.driver.follower is not None:
                m.driver.step(m.wanted)
        a, b = (m.driver.footprint.at(*m.driver.place) for m in movers[:2])
        least = min(least, clearance(a, b))
    return least


@pytest.mark.parametrize(
    ("south", "stops"),
    [(-12.0, True), (-60.0, False), (40.0, False)],
    ids=["a combine crosses soon", "a combine is far off", "a combine is past"],
)
def test_a_cart_stops_before_what_a_combine_drives_over(south, stops):
    combine = driving(COMBINE, Pose(0.0, south, 0.5 * math.pi), 2.0)
    cart = driving(CART, Pose(-16.0, 0.0, 0.0), 3.0)
    look([combine, cart], {})
    assert (cart.driver.cap == 0.0) is stops


def test_a_cart_that_is_in_the_way_already_goes_on():
    combine = driving(COMBINE, Pose(0.0, -10.0, 0.5 * math.pi), 2.0)
    cart = driving(CART, Pose(0.0, 0.0, 0.0), 3.0)
    for _ in range(2):
        look([combine, cart], {})
    assert cart.driver.cap > 0.0
    assert drive([combine, cart], 30.0) > 0.0
    assert combine.driver.machine.y > 20.0


@pytest.mark.parametrize("south", np.linspace(-40.0, -5.0, 8).tolist())
@pytest.mark.parametrize("west", [-45.0, -30.0, -15.0])
def test_two_whose_ways_cross_never_touch_and_both_come_past(south, west):
    combine = driving(COMBINE, Pose(0.0, south, 0.5 * math.pi), 2.0)
    cart = driving(CART, Pose(west, 12.0, 0.0), 4.0)
    assert drive([combine, cart], 60.0) > 0.0
    assert combine.driver.machine.y > 20.0
    assert cart.driver.machine.x > 20.0


def test_nose_to_nose_both_come_to_rest_apart():
    machines = [driving(COMBINE, Pose(0.0, 0.0, 0.0), 2.0), driving(CART, Pose(60.0, 0.0, math.pi), 4.0)]
    assert drive(machines, 30.0) > 0.05
    assert all(m.speed < 0.05 for m in machines)


@pytest.mark.parametrize("apart", [11.7, 12.1])
def test_headers_that_overlap_pass_each_other(apart):
    """Passes are 0.3 m nearer to each other than headers are wide: the second one drives farther out."""
    first = driving(COMBINE, Pose(0.0, 0.0, 0.0), 2.0, "first")
    second = driving(COMBINE, Pose(80.0, apart, math.pi), 2.0, "second")
    assert drive([first, second], 60.0) > 0.05
    assert first.driver.machine.x > 100.0
    assert abs(first.driver.machine.y) < 0.01
    assert second.driver.machine.y == pytest.approx(apart, abs=0.02)  # on its line again


@pytest.mark.parametrize("heading", [0.0, math.pi])
def test_the_first_one_passes_a_combine_that_stands_on_the_next_pass(heading):
    """A full combine waits for its cart: the one of higher precedence drives farther out."""
    first = driving(COMBINE, Pose(0.0, 0.0, 0.0), 2.0, "first")
    stands = driving(COMBINE, Pose(80.0, 11.7, heading), 0.0, "stands")
    assert drive([first, stands], 80.0) > 0.05
    assert first.driver.machine.x > 120.0
    assert first.driver.machine.y == pytest.approx(0.0, abs=0.02)  # on its line again


def test_backwards_over_its_own_tracks_a_trailer_comes_to_where_it_was():
    cart = driving(CART, Pose(0.0, 0.0, 0.0), 2.0)
    cart.driver.take(polyline(np.array([[0.0, 0.0], [30.0, 0.0], [40.0, 8.0]])), 0.12)
    places = []
    for _ in range(80):
        cart.driver.step(2.0)
        places.append(cart.driver.place)
    cart.driver.back(15.0)
    pose, trailer = cart.driver.place
    there = min(places, key=lambda p: math.hypot(p[0].x - pose.x, p[0].y - pose.y))
    assert math.hypot(there[0].x - pose.x, there[0].y - pose.y) < 0.2
    assert trailer == pytest.approx(there[1], abs=0.02)


def test_at_a_crawl_a_braking_way_is_looked_at_closely():
    """In a bend a corner comes past a header's end within 0.4 m, nearer than before and behind that."""
    cart = driving(CART, Pose(0.0, 0.0, 0.0), 0.3)
    places = cart.driver.until_rest(2.0, LOOKS)
    assert len(places) > 3
    assert all(math.hypot(p[0].x - q[0].x, p[0].y - q[0].y) < 0.4 for p, q in pairwise(places))


def standing(x, y, heading, sheet=CART):
    driver = Driver(load_machine(sheet), Pose(x, y, heading), STEP)
    return driver, driver.footprint.sweep([driver.place])


def test_a_manoeuvre_leaves_the_ground_that_it_has_to():
    cart = driving(CART, Pose(-40.0, 0.0, 0.0), 2.0)
    for _ in range(100):
        cart.driver.step(2.0)
    cart.driver.machine.speed = 0.0
    x = cart.driver.machine.x
    other = driving(COMBINE, Pose(x + 14.0, 0.0, math.pi), 2.0)
    ahead = other.driver.footprint.sweep(other.driver.ahead([2.0 * i for i in range(20)]))
    held = other.driver.footprint.sweep([other.driver.place])
    made = manoeuvre(cart.driver, [held], ahead, None, ahead, radius=8.0)
    assert made is not None
    back, path, ground, _ = made
    assert back > 0.0 or path is not None
    assert not overlap(ground, held)
    if path is not None:
        end = path.end
        assert not overlap(cart.driver.footprint.sweep([(end, end.heading)]), ahead)


@pytest.mark.parametrize("apart", [12.14, 12.02, 11.99])
def test_headers_that_are_next_to_each_other_part(apart):
    """A combine at the end of its last pass drives on beside one that stands, however near that is."""
    done, other = driving(COMBINE, Pose(0.0, 0.0, 0.0), 0.0), standing(0.0, -apart, 0.0, COMBINE)[0]
    found = way_out(done.driver, [other.held], 8.0)
    assert found is not None
    assert found[0].length > 40.0
    done.driver.take(found[0], 0.15)
    done.wanted = 2.0
    drive([done, Mover("other", other, 0.0)], 30.0)
    assert done.driver.machine.x > 30.0


def test_who_is_walled_in_has_no_manoeuvre_and_the_standoff_is_told():
    cart = driving(CART, Pose(0.0, 0.0, 0.0), 0.0, "cart")
    cart.wanted, cart.blocked = 3.0, "truck"
    walls = [standing(x, y, h)[1] for x, y, h in ((12.0, 0.0, 1.57), (0.0, 4.0, 0.0), (0.0, -4.0, 0.0))]
    assert way_out(cart.driver, walls, 8.0) is None
    told = GiveWay()
    state = CartState(None, Pose(0.0, 0.0, 0.0), phase="to_truck")
    fixed = {"truck": np.vstack(walls)}
    for time in (0.0, 5.0, 12.0):
        told.look(time, [cart], {"cart": state}, fixed, lambda *_: cart.driver.follower.path)
    (found,) = told.standoffs
    assert (found.first, found.second, found.solved_by) == ("cart", "truck", "")
    assert cart.driver.manoeuvre is None


def test_a_line_beside_a_bent_pass_keeps_its_distance():
    line = np.array([[0.0, 0.0], [100.0, 0.0], [180.0, 30.0], [250.0, 20.0]])
    beside = shifted(line, 0.0, 8.2)
    for (a, b), (c, d) in zip(pairwise(line), pairwise(beside), strict=True):
        side, there = shapely.LineString([a, b]), shapely.LineString([c, d])
        middle = there.interpolate(0.5, normalized=True)
        assert side.distance(middle) == pytest.approx(8.2)
        ahead, turn = b - a, np.array([middle.x, middle.y]) - a
        assert ahead[0] * turn[1] - ahead[1] * turn[0] > 0.0
