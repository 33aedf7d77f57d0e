"""Drive at one speed."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import KMH
from swath.signals import Odometry, SpeedCommand
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """speed_kmh: wanted forward speed; a combine with a 12 m header in wheat works at 4 to 8 km/h."""

    speed_kmh: Annotated[float, Ge(0), Le(40)] = 7.0


class ConstantSpeed(KeepsState):
    """The same forward speed at all times."""

    inputs = (Port("odometry", Odometry, optional=True),)
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._speed = params.speed_kmh * KMH

    def reset(self, stream: Stream) -> Outputs:
        """The command at t = 0."""
        return {"command": SpeedCommand(0, self._speed)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The same command, valid at t + dt."""
        return {"command": SpeedCommand(t + dt, self._speed)}


LEVEL = Level(
    ConstantSpeed,
    Params,
    summary="one speed at all times",
    cost="none",
    tolerance="exact",
)
