"""Camera level `thermal`: apparent temperatures at 8 to 14 um of what sun, sky and bodies warm and cool.

Surfaces are in balance with what they take in, without a memory of the hour before:

    Ts - Ta = ((1 - g) (a S + e (L - s Ta^4)) + q) / (rho cp / ra + 4 e s Ta^3)

S sun and sky on the surface (`field/light.py`), a, e what it absorbs of them and at 8 to 14 um, L, ra
radiation of the sky and resistance of the air (`field/heat.py`), g the share of the net radiation that goes
into the ground or evaporates, q = (Tskin - Ts) / R of a living thing through fur or clothes of insulation R;
from a body 8.3 u^0.6 W/m2K go to the air (ASHRAE Handbook Fundamentals).

None of these papers was read here, numbers of surfaces are estimates, no picture of a field was compared.

What is seen: e B(Ts) + (1 - e) B(sky), B the integral of Planck's law, dimmed by the air as light is; each
pixel takes the mean of its samples, and by diffraction of its neighbours', and has noise of the NETD, at
300 K. No distortion, no drift. Channel `raw` is the apparent temperature in 0.01 K, `colour` the same from
`black` to `white`: by percentiles 1 and 99 of what is no sky, and half as much below them and as much above,
so that what lives stands out of a ground that is nearly even.
"""

from dataclasses import dataclass, replace
from functools import cache
from math import sin, sqrt
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.component import Outputs
from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.core.random import Stream
from swath.core.registry import OWN_LAW, Checked, Level
from swath.field.heat import (
    BOLTZMANN,
    HEAT,
    STRAW_ABSORBS,
    STRAW_EMITS,
    black_body,
    resistance,
    sky_radiation,
    wind_of,
)
from swath.field.light import light
from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.weather import KELVIN, Air
from swath.sensing import BRIGHTEST, CAMERA
from swath.sensing.camera.lighting import CANOPY_COSINE
from swath.sensing.camera.rays import Channel, SceneCamera, Sight, cells, diffraction_mtf, pinhole_of
from swath.sensing.camera.rays import Params as PinholeParams
from swath.signals import F64

BAND = 8e-6, 14e-6  # [m]
MIDDLE = 10e-6  # where a body at 290 K sends most [m]
CENTIKELVIN = 100.0  # counts per kelvin of `raw`
# absorbed of sunlight, emissivity at 8 to 14 um, share of the net radiation that goes elsewhere: estimates
DRY = STRAW_ABSORBS, STRAW_EMITS, 0.05
SOIL, GREEN, THING = (0.75, 0.94, 0.3), (0.8, 0.97, 0.7), (0.6, 0.93, 0.1)
SURFACES = {Organ.GROUND: SOIL, Organ.WEED: GREEN, Organ.SOLID: THING}
SUN_ON_BODY = 0.7  # absorbed by fur and clothes, an estimate


@dataclass(frozen=True)
class Params(PinholeParams):
    """A thermal camera: a class of uncooled bolometers. Keys of colour alone (texture, green_percent,
    orthophoto) change nothing.

    samples_per_pixel: samples spread over the pixel
    width_px: width of the image
    height_px: height of the image
    channels: what an image holds
    netd_mk: noise equivalent temperature difference at 300 K, 50 is usual
    f_number: of the lens, which blurs by diffraction at 10 um alone; 1.0 is usual
    pixel_um: side of a pixel, which that blur is counted in; 12 is usual
    """

    samples_per_pixel: Literal[1, 4, 9, 16] = 4
    width_px: Annotated[int, Ge(1), Le(8192)] = 640
    height_px: Annotated[int, Ge(1), Le(8192)] = 480
    channels: tuple[Channel, ...] = ("colour", "depth", "label", "raw")
    netd_mk: Annotated[float, Ge(0), Le(5000)] = 50.0
    f_number: Annotated[float, Gt(0), Le(20)] = 1.0
    pixel_um: Annotated[float, Ge(3), Le(100)] = 12.0


