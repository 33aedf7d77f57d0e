"""A scanner whose spot and range noise are not those of its data sheet."""

import numpy as np
import pytest

from swath.sensing.lidar_sheet import load_lidar
from tests.levels.limits import make
from tests.sensing.replay_rig import drive, small_world


@pytest.mark.parametrize("name", ["sick-lms111", "hokuyo-utm-30lx", "velodyne-vlp16"])
def test_spot_and_noise_are_so_many_times_those_of_the_sheet(name):
    sheet, distance = load_lidar(name), np.linspace(0.5, 30.0, 20)
    signal = np.geomspace(1.0, 1e3, 20)
    other = sheet.instance(spot=1.7, noise=2.5)
    np.testing.assert_allclose(other.beam.diameter(7.0), 1.7 * sheet.beam.diameter(7.0))
    for of in (None, signal):
        np.testing.assert_allclose(other.noise_sigma(distance, of), 2.5 * sheet.noise_sigma(distance, of))


@pytest.mark.parametrize("level", ["plants", "empirical"])
def test_ranges_scatter_by_the_factor(level):
    """The same scans with more noise: what it adds has the sheet's standard deviation times the factor."""
    setup = small_world().leader.parts["lidar"].setup
    seen = {}
    for factor in (0.0, 1.0, 5.0):
        lidar = make("lidar", level, setup, sector_deg=(-25, 25), noise_factor=factor)
        outs, _ = drive(lidar, small_world(), offset=0.3, speed=3.0, length=3.0)
        seen[factor] = np.concatenate([out["scan"].ranges[:, 0] for out in outs])
    sheet = load_lidar("sick-lms511-hr")
    sigma = sheet.noise_sigma(seen[0.0].astype(float))
    for factor in (1.0, 5.0):
        off = (seen[factor] - seen[0.0]) / sigma
        known = np.isfinite(off)
        assert known.mean() > 0.9
        assert float(np.std(off[known])) == pytest.approx(factor, rel=0.1)
