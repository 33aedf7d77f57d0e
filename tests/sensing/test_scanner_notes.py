"""What a scanner tells its user when it looks at nothing."""

import dataclasses

import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.sensing.lidar import empirical, plants
from tests.sensing.test_empirical import scan, site

DOWN = Pose.from_euler((25.0, 50.0, 3.0), 0.0, 0.35, 0.3)
UP = Pose.from_euler((25.0, 50.0, 3.0), 0.0, -1.2, 0.3)
LEVELS = [
    (plants.PlantsLidar, plants.Params(step_deg=1.0, sector_deg=(-60.0, 60.0), sub_rays=1)),
    (empirical.EmpiricalLidar, empirical.Params(step_deg=1.0, sector_deg=(-60.0, 60.0))),
]


def lidar_of(make, params):
    lidar = make(params, dataclasses.replace(site(), period=0.04))
    lidar.reset(Stream(7, "combine.lidar"))
    return lidar


@pytest.mark.parametrize(("make", "params"), LEVELS)
def test_a_scanner_that_saw_only_sky_says_so_until_it_sees_something(make, params):
    lidar = lidar_of(make, params)
    assert lidar.notes == []  # nothing scanned yet
    scan(lidar, UP, 10**9)
    [note] = lidar.notes
    assert "no beam met anything" in note
    assert "pitch_deg" in note
    scan(lidar, DOWN, 2 * 10**9)
    assert lidar.notes == []
    scan(lidar, UP, 3 * 10**9)
    assert lidar.notes == []
