"""From a scenario to a world: the field, the machines in it, their parts and connections.

`start_pose` is where a machine starts; whether edge and field go on for as long as the run does is checked.
"""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.abilities import (
    Closes,
    HasIdentity,
    HasMounting,
    HasOpticalFrame,
    HasOverlap,
    HasRange,
    NeedsRealTime,
)
from swath.core.asked import Asked, asking, bare, made_of
from swath.core.checked import CheckedOutput
from swath.core.component import Port, State
from swath.core.errors import InputError, SwathError, WiringError
from swath.core.fault import NOTHING, FaultyOutput
from swath.core.foreign_code import through
from swath.core.frames import Pose
from swath.core.graph import Graph, Node
from swath.core.number_text import num
from swath.core.portable import product
from swath.core.random import Stream
from swath.core.schedule import Slot, from_hz
from swath.documents.geojson import lines_of, read_shapes
from swath.field.edges.track import EdgeShape
from swath.field.field import Field
from swath.field.maps.projection import Origin
from swath.field.memory_layout import Solids
from swath.field.site_setup import TRAILER, Bodies, SiteSetup, why_outside
from swath.field.solid.solids import machine_body, trailer_body
from swath.machine.body.body import MachineBody, read_body
from swath.machine.machine_sheet import MachineSheet, load_machine
from swath.machine.organ import LinkedOrgan
from swath.record.message_factory import OPTICAL_FRAME
from swath.runtime.faults import displaced, make_fault
from swath.runtime.field_setup import build_field
from swath.runtime.field_state import begin_field
from swath.runtime.kept import KeptFields
from swath.runtime.scene import Walkers, scene_nodes
from swath.runtime.unused import watched, watched_slot
from swath.runtime.world import Machine, World
from swath.scenario.machine_types import ORGANS
from swath.scenario.resolved import MachineSection, SlotChoice
from swath.scenario.scenario import Scenario, folder_of
from swath.scenario.sections import StartAlongEdge, StartPose
from swath.scenario.slots import CATALOGUE, PEER, SLOTS, TRUTH, kind_of
from swath.signals import F64
from swath.signals.setup import ControlSetup, LinkSetup, MachineGeometry

LOOK_AHEAD_M = 5.0  # the edge must go on this far beyond where the header ends up


def edge_of(section: MachineSection, field: Field) -> EdgeShape:
    """The initial edge that a machine follows: the one it names, else the first of the field."""
    asks = section.has("header") or isinstance(section.start, StartAlongEdge)
    name = (section.common if asks else bare(section.common)).field_edge
    if name is None:
        return field.first_edge
    if name not in field.edges:
        expected = f"expected one of field.edges: {', '.join(field.edges)}"
        raise InputError(f"{section.name}.field_edge", name, expected)
    return field.edges[name].shape


def start_pose(section: MachineSection, field: Field, edge: EdgeShape, machine: MachineGeometry) -> Pose:
    """pose_world_machine at t = 0, level; motion puts it on the ground."""
    start = section.start
    if isinstance(start, StartPose):
        x, y, yaw = start.x_m, start.y_m, np.radians(start.heading_deg)
    else:
        along = float(edge.heading_at(start.along_edge_m))
        yaw = along + np.radians(start.heading_error_deg)
        left = np.array([-np.sin(along), np.cos(along)])
        end = edge.point_at(start.along_edge_m) + start.offset_m * left
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        x, y = end - product(turn, np.array(machine.header_end(section.common.edge_side)))
    return Pose.from_euler((x, y, float(field.ground_at(x, y))), yaw=float(yaw))


def check_side(section: MachineSection, edge: EdgeShape) -> None:
    """The crop must stand on the machine's side of its edge; only a machine that cuts has one."""
    if not section.has("header") or edge.crop_side != section.common.edge_side:
        return
    side = section.common.edge_side
    other = "right" if side == "left" else "left"
    expected = f"expected {other}, because the crop stands to the {edge.crop_side} of the edge"
    raise InputError(f"{section.name}.edge_side", side, expected)


