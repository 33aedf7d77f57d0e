"""Water on and in straw: the film's balance, Angstrom's law, a day from dew to noon."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.core.units import HOUR
from swath.field import wetness
from swath.field.heat import STRAW_ABSORBS, STRAW_EMITS, resistance, saturation
from swath.field.moisture import Moisture
from swath.field.weather import KELVIN, Air, Sun
from tests.field.made_field import made_field

DAY = {
    "temperature": ((0, 13), (5, 10), (15, 26), (24, 14)),
    "humidity": ((0, 95), (6, 98), (15, 45), (24, 93)),
}


class Summer:
    """A clear day at 52 deg north, the sun by its declination; a SiteWeather as far as it is asked."""

    start = None

    def __init__(self, rain=0.0):
        self.rain = rain

    def hour(self, t):
        return (12.0 + t / NS / HOUR) % 24.0

    def at(self, t):
        warm, humid = (
            float(np.interp(self.hour(t), *np.array(DAY[k]).T)) for k in ("temperature", "humidity")
        )
        return Air(rain=self.rain, wind=(1.5, 0.0), temperature=KELVIN + warm, humidity=humid / 100.0)

    def sun(self, t):
        turn, lat, up = 2.0 * np.pi * (self.hour(t) - 13.5) / 24.0, np.radians(52.3), np.radians(19.6)
        sine = np.sin(lat) * np.sin(up) + np.cos(lat) * np.cos(up) * np.cos(turn)
        return Sun(0.0, float(np.arcsin(sine)))


def test_dew_of_0_15_mm_dries_in_half_an_hour_at_200_watts():
    film, seconds = 0.15, 0.0
    while film > 0.0:
        film, seconds = wetness.film_after(film, 0.0, 200.0, 1.0), seconds + 1.0
    assert seconds / 60.0 == pytest.approx(30.6, abs=0.05)


def test_a_film_darkens_by_angstroms_law():
    """0.5 to 0.36 and 0.3 to 0.19 where it lies, nothing where it does not."""
    dry = np.array([0.5, 0.3])
    np.testing.assert_allclose(wetness.darkened(dry, 1.0), [0.36, 0.19], atol=0.006)
    np.testing.assert_array_equal(wetness.darkened(dry, 0.0), dry)


@pytest.mark.parametrize("seed", range(3))
def test_penman_closes_the_balance_of_a_wet_surface(seed):
    """At Ts sensible and latent heat add up to the net radiation, to first order in Ts - Ta."""
    draw = np.random.default_rng(seed)
    for _ in range(20):
        t = KELVIN + float(draw.uniform(5, 30))
        air = Air(
            wind=(float(draw.uniform(0, 5)), 0.0), temperature=t, humidity=float(draw.uniform(0.3, 1.0))
        )
        elevation, height = float(draw.uniform(-0.3, 1.0)), float(draw.uniform(0.3, 1.5))
        latent, ra = wetness.latent_heat(air, elevation, height), resistance(air, height)
        slope = 0.5 * (saturation(t + 1.0) - saturation(t - 1.0))
        per_hpa = wetness.HEAT / (wetness.PSYCHROMETRIC * ra)
        lack = (1.0 - air.humidity) * saturation(t)
        over = (latent / per_hpa - lack) / slope  # Ts - Ta at which so much evaporates
        sensible = wetness.HEAT * over / ra
        net = latent + sensible
        expected = STRAW_ABSORBS * wetness.light(elevation, 0.0).watts
        expected += STRAW_EMITS * (wetness.sky_radiation(air) - wetness.BOLTZMANN * t**4)
        assert net == pytest.approx(expected, abs=1e-6)


def test_a_day_goes_from_dew_to_dry_straw():
    """Wet before sunrise, dry from late morning to evening."""
    found = wetness.by_weather(Moisture(straw_moisture_percent="weather"), Summer(), 0.8)
    at = {hour: found.at(round((hour - 12.0) * HOUR * NS))["straw_moisture"] for hour in (5, 8, 10, 13, 17)}
    assert at[5] > 0.2 > 0.16 > at[13]
    assert at[8] > at[10] > at[13]
    assert 0.08 < at[17] < 0.14
    assert wetness.film_share(at[5]) > 0.3
    assert wetness.film_share(at[13]) == 0.0


def test_rain_wets_at_noon():
    rainy = wetness.by_weather(Moisture(straw_moisture_percent="weather"), Summer(rain=3.0), 0.8)
    assert rainy.at(0)["straw_moisture"] > 0.3


def test_without_weather_it_is_an_error_and_numbers_stay():
    with pytest.raises(InputError, match="weather"):
        wetness.by_weather(Moisture(straw_moisture_percent="weather"), None, 0.8)
    given = Moisture(straw_moisture_percent=17.0)
    assert wetness.by_weather(given, None, 0.8) is given
    assert made_field().film(0) == 0.0
