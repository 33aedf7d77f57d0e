"""Places at which a combine can be emptied standing: around the field, about the gate, on headland passes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from swath.fleet.bodies import Body, Place
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.plan import HEADLAND, Plan
from swath.fleet.yard import fits


@dataclass(frozen=True)
class Params:
    """inner_m, outer_m: between places on headland passes and around the field; off_m: of the latter from the
    field; gate_m: reach of those about the gate; every_m: between them; clear_m: kept off who waits.
    Estimates: so many that one is near, so few that they are looked through at once.
    """

    inner_m: float = 60.0
    outer_m: float = 30.0
    off_m: tuple[float, ...] = (7.0, 9.0, 12.0, 14.0)
    gate_m: float = 40.0
    every_m: float = 10.0
    clear_m: float = 2.0


PARAMS = Params()


def service_places(
    ground: Ground,
    combine: Body,
    cart: Body,
    beside: tuple[float, float],
    waits: Sequence[tuple[Body, Place]],
) -> Iterator[Place]:
    """Places of a combine on ground without crop, a cart beside it, so far ahead and leftward [m]; off who
    waits or empties, bodies at their places.
    """
    shapely = shapely_here()
    taken = [shapely.polygons(b.outlines(np.array([p]), PARAMS.clear_m)[0]) for b, p in waits]
    bare = shapely.difference(ground.open, ground.field)
    bare = shapely.difference(bare, shapely.union_all(np.concatenate(taken)))
    shapely.prepare(bare)
    for place in _along(ground):
        if fits(bare, combine, place) and fits(bare, cart, place.ahead(*beside)):
            yield place


def along_passes(plan: Plan) -> Iterator[Place]:
    """Places on headland passes, in both directions."""
    for p in plan.passes:
        if p.kind == HEADLAND:
            count = max(1, int(p.length / PARAMS.inner_m))
            for share in (np.arange(count) + 0.5) / count:
                x, y = ((1.0 - share) * a + share * b for a, b in zip(p.start, p.end, strict=True))
                for h in (p.heading, p.heading + math.pi):
                    yield Place(float(x), float(y), h, h)


def _along(ground: Ground) -> Iterator[Place]:
    """Places beside the outlines, along them in both directions, and about the gate and the truck."""
    shapely = shapely_here()
    for part in shapely.get_parts(ground.field):
        points = shapely.get_coordinates(shapely.orient_polygons(part, exterior_cw=False).exterior)
        for a, b in pairwise(points):
            length, heading = math.dist(a, b), math.atan2(*(b - a)[::-1])
            count = max(1, int(length / PARAMS.outer_m))
            for i in range(count):
                middle = a + (i + 0.5) / count * (b - a)
                for out in PARAMS.off_m:
                    for turn in (0.0, math.pi):
                        h = heading + turn
                        x, y = middle + out * np.array([math.sin(heading), -math.cos(heading)])
                        yield Place(float(x), float(y), h, h)
    x0, y0 = ground.gate
    steps = np.arange(-PARAMS.gate_m, PARAMS.gate_m + 1.0, PARAMS.every_m)
    for x in steps:
        for y in steps:
            for h in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
                h = h + ground.dock.heading
                yield Place(x0 + float(x), y0 + float(y), h, h)
