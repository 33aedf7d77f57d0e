"""Dust level `plume`: puffs from header, chopper and wheels that drift with the wind of `field.weather`.

How much dust a combine makes is hardly known: of wheat 0.49 kg/ha (EMEP/EEA guidebook) to 6.5 kg/ha
(California ARB, section 7.5) are given for what is finer than 10 um; four times as much in all, of 11 t/ha
that go through, is 0.2 to 2.4 g/kg. Wetter straw makes less: exp(-(M - 8) / 5), M its moisture in percent,
estimated.
"""

from dataclasses import dataclass
from math import exp, fsum
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import GRAM, PERCENT
from swath.field.plume import Puffs, Stability
from swath.field.site_setup import SiteSetup
from swath.signals import CropFlow, MachineState

DRY, DAMPING = 0.08, 0.05  # straw moisture of `grams_per_kg`, and that which damps dust by e [E]
HEADER_HEIGHT, CHOPPER_HEIGHT, WHEEL_HEIGHT = 0.8, 1.5, 0.3  # where it leaves, above the ground [m] [E]


@dataclass(frozen=True)
class Params:
    """How much dust, and how it spreads.

    grams_per_kg: dust of each kg of crop that goes through, at 8 % of straw moisture
    header_percent: share of it that rises at the header; the rest leaves with the straw
    soil_g_per_m: dust that the wheels raise on each metre
    stability: Pasquill's class of the air: A very unstable, B or C at noon of a harvest's day, D or E in its
        evening, F very stable
    start_m: spread of a puff where it leaves, one sigma: the machine's wake
    puff_s: time between puffs
    """

    grams_per_kg: Annotated[float, Ge(0), Le(50)] = 0.6
    header_percent: Annotated[float, Ge(0), Le(100)] = 30.0
    soil_g_per_m: Annotated[float, Ge(0), Le(1000)] = 0.5
    stability: Stability = "C"
    start_m: Annotated[float, Ge(0.2), Le(20)] = 2.5
    puff_s: Annotated[float, Gt(0), Le(10)] = 1.0


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
        moisture = self.setup.field.moisture.at(now)["straw_moisture"]
        dusty = p.grams_per_kg * GRAM * exp(-(moisture - DRY) / DAMPING)
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
            ((header_x, header_y, HEADER_HEIGHT), self._waiting[0]),
            ((rear, 0.0, CHOPPER_HEIGHT), self._waiting[1]),
            ((0.0, 0.0, WHEEL_HEIGHT), soil),
        ):
            if mass > 0.0:
                east, north, _ = state.pose.point(x, y, 0.0)
                self.puffs.emit((east, north, height), mass)
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
