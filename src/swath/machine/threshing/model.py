"""Threshing level `model`: drum and concave as two coupled exponentials over their length.

Grain in the ear u and free grain in the straw f over the length x:

    du/dx = -lambda u,   df/dx = lambda u - beta f,   separated = 1 - u - f

(Miu, Combine Harvesters, 2015; separation alone: Boettinger, Beck and Kutzbach). Both rates fall with the
layer.
"""

from dataclasses import dataclass
from math import exp, expm1
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.estimate import Estimate
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import MM, PERCENT, RPM
from swath.field.site_setup import SiteSetup
from swath.machine.drivetrain_sheet import drivetrain_of, threshing_of
from swath.machine.organ import (
    ACTUAL,
    ENGINE,
    SETTINGS,
    Organ,
    Setting,
    crop,
    given,
    moisture,
    ratio_of,
    sent,
)

Threshability = Annotated[float, Ge(0.2), Le(3)]
Power = Annotated[float, Ge(-5), Le(5)]


def coupled(ear: float, free: float, threshing: float, separation: float) -> tuple[float, float]:
    """(grain in the ear, free grain) after a length, from those before it; both rates times the length.

    Exact for any two rates, equal ones too.
    """
    gap = abs(separation - threshing)
    shared = 1.0 - 0.5 * gap if gap < 1e-6 else -expm1(-gap) / gap
    slower = exp(-min(separation, threshing))
    return ear * exp(-threshing), free * exp(-separation) + ear * threshing * slower * shared


@dataclass(frozen=True)
class Params:
    """Drum and concave: how rates and breakage change with settings and moisture. v is the speed of the drum
    over that of the manual for the crop, c the manual's clearance over the one that is set, M the moisture.
    What is not cited is an estimate, where nothing narrower is known within half to twice.

    threshability: factor on threshing and separation [1]; 1 = dry wheat
    threshing_speed: threshing goes with v to this power
    threshing_clearance: and with c to this one
    separation_speed: separation goes with v to this power
    separation_clearance: and with c to this one
    moisture_rate: both go with exp(-rate (M - 0.12)), M of the straw
    short_straw_speed: separation goes with exp(-this (v - 1)^2) above v = 1, where straw is broken up
    short_straw_clearance: and with exp(-this (c - 1)^2) below the manual's clearance
    short_speed: short straw on the shoe goes with v to this power
    short_clearance: and with c to this one
    ears_through_percent: share of the unthreshed grain that falls through the concave and so comes back
    broken_percent: grain broken at the manual's settings; none = the crop's own
    broken_factor: factor on it: the crops' own are known within half to twice
    broken_speed_m_s: change of the rim's speed in which breakage grows e-fold
    broken_clearance: breakage goes with c to this power
    broken_feed: and with 1 / feed to this one (a doubled feed broke 16 % less wheat, tehqeeqat 33395)
    broken_moisture_percent: moisture of the grain at which least breaks (impact damage has such a least in
        wheat and rape, Int. Agrophys. 21:299)
    broken_width_percent: distance from it at which twice as much does
    power_clearance: power of the drum goes with v and with c to this power
    blocks_at: straw in the drum over the nominal at which it blocks; a slower drum holds more
    speed_rpm_s: how fast the drum's speed is set
    opening_mm_s: how fast the concave is
    """

    threshability: Threshability = 1.0
    threshing_speed: Annotated[Power, Estimate(0.5, 1.5)] = 1.0
    threshing_clearance: Annotated[Power, Estimate(0.2, 1)] = 0.5
    separation_speed: Annotated[Power, Estimate(0, 1)] = 0.5
    separation_clearance: Annotated[Power, Estimate(0, 0.6)] = 0.3
    moisture_rate: Annotated[float, Ge(0), Le(20), Estimate(2, 4)] = 2.5
    short_straw_speed: Annotated[float, Ge(0), Le(50), Estimate(2, 8)] = 4.0
    short_straw_clearance: Annotated[float, Ge(0), Le(50), Estimate(0.5, 2)] = 1.0
    short_speed: Annotated[Power, Estimate(0.75, 3)] = 1.5
    short_clearance: Annotated[Power, Estimate(0.15, 0.6)] = 0.3
    ears_through_percent: Annotated[float, Ge(0), Le(100), Estimate(5, 20)] = 10.0
    broken_percent: Annotated[float, Ge(0), Le(50)] | None = None
    broken_factor: Annotated[float, Ge(0), Le(50), Estimate(0.5, 2)] = 1.0
    broken_speed_m_s: Annotated[float, Gt(0), Le(100), Estimate(2.5, 10)] = 5.0
    broken_clearance: Annotated[Power, Estimate(0.25, 1)] = 0.5
    broken_feed: Power = 0.25
    broken_moisture_percent: Annotated[float, Ge(0), Le(50)] = 24.0
    broken_width_percent: Annotated[float, Gt(0), Le(50), Estimate(4.5, 18)] = 9.0
    power_clearance: Annotated[Power, Estimate(0.1, 0.4)] = 0.2
    blocks_at: Annotated[float, Gt(0), Le(100), Estimate(1.5, 5)] = 2.5
    speed_rpm_s: Annotated[float, Gt(0), Le(1e4), Estimate(10, 40)] = 20.0
    opening_mm_s: Annotated[float, Gt(0), Le(1e3), Estimate(0.5, 2)] = 1.0


