"""Where along an edge its wall stops rays: bends that begin and end, bites behind what stands out."""

import numpy as np
import pytest

from swath.control.edge.canopy_classes import CELL, CLASSES, HALF
from swath.signals import Odometry
from tests.control.block_rig import Rig
from tests.control.canopy_scans import answers, lay
from tests.control.synthetic_edge import Scanner, Stand, mounting
from tests.control.test_likelihood_ratio import PERIOD, SPEED, detector, drive

RADIUS, BEGIN, ANGLE = 12.0, 12.0, 1.4  # m, m, rad: of a bend away from the crop
SLIPS = 0.977  # speed that is measured over that which is driven
TURNED = 0.08  # rad by which an edge turns away since, from which on points move
EVEN = 0.21  # of the crop's height: standard deviation of where an even wall lies


def echoes(beside, ahead):
    """A block of them, as many rays per independent ray as two scans at one place have."""
    rig = Rig()
    cells = np.floor((np.asarray(beside) + HALF) / CELL) * CLASSES
    lay(rig.block, answers(cells, ahead=ahead), 0.0)
    rig.block.row["scans"] = 2.0
    return rig


def test_the_wall_is_where_the_outermost_crop_stops_rays():
    scan = echoes([0.1, 0.11, 0.2, 0.25, 0.9, -0.6], [1.0, 2.0, 3.0, 2.0, 9.0, np.nan])
    along, variance = scan("wall", 0.1)[:2]
    assert along == pytest.approx(2.0)
    assert variance == pytest.approx(2.0 * 0.5 / 4)
    assert np.isnan(scan("wall", -0.6)[0])


def test_a_block_lies_at_its_wall_where_the_edge_turns_away():
    along = lambda wall, angle: Rig()("place_along", wall, 0.5, angle)[0]  # noqa: E731
    assert [along(1.5, a) for a in (0.0, 0.9, -0.1)] == [0.5, 0.5, 0.5]
    assert along(1.5, -0.3) == pytest.approx(1.0)
    assert along(1.5, -0.9) == pytest.approx(1.5)
    assert along(np.nan, -0.9) == 0.5


def begin_of_bend(radius, ahead, begin=4.0):
    """(a track, its angle [rad]) of an edge that bends away, of which the track knows late.

    Blocks are put `ahead` [m] before their walls.
    """
    rig, angle = Rig(), 0.0
    for way in 0.4 * np.arange(23):
        turn = max(way + ahead - begin, 0.0) / radius
        x, u = min(way + ahead, begin) + radius * np.sin(turn), radius * (np.cos(turn) - 1.0)
        rig("point", x - ahead * np.cos(angle), u - ahead * np.sin(angle), 1e-4, way)
        rig("add_wall", way, angle, ahead)
        angle = -max(way - 1.0 - begin, 0.0) / radius
        if way == 0.0:
            rig.begin(*rig.points[0, :2], 0.0)
        rig("advance", 0.4)
        rig("accept", rig.points[-1, 1] - rig.arc["u"], 1e-4, True)
    return rig, angle


def beside_bend(rows, radius, begin=4.0):
    """How far points (n, >= 2) lie beside such an edge [m]."""
    x, u = rows[:, 0] - begin, rows[:, 1]
    return np.where(x > 0.0, radius - np.hypot(x, u + radius), -u)


def test_what_was_seen_of_a_bend_lies_at_its_wall_once_the_edge_has_turned():
    rig, angle = begin_of_bend(15.0, 1.0)
    begun = slice(8, 13)  # blocks
    before = np.abs(beside_bend(rig.points[begun], 15.0)).max()
    first = rig("move_walls", angle)[0]
    assert before > 0.03
    assert np.abs(beside_bend(rig.points[begun], 15.0)).max() < 0.005
    assert np.isnan(rig("move_walls", angle)[0])
    rig("retrace", first, 0.0)
    assert rig.arc["distance"] == pytest.approx(rig.points[-1, 3], abs=0.5)


def test_along_an_edge_that_goes_straight_on_no_point_is_moved():
    rig, angle = begin_of_bend(1e9, 1.0)
    assert all(np.isnan(rig("move_walls", angle + more)[0]) for more in (0.0, -0.9 * TURNED, 0.5))


def test_a_wall_to_and_fro_is_jagged():
    even, jagged = Rig(), Rig()
    for k in range(60):
        even("add_jagged", 0.8 + 0.1 * (-1) ** k, 0.01, 0.4, 0.0, 0.4)
        jagged("add_jagged", 0.8 + 0.4 * (-1) ** k, 0.01, 0.4, 0.0, 0.4)
    assert even("swing", 0.85)[0] == 0.0
    assert jagged("swing", 0.85)[0] == pytest.approx(np.sqrt(0.4**2 - 0.01 - (0.85 * EVEN) ** 2), rel=0.1)
    for _ in range(40):
        jagged("add_jagged", 5.0, 0.01, 0.4, 0.5, 0.4)
    assert jagged("swing", 0.85)[0] < 0.05


