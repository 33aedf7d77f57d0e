"""What colour a surface has in the light of sun and sky: Lambert's cosine law, sRGB at the end.

A surface of colour c sends c (sky + sun cos a), a between its normal and the sun, 0 in shadow; sun and sky as
`field/light.py` has them, each in three bands of colour. White is a plate across the sun at 45 deg. A picture
is exposed for the clear day: a white plate across the sun, or in twilight four times the sky's light on level
ground, or by night one 6 m before the brightest lamp, is 1 / FULL. So evening light is gold and shadows are
blue.

The sky is as bright as ISO 15469:2004 says, type 12 (clear, low turbidity) and type 1 (overcast), scaled so
that it sends the light of the sky on level ground; towards the horizon its colour fades as the optical depth
of the air goes up (Rayleigh's by Hansen and Travis 1974, aerosol's of the table of the light).
"""

from math import cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.portable import power
from swath.core.units import DEG
from swath.field.light import Light, light
from swath.field.memory_layout import Organ
from swath.field.weather import Sun
from swath.sensing.camera.lamps import irradiance_per_lux
from swath.signals import F64

# sRGB of reflectances at 650 and 550 nm: dry straw 0.42 and 0.37, dead leaf 0.29 and 0.25, green leaf 0.05
# and 0.16 by PROSPECT-D, dry soil 0.31 and 0.26 of prosail. All blue, and ears, pods, cobs, awns, branches,
# weeds and solids, are own choice, by eye.
COLOURS: dict[Organ, tuple[int, int, int]] = {
    Organ.NONE: (0, 0, 0),
    Organ.GROUND: (151, 139, 112),
    Organ.STRAW: (173, 164, 116),
    Organ.STEM: (173, 164, 106),
    Organ.EAR: (160, 139, 92),
    Organ.LEAF: (147, 137, 84),
    Organ.STUBBLE: (173, 164, 128),
    Organ.SOLID: (140, 146, 154),
    Organ.WEED: (72, 122, 54),
    Organ.AWN: (182, 160, 96),
    Organ.BRANCH: (147, 137, 80),
    Organ.POD: (150, 122, 68),
    Organ.COB: (186, 146, 58),
}
FRESH = (63, 111, 48)  # plants that are not ripe
GREEN_ORGANS = (Organ.STEM, Organ.EAR, Organ.LEAF, Organ.AWN, Organ.BRANCH, Organ.POD, Organ.COB)
FULL = 0.7  # light that a pixel shows as 255; straw and soil send a third of what falls on them
WAVELENGTHS = (620e-9, 540e-9, 460e-9)  # middle of the bands of red, green and blue [m]
WHITE_SUN = 45.0 * DEG  # the elevation of a sun that is white
TWILIGHT = 4.0  # a picture in twilight is exposed for so much light of the sky
DEPTHS = np.array([0.179, 0.245, 0.373])  # of the air in red, green and blue, straight up
NODES = np.linspace(-1.0, 1.0, 1025)  # sines and cosines of the tables of the sky


def sun_direction(azimuth: float, elevation: float) -> F64:
    """Unit vector towards the sun, world (3,). azimuth [rad] clockwise from north, elevation [rad]."""
    level = cos(elevation)
    return np.array([level * sin(azimuth), level * cos(azimuth), sin(elevation)])


def organ_colours(green: float) -> F64:
    """Linear colour of each Organ, (organs, 3). green: share of unripe plants' colour in that of the crop."""
    table = np.array([linear(COLOURS[organ]) for organ in Organ])
    own = list(GREEN_ORGANS)
    table[own] = (1.0 - green) * table[own] + green * linear(FRESH)
    return table


def bands(of: Light, values: F64) -> F64:
    """Irradiance [W/(m2 nm)] in red, green and blue of one of a light's `sun`, `sky` and `level`, (3,)."""
    return np.array([of.at(w, values) for w in WAVELENGTHS])


