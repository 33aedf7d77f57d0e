"""Changes to a run while it goes: another level, another parameter, an obstacle more or less.

    changes = Interventions(world)
    changes.set(t, "combine.speed.speed_kmh", 5)            # a parameter; the part keeps its state
    changes.set(t, "combine.edge.level", "otsu")            # another level, which starts from the present
    changes.set(t, "obstacles.pole", "{kind: post, x_m: 12, y_m: 3}")
    changes.set(t, "obstacles.pole", None)
    changes.set(t, "obstacles.walker", "{kind: person, x_m: 9, y_m: 3, path: {to: [[9, -3]]}}")

Keys and values are those of `--set`. Each change takes effect before the tick at t; what was done is kept in
`events` and does the same again through `Script`. Of code that is not swath's, and of files that are read,
only those come in which the scenario names, or who started the run: a change may be somebody else's, over
ROS 2 or in a recording, and files are read with the user's rights.
"""

import dataclasses
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from swath.core.abilities import Closes
from swath.core.errors import InputError
from swath.core.foreign_code import allow_code, file_of, only_code, present_gate, through
from swath.core.schedule import NS
from swath.documents.json_file import read_json
from swath.documents.yaml_document import parse_value
from swath.field.memory_layout import Solids
from swath.field.solid.obstacles import things_of
from swath.field.solid.solids import merge
from swath.runtime.assembly import exchange, make_part
from swath.runtime.world import World
from swath.scenario.resolved import SlotChoice
from swath.scenario.scenario import Scenario, code_of, folder_of, parse_scenario
from swath.scenario.slots import CATALOGUE


def named_files(value: Any, base: Path) -> set[Path]:
    """What among the texts of a value, however deep, is there as a file or folder, absolute.

    A single word without a dot or slash is a level, a name or a kind, even where something is called so; for
    `file.py:Class` see `scenario.code_of`.
    """
    return {path for text in _texts(value) if (path := _there(text, base)) is not None}


def files_of(scenario: Scenario) -> set[Path]:
    """Files and folders that a scenario names."""
    base = folder_of(scenario)
    machines = [machine.plain() for machine in scenario.machines.values()]
    return named_files([scenario.field.plain(), *machines], base)


def _there(text: str, base: Path) -> Path | None:
    if ".py:" in text or not any(mark in text for mark in "./\\~"):
        return None
    try:
        path = (base / Path(text).expanduser()).resolve()
        return path if os.path.exists(path) else None
    except (OSError, ValueError, RuntimeError):
        return None


def _texts(value: Any) -> Iterator[str]:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = vars(value)
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, dict):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, list | tuple | set | frozenset):
        for part in value:
            yield from _texts(part)


OBSTACLES = "obstacles"
MOST_SECONDS = 1e9  # of a run
MOST_EVENTS = 1000  # that are done again: for each the scenario is read, a tenth of a second


class Restart(Exception):  # not an error: whoever drives the run begins again
    """A run is to begin anew; raised by a `before_tick`."""


