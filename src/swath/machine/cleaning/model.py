"""Cleaning level `model`: losses of a shoe over its air and its load, with the sieves as they are set.

Too much air blows grain out, too little lets it ride over: as Craessaerts et al. 2010 (Biosyst. Eng. 106:97)
found the losses over the load, U-shaped. With x the load over the crop's nominal one less 1 (geometric mean
of all that is on it and of what is not grain), u the speed of the air against the crop's best in units of its
width, s the sieve over the manual's:

    lost = l / 2 (exp(u - h x) + exp(g x - u) / s_upper^2),   u = (v - v_best) / width
    v = v_best fan (1 - 2 % per mm that the upper sieve is wider)
"""

from dataclasses import dataclass
from math import exp, sqrt
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.estimate import Estimate
from swath.core.registry import Level
from swath.core.units import MM, PERCENT, RPM
from swath.field.site_setup import SiteSetup
from swath.machine.cleaning import overload
from swath.machine.cleaning.overload import RETURNS_MAX, Shares, Shoe, shoe_load
from swath.machine.drivetrain_sheet import threshing_of
from swath.machine.organ import ACTUAL, SETTINGS, Setting, ratio_of
from swath.signals.settings import CROPS, SIEVE_AIR

Rate = Annotated[float, Ge(0), Le(50)]


@dataclass(frozen=True)
class Params:
    """Fan and sieves. All are estimates, where nothing narrower is known within half to twice.

    blown_out: h, how much less is blown out with more load
    ridden_over: g, how much more rides over with more load; 4.6 doubles it over 15 % more load
    pressure_percent_mm: air lost per mm that the upper sieve is wider than the manual's (opening a sieve
        lowers the pressure, John Deere OMDXE11330)
    upper_power: grain that rides over goes with the upper sieve to minus this power
    returns_air_m_s: change of the air in which the returns grow e-fold, in wheat; as the crop's width
    returns_lower: returns go with what is not grain on the shoe, and with the lower sieve to minus this power
    returns_upper: and with the upper sieve to this one
    tank_mog_percent: material other than grain in the tank, over the grain, at the manual's settings; 0.6 was
        found in wheat of Kansas, 1.7 to 2.1 behind a controlled shoe
    mog_air_m_s: change of the air in which it falls e-fold, likewise
    mog_load: it goes with what is not grain on the shoe to this power, and with the lower sieve
    fan_share_percent: of the shoe's power, goes with the fan's speed to the third power
    speed_rpm_s: how fast the fan is set
    opening_mm_s: how fast a sieve is
    """

    blown_out: Annotated[Rate, Estimate(1, 4)] = 2.0
    ridden_over: Annotated[Rate, Estimate(1, 5)] = 4.6
    pressure_percent_mm: Annotated[float, Ge(0), Le(20), Estimate(1, 4)] = SIEVE_AIR
    upper_power: Annotated[Rate, Estimate(1, 4)] = 2.0
    returns_air_m_s: Annotated[float, Gt(0), Le(100), Estimate(1, 4)] = 2.0
    returns_lower: Annotated[Rate, Estimate(0.25, 1)] = 0.5
    returns_upper: Annotated[Rate, Estimate(0.75, 3)] = 1.5
    tank_mog_percent: Annotated[float, Ge(0), Le(20), Estimate(0.25, 2)] = 0.5
    mog_air_m_s: Annotated[float, Gt(0), Le(100), Estimate(0.75, 3)] = 1.5
    mog_load: Annotated[Rate, Estimate(0.25, 1)] = 0.5
    fan_share_percent: Annotated[float, Ge(0), Le(100), Estimate(25, 75)] = 50.0
    speed_rpm_s: Annotated[float, Gt(0), Le(1e4), Estimate(10, 40)] = 20.0
    opening_mm_s: Annotated[float, Gt(0), Le(1e3), Estimate(0.5, 2)] = 1.0


class AirShoe(Shoe):
    """A shoe with a fan and two sieves."""

    kept = (*Shoe.kept, "_set")
    inputs = (*Shoe.inputs, SETTINGS)
    outputs = (*Shoe.outputs, ACTUAL)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        p = self._p = params
        d = threshing_of(setup.machine)
        self._mog = d.straw * d.chaff  # on the shoe at the nominal flow [kg/s]
        sieve = p.opening_mm_s * MM
        self._set = Setting(setup, fan=p.speed_rpm_s * RPM, upper=sieve, lower=sieve)

    def start(self) -> None:
        """Empty it; settings as they are first wanted."""
        super().start()
        self._set.clear()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Clean what leaves the sieves within dt."""
        return {**super().step(t, dt, inputs), **self._set.moved(t + dt)}

    def _shares(self, flow: float, mog: float, h: float, inputs: Inputs) -> Shares:
        p, s, crop = self._p, self._set.over_own(inputs, h), self._set.crop
        load = shoe_load(flow, self._c, inputs["state"])
        light = load * (max(mog, 0.0) / self._mog) * (self._c.flow / flow) if flow > 0.0 else 0.0
        fan = s["fan"] * ratio_of(inputs)
        wider = (s["upper"] - 1.0) * self._set.own["upper"] / MM
        faster = crop.air * (fan * (1.0 - p.pressure_percent_mm * PERCENT * wider) - 1.0)  # [m/s]
        fan_share = p.fan_share_percent * PERCENT
        self._effort = 1.0 - fan_share + fan_share * fan**3
        widths = crop.width / CROPS["wheat"].width  # of kernels that other air carries
        back = self._c.returns * light * bounded_exp(faster / (p.returns_air_m_s * widths))
        back *= s["lower"] ** -p.returns_lower * s["upper"] ** p.returns_upper
        mog = p.tank_mog_percent * PERCENT * bounded_exp(-faster / (p.mog_air_m_s * widths))
        lost = shoe_loss(p, self._c.loss, sqrt(load * light) / crop.load, faster / crop.width, s["upper"])
        return Shares(lost, min(back, RETURNS_MAX), mog * s["lower"] * light**p.mog_load)


def bounded_exp(x: float) -> float:
    """exp(x), x at most 30 from 0."""
    return exp(min(max(x, -30.0), 30.0))


def shoe_loss(p: Params, least: float, load: float, air: float, upper: float = 1.0) -> float:
    """Share of the grain that goes over the rear.

    least: at the nominal load and the best air; load: over the nominal one; air: u as above; upper: opening
    of the upper sieve over the manual's
    """
    x = load - 1.0
    blown, ridden = bounded_exp(air - p.blown_out * x), bounded_exp(p.ridden_over * x - air)
    return min(0.5 * least * float(blown + ridden * upper**-p.upper_power), 1.0)


LEVEL = Level(
    AirShoe,
    Params,
    summary="a shoe with fan and sieves: losses over air and load, returns, what is in the tank beside grain",
    cost="about 25 us per step",
    tolerance="equal to its formula; its numbers are estimates with bands",
    numbers=("transport", "cleaning", "power"),
    checked=overload.LEVEL.checked,
)
