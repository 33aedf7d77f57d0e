"""Water on and in straw through a day: dew and rain come, sun and wind take them.

The film on the stand [kg/m2] goes by Penman 1948 (doi:10.1098/rspa.1948.0037) without a resistance of plants:

    LE = (D Rn + rho cp (es - e) / ra) / (D + g),   film' = rain - LE / L,   0 <= film <= film_max

Rn net radiation, D slope of the vapour at saturation, g = 0.66 hPa/K; LE < 0 is dew. The straw itself follows
the humidity of the air with a lag: 8 to 20 % of its dry mass at humidities of 0.12 to
0.89, measured on maize stalks, straight on beyond. What is more than it holds in damp air lies on it, and
darkens a reflectance r to r / (n^2 (1 - r) + r), n = 1.33 (Angstrom 1925). The papers were not read here; no
stand was compared.
"""

from typing import Any

import numpy as np

from swath.core.asked import bare, gathered, replaced, telling
from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.core.units import HOUR, PERCENT
from swath.field.heat import (
    BOLTZMANN,
    HEAT,
    STRAW_ABSORBS,
    STRAW_EMITS,
    resistance,
    saturation,
    sky_radiation,
)
from swath.field.light import light
from swath.field.moisture import DAY, NOON, Moisture
from swath.field.weather import Air, SiteWeather, hour_of
from swath.signals import F64

BY_WEATHER = "weather"  # in place of a number
LATENT = 2.45e6  # heat of evaporation [J/kg]
PSYCHROMETRIC = 0.66  # [hPa/K]
USUAL = Moisture()
STEP = 300.0  # [s]
SQUARE_INDEX = 1.33**2  # of water


def film_share(straw_moisture: float, of: Moisture = USUAL) -> float:
    """Share of the straw that water covers: what is beyond its hold in damp air lies on it as a film."""
    content = straw_moisture / (1.0 - straw_moisture)
    held = (content - balance_content(1.0)) * of.dry_straw_kg_m2 / of.film_max_kg_m2
    return min(max(held, 0.0), 1.0)


def darkened(reflectance: Any, share: float) -> F64:
    """Reflectances of straw, a share of which is under a film."""
    wet = reflectance / (SQUARE_INDEX * (1.0 - reflectance) + reflectance)
    return np.asarray((1.0 - share) * reflectance + share * wet)


def latent_heat(air: Air, elevation: float, height: float) -> float:
    """Heat that evaporates water from a wet stand of a height [m], < 0 = dew [W/m2]; sun at an elevation."""
    t, net = air.temperature, STRAW_ABSORBS * light(elevation, air.cloud).watts
    net += STRAW_EMITS * (sky_radiation(air) - BOLTZMANN * air.temperature**4)
    slope = 0.5 * (saturation(t + 1.0) - saturation(t - 1.0))
    lack = HEAT * (1.0 - air.humidity) * saturation(t) / resistance(air, height)
    return (slope * net + lack) / (slope + PSYCHROMETRIC)


def balance_content(humidity: float) -> float:
    """Water over dry mass of straw that lies in air of a humidity for long."""
    return max(0.08 + 0.12 * (humidity - 0.12) / 0.77, 0.0)


def film_after(
    film: float, rain: float, latent: float, seconds: float, most: float = USUAL.film_max_kg_m2
) -> float:
    """Film [kg/m2] after a time; rain [kg/m2s], latent [W/m2], most: that hangs there [kg/m2]."""
    return min(max(film + (rain - latent / LATENT) * seconds, 0.0), most)


def day_of(weather: SiteWeather, start: float, height: float, of: Moisture) -> tuple[F64, F64, F64]:
    """Hours of a day, film [kg/m2] and content of straw at each; start: hour of t = 0 of the run.

    It is gone through twice: the first day finds what the second begins with.
    """
    hours = np.arange(0.0, DAY, STEP / HOUR)
    film, content, rows = 0.0, -1.0, []
    for hour in [*hours, *hours]:
        t = round((float(hour) - start) * HOUR * NS)
        air, sun = weather.at(t), weather.sun(t)
        content = balance_content(air.humidity) if content < 0.0 else content
        rows.append((film, content))
        latent = latent_heat(air, -0.5 * np.pi if sun is None else sun.elevation, height)
        film = film_after(film, air.rain / HOUR, latent, STEP, of.film_max_kg_m2)
        content += (balance_content(air.humidity) - content) * STEP / (of.straw_lag_h * HOUR)
    films, contents = np.array(rows[len(hours) :]).T
    return hours, films, contents


def by_weather(moisture: Moisture, weather: SiteWeather | None, height: float) -> Moisture:
    """Moisture of a stand by the hour of its weather, of its straw that of the weather where it says so."""
    key, own = "field.stand.straw_moisture_percent", bare(moisture).start_hour
    moment, asks_time = gathered(lambda: None if weather is None else weather.start)
    if moment is not None:
        start = hour_of(moment)
        if own is not None and abs(own - start) * HOUR >= 60.0:
            expected = f"expected {start:.4g}, the hour of field.weather.time, or none"
            raise InputError("field.stand.start_hour", own, expected)
        moisture = telling(replaced(moisture, start_hour=start), {"start_hour": asks_time})
    if not bare(moisture).is_by_weather:
        return moisture
    if weather is None:
        raise InputError(key, BY_WEATHER, "expected field.weather beside it")
    (_, percents), asks = gathered(
        lambda: (moisture.straw_moisture_percent, _percents(moisture, weather, height))
    )
    said = replaced(moisture, straw_moisture_percent=percents)
    return telling(said, {"straw_moisture_percent": asks})


def _percents(moisture: Moisture, weather: SiteWeather, height: float) -> tuple[tuple[float, float], ...]:
    """Pairs of hour and water in the straw, by the weather."""
    start = NOON if moisture.start_hour is None else moisture.start_hour
    hours, film, content = day_of(weather, start, height, moisture)
    water = content * moisture.dry_straw_kg_m2 + film
    percents = (water / (moisture.dry_straw_kg_m2 + water) / PERCENT).tolist()
    return tuple(zip(hours.tolist(), percents, strict=True))
