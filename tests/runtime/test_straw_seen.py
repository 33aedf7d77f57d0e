"""The straw swath lies where the machine dropped it, and rays see it there."""

import numpy as np
import pytest

from swath.field.memory_layout import Organ
from swath.rays.engine import RayCaster
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario

SCENARIO = """
format: swath scenario 2
name: swath-seen
run: {distance_m: 32, max_duration_s: 60}
field:
  terrain: plane
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight, length_m: 80}
machines:
  combine:
    motion: {level: single_track, rate_hz: 50, start_speed_kmh: 8, substep_ms: 10}
    process: threshing
    lidar: off
    edge: {level: truth, rate_hz: 5}
    speed: {speed_kmh: 8}
"""


@pytest.fixture(scope="module")
def world():
    world = assemble(parse_scenario(SCENARIO))
    drive(world, [])
    return world


def straw_share(world, x, y):
    """Share of rays straight down that hit straw on the ground, and the mean height they hit [m]."""
    origins = np.stack([x, y, np.full_like(x, 4.0)], axis=1)
    down = np.tile([0.0, 0.0, -1.0], (len(x), 1))
    hits = RayCaster(world.field, threads=1).cast(origins, down, range_max=6.0)
    return np.mean(hits.organ == int(Organ.STRAW)), 4.0 - np.nanmean(hits.distance)


def test_straw_lies_behind_the_middle_of_the_machine(world):
    middle = (
        world.leader.sheet.header_end("left")[1] - world.leader.overlap
    )  # its left end drives north, x = 0
    load = world.graph.latest("combine.process", "load")
    assert world.field.straw_kg == pytest.approx(load.dropped_straw, rel=0.03)
    rng = np.random.default_rng(1)
    y = rng.uniform(12.0, 18.0, 400)
    on = straw_share(world, middle + rng.uniform(-0.3, 0.3, 400), y)
    beside = straw_share(world, middle + 2.5 + rng.uniform(-0.3, 0.3, 400), y)
    assert on[0] > 0.8
    assert beside[0] == 0.0
    assert on[1] > beside[1] + 0.1
