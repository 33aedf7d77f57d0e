"""Ways over free ground: closed forms, closed ground, reversing, a trailer."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.fleet.ground import Grid
from swath.fleet.machines import Drive, Place, body_of
from swath.fleet.ways import (
    PARAMS,
    Finder,
    driven,
    eased,
    eased_where_clear,
    limits_along,
    rolled,
    stops_along,
    straight,
    times_along,
)
from swath.machine.machine_sheet import load_machine

COMBINE, CART = body_of(load_machine("lexion-700")), body_of(load_machine("tractor-grain-cart"))
DRIVE = Drive(radius=6.4, turning=2.0, straight=3.0, backwards=1.0, accel=0.5, shift=2.0)
TOWS = Drive(radius=9.0, turning=2.5, straight=4.0, backwards=0.0, accel=0.6, shift=2.0)


def ground(closed=()):
    """Open ground of 100 m by 80 m but for rectangles (west, east, south, north), and a search on it."""
    free, edge = np.full((200, 160), -1.0, np.float32), np.full((200, 160), 9.0, np.float32)
    for w, e, s, n in closed:
        free[int(2 * w) : int(2 * e), int(2 * s) : int(2 * n)] = 1e18
    return Finder(Grid(0.0, 0.0, 0.5, edge, free))


def cut(finder, time):
    """All crop, at a time."""
    free = finder.grid.free_from
    free[free > 1e17] = time
    finder.grid.changed.append((slice(0, free.shape[0]), slice(0, free.shape[1])))


@pytest.mark.parametrize(
    ("goal", "length"),
    [
        ((70.0, 40.0, 0.0), 40.0),
        ((30.0, 52.8, math.pi), math.pi * 6.4),  # half a circle
        ((36.4, 56.4, math.pi / 2), 0.5 * math.pi * 6.4 + 10.0),  # a quarter and straight on
    ],
)
def test_on_open_ground_the_shortest_way_is_the_dubins_path(goal, length):
    finder = ground()
    start, end = Place(30.0, 40.0, 0.0, 0.0), Place(*goal, goal[2])
    way = finder.find(COMBINE, DRIVE, start, end)
    assert way.length == pytest.approx(length, abs=0.01)
    assert way.end[:2] == pytest.approx(goal[:2], abs=1e-6)


def test_a_dubins_path_of_any_length_is_taken_at_once():
    free, edge = np.full((5600, 80), -1.0, np.float32), np.full((5600, 80), 9.0, np.float32)
    finder = Finder(Grid(0.0, 0.0, 0.5, edge, free))
    way = finder.find(COMBINE, DRIVE, Place(20.0, 15.0, 0.0, 0.0), Place(2770.0, 25.0, 0.0, 0.0), most=2)
    assert way is not None
    assert 2750.0 < way.length < 2750.1


def test_no_way_leads_through_crop_that_stands_and_one_around_it_is_found():
    crop = [(48.0, 52.0, 0.0, 60.0)]
    finder = ground(crop)
    way = finder.find(COMBINE, DRIVE, Place(30.0, 20.0, 0.0, 0.0), Place(70.0, 20.0, 0.0, 0.0))
    chassis = COMBINE.outlines(way.places)[:, 0]
    inside = (chassis[..., 0] > 48.5) & (chassis[..., 0] < 51.5) & (chassis[..., 1] < 59.5)
    assert not inside.any()
    assert way.length > 2 * 40.0  # up to the end of the crop and back


def test_crop_that_is_cut_by_then_is_open_ground():
    finder = ground([(48.0, 52.0, 0.0, 80.0)])
    start, goal = Place(20.0, 20.0, 0.0, 0.0), Place(80.0, 20.0, 0.0, 0.0)
    assert finder.find(COMBINE, DRIVE, start, goal) is None
    cut(finder, 500.0)
    assert finder.find(COMBINE, DRIVE, start, goal, time=100.0) is None
    assert finder.find(COMBINE, DRIVE, start, goal, time=600.0) is not None


def test_a_combine_backs_out_of_a_dead_end_and_a_cart_cannot():
    walls = [(20.0, 61.0, 32.0, 36.0), (20.0, 61.0, 44.0, 48.0), (57.0, 61.0, 32.0, 48.0)]
    finder = ground(walls)
    start, goal = Place(44.0, 40.0, 0.0, 0.0), Place(12.0, 60.0, math.pi / 2, math.pi / 2)
    way = finder.find(COMBINE, DRIVE, start, goal)
    assert (way.ways < 0.0).any()
    assert finder.find(CART, TOWS, start, goal) is None


@pytest.mark.parametrize("deep", [8.0, 16.0, 33.0])
@pytest.mark.parametrize("bend", [0.0, 0.04])
def test_who_is_shut_in_by_a_pass_goes_back_as_it_came(deep, bend):
    """Crop stands 10 cm beside the body, where ways keep 15 cm."""
    finder = ground([(20.0, 60.0, 30.0, 38.5), (20.0, 60.0, 42.0, 50.0)])
    came = driven(
        Place(8.0, 40.25, 0.0, 0.0), [(0.0, deep), (-bend, 4.0), (bend, 8.0), (-bend, 4.0)], COMBINE
    )
    start, goal = Place(*came.places[-1].tolist()), Place(12.0, 70.0, math.pi / 2, math.pi / 2)
    assert finder.find(COMBINE, DRIVE, start, goal) is None
    way = finder.find(COMBINE, DRIVE, start, goal, came=lambda: came)
    back = way.places[way.distance < 9.8, :2]  # the length of its body
    assert np.hypot(*(back[:, None] - came.places[None, :, :2]).transpose(2, 0, 1)).min(axis=1).max() < 1e-6
    assert way.end[:2] == pytest.approx(goal[:2], abs=1e-6)
    assert finder.find(COMBINE, replace(DRIVE, backwards=0.0), start, goal, came=lambda: came) is None


@pytest.mark.parametrize("goal", [(60.0, 62.0, math.pi), (75.0, 30.0, -math.pi / 2), (85.0, 55.0, 0.0)])
def test_a_trailer_that_has_to_be_in_line_comes_straight_to_the_goal_at_once(goal):
    finder = ground()
    end = Place(*goal, goal[2])
    way = finder.find(CART, TOWS, Place(40.0, 40.0, 0.0, 0.0), end, in_line=PARAMS.line_deg, most=200)
    x, y, heading, trailer = way.places[-1]
    assert (x, y) == pytest.approx(goal[:2], abs=1e-6)
    assert math.cos(heading - goal[2]) == pytest.approx(1.0)
    assert math.cos(trailer - heading) > math.cos(math.radians(6.0))


def test_a_trailer_settles_on_the_circle_of_the_tractrix():
    radius, hitch, drawbar = 15.0, CART.hitch, CART.drawbar
    track = driven(Place(0.0, 0.0, 0.0, 0.0), [(1.0 / radius, 200.0)], CART, spacing=0.05)
    x, y, heading, trailer = track.places[-1]
    axle = [
        x + hitch * math.cos(heading) - drawbar * math.cos(trailer),
        y + hitch * math.sin(heading) - drawbar * math.sin(trailer),
    ]
    assert math.dist(axle, (0.0, radius)) == pytest.approx(
        math.sqrt(radius**2 + hitch**2 - drawbar**2), abs=0.02
    )


def test_times_are_those_of_a_speed_that_changes_by_its_acceleration():
    way = straight(Place(0.0, 0.0, 0.0, 0.0), 100.0, COMBINE)
    up = DRIVE.straight**2 / (2.0 * DRIVE.accel)
    expected = 2.0 * DRIVE.straight / DRIVE.accel + (100.0 - 2.0 * up) / DRIVE.straight
    assert times_along(way, DRIVE)[-1] == pytest.approx(expected, rel=0.01)


R = DRIVE.radius


@pytest.mark.parametrize(
    "pieces",
    [
        [(1 / R, 12.0), (0.0, 20.0), (-1 / R, 8.0)],
        [(1 / R, 3.0), (-1 / R, 15.0), (1 / R, 3.0)],
        [(1 / R, 8.0), (0.0, 3.0), (1 / R, -8.0), (0.0, -2.0), (1 / R, 10.0)],  # with reverse
    ],
)
def test_an_eased_way_ends_where_it_did_and_its_bends_grow_over_the_ramp(pieces):
    start = Place(3.0, 4.0, 0.3, 0.3)
    hard, soft = driven(start, pieces, COMBINE), eased(start, pieces, COMBINE, 3.0)
    assert soft.places[-1] == pytest.approx(hard.places[-1], abs=1e-5)
    ahead = np.diff(soft.ways) == 0.0
    change = np.abs(np.diff(soft.bends)) / (0.5 * (np.diff(soft.distance)[1:] + np.diff(soft.distance)[:-1]))
    assert change[ahead].max() < 1.05 * 2.0 / R / 3.0
    assert np.abs(soft.bends).max() < 1.02 / R
    away = np.hypot(*(soft.places[:, None, :2] - hard.places[None, :, :2]).T).min(axis=0)
    assert away.max() < 0.45  # less than a step of the search, whose 1.5 m are far more


@pytest.mark.parametrize("tight", [0, 1, 2])
def test_one_bend_without_room_leaves_the_others_eased(tight):
    """Three bends between straights, one of them where no eased way is clear: only there it stands."""
    drive = replace(DRIVE, steering=0.05)
    pieces = [(0.0, 12.0), (0.12, 8.0), (0.0, 12.0), (-0.12, 8.0), (0.0, 12.0), (0.12, 8.0), (0.0, 12.0)]
    start = Place(10.0, 40.0, 0.0, 0.0)
    sharp = driven(start, pieces, COMBINE)
    x, y = sharp.places[np.searchsorted(sharp.distance, 16.0 + 20.0 * tight), :2]

    def is_clear(track, *_):
        return np.hypot(track.places[:, 0] - x, track.places[:, 1] - y).min() > 2.0

    made = eased_where_clear(start, pieces, COMBINE, drive.straight, is_clear)
    assert made.end == pytest.approx(sharp.end, abs=1e-6)
    assert np.abs(np.diff(made.distance)).max() <= 0.5 + 1e-9
    assert len(stops_along(sharp, drive)) == 6
    assert len(stops_along(made, drive)) == 2
    assert times_along(made, drive)[-1] < times_along(sharp, drive)[-1]


def test_who_steers_slowly_drives_bends_no_faster_than_it_steers():
    slow = Drive(6.4, 2.0, 3.0, 1.0, 0.5, 2.0, steering=0.04)
    way = eased(Place(0.0, 0.0, 0.0, 0.0), [(0.0, 20.0), (1 / R, 10.0), (0.0, 20.0)], COMBINE, 3.0)
    limit = limits_along(way, slow)
    over = 0.5 * (np.diff(way.distance)[1:] + np.diff(way.distance)[:-1])
    assert (limit[1:-1] * np.abs(np.diff(way.bends)) <= 0.04 * over * 1.0001 + 1e-9).all()
    assert times_along(way, slow)[-1] > times_along(way, DRIVE)[-1]


STEERS = replace(DRIVE, steering=0.05)


@pytest.mark.parametrize("far", [(50.0, 12.0, math.pi), (65.0, 70.0, 0.0)])  # a turn; too far off for one
def test_a_way_out_of_crop_that_is_cut_at_that_moment_is_driven_without_a_stop(far):
    finder = ground([(0.0, 40.0, 0.0, 30.0)])
    cut(finder, 100.1)  # the last of it under the machine that sets out
    start, goal = Place(36.0, 20.0, 0.0, 0.0), Place(*far, far[2])
    way = finder.find(COMBINE, STEERS, start, goal, time=100.0)
    assert not stops_along(way, STEERS)
    assert way.end[:2] == pytest.approx(goal[:2], abs=0.02)


def test_a_turn_is_rolled_where_there_is_room():
    start, goal = Place(50.0, 30.0, 0.0, 0.0), Place(50.0, 42.0, math.pi, math.pi)
    turn = rolled(start, goal, STEERS, COMBINE)
    assert ground().find(COMBINE, STEERS, start, goal).places == pytest.approx(turn.places)


def test_a_way_asked_for_again_is_known_until_crop_is_cut():
    finder = ground([(48.0, 52.0, 0.0, 80.0)])
    start, goal = Place(20.0, 20.0, 0.0, 0.0), Place(80.0, 20.0, 0.0, 0.0)
    for time in (0.0, 50.0, 200.0):  # nothing changes with time
        assert finder.find(COMBINE, DRIVE, start, goal, time=time) is None
    assert finder.searches == 1
    cut(finder, 500.0)
    assert finder.find(COMBINE, DRIVE, start, goal, time=100.0) is None
    assert finder.find(COMBINE, DRIVE, start, goal, time=600.0) is finder.find(
        COMBINE, DRIVE, start, goal, time=700.0
    )
    assert finder.searches == 3