@dataclass(frozen=True)
class Balance:
    """What reaches surfaces. sun: direct, across it; sky: diffuse, on level ground; down: long waves [W/m2].

    up: sine of the sun's elevation, 0 at night
    air [K]; canopy, body: heat to the air per kelvin [W/m2K]
    """

    up: float
    sun: float
    sky: float
    down: float
    air: float
    canopy: float
    body: float

    def surface(self, absorbed: F64 | float, emissivity: F64 | float, lost: F64 | float, sun: F64) -> F64:
        """Temperature [K]; lost: share of the net radiation; sun: cosine of its angle, 0 in shadow."""
        net = self._net(absorbed, emissivity, sun) * (1.0 - np.asarray(lost))
        return self.air + net / (self.canopy + 4.0 * np.asarray(emissivity) * BOLTZMANN * self.air**3)

    def living(self, skin: float, insulation: float, emissivity: float, sun: F64) -> F64:
        """Temperature [K] of fur or clothes on a skin [K]."""
        to_air = self.body + 4.0 * emissivity * BOLTZMANN * self.air**3
        taken = self._net(SUN_ON_BODY, emissivity, sun) + (skin - self.air) / insulation
        return np.asarray(self.air + taken / (to_air + 1.0 / insulation))

    def _net(self, absorbed: F64 | float, emissivity: F64 | float, sun: F64) -> F64:
        light = np.asarray(absorbed) * (self.sky + self.sun * sun)
        return np.asarray(light + np.asarray(emissivity) * (self.down - BOLTZMANN * self.air**4))

    @property
    def sky_temperature(self) -> float:
        """Of a black body that sends what the sky does [K]."""
        return float(sqrt(sqrt(self.down / BOLTZMANN)))


def balance(air: Air, elevation: float, height: float) -> Balance:
    """Balance under a sun at an elevation [rad], in a stand of a height [m]."""
    day = light(elevation, air.cloud)
    return Balance(
        up=max(sin(elevation), 0.0),
        sun=float(day.sun[-1]),
        sky=float(day.sky[-1]),
        down=sky_radiation(air),
        air=air.temperature,
        canopy=HEAT / resistance(air, height),
        body=8.3 * wind_of(air) ** 0.6,
    )


@cache
def _table() -> tuple[F64, F64]:
    """Temperatures [K] and the exitance of a black body in BAND [W/m2], by Simpson's rule."""
    temperature, wave = np.arange(150.0, 450.5, 0.5), np.linspace(*BAND, 61)
    weight = np.array([1.0, *[4.0, 2.0] * 29, 4.0, 1.0]) * (wave[1] - wave[0]) / 3.0
    return temperature, np.asarray((black_body(wave, temperature[:, None]) * weight).sum(axis=1))


def exitance(temperature: F64 | float) -> F64:
    """Exitance of a black body at 8 to 14 um [W/m2] at temperatures [K]."""
    known, table = _table()
    at = np.clip((np.asarray(temperature) - known[0]) / (known[1] - known[0]), 0.0, len(known) - 1.001)
    k = at.astype(np.int32)
    return np.asarray(table[k] + (at - k) * (table[k + 1] - table[k]))


def apparent(sent: F64) -> F64:
    """Temperature [K] of a black body that sends so much at 8 to 14 um [W/m2]."""
    known, table = _table()
    return np.asarray(np.interp(sent, table, known))


