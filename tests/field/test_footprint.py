"""The ground that is held under a moving body against the field's own reader."""

import numpy as np
import pytest
import warp as wp

from swath.core.errors import InputError
from swath.field.ground.footprint_kernel import Place, Span, mean_height
from swath.field.stand import uniform
from swath.field.terrain import formula
from swath.kernels import repeatable, shared
from tests.field.made_field import made_field

POINTS = np.array([[0.0, 1.6], [0.3, -1.6], [-3.8, 1.4], [-3.8, -1.4], [-2.0, 0.01]])


@wp.kernel
def read(
    nodes: wp.array2d(dtype=wp.float64),
    first: wp.array(dtype=int),
    points: wp.array2d(dtype=wp.float64),
    span: wp.array(dtype=Span),
    place: wp.array(dtype=wp.float64),
    heights: wp.array(dtype=wp.float64),
):
    s, p = span[0], Place()
    p.u = (s.c * place[0] + s.s * place[1]) * s.per_m
    p.v = (s.c * place[1] - s.s * place[0]) * s.per_m
    p.c = s.c * wp.cos(place[2]) + s.s * wp.sin(place[2])
    p.s = s.c * wp.sin(place[2]) - s.s * wp.cos(place[2])
    for k in range(heights.shape[0]):
        heights[k] = mean_height(nodes, first, points, p, k, heights.shape[0])


def heights(footprint, place):
    """Means of five groups of the points."""
    footprint.take(*place)
    found = np.zeros(len(POINTS))
    repeatable(read, [*footprint.arguments(), shared(np.array(place)), shared(found)]).launch()
    return found


def rough(**more):
    stand = uniform.Params(row_azimuth_deg=67.0)
    return made_field(terrain=formula.Params(slope_percent=4.0, roughness_class="E"), stand=stand, **more)


def poses(count=400):
    """A winding way across several pages."""
    t = np.linspace(0.0, 60.0, count)
    return [(float(-20.0 + 0.6 * a), float(7.0 * np.sin(0.2 * a)), float(0.4 * a)) for a in t]


def world(x, y, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return x + c * POINTS[:, 0] - s * POINTS[:, 1], y + s * POINTS[:, 0] + c * POINTS[:, 1]


@pytest.mark.parametrize("page_limit", [1024, 2])
def test_reads_what_ground_height_reads(page_limit):
    field = rough(page_limit=page_limit)
    quick, truth = field.footprint(POINTS), rough()
    off = [np.abs(heights(quick, p) - truth.ground_height(*world(*p))).max() for p in poses()]
    assert max(off) < 1e-12
    spread = np.ptp([truth.ground_height(*world(*p)) for p in poses()])
    assert spread > 0.5  # there was something to get wrong


def test_means_are_those_of_the_heights():
    field = rough(page_limit=2)
    quick, alone = field.footprint(np.repeat(POINTS, 4, axis=0) + 0.1), field.footprint(POINTS + 0.1)
    ways = [(heights(quick, p), heights(alone, p)) for p in poses(50)]
    np.testing.assert_allclose(*zip(*ways, strict=True), atol=1e-12)


def test_does_not_depend_on_the_way_it_came():
    field = rough()
    moved = field.footprint(POINTS)
    for p in poses():
        assert heights(moved, p).tobytes() == heights(field.footprint(POINTS), p).tobytes()


def test_goes_on_after_the_field_went_back():
    field = rough()
    quick, kept = field.footprint(POINTS), field.save()
    before = [heights(quick, p) for p in poses(40)]
    field.load(kept)
    np.testing.assert_array_equal([heights(quick, p) for p in poses(40)], before)


@pytest.mark.parametrize(
    "place", [(np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, np.nan), (2e6, 0.0, 0.0)]
)
def test_refuses_places_that_are_none(place):
    with pytest.raises(InputError):
        rough().footprint(POINTS).take(*place)
