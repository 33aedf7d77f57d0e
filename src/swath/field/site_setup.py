"""What the parts of a machine that touch the world are given: field, machine, what stands around."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.portable import product
from swath.field.edges.track import EdgeShape
from swath.field.field import Field
from swath.field.grain import GrainBox, GrainReceiver
from swath.field.maps.projection import Origin
from swath.field.memory_layout import Solids
from swath.field.solid.contact import Parts, bounds, joined, nearest, overlaps, parts_of
from swath.field.solid.convex import Vector
from swath.field.solid.obstacles import KINDS, Thing, Warm, names_of
from swath.field.solid.solids import merge, moved
from swath.signals import MachineState
from swath.signals.setup import MachineGeometry

TRAILER = ".trailer"  # after a machine's name: the body that it tows
MACHINE = "machine"  # kind of the bodies of machines
STILL = (0.0, 0.0, 0.0)  # velocity of what stands
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contact:
    """Two bodies that overlap. point: in both of them, world (3,) [m]."""

    first: str
    second: str
    point: Vector


@dataclass(frozen=True)
class Sighted:
    """What a sensor sees of a body: its solids in the world. kind: as in `OBSTACLE_KINDS`.

    velocity: of its origin, world (3,) [m/s]
    pose: pose_world_body
    warm: what keeps it warm, None where nothing does
    """

    name: str
    kind: str
    solids: Solids
    velocity: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    pose: Pose = dataclasses.field(default_factory=Pose.identity)
    warm: Warm | None = None


@dataclass(frozen=True)
class Body:
    """A thing of the scene or a machine as it is now. kind: as in `OBSTACLE_KINDS`; solids: in the world.

    pose: pose_world_body
    velocity: of its origin, world (3,) [m/s]
    middle, half: of a box around it in its own frame, (3,) [m]
    rcs_dbsm: radar cross section at 24 and 77 GHz, None where it is that of its solids
    """

    name: str
    kind: str
    solids: Solids
    pose: Pose
    velocity: Array
    middle: Array
    half: Array
    rcs_dbsm: tuple[float, float] | None = None


def known_as(obstacles: Any, machines: Sequence[str]) -> list[str]:
    """Names of obstacles, as parameters, and of machines, and the kinds of both."""
    towed = [name + TRAILER for name in machines]
    return [*names_of(obstacles), *machines, *towed, *KINDS, MACHINE]


class Bodies:
    """The bodies of all machines by name, where they stand now, and the obstacles around them.

    One such list is shared by all sites. Whoever moves a machine places it anew after every step, and after
    `load`. obstacles: in the world, by name. Wheels are no part of a body: the ground is never in contact.
    """

    def __init__(self, obstacles: Mapping[str, Solids] | None = None) -> None:
        self._solids: dict[str, Solids] = {}
        self._places: dict[str, Pose] = {}
        self._told: dict[str, Callable[[], MachineState]] = {}  # where bodies are, once somebody asks
        self._starts: dict[str, Pose] = {}
        self._parts: dict[str, Parts] = {}
        self._shown: dict[str, dict[str, Solids]] = {}
        self._sees_itself: set[str] = set()
        self._standing: set[str] = set()  # bodies that are no machines
        self._hitched: set[frozenset[str]] = set()
        self._known: dict[str, tuple[Pose, Parts]] = {}
        self.changes = np.zeros(1, np.int64)  # of what there is and can be seen; what moves is not counted
        self.boxes: dict[str, GrainBox] = {}  # by the body that carries them
        self._speeds: dict[str, Sequence[float] | MachineState] = {}
        self._bounds: dict[str, tuple[Array, Array]] = {}
        self._things: dict[str, Thing] = {}  # what is known of the field's obstacles by name
        self._added: dict[str, Thing] = {}  # and of those that came while the run went
        self.set_obstacles(obstacles or {})

    def set_obstacles(self, obstacles: Mapping[str, Solids]) -> None:
        """The obstacles that stand around from now on, by name."""
        self._standing_solids, self._bounds = dict(obstacles), {}
        self._obstacles = {name: parts_of(solids) for name, solids in obstacles.items()}
        self.changes += 1

    def set_things(self, things: Sequence[Thing]) -> None:
        """The obstacles of the field from now on: those that stand, and those that go, where they start."""
        before, self._things = self._things, {thing.name: thing for thing in things}
        self.set_obstacles({thing.name: thing.in_world for thing in things if thing.way is None})
        for name in before.keys() - self._things.keys():
            self.remove(name)
        for thing in things:
            if thing.way is not None and thing.name not in self._solids:
                self.add(thing.name, thing.solids, thing.pose, is_machine=False)

    def add_thing(self, name: str, thing: Thing) -> None:
        """Another obstacle while the run goes, under a name of its own; it starts where its pose says."""
        self.add(name, thing.solids, thing.pose, is_machine=False)
        self._added[name] = thing

    def going(self) -> list[str]:
        """Names of the obstacles that have a way."""
        return [n for n, thing in (self._things | self._added).items() if thing.way is not None]

    def is_added(self, name: str) -> bool:
        """Whether it is an obstacle that came while the run went."""
        return name in self._added

    def add(self, name: str, solids: Solids, pose: Pose, *, is_machine: bool = True) -> None:
        """A machine's solids in its own frame, and where it starts; or a thing that sensors see beside the
        obstacles of the field, and that touches machines alone.
        """
        if name in self._obstacles:
            raise InputError("field.obstacles", name, "expected obstacles with other names than bodies")
        self._solids[name] = solids
        self._places[name] = self._starts[name] = pose
        self._speeds[name] = STILL
        self._parts[name] = parts_of(solids)
        self._known.pop(name, None)
        self.changes += 1
        if not is_machine:
            self._standing.add(name)

    def hitch(self, first: str, second: str) -> None:
        """Two machines hang together: they never count as touching."""
        self._hitched.add(frozenset((first, second)))

    def remove(self, name: str) -> None:
        """Take one away; nothing where there is none of that name."""
        for known in (self._solids, self._poses, self._starts, self._parts, self._known, self._speeds):
            known.pop(name, None)
        self._bounds.pop(name, None)
        self._added.pop(name, None)
        self.changes += 1
        self._standing.discard(name)
        self._hitched = {pair for pair in self._hitched if name not in pair}

    def __contains__(self, name: str) -> bool:
        """Whether a machine or a thing of this name is there."""
        return name in self._solids or name in self._obstacles

    def place(self, name: str, pose: Pose, velocity: Sequence[float] = STILL) -> None:
        """Move a machine or a thing; velocity: world (3,) [m/s], it stands there by default.

        Raises InputError for a name that was not added.
        """
        if name not in self._solids:
            self._refuse(name)
        self._told.pop(name, None)
        self._places[name] = pose
        self._speeds[name] = velocity

    def follow(self, name: str, state: Callable[[], MachineState]) -> None:
        """Move a machine to where it now is. state: gives that, until it is moved again."""
        if name not in self._solids:
            self._refuse(name)
        self._told[name] = state

    def _settle(self) -> None:
        """Ask where they are that are followed."""
        while self._told:
            name, tell = self._told.popitem()
            state = tell()
            self._places[name], self._speeds[name] = state.pose, state

    @property
    def _poses(self) -> dict[str, Pose]:
        """Where all bodies are now."""
        self._settle()
        return self._places

    def show(self, name: str, more: Solids, part: str = "") -> None:
        """What sensors see of a part of a body, in its frame; all such parts are seen instead of the solids
        that it touches others with.
        """
        self._shown.setdefault(name, {})[part] = more

    def show_to_itself(self, name: str) -> None:
        """A machine's own sensors see its body, too."""
        self._sees_itself.add(name)
        self.changes += 1

    @property
    def is_alone(self) -> bool:
        """Whether there is one body and nothing that it could meet, or that could see it."""
        return len(self._solids) == 1 and not self._obstacles and not self._things and not self._sees_itself

    def pose_of(self, name: str) -> Pose:
        """Where a body stands."""
        return self._poses[name]

    def own(self, name: str) -> list[str]:
        """A machine's bodies: its own and that of its trailer."""
        return [n for n in (name, name + TRAILER) if n in self._solids]

    def box_under(self, place: Any) -> tuple[str, float, float] | None:
        """The body whose box lies below a world point (3,), and the point in that box [m]; else None."""
        for name, held in self.boxes.items():
            pose, box = self._poses[name], held.box
            x, y, _ = product(pose.rotation.T, place - pose.position).tolist()
            if abs(x - box.x) <= 0.5 * box.length and abs(y) <= 0.5 * box.width:
                return name, x - box.x, y
        return None

    def beside(self, name: str, *, itself: bool = False) -> list[str]:
        """Names of all machines and things that go; of this one only where it sees itself, or `itself`."""
        return sorted(n for n in self._solids if n != name or itself or n in self._sees_itself)

    def others(self, name: str) -> Solids:
        """Solids of all machines and things that go, in the world; of this one only where it sees itself."""
        return merge(*(moved(self._seen(n), self._poses[n]) for n in self.beside(name)))

    def in_sight(self, name: str, *, itself: bool = False) -> list[Sighted]:
        """What sensors of a machine see of every obstacle, thing and machine as they are now; of this machine
        only where it sees itself, or `itself` asks for it.
        """
        solids = self._standing_solids
        standing = [Sighted(n, self._kind(n), solids[n], warm=self._warm(n)) for n in self._obstacles]
        return standing + [
            Sighted(
                n, self._kind(n), moved(self._seen(n), pose), np.array(self._velocity(n)), pose, self._warm(n)
            )
            for n in self.beside(name, itself=itself)
            for pose in (self._poses[n],)
        ]

    def around(self, name: str = "") -> list[Body]:
        """Every obstacle, thing and machine but one, as they are now."""
        return [self._body(n) for n in (*self._obstacles, *sorted(self._solids)) if n != name]

    def clearance(self, name: str) -> tuple[float, str]:
        """Distance [m] of a machine from the nearest obstacle or other machine, and the name of that one.

        0 where they overlap, (inf, "") where there is nothing else. A distance above `contact.NEAR` may be a
        lower bound.
        """
        around = self._around(name)
        if not around:
            return float("inf"), ""
        found = nearest(self._in_world(name), joined(list(around.values())))
        if found is None:
            return float("inf"), ""
        return found.distance, _owner(around, found.second)

    def contacts(self, name: str = "") -> list[Contact]:
        """Everything that a machine overlaps, or any machine does, each pair of names once, in order."""
        pairs: dict[tuple[str, str], Contact] = {}
        for machine in [name] if name else [n for n in self._solids if n not in self._standing]:
            around = self._around(machine)
            for found in overlaps(self._in_world(machine), joined(list(around.values()))):
                other = _owner(around, found.second)
                is_machine = other in self._solids and other not in self._standing
                first, second = sorted((machine, other)) if is_machine and not name else (machine, other)
                pairs.setdefault((first, second), Contact(first, second, found.point))
        return [pairs[key] for key in sorted(pairs)]

    def reset(self) -> None:
        """Put all bodies where they were added."""
        self._told.clear()
        self._places = {name: self._starts[name] for name in self._places}
        self._speeds = dict.fromkeys(self._places, STILL)

    def save(self) -> dict[str, Any]:
        """Where all machines and things stand, and how fast they go."""
        return {n: np.vstack([p.position, p.rotation, self._velocity(n)]) for n, p in self._poses.items()}

    def load(self, state: dict[str, Any]) -> None:
        """Put all machines and things back."""
        for name, rows in state.items():
            self.place(name, Pose(np.array(rows[0]), np.array(rows[1:4])), rows[4].tolist())

    def _refuse(self, name: str) -> NoReturn:
        raise InputError("machine", name, f"expected one of {', '.join(sorted(self._solids)) or 'none'}")

    def _velocity(self, name: str) -> Sequence[float]:
        """Velocity of a body, world (3,) [m/s]."""
        self._settle()
        held = self._speeds[name]
        if not isinstance(held, MachineState):
            return held
        ahead, left = held.speed, held.lateral_speed
        (a, b, _), (d, e, _), (g, h, _) = held.pose.numbers[1]
        return a * ahead + b * left, d * ahead + e * left, g * ahead + h * left

    def _around(self, name: str) -> dict[str, Parts]:
        """What a machine may touch: the other machines that it is not hitched to, and all that stands."""
        beside = [n for n in self._solids if n != name and frozenset((n, name)) not in self._hitched]
        return {n: self._in_world(n) for n in beside} | self._obstacles

    def _seen(self, name: str) -> Solids:
        """What sensors see of a body, in its frame."""
        shown = self._shown.get(name)
        return merge(*shown.values()) if shown else self._solids[name]

    def _body(self, name: str) -> Body:
        thing, moves = self._thing(name), name in self._solids
        kind = self._kind(name)
        if thing is not None:
            own, rcs = thing.solids, thing.rcs_dbsm
        else:
            own, rcs = self._solids[name] if moves else self._standing_solids[name], None
        pose = self._poses[name] if moves else Pose.identity() if thing is None else thing.pose
        velocity = np.array(self._velocity(name) if moves else STILL)
        if name not in self._bounds:
            self._bounds[name] = bounds(parts_of(own))
        return Body(name, kind, moved(own, pose), pose, velocity, *self._bounds[name], rcs)

    def _kind(self, name: str) -> str:
        if (thing := self._thing(name)) is not None:
            return thing.kind
        return MACHINE if name in self._solids and name not in self._standing else "unknown"

    def _warm(self, name: str) -> Warm | None:
        return None if (thing := self._thing(name)) is None else thing.warm

    def _thing(self, name: str) -> Thing | None:
        """What is known of an obstacle; None for a machine."""
        return self._things.get(name) or self._added.get(name)

    def _in_world(self, name: str) -> Parts:
        """The parts of a body where it stands now."""
        pose, known = self._poses[name], self._known.get(name)
        if known is None or known[0] is not pose:
            known = self._known[name] = pose, self._parts[name].moved(pose)
        return known[1]


