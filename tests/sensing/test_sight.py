"""A scan finds the pages that its beams need, and what it sees does not depend on any other page."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.rays import sight as sight_module
from swath.rays.sight import Sight
from swath.runtime.assembly import assemble
from swath.scenario.scenario import parse_scenario
from swath.sensing.lidar import empirical, plants

TEXT = """
format: swath scenario 2
name: sight
seed: 3
run: {distance_m: 4, max_duration_s: 6}
field:
  terrain:
    level: formula
    slope_percent: 9
    roughness_class: E
    waves: [{amplitude_m: 0.7, wavelength_m: 21, azimuth_deg: 30}]
  stand: {level: uniform, lean_deg: 55, row_azimuth_deg: 17, lean_azimuth_deg: 250}
  edge: {shape: straight}
machines:
  combine:
    motion: single_track
    lidar: {sub_rays: 1, step_deg: 10}
"""
LEVELS = {
    "empirical": (empirical.EmpiricalLidar, empirical.Params),
    "plants": (plants.PlantsLidar, plants.Params),
}
KEYS = {
    "a scanner": {"sensor": "sick-lms511-hr", "sector_deg": (-60.0, 60.0), "step_deg": 1.0},
    "of 16 lines": {"sensor": "velodyne-vlp16", "sector_deg": (-20.0, 20.0), "step_deg": 1.0},
}


def scans(level, keys, *, first=0.0):
    """Ranges of sweeps at three places, and the pages then in memory; first: radius brought in before [m]."""
    setup = assemble(parse_scenario(TEXT)).leader.parts["lidar"].setup
    made, params = LEVELS[level]
    lidar = made(params(**keys), setup)
    lidar.reset(Stream(5, "lidar"))
    found, field, count = [], setup.field, len(lidar.azimuth)
    for k, (x, y, pitch, yaw) in enumerate(
        [(3.0, 4.0, 14.0, 90.0), (31.0, -7.0, 4.0, 200.0), (-9.0, 2.0, 30.0, 5.0)]
    ):
        if first:
            field.ensure(x, y, first)
        z = float(field.ground_height(x, y)) + 3.8
        pose = Pose.from_euler((x, y, z), 0.0, np.radians(pitch), np.radians(yaw))
        origins, turns = (np.repeat(a[None], count, 0) for a in (pose.position, pose.rotation))
        found.append(lidar.scan_from(10**9 * (k + 1), origins, turns)["scan"].ranges)
    return np.concatenate(found), len(field.store.keys)


@pytest.mark.parametrize(("level", "keys"), [("empirical", "of 16 lines"), ("plants", "a scanner")])
def test_a_scan_is_the_same_with_all_pages_around_in_memory(level, keys):
    own, pages = scans(level, KEYS[keys])
    all_of_them, more = scans(level, KEYS[keys], first=70.0)
    np.testing.assert_array_equal(own, all_of_them)
    assert np.isfinite(own).mean() > 0.5
    assert pages < 0.5 * more


def test_a_beam_ends_where_it_is_below_the_ground():
    """Straight down one page is enough but for stems that lean in; a level one passes all up to its reach."""
    field = assemble(parse_scenario(TEXT)).field
    eye = np.array([[4.1, 3.9, 30.0]])
    sight = Sight(field, reach=40.0, exit_diameter=0.01, divergence=0.01)
    field.store.restore({})
    sight.ensure(eye, np.array([[0.0, 0.0, -1.0]]))
    assert len(field.store.keys) <= 9
    sight.ensure(eye, np.array([[1.0, 0.0, 0.0]]))
    ways = eye[0] + np.linspace(0.0, 40.0, 400)[:, None] * [1.0, 0.0, 0.0]
    before = len(field.store.keys)
    field.ground_height(ways[:, 0], ways[:, 1])
    assert len(field.store.keys) == before


def test_beams_that_moved_a_little_find_their_pages_in_memory(monkeypatch):
    """Whatever beams near those of the last look need was brought in with them: no second look."""
    field = assemble(parse_scenario(TEXT)).field
    draw, shift, bend = np.random.default_rng(4), sight_module.MOVED, sight_module.TURNED
    for _ in range(6):
        eyes = np.repeat([[*draw.uniform(-20.0, 20.0, 2), 6.0]], 9, 0)
        towards = draw.normal(size=(9, 3)) * [1.0, 1.0, 0.2]
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        moved = eyes + shift * draw.uniform(-0.55, 0.55, (1, 3))
        turned = towards + bend * draw.uniform(-0.55, 0.55, (9, 3))
        field.store.restore({})
        sight = Sight(field, reach=40.0, exit_diameter=0.01, divergence=0.01)
        sight.ensure(eyes, towards)
        found = set(field.store.keys)
        walks = sight.whole[sight_module.WALKS].copy()
        sight.ensure(moved, turned)
        assert sight.whole[sight_module.WALKS] == walks > 0
        monkeypatch.setattr(sight_module, "MOVED", 0.0)
        monkeypatch.setattr(sight_module, "TURNED", 0.0)
        field.store.restore({})
        Sight(field, reach=40.0, exit_diameter=0.01, divergence=0.01).ensure(moved, turned)
        assert set(field.store.keys) <= found
        monkeypatch.undo()


def test_beams_are_walked_along_again_when_pages_were_dropped_or_forgotten():
    field = assemble(parse_scenario(TEXT)).field
    sight = Sight(field, reach=40.0, exit_diameter=0.01, divergence=0.01)
    beam = np.array([[4.1, 3.9, 30.0]]), np.array([[0.6, 0.0, -0.8]])
    field.store.restore({})
    sight.ensure(*beam)
    needed = set(field.store.keys)
    field.store.restore({})
    sight.ensure(*beam)
    assert needed <= set(field.store.keys)
    field.store.limit = 1
    field.ensure(500.0, 500.0, 10.0)
    assert not needed <= set(field.store.keys)
    sight.ensure(*beam)
    assert needed <= set(field.store.keys)


def test_a_sensor_far_from_the_field_is_refused():
    field = assemble(parse_scenario(TEXT)).field
    sight = Sight(field, reach=40.0, exit_diameter=0.01, divergence=0.01)
    for bad in (np.nan, 2e6):
        with pytest.raises(InputError):
            sight.ensure(np.array([[bad, 0.0, 3.0]]), np.array([[0.0, 0.0, -1.0]]))
