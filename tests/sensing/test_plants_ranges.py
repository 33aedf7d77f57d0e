"""The ranges of rain, dust and wet straw that LiDAR levels declare: the laws at their ends.

Of every level: nothing that no field of wheat has passes without a word.
"""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.field.wetness import SQUARE_INDEX, darkened, film_share
from swath.runtime.met import QUANTITIES
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


@pytest.mark.parametrize("percent", [ENDS["straw_moisture_percent"][0], 12.0, 25.0, 40.0, 80.0])
def test_wet_straw_over_the_whole_range(percent):
    """A share of it under a film, of which Angstrom's law gives 1 / r' - 1 = n^2 (1 / r - 1)."""
    dry, share = np.linspace(0.02, 0.98, 49), film_share(0.01 * percent)
    film = 1.0 / (1.0 + SQUARE_INDEX * (1.0 / dry - 1.0))
    np.testing.assert_allclose(darkened(dry, share), (1.0 - share) * dry + share * film, rtol=1e-12)
    assert share == 0.0 if percent <= 12.0 else 0.0 < share <= 1.0


FAR_OUT = {
    "rain_mm_h": 100.0,
    "stems_per_m2": 2500.0,
    "dust_per_m": 1.0,
    "cone_index_kpa": 200.0,
    "light_lx": 200_000.0,
    "receiver_light_lx": 200_000.0,
    "straw_moisture_percent": 81.0,
}


@pytest.mark.parametrize("name", FAR_OUT)
def test_no_level_takes_the_far_out_for_plain(name):
    """Beyond its declared range, or beyond plain values where it declares none."""
    seen = 0
    for kind in QUANTITIES[name].touches:
        for level in CATALOGUE.registry.names(kind):
            own = [c for c in CATALOGUE.registry.get(kind, level).checked if c.quantity == name]
            low, high = (own[0].low, own[0].high) if own else QUANTITIES[name].plain
            assert not low <= FAR_OUT[name] <= high, (kind, level)
            seen += 1
    assert seen
