"""Drive at one speed, as long as the crop edge is seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from swath.control.speed.edge_guard import EdgeGuards
from swath.control.speed.guards import GUARD_INPUTS, Guarded, Guards
from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.together import Given, OneByOne, Samples
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

    @classmethod
    def together(cls, parts: Sequence["ConstantSpeed"]) -> "Speeds":
        """All of them."""
        return Speeds(parts)

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


class Speeds(OneByOne):
    """Those of many worlds; one by one where they hear of obstacles or paths."""

    def __init__(self, parts: Sequence[ConstantSpeed]) -> None:
        super().__init__(parts)
        self._wanted = np.array([part._speed for part in parts])
        self._guards = EdgeGuards([part._guard.edge for part in parts])

    @property
    def reasons(self) -> dict[int, str]:
        """Why worlds end, by their number."""
        return self._guards.reasons

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        """The commands at t = 0."""
        self._guards.reset()
        return super().reset(streams)

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        """The commands that are valid at t + dt."""
        if inputs.get("objects") is not None or inputs.get("guidance") is not None:
            made = super().step(t, dt, inputs)
            for world, part in enumerate(self.parts):
                self._guards.take(world, part._guard.edge)
            return made
        speed = self._guards.limit(self._wanted, inputs.get("edge"), inputs.get("odometry"), dt)
        return {"command": Samples(SpeedCommand, t + dt, {"speed": speed})}

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        self._guards.give(world, self.parts[world]._guard.edge)
        return super().save(world)

    def load(self, world: int, state: State) -> None:
        """Back to it."""
        super().load(world, state)
        self._guards.take(world, self.parts[world]._guard.edge)


LEVEL = Level(
    ConstantSpeed,
    Params,
    summary="one speed, less where the edge is not sure, none where it is lost",
    cost="10 us per step",
    tolerance="exact",
)
