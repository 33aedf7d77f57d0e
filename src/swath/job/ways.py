"""Ways of a job's machines: clear of the truck, and those of carts straight over cut ground where that is
shorter.
"""

from functools import partial
from typing import Any

import numpy as np

from swath.job.cart_ways import RUN_UP, WayBeside, way_beside
from swath.job.combine_ways import way_to_pass as way_of_combine
from swath.job.path import Path, Pose
from swath.job.plan import shapely_here
from swath.job.states import BESIDE, DONE, CartState, CombineState, at, is_beside, way_between
from swath.job.truck import is_clear
from swath.job.truck_ways import way_into_lane

VARIANTS = tuple((share * RUN_UP, direct) for direct in (False, True) for share in (1.0, 2.0, 3.0, 0.5))
ABREASTS = (4.0, 2.0, 6.0, 9.0, 13.0)  # radii, as `way_of_combine`: the first that leads clear of the truck
CROP = 2.0  # m from standing crop to the middle of a cart
AT_TRUCK = 80.0  # m from its place there, where a cart may be farther outside the field
OUTSIDE = 20.0  # m beyond the boundary, where combines turn, too


def way_to_truck(job: Any, cart: CartState, here: Pose) -> Path:
    """Of a cart from a place; beside a combine straight on first, to wait there until that is past."""
    near = any(way_between(here, at(c)) <= BESIDE for c in job.combines)
    place = job.place_at_truck(cart)
    return way_into_lane(here, place, is_beside=near, is_free=partial(is_free, job, place))


def way_to_combine(job: Any, cart: CartState, here: Pose) -> WayBeside:
    """Of a cart from a place, as `way_beside`; from the truck straight out of its lane first. Of some ways
    the first that leads clear of the truck.
    """
    assert cart.combine is not None
    combine, place = cart.combine, job.place_at_truck(cart)
    found = None
    leaves = is_beside(here, [at(c) for c in job.combines if c is not combine])
    free = partial(is_free, job, place)
    for run_up, direct in VARIANTS:
        way = way_beside(
            here, combine, cart.spec, place, run_up=run_up, direct=direct, leaves=leaves, is_free=free
        )
        found = found or way
        if is_clear(way.path, job.places[0], job.fleet.truck):
            return way
    assert found is not None
    return found


def way_to_pass(job: Any, combine: CombineState, here: Pose) -> Path:
    """Of a combine from where its fixed axle is; of some ways the first that leads clear of the truck."""
    assert combine.task is not None
    spec, keep = combine.spec, 0.5 * combine.spec.sheet.header_width + combine.spec.sheet.knife_x
    ways = (way_of_combine(spec, here, combine.task.start, abreast) for abreast in ABREASTS)
    first = next(ways)
    if not job.places or is_clear(first, job.places[0], job.fleet.truck, keep):
        return first
    return next((w for w in ways if is_clear(w, job.places[0], job.fleet.truck, keep)), first)


def is_free(job: Any, place: Pose, way: Path) -> bool:
    """Whether a cart's way leads over cut ground, far outside the field only near its place at the truck,
    and clear of the truck.
    """
    points = way.points
    far = points[np.hypot(*(points - place[:2]).T) > AT_TRUCK]
    shapely = shapely_here()
    field = shapely.Polygon(job.plan.boundary).buffer(OUTSIDE)
    inside = shapely.contains_xy(field, far)
    for hole in job.plan.holes:
        inside &= ~shapely.contains_xy(shapely.Polygon(hole), far)
    cutting = [
        c for c in job.combines if c.task is not None and c.phase in ("cut", "stand") and c.left > DONE
    ]
    begun = [(c.index, _rest(c)) for c in cutting]
    return (
        bool(inside.all())
        and is_clear(way, job.places[0], job.fleet.truck)
        and job.passes.ground.is_clear(points, CROP, begun)
    )


def _rest(c: CombineState) -> Any:
    """Line of what a combine has left of its pass, (n, 2) [m]."""
    assert c.task is not None
    done = c.task.length - c.left
    steps = np.diff(c.task.line, axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    return np.array([c.task.at(done)[:2], *c.task.line[way > done]])
