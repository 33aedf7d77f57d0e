"""What bodies sweep, and who meets whom on it, against shapely."""

import math

import numpy as np
import pytest

from swath.fleet.machines import Body, Place, Rectangle
from swath.fleet.table import Taken, swept_by
from swath.fleet.ways import driven

GAP = 0.2  # m
OWN = (Rectangle(-2.0, 4.0, -1.5, 1.5), Rectangle(4.0, 6.0, -5.0, 5.0))
TOWED = (Rectangle(-1.1, 1.1, -1.2, 1.2), Rectangle(0.0, 5.0, -0.15, 0.15))
BODIES = (Body(OWN, (), 1), Body(OWN[:1], TOWED, -1, -1.0, 5.0))


def drawn(rng, body, quarters=None):
    """A path of bends and straights, or along an axis: places, first and last samples of segments."""
    pieces = [(float(rng.choice([0.0, 0.1, -0.1])), float(rng.uniform(1.0, 20.0))) for _ in range(5)]
    heading = rng.uniform(-3.0, 3.0)
    if quarters is not None:
        pieces, heading = [(0.0, float(rng.uniform(20.0, 60.0)))], 0.5 * math.pi * quarters
    places = driven(Place(*rng.uniform(-60.0, 60.0, 2), heading, heading), pieces, body).places
    cuts = np.unique([0, *rng.integers(1, len(places) - 1, 9), len(places) - 1])
    return places, cuts[:-1], cuts[1:]


@pytest.mark.parametrize("quarters", [None, *range(-6, 6)])
@pytest.mark.parametrize("body", BODIES)
def test_an_outline_is_the_convex_hull_of_all_corners(body, quarters):
    import shapely

    places, first, last = drawn(np.random.default_rng(1), body, quarters)
    swept = swept_by(body, places, first, last, GAP)
    assert (
        swept.until(3).then(swept_by(body, places, first[3:], last[3:], GAP))[:].tolist() == swept[:].tolist()
    )
    for i, (a, b) in enumerate(zip(first, last, strict=True)):
        outlines = body.outlines(places[a : b + 1], GAP)
        for r, polygon in enumerate(swept[i]):
            hull = shapely.convex_hull(shapely.MultiPoint(outlines[:, r].reshape(-1, 2)))
            assert shapely.is_valid(polygon)
            assert shapely.symmetric_difference(hull, polygon).area < 1e-6 * hull.area


def test_who_meets_whom_is_what_polygons_say_whatever_is_added_and_taken_back():
    import shapely

    rng, taken, there = np.random.default_rng(2), Taken(), []
    for n in range(40):
        body, name = BODIES[n % 2], str(n % 5)
        swept = swept_by(body, *drawn(rng, body), GAP)
        others = [(k, polygons) for k, (other, polygons) in enumerate(there) if other != name]
        expected = [
            [k for k, polygons in others if shapely.intersects(own[:, None], polygons).any()]
            for own in swept[:]
        ]
        assert taken.met_by(swept, name) == expected
        taken.add(name, swept)
        there += [(name, polygons) for polygons in swept[:]]
        if n % 6 == 3:
            keep = len(there) - int(rng.integers(1, 30))
            taken.back(keep)
            del there[keep:]
    assert sum(map(len, expected)) > 20