def check_start(machines: Mapping[str, Machine], field: Field, bodies: Bodies) -> None:
    """No machine may start in another one or in an obstacle, and one that cuts must start in the field."""
    for contact in bodies.contacts():
        at = f"({num(contact.point[0], places=1)}, {num(contact.point[1], places=1)})"
        expected = f"expected another place: it overlaps {contact.second} at {at} m"
        raise InputError(f"{contact.first.removesuffix(TRAILER)}.start", None, expected)
    for name, machine in machines.items():
        if machine.cuts and (why := why_outside(field, machine.sheet, machine.start)):
            raise InputError(f"{name}.start", None, f"expected a place in the field: {why}")


def check_room(scenario: Scenario, machine: Machine, field: Field) -> None:
    """The edge of a machine that cuts, and the field around it, must go on for as long as the run does."""
    start, edge = machine.section.start, machine.edge
    if isinstance(start, StartPose) or not machine.cuts:
        return
    begin, distance = start.along_edge_m, scenario.run.distance_m
    room = edge.length - (0.0 if edge.is_closed else begin) - LOOK_AHEAD_M
    if distance > room:
        expected = f"expected at most {num(max(room, 0.0))} m, the edge ends there"
        raise InputError("run.distance_m", distance, expected)
    s = np.linspace(begin, begin + distance + LOOK_AHEAD_M, 200)
    along, at = edge.heading_at(s), edge.point_at(s)
    left = np.stack([-np.sin(along), np.cos(along)], axis=1)
    inward = -1.0 if machine.edge_side == "left" else 1.0
    for across in (0.0, inward * machine.sheet.header_width):
        points = at + across * left
        is_inside = field.covers(points[:, 0], points[:, 1])
        is_inside[: is_inside.argmax()] = True  # a slanted headland
        if not np.all(is_inside):
            short = float(s[np.argmin(is_inside)] - begin)
            expected = f"expected a field that covers the run, it ends after {num(short)} m"
            raise InputError("run.distance_m", distance, expected)


DEVICES = "swath.link.device.output"  # loaded where a scenario asks for one
_MOUNTED = "lidar", "scan_filter", "radar", "camera", "gnss", "imu"  # slots whose mounting control knows


def assemble(
    scenario: Scenario, *, only: Collection[str] | None = None, fields: KeptFields | None = None
) -> World:
    """Build the world of a scenario.

    Parameters
    ----------
    scenario : Scenario
        As `swath.load_scenario` gives it.
    only : collection of str
        Full names of slots, such as `combine.process`: nothing else runs in the graph, and what comes from
        elsewhere is put in from outside (`Graph.put`).
    fields : KeptFields
        Fields of worlds before; whoever gives them drives one world at a time.

    Returns
    -------
    World
        The world, not yet begun.

    Raises
    ------
    InputError, WiringError
        With file and line, where something cannot work.
    """
    try:
        with through(scenario.gate):
            return _assemble(scenario, only, fields)
    except InputError as error:
        raise scenario.locate(error) from error
    except WiringError as error:
        raise WiringError(f"{error} ({scenario.file})" if scenario.file else str(error)) from error


def _assemble(scenario: Scenario, only: Collection[str] | None, fields: KeptFields | None) -> World:
    asked = Asked(is_of_parts=True)
    scenario, base = watched(scenario, asked), folder_of(scenario)
    seed = scenario.field_seed
    is_cut = any(machine.has("header") for machine in scenario.machines.values())
    if fields is None:
        ground = build_field(scenario.field, stream=Stream(seed, "field"), base=base, is_cut=is_cut)
    else:
        ground = fields.ground(scenario.field, seed, base, is_cut=is_cut)
    begin_field(ground.field, scenario)
    bodies = Bodies()
    bodies.set_things(ground.things)
    sheets = {name: _sheet_of(section) for name, section in scenario.machines.items()}
    before_asking: list[Callable[[], None]] = []
    site = _Site(ground.field, ground.obstacles, bodies, base, sheets, before_asking, asked, ground.origin)
    machines: dict[str, Machine] = {}
    nodes: list[Node] = []
    for section in scenario.machines.values():
        machine = machines[section.name] = _build_machine(_reduced(section, only), site)
        if only is None:
            _check_pace(scenario, machine)
        check_room(scenario, machine, ground.field)
    for machine in machines.values():
        own = [_node(machine.section, *item, machines) for item in _choices(machine)]
        nodes += [n for n in own if only is None or n.slot.name in only]
    if only is None:
        check_start(machines, ground.field, site.bodies)
        nodes = [*scene_nodes(ground.things, ground.field, site.bodies, tuple(machines)), *nodes]
    graph = Graph(nodes, scenario.seed, outside=None if only is None else outside_of(nodes))
    walkers = Walkers(ground.field, site.bodies)
    devices = [] if only is not None else _devices(scenario, machines)
    world = World(
        scenario, ground.field, ground.obstacles, ground.driven, site.bodies, graph, machines, walkers,
        before_asking, devices, (ground.asked, asked),
    )  # fmt: skip
    world.watch_bodies()
    for device in devices:
        graph.watches[device.setup.name] = device
        graph.before_tick.append(device.wait)
    return world


