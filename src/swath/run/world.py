"""From a scenario to something that runs: the field, the machines in it, their parts and connections."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.abilities import (
    Closes,
    CountsBeams,
    CountsRays,
    EndsRun,
    HasMounting,
    HasNotes,
    HasOpticalFrame,
    HasOverlap,
    NeedsRealTime,
)
from swath.core.component import Port, State
from swath.core.errors import InputError, SwathError
from swath.core.frames import Pose
from swath.core.graph import EndOfRun, Graph, Node
from swath.core.random import Stream
from swath.core.schedule import Slot, from_hz
from swath.field.field import Field
from swath.field.memory_layout import Solids
from swath.field.projection import Origin
from swath.field.site_setup import Bodies, SiteSetup
from swath.field.solids import machine_body
from swath.machine.machine_sheet import MachineSheet, load_machine
from swath.machine.process.straw_laying import LaidStraw
from swath.record.messages import OPTICAL_FRAME, RecordedMachine
from swath.run.field_setup import build_field
from swath.run.placing import check_room, check_side, start_pose
from swath.scenario.resolved import MachineSection, SlotChoice
from swath.scenario.scenario import Scenario
from swath.scenario.slots import CONTROL, EXCHANGEABLE, SLOTS, TRUTH
from swath.signals import F64
from swath.signals.setup import ControlSetup, LinkSetup


@dataclass(frozen=True)
class Machine:
    """A machine in the world. parts: slot -> component; mountings: sensor slot -> pose_machine_sensor

    overlap: how far its steering wants the header end out over the cut ground [m], 0 where it does not say
    retired: parts that others replaced while running
    origin: where on Earth the world's origin lies, if that is known
    """

    name: str
    card: MachineSheet
    edge_side: str
    parts: dict[str, Any]
    mountings: Mapping[str, Pose]
    overlap: float
    retired: list[Any] = dataclasses.field(default_factory=list)
    origin: Origin | None = None

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
        told = [part for part in self.all_parts if isinstance(part, CountsBeams)]
        beams = sum(int(part.beam_count) for part in told)
        return {"unmeasured_beam_share": sum(int(p.unmeasured_count) for p in told) / beams} if beams else {}

    @property
    def notes(self) -> list[str]:
        """What the parts want the user to know about the run, each once."""
        return [f"{self.name}: {n}" for p in self.all_parts if isinstance(p, HasNotes) for n in p.notes]

    def recorded(self) -> RecordedMachine:
        """What the recording needs to know."""
        return RecordedMachine(
            self.name, self.card, self.edge_side, self.mountings, self.origin, tuple(self.parts)
        )


@dataclass(frozen=True)
class World:
    """A scenario, assembled. driven: the real pass that the edge follows, (n, 2) world [m], if it does."""

    scenario: Scenario
    field: Field
    obstacles: Solids
    driven: F64 | None
    bodies: Bodies
    graph: Graph
    machines: Mapping[str, Machine]

    @property
    def leader(self) -> Machine:
        """The first machine: its distance ends the run."""
        return next(iter(self.machines.values()))

    def save(self) -> dict[str, Any]:
        """Everything that changes while running."""
        return {"graph": self.graph.save(), "field": self.field.save(), "bodies": self.bodies.save()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Back to a saved moment, in a world of the same scenario."""
        self.graph.load(state["graph"])
        self.field.load(state["field"])
        self.bodies.load(state["bodies"])

    def close(self) -> None:
        """Let go of what parts hold outside: processes, nodes, buses. Calling it again does nothing."""
        for machine in self.machines.values():
            for part in machine.all_parts:
                if isinstance(part, Closes):
                    part.close()

    def end_with_parts(self, t: int) -> None:
        """Before the tick at t [ns]: a part that wants the run to end ends it."""
        for machine in self.machines.values():
            for slot, part in machine.parts.items():
                if isinstance(part, EndsRun) and (reason := part.end_reason(t)):
                    raise EndOfRun(f"{machine.name}.{slot}: {reason}")

    def place_bodies(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None:
        """Observer of the graph: the bodies of the machines stand where the machines do."""
        if (state := outputs.get("state")) is not None and slot.endswith(".motion"):
            self.bodies.place(slot.partition(".")[0], state.pose)


def assemble(scenario: Scenario, *, only: Collection[str] | None = None) -> World:
    """Build the world. InputError or WiringError, with file and line, where something cannot work.

    only: full names of slots, such as `combine.process`: nothing else runs in the graph, and what comes from
    elsewhere is put in from outside (`Graph.put`)
    """
    try:
        return _assemble(scenario, only)
    except InputError as error:
        raise scenario.locate(error) from error


def _assemble(scenario: Scenario, only: Collection[str] | None) -> World:
    base = scenario.file.parent if scenario.file is not None else Path.cwd()
    ground = build_field(scenario.field, stream=Stream(scenario.seed, "field"), base=base)
    field = ground.field
    site = Site(field, ground.obstacles, Bodies(), base, ground.origin)
    machines, nodes = {}, []
    for section in scenario.machines.values():
        machine, own_nodes = _build_machine(_reduced(section, only), site)
        if only is None:
            _check_pace(scenario, machine)
        machines[section.name] = machine
        nodes += [n for n in own_nodes if only is None or n.slot.name in only]
        check_room(scenario, section, field, machine.card)
    graph = Graph(nodes, scenario.seed, outside=None if only is None else outside_of(nodes))
    world = World(scenario, field, ground.obstacles, ground.driven, site.bodies, graph, machines)
    if any(isinstance(part, EndsRun) for machine in machines.values() for part in machine.parts.values()):
        graph.before_tick.append(world.end_with_parts)
    return world


def _reduced(section: MachineSection, only: Collection[str] | None) -> MachineSection:
    """The machine with the slots asked for, and the scanner whose mounting control is told."""
    if only is None:
        return section
    named = {slot for slot in section.slots if f"{section.name}.{slot}" in only}
    kept = named | ({"lidar"} if named & set(CONTROL) else set())
    return dataclasses.replace(section, slots={s: c for s, c in section.slots.items() if s in kept})


def outside_of(nodes: Sequence[Node]) -> dict[str, dict[str, Port]]:
    """What the wires of these nodes bring from elsewhere: slot -> output -> port, as the inputs want it."""
    inside = {node.slot.name for node in nodes}
    found: dict[str, dict[str, Port]] = {}
    for node in nodes:
        ports = {port.name: port for port in node.component.inputs}
        for name, (source, output) in node.wires.items():
            if source not in inside and name in ports:
                port = ports[name]
                sent = Port(output, port.signal, port.unit, port.shape)
                found.setdefault(source, {}).setdefault(output, sent)
    return found


@dataclass(frozen=True)
class Site:
    """What all machines of a scenario share."""

    field: Field
    obstacles: Solids
    bodies: Bodies
    base: Path
    origin: Origin | None = None


def _build_machine(section: MachineSection, site: Site) -> tuple[Machine, list[Node]]:
    card = load_machine(section.card.as_posix(), header_width_m=section.common.header_width_m)
    check_side(section, site.field)
    start = start_pose(section, site.field, card)
    site.bodies.add(section.name, machine_body(card), start)
    parts: dict[str, Any] = {}
    mountings: dict[str, Pose] = {}
    for slot in _build_order(section.slots):
        choice = section.slots[slot]
        setup = _setup(section, slot, choice, card, start, mountings, site)
        parts[slot] = _make(section.name, slot, choice, setup)
        if slot == "process" and choice.found.is_link:
            parts[slot] = LaidStraw(parts[slot], site.field, card)
        if isinstance(part := parts[slot], HasMounting) and isinstance(part.mounting, Pose):
            mountings[slot] = part.mounting
        if isinstance(part, HasOpticalFrame):
            mountings[slot + OPTICAL_FRAME] = part.optical
    nodes = [_node(section, slot, choice, parts[slot], parts) for slot, choice in section.slots.items()]
    steer = parts.get("steer")
    overlap = float(steer.overlap) if isinstance(steer, HasOverlap) else 0.0
    side = section.common.edge_side
    machine = Machine(section.name, card, side, parts, mountings, overlap, origin=site.origin)
    return machine, nodes


def make_part(world: World, name: str, choice: SlotChoice) -> tuple[Any, dict[str, tuple[str, str]]]:
    """A component for the slot `name`, such as `combine.lidar`, of a standing world, and its wires.

    InputError or WiringError where it cannot be had. `exchange` puts it into the slot.
    """
    machine_name, _, slot = name.partition(".")
    section, machine = world.scenario.machines[machine_name], world.machines[machine_name]
    file = world.scenario.file
    base = file.parent if file is not None else Path.cwd()
    site = Site(world.field, world.obstacles, world.bodies, base, machine.origin)
    start = start_pose(section, world.field, machine.card)
    setup = _setup(section, slot, choice, machine.card, start, machine.mountings, site)
    component = _make(machine_name, slot, choice, setup)
    return component, _node(section, slot, choice, component, machine.parts).wires


def exchange(
    world: World,
    name: str,
    component: Any,
    wires: Mapping[str, tuple[str, str]],
    *,
    state: State | None = None,
) -> None:
    """From its next step on, another component plays the slot `name`; the old one is kept as retired.

    state: of the component before, which is of the same level: it goes on where that one stood, and that one
    is let go. Without it only slots in `EXCHANGEABLE` can: the state of the others is the machine's own.
    InputError, WiringError.
    """
    machine_name, _, slot = name.partition(".")
    if slot not in EXCHANGEABLE and state is None:
        raise InputError("slot", name, f"expected one of {', '.join(EXCHANGEABLE)} to exchange")
    world.graph.exchange(name, component, wires, state)
    machine = world.machines[machine_name]
    before, machine.parts[slot] = machine.parts[slot], component
    if state is None:
        machine.retired.append(before)
    elif isinstance(before, Closes):
        before.close()


def _setup(
    section: MachineSection,
    slot: str,
    choice: SlotChoice,
    card: MachineSheet,
    start: Pose,
    mountings: Mapping[str, Pose],
    site: Site,
) -> Any:
    """What the level of a slot is told: the site, or for control and links less."""
    if choice.found.is_link:
        return _link_setup(section, slot, choice, card, mountings, site.base)
    period = from_hz(choice.common.rate_hz) * 1e-9
    if slot in CONTROL and not choice.found.sees_truth:
        mounting = mountings.get("lidar", Pose.from_euler((card.knife_x, 0.0, 2.0)))
        return ControlSetup(card, mounting, section.common.edge_side, period)
    return SiteSetup(
        field=site.field,
        machine=card,
        start=start,
        edge_side=section.common.edge_side,
        period=period,
        name=section.name,
        obstacles=site.obstacles,
        bodies=site.bodies,
        base=site.base,
        origin=site.origin,
    )


def _link_setup(
    section: MachineSection,
    slot: str,
    choice: SlotChoice,
    card: MachineSheet,
    mountings: Mapping[str, Pose],
    base: Path,
) -> LinkSetup:
    """The face of a slot: what its wires bring, without the truth where it is control, and what it gives."""
    kind = next(s for s in SLOTS if s.name == slot)
    gives = {s.name: {p.name: p for p in (*s.outputs, *s.more)} for s in SLOTS}
    offered = []
    for port, (source, output) in choice.wires.items():
        sent = gives.get(source.rpartition(".")[2], {}).get(output)
        if sent is not None and not (slot in CONTROL and sent.signal in TRUTH):
            offered.append(Port(port, sent.signal, sent.unit, sent.shape, optional=True))
    mounting = mountings.get("lidar", Pose.from_euler((card.knife_x, 0.0, 2.0)))
    period = from_hz(choice.common.rate_hz) * 1e-9
    control = ControlSetup(card, mounting, section.common.edge_side, period)
    return LinkSetup(section.name, slot, tuple(offered), kind.outputs, control, base)


def _build_order(slots: Mapping[str, SlotChoice]) -> list[str]:
    """Sensors first: control is told where they sit."""
    return [s for s in slots if s not in CONTROL] + [s for s in slots if s in CONTROL]


def _make(machine: str, slot: str, choice: SlotChoice, setup: Any) -> Any:
    try:
        component = choice.make(setup)
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(f"{machine}.{slot}.{error.key}", error.value, error.expected) from error
    except SwathError:
        raise
    except Exception as error:
        if ".py:" not in choice.level:
            raise
        what = f"could not be made by Class(params, setup): {type(error).__name__}: {error}"
        raise InputError(f"{machine}.{slot}.level", choice.level, what) from error
    absent = [name for name in ("inputs", "outputs", "reset", "step") if not hasattr(component, name)]
    if absent:
        what = f"has no {', '.join(absent)}; expected a component as in examples/my_edge_detector.py"
        raise InputError(f"{machine}.{slot}.level", choice.level, what)
    return component


def _node(
    section: MachineSection, slot: str, choice: SlotChoice, component: Any, parts: Mapping[str, Any]
) -> Node:
    common = choice.common
    ports = {p.name for p in component.inputs}
    optional = {p.name for p in component.inputs if p.optional}
    off = {f"{section.name}.{name}" for name in section.off}
    sent = {f"{section.name}.{name}": {p.name for p in part.outputs} for name, part in parts.items()}

    def is_kept(port: str, source: str, output: str) -> bool:
        if source in off and port in optional:
            return False
        is_missing = source in sent and output not in sent[source]  # a level without what others have
        return port in choice.wired or (port in ports and not (is_missing and port in optional))

    wires = {port: wire for port, wire in choice.wires.items() if is_kept(port, *wire)}
    timing = Slot(
        f"{section.name}.{slot}", from_hz(common.rate_hz), round(common.offset_ms * 1e6), common.latch
    )
    return Node(timing, component, wires)


def _check_pace(scenario: Scenario, machine: Machine) -> None:
    """Parts that answer by the clock on the wall need a run that goes by it."""
    for slot, part in machine.parts.items():
        if isinstance(part, NeedsRealTime) and part.needs_real_time and not scenario.is_paced:
            expected = f"{part.needs_real_time}: expected a run with --real-time"
            raise InputError(f"{machine.name}.{slot}", None, expected)
