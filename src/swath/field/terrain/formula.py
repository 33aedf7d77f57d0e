"""Terrain level `formula`: a slope, gentle waves and ISO 8608 roughness."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.registry import Level
from swath.core.units import DEG
from swath.field.field_setup import FieldSetup, from_azimuth
from swath.field.ground.waves import ROUGHNESS_CLASSES, Waves, make_roughness, make_wave
from swath.field.terrain import plane

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wave:
    """One sine wave of the ground.

    amplitude_m: half of the height from crest to trough
    wavelength_m: distance from crest to crest
    azimuth_deg: direction in which it runs, clockwise from north
    phase_deg: phase at the world's origin
    """

    amplitude_m: Annotated[float, Ge(0.0), Le(100.0)]
    wavelength_m: Annotated[float, Ge(1.0), Le(1e5)]
    azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 0.0
    phase_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 0.0


@dataclass(frozen=True)
class Params:
    """A plane with waves and roughness.

    slope_percent: rise per run
    slope_azimuth_deg: direction in which the ground rises, clockwise from north
    waves: sine waves, any number
    roughness_class: ISO 8608 class, or `none`
    gd_n0_m3: displacement spectral density Gd at 0.1 cycles/m, in place of that of a class
    waviness: exponent w of the spectrum [1]: 2 in ISO 8608; off-road spectra are flatter, down to 1.2
    """

    slope_percent: Annotated[float, Ge(-100.0), Le(100.0)] = 0.0
    slope_azimuth_deg: Annotated[float, Ge(-360.0), Le(360.0)] = 90.0
    waves: tuple[Wave, ...] = ()
    roughness_class: Literal["none", "A", "B", "C", "D", "E", "F"] = "C"
    gd_n0_m3: Annotated[float, Ge(0.0), Le(0.1)] | None = None
    waviness: Annotated[float, Gt(0.5), Le(4.0)] = 2.0


class Formula:
    """Plane plus waves plus roughness."""

    def __init__(self, params: Params, setup: FieldSetup) -> None:
        base = plane.Params(params.slope_percent, params.slope_azimuth_deg)
        self._plane = plane.Plane(base, setup)
        gd = params.gd_n0_m3
        if gd is None:
            gd = ROUGHNESS_CLASSES.get(params.roughness_class, 0.0)
        waves = Waves.none()
        for w in params.waves:
            heading = from_azimuth(w.azimuth_deg)
            waves += make_wave(w.amplitude_m, w.wavelength_m, heading, w.phase_deg * DEG)
        self.gd_n0 = gd
        if gd > 0.0:
            waves += make_roughness(gd, params.waviness, setup.stream.child("roughness"))
        self.waves = waves

    def height(self, x: Any, y: Any) -> Array:
        """Height [m] at world points."""
        return self._plane.height(x, y) + self.waves.height(x, y)

    def lattice(self, u: Array, v: Array, yaw: float) -> Array:
        """Height [m] at the crossings of u and v in a frame turned by yaw, shape (len(v), len(u))."""
        return self._plane.lattice(u, v, yaw) + self.waves.lattice(u, v, yaw)


LEVEL = Level(
    Formula,
    Params,
    "a slope, waves and ISO 8608 roughness",
    cost="1 ms per page of 8 m x 8 m",
    tolerance="slope and waves exact; profiles within 15 % of ISO 8608 per octave, 0.05-2 cycles/m",
)
