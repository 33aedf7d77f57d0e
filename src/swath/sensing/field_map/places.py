"""What every field map level shares: places ahead, where the machine takes itself to be, the true crop."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from math import cos, isfinite, sin
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.crop_sheet import load_crop
from swath.field.field import Field
from swath.field.site_setup import SiteSetup
from swath.signals import F64, FieldMap, Fix, Odometry

ACROSS = np.array([-0.4, 0.0, 0.4])  # places across the header, in its widths
SAMPLES = 41  # of the true crop along each side of the square about the start
SQUARE_M = 400.0  # its side, over which mean and spread of the crop are taken


@dataclass(frozen=True)
class PlaceParams:
    """Places ahead of the knife that a map is asked for.

    reach_m: farthest place ahead of the knife
    step_m: distance between the places
    antenna_x_m: place of the receiver ahead of the fixed axle, as the fitter measured it
    antenna_y_m: place of the receiver leftward, as the fitter measured it
    """

    reach_m: Annotated[float, Gt(0), Le(500)] = 40.0
    step_m: Annotated[float, Ge(0.5), Le(50)] = 2.0
    antenna_x_m: Annotated[float, Ge(-30), Le(30)] = 1.0
    antenna_y_m: Annotated[float, Ge(-30), Le(30)] = 0.0


@dataclass(frozen=True)
class Answer:
    """What a map says: grain [kg/m2], its sd, age [s], each (n,) of points."""

    grain: F64
    sd: F64
    age: F64


class LocatedMap(KeepsState, ABC):
    """Looks up the map at the measured position. A level says what the map holds at points of the world."""

    inputs: tuple[Port, ...] = (Port("fix", Fix), Port("odometry", Odometry, optional=True))
    outputs = (Port("map", FieldMap),)
    kept: ClassVar[tuple[str, ...]] = ("_heading",)

    def __init__(self, params: PlaceParams, setup: SiteSetup) -> None:
        self._p, self._setup = params, setup
        machine = setup.machine
        count = max(int(params.reach_m / params.step_m), 1)
        steps = params.step_m * np.arange(1.0, count + 1.0)
        self._ahead: F64 = np.asarray(machine.knife_x + steps, dtype=np.float64)
        self._across = machine.header_y + machine.header_width * ACROSS
        self._heading = 0.0

    def reset(self, stream: Stream) -> Outputs:
        """Nothing known yet; the heading is that of the start until there is a course."""
        self._heading = self._setup.start.euler()[2]
        return {"map": self._silent(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What the map says at t + dt."""
        here = self.place(t + dt, inputs)
        return {"map": self._silent(t + dt) if here is None else self.sample(t + dt, *here)}

    def place(self, now: int, inputs: Inputs) -> tuple[float, float, float] | None:
        """x, y [m] of the fixed axle and heading [rad], as measured; None without a position."""
        fix: Fix | None = inputs["fix"]
        if fix is None or not fix.has_place:
            return None
        odometry: Odometry | None = inputs.get("odometry")
        if isfinite(fix.course):
            self._heading = fix.course
        speed = odometry.speed if odometry is not None else fix.speed if isfinite(fix.speed) else 0.0
        travel = speed * (now - fix.t) / NS - self._p.antenna_x_m
        c, s, aside = cos(self._heading), sin(self._heading), -self._p.antenna_y_m
        return fix.x + c * travel - s * aside, fix.y + s * travel + c * aside, self._heading

    def sample(self, t: int, x: float, y: float, heading: float) -> FieldMap:
        """The map ahead of a machine there."""
        c, s = cos(heading), sin(heading)
        u, v = np.meshgrid(self._ahead, self._across, indexing="ij")
        east, north = x + c * u - s * v, y + s * u + c * v
        found = self.look_up(t, east.ravel(), north.ravel(), heading)
        grain, sd, age = (a.reshape(u.shape) for a in (found.grain, found.sd, found.age))
        known = np.isfinite(grain)
        count = known.sum(axis=1)
        mean, spread, old = (
            np.where(count > 0, np.where(known, a, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
            for a in (grain, sd, age)
        )
        return FieldMap(t, self._ahead, mean, spread, old, self._boundary(x, y, c, s))

    @abstractmethod
    def look_up(self, t: int, x: F64, y: F64, heading: float) -> Answer:
        """What the map holds at points (n,) of the world."""

    def _boundary(self, x: float, y: float, c: float, s: float) -> float:
        region = self._setup.field.boundary
        if region is None:
            return float("nan")
        along = np.arange(0.0, float(self._ahead[-1]), 1.0)
        out = np.flatnonzero(~region.contains(x + c * along, y + s * along))
        return float(along[out[0]]) if len(out) else float("nan")

    def _silent(self, t: int) -> FieldMap:
        nothing = np.full(len(self._ahead), np.nan)
        return FieldMap(t, self._ahead, nothing, nothing, nothing, float("nan"))


@lru_cache(maxsize=4)
def _grain_mass(crop: str) -> float:
    """Grain of a mean stem of a crop [kg]."""
    yields = load_crop(crop).yields
    return 0.0 if yields is None else yields.grain_mass


def true_grain(field: Field, x: F64, y: F64) -> F64:
    """Grain that was grown at points of the world [kg/m2], 0 where nothing grows."""
    stems = np.where(field.stand.bare(x, y), 0.0, field.stand.density(x, y))
    inside = True if field.boundary is None else field.boundary.contains(x, y)
    grain: F64 = np.where(inside, np.nan_to_num(stems), 0.0) * _grain_mass(field.stand.crop)
    return grain


def mean_and_spread(field: Field, x: float, y: float) -> tuple[float, float]:
    """Mean and standard deviation [kg/m2] of what was grown about a place, where anything was."""
    line = np.linspace(-0.5, 0.5, SAMPLES) * SQUARE_M
    east, north = (a.ravel() for a in np.meshgrid(x + line, y + line))
    grain = true_grain(field, east, north)
    grown = grain[grain > 0.0]
    return (float(grown.mean()), float(grown.std())) if len(grown) else (0.0, 0.0)
