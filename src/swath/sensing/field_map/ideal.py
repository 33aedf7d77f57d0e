"""Field map level `ideal`: what really was grown, at the true place."""

from dataclasses import dataclass

import numpy as np

from swath.core.component import Inputs, Port
from swath.core.registry import Level
from swath.sensing.field_map.places import Answer, LocatedMap, PlaceParams, true_grain
from swath.signals import F64, MachineState


@dataclass(frozen=True)
class Params(PlaceParams):
    """Beside the places nothing."""


class IdealMap(LocatedMap):
    """The truth of the field, cut or not."""

    inputs = (Port("state", MachineState),)

    def place(self, now: int, inputs: Inputs) -> tuple[float, float, float] | None:
        """Where the machine is."""
        state: MachineState = inputs["state"]
        x, y, _ = state.pose.position.tolist()
        return x, y, state.pose.euler()[2]

    def look_up(self, t: int, x: F64, y: F64, heading: float) -> Answer:
        """What was grown there."""
        return Answer(true_grain(self._setup.field, x, y), np.zeros(len(x)), np.zeros(len(x)))


LEVEL = Level(IdealMap, Params, "what really was grown ahead", cost="0.2 ms", tolerance="exact")
