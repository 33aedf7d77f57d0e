"""The world: a field, the machines in it, and the graph that runs their parts. `assembly.py` builds it."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swath.core.abilities import Closes, CountsBeams, CountsRays, HasNotes, HasRange, KnowsErrors, OffersRates
from swath.core.asked import ALL, Asked, bare
from swath.core.frames import Pose
from swath.core.graph import Graph
from swath.core.number_text import num
from swath.field.edges.track import EdgeShape
from swath.field.field import Field
from swath.field.maps.projection import Origin
from swath.field.memory_layout import Solids
from swath.field.site_setup import TRAILER, Bodies
from swath.field.solid.obstacles import Thing
from swath.machine.body.body import MachineBody
from swath.machine.header.header_kinematics import HeaderKinematics
from swath.machine.machine_sheet import MachineSheet
from swath.machine.towing import pose_of
from swath.record.message_factory import RecordedMachine
from swath.runtime.scene import Walkers
from swath.scenario.resolved import MachineSection, SlotChoice
from swath.scenario.scenario import Scenario
from swath.signals import F64, HeaderState

BODY = "body"  # the part of a machine that its file gives, beside the grain that it carries
ASKED_BY = "asked_by"  # key of a summary
EDGE_STEP = 0.5  # between the points of a drawn edge [m]
OFFERED = 1e-3  # a rate this near to one that is offered is that one, of itself; estimated


@dataclass(frozen=True)
class Machine:
    """A machine in the world. parts: slot -> component; mountings: sensor slot -> pose_machine_sensor.

    edge: the initial edge that it follows
    start: pose_world_machine at t = 0
    overlap: how far its steering wants the header end out over the cut ground [m], 0 where it does not say
    retired: parts that others replaced while running
    changed: what was chosen then
    origin: where on Earth the world's origin lies, if that is known
    body: its shape from the user's file, if it has one
    """

    section: MachineSection
    sheet: MachineSheet
    edge: EdgeShape
    start: Pose
    parts: dict[str, Any]
    mountings: Mapping[str, Pose]
    overlap: float
    retired: list[Any] = dataclasses.field(default_factory=list)
    changed: dict[str, SlotChoice] = dataclasses.field(default_factory=dict)
    origin: Origin | None = None
    body: MachineBody | None = None

    @property
    def name(self) -> str:
        """The name of the machine in the scenario."""
        return self.section.name

    @property
    def slots(self) -> Mapping[str, SlotChoice]:
        """What is chosen for its slots now."""
        return {**self.section.slots, **self.changed}

    @property
    def edge_side(self) -> str:
        """`left` or `right`, the end of the header that follows the edge."""
        return bare(self.section.common).edge_side

    @cached_property
    def header_kinematics(self) -> HeaderKinematics:
        """The kinematics of a header that is level at the ground."""
        return HeaderKinematics(self.sheet, 0.0)

    @property
    def cuts(self) -> bool:
        """True for a machine with a header."""
        return bool(self.slots_of("header"))

    def slots_of(self, kind: str) -> list[str]:
        """The slots of a kind, such as `lidar_left` and `lidar_right` of `lidar`."""
        return [slot for slot, choice in self.section.slots.items() if choice.kind.name == kind]

    @property
    def all_parts(self) -> list[Any]:
        """The parts at work and the retired ones."""
        return [*self.parts.values(), *self.retired]

    @property
    def ray_count(self) -> int:
        """Rays cast by all sensors so far."""
        return sum(part.ray_count for part in self.all_parts if isinstance(part, CountsRays))

    def coverage(self) -> dict[str, float]:
        """`unmeasured_beam_share` of a machine that replays measured scans, nothing of any other."""
        counting = [part for part in self.all_parts if isinstance(part, CountsBeams)]
        beams = sum(part.beam_count for part in counting)
        return {"unmeasured_beam_share": sum(p.unmeasured_count for p in counting) / beams} if beams else {}

    @property
    def notes(self) -> list[str]:
        """What the parts want the user to know about the run, each once."""
        notes = [f"{self.name}: {n}" for p in self.all_parts if isinstance(p, HasNotes) for n in p.notes]
        return list(dict.fromkeys([*notes, *self._about_rates()]))

    def _about_rates(self) -> Iterator[str]:
        """Rates that a sensor's maker does not offer."""
        for slot, choice in self.slots.items():
            rate, part = choice.common.rate_hz, self.parts.get(slot)
            sheet, offered = part.offered if isinstance(part, OffersRates) else ("", ())
            if offered and not any(abs(rate - r) < OFFERED * r for r in offered):
                offer = ", ".join(num(r) for r in offered)
                key = f"{self.name}.{slot}.rate_hz"
                yield f"{key}: {num(rate)} Hz is not a rate of the {sheet}, which has {offer} Hz"

    def recorded(self) -> RecordedMachine:
        """What the recording needs to know."""
        outputs = {f"{slot}.{p.name}": p.signal for slot, part in self.parts.items() for p in part.outputs}
        scanners = {
            slot: (1.0 / self.section.slots[slot].common.rate_hz, *part.range_limits)
            for slot, part in self.parts.items()
            if isinstance(part, HasRange)
        }
        return RecordedMachine(
            self.name,
            self.sheet,
            self.edge_side,
            self.mountings,
            self.origin,
            outputs,
            self.edge,
            self.start,
            scanners,
            errors={slot: part.errors for slot, part in self.parts.items() if isinstance(part, KnowsErrors)},
            triangles=np.zeros((0, 3, 3)) if self.body is None else self.body.triangles,
        )


