"""What cannot be cast is refused in one line that names it."""

from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.rays.engine import RayCaster
from swath.rays.refusals import check_origins
from tests.rays.hand_field import HandField, make_pages, small_library

LIBRARY = small_library(50, tiles=1)
DOWN = np.array([0.0, 0.0, -1.0])


def field(**options):
    return HandField(make_pages(LIBRARY, **({"pages": 2} | options)), LIBRARY)


def cast(where, origins, **options):
    o = np.atleast_2d(origins).astype(float)
    return RayCaster(where, threads=1).cast(o, np.tile(DOWN, (len(o), 1)), **({"range_max": 9.0} | options))


@pytest.mark.parametrize("range_max", [0.0, -5.0, np.nan, np.inf])
def test_ranges_that_are_no_length(range_max):
    with pytest.raises(InputError, match=r"range_max = .*: expected a finite range > 0 m"):
        cast(field(), [4.0, 4.0, 2.0], range_max=range_max)


def test_a_sensor_under_the_ground():
    """On a slope of 10 %, at x = 6: the ground is at 0.6 m, and where it is level at half a metre more."""
    hill = field(slope=(0.1, 0.0))
    with pytest.raises(InputError, match=r"origin = \[6, 4, 0.3\]: .* above the ground, it is 0.3 m below"):
        cast(hill, [[1.0, 4.0, 3.0], [6.0, 4.0, 0.3]])
    assert cast(hill, [[1.0, 4.0, 3.0], [6.0, 4.0, 0.9]]).is_hit.all()
    assert cast(hill, [6.0, 4.0, 0.5995]).is_hit.all()  # as good as on it


def test_a_place_without_pages():
    with pytest.raises(
        InputError, match=r"origin = \[40, 4, 2\]: .* starts over known ground: call field.ensure"
    ):
        cast(field(), [[4.0, 4.0, 2.0], [40.0, 4.0, 2.0]])
    bare = field()
    bare.pages.table = np.zeros((0, 0), np.int32)
    with pytest.raises(InputError, match="known ground"):
        cast(bare, [4.0, 4.0, 2.0])
    holed = field()
    holed.pages.table[0, 1] = -1
    assert cast(holed, [[4.0, 4.0, 2.0], [4.0, 12.0, 2.0]]).is_hit.all()
    with pytest.raises(InputError, match=r"origin = \[12, 4, 2\]"):
        cast(holed, [[4.0, 4.0, 2.0], [12.0, 4.0, 2.0]])


def test_every_origin_counts_whatever_way_it_is_looked_at():
    """The quick look at a box around all origins never passes what the look at each one refuses."""
    rng = np.random.default_rng(1)
    hills = make_pages(LIBRARY, pages=3, first=-1, ground=lambda x, y: 0.5 * np.sin(x) * np.cos(0.7 * y))
    turned = SimpleNamespace(pages=hills, library=LIBRARY, stand_yaw=0.6)
    refused = 0
    for size in (0.1, 1.0, 6.0, 20.0):
        for _ in range(60):
            middle = rng.uniform(-6.0, 12.0, 2)
            o = np.c_[middle + rng.uniform(-0.5, 0.5, (8, 2)) * size, rng.uniform(-0.4, 0.8, 8)]
            u = np.cos(0.6) * o[:, 0] + np.sin(0.6) * o[:, 1]
            v = np.cos(0.6) * o[:, 1] - np.sin(0.6) * o[:, 0]
            inside = ((u > -8) & (u < 16) & (v > -8) & (v < 16)).all()
            depth = 0.5 * np.sin(u) * np.cos(0.7 * v) - o[:, 2]
            if inside and np.abs(depth).min() < 0.02:
                continue  # too close to tell from the lattice
            wrong = not inside or bool((depth > 0.0).any())
            refused += wrong
            try:
                check_origins(turned, o)
                assert not wrong
            except InputError:
                assert wrong
    assert 60 < refused < 235


def test_no_rays_are_no_question():
    assert len(cast(field(), np.zeros((0, 3))).distance) == 0
