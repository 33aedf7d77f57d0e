"""Looking for a way of a cart: what is no goal is not looked for, and nothing is looked for twice."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.job import cart_ways, ways
from swath.control.job.cart_ways import CartWays
from swath.control.job.cells import Cells
from swath.control.job.ground import Ground
from swath.control.job.passes import Pass
from swath.control.job.ways import Search
from swath.control.steer.guidance_line import along_bends
from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place
from swath.signals import PeerState, Phase

FIELD = [(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]
NORTH = 0.5 * np.pi
START = Place(-15.0, 20.0, NORTH)


def search_on(ground):
    return Search(ground, ground.clear_of(2.0), ground.clear_of(1.2), 9.0)


@pytest.fixture
def shots(monkeypatch):
    """Goals of all ways that were tried directly."""
    tried, shortest = [], ways.shortest

    def counted(here, goal, radius):
        tried.append(goal)
        return shortest(here, goal, radius)

    monkeypatch.setattr(ways, "shortest", counted)
    return tried


def test_a_goal_in_the_crop_is_not_looked_for(shots):
    assert search_on(Ground(FIELD)).way(START, [Place(30.0, 20.0, 0.0)]) is None
    assert not shots


@pytest.mark.parametrize(("heading", "is_found"), [(NORTH, True), (-NORTH, False), (0.0, False)])
def test_a_goal_that_cannot_be_come_to_in_its_direction_is_not_looked_for(heading, is_found, shots):
    """A lane that ends in the crop: a point gets there, the machine only as the lane leads."""
    ground = Ground(FIELD)
    ground.cut([(30.0, 0.0), (30.0, 25.0)], 7.0)
    search, goal = search_on(ground), Place(30.0, 20.0, heading)
    assert (search.way(START, [goal]) is not None) is is_found
    assert bool(shots) is is_found


def test_of_several_directions_of_a_goal_those_are_tried_that_can_be_come_to(shots):
    ground = Ground(FIELD)
    ground.cut([(30.0, 0.0), (30.0, 25.0)], 7.0)
    goals = [Place(30.0, 20.0, 2.0 * np.pi * i / 12) for i in range(12)]
    assert search_on(ground).way(START, goals) is not None
    assert {round(np.degrees(goal.heading)) for goal in shots} <= {60, 90, 120}


def test_where_a_header_will_stick_out_of_the_field_no_way_leads_until_it_was_there():
    """A pass 1 m inside of the field's side, header 6 m: 2 m beyond it, and half a metre of room."""
    ground, line = Ground(FIELD), [(0.0, 1.0), (60.0, 1.0)]
    before = ground.clear_of(2.0)
    assert not ground.is_in(before, 30.0, -2.25)
    ground.sweep(line, 6.0)
    swept = ground.clear_of(2.0)
    assert ground.is_in(swept, 30.0, -4.25)
    assert not ground.is_in(swept, 30.0, -4.75)
    done = ground.copy()
    done.cut(line, 6.0)
    assert not done.is_in(done.clear_of(2.0), 30.0, -2.25)
    assert ground.is_in(ground.clear_of(2.0), 30.0, -4.25)


def test_a_start_beside_the_goal_counts_as_away():
    """Both in one dead end, 10 m apart: straight on."""
    ground = Ground(FIELD)
    ground.cut([(30.0, 10.0), (30.0, 35.0)], 7.0)
    way = search_on(ground).way(Place(30.0, 15.0, NORTH), [Place(30.0, 25.0, NORTH)])
    assert sum(size for _, size in way) == pytest.approx(10.0)


def test_the_way_left_leads_around_the_crop():
    """Of a point, in steps of 2 m to eight sides: at most a tenth longer than the shortest one."""
    ground = Ground(FIELD)
    goal = Place(30.0, 50.0, 0.0)
    left = Cells(ground, ground.clear_of(2.0), ground.clear_of(2.0), (START, goal)).remaining_to(goal)
    shortest = np.hypot(8.0, 2.0) + 44.0 + np.hypot(32.0, 8.0)  # 2 m clear of the two corners in the west
    assert left.at(-10.0, -4.0) == pytest.approx(shortest, rel=0.1)
    assert left.at(62.5, 50.0) == pytest.approx(32.5, abs=3.0)
    assert left.at(30.0, 20.0) == np.inf


def said(speed, phase, remaining):
    return PeerState(0, True, 0.1, 40.0, 5.0, 0.0, speed, 0.0, phase=phase, task=0, remaining=remaining)


