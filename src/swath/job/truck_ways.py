"""Where carts stand at the truck, and their ways there."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from swath.job.cart_ways import RADIUS, STRAIGHT_OUT, straight_first, way_in
from swath.job.path import Path, Piece, Pose, ahead_of, joined, path_of, polyline
from swath.job.turns import TurnLimits, dubins

Array = NDArray[np.float64]
LANE = 7.0  # m between the places of carts at the truck
OUT = 20.0  # m from the field to the first of them
STRAIGHT_IN = 20.0  # m before its place at the truck, from where a cart drives straight


def way_into_lane(
    here: Pose, place: Pose, *,
    is_beside: bool = False,
    is_free: Callable[[Path], bool] | None = None,
    is_off: Callable[[Path], bool] = lambda _: True,
) -> Path:  # fmt: skip
    """Over passes and headland to a place at the truck, straight in from the nearer side, or the shortest of
    that and of ways in one turn, or turned about first, from both sides, that lead over cut ground.

    is_beside: beside a combine, from where it drives straight on first, to wait there until that is past;
    is_free: whether a way leads over cut ground and clear of the truck; is_off: where none does, whether it
    does not lead before the combine that the cart is beside
    """
    out = STRAIGHT_OUT if is_beside else 0.0
    begin, here = here, ahead_of(here, out)
    c, s = math.cos(place.heading), math.sin(place.heading)
    ahead = (here.x - place.x) * c + (here.y - place.y) * s
    other = Pose(place.x, place.y, place.heading + math.pi)
    near, far = (other, place) if ahead > 0.0 else (place, other)
    way = way_in(here, ahead_of(near, -STRAIGHT_IN), np.array([near[:2]]))[0]
    if is_free is not None:
        ways = [straight for goal in (near, far) for straight in _straight(here, goal)]
        ways.sort(key=lambda w: w.length)
        free = (w for w in sorted([way, *ways], key=lambda w: w.length) if is_free(w))
        way = next(free, None) or next((w for w in [way, *ways] if is_off(w)), way)
    return straight_first(begin, out, way)


def _straight(here: Pose, goal: Pose) -> Iterator[Path]:
    """Into a place from STRAIGHT_IN before it in one turn, and once turned about to the left."""
    limits, first = TurnLimits(RADIUS, 1.0), ahead_of(goal, -STRAIGHT_IN)
    line = polyline(np.array([first[:2], goal[:2]]), 0.5)
    about = path_of([Piece(1.0 / RADIUS, 1.0 / RADIUS, math.pi * RADIUS)], here, 0.5)
    yield joined([path_of(dubins.plan(here, first, limits), here, 0.5), line])
    yield joined([about, path_of(dubins.plan(about.end, first, limits), about.end, 0.5), line])


def place_at_truck(truck: Pose, boundary: Array, number: int) -> Pose:
    """Where a cart stands at the truck: lanes along the nearest side of the field, side by side outward.

    The first is where the truck is said to be, at least OUT from the field: the truck stands on its field's
    side, and combines turn beyond the boundary.
    """
    ends = np.roll(boundary, -1, axis=0)
    step = ends - boundary
    share = ((truck.x - boundary[:, 0]) * step[:, 0] + (truck.y - boundary[:, 1]) * step[:, 1]) / (
        step**2
    ).sum(1)
    near = boundary + np.clip(share, 0.0, 1.0)[:, None] * step
    side = int(np.hypot(near[:, 0] - truck.x, near[:, 1] - truck.y).argmin())
    course = math.atan2(float(step[side, 1]), float(step[side, 0]))
    normal = math.sin(course), -math.cos(course)  # a ring is counter-clockwise: outward is on the right
    corner = boundary[side].tolist()
    first = (truck.x - corner[0]) * normal[0] + (truck.y - corner[1]) * normal[1]
    out = number * LANE + max(OUT - first, 0.0)
    return Pose(truck.x + out * normal[0], truck.y + out * normal[1], course)
