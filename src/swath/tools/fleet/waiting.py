"""Where several carts wait: beside the truck, off the field and off the ways of the combine."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.job.machines import Combine
from swath.job.path import path_of
from swath.job.plan import FieldPlan, Shared, shapely_here
from swath.signals import F64
from swath.tools.fleet.combine_turns import axle_at

Point = tuple[float, float]
OFF_WAYS = 20.0  # m from a combine's axle on its way: its header, and a cart whichever way it stands
APART = 22.0  # m between two carts that stand, or one and the truck
BESIDE = 6.0  # m from the field
FARTHEST = 26.0  # m beyond the field's bounds: so far carts look for ways
AROUND, STEP, TURN = 90.0, 4.0, 15.0  # m about the truck that are looked at; m, deg between two places


def waiting_places(plan: FieldPlan, ways: Sequence[F64], truck: Point, count: int) -> list[Point]:
    """Places [m] for a count of carts, the nearest to the truck first. ways: of the combines, as `axle_ways`

    InputError where there is no room.
    """
    shapely, found = shapely_here(), list[Point]()
    (west, south), (east, north) = plan.boundary.min(axis=0), plan.boundary.max(axis=0)
    bounds = shapely.box(west - FARTHEST, south - FARTHEST, east + FARTHEST, north + FARTHEST)
    free = _off_ways(bounds, plan, ways, BESIDE)
    for place in _around(truck):
        apart = min(math.dist(place, other) for other in (truck, *found))
        if len(found) < count and apart >= APART and free.contains(shapely.Point(place)):
            found.append(place)
    if len(found) < count:
        told = f"expected room beside the field, {OFF_WAYS:g} m off the combines' ways, for {count} carts"
        raise InputError("truck", list(truck), told)
    return found


def truck_place(plan: FieldPlan, ways: Sequence[F64], truck: Point, off: float) -> Point:
    """Where carts are emptied [m]: the place nearest to the truck that is so far off the field [m] and
    OFF_WAYS off the ways of the combines, as `axle_ways`.
    """
    shapely = shapely_here()
    at = shapely.Point(truck)
    nearest, _ = shapely.ops.nearest_points(_off_ways(at.buffer(AROUND), plan, ways, off), at)
    return float(nearest.x), float(nearest.y)


def _off_ways(ground: Any, plan: FieldPlan, ways: Sequence[F64], off: float) -> Any:
    """What of a ground is off the field [m], and OFF_WAYS off the ways."""
    shapely = shapely_here()
    free = ground.difference(shapely.Polygon(plan.boundary).buffer(off))
    for way in ways:
        free = free.difference(shapely.LineString(way).buffer(OFF_WAYS))
    return free


def _around(truck: Point) -> list[Point]:
    """Places about the truck, from near to far."""
    away = [APART + STEP * i for i in range(int((AROUND - APART) / STEP))]
    angles = [math.radians(TURN * i) for i in range(round(360.0 / TURN))]
    return [(truck[0] + r * math.cos(a), truck[1] + r * math.sin(a)) for r in away for a in angles]


def axle_ways(of: Shared, number: int, combine: Combine, run_out: float) -> F64:
    """Points (n, 2) [m] of the fixed axle's way of a combine through all its passes and turns, and on behind
    the last one [m].
    """
    parts = []
    for i, p in enumerate(of.plan.passes):
        if of.by[i] != number:
            continue
        end = axle_at(p.end, combine)
        parts.append(np.array([axle_at(p.start, combine)[:2], end[:2]]))
        if i in of.turns:
            parts.append(path_of(of.turns[i], end).points)
        else:
            parts.append(np.array([axle_at(p.end, combine, -run_out)[:2]]))
    return np.concatenate(parts)