def _owner(bodies: Mapping[str, Parts], index: int) -> str:
    """Whose part has this number among the parts of all."""
    for name, parts in bodies.items():
        if index < len(parts.kind):
            return name
        index -= len(parts.kind)
    raise IndexError(index)


def why_outside(field: Field, machine: MachineGeometry, start: Pose) -> str:
    """Why a machine that is to cut would start outside the field, empty where it does not.

    It starts inside when the middle of its fixed axle, or the middle or an end of its knife does.
    """
    ends = [machine.header_end(side) for side in ("left", "right")]
    points = np.array([[0.0, 0.0], [machine.knife_x, machine.header_y], *ends])
    x, y, _ = start.apply(np.column_stack([points, np.zeros(4)])).T
    return field.why_outside(x, y)


@dataclass(frozen=True)
class Landing:
    """Where grain comes down: in a box of a machine, else on the ground of the field."""

    field: Field
    bodies: Bodies

    def receive(self, mass_kg: float, place: Any) -> None:
        """A `GrainReceiver`."""
        self.land(mass_kg, place)

    def land(self, mass_kg: float, place: Any) -> float:
        """Grain [kg] comes down from a world point (3,) [m]; how much of it stays in a box."""
        found = self.bodies.box_under(place) if self.bodies.boxes else None
        if found is None:
            self.field.receive(mass_kg, place)
            return 0.0
        name, x, y = found
        return self.bodies.boxes[name].pour(mass_kg, x, y, self.field, self.bodies.pose_of(name))


