"""Paths of a job join and know where they are; a planned one is driven."""

import math

import numpy as np
import pytest

from swath.job.drive import MARGIN, DrivenMachine, Follower
from swath.job.path import Piece, Pose, joined, path_of, polyline
from swath.job.turns import clothoid, limits_of
from swath.machine.machine_sheet import dynamics_of, load_machine

STEP = 0.05  # s


def test_a_clothoid_is_that_of_fresnel():
    a = 8.0  # ends of the Euler spiral x + i y = int exp(i u^2 / (2 a^2)) at u = a
    path = path_of([Piece(0.0, 1 / a, a)], Pose(0, 0, 0))
    series = sum((-1) ** n / (math.factorial(2 * n) * (4 * n + 1) * 2 ** (2 * n)) for n in range(9))
    assert path.end.x == pytest.approx(a * series, abs=1e-9)
    assert path.end.heading == pytest.approx(0.5)


def test_paths_join_and_know_where_they_are():
    one = polyline(np.array([[0.0, 0.0], [10.0, 0.0]]))
    both = joined([one, path_of([Piece(0.1, 0.1, 5.0)], one.end)])
    assert both.length == pytest.approx(15.0)
    assert both.at(4.0) == pytest.approx((4.0, 0.0, 0.0))
    assert both.at(15.0).heading == pytest.approx(0.5)


def test_a_planned_path_is_driven_within_a_quarter_metre():
    sheet, start = load_machine("lexion-700"), Pose(-30.0, 0.0, 0.0)
    limits = limits_of(sheet.wheelbase, 6.4, dynamics_of(sheet).steer_rate, 2.0)
    pieces = [Piece(0, 0, 30.0), *clothoid.plan(Pose(0, 0, 0), Pose(0, 11.9, math.pi), limits)]
    path = path_of([*pieces, Piece(0, 0, 20.0)], start)
    machine, follower, track = DrivenMachine(sheet, start, STEP), Follower(path, MARGIN / 6.4), [start]
    machine.speed = 2.0
    while not follower.is_done and len(track) * STEP < 4.0 * path.length / 2.0:
        machine.step(follower.curvature(machine), 2.0)
        track.append(machine.pose)
    off = [np.hypot(*(path.points - p[:2]).T).min() for p in track[::5]]
    assert max(off) < 0.25
    assert (len(track) - 1) * STEP == pytest.approx(path.length / 2.0, rel=0.02)
