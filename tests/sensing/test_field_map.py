"""Field maps: what they hold, where they are looked up, and how much of it is right."""

from math import pi

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.maps.projection import Origin
from swath.field.maps.raster import Raster
from swath.field.site_setup import SiteSetup
from swath.field.stand import maps
from swath.sensing.field_map.error import ErrorMap
from swath.sensing.field_map.error import Params as ErrorParams
from swath.sensing.field_map.file import FileMap
from swath.sensing.field_map.file import Params as FileParams
from swath.sensing.field_map.places import true_grain
from swath.signals import Fix
from tests.field.made_field import made_field, rectangle
from tests.field.test_solids import MACHINE

ORIGIN = Origin(32632, 500_000.0, 5_800_000.0)
DT = NS // 5


@pytest.fixture(scope="module")
def setup():
    """Density that goes from 200 to 500 stems/m2 in waves."""
    variation = maps.Variation(sd_percent=25.0, length_m=12.0)
    field = made_field(
        stand=maps.Params(stems_per_m2=400, density_variation=variation), boundary=rectangle(-90, -90, 90, 90)
    )
    return SiteSetup(field, MACHINE, Pose.identity(), "left", 0.2, origin=ORIGIN)


def fix(x, y, course=0.0, t=0, speed=2.0):
    nan = float("nan")
    return Fix(t, x, y, 4.0, speed, course, 0.02, 0.03, 0.1, 4, nan, nan, nan)


def made(kind, params, setup, seed=1):
    part = kind(params, setup)
    part.reset(Stream(seed, "combine.field_map"))
    return part


def test_without_errors_it_is_the_truth(setup):
    part = made(ErrorMap, ErrorParams(correlation=1.0, kernel_m=0.0, cell_m=0.0), setup)
    seen = part.step(0, DT, {"fix": fix(1.0, 0.0, t=DT), "odometry": None})["map"]
    assert seen.ahead[0] == pytest.approx(MACHINE.knife_x + 2.0)
    across = MACHINE.header_y + MACHINE.header_width * np.array([-0.4, 0.0, 0.4])
    here = np.repeat(seen.ahead[3], 3)  # the antenna is 1 m ahead of the axle, which so is at zero
    assert seen.grain[3] == pytest.approx(true_grain(setup.field, here, across).mean())
    assert seen.boundary != seen.boundary  # farther than the map is asked for
    near = part.step(DT, DT, {"fix": fix(71.0, 0.0, t=2 * DT), "odometry": None})["map"]
    assert near.boundary == pytest.approx(20.0, abs=1.01)
    assert np.isnan(near.grain[-1])


def test_it_is_looked_up_at_the_measured_place_and_course(setup):
    part = made(ErrorMap, ErrorParams(correlation=1.0, kernel_m=0.0, cell_m=0.0), setup)
    seen = part.step(0, DT, {"fix": fix(0.0, 1.0, course=pi / 2, t=DT), "odometry": None})["map"]
    ahead, across = seen.ahead[5], MACHINE.header_y + MACHINE.header_width * np.array([-0.4, 0.0, 0.4])
    assert seen.grain[5] == pytest.approx(true_grain(setup.field, -across, np.repeat(ahead, 3)).mean())
    nothing = made(ErrorMap, ErrorParams(), setup).step(0, DT, {"fix": fix(np.nan, 0.0), "odometry": None})[
        "map"
    ]
    assert np.isnan(nothing.grain).all()


@pytest.mark.parametrize("r", [0.25, 0.68, 0.9])
def test_correlation_with_the_truth(setup, r):
    """Over many maps: one has few independent places."""
    line = np.arange(-80.0, 80.0, 8.0)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    truth = true_grain(setup.field, x, y)
    level = ErrorParams(correlation=r, kernel_m=0.0, cell_m=0.0)
    found = [made(ErrorMap, level, setup, seed).look_up(0, x, y, 0.0).grain for seed in range(12)]
    every = np.corrcoef(np.tile(truth, len(found)), np.concatenate(found))[0, 1]
    assert every == pytest.approx(r, abs=0.03)
    assert np.std(np.concatenate(found)) == pytest.approx(truth.std(), rel=0.1)


def test_the_kernel_of_a_yield_monitor_smears_along_the_way(setup):
    x = np.linspace(-60.0, 60.0, 200)
    sharp, smeared = (
        made(ErrorMap, ErrorParams(correlation=1.0, kernel_m=k, cell_m=0.0), setup).look_up(0, x, 0 * x, 0.0)
        for k in (0.0, 24.0)
    )
    assert smeared.grain.std() < 0.8 * sharp.grain.std()


def test_a_file_comes_back_bit_for_bit(setup, tmp_path):
    values = np.arange(30, dtype=np.float32).reshape(5, 6) / 7
    raster = Raster(values, 4.0, -4.0, 2.0, 32632)
    raster.to_geotiff(tmp_path / "map.tif", 32632, (ORIGIN.easting, ORIGIN.northing))
    part = made(FileMap, FileParams(file=str(tmp_path / "map.tif")), setup)
    x, y = (a.ravel() for a in np.meshgrid(*raster.centres()))
    assert (part.look_up(0, x, y, 0.0).grain == values.ravel().astype(float)).all()
    assert np.isnan(part.look_up(0, np.array([99.0]), np.array([0.0]), 0.0).grain).all()