@dataclass(frozen=True)
class SiteSetup:
    """What a component of the machine or a sensor may know, the truth included.

    field: the one truth
    machine: data-sheet geometry
    start: pose_world_machine at t = 0
    edge_side: `left` or `right`, the end of the header that follows the edge period [s] of the component
    name: of the machine
    obstacles: in the world
    bodies: of all machines
    base: folder that relative file names start from
    origin: where on Earth the world's origin lies, if that is known
    edge: line of the initial edge that the machine follows, such as `field.edges["west"].shape`
    grain_receiver: takes what the machine's tank is emptied into; None = boxes below, or the ground
    peer: geometry of the machine that it works with
    """

    field: Field
    machine: MachineGeometry
    start: Pose
    edge_side: str
    period: float
    name: str = ""
    obstacles: Solids = dataclasses.field(default_factory=Solids)
    bodies: Bodies = dataclasses.field(default_factory=Bodies)
    base: Path = dataclasses.field(default_factory=Path)
    origin: Origin | None = None
    edge: EdgeShape | None = None
    grain_receiver: GrainReceiver | None = None
    peer: MachineGeometry | None = None

    @property
    def receiver(self) -> GrainReceiver:
        """Whoever takes the grain that leaves the machine."""
        return self.grain_receiver or Landing(self.field, self.bodies)

    @property
    def carrier(self) -> str:
        """The body that carries the machine's box: its trailer, or itself."""
        return self.name + TRAILER if self.machine.hitch else self.name

    def solids(self) -> Solids:
        """Everything hard that this machine's sensors can see: obstacles, other machines, and itself where
        its body is from a file.
        """
        return merge(self.obstacles, self.bodies.others(self.name))