def _reduced(section: MachineSection, only: Collection[str] | None) -> MachineSection:
    """The machine with the slots asked for, and the sensors whose mounting their control knows."""
    if only is None:
        return section
    named = {slot for slot in section.slots if f"{section.name}.{slot}" in only}
    kept, seen = set(named), named
    while seen:
        wired = {
            source.rpartition(".")[2]
            for slot in seen
            if section.slots[slot].kind.is_control
            for source, _ in section.slots[slot].wires.values()
            if source.startswith(f"{section.name}.")
        }
        seen = {s for s in wired & section.slots.keys() if section.slots[s].kind.name in _MOUNTED} - kept
        kept |= seen
    slots = {slot: choice for slot, choice in section.slots.items() if slot in kept}
    return dataclasses.replace(section, slots=slots, present=section.present)


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
class _Site:
    """What all machines of a scenario share."""

    field: Field
    obstacles: Solids
    bodies: Bodies
    base: Path
    sheets: Mapping[str, MachineSheet]
    before_asking: list[Callable[[], None]]  # as `World.before_asking`
    asked: Asked  # who asks for keys of slots
    origin: Origin | None = None


@dataclass(frozen=True)
class _Place:
    """A machine that is being built: where it stands, on which edge, and its sensors so far."""

    section: MachineSection
    sheet: MachineSheet
    edge: EdgeShape
    start: Pose
    mountings: Mapping[str, Pose]
    site: _Site


def _choices(machine: Machine) -> list[tuple[str, SlotChoice, Any]]:
    """Name, choice and component of its slots."""
    return [(slot, choice, machine.parts[slot]) for slot, choice in machine.section.slots.items()]


def _sheet_of(section: MachineSection) -> MachineSheet:
    return load_machine(section.sheet.as_posix(), header_width_m=section.common.header_width_m)


def _build_machine(section: MachineSection, site: _Site) -> Machine:
    sheet = site.sheets[section.name]
    edge = edge_of(section, site.field)
    check_side(section, edge)
    start = start_pose(section, site.field, edge, sheet)
    body = _body(section, site)
    site.bodies.add(section.name, machine_body(sheet) if body is None else body.level, start)
    if sheet.hitch is not None and sheet.trailer is not None:
        towed = section.name + TRAILER
        behind = Pose(start.apply([sheet.hitch.x - sheet.hitch.drawbar, 0.0, 0.0]), start.rotation)
        site.bodies.add(towed, trailer_body(sheet.hitch, sheet.trailer.width, sheet.box), behind)
        site.bodies.hitch(section.name, towed)
    parts: dict[str, Any] = {}
    mountings: dict[str, Pose] = {}
    place = _Place(section, sheet, edge, start, mountings, site)
    for slot in _build_order(section.slots):
        part = parts[slot] = _make(place, slot, section.slots[slot])
        mountings |= _told_mountings(place, slot, part)
    steer = parts.get("steer")
    overlap = float(steer.overlap) if isinstance(steer, HasOverlap) else 0.0
    return Machine(section, sheet, edge, start, parts, mountings, overlap, origin=site.origin, body=body)


def _body(section: MachineSection, site: _Site) -> MachineBody | None:
    """The machine's shape from the user's file, which its own sensors see, too."""
    if section.common.body is None:
        return None
    site.bodies.show_to_itself(section.name)
    return read_body(section.common.body, f"{section.name}.body")


