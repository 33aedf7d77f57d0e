"""The scene: moves the obstacles that have a path, and says where all of them are."""

from collections.abc import Sequence
from math import cos, hypot, sin
from typing import Any

import numpy as np

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.frames import Pose
from swath.core.graph import Node
from swath.core.random import Stream
from swath.core.schedule import NS, Slot, from_hz
from swath.field.edges.track import Way
from swath.field.site_setup import Bodies
from swath.field.solid.obstacles import Path, Thing
from swath.record.recorder import SCENE
from swath.signals import OBSTACLE_KINDS, MachineState, Obstacles

SLOT = f"{SCENE}.obstacles"
MOVING_HZ, STANDING_HZ = 50.0, 1.0


def scene_nodes(things: Sequence[Thing], field: Any, bodies: Bodies, machines: Sequence[str]) -> list[Node]:
    """The node that moves the obstacles of a field; none without obstacles."""
    if not things:
        return []
    rate = MOVING_HZ if any(thing.way is not None for thing in things) else STANDING_HZ
    wires = {name: (f"{name}.motion", "state") for name in machines}
    return [Node(Slot(SLOT, from_hz(rate)), Scene(things, field, bodies, machines), wires)]


class Walkers(KeepsState):
    """Things on their paths. begun: when each of those that go set off, by name [ns]."""

    kept = ("begun",)

    def __init__(self, field: Any, bodies: Bodies) -> None:
        self._field, self._bodies = field, bodies
        self._paths: dict[str, tuple[Path, Way]] = {}
        self.begun: dict[str, int] = {}

    def add(self, name: str, thing: Thing) -> None:
        """Another body that goes; nothing where the thing has no path."""
        self.remove(name)
        if thing.path is not None and thing.way is not None:
            self._paths[name] = thing.path, thing.way

    def remove(self, name: str) -> None:
        """It goes no more; nothing where it never did."""
        self._paths.pop(name, None)
        self.begun.pop(name, None)

    def place(self, now: int, machines: Sequence[Sequence[float]]) -> None:
        """Put those that are still around where they are at `now` [ns]; see `sets_off`."""
        for name, (path, way) in self._paths.items():
            if name not in self._bodies:
                continue
            if name not in self.begun and sets_off(path, way, now / NS, machines):
                self.begun[name] = now
            gone = (now - self.begun[name]) / NS if name in self.begun else -1.0
            x, y, heading, speed = way.after(gone)
            pose = Pose.from_euler([x, y, float(self._field.ground_height(x, y))], yaw=heading)
            self._bodies.place(name, pose, (speed * cos(heading), speed * sin(heading), 0.0))


class Scene(KeepsState):
    """A component with the states of all machines as inputs. A thing that was taken out is left out."""

    kept = ("walkers",)
    outputs = (Port("state", Obstacles),)

    def __init__(self, things: Sequence[Thing], field: Any, bodies: Bodies, machines: Sequence[str]) -> None:
        self._bodies = bodies
        self._names = [thing.name for thing in things]
        self.inputs = tuple(Port(name, MachineState) for name in machines)
        self.walkers = Walkers(field, bodies)
        for thing in things:
            self.walkers.add(thing.name, thing)

    def reset(self, stream: Stream) -> Outputs:
        """Everything where it starts; what sets off at once, sets off."""
        self.walkers.begun = {}
        return self._at(0, ())

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Everything where it is at t + dt."""
        return self._at(t + dt, tuple(inputs[port.name] for port in self.inputs))

    def _at(self, now: int, machines: Sequence[MachineState]) -> Outputs:
        self.walkers.place(now, [machine.pose.position[:2].tolist() for machine in machines])
        return {"state": self._sample(now)}

    def _sample(self, t: int) -> Obstacles:
        known = self._bodies
        there = [b for b in known.around() if b.name in self._names or known.is_added(b.name)]
        middles = np.array([b.pose.apply(b.middle) for b in there]).reshape(-1, 3)
        half = np.array([b.half for b in there]).reshape(-1, 3)
        return Obstacles(
            t,
            np.array([OBSTACLE_KINDS.index(b.kind) for b in there], np.uint8),
            middles[:, 0].copy(),
            middles[:, 1].copy(),
            middles[:, 2].copy(),
            np.array([b.pose.euler()[2] for b in there]),
            np.array([float(np.hypot(b.velocity[0], b.velocity[1])) for b in there]),
            2.0 * half[:, 0],
            2.0 * half[:, 1],
            2.0 * half[:, 2],
        )


def sets_off(path: Path, way: Way, t_s: float, machines: Sequence[Sequence[float]]) -> bool:
    """Whether a thing that stands sets off at a time. machines: x, y of the fixed axle of each [m]."""
    if t_s < path.start_s:
        return False
    x, y = way.points[0].tolist()
    near = path.start_within_m
    return near is None or any(hypot(px - x, py - y) <= near for px, py in machines)
