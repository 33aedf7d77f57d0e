"""Heat of the air and the sky at a surface: what warms straw, soil and bodies, and dries what is wet.

- Vapour at saturation [hPa]: 6.108 exp(17.27 t / (t + 237.3)), t in deg C (FAO Irrigation and Drainage Paper
  56, eq. 11, there in kPa)
- Radiation of the sky: 1.24 (v / T)^(1/7) s T^4, v vapour in hPa (Brutsaert 1975,
  doi:10.1029/WR011i005p00742); clouds fill up n^2 of what is left to a black body (estimate)
- Resistance of the air over a stand of height h: FAO 56, eq. 4, wind 2 m above it, at least 0.5 m/s
"""

from math import exp, hypot, log

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.field.weather import KELVIN, Air

Array = NDArray[np.float64]

BOLTZMANN = 5.670374419e-8  # [W/m2K4]
FIRST, SECOND = 3.741771852e-16, 1.438776877e-2  # radiation constants, CODATA 2018 [W m2, m K]
HEAT = 1.2 * 1005.0  # of air, density times heat capacity [J/m3K]
KARMAN, CALM = 0.41, 0.5  # least wind [m/s]
STRAW_ABSORBS, STRAW_EMITS = 0.65, 0.96  # of sunlight, at 8 to 14 um: estimates


def saturation(temperature: float) -> float:
    """Pressure of saturated vapour [hPa] at a temperature [K]."""
    return 6.108 * exp(17.27 * (temperature - KELVIN) / (temperature - KELVIN + 237.3))


def black_body(wave: Array, temperature: Array | float) -> Array:
    """Exitance of a black body [W/m3] at wavelengths [m] and temperatures [K], by Planck's law."""
    return np.asarray(FIRST / portable.power(wave, 5.0) / (portable.exp(SECOND / (wave * temperature)) - 1.0))


def sky_radiation(air: Air) -> float:
    """Long waves that the sky sends down [W/m2]."""
    emissivity = min(
        1.24 * (air.humidity * saturation(air.temperature) / air.temperature) ** (1.0 / 7.0), 1.0
    )
    emissivity += (1.0 - emissivity) * air.cloud**2
    return float(emissivity * BOLTZMANN * air.temperature**4)


def wind_of(air: Air) -> float:
    """Wind speed that counts, at least CALM [m/s]."""
    return max(hypot(*air.wind), CALM)


def resistance(air: Air, height: float) -> float:
    """Of the air to heat and vapour from a stand of a height [m], [s/m]."""
    h = max(height, 0.05)
    rough, above = 0.123 * h, 2.0 + h / 3.0
    return log(above / rough) * log(above / (0.1 * rough)) / (KARMAN**2 * wind_of(air))