class Interventions:
    """Changes a world, and keeps a list of what was changed.

    events: per change the simulated time `t_s`, the key `set` and its new `value`, None where it was removed
    allow: what may be set beside what the scenario names: code, files or `file.py:Class`, and files that are
    read, or folders with them
    """

    def __init__(self, world: World, allow: Iterable[str] = ()) -> None:
        self.world = world
        allowed = [file_of(text) for text in allow]
        with through(world.scenario.gate), allow_code(allowed):
            self._gate = present_gate()
        self._code = (*code_of(world.scenario), *allowed)
        self._allowed = set(allowed)
        self.events: list[dict[str, Any]] = []
        self._fixed = {str(i): o for i, o in enumerate(world.scenario.field.obstacles)}
        self._added: dict[str, Any] = {}

    @cached_property
    def _files(self) -> set[Path]:
        """What may be read; looked up when the first change comes."""
        return files_of(self.world.scenario) | self._allowed

    @cached_property
    def _now(self) -> Scenario:
        """The scenario as it stands; read when the first change comes."""
        with through(self._gate):
            return _freshly_read(self.world.scenario, [])

    def set(self, t: int, key: str, value: Any) -> None:
        """Change `key` before the tick at t [ns]. SwathError, and no change, if it cannot be."""
        first, _, rest = key.partition(".")
        self._need_known_files(key, value)
        lockstep = self.world.graph.lockstep
        lockstep.look()  # what was sent before is of the world as it was
        with through(self._gate), only_code(self._code):
            if first == OBSTACLES and rest:
                self._set_obstacle(t, rest, value)
            else:
                self._set_slot(key, value)
        lockstep.look_around()
        self.events.append({"t_s": t / NS, "set": key, "value": value})

    def check(self, key: str, value: Any) -> None:
        """What `set` finds wrong by reading alone. SwathError."""
        self._need_known_files(key, value)
        with through(self._gate), only_code(self._code):
            after_change(self._now, key, value)

    def _need_known_files(self, key: str, value: Any) -> None:
        """InputError where a change would read a file that neither the scenario nor `allow` names."""
        given = parse_value(_text(value), key)
        found = named_files(given, folder_of(self.world.scenario))
        new = sorted(f for f in found if not any(f == k or k in f.parents for k in self._files))
        if new:
            expected = f"expected no file but those that the scenario or --allow names, not {new[0]}"
            raise InputError(key, value, expected)

    def values(self) -> dict[str, Any]:
        """What can be set, and how it stands: plain numbers, texts, truths and lists of one kind."""
        found: dict[str, Any] = {}
        for machine in self._now.machines.values():
            for slot, choice in machine.slots.items():
                common = {*type(choice.common).model_fields}
                own = {k: v for k, v in choice.plain().items() if k not in common}
                found |= _flat(f"{machine.name}.{slot}", own)
        plain = self._now.field.plain().get("obstacles", [])
        for name in self._fixed:
            found[f"{OBSTACLES}.{name}"] = json.dumps(plain[int(name)])
        return found | {f"{OBSTACLES}.{name}": text for name, text in self._added.items()}

    def levels(self) -> dict[str, list[str]]:
        """The levels that swath has for each slot, by the key that sets one."""
        return {
            f"{machine.name}.{slot}.level": CATALOGUE.registry.names(kind.name)
            for machine in self._now.machines.values()
            for slot in machine.slots
            if (kind := CATALOGUE.kind_of(slot)) is not None
        }

    def _set_slot(self, key: str, value: Any) -> None:
        slot, before, after, wanted = _slot_after(self._now, key, value)
        self._exchange(slot, before, after)
        self._now = wanted

    def _exchange(self, name: str, before: SlotChoice, after: SlotChoice) -> None:
        """The same level goes on with its state, another one starts from the present."""
        machine, _, slot = name.partition(".")
        is_same = before.level == after.level
        state = self.world.machines[machine].parts[slot].save() if is_same else None
        component, wires = make_part(self.world, name, after)
        try:
            exchange(self.world, name, component, wires, state=state, choice=after)
        except BaseException as error:
            if isinstance(component, Closes):
                component.close()
            if isinstance(error, (LookupError, TypeError, ValueError)):
                text = f"cannot change while it runs, the state of the part does not fit ({error})"
                raise InputError(name, None, text) from error
            raise

    def _set_obstacle(self, t: int, name: str, value: Any) -> None:
        world, key = self.world, f"{OBSTACLES}.{name}"
        if value in (None, ""):
            if name in self._added:
                world.remove_obstacle(key)
                del self._added[name]
            elif name in self._fixed:
                del self._fixed[name]
                self._keep_fixed()
            else:
                there = ", ".join([*self._fixed, *self._added]) or "none"
                raise InputError(key, None, f"expected an obstacle that is there: {there}")
            return
        if name in self._fixed:
            raise InputError(key, value, "expected another name: the scenario's own can only be removed")
        (thing,) = things_of((_obstacle(self._now, key, value),), world.field)
        world.add_obstacle(key, thing, t)
        self._added[name] = _text(value)

    def _keep_fixed(self) -> None:
        """The solids of the scenario that are left, in place: every sensor holds the same object."""
        things = things_of(tuple(self._fixed.values()), self.world.field)
        self.world.bodies.set_things(things)
        left = merge(*(thing.in_world for thing in things if thing.way is None))
        for field in dataclasses.fields(Solids):
            setattr(self.world.obstacles, field.name, getattr(left, field.name))