@pytest.mark.parametrize(("speed", "phase", "remaining", "looks"), [
    (1.5, Phase.CUTS, 40.0, 1), (0.0, Phase.STANDS, 20.0, 2), (1.5, Phase.CUTS, 20.0, 2),
])  # fmt: skip
def test_with_nothing_else_in_the_way_a_failing_search_is_not_repeated(
    speed, phase, remaining, looks, monkeypatch
):
    """Nearer to a combine that stands, or may soon at the end of its pass, it looks once more."""
    count = []

    class Failing:
        def __init__(self, *given):
            pass

        def way(self, start, goals):
            count.append(start)

    monkeypatch.setattr(cart_ways, "Search", Failing)
    made = CartWays([Pass(((6.0, 0.0), (6.0, 40.0)))], FIELD, 12.0, 8.2, 9.0)
    assert made.to_place(Place(0.0, 0.0, 0.0), (-15.0, -15.0), said(speed, phase, remaining)) is None
    assert len(count) == looks


def test_a_way_leads_around_what_a_combine_cuts_next():
    """Where no crop stands: over a strip that overlaps one that was cut, to a place behind the combine."""
    first, then = Pass(((0.0, 34.0), (60.0, 34.0))), Pass(((0.0, 24.0), (60.0, 32.0)))
    made = CartWays([first, then], FIELD, 12.0, 8.2, 9.0)
    here = Place(66.0, 35.0, np.pi)
    x, y = 12.0, 25.6
    told = {
        "header_width": 12.0, "header_front": 4.0, "header_left": 0.0, "body_width": 3.4, "body_rear": -5.0,
        "body_front": 4.0,
    }  # fmt: skip
    cuts = PeerState(
        0, True, 0.1, here.x - x, y - here.y, np.arctan2(8.0, 60.0) - np.pi, 2.0, 0.0, phase=int(Phase.CUTS),
        task=1, remaining=44.0, **told,
    )  # fmt: skip
    way = made.to_pass(here, 1, cuts)
    assert way is not None
    lane = way.points[:-1]
    ahead = lane[(lane[:, 0] > 20.0) & (lane[:, 0] < 56.0)]
    middle = 24.0 + ahead[:, 0] * 8.0 / 60.0
    assert (ahead[:, 1] - middle).min() > 6.0 + 1.5


@pytest.mark.parametrize(("task", "beside", "is_found"), [
    (3, False, False),  # the last pass of the first combine, while the second one cuts its left neighbour
    (5, False, True),  # that is cut
    (3, True, True),  # it will be, by the plan
])  # fmt: skip
def test_to_a_last_pass_a_cart_comes_when_no_crop_stands_beside_it(task, beside, is_found):
    """Northward, between the second combine's passes."""
    second = Pass(((18.0, 0.0), (18.0, 40.0)), combine=1)
    last = Pass(((30.0, 0.0), (30.0, 40.0)), cart_beside=beside, cart_standing=True)
    rest = Pass(((42.0, 0.0), (42.0, 40.0))), Pass(((6.0, 0.0), (6.0, 40.0)), combine=1)
    made = CartWays([rest[0], rest[0], second, last, second, rest[1]], FIELD, 12.0, 8.2, 9.0)
    here = Place(26.0, -30.0, NORTH)
    first = replace(said(2.0, Phase.CUTS, 20.0), x=50.0, y=-4.0, heading=0.0, task=3)
    other = replace(said(2.0, Phase.CUTS, 30.0), x=40.0, y=8.0, heading=0.0, task=task - 1)
    way = made.to_pass(here, 3, first, rest=[other])
    assert (way is not None) is is_found


def driven(start, way, radius=9.0):
    """Points of a way."""
    return np.array(along_bends(*start, bends_of(way, radius)))