def _told_mountings(place: _Place, slot: str, part: Any) -> dict[str, Pose]:
    """Where a sensor sits and its optical frame, as control and recording know them."""
    choice, mountings = place.section.slots[slot], {}
    if choice.common.mount_error:
        part = choice.make(_setup(place, slot, choice))
    if isinstance(part, HasMounting) and isinstance(part.mounting, Pose):
        mountings[slot] = part.mounting
    if isinstance(part, HasOpticalFrame):
        mountings[slot + OPTICAL_FRAME] = part.optical
    return mountings


def make_part(world: World, name: str, choice: SlotChoice) -> tuple[Any, dict[str, tuple[str, str]]]:
    """A component for the slot `name`, such as `combine.lidar`, of a standing world, and its wires.

    InputError or WiringError where it cannot be had. `exchange` puts it into the slot.
    """
    machine_name, _, slot = name.partition(".")
    machine = world.machines[machine_name]
    sheets = {m.name: m.sheet for m in world.machines.values()}
    site = _Site(
        world.field, world.obstacles, world.bodies, folder_of(world.scenario), sheets, world.before_asking,
        world.asked[-1], machine.origin,
    )  # fmt: skip
    place = _Place(machine.section, machine.sheet, machine.edge, machine.start, machine.mountings, site)
    choice = watched_slot(choice, name, site.asked)
    component = _make(place, slot, choice)
    return component, _node(machine.section, slot, choice, component, world.machines).wires


def exchange(
    world: World,
    name: str,
    component: Any,
    wires: Mapping[str, tuple[str, str]],
    *,
    state: State | None = None,
    choice: SlotChoice | None = None,
) -> None:
    """From its next step on, another component plays the slot `name`; the old one is kept as retired.

    choice: what was chosen for the slot, None for a part from elsewhere
    state: of the component before, of the same level: the new one resumes from it, the old one is
    released. Without it only exchangeable slots can: the state of the others is the machine's own.
    InputError, WiringError.
    """
    machine_name, _, slot = name.partition(".")
    kind = kind_of(slot)
    if state is None and (kind is None or not kind.is_exchangeable):
        able = ", ".join(s.name for s in SLOTS if s.is_exchangeable)
        raise InputError("slot", name, f"expected one of {able} to exchange")
    world.graph.exchange(name, component, wires, state, partial(_guarded, name, choice, component))
    machine = world.machines[machine_name]
    before, machine.parts[slot] = machine.parts[slot], component
    if choice is not None:
        machine.changed[slot] = choice
    if state is None:
        machine.retired.append(before)
    elif isinstance(before, Closes):
        before.close()


def _setup(place: _Place, slot: str, choice: SlotChoice) -> Any:
    """The setup of a level: the site, or for control and links less."""
    section, site = place.section, place.site
    period = from_hz(choice.common.rate_hz) * 1e-9
    mountings, height = _mountings(place, choice), site.field.seen_height
    side, lines = bare(section.common).edge_side, partial(read_line, site.origin)
    rows = site.field.library.row_spacing
    told = ControlSetup(place.sheet, mountings, side, period, height, lines, rows)
    control = made_of(told, section.common, {"edge_side": "edge_side"})
    if choice.found.is_link:
        fed = {port: source for port, (source, _) in choice.wires.items()}
        offered, gives = _offered(choice, section), choice.kind.outputs
        ground = None if choice.kind.is_control else site.field.terrain.height
        to_local = None if site.origin is None else site.origin.to_field
        return LinkSetup(
            section.name, slot, offered, gives, control, site.base, fed, site.before_asking, ground, to_local
        )
    if choice.kind.is_control and not choice.found.sees_truth:
        return control
    return _site_setup(place, period, choice)


def read_line(origin: Origin | None, file: str, index: int) -> F64:
    """The n-th line of a GeoJSON file, in the order in which they stand in it: points (n, 2) of the field's
    frame [m].

    origin: of the field on Earth. InputError where there is none, or no such line
    """
    if origin is None:
        raise InputError("file", file, "expected a field that lies on Earth, with an origin")
    lines = lines_of(read_shapes(Path(file), "file")[0], Path(file), "file")
    if index >= len(lines):
        raise InputError("line", index, f"expected less than the {len(lines)} lines of the file")
    return origin.to_local(lines[index])


