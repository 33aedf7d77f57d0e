"""Fields with several initial edges: a strip between two, a corner, and what cannot be."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.edges.edge import GapParams, StraightEdge, TeethParams, code_at, code_within, make_edge
from swath.field.memory_layout import STANDING
from tests.field.made_field import SETUP, made_field, rectangle

WEST = StraightEdge(y_m=-20.0, stubble_height_m=0.1, crop_begins_m=None)
EAST = StraightEdge(x_m=12.0, y_m=-20.0, crop_side="left", stubble_height_m=0.2, crop_begins_m=None)
SOUTH = StraightEdge(x_m=-30.0, y_m=-15.0, heading_deg=0.0, crop_side="left", stubble_height_m=0.3)


def edges(**params):
    return {name: make_edge(p, SETUP, name) for name, p in params.items()}


def test_crop_stands_between_two_edges_and_each_side_has_its_own_stubble():
    field = made_field(edge=edges(west=WEST, east=EAST))
    x, y = np.meshgrid(np.arange(-15.005, 30.0, 0.09), np.arange(-9.0, 9.0, 1.3))
    assert np.array_equal(field.standing(x, y), (x > 0.0) & (x < 12.0))
    codes = code_at(field.edges, x, y)
    assert np.array_equal(codes, np.where(x < 0.0, 10, np.where(x > 12.0, 20, STANDING)))
    across = rectangle(-5.0, -2.0, 20.0, 2.0)
    assert field.standing_area(across) == pytest.approx(48.0, abs=0.5)
    assert list(field.edges) == ["west", "east"]
    assert field.first_edge is field.edges["west"].shape


def test_outside_several_edges_lies_the_stubble_of_the_nearest():
    three = edges(west=WEST, east=EAST, south=SOUTH)
    x, y = np.array([-3.0, -1.0, 13.0, 17.0, 6.0]), np.array([-16.0, -19.0, -16.5, -15.5, -16.0])
    assert code_at(three, x, y).tolist() == [30, 10, 20, 30, 30]
    turned_round = dict(reversed(three.items()))
    assert np.array_equal(code_at(turned_round, x, y), code_at(three, x, y))


def test_every_edge_has_its_own_gaps_and_teeth():
    gap = GapParams(start_m=10.0, end_m=14.0, depth_m=3.0, stubble_height_m=0.05)
    teeth = TeethParams(amplitude_m=1.0, wavelength_m=4.0)
    west = StraightEdge(y_m=-20.0, crop_begins_m=None, gaps=(gap,), teeth=teeth)
    east = StraightEdge(x_m=12.0, y_m=-20.0, crop_side="left", crop_begins_m=None, teeth=teeth)
    made = edges(west=west, east=east)
    assert made["west"].teeth.seed != made["east"].teeth.seed
    y = np.arange(-20.0, 20.0, 0.05)
    x = np.arange(0.0, 12.0, 0.02)
    left = np.argmax(code_at(made, *np.meshgrid(x, y)) == STANDING, axis=1)
    in_gap = (y >= -10.0) & (y < -6.0)
    assert left[in_gap].min() >= 150
    assert np.abs(0.02 * left[~in_gap] - made["west"].teeth.depth(y[~in_gap] + 20.0)).max() < 0.021
    assert code_at(made, np.array([1.0]), np.array([-8.0])) == 5


def test_one_code_for_a_disc_is_never_wrong():
    teeth = TeethParams(amplitude_m=1.5, wavelength_m=5.0)
    three = edges(west=StraightEdge(y_m=-30.0, teeth=teeth, crop_begins_m=5.0), east=EAST, south=SOUTH)
    rng = np.random.Generator(np.random.Philox(4))
    x, y = rng.uniform(-30.0, 40.0, 2000), rng.uniform(-30.0, 20.0, 2000)
    found = code_within(three, x, y, 1.2)
    angle, far = rng.uniform(0, 2 * np.pi, (60, 1)), 1.2 * np.sqrt(rng.uniform(0, 1, (60, 1)))
    inside = code_at(three, x + far * np.cos(angle), y + far * np.sin(angle))
    one = found >= 0
    assert np.array_equal(inside[:, one], np.broadcast_to(found[one], inside[:, one].shape))
    assert 0.6 < one.mean() < 1.0
    assert {15, 20, 30, STANDING} <= set(found.tolist())


def test_edges_without_crop_between_them_are_refused_by_name():
    away = StraightEdge(x_m=-12.0, y_m=-20.0, crop_side="left", crop_begins_m=None)
    with pytest.raises(InputError, match=r"field\.edges\.west: expected an edge with some of its crop on"):
        made_field(edge=edges(west=WEST, away=away))
    far = StraightEdge(x_m=500.0, crop_side="left")
    with pytest.raises(InputError, match=r"field\.edges\.far: expected an edge inside the boundary"):
        made_field(edge=edges(west=WEST, far=far), boundary=[[-50, -50], [50, -50], [50, 50], [-50, 50]])
    with pytest.raises(InputError, match="expected at least one edge"):
        made_field(edge={})
