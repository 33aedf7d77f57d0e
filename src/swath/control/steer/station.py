"""Steering level `station`: along the path that `cooperate` wants, at the fixed axle of a tractor.

With e the distance to the path on the left and theta its direction against the machine, curvature
k = kappa + e / d^2 + 2 z theta / d gives e'' + 2 z e' / d + e / d^2 = 0 over the distance driven.
"""

from dataclasses import dataclass
from math import sin
from typing import Annotated

from annotated_types import Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG
from swath.signals import Odometry, SteerCommand
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup

DAMPING = 0.9
STEEPEST = 12.0 * DEG  # towards a path far aside


@dataclass(frozen=True)
class Params:
    """Steer to the station beside another machine.

    distance_m: least distance over which an error dies out
    time_s: that distance over the present speed
    """

    distance_m: Annotated[float, Gt(0.5), Le(100)] = 4.0
    time_s: Annotated[float, Gt(0), Le(20)] = 2.0


class StationSteer(KeepsState):
    """Straight on while there is no station."""

    inputs = (Port("station", Wanted), Port("odometry", Odometry))
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params

    def reset(self, stream: Stream) -> Outputs:
        """Straight on."""
        return {"command": SteerCommand(0, 0.0, True)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The command at t + dt."""
        wanted: Wanted = inputs["station"]
        if not wanted.is_active:
            return {"command": SteerCommand(t + dt, 0.0, True)}
        d = max(self._p.distance_m, self._p.time_s * inputs["odometry"].speed)
        most = 2.0 * DAMPING * d * sin(STEEPEST)
        left = min(max(wanted.left, -most), most)
        curvature = wanted.curvature + left / d**2 + 2.0 * DAMPING * wanted.heading / d
        return {"command": SteerCommand(t + dt, curvature, True)}


LEVEL = Level(
    StationSteer,
    Params,
    summary="along the path of a station beside another machine",
    cost="none",
    tolerance="against its differential equation within 2 cm",
)
