"""An image sensor by the linear model of EMVA Standard 1288, Release 4.0 Linear.

    photons that hit a pixel in the exposure:  mu_p = A t E lambda / (h c)                  (eq. 3)
    electrons:  mu_e = eta mu_p + mu_I t, Poisson, at most the full well                    (eq. 5, 14)
    digital number:  y = K (mu_e + N(0, sigma_d)) + black level, rounded and clipped        (eq. 8, 10)

Of each pixel the efficiency is off by a share (PRNU) and the dark signal by some electrons (DSNU), both
normal and drawn once; a gain multiplies K.

`sunlight` is how much light there is by day and in twilight, by the elevation of the sun. Colour filters:
rows red green, green blue. The two colours that a pixel has not measured are means of its neighbours that
have (bilinear interpolation); at the border of those that are there.
"""

from dataclasses import dataclass
from math import pi, sin

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream
from swath.core.units import DEG
from swath.sensing.camera.camera_sheet import CameraSheet
from swath.sensing.camera.shading import CLOUD_LIGHT, sky_share
from swath.signals import F64


def filters(height: int, width: int) -> NDArray[np.int64]:
    """Colour of each pixel, 0 red, 1 green, 2 blue, (height, width)."""
    rows, columns = np.indices((height, width)) % 2
    return rows + columns


def filtered(light: F64) -> F64:
    """Of light (height, width, 3) what each pixel's filter lets through, (height, width)."""
    colour = filters(*light.shape[:2])
    return np.take_along_axis(light, colour[..., None], axis=2)[..., 0]


def interpolated(values: F64) -> F64:
    """A picture (height, width, 3) of what pixels behind filters measured, (height, width)."""
    colour = filters(*values.shape)
    found = []
    for k in range(3):
        own = colour == k
        total, weight = _around(np.where(own, values, 0.0)), _around(own.astype(np.float64))
        found.append(np.where(own, values, total / weight))
    return np.stack(found, axis=-1)


def _around(values: F64) -> F64:
    """Sum of the eight neighbours, those at the sides twice, with 0 beyond the border."""
    wide = np.pad(values, 1)
    rows = wide[:-2] + 2.0 * wide[1:-1] + wide[2:]
    return np.asarray(rows[:, :-2] + 2.0 * rows[:, 1:-1] + rows[:, 2:])


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


PLANCK, LIGHT_SPEED = 6.62607015e-34, 299_792_458.0


def photon_rate(irradiance: F64 | float, pixel: float, wavelength: float) -> F64:
    """Photons per second on a pixel of side [m] at an irradiance [W/m2] of one wavelength [m]."""
    return np.asarray(irradiance) * (pixel * pixel * wavelength / (PLANCK * LIGHT_SPEED))


@dataclass(frozen=True)
class Pattern:
    """What is fixed of every pixel (height, width): response over the mean, dark signal [electrons]."""

    response: F64
    dark: F64


class ImageSensor:
    """One sensor of a make: sheet, its own fixed pattern, and noise or none at all."""

    def __init__(self, sheet: CameraSheet, size: tuple[int, int], *, is_noisy: bool = True) -> None:
        self.sheet, self.is_noisy, self._size = sheet, is_noisy, size
        self._pattern = Pattern(np.ones(size), np.zeros(size))

    def reset(self, stream: Stream) -> None:
        """Draw the fixed pattern of this sensor."""
        if self.is_noisy:
            draw = stream.at(0)
            response = 1.0 + self.sheet.prnu * draw.standard_normal(self._size)
            dark = self.sheet.dsnu * draw.standard_normal(self._size)
            self._pattern = Pattern(np.maximum(response, 0.0), dark)

    def expose(
        self,
        photons: F64,
        exposure: float,
        draw: np.random.Generator,
        *,
        gain: float = 1.0,
        efficiency: F64 | float | None = None,
    ) -> NDArray[np.uint16]:
        """Digital numbers (height, width) of mean photons per pixel in the exposure [s].

        efficiency: of each pixel, none = the sheet's first
        """
        s = self.sheet
        eta = s.efficiency(0) if efficiency is None else efficiency
        mean = eta * photons * self._pattern.response + s.dark_current * exposure
        electrons = mean
        if self.is_noisy:
            electrons = draw.poisson(mean) + s.dark_noise * draw.standard_normal(self._size)
        held = np.minimum(electrons, s.full_well)
        number = s.system_gain * gain * (held + self._pattern.dark) + s.black_level
        return np.clip(np.rint(number), 0, s.digital_max).astype(np.uint16)
