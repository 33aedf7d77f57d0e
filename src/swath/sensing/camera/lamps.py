"""Work lights of the machine that carries a camera: points that send a beam.

A lamp sends I = I_0 2^-(2 a / b)^2 at the angle a from its axis, b the full angle at half intensity, and
nothing backward. At the distance d it lights a surface by I cos(i) / d^2 exp(-k d) [lx], i the angle of
incidence, k the extinction of weather. It has the colour of a black body of 5500 K (Planck's law), lux by the
fit 1.019 exp(-285.4 (wavelength / um - 0.559)^2) of V (Palmer, Radiometry and photometry FAQ, 2003). Not in
it: glare, the beam in dust or rain, spectra of LEDs, the lamps of other machines.
"""

from dataclasses import dataclass
from functools import cache
from math import log, pi
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.frames import Pose
from swath.core.units import DEG
from swath.field.heat import black_body
from swath.sensing.mount import Angle, LevelMount
from swath.signals import F64

EFFICACY = 683.0  # of light of 555 nm [lm/W], the definition of the candela
COLOUR_TEMPERATURE = 5500.0  # of white LEDs, about [K]
WORK_DISTANCE = 6.0  # a picture by night is exposed for what the brightest lamp lights there [m]
NEAREST = 0.05  # nearer surfaces are lit as at this distance [m]


@dataclass(frozen=True)
class WorkLight(LevelMount):
    """A lamp of the machine. Place and brightness of a usual one are our own choice.

    z_m: above ground
    pitch_deg: > 0 nose down
    candela: luminous intensity on its axis [cd]
    beam_deg: full angle between the directions of half that intensity
    """

    z_m: Annotated[float, Gt(0), Le(30)] = 3.6
    pitch_deg: Angle = 20.0
    candela: Annotated[float, Gt(0), Le(1e6)] = 5000.0
    beam_deg: Annotated[float, Ge(1), Le(180)] = 60.0

    def lux(self, pose: Pose, points: F64) -> F64:
        """Illuminance [lx] of surfaces across the light at points (n, 3) of a lamp at pose_world_lamp."""
        away = points - pose.position
        squared = np.maximum((away * away).sum(axis=-1), NEAREST**2)
        forward = (away * pose.rotation[:, 0]).sum(axis=-1) / np.sqrt(squared)
        angle = 0.5 * pi - portable.arcsin(np.clip(forward, -1.0, 1.0))
        beam = portable.exp(-log(2.0) * (2.0 * angle / (self.beam_deg * DEG)) ** 2)
        return np.where(forward > 0.0, self.candela * beam / squared, 0.0)


Lamp = tuple[WorkLight, Pose]  # and its pose_world_lamp


@cache
def irradiance_per_lux(wavelengths: tuple[float, ...]) -> F64:
    """Irradiance at wavelengths [m] of one lux of lamps [W/(m2 nm)], (n,)."""
    wave = np.arange(380.0, 781.0, 5.0)  # [nm]
    seen = 1.019 * portable.exp(-285.4 * (1e-3 * wave - 0.559) ** 2)
    lux = EFFICACY * 5.0 * (seen * black_body(1e-9 * wave, COLOUR_TEMPERATURE)).sum()
    return np.asarray(black_body(np.array(wavelengths), COLOUR_TEMPERATURE) / lux)
