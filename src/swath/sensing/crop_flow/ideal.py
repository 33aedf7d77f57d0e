"""Crop flow level `ideal`: every sensor reads the truth at once."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.signals import FeedReading, LossReading, MachineLoad, YieldReading


@dataclass(frozen=True)
class Params:
    """moisture_percent: water in the grain, share of the wet mass; 12-16 % at harvest."""

    moisture_percent: Annotated[float, Ge(0), Le(50)] = 14.0


class IdealCropFlow:
    """Feeder layer, yield, moisture, tank level and losses as they are."""

    inputs = (Port("load", MachineLoad),)
    outputs = (Port("feed", FeedReading), Port("grain", YieldReading), Port("loss", LossReading))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._moisture = params.moisture_percent * PERCENT

    def reset(self, stream: Stream) -> Outputs:
        """Nothing flows."""
        return self._readings(0, MachineLoad(0, *[0.0] * 7))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The flows at t + dt."""
        return self._readings(t + dt, inputs["load"])

    def save(self) -> State:
        """Nothing to keep."""
        return {}

    def load(self, state: State) -> None:
        """Nothing to restore."""

    def _readings(self, t: int, load: MachineLoad) -> Outputs:
        return {
            "feed": FeedReading(t, load.feeder_flow),
            "grain": YieldReading(t, load.grain_flow, self._moisture, load.tank_level),
            "loss": LossReading(t, load.threshing_loss + load.separation_loss, load.cleaning_loss),
        }


LEVEL = Level(
    IdealCropFlow,
    Params,
    summary="flows, moisture, tank level and losses as they are",
    cost="10 us per sample",
    tolerance="exact",
)