@dataclass(frozen=True)
class World:
    """A scenario, assembled.

    driven: the real pass that the edge follows, (n, 2) world [m], if it does
    added: obstacles that came while the run went, those of them that go
    before_asking: called before a part waits for somebody outside, who may act on messages of the run
    devices: slots that are served as devices (`link.device.output.Device`) once they are opened
    asked: who asks for keys of the field, and of the slots
    """

    scenario: Scenario
    field: Field
    obstacles: Solids
    driven: F64 | None
    bodies: Bodies
    graph: Graph
    machines: Mapping[str, Machine]
    added: Walkers
    before_asking: list[Callable[[], None]] = dataclasses.field(default_factory=list)
    devices: Sequence[Any] = ()
    asked: Sequence[Asked] = ()

    @property
    def asked_by(self) -> dict[str, list[str]]:
        """Keys that were set, without those that every part has to do with -> the parts that ask for them."""
        each = {key: sorted(parts) for asked in self.asked for key, parts in asked.by.items()}
        return {key: parts for key, parts in each.items() if ALL not in parts}

    @property
    def leader(self) -> Machine:
        """The first machine."""
        return next(iter(self.machines.values()))

    def recorded(self, *, is_drawn: bool = True) -> dict[str, RecordedMachine]:
        """What the recording needs to know of each machine, by name. is_drawn: with lines for a viewer."""
        found = {}
        crop = {"height": self.field.seen_height, "row_spacing": float(self.field.library.row_spacing)}
        for name, machine in self.machines.items():
            lines = self._lines(machine) if is_drawn else {}
            found[name] = dataclasses.replace(
                machine.recorded(), lines=lines, is_first=machine is self.leader, crop=crop
            )
        return found

    def _lines(self, machine: Machine) -> dict[str, F64]:
        """The edge that a machine follows, and with the first one the boundary of the field."""
        way = machine.edge.point_at(np.arange(0.0, machine.edge.length + EDGE_STEP, EDGE_STEP))
        lines = {"edge": self._on_ground(way)}
        if machine is self.leader and self.field.boundary is not None:
            for i, ring in enumerate(self.field.boundary.rings):
                lines[f"boundary {i}"] = self._on_ground(np.vstack([ring, ring[:1]]))
        return lines

    def _on_ground(self, points: F64) -> F64:
        """World points (n, 2) with the height of the ground, (n, 3), those outside of its map left out."""
        made = np.column_stack([points, self.field.terrain.height(points[:, 0], points[:, 1])])
        return np.asarray(made[np.isfinite(made[:, 2])])

    @cached_property
    def driving(self) -> tuple[str, ...]:
        """Slots of the motion of the machines that cut; without any, of all machines."""
        names = [m.name for m in self.machines.values() if m.cuts] or list(self.machines)
        return tuple(f"{name}.motion" for name in names)

    def reset(self) -> None:
        """Everything as at the start: the field uncut, the machines where they begin."""
        self.reset_field()
        self.graph.reset()

    def reset_field(self) -> None:
        """The same without the parts of the machines."""
        self.field.reset()
        self.bodies.reset()
        for machine in self.machines.values():
            self._lift_header(machine, None)

    def save(self) -> dict[str, Any]:
        """Everything that changes while running."""
        retired = {m.name: [part.save() for part in m.retired] for m in self.machines.values() if m.retired}
        return {
            "graph": self.graph.save(),
            "field": self.field.save(),
            "bodies": self.bodies.save(),
            "added": self.added.save(),
            "retired": retired,
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Back to a saved moment, in a world of the same scenario after the same changes."""
        self.graph.load(state["graph"])
        self.field.load(state["field"])
        self.bodies.load(state["bodies"])
        self.added.load(state["added"])
        for name, saved in state.get("retired", {}).items():
            for part, own in zip(self.machines[name].retired, saved, strict=True):
                part.load(own)
        for name, machine in self.machines.items():
            if machine.body is not None:
                height = self.graph.latest(f"{name}.header", "height")
                self._lift_header(machine, height if isinstance(height, HeaderState) else None)

    def open_devices(self) -> None:
        """Let the devices listen. SwathError where one cannot; calling it again does nothing."""
        for device in self.devices:
            device.open()

    def close(self) -> None:
        """Close what parts hold outside: processes, nodes, buses. Calling it again does nothing."""
        for device in self.devices:
            device.close()
        for machine in self.machines.values():
            for part in machine.all_parts:
                if isinstance(part, Closes):
                    part.close()

    def watch_bodies(self) -> None:
        """The bodies of the machines and their trailers stand where these do from now on."""
        for machine in self.machines.values():
            for slot in (*machine.slots_of("motion"), *machine.slots_of("header")):
                self.graph.follows[f"{machine.name}.{slot}"] = self.place_bodies

    def add_obstacle(self, name: str, thing: Thing, t: int) -> None:
        """Another obstacle from the tick at t [ns] on, in place of one of that name."""
        self.remove_obstacle(name)
        self.bodies.add_thing(name, thing)
        self.added.add(name, thing)
        if thing.way is not None and self.place_added not in self.graph.before_tick:
            self.graph.before_tick.append(self.place_added)
        self.place_added(t)

    def remove_obstacle(self, name: str) -> None:
        """Take away one that was added; nothing where there is none of that name."""
        self.bodies.remove(name)
        self.added.remove(name)

    def place_added(self, t: int) -> None:
        """The added obstacles that go are where they are at t [ns]; called before the tick at t."""
        self.added.place(t, [self.bodies.pose_of(name).position[:2].tolist() for name in self.machines])

    def place_bodies(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None:
        """What a machine's motion or header sent: its bodies stand there."""
        name = slot.partition(".")[0]
        if "state" in outputs:
            self.bodies.follow(name, lambda: outputs["state"])
            if "trailer" in outputs:
                self.bodies.place(name + TRAILER, pose_of(outputs["trailer"]))
        elif "height" in outputs and self.machines[name].body is not None:
            self._lift_header(self.machines[name], outputs["height"])

    def _lift_header(self, machine: Machine, height: HeaderState | None) -> None:
        """Show sensors where the header of a body from a file is."""
        if machine.body is not None:
            at = Pose.identity()
            if height is not None:
                at = machine.header_kinematics.pose(height.lift, height.tilt)
            self.bodies.show(machine.name, machine.body.with_header_at(at), BODY)
