"""What colour a surface has in the light of sun and sky: Lambert's cosine law, sRGB at the end.

A surface of colour c sends c (E + sun cos a), a between its normal and the sun, 0 in shadow; E comes from the
half space before it: of the sky, and of level ground of dry soil in sun and sky, as far as it looks down (an
integral in steps, interpolated between normals; nothing stands in the way of it). Sun and sky are as
`field/light.py` has them, each in three bands of colour. White is a plate across the sun at 45 deg. A picture
is exposed for the clear day: a white plate across the sun, or in twilight four times the sky's light on level
ground, or by night one 6 m before the brightest lamp, is 1 / FULL. So evening light is gold and shadows are
blue.

The sky is as bright as ISO 15469:2004 says, type 12 (clear, low turbidity) and type 1 (overcast), scaled so
that it sends the light of the sky on level ground; towards the horizon its colour fades as the optical depth
of the air goes up (Rayleigh's by Hansen and Travis 1974, aerosol's of the table of the light).
"""

from functools import cache
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
from swath.kernels import shared, start_warp
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
BANDS, NORMALS = 16, 33  # of the sky from the horizon up; along a side of the table of normals
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
        upward, normals, weights = _half_spaces()
        self._clear = 2.0 * (self._shape(upward, upward[:, 2]) * upward[:, 2:]).mean(axis=0)
        ground = linear(COLOURS[Organ.GROUND]) * (self.sky + self.sun * max(float(self.toward[2]), 0.0))
        above = [np.einsum("nd,d->n", weights, column) for column in self.sky_at(upward).T]
        below = 0.5 - 0.5 * normals[..., 2:]
        self._around = (np.stack(above, axis=-1).reshape(normals.shape) + below * ground).astype(np.float32)

    def on(self, normals: NDArray[np.float32], sun_cosine: F64) -> F64:
        """Light on surfaces (n, 3) with unit normals (n, 3).

        sun_cosine: of the angle to the sun, 0 in shadow, (n,)
        """
        wp, found = start_warp(), np.empty((len(normals), 3))
        from swath.sensing.camera.sky_kernel import light_on

        if len(found):
            given = (
                (normals, wp.vec3),
                (sun_cosine, wp.float64),
                (self._around, wp.vec3),
                (self.sun[None], wp.vec3d),
            )
            arrays = [shared(np.ascontiguousarray(a), kind) for a, kind in (*given, (found, wp.vec3d))]
            wp.launch(light_on, dim=len(found), inputs=arrays, device="cpu")
        return found

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


@cache
def _half_spaces() -> tuple[F64, F64, F64]:
    """Directions upward (n, 3), each for an equal part of the sky; normals (NORMALS, NORMALS, 3) on an
    octahedron that is folded open (Cigolle et al. 2014); weights (NORMALS^2, n) of directions on these.
    """
    middles = (np.arange(BANDS) + 0.5) / BANDS  # sines, of bands of one size
    turn = (np.arange(2 * BANDS) + 0.5) * (pi / BANDS)
    flat = np.sqrt(1.0 - middles**2)[:, None]
    upward = np.stack(
        np.broadcast_arrays(flat * np.cos(turn), flat * np.sin(turn), middles[:, None]), axis=-1
    )
    y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, NORMALS)] * 2, indexing="ij")
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    normals = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1)[..., None]
    upward = upward.reshape(-1, 3)
    cosine = np.einsum("ijk,dk->ijd", normals, upward).reshape(-1, len(upward))
    return upward, normals, np.maximum(cosine, 0.0) * (2.0 / len(upward))


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
