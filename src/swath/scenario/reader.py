"""From plain data to the sections of a scenario, collecting every error on the way."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, SwathError
from swath.core.registry import Level
from swath.documents.data_sheets import find_sheet
from swath.documents.hints import near_miss, unknown_key
from swath.documents.validation import known_keys, validate
from swath.documents.yaml_document import Document, KeyPath, read_document
from swath.scenario.catalogue import Catalogue
from swath.scenario.expectations import read_evaluators, read_expect
from swath.scenario.machine_types import slots_of
from swath.scenario.resolved import FieldSection, LevelChoice, MachineSection, RealTimeSection, SlotChoice
from swath.scenario.sections import (
    Head,
    MachineCommon,
    RealTime,
    Run,
    SlotCommon,
    StartAlongEdge,
    StartPose,
)
from swath.scenario.slots import SlotKind
from swath.scenario.versions import SECTIONS

FIELD_KEYS = ("folder", "terrain", "stand", "edge", "edges", "obstacles", "boundary")
MACHINE_KEYS = ("machine", "header_width_m", "start", "edge_side", "field_edge")
CARDS = {"machine": "machines", "sensor": "sensors", "crop": "crops"}
_NAME = re.compile(r"^[A-Za-z_][A-Za-z0-9_-]{0,40}$")


class ScenarioError(InputError):
    """The first thing wrong in a scenario; `others` are the rest, in the order found."""

    def __init__(self, errors: list[InputError]) -> None:
        first = errors[0]
        super().__init__(first.key, first.value, first.expected, file=first.file, line=first.line)
        self.others = tuple(errors[1:])


class Reader:
    """Reads one document. `read` gives the arguments of a Scenario, or raises ScenarioError."""

    def __init__(self, document: Document, catalogue: Catalogue) -> None:
        self.document, self.catalogue = document, catalogue
        self.folder = document.file.resolve().parent if document.file else Path.cwd()
        self.errors: list[InputError] = []

    def read(self) -> dict[str, Any]:
        """Every section. ScenarioError when anything is wrong."""
        data = self.document.data
        if not isinstance(data, dict):
            text = "expected keys such as name, run, field and combine"
            raise ScenarioError([self.document.error((), data, text)])
        file = self.document.file
        head = {"name": file.stem if file else "scenario"} | {k: data[k] for k in SECTIONS[:3] if k in data}
        checked = self.check(Head, head, ())
        parts: dict[str, Any] = {} if checked is None else dict(checked)
        machines = self._machine_names(data)
        parts["run"] = self.check(Run, data.get("run", {}), ("run",))
        parts["field"] = self._field(data.get("field", {}))
        parts["machines"] = self._machines({name: data[name] for name in machines})
        parts["realtime"] = self._realtime(data["realtime"]) if "realtime" in data else None
        parts["evaluators"], judged = read_evaluators(self, data.get("evaluators", []))
        parts["expect"] = read_expect(self, data.get("expect", {}), judged, machines, parts["machines"])
        if self.errors:
            raise ScenarioError(self.errors)
        return parts

    def check(self, kind: Any, data: Any, path: KeyPath) -> Any:
        """The validated object; None when there were errors, which are noted."""
        value, found = validate(kind, data, path, self.document)
        self.errors += found
        return value

    def note(self, path: KeyPath, value: Any, expected: str) -> None:
        """Note an error."""
        self.errors.append(self.document.error(path, value, expected))

    def mapping(self, data: Any, path: KeyPath) -> dict[str, Any]:
        """The mapping at a path; an empty one, and an error noted, when it is something else."""
        if isinstance(data, dict):
            return data
        self.note(path, "(nothing)" if data is None else data, "expected a mapping of keys")
        return {}

    def unknown(self, data: Mapping[str, Any], path: KeyPath, known: tuple[str, ...]) -> None:
        """Note every key that is not known."""
        for key in data:
            if key not in known:
                self.note((*path, key), None, unknown_key(key, known))

    def base(self, path: KeyPath) -> Path:
        """Where a relative path starts: the scenario's folder, or for a flag the working directory."""
        place = self.document.place(path)
        return Path.cwd() if place is not None and place.line is None else self.folder

    # real time

    def _realtime(self, data: Any) -> RealTimeSection | None:
        path = ("realtime",)
        data = self.mapping(data, path)
        steps = data.get("degrade", [])
        self.unknown(data, path, (*RealTime.model_fields, "degrade"))
        own = {k: v for k, v in data.items() if k in RealTime.model_fields}
        common = self.check(RealTime, own, path)
        if not isinstance(steps, list):
            self.note((*path, "degrade"), steps, "expected a list of {slot, level}")
            return None
        cheaper = [self._cheaper(entry, (*path, "degrade", i)) for i, entry in enumerate(steps)]
        if common is None:
            return None
        if common.on_overrun == "degrade" and not steps:
            self.note((*path, "on_overrun"), common.on_overrun, "expected a list of {slot, level} in degrade")
        return RealTimeSection(common, tuple(c for c in cheaper if c is not None))

    def _cheaper(self, entry: Any, path: KeyPath) -> tuple[str, SlotChoice] | None:
        """A level to fall back to, with the keys of the slot's present one that it knows as well."""
        entry = self.mapping(entry, path)
        name = entry.get("slot")
        machine, _, slot = str(name).partition(".")
        present = self.document.data.get(machine)
        kind = self.catalogue.kind_of(slot)
        is_there = isinstance(present, dict) and not _is_off(present.get(slot, {}))
        if kind is None or not kind.is_exchangeable or not is_there:
            able = ", ".join(s.name for s in self.catalogue.slots if s.is_exchangeable)
            self.note((*path, "slot"), name, f"expected machine.slot of a slot that is there, of {able}")
            return None
        if "level" not in entry:
            self.note((*path, "level"), None, "expected a level to take instead, the key is missing")
            return None
        own = {k: v for k, v in entry.items() if k != "slot"}
        chosen, found = self._level(kind.name, own, path, "")
        if found is None:
            return None
        before = present.get(slot, {})
        before = before if isinstance(before, dict) else {}
        kept = {k: before[k] for k in known_keys(found.params) if k in before}
        common = {k: before[k] for k in SlotCommon.model_fields if k in before}
        choice = self._slot(machine, slot, kind, {**kept, **chosen, **common}, "", path)
        return None if choice is None else (f"{machine}.{slot}", choice)

    # field

    def _field(self, data: Any) -> FieldSection | None:
        data = self.mapping(data, ("field",))
        self.unknown(data, ("field",), FIELD_KEYS)
        levels_of = ("terrain", "stand")
        data = {k: v if k in levels_of else self._with_path(k, v, ("field", k)) for k, v in data.items()}
        folder = data.get("folder")
        if folder is not None and not isinstance(folder, str):
            self.note(("field", "folder"), folder, "expected a path")
            folder = None
        levels = {name: self._ground(name, data, folder is not None) for name in levels_of}
        edges = self._edges(data)
        obstacles = self._obstacles(data.get("obstacles", []))
        boundary = data.get("boundary")
        if boundary is not None:
            boundary = self.check(self.catalogue.part("boundary"), boundary, ("field", "boundary"))
        return FieldSection(
            Path(folder) if folder else None,
            levels["terrain"],
            levels["stand"],
            edges,
            obstacles,
            boundary,
        )

    def _edges(self, data: dict[str, Any]) -> dict[str, Any]:
        """The initial edges by name: the one of `edge`, or those of `edges`."""
        kind = self.catalogue.part("edge")
        if "edges" not in data:
            return {"edge": self.check(kind, data.get("edge", {}), ("field", "edge"))}
        path = ("field", "edges")
        if "edge" in data:
            self.note(path, None, "expected either `edge` or `edges`")
        edges = data["edges"]
        if not isinstance(edges, dict) or not edges:
            self.note(path, edges, "expected at least one edge by name, such as `west: {x_m: 0}`")
            return {}
        for name in edges:
            if not _NAME.match(name):
                self.note((*path, name), None, "expected an edge's name: letters, digits, - and _")
        return {name: self.check(kind, entry, (*path, name)) for name, entry in edges.items()}

    def _ground(self, name: str, data: dict[str, Any], has_folder: bool) -> LevelChoice | None:
        if name not in data and has_folder:
            return None
        path = ("field", name)
        entry, found = self._level(name, data.get(name, {}), path, self.catalogue.field_levels[name])
        if found is None:
            return None
        params = self._params(found, {k: v for k, v in entry.items() if k != "level"}, path)
        return LevelChoice(entry["level"], found, params)

    def _obstacles(self, data: Any) -> tuple[Any, ...]:
        path = ("field", "obstacles")
        if not isinstance(data, list):
            self.note(path, "(nothing)" if data is None else data, "expected a list")
            return ()
        kind = self.catalogue.part("obstacles")
        return tuple(self.check(kind, entry, (*path, i)) for i, entry in enumerate(data))

    # machines

    def _machine_names(self, data: dict[str, Any]) -> list[str]:
        """The top-level keys that are machines; notes those that are neither machine nor section."""
        named = [key for key in data if key not in SECTIONS]
        if not named:
            self.note((), None, "expected a machine under `machines:`, such as `combine:` with its slots")
        return [name for name in named if self._is_machine(name, data)]

    def _is_machine(self, name: str, data: dict[str, Any]) -> bool:
        section = data[name]
        known = (*MACHINE_KEYS, *(s.name for s in self.catalogue.slots))
        is_machine = isinstance(section, dict) and (
            not section or any(key in known or self.catalogue.kind_of(key) for key in section)
        )
        if not is_machine:
            absent = [key for key in SECTIONS if key not in data]
            hint = near_miss(name, absent) or f"; a machine has keys such as {', '.join(known[:4])}"
            self.note((name,), None, "unknown key" + hint)
            return False
        if not _NAME.match(name):
            self.note((name,), None, "expected a machine's name: letters, digits, - and _")
            return False
        return True

    def _machines(self, data: dict[str, Any]) -> dict[str, MachineSection]:
        read = [self._machine(name, section) for name, section in data.items()]
        machines = {m.name: m for m in read if m is not None}
        if not self.errors:
            for machine in machines.values():
                self._check_sources(machine, machines)
        return machines

    def _machine(self, name: str, data: dict[str, Any]) -> MachineSection | None:
        own = {k: self._with_path(k, data[k], (name, k)) for k in MachineCommon.model_fields if k in data}
        common = self.check(MachineCommon, own, (name,))
        start = self._start(data.get("start", {}), (name, "start"))
        if common is None:
            return None
        try:
            sheet = find_sheet("machines", common.machine)
        except (InputError, OSError, ValueError):
            return None  # noted when its path was looked at
        unasked = self._slots_of_type(sheet, (name, "machine"))
        chosen: dict[str, SlotChoice] = {}
        for kind, slot in self._instances(name, data, unasked):
            choice = self._slot(name, slot, kind, data.get(slot, {}), unasked.get(slot, kind.level))
            if choice is not None:
                chosen[slot] = choice
        slots = {slot: replace(c, wires=_wires(name, c, chosen)) for slot, c in chosen.items()}
        off = tuple(slot for slot in unasked if _is_off(data.get(slot)))
        return MachineSection(name, common, sheet, start, slots, off)

    def _slots_of_type(self, sheet: Path, path: KeyPath) -> dict[str, str]:
        """Slot -> level of what a machine has unasked, by the type on its data sheet."""
        try:
            data = read_document(sheet).data
        except InputError as error:
            self.errors.append(error)
            return {}
        data = data if isinstance(data, dict) else {}
        machine_type, own = data.get("type", "combine"), data.get("slots", {})
        if machine_type not in self.catalogue.machine_types:
            self.note(
                path, machine_type, f"expected a data sheet of type {', '.join(self.catalogue.machine_types)}"
            )
            return {}
        return slots_of(self.catalogue.machine_types[machine_type], own if isinstance(own, dict) else {})

    def _instances(
        self, machine: str, data: dict[str, Any], unasked: Mapping[str, str]
    ) -> list[tuple[SlotKind, str]]:
        """Every slot of a machine with its kind, in the order of one tick; notes unknown keys."""
        named = [key for key in data if key not in MACHINE_KEYS]
        for key in named:
            if self.catalogue.kind_of(key) is None:
                plural = [f"{s.name}_NAME" for s in self.catalogue.slots if s.is_plural]
                known = [*MACHINE_KEYS, *(s.name for s in self.catalogue.slots), *plural]
                self.note((machine, key), None, unknown_key(key, known))
        slots = [slot for slot in dict.fromkeys([*unasked, *named]) if not _is_off(data.get(slot))]
        return [
            (kind, slot)
            for kind in self.catalogue.slots
            for slot in slots
            if self.catalogue.kind_of(slot) is kind
        ]

    def _start(self, data: Any, path: KeyPath) -> StartAlongEdge | StartPose:
        in_world = isinstance(data, dict) and any(k in data for k in StartPose.model_fields)
        start: StartAlongEdge | StartPose = self.check(StartPose if in_world else StartAlongEdge, data, path)
        return start

    def _slot(
        self,
        machine: str,
        slot: str,
        kind: SlotKind,
        data: Any,
        level: str,
        path: KeyPath | None = None,
    ) -> SlotChoice | None:
        """The choice for a slot. level: where the data names none; path: where the data was written."""
        path = (machine, slot) if path is None else path
        entry, found = self._level(kind.name, data, path, level)
        if found is None:
            return None
        common_keys = tuple(SlotCommon.model_fields)
        own = {k: v for k, v in entry.items() if k != "level" and k not in common_keys}
        params = self._params(found, own, path, common_keys)
        common = {"rate_hz": kind.rate_hz} | {k: entry[k] for k in common_keys if k in entry}
        checked = self.check(SlotCommon, common, path)
        if checked is None:
            return None
        return SlotChoice(entry["level"], found, params, checked, kind)

    def _check_sources(self, machine: MachineSection, machines: Mapping[str, MachineSection]) -> None:
        """Every wire that the scenario wrote must come from a slot that is there."""
        slots = [f"{m.name}.{s}" for m in machines.values() for s in m.slots]
        for slot, choice in machine.slots.items():
            for port in choice.common.wires:
                source = choice.wires[port][0]
                if source not in slots:
                    text = f"expected slot.output of a slot that is there{near_miss(source, slots)}"
                    self.note((machine.name, slot, "wires", port), choice.common.wires[port], text)

    # levels

    def _level(
        self, kind: str, data: Any, path: KeyPath, default: str
    ) -> tuple[dict[str, Any], Level | None]:
        """The entry as a mapping with its level filled in, and the level, None when it cannot be had."""
        if isinstance(data, str):
            data, where = {"level": data}, path
        else:
            where = (*path, "level")
        entry = {"level": default} | self.mapping(data, path)
        level = entry["level"]
        if not isinstance(level, str):
            self.note(where, "(nothing)" if level is None else level, "expected a level's name")
            return entry, None
        try:
            found = self.catalogue.registry.get(kind, level, base=self.base(where))
        except InputError as error:
            self.note(where, level, error.expected)
        except (OSError, ValueError):
            self.note(where, level, "expected a level's name, or file.py:Class")
        except SwathError as error:
            self.note(where, level, str(error))
        else:
            if callable(found.component):
                entry["level"] = self.absolute_level(level, self.base(where))
                return self._with_paths(entry, path), found
            self.note(where, level, "expected a class")
        return entry, None

    def absolute_level(self, level: str, base: Path) -> str:
        """`file.py:Class` with the whole path of the file; a level's name as it is."""
        file, colon, name = level.rpartition(":")
        return f"{(base / file).resolve()}:{name}" if colon and ".py:" in level else level

    def _params(self, found: Level, data: dict[str, Any], path: KeyPath, also: tuple[str, ...] = ()) -> Any:
        """Validated parameters. Unknown keys are noted here: they may be meant for the slot itself."""
        known = known_keys(found.params)
        for key in data:
            if key not in known:
                self.note((*path, key), None, unknown_key(key, [*known, "level", *also]))
        own = {k: v for k, v in data.items() if k in known}
        return None if found.params is None else self.check(found.params, own, path)

    def _with_paths(self, data: Any, path: KeyPath) -> Any:
        """The data with the paths in it made absolute; notes what is not there."""
        if isinstance(data, list):
            return [self._with_paths(item, (*path, i)) for i, item in enumerate(data)]
        if not isinstance(data, dict):
            return data
        return {key: self._with_path(key, value, (*path, key)) for key, value in data.items()}

    def _with_path(self, key: str, value: Any, path: KeyPath) -> Any:
        if not isinstance(value, str):
            return self._with_paths(value, path)
        if key in CARDS:
            return self._card(CARDS[key], value, path)
        if key in ("file", "folder") or key.endswith(("_file", "_folder")):
            return self._existing(key, value, path)
        return value

    def _card(self, kind: str, value: str, path: KeyPath) -> str:
        """A bundled data sheet's name as it is, the user's own file as an absolute path."""
        try:
            file = find_sheet(kind, value, self.base(path))
        except InputError as error:
            self.note(path, value, error.expected)
            return value
        except (OSError, ValueError):
            self.note(path, value, "expected a name, or a YAML file")
            return value
        return str(file.resolve()) if value.endswith((".yaml", ".yml")) else value

    def _existing(self, key: str, value: str, path: KeyPath) -> str:
        wants_folder = key.endswith("folder")
        try:
            target = (self.base(path) / value).resolve()
            is_there = target.is_dir() if wants_folder else target.is_file()
        except (OSError, ValueError, RuntimeError):
            is_there = False
        if is_there:
            return str(target)
        self.note(path, value, f"there is no such {'folder' if wants_folder else 'file'}")
        return value


def _wires(machine: str, choice: SlotChoice, slots: Mapping[str, SlotChoice]) -> dict[str, tuple[str, str]]:
    """Input port -> (full slot name, output): those of the kind, with what the scenario wrote on top.

    Where a machine has one slot of a kind, its name does not matter.
    """
    wires = {}
    for port, (kind, output) in choice.kind.wires.items():
        instances = [slot for slot, other in slots.items() if other.kind.name == kind]
        source = instances[0] if len(instances) == 1 else kind
        wires[port] = (f"{machine}.{source}", output)
    for port, text in choice.common.wires.items():
        source, _, output = text.rpartition(".")
        wires[port] = (source if "." in source else f"{machine}.{source}", output)
    return wires


def _is_off(entry: Any) -> bool:
    return entry is False or entry == "off"
