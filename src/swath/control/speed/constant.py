"""Drive at one speed, as long as the crop edge is seen."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.control.speed.guards import GUARD_INPUTS, Guarded, Guards
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import KMH
from swath.signals import Odometry, SpeedCommand
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params(Guarded):
    """speed_kmh: wanted forward speed; a combine with a 12 m header in wheat works at 4 to 8 km/h."""

    speed_kmh: Annotated[float, Ge(0), Le(40)] = 7.0


class ConstantSpeed(KeepsState):
    """The same forward speed wherever the edge is sure."""

    kept = ("_guard",)

    inputs = (Port("odometry", Odometry, optional=True), *GUARD_INPUTS)
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._speed = params.speed_kmh * KMH
        self._guard = Guards(params, setup.machine)

    def reset(self, stream: Stream) -> Outputs:
        """The command at t = 0."""
        self._guard.reset()
        return {"command": SpeedCommand(0, self._speed)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The command that is valid at t + dt."""
        speed = self._guard.limit(self._speed, inputs, dt)
        return {"command": SpeedCommand(t + dt, speed)}

    def end_reason(self, t: int) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self._guard.reason


LEVEL = Level(
    ConstantSpeed,
    Params,
    summary="one speed, less where the edge is not sure, none where it is lost",
    cost="10 us per step",
    tolerance="exact",
)
