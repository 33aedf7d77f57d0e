"""The spot of echo `nearest` ends with the outermost sub-ray; a run says so where that is too narrow."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.rays import engine
from swath.sensing.beam import spot_pattern
from swath.sensing.echo import Bundle, Receiver, receive
from swath.sensing.lidar import plants
from tests.sensing.test_empirical import scan, site
from tests.sensing.test_scanner_notes import DOWN


def lidar_of(**keys):
    lidar = plants.PlantsLidar(plants.Params(step_deg=1.0, sector_deg=(-5.0, 5.0), **keys), site())
    lidar.reset(Stream(7, "combine.lidar"))
    return lidar


@pytest.mark.parametrize(
    ("count", "outermost"), [(7, 0.66), (19, 0.66), (37, 0.80), (61, 0.92)]
)  # sqrt(-ln(1 - e (1 - exp(-2))) / 2) of the outermost ring at the share e of the energy
def test_nearest_sees_an_edge_as_far_out_as_the_outermost_sub_ray(count, outermost):
    """A wall 1 m nearer covers the spot beyond x: nearest reports it as long as some sub-ray meets it."""
    pattern = spot_pattern(count, "gaussian")
    x = np.linspace(0.0, 1.0, 401)
    distance = np.where(pattern.position[None, :, 0] > x[:, None], 9.0, 10.0)
    bundle = Bundle(distance, pattern.weight, np.ones_like(distance))
    found = receive(bundle, Receiver(rule="nearest")).distance[:, 0]
    assert x[found == 9.0].max() == pytest.approx(pattern.position[:, 0].max(), abs=3e-3)
    assert pattern.outermost == pytest.approx(outermost, abs=5e-3)


def test_a_spot_too_narrow_for_nearest_is_noted():
    [note] = lidar_of(echo="nearest").notes
    assert "19 sub-rays" in note
    assert "0.66 times" in note
    for keys in ({}, {"echo": "nearest", "sub_rays": 61}, {"echo": "nearest", "spot": "random"}):
        assert lidar_of(**keys).notes == []


def test_a_native_build_that_the_compiler_refuses_is_noted(monkeypatch):
    lidar = lidar_of(sub_rays=7)
    scan(lidar, DOWN)
    assert lidar.notes == []
    monkeypatch.setattr(engine, "can_compile", lambda: False)
    monkeypatch.setattr(engine, "_warn", lambda text: None)  # said once per process, elsewhere
    for k in (2, 3):
        scan(lidar, DOWN, k * 10**9)
    assert lidar.notes == [engine.NOT_COMPILED]
