"""Where a combine goes behind its last pass, and where a cart meets its combine again."""

import math

import numpy as np
import pytest

from swath.job.cart_ways import aside, beside, box_behind, box_offset, way_beside
from swath.job.driver import STANDS, Driver, Manoeuvre
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.footprint import clearance
from swath.job.leave import leave, waits_for_cart
from swath.job.machines import fleet_of
from swath.job.path import Pose, ahead_of, polyline
from swath.job.plan import PlannedPass
from swath.job.states import at
from swath.job.traffic import look
from swath.job.work import plan_of
from tests.job.jobs import job_file
from tests.job.test_give_way import CART, COMBINE, STEP, drive, driving

EAST = 0.0


@pytest.fixture
def job():
    """Two combines and a cart, not begun."""
    file = job_file(2, 1)
    fleet = fleet_of(file)
    return Job(file, plan_of(file, fleet, None), fleet, Events())


def behind_last_passes(job, neighbour):
    """The first combine waits for a cart at the end of its last pass, the other one `neighbour` [m] to its
    left; the cart is far away.
    """
    drivers = {}
    for c, y in zip(job.combines, (0.0, neighbour), strict=True):
        c.task, c.is_last, c.phase, c.tank = None, True, "stand", 900.0
        drivers[c.spec.name] = Driver(c.spec.sheet, Pose(0.0, y, EAST), STEP)
        c.place = ahead_of(Pose(0.0, y, EAST), c.spec.sheet.knife_x)
    cart = job.carts[0]
    drivers[cart.spec.name] = Driver(cart.spec.sheet, Pose(-300.0, 0.0, EAST), STEP)
    return drivers


@pytest.mark.parametrize(("neighbour", "goes"), [(11.7, True), (60.0, False)])
def test_who_waits_for_a_cart_drives_on_to_where_one_can_come(job, neighbour, goes):
    drivers = behind_last_passes(job, neighbour)
    first, other = job.combines
    assert waits_for_cart(first)
    assert leave(job, first, drivers, []) is goes
    if not goes:
        return
    driver = drivers[first.spec.name]
    for _ in range(400):
        driver.make_room(0.2)
    there = beside(ahead_of(driver.machine.pose, first.spec.sheet.knife_x), first.spec, job.carts[0].spec)
    cart = Driver(job.carts[0].spec.sheet, there, STEP)
    a, b = (d.footprint.at(*d.place) for d in (cart, drivers[other.spec.name]))
    assert clearance(a, b) > 0.1


def test_who_waits_for_a_cart_and_stops_another_one_drives_on(job):
    drivers = behind_last_passes(job, 60.0)
    first, other = job.combines
    drivers[other.spec.name].blocked = first.spec.name
    assert leave(job, first, drivers, [])


@pytest.mark.parametrize(("far", "goes"), [(30.0, False), (200.0, True)])
def test_who_waits_for_a_cart_that_is_near_stays_unless_it_stops_one(job, far, goes):
    drivers = behind_last_passes(job, 11.7)
    first, cart = job.combines[0], job.carts[0]
    cart.phase = "to_combine"
    drivers[cart.spec.name] = Driver(cart.spec.sheet, Pose(0.0, far, EAST), STEP)
    assert leave(job, first, drivers, []) is goes
    drivers[cart.spec.name].blocked = first.spec.name
    assert goes or leave(job, first, drivers, [])


def test_who_is_done_drives_on_when_no_cart_at_work_is_near(job):
    drivers = behind_last_passes(job, 60.0)
    job.combines[0].phase, job.combines[0].tank = "done", 0.0
    cart = job.carts[0]
    cart.phase = "to_truck"
    drivers[cart.spec.name] = Driver(cart.spec.sheet, Pose(0.0, 30.0, EAST), STEP)
    assert not leave(job, job.combines[0], drivers, [])  # a cart at work is near
    cart.phase = "idle"
    assert leave(job, job.combines[0], drivers, [])


def cutting(job, done):
    """A combine that has cut so much [m] of a pass to the east, 400 m long."""
    line = np.array([[0.0, 0.0], [400.0, 0.0]])
    c = job.combines[0]
    c.task, c.phase, c.left, c.per_metre = PlannedPass(line), "cut", 400.0 - done, 9.0
    return c


