"""LiDAR: heights of wheat, 400 stems/m2, on a drive along its edge; plants against the closed form."""

import numpy as np
import pytest

from swath.tools.height_map.build import build_height_map
from tests.levels.limits import each_level, make
from tests.sensing.replay_rig import drive, heights_of, small_world, source_of, wasserstein
from tests.tools.first_returns import Stems, UprightStand, closed_form


@pytest.fixture(scope="module")
def world():
    return small_world()


@pytest.fixture(scope="module")
def seen(world):
    """Heights over the ground [m] that `plants` sees in the crop, 0.3 m beside the recorded path."""
    return in_crop(world, world.leader.parts["lidar"])


def in_crop(world, lidar):
    outs, _ = drive(lidar, world, offset=0.3, speed=3.0, length=6.0)
    points, heights = heights_of(world, outs)
    return heights[world.field.first_edge.signed_distance(points[:, 0], points[:, 1]) > 0.3]


@each_level("lidar")
def test_heights_of_a_stand(level, limit, request, tmp_path):
    if level == "plants":
        stems, depression = Stems(400.0), np.radians(30.0)
        found = UprightStand(stems, tile_count=12).look(depression, 0.0, 6000)
        assert found.mean == pytest.approx(closed_form(stems, depression, round_ends=True).mean, abs=limit)
        return
    world, heights = request.getfixturevalue("world"), request.getfixturevalue("seen")
    plants = world.leader.parts["lidar"]
    params = {"sector_deg": (-25, 25), "noise": "none"}
    setup = plants.setup if level != "profile" else small_world().leader.parts["lidar"].setup
    if level == "replay":
        outs, states = drive(plants, world)
        build_height_map(source_of(plants, outs, states)).save(tmp_path / "drive.npz")
        params["file"] = str(tmp_path / "drive.npz")
    assert wasserstein(in_crop(world, make("lidar", level, setup, **params)), heights) < limit
