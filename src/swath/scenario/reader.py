"""From plain data to the sections of a scenario, `field` among them; all errors are collected on the way."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from swath.documents.hints import unknown_key
from swath.documents.validation import known_keys
from swath.documents.yaml_document import Document, KeyPath
from swath.scenario.catalogue import Catalogue
from swath.scenario.expectations import read_evaluators, read_expect
from swath.scenario.machine_reader import is_off, machine_names, read_machines, read_slot
from swath.scenario.resolved import FieldSection, LevelChoice, MachineSection, RealTimeSection, SlotChoice
from swath.scenario.section_reader import NAME, ScenarioError, SectionReader
from swath.scenario.sections import FieldCommon, Head, RealTime, Run, SlotCommon, StartAlongEdge
from swath.scenario.versions import SECTIONS

FIELD_KEYS = (
    "folder", "terrain", "stand", "edge", "edges", "obstacles", "boundary", *FieldCommon.model_fields,
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
    boundary = data.get("boundary")
    if boundary is not None:
        boundary = reader.check(reader.catalogue.part("boundary"), boundary, ("field", "boundary"))
    if common is not None and common.origin is not None and folder is not None:
        reader.note(("field", "origin"), None, "expected no origin beside a field folder, which has its own")
    return FieldSection(
        Path(folder) if folder else None,
        levels["terrain"],
        levels["stand"],
        edges,
        obstacles,
        boundary,
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
    head = {"name": file.stem if file else "scenario"} | {k: data[k] for k in SECTIONS[:3] if k in data}
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
