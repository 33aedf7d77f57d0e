"""Drive at one speed, as long as the crop edge is seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.control.speed.edge_guard import EdgeGuards
from swath.control.speed.guards import GUARD_INPUTS, Guarded
from swath.control.speed.obstacle_stop import ObstacleStop
from swath.core.component import Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.together import Given, InWorlds, Samples, in_world
from swath.core.units import KMH
from swath.signals import Odometry, SpeedCommand
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params(Guarded):
    """speed_kmh: wanted forward speed; a combine with a 12 m header in wheat works at 4 to 8 km/h."""

    speed_kmh: Annotated[float, Ge(0), Le(40)] = 7.0


class ConstantSpeed(InWorlds):
    """The same forward speed wherever the edge is sure. stop: bounds it by objects; wanted [m/s]."""

    inputs = (Port("odometry", Odometry, optional=True), *GUARD_INPUTS)
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self.wanted, self.guard = params.speed_kmh * KMH, params.guard
        self.stop = ObstacleStop(params.stop, setup.machine)

    @classmethod
    def together(cls, parts: Sequence["ConstantSpeed"]) -> "Speeds":
        """Make one object that steps these parts of many worlds together."""
        return Speeds(parts)

    def end_reason(self, t: int) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self.alone.reasons.get(0, "") if isinstance(self.alone, Speeds) else ""


class Speeds(EdgeGuards):
    """The parts of many worlds, stepped together; objects are looked at one by one."""

    def __init__(self, parts: Sequence[ConstantSpeed]) -> None:
        super().__init__([part.guard for part in parts], [part.wanted for part in parts])
        self._parts = parts

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """The commands at t = 0."""
        for part in self._parts:
            part.stop.reset()
        return super().reset(streams)

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """The commands that are valid at t + dt."""
        made = super().step(t, dt, inputs)
        if (objects := inputs.get("objects")) is not None:
            speeds, odometry = made["command"].arrays["speed"], inputs.get("odometry")
            for world, part in enumerate(self._parts):
                seen = in_world(objects, world), in_world(odometry, world)
                speeds[world] = part.stop.limit(part.wanted, *seen, dt, speeds[world])
        return made

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        return {**super().save(world), "stop": self._parts[world].stop.save()}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(world, state)
        self._parts[world].stop.load(state["stop"])


LEVEL = Level(
    ConstantSpeed,
    Params,
    summary="one speed, less where the edge is not sure, none where it is lost",
    cost="10 us per step",
    tolerance="exact",
)
