"""Crop flow level `ideal`: every sensor reads the truth at once."""

from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.signals import FeedReading, LossReading, MachineLoad, YieldReading


@dataclass(frozen=True)
class Params:
    """moisture_percent: water in the grain, share of the wet mass; 12-16 % at harvest."""

    moisture_percent: Annotated[float, Ge(0), Le(50)] = 14.0


class IdealCropFlow(KeepsState):
    """Feeder layer, yield, moisture, tank level and losses as they are."""

    inputs = (Port("load", MachineLoad),)
    outputs = (Port("feed", FeedReading), Port("grain", YieldReading), Port("loss", LossReading))

    def __init__(self, params: Any, setup: SiteSetup) -> None:
        self._moisture = params.moisture_percent * PERCENT

    def reset(self, stream: Stream) -> Outputs:
        """Nothing flows."""
        return self.readings(0, self.truth(MachineLoad(0, *[0.0] * 7)))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The flows at t + dt."""
        return self.readings(t + dt, self.truth(inputs["load"]))

    def truth(self, load: MachineLoad) -> list[float]:
        """Feed, grain [kg/s], moisture, tank level, losses of separation and of cleaning [kg/s]."""
        rotors = load.threshing_loss + load.separation_loss
        return [
            *(load.feeder_flow, load.grain_flow, self._moisture, load.tank_level),
            *(rotors, load.cleaning_loss),
        ]

    def readings(self, t: int, values: list[float]) -> Outputs:
        """The samples of six values in the order of `truth`."""
        feed, grain, moisture, tank, separation, cleaning = values
        return {
            "feed": FeedReading(t, feed),
            "grain": YieldReading(t, grain, moisture, tank),
            "loss": LossReading(t, separation, cleaning),
        }


LEVEL = Level(
    IdealCropFlow,
    Params,
    summary="flows, moisture, tank level and losses as they are",
    cost="10 us per sample",
    tolerance="exact",
)
