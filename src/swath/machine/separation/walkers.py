"""Separation level `walkers`: free grain falls out of the straw on shaken walkers; nothing more is threshed.

    free = free_0 e^-k,   k = k_n (layer)^-n,   as Gregory and Fedler, Beck, and Boettinger describe it

At 2.08 kg of straw per second and metre 3 % of the grain that came in reaches the last of four sections,
k 1.17 in each (Steponavicius et al.; 9.8 % of water). Best the crank turns at a Froude number of 2.58.
"""

from dataclasses import dataclass
from math import exp
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Port
from swath.core.estimate import Estimate
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.machine import SLOPES
from swath.machine.organ import ratio_of
from swath.machine.separation.model import Params as RotorParams
from swath.machine.separation.model import Passage, Rotors
from swath.signals import MachineState

Number = Annotated[float, Ge(0), Le(50)]


@dataclass(frozen=True)
class Params:
    """Walkers. What is not cited is an estimate.

    threshability: factor on the separation [1]; 1 = dry wheat
    moisture_rate: separation goes with exp(-rate (M - 0.12)), M of the straw
    short_straw_speed: and with exp(-this (v - 1)^2) above the manual's speed of the drum, v over it
    short_straw_clearance: and so with its clearance
    crank_rad_s: speed of the crank; 22.5 rad/s is best at a radius of 50 mm
    crank_width_rad_s: at 21.5 rad/s 15 % less is separated: distance from the best at which it is 1/e
    side_slope: how much less is separated per slope of 1; 1.2 to 1.5 times the loss at 10 %
    """

    threshability: Annotated[float, Gt(0.1), Le(3)] = 1.0
    moisture_rate: Annotated[Number, Estimate(2, 4)] = 2.5
    short_straw_speed: Annotated[Number, Estimate(2, 8)] = 4.0
    short_straw_clearance: Annotated[Number, Estimate(0.5, 2)] = 1.0
    crank_rad_s: Annotated[float, Gt(0), Le(100)] = 22.5
    crank_width_rad_s: Annotated[float, Gt(0), Le(100)] = 2.48
    side_slope: Annotated[Number, Estimate(0.4, 0.9)] = 0.6


BEST = 22.5  # speed of a crank of 50 mm at a Froude number of 2.58 [rad/s]


class Walkers(Rotors):
    """The rate, its exponent, and the time on them are those of the rotors in the data sheet."""

    inputs = (*Rotors.inputs, Port("state", MachineState))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(RotorParams(params.threshability), setup)
        self._w = params

    def _passage(self, inputs: Inputs, h: float, straw_moisture: float) -> Passage:
        w, s = self._w, self._set.over_own(inputs, h)
        wet = exp(-w.moisture_rate * (straw_moisture - 0.12))
        short = w.short_straw_speed * max(s["drum"] - 1.0, 0.0) ** 2
        short += w.short_straw_clearance * max(1.0 / s["concave"] - 1.0, 0.0) ** 2
        crank = w.crank_rad_s * ratio_of(inputs)
        shaken = exp(-(((crank - BEST) / w.crank_width_rad_s) ** 2))
        _, side, up = map(float, inputs["state"].pose.numbers[1][2])
        level = max(1.0 - w.side_slope * abs(side / up), 0.1)
        wet *= self._set.crop.walkers
        return Passage(threshing=0.0, separation=wet * exp(-short) * shaken * level)


LEVEL = Level(
    Walkers,
    Params,
    summary="straw walkers: separation that falls with the layer, the slope and a crank off its best speed",
    cost="about 35 us per step",
    tolerance="equal to the closed form",
    numbers=("transport", "threshing", "power"),
    checked=SLOPES[:1],
)
