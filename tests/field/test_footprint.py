"""The quick reader of heights under a moving body against the field's own reader."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.stand import uniform
from swath.field.terrain import formula
from tests.field.made_field import made_field

POINTS = np.array([[0.0, 1.6], [0.3, -1.6], [-3.8, 1.4], [-3.8, -1.4], [-2.0, 0.01]])


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
    off = [np.abs(quick.heights(*p) - truth.ground_height(*world(*p))).max() for p in poses()]
    assert max(off) < 1e-12
    spread = np.ptp([truth.ground_height(*world(*p)) for p in poses()])
    assert spread > 0.5  # there was something to get wrong


@pytest.mark.parametrize("page_limit", [1024, 2])
def test_the_compiled_means_are_those_of_the_heights_to_the_bit(page_limit):
    field, points = (
        rough(page_limit=page_limit),
        np.concatenate([POINTS, POINTS + 0.17, -POINTS, POINTS[::-1]]),
    )
    quick, plain = field.footprint(points, groups=4), field.footprint(points)
    for pose in poses():
        parts = plain.heights(*pose).reshape(4, -1)
        expected = [sum(part.tolist()[1:], part[0]) / len(part) for part in parts]
        assert quick.means(*pose) == expected


def test_does_not_depend_on_the_way_it_came():
    field = rough()
    moved = field.footprint(POINTS)
    for p in poses():
        assert moved.heights(*p).tobytes() == field.footprint(POINTS).heights(*p).tobytes()


def test_goes_on_after_the_field_went_back():
    field = rough()
    quick, kept = field.footprint(POINTS), field.save()
    before = [quick.heights(*p) for p in poses(40)]
    field.load(kept)
    np.testing.assert_array_equal([quick.heights(*p) for p in poses(40)], before)


@pytest.mark.parametrize(
    "place", [(np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, np.nan), (2e6, 0.0, 0.0)]
)
def test_refuses_places_that_are_none(place):
    with pytest.raises(InputError):
        rough().footprint(POINTS).heights(*place)
