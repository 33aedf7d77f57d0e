"""Dust level `plume`: puffs from header, chopper and wheels that drift with the wind of `field.weather`.

How much dust a combine makes is hardly known: of wheat 0.49 kg/ha (EMEP/EEA guidebook) to 6.5 kg/ha
(California ARB, section 7.5) are given for what is finer than 10 um; four times as much in all, of 11 t/ha
that go through, is 0.2 to 2.4 g/kg. Wetter straw makes less: exp(-(M - dry) / damping), M its moisture. On
farms half of the mass is finer than 49 um (Nieuwenhuijsen 1998, aerodynamic): 43 um of plant dust of 1,300
kg/m3. All keys but the class of the air are estimates.
"""

from dataclasses import dataclass, replace
from math import exp, fsum
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.estimate import Estimate
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import GRAM, PERCENT
from swath.field.plume import PLANT, Puffs, Stability
from swath.field.site_setup import SiteSetup
from swath.signals import CropFlow, MachineState

Percent = Annotated[float, Ge(0), Le(100)]
Height = Annotated[float, Ge(0), Le(6)]


@dataclass(frozen=True)
class Params:
    """How much dust, and how it spreads.

    grams_per_kg: dust of each kg of crop that goes through, at straw_dry_percent
    straw_dry_percent: straw moisture that grams_per_kg is for
    straw_damping_percent: further moisture that leaves 1 / e of the dust
    header_percent: share of it that rises at the header; the rest leaves with the straw
    header_height_m: where the header's rises, above the ground
    chopper_height_m: where that which leaves with the straw rises
    wheel_height_m: where that of the wheels rises
    fine_percent: share of its mass that is of 10 um
    coarse_percent: share of its mass that is of 50 um; the rest is of 30 um
    soil_g_per_m: dust that the wheels raise on each metre
    stability: Pasquill's class of the air: A very unstable, B or C at noon of a harvest's day, D or E in its
        evening, F very stable
    start_m: spread of a puff where it leaves, one sigma: the machine's wake
    puff_s: time between puffs
    """

    grams_per_kg: Annotated[float, Ge(0), Le(50), Estimate(0.2, 2.4, "EMEP/EEA and California ARB")] = 0.6
    straw_dry_percent: Annotated[Percent, Estimate(6, 10)] = 8.0
    straw_damping_percent: Annotated[float, Gt(0), Le(100), Estimate(3, 10)] = 5.0
    header_percent: Annotated[Percent, Estimate(10, 60)] = 30.0
    header_height_m: Annotated[Height, Estimate(0.4, 1.5)] = 0.8
    chopper_height_m: Annotated[Height, Estimate(1, 2.5)] = 1.5
    wheel_height_m: Annotated[Height, Estimate(0.1, 0.8)] = 0.3
    fine_percent: Annotated[Percent, Estimate(10, 40)] = 25.0
    coarse_percent: Annotated[Percent, Estimate(20, 60)] = 35.0
    soil_g_per_m: Annotated[float, Ge(0), Le(1000), Estimate(0.05, 5)] = 0.5
    stability: Stability = "C"
    start_m: Annotated[float, Ge(0.2), Le(20), Estimate(2, 3)] = 2.5
    puff_s: Annotated[float, Gt(0), Le(10)] = 1.0

    def __post_init__(self) -> None:
        if self.fine_percent + self.coarse_percent > 100.0:
            expected = f"expected at most {100.0 - self.fine_percent:g}, what fine_percent leaves"
            raise InputError("coarse_percent", self.coarse_percent, expected)


class Plume(KeepsState):
    """Dust of one machine: its puffs are the field's. raised: so far [kg]."""

    kept: ClassVar[tuple[str, ...]] = ("puffs", "raised", "_waiting", "_since", "_gone")
    inputs = (Port("state", MachineState), Port("flow", CropFlow, history=True, optional=True))
    outputs = ()

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params, self.setup = params, setup
        weather = setup.field.weather
        if weather is None:
            raise InputError("level", "plume", "expected field.weather with its wind")
        self.weather = weather
        shares = (
            params.fine_percent,
            100.0 - params.fine_percent - params.coarse_percent,
            params.coarse_percent,
        )
        self.grains = [replace(g, share=s * PERCENT) for g, s in zip(PLANT, shares, strict=True)]
        self.puffs = setup.field.plumes[setup.name] = Puffs(params.stability, params.start_m)

    def reset(self, stream: Stream) -> Outputs:
        """Clear air."""
        self.puffs.rows = self.puffs.rows[:0]
        self.raised, self._since, self._gone = 0.0, 0, 0.0
        self._waiting = [0.0, 0.0]  # at the header, at the chopper [kg]
        return {}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What floats drifts on; what was raised since the last puffs makes new ones."""
        p, state, now = self.params, inputs["state"], t + dt
        self.puffs.drift(dt / NS, self.weather.at(now).wind)
        moisture = self.setup.field.moisture.of_straw(now)
        beyond = moisture - p.straw_dry_percent * PERCENT
        dusty = p.grams_per_kg * GRAM * exp(-beyond / (p.straw_damping_percent * PERCENT))
        made = dusty * fsum(flow.grain + flow.straw for flow in inputs.get("flow") or ())
        share = p.header_percent * PERCENT
        self._waiting = [self._waiting[0] + share * made, self._waiting[1] + (1.0 - share) * made]
        self._since += dt
        if self._since < round(p.puff_s * NS):
            return {}
        rear, _, _, _, _ = self.setup.machine.body
        soil = p.soil_g_per_m * GRAM * max(state.distance - self._gone, 0.0)
        header_x, header_y = self.setup.machine.knife_x, self.setup.machine.header_y
        for (x, y, height), mass in (
            ((header_x, header_y, p.header_height_m), self._waiting[0]),
            ((rear, 0.0, p.chopper_height_m), self._waiting[1]),
            ((0.0, 0.0, p.wheel_height_m), soil),
        ):
            if mass > 0.0:
                east, north, _ = state.pose.point(x, y, 0.0)
                self.puffs.emit((east, north, height), mass, self.grains)
                self.raised += mass
        self._since, self._waiting, self._gone = 0, [0.0, 0.0], state.distance
        return {}


LEVEL = Level(
    Plume,
    Params,
    "puffs from header, chopper and wheels that drift, grow and settle",
    cost="0.1 ms per step with 200 puffs; a scan of 381 beams 1 ms more, a picture 50 ms",
    tolerance="far away within 1 % of Briggs' plume and 2 % of its optical depth, tests/field/test_plume.py",
)
