"""A run in wind: the same again with other threads and after being saved; scans that change with time."""

import pickle

import numpy as np
import pytest

from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from tests.whole.small import small

WIND = ("field.stand.wind={speed_m_s: 6, azimuth_deg: 270}", "run.max_duration_s=2.5")


def digest_of(*sets):
    digest = Digest()
    drive(assemble(small(*sets)), [digest])
    return digest.hex


@pytest.fixture(scope="module")
def reference():
    return digest_of(*WIND)


def test_threads_change_nothing(reference, monkeypatch):
    monkeypatch.setenv("SWATH_THREADS", "2")
    assert digest_of(*WIND) == reference


def test_saved_in_the_middle_and_resumed(reference):
    digest = Digest()
    world = assemble(small(*WIND))
    drive(world, [digest], until_s=1.13)
    state = pickle.dumps({"world": world.save(), "digest": digest.save()})
    saved, fresh, second = pickle.loads(state), assemble(small(*WIND)), Digest()
    fresh.load(saved["world"])
    second.load(saved["digest"])
    drive(fresh, [second], resume=True)
    assert second.hex == reference


def test_no_sway_is_the_run_without_wind(reference):
    still = digest_of("run.max_duration_s=1")
    assert digest_of("run.max_duration_s=1", "field.stand.wind={sway_deg: 0}") == still
    assert digest_of(WIND[0], "run.max_duration_s=1") != still


@pytest.mark.parametrize(("wind", "moves"), [("null", False), ("{speed_m_s: 6}", True)])
def test_a_scanner_that_stands_still_sees_the_crop_move(wind, moves):
    quiet = ("combine.lidar.noise=none", "combine.lidar.angle_noise_deg=0")
    world = assemble(small(f"field.stand.wind={wind}", "run.max_duration_s=0.1", *quiet))
    drive(world)
    lidar = next(n.component for n in world.graph.nodes if n.slot.name == "combine.lidar")
    beams = len(lidar.azimuth)
    down = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # the sensor's x axis looks down
    place = np.tile([3.0, 14.0, 3.5], (beams, 1)), np.tile(down, (beams, 1, 1))
    first, second = (lidar.scan_from(t, *place)["truth"] for t in (1_000_000_000, 1_400_000_000))
    assert np.isfinite(first.points).any()
    assert np.array_equal(first.points, second.points, equal_nan=True) != moves
