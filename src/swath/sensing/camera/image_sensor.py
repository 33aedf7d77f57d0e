"""An image sensor by the linear model of EMVA Standard 1288, Release 4.0 Linear.

    photons that hit a pixel in the exposure:  mu_p = A t E lambda / (h c)                  (eq. 3)
    electrons:  mu_e = eta mu_p + mu_I t, Poisson, at most the full well                    (eq. 5, 14)
    digital number:  y = K (mu_e + N(0, sigma_d)) + black level, rounded and clipped        (eq. 8, 10)

Of each pixel the efficiency is off by a share (PRNU) and the dark signal by some electrons (DSNU), both
normal and drawn once; a gain multiplies K.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream
from swath.sensing.camera.camera_sheet import CameraSheet
from swath.signals import F64

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