class Daylight:
    """The light of a picture.

    toward: unit vector to the sun, world (3,)
    sun, sky: linear light of a white plate across the sun, and of one on level ground in shadow, (3,)
    lux: linear light of a white plate for one lux of lamps, (3,)
    unit: irradiance of green for light FULL [W/(m2 nm)]
    white: of the other colours relative to green in white light, (3,)
    """

    def __init__(self, sun: Sun, cloud: float, lamps: float = 0.0) -> None:
        """Of a sun and a cloud cover; lamps: their light on work [lx], for which to expose at least."""
        self.toward = sun_direction(sun.azimuth, sun.elevation)
        white, clear, now = light(WHITE_SUN), light(sun.elevation), light(sun.elevation, cloud)
        self.white = bands(white, white.sun) / white.at(WAVELENGTHS[1], white.sun)
        lux = irradiance_per_lux(WAVELENGTHS)
        self.unit = max(
            clear.at(WAVELENGTHS[1], clear.sun),
            TWILIGHT * clear.at(WAVELENGTHS[1], clear.sky),
            lamps * float(lux[1]),
        )
        scale = 1.0 / (self.white * self.unit * FULL)
        self.sun, self.sky, self.lux = (x * scale for x in (bands(now, now.sun), bands(now, now.sky), lux))
        self._cloud = cloud
        self._clear = np.ones(3)
        middles = (np.arange(12) + 0.5) / 12.0  # sines, of bands of one size
        around = (np.arange(24) + 0.5) * (pi / 12.0)
        flat = np.sqrt(1.0 - middles**2)
        grid = np.stack(np.broadcast_arrays(flat[:, None] * np.cos(around), flat[:, None] * np.sin(around),
                                            middles[:, None]), axis=-1)  # fmt: skip
        self._clear = 2.0 * (self._shape(grid, grid[..., 2]) * grid[..., 2:]).mean(axis=(0, 1))

    def on(self, sun_cosine: F64) -> F64:
        """Light on surfaces (n, 3); sun_cosine: of the angle to the sun, 0 in shadow, (n,)."""
        return np.asarray(self.sky + sun_cosine[:, None] * self.sun)

    def sky_at(self, directions: F64) -> F64:
        """Linear light (..., 3) of the sky in directions (..., 3); at the horizon below it."""
        up = np.clip(directions[..., 2], 0.0, 1.0)
        clear = self._shape(directions, up) / self._clear
        overcast = ((1.0 + 2.0 * up) * (3.0 / 7.0))[..., None]
        return np.asarray(self.sky * ((1.0 - self._cloud) * clear + self._cloud * overcast))

    def _shape(self, directions: F64, up: F64) -> F64:
        """How bright a clear sky is, up to a factor of each colour, (..., 3)."""
        near = np.interp(np.einsum("...k,k", directions, self.toward), NODES, _INDICATRIX)
        deep = [np.interp(up, NODES, column) for column in _GRADATION]
        return np.asarray(near[..., None] * np.stack(deep, axis=-1))


def encode(light: F64) -> NDArray[np.uint8]:
    """Linear light as sRGB bytes (IEC 61966-2-1)."""
    part = np.clip(light, 0.0, 1.0)
    low = _BYTES[(part * FINE).astype(np.int32)]
    return np.asarray(low + (part >= _NEXT[low]))


def linear(colour: Any) -> F64:
    """Values 0 to 255 of sRGB as linear light of the same shape."""
    x = np.array(colour) / 255.0
    return np.where(x <= 0.04045, x / 12.92, power((x + 0.055) / 1.055, 2.4))


_STEPS = linear(np.arange(255) + 0.5)  # light at which the byte goes up by one
FINE = 1 << 13  # parts of the light with at most one step in each
_BYTES = np.searchsorted(_STEPS, np.arange(FINE + 1) / FINE, side="right").astype(np.uint8)
_NEXT = np.append(_STEPS, np.inf)
_AWAY = 0.5 * pi - portable.arcsin(NODES)  # from the sun [rad]
_INDICATRIX = 1.0 + 10.0 * (portable.exp(-3.0 * _AWAY) - portable.exp(-1.5 * pi)) + 0.45 * NODES**2
_GRADATION = [1.0 - portable.exp(-depth / np.maximum(NODES, 1e-3)) for depth in DEPTHS.tolist()]
