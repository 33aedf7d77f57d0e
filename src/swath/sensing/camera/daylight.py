"""How much light there is by day and in twilight, by the elevation of the sun."""

from math import pi, sin

from swath.core.units import DEG
from swath.sensing.camera.shading import CLOUD_LIGHT, sky_share

SUN_BAND = 130.0  # W/m2 of direct sun in 100 nm of the visible at air mass 1.5, usual, about 1.3 W/m2/nm
# lm per W/m2 in 100 nm of an even spectrum: 683 lm/W times the integral of V(lambda), 106.9 nm (CIE 1924)
LUX = 683.0 * 1.069
LOWEST = -12.0 * DEG  # end of nautical twilight: below it is night
# From this elevation [deg] on: coefficients of lg E in x = elevation / 90 deg (Janiczek and DeYoung 1987, US
# Naval Observatory Circular 171; Seidelmann 1992, Explanatory Supplement to the Astronomical Almanac, 9.34)
CLEAR_SKY = (
    (20.0, 3.74, 3.97, -4.07, 1.47),
    (5.0, 3.05, 13.28, -45.98, 64.33),
    (-0.8, 2.88, 22.26, -207.64, 1034.30),
    (-5.0, 2.88, 21.81, -258.11, -858.36),
    (-12.0, 2.70, 12.17, -431.69, -1899.83),
)


def illuminance(elevation: float) -> float:
    """On level ground under a clear sky [lx]; elevation of the sun [rad], -12 to 90 deg.

    758 lx with the sun on the horizon, 3.4 lx at the end of civil twilight, 6 deg below it.
    """
    x = elevation / (0.5 * pi)
    row = next((r for r in CLEAR_SKY if elevation >= r[0] * DEG), CLEAR_SKY[-1])
    return float(10.0 ** (row[1] + x * (row[2] + x * (row[3] + x * row[4]))))


def sunlight(elevation: float, cloud: float = 0.0) -> float:
    """Light that all others are shares of: direct sunlight across the sun in a band of 100 nm [W/m2].

    Falls with the air mass 1 / sin as 0.7^(m^0.678) (Meinel and Meinel 1976, Applied Solar Energy). Below the
    horizon there is none: what would make the light of the sky what `illuminance` says, clouds (0 to 1) take
    as much of it as they do by day. elevation [rad]
    """
    if elevation <= 0.0:
        clear = illuminance(max(elevation, LOWEST)) / LUX
        return clear * (1.0 - cloud * (1.0 - CLOUD_LIGHT)) / sky_share(cloud)
    mass = 1.0 / max(sin(elevation), 0.03)
    return float(SUN_BAND * 0.7 ** (mass**0.678 - 1.5**0.678))
