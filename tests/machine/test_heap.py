"""Grain in a box: against the closed forms of cones and hip roofs, volumes, walls."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.memory_layout import Solids
from swath.field.site_setup import Bodies
from swath.field.stand import uniform
from swath.machine.heap import height_map
from swath.machine.heap.open_box import Params, Surface, largest_heap
from swath.machine.machine_sheet import load_machine
from swath.signals.setup import OpenBox
from tests.field.made_field import made_field
from tests.machine.machine_fakes import site

SLOPE = math.tan(math.radians(25.0))
BOXES = [  # box, largest heap, one spot, two spots, middle line [m3]: shared closed forms, repose 25 deg
    (OpenBox(0.0, 6.0, 3.0, 1.55, 2.0), 33.1, 25.5, 30.4, 32.5),
    (OpenBox(0.0, 7.0, 3.2, 1.55, 2.0), 41.8, 30.1, 37.4, 41.0),
]


def until_it_runs_over(box, spots, y=0.0):
    """Pours 20 l at a time to each spot in turn, until grain has run over at every one: (surface, poured)."""
    surface, poured, left = Surface(box, SLOPE, 0.1), 0.0, list(spots)
    while left:
        for x in list(left):
            over = surface.pour(0.02, x, y)
            poured += 0.02 - over
            if over > 0.0:
                left.remove(x)
    return surface, poured


@pytest.mark.parametrize(("box", "largest", "one", "two", "line"), BOXES)
def test_first_grain_over_the_rim(box, largest, one, two, line):
    inner = 0.5 * (box.length - box.width)
    cases = {one: [0.0], two: [-0.25 * box.length, 0.25 * box.length], line: np.linspace(-inner, inner, 31)}
    assert largest_heap(box, SLOPE) == pytest.approx(largest, abs=0.06)
    for expected, spots in cases.items():
        surface, poured = until_it_runs_over(box, spots)
        assert surface.volume == pytest.approx(expected, rel=0.02)
        assert surface.volume == pytest.approx(poured, rel=1e-9)


def test_a_line_beside_the_middle_holds_less():
    box = BOXES[0][0]
    share = [until_it_runs_over(box, np.linspace(-1.5, 1.5, 31), y)[0].volume / 33.146 for y in (0.2, 0.5)]
    assert share == [pytest.approx(0.93, abs=0.01), pytest.approx(0.83, abs=0.02)]


def test_slope_and_volume_of_a_cone():
    surface = Surface(OpenBox(0.0, 6.0, 6.0, 3.0, 0.0), SLOPE, 0.1)
    assert surface.pour(4.0, 0.05, 0.05) == 0.0
    high = (3.0 * 4.0 * SLOPE**2 / math.pi) ** (1.0 / 3.0)
    assert surface.at(0.05, 0.05) == pytest.approx(high, abs=0.01)
    rows = surface.heights[:, 30]
    steep = np.degrees(np.arctan(np.abs(np.diff(rows[rows > 0.0])) / 0.1))
    assert np.abs(steep - 25.0).max() < 0.5
    assert surface.volume == pytest.approx(4.0, rel=1e-12)


def test_nowhere_steeper_whatever_is_poured():
    rng = np.random.default_rng(3)
    surface, poured = Surface(BOXES[0][0], SLOPE, 0.1), 0.0
    for x, y, volume in zip(
        rng.uniform(-2.9, 2.9, 300), rng.uniform(-1.4, 1.4, 300), rng.uniform(0, 0.2, 300), strict=True
    ):
        poured += volume - surface.pour(volume, x, y)
    along = np.abs(np.diff(surface.heights, axis=0)) / 0.1
    across = np.abs(np.diff(surface.heights, axis=1)) / 0.1
    assert np.degrees(np.arctan(max(along.max(), across.max()))) < 25.5
    assert max(surface.heights[:, [0, -1]].max(), surface.heights[[0, -1]].max()) < 1.55 + 0.03
    assert surface.volume == pytest.approx(poured, rel=1e-9)


def test_saved_and_loaded():
    surface = Surface(BOXES[0][0], SLOPE, 0.1)
    surface.pour(3.0, 1.0, 0.3)
    other = Surface(BOXES[0][0], SLOPE, 0.1)
    other.load(surface.save())
    surface.pour(3.0, -1.0, 0.0)
    other.pour(3.0, -1.0, 0.0)
    np.testing.assert_array_equal(surface.heights, other.heights)


@pytest.mark.parametrize(("crop", "own", "angle"), [("maize", None, 23.0), ("barley", None, 28.0),
                                                    ("rye", None, 25.0), ("maize", 31.0, 31.0)])  # fmt: skip
def test_grain_lies_at_the_angle_of_the_fields_crop_unless_one_is_said(crop, own, angle):
    field = made_field(stand=uniform.Params(crop=crop))
    setup = replace(site(field, load_machine("grain-truck")), name="cart", bodies=(bodies := Bodies()))
    bodies.add(setup.carrier, Solids(), Pose.identity())
    heap = height_map.LEVEL.component(Params(repose_deg=own), setup)
    assert heap.slope == pytest.approx(math.tan(math.radians(angle)))
