"""Where a driven combine goes behind its last pass: out of the way, or to a place where a cart can come.

With an empty tank it drives on; with grain it waits for a cart, and drives on to where one can come beside it
where other combines leave no room for that on its left. While a cart at work is near it stays, unless it
stops somebody.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from swath.job.cart_ways import beside
from swath.job.driver import Driver, Manoeuvre
from swath.job.engine import Job
from swath.job.footprint import footprint_of, overlap
from swath.job.path import Pose, ahead_of
from swath.job.standoff import OUT_EVERY, OUT_TURN, way_out
from swath.job.states import DONE, CombineState, way_between
from swath.job.traffic import GAP, RESTS

Array = NDArray[np.float64]
NEAR = 50.0  # m of a cart at work, at which a combine stays where it is
BEHIND, AHEAD = 30, 16  # m of a cart's line beside a combine that are to be clear
APART = 2.0  # m between places that are looked at
AGAIN = 60.0  # s after which it tries again
COMES = 60  # m that a combine that cuts is looked ahead
FAN = (0.0, OUT_TURN, -OUT_TURN, 0.5, -0.5)  # rad, to the sides


def leave(job: Job, c: CombineState, drivers: Mapping[str, Driver], fixed: list[Array]) -> bool:
    """Whether a combine behind its last pass sets out to another place now."""
    driver, is_done = drivers[c.spec.name], c.phase == "done"
    if not (is_done or waits_for_cart(c)):
        return False
    if driver.machine.speed > RESTS or driver.manoeuvre is not None or job.time < driver.tried + AGAIN:
        return False
    at_work = [k for k in job.carts if k.phase != "idle" and k.spec.name in drivers]
    here = driver.machine.pose
    is_in_the_way = any(d.blocked == c.spec.name for d in drivers.values())
    is_near = any(way_between(drivers[k.spec.name].machine.pose, here) < NEAR for k in at_work)
    if is_near and not is_in_the_way:
        return False
    others = [d.held for n, d in drivers.items() if n != c.spec.name] + fixed
    if is_done:
        found = way_out(driver, others, c.spec.limits.radius)
    else:
        there = [*fixed, *(_ground(o, drivers[o.spec.name]) for o in job.combines if o is not c)]
        if not is_in_the_way and (not there or _has_room(job, c, here, there)):
            return False
        found = way_out(
            driver, others, c.spec.limits.radius, turns=FAN, suits=lambda p: _has_room(job, c, p, there)
        )
    if found is None:
        return False
    driver.manoeuvre = Manoeuvre(0.0, found[0], "", job.time, found[1], waits=False, apart=OUT_EVERY)
    driver.tried = job.time
    driver.held = np.vstack([driver.held, found[1]])
    return True


def waits_for_cart(c: CombineState) -> bool:
    """True for a combine with grain behind its last pass, with no cart beside it."""
    is_beside = c.cart is not None and c.cart.phase == "beside"
    return c.phase == "stand" and c.is_last and c.task is None and c.tank > DONE and not is_beside


def _ground(o: CombineState, driver: Driver) -> Array:
    """Where a combine stands, and where it cuts next."""
    if o.phase != "cut":
        return driver.held
    lengths = [APART * (i + 1) for i in range(int(min(o.left, COMES) / APART))]
    return np.vstack([driver.held, driver.footprint.sweep(driver.ahead(lengths))])


def _has_room(job: Job, c: CombineState, axle: Pose, there: list[Array]) -> bool:
    """Whether a cart can come beside a combine with its fixed axle at a pose, from behind, and go on."""
    if not job.carts:
        return True
    cart = job.carts[0].spec
    place = beside(ahead_of(axle, c.spec.sheet.knife_x), c.spec, cart)
    line = [ahead_of(place, float(s)) for s in range(-BEHIND, AHEAD + 1, 2)]
    ground = footprint_of(cart.sheet).sweep([(p, p.heading) for p in line])
    return not any(overlap(ground, o, GAP) for o in there)
