"""Where along an edge its wall stops rays: bends that end, and bites behind what stands out."""

import numpy as np
import pytest

from swath.control.edge.canopy_classes import CELL, CLASSES, HALF
from swath.control.edge.canopy_rays import RayAnswers
from swath.control.edge.edge_wall import EVEN, JaggedWall, Wall, place_along, wall_of
from swath.signals import Odometry
from tests.control.synthetic_edge import Scanner, Stand, mounting
from tests.control.test_likelihood_ratio import PERIOD, SPEED, detector, drive

RADIUS, BEGIN, ANGLE = 12.0, 12.0, 1.4  # m, m, rad: of a bend away from the crop
SLIPS = 0.977  # speed that is measured over that which is driven


def echoes(beside, ahead):
    cells = np.floor((np.asarray(beside) + HALF) / CELL).astype(np.int64) * CLASSES
    none = np.zeros(0)
    return RayAnswers(cells, np.asarray(ahead, dtype=float), 0.0, 0, none, none, none)


def test_the_wall_is_where_the_outermost_crop_stops_rays():
    scan = echoes([0.1, 0.11, 0.2, 0.25, 0.9, -0.6], [1.0, 2.0, 3.0, 2.0, 9.0, np.nan])
    wall = wall_of([scan], 0.1, 2.0)
    assert wall.along == pytest.approx(2.0)
    assert wall.variance == pytest.approx(2.0 * 0.5 / 4)
    assert np.isnan(wall_of([scan], -0.6, 2.0).along)


def test_a_block_lies_at_its_wall_where_the_edge_turns_away():
    wall = Wall(1.5, 0.01)
    assert [place_along(wall, 0.5, a) for a in (0.0, 0.9, -0.1)] == [0.5, 0.5, 0.5]
    assert place_along(wall, 0.5, -0.3) == pytest.approx(1.0)
    assert place_along(wall, 0.5, -0.9) == pytest.approx(1.5)
    assert place_along(Wall(np.nan, np.nan), 0.5, -0.9) == 0.5


def test_a_wall_to_and_fro_is_jagged():
    even, jagged = JaggedWall(), JaggedWall()
    for k in range(60):
        even.add(Wall(0.8 + 0.1 * (-1) ** k, 0.01), 0.4, 0.0, 0.4)
        jagged.add(Wall(0.8 + 0.4 * (-1) ** k, 0.01), 0.4, 0.0, 0.4)
    assert even.swing == 0.0
    assert jagged.swing == pytest.approx(np.sqrt(0.4**2 - 0.01 - EVEN**2), rel=0.1)
    for _ in range(40):
        jagged.add(Wall(5.0, 0.01), 0.4, 0.5, 0.4)
    assert jagged.swing < 0.05


def test_bites_that_hide_are_in_the_deviation():
    depth = lambda x: 0.28 * np.clip(np.sin(2.0 * np.pi * x / 2.7), 0.0, 1.0)  # noqa: E731
    edges, error = drive(inside=lambda x, y: 6.0 - y - depth(x), metres=26.0)
    even, _ = drive(metres=26.0)
    x = 0.04 * SPEED * np.arange(1, len(edges) + 1) + edges[-1].reference_x
    sd = np.array([e.offset_sd for e in edges])
    assert np.mean(np.abs(error + depth(x))[150:] < 1.96 * sd[150:]) > 0.65
    assert sd[150:].mean() > 2.0 * np.mean([e.offset_sd for e in even[150:]])


def inside_of_bend(x, y):
    """How far inside the crop, right of an edge that is straight, bends to the left and is straight again."""
    turn = np.arctan2(x - BEGIN, 6.0 + RADIUS - y)
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    end = BEGIN + RADIUS * s, 6.0 + RADIUS * (1.0 - c)
    on = c * (y - end[1]) - s * (x - end[0])
    arc = np.hypot(x - BEGIN, y - 6.0 - RADIUS) - RADIUS
    return np.where(turn < 0.0, 6.0 - y, np.where(turn < ANGLE, arc, -on))


def test_an_edge_is_followed_where_its_bend_ends():
    scanner, level = Scanner(Stand(inside_of_bend), mounting("left")), detector()
    rng, pose, errors = np.random.default_rng(3), [0.0, 0.0, 0.0], []
    for k in range(round(48.0 / (SPEED * 0.04))):
        yaw_rate = SPEED / (RADIUS + 6.0) if pose[0] > BEGIN and pose[2] < ANGLE else 0.0
        pose[2] += yaw_rate * 0.04
        pose[0] += SPEED * 0.04 * np.cos(pose[2])
        pose[1] += SPEED * 0.04 * np.sin(pose[2])
        scan = scanner.scan((k + 1) * PERIOD, pose, rng)
        odometry = Odometry(0, SLIPS * SPEED, yaw_rate, float(np.arctan(3.9 * yaw_rate / SPEED)))
        edge = level.step(k * PERIOD, PERIOD, {"scan": scan, "odometry": odometry})["edge"]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x, y = edge.reference_x, edge.offset
        errors.append(float(inside_of_bend(pose[0] + c * x - s * y, pose[1] + s * x + c * y)))
    assert np.abs(errors[150:]).max() < 0.12
