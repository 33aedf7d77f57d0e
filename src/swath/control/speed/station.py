"""Speed level `station`: keeps the place that `cooperate` wants.

The drive answers with a lag T: v' = (command - v) / T. The command V + T a + k d, with V and a of the wanted
place and d its distance ahead, leaves T d'' + d' + k d = 0.
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import KMH
from swath.signals import SpeedCommand
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """Keep the speed of the machine beside.

    gain_per_s: gain k of the distance
    lag_s: time constant T of the machine's own drive
    closing_m_s: greatest speed that is added or taken to close up
    speed_kmh: speed while there is no station
    """

    gain_per_s: Annotated[float, Gt(0), Le(5)] = 0.4
    lag_s: Annotated[float, Ge(0), Le(10)] = 1.0
    closing_m_s: Annotated[float, Gt(0), Le(5)] = 1.0
    speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0


class StationSpeed(KeepsState):
    """Never backwards: a place behind is waited for."""

    inputs = (Port("station", Wanted),)
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params

    def reset(self, stream: Stream) -> Outputs:
        """The speed without a station."""
        return {"command": SpeedCommand(0, self._p.speed_kmh * KMH)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The command at t + dt."""
        wanted: Wanted = inputs["station"]
        speed = self._p.speed_kmh * KMH
        if wanted.is_active:
            most = self._p.closing_m_s
            closing = min(max(self._p.gain_per_s * wanted.ahead, -most), most)
            speed = max(wanted.speed + self._p.lag_s * wanted.acceleration + closing, 0.0)
        return {"command": SpeedCommand(t + dt, speed)}


LEVEL = Level(
    StationSpeed,
    Params,
    summary="keeps a place beside another machine",
    cost="none",
    tolerance="against its differential equation within 2 cm",
)