@pytest.mark.parametrize("goal", [
    Place(225.0, 130.0, 0.0), Place(190.0, 125.0, NORTH), Place(212.0, -12.0, -NORTH), Place(95.0, 117.0, 0),
])  # fmt: skip
def test_a_way_that_was_found_is_straightened(goal, monkeypatch):
    """Around crop: to the same place, no longer, over free ground, and in a few bends."""
    ground = Ground([(0.0, 0.0), (210.0, 15.0), (200.0, 120.0), (0.0, 110.0)])
    for line in (((0.0, 6.0), (210.0, 21.0)), ((204.0, 0.0), (194.0, 120.0)), ((0.0, 104.0), (200.0, 114.0))):
        ground.cut(line, 12.0)
    start, search = Place(-12.0, 20.0, 1.2), search_on(ground)
    way = search.way(start, [goal])
    monkeypatch.setattr(ways, "straightened", lambda cells, start, way, radius: way)
    steps = search.way(start, [goal])
    assert driven(start, way)[-1] == pytest.approx(goal[:2], abs=1e-6)
    assert not any(ground.is_in(ground.clear_of(1.0), *point) for point in driven(start, way).tolist())
    assert sum(size for _, size in way) <= sum(size for _, size in steps) + 1e-6
    bends = [sum(word != "S" for word, _ in made) for made in (way, steps)]
    assert bends[0] <= 6
    assert bends[1] > 2 * bends[0]


@pytest.mark.parametrize(("speed", "straight"), [(0.0, True), (2.0, False)])
def test_from_beside_a_combine_that_stands_a_cart_drives_straight_on_first(speed, straight):
    """To the pass of another one, past the header: its trailer would cut the corner about that."""
    passes = [Pass(((18.0, 0.0), (18.0, 40.0))), Pass(((42.0, 0.0), (42.0, 40.0)), combine=1)]
    made = CartWays(passes, FIELD, 12.0, 8.2, 9.0)
    here = Place(9.8, 46.0, NORTH)
    told = {"header_width": 12.0, "header_front": 4.0, "header_left": 0.0, "heading": 0.0}
    stood = replace(said(speed, Phase.STANDS, 0.0), x=-4.0, y=-8.2, **told)
    other = replace(said(2.0, Phase.CUTS, 30.0), x=-36.0, y=-32.2, task=1, **told)
    way = made.to_pass(here, 1, other, rest=[stood])
    assert way is not None
    begin = way.points[:11] - here[:2]
    aside = np.interp([7.0, 10.0], begin[:, 1], begin[:, 0])
    assert np.allclose(aside, -0.7, atol=0.02) is straight


@pytest.mark.parametrize(("left", "ahead", "comes_in"), [
    (8.9, 60.0, True), (8.2, 60.0, False), (8.9, 30.0, False), (8.9, 90.0, False),
])  # fmt: skip
def test_behind_a_combine_in_its_pass_a_cart_comes_in_from_farther_out(left, ahead, comes_in):
    """Once: a combine that stands is poured from off the middle of the box else, until one wall is full."""
    made = CartWays([Pass(((18.0, 0.0), (18.0, 100.0)))], FIELD, 12.0, 8.2, 9.0)
    here = Place(18.0 - left, 99.0 - ahead if ahead < 80.0 else 85.0, NORTH)
    stands = replace(said(0.0, Phase.STANDS, 0.0), x=ahead, y=-left)
    way = made.onto_line(here, np.array([here[:2], (here.x, 130.0)]), 0, stands)
    assert (way is not None) is comes_in
    if way is not None:
        assert way.points[0] == pytest.approx(here[:2])
        assert way.points[1:, 0] == pytest.approx(18.0 - 8.2)
        assert way.beside == pytest.approx(np.hypot(*np.diff(way.points, axis=0).T).sum())
        assert made.onto_line(here, way.points, 0, stands) is None


@pytest.mark.parametrize(("behind", "aside", "turned", "is_straight"), [
    (43.0, 0.4, 0.03, True), (20.0, -0.4, 0.0, True), (43.0, 1.5, 0.0, False), (43.0, 0.0, 0.5, False),
])  # fmt: skip
def test_on_the_line_beside_the_pass_a_cart_drives_straight_on(behind, aside, turned, is_straight):
    """One that has stopped there, too near behind the combine to come onto the line anew."""
    made = CartWays([Pass(((18.0, 0.0), (18.0, 200.0)), cart_beside=True)], FIELD, 12.0, 8.2, 9.0)
    here = Place(18.0 - 8.2 - aside, 120.0 - behind, NORTH + turned)
    c, s = np.cos(turned), np.sin(turned)
    right = 8.2 + aside
    stands = replace(said(0.0, Phase.STANDS, 80.0), x=c * behind - s * right, y=-c * right - s * behind)
    way = made.to_pass(here, 0, stands)
    assert (way is not None and len(way.points) == 3) is is_straight
    if is_straight:
        assert way.points[0] == pytest.approx(here[:2])
        assert way.points[1:, 0] == pytest.approx(18.0 - 8.2)
        assert way.points[1, 1] == pytest.approx(here.y + 7.0, abs=0.5)
