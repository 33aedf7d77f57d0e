"""The ranges of rain and dust that the LiDAR level `plants` declares: Beer and Lambert at their ends."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.scenario.slots import CATALOGUE
from swath.sensing.echo import ScannerWeather, disturb

ENDS = {c.quantity: (c.low, c.high) for c in CATALOGUE.registry.get("lidar", "plants").checked}


@pytest.mark.parametrize("share", [0.02, 0.5, 1.0])
@pytest.mark.parametrize(
    ("quantity", "key", "extinction"),
    [
        ("rain_mm_h", "rain_mm_h", lambda r: 0.01 * r**0.6),
        ("dust_per_m", "extinction_per_m", lambda b: b),
    ],
)
def test_echoes_over_the_whole_range(quantity, key, extinction, share):
    """There and back through the air: exp(-2 b d) of the energy is left, from 1 to 40 m."""
    value, distance = share * ENDS[quantity][1], np.linspace(1.0, 40.0, 79)[:, None]
    air = ScannerWeather(**{key: value})
    found, albedo = disturb(air, distance, np.full_like(distance, 0.5), 0.5, Stream(1, "air").at(1))
    np.testing.assert_array_equal(found, distance)
    np.testing.assert_allclose(albedo, 0.5 * np.exp(-2.0 * extinction(value) * distance), rtol=1e-12)