class ThermalCamera(SceneCamera):
    """A radiometric camera for long waves."""

    kept: ClassVar[tuple[str, ...]] = ("_last", "_casts")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._netd = 1e-3 * params.netd_mk
        self.mtf = diffraction_mtf(MIDDLE, params.f_number, 1e-6 * params.pixel_um)
        super().__init__(params, setup, pinhole_of(params, Lens()))
        table = [SURFACES.get(organ, DRY) for organ in Organ]
        self._surfaces: F64 = np.array(table)

    def reset(self, stream: Stream) -> Outputs:
        """A black image."""
        self._stream = stream
        return super().reset(stream)

    def picture_from(self, t: int, pose: Pose) -> Outputs:
        """Every sample at once."""
        seen = self.sight(t, pose)
        return self.outputs_of(t, seen, **self._channels(t, seen))

    def _channels(self, t: int, seen: Sight) -> dict[str, Any]:
        kelvin, found = self.temperatures(t, seen), dict[str, Any]()
        wanted = self.params.channels
        if "raw" in wanted:
            found["raw"] = np.clip(np.rint(CENTIKELVIN * kelvin), 0, 65535).astype(np.uint16)[..., None]
        if "colour" in wanted:
            below = cells(seen.hits.is_hit | (seen.directions[..., 2] < 0.0), self.per_side).any(axis=0)
            low, high = np.percentile(kelvin[below] if below.any() else kelvin, (1.0, 99.0))
            spread = max(high - low, 1.0)
            found["black"], found["white"] = float(low - 0.5 * spread), float(low + 2.0 * spread)
            grey = np.clip(255.0 / (2.5 * spread) * (kelvin - found["black"]), 0, 255).astype(np.uint8)
            found["colour"] = np.repeat(grey[..., None], 3, axis=2)
        return found

    def temperatures(self, t: int, seen: Sight) -> F64:
        """Apparent temperatures of the pixels with their noise [K], (height, width)."""
        weather, (sun, cloud) = self.setup.field.weather, self.sky(t)
        air = replace(Air() if weather is None else weather.at(t), cloud=cloud)
        now = balance(air, sun.elevation, self.setup.field.crop_height)
        sent, extinction = self._sent(t, seen, now), self._lighting.setup.extinction
        if extinction > 0.0:
            clear = np.nan_to_num(seen.hits.distance.astype(float), nan=self.params.reach_m)
            clear = portable.exp(-extinction * clear)
            sent = clear * sent + (1.0 - clear) * exitance(now.air)
        found = apparent(self.pixels(sent))
        slope = (exitance(found + 0.5) - exitance(found - 0.5)) / (exitance(300.5) - exitance(299.5))
        noise = self._stream.at(t).standard_normal(found.shape) if self._netd > 0.0 else 0.0
        return np.asarray(found + self._netd * noise / slope)

    def _sent(self, t: int, seen: Sight, now: Balance) -> F64:
        """What samples send at 8 to 14 um [W/m2], (rows, columns); far ground is as the crop in the sun."""
        hits, things = seen.hits, seen.things
        if self.setup.field.weather is not None:
            self._lighting.setup = self._light_setup(t)
        cosine = self._lighting.cosines(hits, seen.origins, seen.directions, things, self.caster, t)
        organ, owner = hits.organ[hits.is_hit], things.owners(hits)[hits.is_hit]
        absorbed, emits, lost = self._surfaces.T
        shade, sunlit = (now.surface(absorbed, emits, lost, np.array(sun)) for sun in (0.0, 1.0))
        kelvin, emissivity = shade[organ] + (sunlit - shade)[organ] * cosine, emits[organ]
        for number, warm in enumerate(things.warm, start=1):
            own = np.flatnonzero(owner == number)
            if warm is not None and len(own):
                emissivity[own] = warm.emissivity
                skin = KELVIN + warm.skin
                kelvin[own] = now.living(skin, warm.insulation, warm.emissivity, cosine[own])
        below = seen.directions[..., 2] < 0.0
        sky = exitance(now.sky_temperature)
        far = exitance(now.surface(*DRY, sun=np.array(CANOPY_COSINE * sqrt(now.up))))
        found = np.where(below, DRY[1] * far + (1.0 - DRY[1]) * sky, sky)
        found[hits.is_hit] = emissivity * exitance(kelvin) + (1.0 - emissivity) * sky
        return found


LEVEL = Level(
    ThermalCamera,
    Params,
    summary="apparent temperatures at 8 to 14 um: sun, sky, wind and living things; NETD",
    cost="about that of rays, with its rays towards the sun",
    tolerance="equal to rays within 0.5 px; Planck's law within 0.2 %; no thermal picture was compared",
    checked=(*CAMERA, Checked("light_lx", 0.0, BRIGHTEST, "tests/sensing/test_thermal.py", OWN_LAW)),
)
