"""From plain data to the sections of a scenario; all errors are collected on the way.

`field` is one of them; machines are read with their slots, and these with levels, parameters and wires.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, near_miss
from swath.documents.data_sheets import find_sheet
from swath.documents.validation import as_name, known_keys, unknown_key
from swath.documents.yaml_document import Document, KeyPath, read_document
from swath.scenario.expectations import read_evaluators, read_expect
from swath.scenario.machine_types import BY_LEVEL, BY_SECTION, slots_of
from swath.scenario.resolved import FieldSection, LevelChoice, MachineSection, RealTimeSection, SlotChoice
from swath.scenario.section_reader import NAME, ScenarioError, SectionReader
from swath.scenario.sections import (
    FieldCommon,
    Head,
    MachineCommon,
    RealTime,
    Run,
    SlotCommon,
    StartAlongEdge,
    StartPose,
)
from swath.scenario.slots import GONE_SLOTS, PEER, Catalogue, SlotKind
from swath.scenario.versions import SECTIONS

MOST_MACHINES = 50
MACHINE_KEYS = ("machine", "header_width_m", "start", "edge_side", "field_edge", "peer", "body")


def machine_names(reader: SectionReader, data: dict[str, Any]) -> list[str]:
    """The top-level keys that are machines; notes those that are neither machine nor section."""
    named = [key for key in data if key not in SECTIONS]
    if not named:
        reader.note((), None, "expected a machine under `machines:`, such as `combine:` with its slots")
    found = [name for name in named if _is_machine(reader, name, data)]
    if len(found) > MOST_MACHINES:
        reader.note((found[MOST_MACHINES],), None, f"expected at most {MOST_MACHINES} machines")
    return found[:MOST_MACHINES]


def _is_machine(reader: SectionReader, name: str, data: dict[str, Any]) -> bool:
    section = data[name]
    known = (*MACHINE_KEYS, *(s.name for s in reader.catalogue.slots))
    is_machine = isinstance(section, dict) and (
        not section or any(key in known or reader.catalogue.kind_of(key) for key in section)
    )
    if not is_machine:
        absent = [key for key in SECTIONS if key not in data]
        if name in known and name not in MACHINE_KEYS:
            machine = next((n for n in data if n not in SECTIONS and n not in known), "combine")
            reader.note((name,), None, f"unknown key, did you mean '{machine}.{name}'?")
            return False
        hint = near_miss(name, absent) or f"; a machine has keys such as {', '.join(known[:4])}"
        reader.note((name,), None, "unknown key" + hint)
        return False
    if not NAME.match(name):
        reader.note((name,), None, "expected a machine's name: letters, digits, - and _")
        return False
    return True


def read_machines(reader: SectionReader, data: dict[str, Any]) -> dict[str, MachineSection]:
    """The machines by name, without those that cannot be read; notes what is wrong."""
    read = [_machine(reader, name, section) for name, section in data.items()]
    machines = {m.name: m for m in read if m is not None}
    if not reader.errors:
        for machine in machines.values():
            _check_sources(reader, machine, machines)
            _check_peer(reader, machine, machines)
    return machines


def _machine(reader: SectionReader, name: str, data: dict[str, Any]) -> MachineSection | None:
    own = {k: reader.with_path(k, data[k], (name, k)) for k in MachineCommon.model_fields if k in data}
    common = reader.check(MachineCommon, own, (name,))
    start = _start(reader, data.get("start", {}), (name, "start"))
    if common is None:
        return None
    try:
        sheet = find_sheet("machines", common.machine)
    except (InputError, OSError, ValueError):
        return None  # noted when its path was looked at
    unasked = _slots_of_type(reader, sheet, (name, "machine"))
    for (slot, level), more in BY_LEVEL.items():
        entry, own = data.get(slot, unasked.get(slot)), {m: unasked.pop(m) for m in more if m in unasked}
        if (entry.get("level") if isinstance(entry, dict) else entry) == level:
            unasked |= {m: reader.catalogue.slot(m).level for m in more} | own
    chosen: dict[str, SlotChoice] = {}
    for kind, slot in _instances(reader, name, data, unasked):
        choice = read_slot(reader, name, slot, kind, data.get(slot, {}), unasked.get(slot, kind.level))
        if choice is not None:
            chosen[slot] = choice
    slots = {slot: replace(c, wires=_wires(name, c, chosen, common.peer)) for slot, c in chosen.items()}
    off = tuple(slot for slot in unasked if is_off(data.get(slot)))
    return MachineSection(name, common, sheet, start, slots, off)


def _slots_of_type(reader: SectionReader, sheet: Path, path: KeyPath) -> dict[str, str]:
    """Slot -> level of what a machine has unasked, by the type on its data sheet."""
    try:
        data = read_document(sheet).data
    except InputError as error:
        reader.errors.append(error)
        return {}
    data = data if isinstance(data, dict) else {}
    machine_type, own = data.get("type", ""), data.get("slots", {})
    if not isinstance(machine_type, str) or machine_type not in reader.catalogue.machine_types:
        known = ", ".join(reader.catalogue.machine_types)
        said = f"says {str(machine_type)[:40]}" if machine_type else "has none"
        reader.note(path, sheet.as_posix(), f"expected a data sheet with a `type` of {known}; it {said}")
        return {}
    more = {slot: level for key, slots in BY_SECTION.items() if key in data for slot, level in slots.items()}
    return slots_of(
        {**reader.catalogue.machine_types[machine_type], **more}, own if isinstance(own, dict) else {}
    )


def _instances(
    reader: SectionReader, machine: str, data: dict[str, Any], unasked: Mapping[str, str]
) -> list[tuple[SlotKind, str]]:
    """Every slot of a machine with its kind, in the order of one tick; notes unknown keys."""
    named = [key for key in data if key not in MACHINE_KEYS]
    kinds = {key: reader.catalogue.kind_of(key) for key in [*unasked, *named]}
    for key in named:
        if kinds[key] is None:
            plural = [f"{s.name}_NAME" for s in reader.catalogue.slots if s.is_plural]
            known = [*MACHINE_KEYS, *(s.name for s in reader.catalogue.slots), *plural]
            gone = GONE_SLOTS.get(key)
            other = (
                f"unknown key, did you mean field.{key}?" if key in FIELD_KEYS else unknown_key(key, known)
            )
            said = f"unknown key: it is gone, {gone}" if gone else other
            reader.note((machine, key), None, said)
        elif not NAME.match(key):
            reader.note((machine, key), None, "expected a slot's name: letters, digits, - and _")
    slots = [slot for slot in kinds if not is_off(data.get(slot))]
    return [(kind, slot) for kind in reader.catalogue.slots for slot in slots if kinds[slot] is kind]


def _start(reader: SectionReader, data: Any, path: KeyPath) -> StartAlongEdge | StartPose:
    in_world = isinstance(data, dict) and any(k in data for k in StartPose.model_fields)
    start: StartAlongEdge | StartPose = reader.check(StartPose if in_world else StartAlongEdge, data, path)
    return start


def read_slot(
    reader: SectionReader,
    machine: str,
    slot: str,
    kind: SlotKind,
    data: Any,
    level: str,
    path: KeyPath | None = None,
) -> SlotChoice | None:
    """The choice for a slot. level: where the data names none; path: where the data was written."""
    path = (machine, slot) if path is None else path
    entry, found = reader.level(kind.name, data, path, level)
    if found is None:
        return None
    common_keys = tuple(SlotCommon.model_fields)
    own = {k: v for k, v in entry.items() if k != "level" and k not in common_keys}
    params = reader.params(found, own, path, common_keys)
    common = {"rate_hz": kind.rate_hz} | {k: entry[k] for k in common_keys if k in entry}
    checked = reader.check(SlotCommon, common, path)
    if checked is None:
        return None
    return SlotChoice(entry["level"], found, params, checked, kind)


def _check_sources(
    reader: SectionReader, machine: MachineSection, machines: Mapping[str, MachineSection]
) -> None:
    """Every wire that the scenario wrote must come from a slot that is there."""
    slots = [f"{m.name}.{s}" for m in machines.values() for s in m.slots]
    for slot, choice in machine.slots.items():
        for port in choice.common.wires:
            source = choice.wires[port][0]
            if source not in slots:
                text = f"expected slot.output of a slot that is there{near_miss(source, slots)}"
                reader.note((machine.name, slot, "wires", port), choice.common.wires[port], text)


def _wires(
    machine: str, choice: SlotChoice, slots: Mapping[str, SlotChoice], peer: str | None
) -> dict[str, tuple[str, str]]:
    """Input port -> (full slot name, output): those of the kind, with what the scenario wrote on top.

    Where a machine has one slot of a kind, its name does not matter. peer: the machine it works with
    """
    wires = {}
    for port, (kind, output) in choice.kind.wires.items():
        if choice.found.is_link and port in choice.kind.asked:
            continue
        if kind.startswith(PEER):
            if (other := choice.common.peer or peer) is not None:
                wires[port] = (f"{other}.{kind.removeprefix(PEER)}", output)
            continue
        instances = [slot for slot, other in slots.items() if other.kind.name == kind]
        source = instances[0] if len(instances) == 1 else kind
        wires[port] = (f"{machine}.{source}", output)
    for port, text in choice.common.wires.items():
        source, _, output = text.rpartition(".")
        wires[port] = (source if "." in source else f"{machine}.{source}", output)
    return wires


def _check_peer(
    reader: SectionReader, machine: MachineSection, machines: Mapping[str, MachineSection]
) -> None:
    """The machines that one and its slots work with must be there."""
    others = [name for name in machines if name != machine.name]
    named: dict[KeyPath, str | None] = {(machine.name, "peer"): machine.common.peer}
    named |= {(machine.name, slot, "peer"): choice.common.peer for slot, choice in machine.slots.items()}
    for path, peer in named.items():
        if peer is not None and peer not in others:
            reader.note(path, peer, f"expected another machine{near_miss(peer, others)}")
    for slot, choice in machine.slots.items():
        if choice.common.peer and not any(kind.startswith(PEER) for kind, _ in choice.kind.wires.values()):
            reader.note((machine.name, slot, "peer"), choice.common.peer, "expected a slot that hears others")


def is_off(entry: Any) -> bool:
    """Whether the entry of a slot takes it away."""
    return entry is False or entry == "off"


FIELD_KEYS = (
    "folder", "terrain", "stand", "edge", "edges", "obstacles", "boundary", "weather",
    *FieldCommon.model_fields,
)  # fmt: skip


def read_field(reader: SectionReader, data: Any) -> FieldSection | None:
    """The section; notes what is wrong."""
    data = reader.mapping(data, ("field",))
    levels_of = ("terrain", "stand")
    for key in [k for k in data if k not in FIELD_KEYS]:
        deeper = next((name for name in levels_of if key in _keys_of(reader, name)), None)
        hint = (
            unknown_key(key, FIELD_KEYS)
            if deeper is None
            else f"unknown key, did you mean field.{deeper}.{key}?"
        )
        reader.note(("field", key), None, hint)
    data = {k: v if k in levels_of else reader.with_path(k, v, ("field", k)) for k, v in data.items()}
    folder = data.get("folder")
    if folder is not None and not isinstance(folder, str):
        reader.note(("field", "folder"), folder, "expected a path")
        folder = None
    own = {k: v for k, v in data.items() if k in FieldCommon.model_fields}
    common = reader.check(FieldCommon, own, ("field",))
    levels = {name: _ground(reader, name, data, folder is not None) for name in levels_of}
    edges = _edges(reader, data)
    obstacles = _obstacles(reader, data.get("obstacles", []))
    boundary, weather = (
        reader.check(reader.catalogue.part(key), data[key], ("field", key))
        if data.get(key) is not None
        else None
        for key in ("boundary", "weather")
    )
    if common is not None and common.origin is not None and folder is not None:
        reader.note(("field", "origin"), None, "expected no origin beside a field folder, which has its own")
    return FieldSection(
        Path(folder) if folder else None,
        levels["terrain"],
        levels["stand"],
        edges,
        obstacles,
        boundary,
        weather,
        common or FieldCommon(),
    )


def _keys_of(reader: SectionReader, name: str) -> list[str]:
    """Keys of the default level of terrain or stand."""
    level = reader.catalogue.registry.get(name, reader.catalogue.field_levels[name])
    return known_keys(level.params)


def _edges(reader: SectionReader, data: dict[str, Any]) -> dict[str, Any]:
    """The initial edges by name: the one of `edge`, or those of `edges`; none where neither is written."""
    kind = reader.catalogue.part("edge")
    if "edges" not in data:
        return {"edge": reader.check(kind, data["edge"], ("field", "edge"))} if "edge" in data else {}
    path = ("field", "edges")
    if "edge" in data:
        reader.note(path, None, "expected either `edge` or `edges`")
    edges = data["edges"]
    if not isinstance(edges, dict) or not edges:
        reader.note(path, edges, "expected at least one edge by name, such as `west: {x_m: 0}`")
        return {}
    for name in edges:
        if not NAME.match(name):
            reader.note((*path, name), None, "expected an edge's name: letters, digits, - and _")
    return {name: reader.check(kind, entry, (*path, name)) for name, entry in edges.items()}


def _ground(reader: SectionReader, name: str, data: dict[str, Any], has_folder: bool) -> LevelChoice | None:
    if name not in data and has_folder:
        return None
    path = ("field", name)
    entry, found = reader.level(name, data.get(name, {}), path, reader.catalogue.field_levels[name])
    if found is None:
        return None
    params = reader.params(found, {k: v for k, v in entry.items() if k != "level"}, path)
    return LevelChoice(entry["level"], found, params)


def _obstacles(reader: SectionReader, data: Any) -> tuple[Any, ...]:
    path = ("field", "obstacles")
    if not isinstance(data, list):
        reader.note(path, "(nothing)" if data is None else data, "expected a list")
        return ()
    kind = reader.catalogue.part("obstacles")
    return tuple(reader.check(kind, entry, (*path, i)) for i, entry in enumerate(data))


FAR_M = 1e5  # where an edge lies that nobody wrote


def read_sections(document: Document, catalogue: Catalogue) -> dict[str, Any]:
    """The arguments of a Scenario, from every section. ScenarioError when anything is wrong."""
    reader, data = SectionReader(document, catalogue), document.data
    if not isinstance(data, dict):
        text = "expected keys such as name, run, field and combine"
        raise ScenarioError([document.error((), data, text)])
    file = document.file
    head = {"name": as_name(file.stem if file else "", "scenario")} | {
        k: data[k] for k in SECTIONS[:3] if k in data
    }
    checked = reader.check(Head, head, ())
    parts: dict[str, Any] = {} if checked is None else dict(checked)
    machines = machine_names(reader, data)
    parts["run"] = reader.check(Run, data.get("run", {}), ("run",))
    parts["field"] = read_field(reader, data.get("field", {}))
    parts["machines"] = read_machines(reader, {name: data[name] for name in machines})
    if parts["field"] is not None and not parts["field"].edges:
        parts["field"] = _without_edge(reader, parts["field"], parts["machines"])
    parts["realtime"] = _realtime(reader, data["realtime"], parts["machines"]) if "realtime" in data else None
    parts["evaluators"], judged = read_evaluators(reader, data.get("evaluators", []))
    obstacles = parts["field"].obstacles
    parts["expect"] = read_expect(
        reader, data.get("expect", {}), judged, machines, parts["machines"], obstacles
    )
    if reader.errors:
        raise ScenarioError(reader.errors)
    return parts


def _without_edge(
    reader: SectionReader, field: FieldSection, machines: Mapping[str, MachineSection]
) -> FieldSection:
    """The field of machines that only drive: all of its crop stands, the edge lies far away."""
    path, kind = ("field", "edge"), reader.catalogue.part("edge")
    if any(machine.has("header") for machine in machines.values()):
        reader.check(kind, {}, path)
        return field
    for name, machine in machines.items():
        if isinstance(machine.start, StartAlongEdge):
            expected = "expected x_m, y_m and heading_deg: the field has no edge"
            reader.note((name, "start"), None, expected)
    edge = {"shape": "straight", "x_m": -FAR_M, "y_m": -0.5 * FAR_M, "length_m": FAR_M, "crop_begins_m": None}
    return replace(field, edges={"edge": reader.check(kind, edge, path)})


def _realtime(
    reader: SectionReader, data: Any, machines: Mapping[str, MachineSection]
) -> RealTimeSection | None:
    path = ("realtime",)
    data = reader.mapping(data, path)
    steps = data.get("degrade", [])
    reader.unknown(data, path, (*RealTime.model_fields, "degrade"))
    own = {k: v for k, v in data.items() if k in RealTime.model_fields}
    common = reader.check(RealTime, own, path)
    if not isinstance(steps, list):
        reader.note((*path, "degrade"), steps, "expected a list of {slot, level}")
        return None
    cheaper = [_cheaper(reader, entry, (*path, "degrade", i), machines) for i, entry in enumerate(steps)]
    if common is None:
        return None
    if common.on_overrun == "degrade" and not steps:
        reader.note((*path, "on_overrun"), common.on_overrun, "expected a list of {slot, level} in degrade")
    return RealTimeSection(common, tuple(c for c in cheaper if c is not None))


def _cheaper(
    reader: SectionReader, entry: Any, path: KeyPath, machines: Mapping[str, MachineSection]
) -> tuple[str, SlotChoice] | None:
    """A level to fall back to, with the keys of the slot's present one that it knows as well."""
    entry = reader.mapping(entry, path)
    name = entry.get("slot")
    machine, _, slot = str(name).partition(".")
    present = reader.document.data.get(machine)
    kind = reader.catalogue.kind_of(slot)
    is_there = isinstance(present, dict) and not is_off(present.get(slot, {}))
    if kind is None or not kind.is_exchangeable or not is_there:
        able = ", ".join(s.name for s in reader.catalogue.slots if s.is_exchangeable)
        reader.note((*path, "slot"), name, f"expected machine.slot of a slot that is there, of {able}")
        return None
    if "level" not in entry:
        reader.note((*path, "level"), None, "expected a level to take instead, the key is missing")
        return None
    own = {k: v for k, v in entry.items() if k != "slot"}
    chosen, found = reader.level(kind.name, own, path, "")
    if found is None:
        return None
    before = present.get(slot, {})
    before = before if isinstance(before, dict) else {}
    kept = {k: before[k] for k in known_keys(found.params) if k in before}
    common = {k: before[k] for k in SlotCommon.model_fields if k in before}
    choice = read_slot(reader, machine, slot, kind, {**kept, **chosen, **common}, "", path)
    if choice is None or machine not in machines:
        return None
    return f"{machine}.{slot}", replace(choice, wires=machines[machine].slots[slot].wires)
