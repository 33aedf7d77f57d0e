"""What colour a surface has in the light of sun and sky: Lambert's cosine law, sRGB at the end.

A surface of colour c sends c (SKY_LIGHT + SUN_LIGHT cos a), a between its normal and the sun, 0 in shadow.
Under clouds the sun's part goes down and the sky's up. Linear light 1 is FULL times what a white plate across
the sun sends, so that light times FULL times the sun's irradiance is a surface's radiant exitance.
"""

from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.portable import power
from swath.field.memory_layout import Organ
from swath.signals import F64

# sRGB. Own choice, by eye, of ripe crop on dry loam: nothing was measured.
COLOURS: dict[Organ, tuple[int, int, int]] = {
    Organ.NONE: (0, 0, 0),
    Organ.GROUND: (116, 93, 70),
    Organ.STRAW: (226, 204, 140),
    Organ.STEM: (214, 188, 112),
    Organ.EAR: (198, 163, 102),
    Organ.LEAF: (158, 152, 92),
    Organ.STUBBLE: (214, 201, 164),
    Organ.SOLID: (140, 146, 154),
    Organ.WEED: (72, 122, 54),
    Organ.AWN: (229, 196, 116),
    Organ.BRANCH: (166, 148, 86),
    Organ.POD: (176, 138, 74),
    Organ.COB: (226, 176, 66),
}
HAZE, ZENITH = (214, 225, 233), (92, 146, 206)  # sky at and below the horizon, and overhead; own choice
# Diffuse over direct light of a clear day: about a quarter, own choice; a white plate across the sun is full.
SKY_LIGHT, SUN_LIGHT = 0.25, 1.0
FULL = 1.1  # light that a pixel shows as 255
CLOUD_LIGHT = 0.3  # diffuse light of an overcast sky over the direct one of a clear day, own choice
CLOUD, CLOUD_BRIGHTNESS = (196, 200, 204), 0.6  # sky under clouds; own choice
FRESH = (96, 134, 62)  # plants that are not ripe
GREEN_ORGANS = (Organ.STEM, Organ.EAR, Organ.LEAF, Organ.AWN, Organ.BRANCH, Organ.POD, Organ.COB)


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


def lit(sun_cosine: F64, cloud: float) -> F64:
    """Light on surfaces; sun_cosine: of the angle to the sun, 0 in shadow; cloud: 0 clear to 1 overcast."""
    return np.asarray((sky_share(cloud) + (1.0 - cloud) * SUN_LIGHT * sun_cosine) / FULL)


def sky_share(cloud: float) -> float:
    """Light of the sky on level ground over the direct one of a clear day."""
    return (1.0 - cloud) * SKY_LIGHT + cloud * CLOUD_LIGHT


def sky_light(up: F64, cloud: float = 0.0) -> F64:
    """Linear light (..., 3) of the sky in directions with this upward part, sine of the elevation."""
    share = np.sqrt(np.clip(up, 0.0, 1.0))[..., None]
    clear = (1.0 - share) * linear(HAZE) + share * linear(ZENITH)
    return np.asarray((1.0 - cloud) * clear + cloud * CLOUD_BRIGHTNESS * linear(CLOUD))


def air_light(cloud: float) -> F64:
    """Linear light (3,) that a deep layer of dust or haze sends: that of the sky at the horizon."""
    return np.asarray(sky_light(np.zeros(1), cloud)[0])


def encode(light: F64) -> NDArray[np.uint8]:
    """Linear light as sRGB bytes (IEC 61966-2-1)."""
    return np.searchsorted(_STEPS, np.clip(light, 0.0, 1.0), side="right").astype(np.uint8)


def linear(colour: Any) -> F64:
    """Values 0 to 255 of sRGB as linear light of the same shape."""
    x = np.array(colour) / 255.0
    return np.where(x <= 0.04045, x / 12.92, power((x + 0.055) / 1.055, 2.4))


_STEPS = linear(np.arange(255) + 0.5)  # light at which the byte goes up by one
