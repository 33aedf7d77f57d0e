"""Feeder level `model`: header and feeder house delay what was cut; little crop takes longer.

The header delays by delay_n (F / F_n)^-exponent, the feeder house is plug flow; docs/explanation/machine.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum

from swath.core.asked import replaced
from swath.core.component import Inputs, Outputs, Port
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.moisture import Percent
from swath.field.site_setup import SiteSetup
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.organ import ENGINE, JOINED, Organ, given, ratio_of
from swath.machine.transport import Conveyor, Masses, Mixer, flow_delay
from swath.signals import CropFlow, CropStream

FLOW = Port("flow", CropFlow, history=True)


@dataclass(frozen=True)
class Params:
    """What the crop is like that comes in; none = as the stand is.

    grain_moisture_percent: water in the grain, share of the wet mass
    straw_moisture_percent: water in the straw, share of the wet mass
    """

    grain_moisture_percent: Percent | None = None
    straw_moisture_percent: Percent | None = None


class Feeder(Organ):
    """Mixing over the header's width, plug flow to the feeder house and through it."""

    kept = ("_spread", "_header", "_feeder")
    inputs = (FLOW, ENGINE)
    outputs = given("fed")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        drivetrain = drivetrain_of(setup.machine)
        t = self._transport = drivetrain.transport
        self._consumers, self._width = drivetrain.consumers, setup.machine.header_width
        own = {name: percent for name, percent in vars(params).items() if percent is not None}
        self._moisture = replaced(setup.field.moisture, **own)
        self._spread = Mixer(2)
        self._header = Conveyor(1.0, 2, joined=JOINED)
        self._feeder = Conveyor(t.feeder, 2, joined=JOINED)

    def start(self) -> None:
        """Empty it."""
        for part in (self._spread, self._header, self._feeder):
            part.clear()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Move everything on by dt."""
        h = dt / NS
        masses = [fsum(f.grain for f in inputs["flow"]), fsum(f.straw for f in inputs["flow"])]
        gathered, fed = self._pass_on(masses, h, ratio_of(inputs))
        c = self._consumers
        power = c.header_width * self._width + c.header_work * (fsum(masses) / h)
        stream = CropStream(t + dt, unthreshed=fed[0], straw=fed[1], dt=h, **self._moisture.at(t + dt))
        return {"fed": stream, "work": self.work(t + dt, h, *gathered, power=power)}

    def held(self) -> Sequence[Sequence[float]]:
        """Grain and straw in header and feeder house [kg]."""
        return [part.held() for part in (self._spread, self._header, self._feeder)]

    def _pass_on(self, masses: Masses, h: float, ratio: float) -> tuple[Masses, Masses]:
        """Grain and straw [kg] into the feeder house and out of it."""
        t = self._transport
        spread = self._spread.advance(masses, h, t.header_spread)
        delay = flow_delay(fsum(self._header.held()) + fsum(spread), t.header, t.feed, t.exponent)
        gathered = self._header.advance(spread, h * ratio / delay)
        return gathered, self._feeder.advance(gathered, h * ratio)


class IdealFeeder(Feeder):
    """At once."""

    def _pass_on(self, masses: Masses, h: float, ratio: float) -> tuple[Masses, Masses]:
        return masses, masses


LEVEL = Level(
    Feeder,
    Params,
    summary="header and feeder house: mixing over the width, delays that grow with little crop",
    cost="about 20 us per step",
    tolerance="mean delays exact at a steady flow",
    numbers=("transport", "power"),
)
PRESETS = {"ideal": LEVEL.preset("what the header takes in is at the drum at once", "10 us", IdealFeeder)}
