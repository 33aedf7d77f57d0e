"""Where several carts wait: beside the truck, off the field and off the ways of the combine."""

import math

import numpy as np

from swath.core.errors import InputError
from swath.job.machines import Combine
from swath.job.path import path_of
from swath.job.plan import FieldPlan, shapely_here
from swath.signals import F64
from swath.tools.fleet.combine_turns import axle_at, turn_between
from swath.tools.fleet.echelon import assigned, run_outs

Point = tuple[float, float]
OFF_WAYS = 20.0  # m from a combine's axle on its way: its header, and a cart whichever way it stands
APART = 22.0  # m between two carts that stand, or one and the truck
BESIDE = 6.0  # m from the field
FARTHEST = 26.0  # m beyond the field's bounds: so far carts look for ways
AROUND, STEP, TURN = 90.0, 4.0, 15.0  # m about the truck that are looked at; m, deg between two places


def waiting_places(
    plan: FieldPlan, combine: Combine, truck: Point, count: int, abreast: int = 1
) -> list[Point]:
    """Places [m] for a count of carts, the nearest to the truck first. abreast: combines in echelon

    InputError where there is no room.
    """
    shapely = shapely_here()
    field = shapely.Polygon(plan.boundary)
    (west, south), (east, north) = plan.boundary.min(axis=0), plan.boundary.max(axis=0)
    bounds = shapely.box(west - FARTHEST, south - FARTHEST, east + FARTHEST, north + FARTHEST)
    free = bounds.difference(field.buffer(BESIDE))
    for number in range(abreast):
        ways = shapely.LineString(axle_ways(plan, combine, number, abreast))
        free = free.difference(ways.buffer(OFF_WAYS))
    found: list[Point] = []
    for place in _around(truck):
        apart = min(math.dist(place, other) for other in (truck, *found))
        if len(found) < count and apart >= APART and free.contains(shapely.Point(place)):
            found.append(place)
    if len(found) < count:
        told = f"expected room beside the field, {OFF_WAYS:g} m off the combine's ways, for {count} carts"
        raise InputError("truck", list(truck), told)
    return found


def _around(truck: Point) -> list[Point]:
    """Places about the truck, from near to far."""
    away = [APART + STEP * i for i in range(int((AROUND - APART) / STEP))]
    angles = [math.radians(TURN * i) for i in range(round(360.0 / TURN))]
    return [(truck[0] + r * math.cos(a), truck[1] + r * math.sin(a)) for r in away for a in angles]


def axle_ways(plan: FieldPlan, combine: Combine, number: int = 0, abreast: int = 1) -> F64:
    """Points (n, 2) [m] of the fixed axle's way through all its passes and turns, and on behind the last one.

    number: of the combine; abreast: how many there are in echelon
    """
    parts = []
    own = [p for p, by in zip(plan.passes, assigned(plan, abreast), strict=True) if by == number]
    run_out = run_outs(abreast)[number]
    for p, then in zip(own, (*own[1:], None), strict=True):
        end = axle_at(p.end, combine)
        parts.append(np.array([axle_at(p.start, combine)[:2], end[:2]]))
        if then is None:
            parts.append(np.array([axle_at(p.end, combine, -run_out)[:2]]))
        else:
            parts.append(path_of(turn_between(p, then, combine), end).points)
    return np.concatenate(parts)
