"""A ramp is one where chance does not give the slope."""

import numpy as np
import pytest

from swath.control.edge.canopy_classes import CELL, HALF, LAYER, LOWEST
from tests.control.block_rig import Rig

HEIGHT, OVERHANG = 0.85, 0.04  # m


def told(rng, tilt, rays, stop=(0.15, HEIGHT)):
    """(share, feet [m], slope) of a stand whose stems lean inward by a tangent, from independent rays.

    stop: heights between which rays are stopped [m]
    """
    place, height = rng.uniform(-1.3, 1.3, rays), rng.uniform(*stop, rays)
    height = np.where(place > tilt * height, height, 0.02)
    rig, layer = Rig(), ((height - LOWEST) / LAYER).astype(int)
    np.add.at(rig.block.counts, (((place + HALF) / CELL).astype(int), layer), 1.0)
    rig("add_ramp", 0.0)
    return rig("ramp", HEIGHT, OVERHANG, 1.0, 0.0)[:3]


@pytest.mark.parametrize("rays", [900, 1600])
def test_an_upright_stand_seldom_seems_one_however_few_its_rays(rays):
    found = np.array([told(np.random.default_rng([1, k]), 0.0, rays) for k in range(150)])
    assert np.mean(found[:, 0] > 0.0) < 0.08
    assert found[:, 2].mean() == pytest.approx(0.0, abs=0.04)


def test_a_stand_that_leans_in_is_one_once_its_rays_are_many():
    few, many = (
        np.array([told(np.random.default_rng([2, k]), 0.35, rays) for k in range(40)]) for rays in (600, 6000)
    )
    assert few[:, 0].mean() < 0.8
    assert many[:, 0].min() > 0.8
    assert many[:, 2].mean() == pytest.approx(0.22, abs=0.03)  # its begin is not that of its last stems


def test_layers_that_stop_no_ray_say_nothing():
    assert not told(np.random.default_rng(3), 0.35, 6000, stop=(0.4, 0.56)).any()
