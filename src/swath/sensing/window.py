"""Dust on the window of a scanner: what settles on it, what it takes from each beam, what takes it off.

Of the light 1 - 0.3437 erf(0.17 m^0.8473) comes through m g/m2 (Coello and Boyle 2019,
doi:10.1109/JPHOTOV.2019.2919628), there and back the square. That is solar glass, which
keeps what is scattered forward: a scanner loses more. An upright window catches a
tenth of the dust that falls past it and a share of what the air carries against it; both are estimated.
"""

from dataclasses import dataclass
from math import erf
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.component import KeepsState
from swath.core.portable import product
from swath.core.schedule import NS
from swath.core.units import GRAM, PERCENT
from swath.field.field import Field
from swath.field.plume import PLANT, fall_speed
from swath.sensing.haze import extinction_at
from swath.signals import F64

HOUR = 3600.0  # [s]


@dataclass(frozen=True)
class Params:
    """A window that gets dirty.

    dust_g_m2: dust on it at the start
    fall_percent: share of the dust falling past that it catches
    impaction_percent: share of the dust that the air carries against it that it catches
    wiped_s: times at which it is wiped
    rinse_mm: rain that takes off half of the dust
    warning_percent: light that still comes through where the scanner warns
    error_percent: light that still comes through where the scanner calls it an error
    """

    dust_g_m2: Annotated[float, Ge(0), Le(100)] = 0.0
    fall_percent: Annotated[float, Ge(0), Le(100)] = 10.0
    impaction_percent: Annotated[float, Ge(0), Le(100)] = 2.0
    wiped_s: tuple[Annotated[float, Ge(0), Le(1e6)], ...] = ()
    rinse_mm: Annotated[float, Gt(0), Le(100)] = 1.0
    warning_percent: Annotated[float, Gt(0), Le(100)] = 90.0
    error_percent: Annotated[float, Gt(0), Le(100)] = 80.0


def transmission(mass: F64) -> F64:
    """Share of light that comes through dust of a mass [g/m2], one way."""
    shades = portable.power(np.maximum(mass, 0.0), 0.8473) * 0.17
    return np.array([1.0 - 0.3437 * erf(x) for x in shades.ravel().tolist()]).reshape(mass.shape)


class Window(KeepsState):
    """The window of one scanner. mass: of the dust before each beam [g/m2], (n,)."""

    kept: ClassVar[tuple[str, ...]] = ("mass", "_t", "_place", "_warned")

    def __init__(self, params: Params, count: int) -> None:
        self.params, self._count = params, count
        self.reset()

    def reset(self) -> None:
        """As at the start of a run."""
        self.mass = np.full(self._count, self.params.dust_g_m2)
        self._t, self._place = 0, np.full(3, np.nan)
        self._warned: dict[str, float] = {}

    def step(self, t: int, field: Field, place: F64, directions: F64) -> F64:
        """Let dust settle up to t [ns]: light that comes through before each beam, one way (n,).

        place: of the scanner, world (3,); directions: of its beams (n, 3)
        """
        p, dt, weather = self.params, (t - self._t) / NS, field.weather
        last, self._place = self._place, place
        if dt > 0.0 and weather is not None and not np.isnan(last).any():
            air = weather.at(t)
            ground = float(field.ground_height(place[0], place[1]))
            here = np.array([[place[0], place[1], max(place[2] - ground, 0.0)]])
            middle = PLANT[1]
            thick = air.dust / middle.extinction  # [kg/m3]
            falling = thick * fall_speed(middle.diameter, middle.density)  # [kg/(m2 s)]
            for puffs in field.plumes.values():
                packed, per_mass, speed = puffs.packed(), puffs.rows[:, 5], puffs.rows[:, 6]
                packed[:, 5] /= per_mass
                thick += float(extinction_at(packed, here)[0])
                packed[:, 5] *= speed
                falling += float(extinction_at(packed, here)[0])
            against = -product(directions, np.array([*air.wind, 0.0]) - (place - last) / dt)
            carried = p.impaction_percent * PERCENT * thick * np.maximum(against, 0.0)
            self.mass += dt / GRAM * (p.fall_percent * PERCENT * falling + carried)
            self.mass *= 0.5 ** (air.rain * dt / HOUR / p.rinse_mm)
        if any(self._t < wiped * NS <= t for wiped in p.wiped_s):
            self.mass[:] = 0.0
        self._t = t
        through = transmission(self.mass)
        worst = float(through.min()) / PERCENT
        for state, limit in (("warning", p.warning_percent), ("error", p.error_percent)):
            if worst < limit:
                self._warned.setdefault(state, t / NS)
        return through

    @property
    def notes(self) -> list[str]:
        """The warnings that the scanner gave."""
        return [f"lidar: {state} of its dirty window from {t:.0f} s on" for state, t in self._warned.items()]
