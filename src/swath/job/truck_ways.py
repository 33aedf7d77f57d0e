"""Where carts stand at the truck, and their ways there."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from swath.job.cart_ways import LOOKED_AT, RADIUS, SAVES, STRAIGHT_OUT, straight_first, way_in
from swath.job.path import Path, Pose, ahead_of, joined, path_of, polyline
from swath.job.turns import TurnLimits, dubins

Array = NDArray[np.float64]
LANE = 7.0  # m between the places of carts at the truck
OUT = 20.0  # m from the field to the first of them
STRAIGHT_IN = 20.0  # m before its place at the truck, from where a cart drives straight


def way_into_lane(
    here: Pose, place: Pose, *, is_beside: bool = False, is_free: Callable[[Path], bool] | None = None
) -> Path:
    """Over passes and headland to a place at the truck, straight in from the nearer side; from either side
    where that is shorter in one turn over cut ground.

    is_beside: beside a combine, from where it drives straight on first, to wait there until that is past;
    is_free: whether a way leads over cut ground and clear of the truck
    """
    out = STRAIGHT_OUT if is_beside else 0.0
    begin, here = here, ahead_of(here, out)
    c, s = math.cos(place.heading), math.sin(place.heading)
    ahead = (here.x - place.x) * c + (here.y - place.y) * s
    other = Pose(place.x, place.y, place.heading + math.pi)
    near = other if ahead > 0.0 else place
    way = way_in(here, ahead_of(near, -STRAIGHT_IN), np.array([near[:2]]))[0]
    if is_free is not None:
        turns = [
            (dubins.plan(here, ahead_of(goal, -STRAIGHT_IN), TurnLimits(RADIUS, 1.0)), goal)
            for goal in (near, place if near is other else other)
        ]
        for turn, goal in sorted(turns, key=lambda turn: math.fsum(p.length for p in turn[0])):
            if math.fsum(p.length for p in turn) + STRAIGHT_IN > way.length - SAVES:
                break
            if is_free(path_of(turn, here, LOOKED_AT)):
                there = path_of(turn, here, 0.5)
                way = joined([there, polyline(np.array([there.end[:2], goal[:2]]), 0.5)])
                break
    return straight_first(begin, out, way)


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
