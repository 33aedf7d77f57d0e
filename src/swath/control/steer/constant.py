"""Steering level `constant`: one path curvature at all times, whatever lies ahead."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import SteerCommand
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """curvature_per_m: of the path [1/m], > 0 to the left; 0 drives straight on."""

    curvature_per_m: Annotated[float, Ge(-0.5), Le(0.5)] = 0.0


class ConstantSteer(KeepsState):
    """The same curvature at all times: a vehicle that only drives, and step responses."""

    inputs: tuple[Port, ...] = ()
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._curvature = params.curvature_per_m

    def reset(self, stream: Stream) -> Outputs:
        """The command at t = 0."""
        return {"command": SteerCommand(0, self._curvature, True)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Send the same command, valid at t + dt."""
        return {"command": SteerCommand(t + dt, self._curvature, True)}


LEVEL = Level(
    ConstantSteer,
    Params,
    summary="one path curvature at all times, open loop",
    cost="2 us per step",
    tolerance="exact",
)
