"""Speed level `feed_rate`: constant measured throughput, by a PI law on the speed.

It sees a change only after the crop has been cut and has come to the sensor in the feeder house (1.5-3 s).
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.speed._target import Common, has_crop, ramped, room
from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.setup import ControlSetup
from swath.core.signals import EngineState, FeedReading, SpeedCommand
from swath.core.units import KMH


@dataclass(frozen=True, kw_only=True)
class Params(Common):
    """gain: of the free share on the speed; reset_s: time of the integration."""

    gain: Annotated[float, Ge(0), Le(5)] = 0.4
    reset_s: Annotated[float, Gt(0), Le(100)] = 6.0


class FeedRate:
    """PI in its velocity form: the command itself is the integral, so ramps and bounds cannot wind it up."""

    inputs = (Port("feed", FeedReading, optional=True), Port("engine", EngineState, optional=True))
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params

    def reset(self, stream: Stream) -> Outputs:
        """Entry speed."""
        self._speed = self._p.entry_speed_kmh * KMH
        self._before: float | None = None
        return {"command": SpeedCommand(0, self._speed)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The next command, valid at t + dt."""
        p, h = self._p, dt / NS
        free = room(p, inputs["feed"], inputs["engine"])
        if free is None or not has_crop(p, inputs["feed"]):
            wanted, self._before = p.entry_speed_kmh * KMH, None
        else:
            before = free if self._before is None else self._before
            wanted = self._speed * (1.0 + p.gain * (free - before) + h / p.reset_s * free)
            self._before = free
        self._speed = ramped(p, self._speed, wanted, h)
        return {"command": SpeedCommand(t + dt, self._speed)}

    def save(self) -> State:
        """The command and the last error."""
        return {"speed": self._speed, "before": self._before}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._speed, self._before = state["speed"], state["before"]


LEVEL = Level(
    FeedRate,
    Params,
    summary="constant measured throughput, held back by the engine's load",
    cost="5 us per step",
    tolerance="no error in steady state; late by the way from the knife to the sensor",
)
