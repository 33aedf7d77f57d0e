import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.field_setup import FieldSetup
from swath.field.stand.bands import Band, Bands, Params


def bands(**params):
    steps = (Band(100.0, 600.0), Band(180.0, 300.0, 1.1))
    return Bands(Params(**{"stems_per_m2": 300.0, "bands": steps, **params}), FieldSetup())


def test_density_and_height_jump_along_the_direction():
    stand = bands()
    y = np.array([-50.0, 0.0, 99.9, 100.0, 179.9, 180.0, 900.0])
    assert stand.density(7.0, y).tolist() == [300.0, 300.0, 300.0, 600.0, 600.0, 300.0, 300.0]
    assert stand.height_factor(7.0, y).tolist() == [1.0] * 5 + [1.1] * 2
    assert stand.density_max == 600.0
    assert stand.density(np.zeros((3, 1)), np.zeros(4)).shape == (3, 4)


@pytest.mark.parametrize(("azimuth", "x", "y"), [(90.0, 120.0, 0), (180.0, 0, -120.0), (45.0, 90.0, 90.0)])
def test_the_direction_is_an_azimuth_from_north(azimuth, x, y):
    stand = bands(bands_azimuth_deg=azimuth)
    assert stand.density(x, y) == 600.0
    assert stand.density(-x, -y) == 300.0


def test_bands_out_of_order_are_refused():
    with pytest.raises(InputError, match="rising from_m"):
        bands(bands=(Band(100.0, 600.0), Band(50.0, 300.0)))