def _site_setup(place: _Place, period: float, choice: SlotChoice | None = None) -> SiteSetup:
    site, section = place.site, place.section
    common, own = section.common, None if choice is None else choice.common
    hears = common if own is None or bare(own).peer is None else own  # what says the machine it works with
    made = SiteSetup(
        field=site.field,
        machine=place.sheet,
        start=place.start,
        edge_side=bare(common).edge_side,
        period=period,
        name=section.name,
        obstacles=site.obstacles,
        bodies=site.bodies,
        base=site.base,
        origin=site.origin,
        edge=place.edge,
        peer=site.sheets.get(bare(hears).peer or ""),
    )
    made = made_of(made, hears, {"peer": "peer"})
    return made_of(made, common, {"edge_side": "edge_side", "edge": "field_edge"})


def _mountings(place: _Place, choice: SlotChoice) -> dict[str, Pose]:
    """Input port -> mounting of the sensor of the same machine that is wired to it."""
    own, declared = f"{place.section.name}.", getattr(choice.found.component, "inputs", ())
    known = {port.name for port in declared} if isinstance(declared, tuple) else set()
    left = {port for port in choice.kind.asked if port not in (*choice.common.wires, *known)}
    wired = {port: source.removeprefix(own) for port, (source, _) in choice.wires.items() if port not in left}
    return {port: place.mountings[slot] for port, slot in wired.items() if slot in place.mountings}


def _offered(choice: SlotChoice, section: MachineSection) -> tuple[Port, ...]:
    """The ports that the wires of a slot bring, without organs that the machine does not have, and without
    the truth where it is control; each optional.
    """
    organs = {f"{section.name}.{organ}" for organ in ORGANS if organ not in section.present}
    offered = []
    for port, (source, output) in choice.wires.items():
        if source in organs:
            continue
        kind = kind_of(source.rpartition(".")[2])
        gives = {} if kind is None else {p.name: p for p in (*kind.outputs, *kind.more)}
        sent = gives.get(output)
        if sent is not None and not (choice.kind.is_control and sent.signal in TRUTH):
            offered.append(Port(port, sent.signal, sent.unit, sent.shape, optional=True))
    return tuple(offered)


def _build_order(slots: Mapping[str, SlotChoice]) -> list[str]:
    """Sensors first: control has to know where they sit."""
    return sorted(slots, key=lambda slot: slots[slot].kind.is_control)


def _make(place: _Place, slot: str, choice: SlotChoice) -> Any:
    name = f"{place.section.name}.{slot}"
    try:
        really = displaced(choice) if choice.common.mount_error else choice
        with asking(name):
            component = really.make(_setup(place, slot, choice))
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(f"{name}.{error.key}", error.value, error.expected) from error
    except SwathError:
        raise
    except Exception as error:
        if ".py:" not in choice.level:
            raise
        what = f"could not be made by Class(params, setup): {type(error).__name__}: {error}"
        raise InputError(f"{name}.level", choice.level, what) from error
    absent = [verb for verb in ("inputs", "outputs", "reset", "step") if not hasattr(component, verb)]
    if absent:
        what = f"has no {', '.join(absent)}; expected a component as in examples/my_edge_detector.py"
        raise InputError(f"{name}.level", choice.level, what)
    is_own = type(component).__module__.startswith("swath.") and not choice.found.is_link
    is_adapted = choice.found.is_link or choice.kind.name in ORGANS
    if choice.kind.link_adapter and is_adapted and not is_own:
        module, _, adapter = choice.kind.link_adapter.partition(":")
        component = getattr(import_module(module), adapter)(component, _site_setup(place, 0.0))
    return component


