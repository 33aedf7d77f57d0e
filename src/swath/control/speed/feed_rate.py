"""Speed level `feed_rate`: constant measured throughput, by a PI law on the speed.

It sees a change only after the crop has been cut and has come to the sensor in the feeder house (1.5-3 s).
"""

from dataclasses import dataclass
from math import expm1
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.speed.guards import GUARD_INPUTS, Guards
from swath.control.speed.throughput_target import Common, has_crop, ramped, room
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.signals import EngineState, FeedReading, Odometry, SpeedCommand
from swath.signals.setup import ControlSetup

APART = 0.05  # command and wish may differ by this share before the integration waits


@dataclass(frozen=True, kw_only=True)
class Params(Common):
    """A PI controller of the throughput.

    gain: gain of the free share on the speed [1]
    reset_s: time of the integration
    smooth_s: time constant of a low pass on the free share, so that the noise of sensors does not shake the
        drive
    """

    gain: Annotated[float, Ge(0), Le(5)] = 0.5
    reset_s: Annotated[float, Gt(0), Le(100)] = 6.0
    smooth_s: Annotated[float, Ge(0), Le(20)] = 0.5


class FeedRate(KeepsState):
    """PI on the share of the throughput that is free; the integral waits while a ramp or bound holds."""

    kept = ("_speed", "_base", "_free", "_guard")

    inputs = (
        Port("feed", FeedReading, optional=True),
        Port("engine", EngineState, optional=True),
        *GUARD_INPUTS,
        Port("odometry", Odometry, optional=True),
    )
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._guard = Guards(params, setup.machine)

    def reset(self, stream: Stream) -> Outputs:
        """Entry speed."""
        self._guard.reset()
        self._speed = self._base = self._p.entry_speed_kmh * KMH
        self._free = 0.0
        return {"command": SpeedCommand(0, self._speed)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The next command, valid at t + dt."""
        p, h = self._p, dt / NS
        free = room(p, inputs["feed"], inputs["engine"])
        if free is None or not has_crop(p, inputs["feed"]):
            self._base, self._free = p.entry_speed_kmh * KMH, 0.0
        else:
            new = 1.0 if p.smooth_s <= 0.0 else -expm1(-h / p.smooth_s)
            self._free += new * (free - self._free)
        wanted = self._base * (1.0 + p.gain * self._free)
        self._speed = ramped(p, self._speed, wanted, h)
        apart = wanted - self._speed
        if abs(apart) <= APART * self._speed or apart * self._free < 0.0:
            self._base *= 1.0 + h / p.reset_s * self._free
        speed = self._guard.limit(self._speed, inputs, dt)
        return {"command": SpeedCommand(t + dt, speed)}

    def end_reason(self, t: int) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self._guard.reason


LEVEL = Level(
    FeedRate,
    Params,
    summary="constant measured throughput, held back by the engine's load",
    cost="12 us per step",
    tolerance="no error in steady state; late by the travel from the knife to the sensor",
)