@pytest.mark.parametrize(
    ("along", "heading"),
    [(150.0, math.pi), (150.0, 1.7), (205.0, EAST)],
    ids=["turned about", "turned aside", "ahead of it"],
)
def test_a_cart_near_the_line_needs_not_go_to_the_begin_of_the_pass(job, along, heading):
    c = cutting(job, 200.0)
    cart = job.carts[0].spec
    here = Pose(along, aside(c.spec) + 1.0, heading)
    path, base, length, onto = way_beside(here, c, cart, Pose(0.0, -50.0, EAST))
    assert length == pytest.approx(400.0)
    x, y, course = path.at(onto)
    assert (y, math.sin(course)) == pytest.approx((aside(c.spec), 0.0), abs=0.01)
    goal = base + 200.0  # along its path: where its box is under the pipe of the combine
    if heading == EAST:
        assert goal < 0.0  # it waits
        assert abs(goal) == pytest.approx(205.0 - (200.0 - box_offset(c.spec) + box_behind(cart)), abs=0.5)
        return
    x, y, course = path.at(goal)
    assert (x, y) == pytest.approx(beside(at(c), c.spec, cart)[:2], abs=0.3)
    assert math.cos(course) > 0.99
    assert goal < 150.0
    assert (path.points[:, 0] > along - 60.0).all()


def test_a_cart_that_is_too_far_ahead_of_one_that_stands_comes_from_behind(job):
    c = cutting(job, 200.0)
    c.phase = "stand"
    here = Pose(215.0, aside(c.spec), EAST)
    _, base, *_ = way_beside(here, c, job.carts[0].spec, Pose(0.0, -50.0, EAST))
    assert base + 200.0 > 20.0


def test_a_cart_that_meets_a_combine_drives_aside_and_neither_stops():
    """7 m between their lines: the header is 6 m, the cart 1.8 m to its side."""
    combine = driving(COMBINE, Pose(0.0, 0.0, EAST), 2.0)
    cart = driving(CART, Pose(130.0, -7.0, math.pi), 4.0, way=300.0)
    slowest = math.inf
    for _ in range(50):
        assert drive([combine, cart], 0.6) > 0.1
        if combine.driver.machine.distance > 10.0:
            slowest = min(slowest, combine.speed, cart.speed)
    assert slowest > 1.5
    assert cart.driver.machine.x < 20.0
    assert combine.driver.machine.y == pytest.approx(0.0, abs=0.02)


def test_nobody_waits_for_the_turn_of_one_that_it_stops():
    combine = driving(COMBINE, Pose(0.0, -40.0, 0.5 * math.pi), 0.0, "turns")
    combine.turns, combine.wanted = True, 2.0
    other = driving(COMBINE, Pose(-16.0, 0.0, EAST), 2.0, "other")
    look([combine, other], {})
    assert other.blocked == "turns"
    cart = driving(CART, Pose(0.0, -34.05, EAST), 0.0, "cart")
    cart.beside, cart.wanted = "other", 0.0
    for m in (combine, other):
        m.blocked, m.claim = "", None
    combine.driver.machine.speed = 0.0
    look([combine, other, cart], {})
    assert combine.blocked == "cart"
    assert other.blocked == ""


def made_room(let):
    """A cart in a manoeuvre over 30 m, and the ground that it holds for it after each second."""
    m = driving(CART, Pose(0.0, 0.0, EAST), 0.0)
    path = polyline(np.array([[0.0, 0.0], [30.0, 0.0]]))
    places = [(path.at(1.5 * i), EAST) for i in range(21)]
    m.driver.manoeuvre = Manoeuvre(0.0, path, "", 0.0, m.driver.footprint.sweep(places))
    ground = []
    for _ in range(30):
        for _ in range(5):
            m.driver.let(let)
            m.driver.make_room(0.2)
        left = m.driver.room_ground
        ground.append(0 if left is None else len(left))
    return m.driver, ground


def test_ground_behind_a_manoeuvre_is_free_again():
    driver, ground = made_room(math.inf)
    assert ground == sorted(ground, reverse=True)
    assert 0 < ground[10] < 0.7 * ground[0]
    assert driver.manoeuvre.is_there
    assert ground[-1] == 0


def test_a_manoeuvre_that_others_do_not_let_go_on_is_given_up():
    driver, _ = made_room(0.0)
    assert driver.manoeuvre.is_there
    assert not driver.manoeuvre.waits
    assert STANDS * STEP <= 15.0
