"""Ways of a job's machines: clear of the truck, and those of carts straight over cut ground where that is
shorter.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.job.cart_ways import LOOKED_AT, RUN_UP, WayBeside, straight_out, way_beside
from swath.job.combine_ways import axle_pose
from swath.job.combine_ways import way_to_pass as way_of_combine
from swath.job.machines import Combine
from swath.job.path import Path, Pose, path_of
from swath.job.plan import shapely_here
from swath.job.states import BESIDE, DONE, CartState, CombineState, at, is_beside, way_between
from swath.job.truck import is_clear
from swath.job.truck_ways import way_into_lane

Array = NDArray[np.float64]
VARIANTS = tuple((share * RUN_UP, direct) for direct in (False, True) for share in (1.0, 2.0, 3.0, 0.5))
ABREASTS = (4.0, 2.0, 6.0, 9.0, 13.0)  # radii, as `way_of_combine`: the first that leads clear of the truck
CROP = 1.5  # m from standing crop to the middle of a cart
AT_TRUCK = 80.0  # m from its place there, where a cart may be farther outside the field
OUTSIDE = 20.0  # m beyond the boundary, where combines turn, too


def way_to_truck(job: Any, cart: CartState, here: Pose) -> Path:
    """Of a cart from a place; beside a combine straight on first, to wait there until that is past."""
    near = [c for c in job.combines if way_between(here, at(c)) <= BESIDE]
    place = job.place_at_truck(cart)
    lines = [_rest(c) for c in _cutting(near)]

    def is_off(way: Path) -> bool:
        return bool(job.passes.ground.is_off(lines, _looked_at(way), 0.0))

    return way_into_lane(here, place, is_beside=bool(near), is_free=_free(job, place), is_off=is_off)


def way_to_combine(job: Any, cart: CartState, here: Pose) -> WayBeside:
    """Of a cart from a place, as `way_beside`; from the truck straight out of its lane first. Of some ways
    the first that leads clear of the truck. Where passes are shared out before the job, a shorter one that
    is found as with sensors.
    """
    assert cart.combine is not None
    combine, place = cart.combine, job.place_at_truck(cart)
    found = None
    leaves = is_beside(here, [at(c) for c in job.combines if c is not combine])
    free = _free(job, place)
    for run_up, direct in VARIANTS:
        way = way_beside(
            here, combine, cart.spec, place, run_up=run_up, direct=direct, leaves=leaves, is_free=free
        )
        found = found or way
        if is_clear(way.path, job.places[0], job.fleet.truck):
            found = way
            break
    assert found is not None
    if job.shared_ways is None:
        return found
    out = straight_out(here, combine, cart.spec, place, leaves=leaves)
    way = job.shared_ways.to_combine(cart, here, out, job.combines, found)
    return found if way is None or not is_clear(way.path, job.places[0], job.fleet.truck) else way


def way_to_pass(job: Any, combine: CombineState, here: Pose) -> Path:
    """Of a combine from where its fixed axle is; of some ways the first that leads clear of the truck."""
    assert combine.task is not None
    spec, keep = combine.spec, _keep(combine.spec)
    ways = (way_of_combine(spec, here, combine.task.start, abreast) for abreast in ABREASTS)
    first = next(ways)
    if not job.places or is_clear(first, job.places[0], job.fleet.truck, keep):
        return first
    return next((w for w in ways if is_clear(w, job.places[0], job.fleet.truck, keep)), first)


def planned_way(job: Any, combine: CombineState) -> Path | None:
    """Of a combine from the end of a pass, where turns are planned before the job, too; None without one that
    leads clear of the truck.
    """
    pieces, knife = job.turns.get(combine.before), combine.spec.sheet.knife_x
    if pieces is None:
        return None
    way = path_of(pieces, axle_pose(combine.place, knife))
    is_free = not job.places or is_clear(way, job.places[0], job.fleet.truck, _keep(combine.spec))
    return way if is_free else None


def _keep(combine: Combine) -> float:
    """From the middle of the fixed axle to the farther end of the header, about [m]."""
    return 0.5 * combine.sheet.header_width + combine.sheet.knife_x


def _free(job: Any, place: Pose) -> Callable[[Path], bool] | None:
    """`is_free`; None in echelon: behind the passes there combines turn side by side, where carts that come
    straight hold them up.
    """
    in_echelon = len(job.combines) > 1 and job.file.team.together == "echelon"
    return None if in_echelon else partial(is_free, job, place)


def is_free(job: Any, place: Pose, way: Path) -> bool:
    """Whether a cart's way leads over cut ground, far outside the field only near its place at the truck,
    and clear of the truck.
    """
    points = _looked_at(way)
    begun = [(c.index, _rest(c)) for c in _cutting(job.combines)]
    if not job.passes.ground.is_clear(points, CROP, begun):
        return False
    if not is_clear(way, job.places[0], job.fleet.truck):
        return False
    shapely, far = shapely_here(), points[np.hypot(*(points - place[:2]).T) > AT_TRUCK]
    inside = shapely.contains_xy(shapely.Polygon(job.plan.boundary).buffer(OUTSIDE), far)
    for hole in job.plan.holes:
        inside &= ~shapely.contains_xy(shapely.Polygon(hole), far)
    return bool(inside.all())


def _cutting(combines: Sequence[CombineState]) -> list[CombineState]:
    return [c for c in combines if c.task and c.phase in ("cut", "stand") and c.left > DONE]


def _looked_at(way: Path) -> Array:
    """Points of a way, LOOKED_AT apart, (n, 2) [m]."""
    at = np.arange(0.0, way.length + LOOKED_AT, LOOKED_AT)
    return np.column_stack([np.interp(at, way.distance, xs) for xs in way.points.T])


def _rest(c: CombineState) -> Array:
    """Line of what a combine has left of its pass, (n, 2) [m]."""
    assert c.task is not None
    done = c.task.length - c.left
    steps = np.diff(c.task.line, axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    return np.array([c.task.at(done)[:2], *c.task.line[way > done]])
