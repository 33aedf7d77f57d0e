"""Wind in a stand: lean that travels over it as a wave.

On top of its own lean a tile leans along the wind by a slope (aside per height)

    slope(x, y, t) = steady + amplitude ((1 - g) sin 2 pi (s / wavelength - t / period)
                                         + g sin 2 pi (s' / (4 wavelength) - t / (4 period)))

with s the place of the tile's middle along the wind, s' the same along a direction turned by 30 deg, so that
crests are not straight and no two gusts alike, and g = 0.3. A pure function of place and time: nothing is
drawn, nothing is kept, and it comes again after 4 periods. It is a shear: heights stay what they are.
"""

from dataclasses import dataclass
from math import cos, sin, tan
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.schedule import NS
from swath.core.units import DEG
from swath.field.field_setup import from_azimuth
from swath.field.weather import SiteWeather, Weather

GUST_SHARE = 0.3  # of the amplitude that the second wave has [E]
GUST_LENGTH = 4  # of the second wave, in wavelengths and in periods of the first [E]
GUST_TURN = 30.0 * DEG  # of the second wave's direction against the wind [E]
SWAY_PER_SPEED2 = 0.2  # deg per (m/s)^2: drag and so small leans grow with the square of speed [E]
USUAL = Weather(wind_m_s=5.0)  # where a scenario says nothing of the wind
SWAY_MAX = 15.0  # the most that a speed alone gives [deg] [E]


@dataclass(frozen=True, kw_only=True)
class Wind:
    """Wind that sways the crop.

    speed_m_s: wind speed 2 m above the ground; none = that of field.weather at the start, else 5
    azimuth_deg: direction in which the wind blows, clockwise from north; none = that of field.weather, else
        90
    sway_deg: amplitude of the stems' lean; none = 0.2 speed^2, at most 15
    steady_deg: lean about which the stems sway; none = as much as sway_deg
    wavelength_m: length of the waves that run over the stand
    period_s: period of the waves that run over the stand
    """

    speed_m_s: Annotated[float, Ge(0.0), Le(30.0)] | None = None
    azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] | None = None
    sway_deg: Annotated[float, Ge(0.0), Le(30.0)] | None = None
    steady_deg: Annotated[float, Ge(0.0), Le(30.0)] | None = None
    wavelength_m: Annotated[float, Ge(2.0), Le(1000.0)] = 4.0
    period_s: Annotated[float, Gt(0.05), Le(1000.0)] = 1.0


@dataclass(frozen=True)
class Sway:
    """A wind as rays need it, in the stand frame.

    toward: unit vector along the wind
    steady, amplitude: slopes [m aside per m of height]
    wave, gust: wave vectors of the two waves [cycles/m]
    period: of the first [ns]
    """

    toward: tuple[float, float]
    steady: float
    amplitude: float
    wave: tuple[float, float]
    gust: tuple[float, float]
    period: int

    @property
    def slope_max(self) -> float:
        """No stem leans further than this [m per m]."""
        return self.steady + self.amplitude

    def phases(self, t: int) -> tuple[float, float]:
        """How far both waves have gone at a time [ns], in [0, 1) cycles."""
        long = GUST_LENGTH * self.period
        return (t % self.period) / self.period, (t % long) / long

    def slope(self, x: Any, y: Any, t: int) -> NDArray[np.float64]:
        """Slope along the wind where the middles of tiles are, stand frame [m], at a time [ns]."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        first, second = (
            np.sin(2.0 * np.pi * (k[0] * x + k[1] * y - phase))
            for k, phase in zip((self.wave, self.gust), self.phases(t), strict=True)
        )
        waves = (1.0 - GUST_SHARE) * first + GUST_SHARE * second
        return np.asarray(self.steady + self.amplitude * waves, dtype=np.float64)


def make_sway(wind: Wind | None, row_heading: float, weather: SiteWeather | None = None) -> Sway | None:
    """What a wind does to a stand whose rows have a heading [rad]; None where nothing moves."""
    if wind is None:
        return None
    usual = USUAL if weather is None else weather.params_at(0)
    speed = usual.wind_m_s if wind.speed_m_s is None else wind.speed_m_s
    azimuth = usual.wind_azimuth_deg if wind.azimuth_deg is None else wind.azimuth_deg
    own = min(SWAY_PER_SPEED2 * speed**2, SWAY_MAX)
    sway = own if wind.sway_deg is None else wind.sway_deg
    steady = sway if wind.steady_deg is None else wind.steady_deg
    if sway == 0.0 and steady == 0.0:
        return None
    heading = from_azimuth(azimuth) - row_heading
    turned, k = heading + GUST_TURN, 1.0 / wind.wavelength_m
    return Sway(
        toward=(cos(heading), sin(heading)),
        steady=tan(steady * DEG),
        amplitude=tan(sway * DEG),
        wave=(k * cos(heading), k * sin(heading)),
        gust=(k / GUST_LENGTH * cos(turned), k / GUST_LENGTH * sin(turned)),
        period=round(wind.period_s * NS),
    )