def after_change(scenario: Scenario, key: str, value: Any) -> Scenario:
    """The scenario with another level or parameter; that of obstacles is only read. SwathError."""
    first, _, rest = key.partition(".")
    if first != OBSTACLES or not rest:
        return _slot_after(scenario, key, value)[3]
    if value not in (None, ""):
        _obstacle(scenario, key, value)
    return scenario


def _slot_after(scenario: Scenario, key: str, value: Any) -> tuple[str, SlotChoice, SlotChoice, Scenario]:
    """Slot, old choice, new choice, and the changed scenario."""
    machine, slot, part = [*key.split(".", 2), "", ""][:3]
    section = scenario.machines.get(machine)
    if section is None or slot not in section.slots or not part:
        expected = "expected machine.slot.level, machine.slot.parameter or obstacles.name"
        raise InputError(key, value, expected)
    before = section.slots[slot]
    wanted = _freshly_read(scenario, [f"{key}={_text(value)}"])
    after = wanted.machines[machine].slots[slot]
    if part.split(".")[0] in type(before.common).model_fields or after.common != before.common:
        raise InputError(key, value, "expected a level or a parameter of it, rhythm and wires stay")
    return f"{machine}.{slot}", before, after, wanted


def _obstacle(scenario: Scenario, key: str, value: Any) -> Any:
    """What an obstacle's text says."""
    read = _freshly_read(scenario, [f"field.{OBSTACLES}=[{_text(value)}]"]).field.obstacles
    if len(read) != 1:
        raise InputError(key, value, "expected one obstacle, each has its own name")
    return read[0]


class Script:
    """Does recorded events again; put it into `Graph.before_tick`. events: as in summary.json."""

    def __init__(self, changes: Interventions, events: Sequence[Mapping[str, Any]]) -> None:
        self._changes = changes
        self._left = sorted(events, key=lambda e: float(e["t_s"]))

    def __call__(self, t: int) -> None:
        """What is due before the tick at t [ns]."""
        while self._left and round(self._left[0]["t_s"] * NS) <= t:
            event = self._left.pop(0)
            self._changes.set(t, str(event["set"]), event["value"])


def read_events(source: Path) -> list[dict[str, Any]]:
    """The events of a run folder, or of a JSON file that is a list of them. InputError."""
    file = source / "summary.json" if os.path.isdir(source) else source
    data = read_json(file, "--events", "a run folder, or a JSON file of events")
    found = data.get("events", []) if isinstance(data, dict) else data
    is_list = isinstance(found, list) and all(isinstance(e, dict) for e in found)
    if not is_list or any({"t_s", "set", "value"} - set(e) or not _is_time(e["t_s"]) for e in found):
        raise InputError("--events", str(source), "expected events with t_s, set and value")
    if len(found) > MOST_EVENTS:
        raise InputError("--events", len(found), f"expected at most {MOST_EVENTS}", file=file)
    return list(found)


def _is_time(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and 0.0 <= value <= MOST_SECONDS


def _freshly_read(scenario: Scenario, sets: list[str]) -> Scenario:
    base = scenario.file.parent if scenario.file is not None else None
    return parse_scenario(scenario.resolved(), base=base, sets=sets)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _flat(prefix: str, data: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, dict):
            found |= _flat(f"{prefix}.{key}", value)
        elif _is_plain(value):
            found[f"{prefix}.{key}"] = value
    return found


def _is_plain(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and len({type(v) for v in value}) == 1 and not isinstance(value[0], (list, dict))
    return isinstance(value, (bool, int, float, str))