def rate_factors(p: Params, v: float, c: float, moisture: float) -> tuple[float, float]:
    """Factors on the rates of threshing and separation. v, c, moisture of the straw: as in `Params`."""
    wet = exp(-p.moisture_rate * (moisture - 0.12))
    short = exp(-p.short_straw_speed * max(v - 1.0, 0.0) ** 2)
    short *= exp(-p.short_straw_clearance * max(c - 1.0, 0.0) ** 2)
    threshing = v**p.threshing_speed * c**p.threshing_clearance * wet
    return threshing, v**p.separation_speed * c**p.separation_clearance * wet * short


class Drum(Organ):
    """Threshes what comes from feeder and returns; all of their grain counts as unthreshed.

    Half of what falls through beside grain is chaff, half short straw at the manual's settings.
    """

    kept = ("_set",)
    inputs = (crop("fed"), crop("back"), ENGINE, SETTINGS)
    outputs = (*given("over", "through"), ACTUAL)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        drivetrain = drivetrain_of(setup.machine)
        self._p, self._d = params, threshing_of(setup.machine)
        self._work = drivetrain.consumers.drum_work
        self._set = Setting(setup, drum=params.speed_rpm_s * RPM, concave=params.opening_mm_s * MM)
        self._rim = self._set.own["drum"] * setup.machine.works.radius
        own, crop_work = params.broken_percent, self._set.crop
        self._broken = params.broken_factor * (crop_work.broken if own is None else own * PERCENT)

    def start(self) -> None:
        """Settings as they are first wanted."""
        self._set.clear()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Thresh what came within dt; nothing stays in it."""
        h, came, p, ratio = dt / NS, (*inputs["fed"], *inputs["back"]), self._p, ratio_of(inputs)
        s = self._set.over_own(inputs, h)
        v, c, wet = s["drum"], 1.0 / s["concave"], moisture(inputs["fed"])
        grain_moisture, straw_moisture = wet
        grain = mog = broken = 0.0
        for stream in came:
            grain, mog, broken = grain + stream.grain, mog + stream.mog, broken + stream.broken
        layer = mog / h / self._d.straw / max(ratio, 0.05)
        ear, free = self._left(grain, layer, ratio, rate_factors(p, v, c, straw_moisture))
        hit = self.breakage(v * ratio, c, layer, grain_moisture)
        broken_share = (broken + (grain - broken) * hit) / grain if grain > 0.0 else 0.0
        chaff = 0.5 * (mog * self._d.chaff)
        short = min(chaff * (v**p.short_speed * c**p.short_clearance), mog - chaff)
        fallen, ears = grain - ear - free, ear * (p.ears_through_percent * PERCENT)
        power = self._work * ((grain + mog) / h) * v * c**p.power_clearance
        over = [ear - ears, free, free * broken_share, mog - (chaff + short), 0.0, 0.0]
        through = [ears, fallen, fallen * broken_share, 0.0, short, chaff]
        return {
            "over": sent(t + dt, h, over, wet),
            "through": sent(t + dt, h, through, wet),
            "work": self.work(
                t + dt, h, grain, mog, power=power, blockage=layer / max(v, 0.01) / p.blocks_at
            ),
            **self._set.moved(t + dt),
        }

    def breakage(self, v: float, c: float, layer: float, moisture: float) -> float:
        """Share of the grain that the drum breaks. v, c: as in `Params`; layer: over the nominal one."""
        p = self._p

        def damage(m: float) -> float:
            return 1.0 + ((m / PERCENT - p.broken_moisture_percent) / p.broken_width_percent) ** 2

        wet = damage(moisture) / damage(self._set.crop.moisture)
        fed = max(layer, 0.05) ** -p.broken_feed
        speed = exp(min(self._rim * (v - 1.0) / p.broken_speed_m_s, 30.0))
        return min(self._broken * speed * float(c**p.broken_clearance * fed * wet), 1.0)

    def _left(
        self, grain: float, layer: float, ratio: float, factors: tuple[float, float]
    ) -> tuple[float, float]:
        """Grain in the ear and free grain in the straw behind the concave [kg]."""
        d, threshability = self._d, self._p.threshability * ratio
        scale = threshability * max(layer, 1e-3) ** -d.drum_exponent
        threshing, separation = d.drum_threshing * scale, d.drum_separation * scale
        return coupled(grain, 0.0, threshing * factors[0], separation * factors[1])


class IdealDrum(Drum):
    """All grain is threshed and falls through the concave."""

    def _left(
        self, grain: float, layer: float, ratio: float, factors: tuple[float, float]
    ) -> tuple[float, float]:
        return 0.0, 0.0


LEVEL = Level(
    Drum,
    Params,
    summary="drum and concave: threshing and separation as coupled exponentials of the layer",
    cost="about 15 us per step",
    tolerance="equal to the closed forms",
    numbers=("threshing", "power"),
)
PRESETS = {
    "ideal": LEVEL.preset("all grain is threshed and falls through", "10 us", IdealDrum, threshability=1.0)
}
