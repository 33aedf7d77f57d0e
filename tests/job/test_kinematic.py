"""Driven machines work off the same field as those that jump from event to event."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from swath.job.fleet import read_fleet
from swath.job.kinematic import Kinematic
from swath.job.path import Pose
from swath.job.swept import swept_ground
from swath.job.truck_ways import place_at_truck
from swath.job.work import work_off
from tests.job.jobs import finished, job_file
from tests.job.layouts import CARTS, both_levels, layout_file, same_ranking

SMALL = [(0.0, 0.0), (320.0, 0.0), (320.0, 170.0), (0.0, 170.0)]


@pytest.fixture(scope="module")
def echelon():
    motion = Kinematic()
    file = job_file(2, 2, boundary_m=SMALL, team={"together": "echelon"})
    return finished(file, motion=motion), motion


def test_two_combines_in_echelon_end_with_all_grain_at_the_truck(echelon):
    job, _ = echelon
    cut = math.fsum(c.cut for c in job.combines)
    assert cut == pytest.approx(320 * 170 * 0.8, rel=1e-9)
    assert job.at_truck == pytest.approx(cut, rel=1e-9)


def test_the_knives_leave_no_strip(echelon):
    """Swept strips of the knives, over the field; passes overlap by 0.3 of 11.7 m, and in corners."""
    _, motion = echelon
    found = swept_ground(motion.tracks, 12.0, np.array(SMALL))
    assert found.left < 0.001 * 320 * 170
    assert found.widest < 0.2
    assert 0.3 / 11.7 < found.twice / (320 * 170) < 0.1


def test_a_cart_pours_only_in_its_place(echelon):
    _, motion = echelon
    assert motion.largest_error < 4.5  # of a box of 6 m: when it starts to move with the combine


def test_nobody_touches_anybody(echelon):
    """Carts, combines and the truck, over the whole job."""
    _, motion = echelon
    assert len(motion.watch.pairs) == 10
    assert [p for p in motion.watch.pairs if p.touched > 0.0] == []


def test_every_standoff_is_solved(echelon):
    _, motion = echelon
    assert all(s.solved_by for s in motion.standoffs)


def test_giving_way_costs_little_time(echelon):
    job, _ = echelon
    by_events = finished(job_file(2, 2, boundary_m=SMALL, team={"together": "echelon"})).time
    assert 0.95 * by_events < job.time < 1.05 * by_events


def test_the_bundled_small_field_is_harvested_without_contact():
    file, _ = read_fleet("small-field")
    made = work_off(file, level="kinematic")
    assert [p for p in made.contacts if p.touched > 0.0] == []
    assert made.duration == pytest.approx(work_off(file).duration, rel=0.03)


@pytest.mark.parametrize("along", [(900.0, -20.0), (-30.0, 300.0), (450.0, 700.0)])
def test_places_at_the_truck_are_side_by_side_and_lead_away_from_the_field(along):
    boundary = np.array([(0.0, 0.0), (905.0, 35.0), (880.0, 525.0), (50.0, 575.0)])
    field = shapely.Polygon(boundary)
    places = [place_at_truck(Pose(*along, 0.0), boundary, i) for i in range(3)]
    assert places[0][:2] == along
    far = [field.distance(shapely.Point(p[:2])) for p in places]
    assert far == sorted(far)
    for a, b in pairwise(places):
        assert math.hypot(a.x - b.x, a.y - b.y) == pytest.approx(7.0)
        assert abs((b.x - a.x) * math.cos(a.heading) + (b.y - a.y) * math.sin(a.heading)) < 1e-9


def test_one_combine_takes_as_long_as_by_events():
    file = job_file(1, 1, boundary_m=SMALL)
    by_events, driven = finished(file).time, finished(file, motion=Kinematic()).time
    assert driven == pytest.approx(by_events, rel=0.05)


@pytest.mark.parametrize("layout", [4])
def test_numbers_of_carts_rank_the_same(layout):
    """Driven machines wait for each other; layout 4 with one, two, three carts: 5.3, -2.6 and 1.3 %."""
    made = [both_levels(layout_file(layout, n)) for n in CARTS]
    cheap, dear, touched, unsolved = zip(*made, strict=True)
    assert same_ranking(cheap, dear)
    assert dear[0] == pytest.approx(cheap[0], rel=0.06)
    assert dear[1:] == pytest.approx(cheap[1:], rel=0.05)
    assert all(seconds == 0.0 for pairs in touched for seconds in pairs.values())
    assert unsolved == (0, 0, 0)