def test_bites_that_hide_are_in_the_deviation():
    depth = lambda x: 0.28 * np.clip(np.sin(2.0 * np.pi * x / 2.7), 0.0, 1.0)  # noqa: E731
    edges, error = drive(inside=lambda x, y: 6.0 - y - depth(x), metres=26.0)
    even, _ = drive(metres=26.0)
    x = 0.04 * SPEED * np.arange(1, len(edges) + 1) + edges[-1].reference_x
    sd = np.array([e.offset_sd for e in edges])
    assert np.mean(np.abs(error + depth(x))[150:] < 1.96 * sd[150:]) > 0.65
    assert sd[150:].mean() > 2.0 * np.mean([e.offset_sd for e in even[150:]])


def inside_of_bend(x, y, radius=RADIUS):
    """How far inside the crop, right of an edge that is straight, bends to the left and is straight again."""
    turn = np.arctan2(x - BEGIN, 6.0 + radius - y)
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    end = BEGIN + radius * s, 6.0 + radius * (1.0 - c)
    on = c * (y - end[1]) - s * (x - end[0])
    arc = np.hypot(x - BEGIN, y - 6.0 - radius) - radius
    return np.where(turn < 0.0, 6.0 - y, np.where(turn < ANGLE, arc, -on))


def errors_in_bend(radius, metres, slips=1.0, bite=0.0):
    """Of the told edge [m], step by step, along the bend; a bite lies over the 2 m before it."""
    seen = lambda x, y: inside_of_bend(x, y, radius) - np.where((x > BEGIN - 2.0) & (x < BEGIN), bite, 0.0)  # noqa: E731
    scanner, level = Scanner(Stand(seen), mounting("left")), detector()
    rng, pose, errors = np.random.default_rng(3), [0.0, 0.0, 0.0], []
    for k in range(round(metres / (SPEED * 0.04))):
        yaw_rate = SPEED / (radius + 6.0) if pose[0] > BEGIN and pose[2] < ANGLE else 0.0
        pose[2] += yaw_rate * 0.04
        pose[0] += SPEED * 0.04 * np.cos(pose[2])
        pose[1] += SPEED * 0.04 * np.sin(pose[2])
        scan = scanner.scan((k + 1) * PERIOD, pose, rng)
        odometry = Odometry(0, slips * SPEED, yaw_rate, float(np.arctan(3.9 * yaw_rate / SPEED)))
        edge = level.step(k * PERIOD, PERIOD, {"scan": scan, "odometry": odometry})["edge"]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x, y = edge.reference_x, edge.offset
        errors.append(float(inside_of_bend(pose[0] + c * x - s * y, pose[1] + s * x + c * y, radius)))
    return np.array(errors)


def test_an_edge_is_followed_where_its_bend_ends():
    assert np.abs(errors_in_bend(RADIUS, 48.0, slips=SLIPS)[150:]).max() < 0.12


def test_a_bend_is_followed_that_seems_bites_at_first():
    """A bite just before it and rays that meet its wall far ahead tell of a saw, until the edge goes on."""
    errors = errors_in_bend(13.0, 30.0, bite=0.15)[100:]
    assert np.abs(errors).max() < 0.5
    assert np.abs(errors[-100:]).max() < 0.15


def breaks_after(places):
    """From which way on [m] an edge whose blocks lie so far beside a line along bites [m] bends away."""
    rig = Rig()
    told = [rig("bends_away", beside, 0.4 * k)[:2] for k, beside in enumerate(places)]
    return [since if bends else None for bends, since in told]


def test_bites_come_back_to_their_line_and_bends_do_not():
    assert breaks_after([0.0, -0.25, -0.31, -0.38])[-1] == pytest.approx(0.4)
    for bites in ([0.0, -0.5, -0.45, -0.4, -0.35], [-0.3, -0.3, -0.3, -0.3], [-0.25, 0.1, -0.35, 0.0, -0.5]):
        assert breaks_after(bites) == [None] * len(bites)


def test_a_track_goes_along_the_points_that_a_line_left_out():
    """On a circle of 13 m from 6 m on, of which the line along bites saw nothing."""
    track, rows = Rig().begin(0.0, 0.0, 0.0), []
    for k in range(1, 26):
        way = 0.4 * k
        turn = max(way - 6.0, 0.0) / 13.0
        x = min(way, 6.0) + 13.0 * np.sin(turn)
        rows.append((x, -13.0 * (1.0 - np.cos(turn)), 1e-4, way))
        track("advance", 0.4)
        track("accept", 0.0, 1e-4, True)
    assert abs(track.arc["u"] - rows[-1][1]) > 0.5
    track.set_points(rows)("retrace", 6.2, 0.0)
    assert track.arc["distance"] == pytest.approx(10.0)
    assert np.hypot(track.arc["x"] - rows[-1][0], track.arc["u"] - rows[-1][1]) < 0.05
    assert track.arc["angle"] == pytest.approx(-4.0 / 13.0, abs=0.1)