def _node(
    section: MachineSection, slot: str, choice: SlotChoice, component: Any, machines: Mapping[str, Machine]
) -> Node:
    """A component with its wires to the parts of all machines."""
    common, key = choice.common, f"{section.name}.{slot}.level"
    ports = {p.name: p for p in component.inputs}
    if choice.kind.is_control and not choice.found.sees_truth:
        for port in ports.values():
            if port.signal in TRUTH:
                expected = f"expected a part without the input {port.name}: control never sees the truth"
                raise InputError(key, choice.level, expected)
    sent = {
        f"{name}.{other}": {p.name for p in part.outputs}
        for name, machine in machines.items()
        for other, part in machine.parts.items()
    }
    present = {f"{name}.{other}" for name, m in machines.items() for other in m.section.present}

    def is_kept(port: str, source: str, output: str) -> bool:
        """A wire of the kind's list is left out where its port is not there, or may stay open and does."""
        if port in common.wires:
            return True
        is_there = source in present and (source not in sent or output in sent[source])
        return port in ports and (is_there or not ports[port].optional)

    wires = {port: wire for port, wire in choice.wires.items() if is_kept(port, *wire)}
    own = choice.kind.wires
    if any(port not in common.wires and own[port][0].startswith(PEER) for port in wires):
        assert common.peer or section.common.peer  # asked for: it sends what these bring
    is_whole = len(section.slots) == len(section.present)
    for port, (source, output) in wires.items():
        is_absent = source not in present and is_whole
        if port in common.wires or not (is_absent or output not in sent.get(source, {output})):
            continue
        other, needed = source, output
        if is_absent and source.rpartition(".")[2] in ORGANS:
            other, needed = f"{section.name}.process", "organs"
        elif is_absent:
            raise InputError(
                key, choice.level, f"expected a slot {source} beside it, whose {output} it takes"
            )
        what = f"expected {other} at {_levels_with(needed, other)}: it takes {source}.{output}"
        raise InputError(key, choice.level, what)
    timing = Slot(
        f"{section.name}.{slot}", from_hz(common.rate_hz), round(common.offset_ms * 1e6), common.latch
    )
    try:
        fault = make_fault(choice, component)
    except InputError as error:
        raise InputError(f"{section.name}.{slot}.{error.key}", error.value, error.expected) from error
    return Node(timing, component, wires, _guarded(timing.name, choice, component, fault))


def _levels_with(output: str, slot: str) -> str:
    """Levels of a slot that send an output, as an error says them."""
    kind, registry = kind_of(slot.rpartition(".")[2]), CATALOGUE.registry
    levels = {} if kind is None else {n: registry.get(kind.name, n) for n in registry.names(kind.name)}
    outputs = {name: getattr(level.component, "outputs", ()) for name, level in levels.items()}
    found = [name for name, ports in outputs.items() if output in [port.name for port in ports]]
    return f"level {' or '.join(found)}" if found else "another level"


def _guarded(
    name: str, choice: SlotChoice | None, component: Any, fault: FaultyOutput | None
) -> FaultyOutput | None:
    """The fault of a slot, before which the samples of a part that is not swath's own are checked."""
    kind = type(component.part if isinstance(component, LinkedOrgan) else component)
    if kind.__module__.startswith("swath.") and (choice is None or not choice.found.is_link):
        return fault
    part = kind.__qualname__ if choice is None else choice.level
    return CheckedOutput(name, part, component.outputs, NOTHING if fault is None else fault.fault)


def _devices(scenario: Scenario, machines: Mapping[str, Machine]) -> list[Any]:
    """Slots that are served as devices of their own (`swath.link.device.output`), with their addresses."""
    made = []
    for machine in machines.values():
        for slot, choice in machine.section.slots.items():
            if choice.common.device is None:
                continue
            key, output = f"{machine.name}.{slot}", import_module(DEVICES)
            part, section = machine.parts[slot], scenario.realtime
            if not scenario.is_paced or section is None:
                expected = "expected a run with --real-time: a device sends at the pace of the clock"
                raise InputError(f"{key}.device", choice.common.device, expected)
            limit = part.range_limits[1] if isinstance(part, HasRange) else float("nan")
            identity = part.identity if isinstance(part, HasIdentity) else ""
            setup = output.DeviceSetup(
                key, part.outputs, from_hz(choice.common.rate_hz) * 1e-9, limit, machine.origin,
                section.common.factor, identity, machine.sheet.wheelbase, machine.sheet.max_steer,
            )  # fmt: skip
            try:
                made.append(output.make_device(choice.common.device, setup))
            except InputError as error:
                raise InputError(f"{key}.device", error.value, error.expected) from error
    return made


def _check_pace(scenario: Scenario, machine: Machine) -> None:
    """Parts that answer by the clock on the wall need a run that goes by it."""
    for slot, part in machine.parts.items():
        if isinstance(part, NeedsRealTime) and part.needs_real_time and not scenario.is_paced:
            expected = f"{part.needs_real_time}: expected a run with --real-time"
            raise InputError(f"{machine.name}.{slot}", None, expected)
