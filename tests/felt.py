"""Whether what a run says of a key that was set is so: it is felt where another value changes the digest."""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from random import Random
from typing import Any

from swath.core.asked import bare
from swath.core.errors import InputError, SwathError
from swath.core.fault import _keys
from swath.core.layout import quantities
from swath.documents.data_sheets import sheet_names
from swath.documents.validation import schema_of
from swath.field.weather import Weather
from swath.runtime.assembly import assemble
from swath.runtime.faults import make_fault
from swath.runtime.job import run_unrecorded
from swath.runtime.world import World
from swath.scenario.overrides import layered
from swath.scenario.resolved import SlotChoice
from swath.scenario.scenario import UNTOLD, Scenario, load_scenario
from swath.scenario.sections import FaultSection, RealTime

SHORT = ("run.distance_m=3", "run.max_duration_s=4", "run.record=none")
# a value of each key of the weather that is far from its default, and what it cannot be without
WEATHER: dict[str, tuple[str, ...]] = {
    "rain_mm_h": ("20",), "fog_mor_m": ("60",), "dust_per_m": ("0.02",), "wind_m_s": ("12",),
    "wind_azimuth_deg": ("20",), "temperature_c": ("5",), "humidity_percent": ("95",),
    "cloud_percent": ("80",),
    "sun_azimuth_deg": ("110", "field.weather.sun_elevation_deg=30"),
    "sun_elevation_deg": ("30", "field.weather.sun_azimuth_deg=110"),
    "time": ("2026-07-25T09:00+02:00", "field.weather={sun_elevation_deg: 30, sun_azimuth_deg: 110}"),
}  # fmt: skip
PACES = "realtime.pace=free", "realtime.factor=100"
LIMITS = {"run.distance_m": "distance", "run.max_duration_s": "time"}  # key -> how a run ends that reaches it


@dataclass(frozen=True)
class Row:
    """A key of a scenario with changes, and what else it is set to: first its default, where it has one.

    group: what has the key
    """

    scenario: str
    sets: tuple[str, ...]
    key: str
    others: tuple[str, ...]
    group: str = "field"


@dataclass(frozen=True)
class Found:
    """is_told: the run says that nothing uses the key; is_felt: its digest is another one without it."""

    is_told: bool
    is_felt: bool

    @property
    def is_false(self) -> bool:
        """A key that changes the run is said to be unused."""
        return self.is_told and self.is_felt


class Looked:
    """Runs that were driven so far, each once."""

    def __init__(self) -> None:
        self._driven: dict[tuple[str, ...], dict[str, Any]] = {}

    def drive(self, name: str, sets: tuple[str, ...]) -> dict[str, Any]:
        """Summary."""
        if (name, *sets) not in self._driven:
            self._driven[name, *sets] = run_unrecorded(load_scenario(name, sets=layered(SHORT, sets)))
        return self._driven[name, *sets]

    def look(self, row: Row) -> Found:
        """What a run says of a key, and what is so."""
        summary = self.drive(row.scenario, row.sets)
        rest = tuple(text for text in row.sets if text.partition("=")[0] != row.key)
        others = [self.drive(row.scenario, (*rest, other) if other else rest) for other in row.others]
        is_felt = any(other["digest"] != summary["digest"] for other in others)
        ended, slot = summary["ended"]["reason"], ".".join(row.key.split(".")[:2])
        is_idle = any(note.startswith(f"{slot}: it is first due") for note in summary.get("notes", []))
        is_over = not is_felt and (is_idle or LIMITS.get(row.key, ended) != ended)
        return Found(is_named(row.key, summary) or is_over, is_felt)


def is_named(key: str, summary: dict[str, Any]) -> bool:
    """Whether a run says that nothing uses a key, or what it is in."""
    begin = "no part of this run uses "
    notes = [note.removeprefix(begin) for note in summary.get("notes", []) if note.startswith(begin)]
    return any(f"{key}.".startswith(f"{note.partition(':')[0]}.") for note in notes)


def rows_of(name: str, sets: tuple[str, ...] = ()) -> Iterator[Row]:
    """The keys that a scenario sets, but for those that cannot be otherwise and how far it is driven."""
    scenario = load_scenario(name, sets=layered(SHORT, sets))
    world = assemble(scenario)
    world.close()
    driven = {text.partition("=")[0] for text in SHORT}
    for asked in world.asked:
        for key, (kind, field, _) in asked.about.items():
            if key not in driven and (others := _others(scenario, sets, key, kind, field)):
                yield Row(name, sets, key, others, _group(world, key))


def drawn_rows(name: str, sets: tuple[str, ...] = (), *, seed: int = 1, count: int = 20) -> list[Row]:
    """Keys of slots, faults, parts, machines, `run` and `realtime`, each away from its default.

    Kinds of keys come in turn, so that the many keys of parts do not crowd out the others.
    """
    world, drawn = assemble(load_scenario(name, sets=layered(SHORT, sets))), Random(f"{seed} {name} {sets}")
    world.close()
    groups: dict[str, list[Row]] = {}
    for key, value in _siblings(world, drawn):
        text = f"{key}={json.dumps(value)}"
        group = _group(world, key)
        pace = drawn.choice([text for text in PACES if not text.startswith(f"{key}=")])
        paced = (pace,) if group == "realtime" else ()
        groups.setdefault(group, []).append(Row(name, (*sets, *paced, text), key, ("",), group))
    for rows in groups.values():
        drawn.shuffle(rows)
    found: list[Row] = []
    while len(found) < count and any(groups.values()):
        found += [rows.pop() for rows in groups.values() if rows]
    return found[:count]


def _group(world: World, key: str) -> str:
    first, *rest = key.split(".")
    if first in ("field", "run", "realtime"):
        return first
    slots = world.machines[first].section.slots
    if not rest or rest[0] not in slots:
        return "machine"
    own = type(slots[rest[0]].common).model_fields
    return "part" if rest[1] not in own else "fault" if rest[1] == "fault" else "slot"


def _siblings(world: World, drawn: Random) -> Iterator[tuple[str, Any]]:
    """Keys, set or not, with another value."""
    sections: list[tuple[str, Any]] = [("run", world.scenario.run), ("realtime", RealTime())]
    for name, machine in world.machines.items():
        sections += [(name, machine.section.common), (f"{name}.start", machine.section.start)]
        others = [other for other in world.machines if other != name]
        sheets = [n for n in sheet_names("machines") if n != bare(machine.section.common).machine]
        yield f"{name}.machine", drawn.choice(sheets)
        if edges := list(world.field.edges)[1:]:
            yield f"{name}.field_edge", drawn.choice(edges)
        if others := [other for other in others if other != bare(machine.section.common).peer]:
            yield f"{name}.peer", drawn.choice(others)
        for slot, choice in machine.section.slots.items():
            path = f"{name}.{slot}"
            sections += [(path, choice.common), (path, choice.params)]
            if _may_fail(choice, machine.parts[slot]):
                sections.append((f"{path}.fault", FaultSection()))
                yield from _by_field(world, path, choice.params, drawn)
    for path, section in sections:
        yield from _away(path, section, drawn)


def _may_fail(choice: SlotChoice, part: Any) -> bool:
    said = choice.common.model_copy(update={"fault": FaultSection()})
    with suppress(InputError):
        return make_fault(replace(choice, common=said), part) is not None
    return False


def _by_field(world: World, path: str, params: Any, drawn: Random) -> Iterator[tuple[str, Any]]:
    """Faults of a field that a slot sends, and where its sensor sits."""
    machine, _, slot = path.partition(".")
    named = [
        (field, quantity)
        for port in world.machines[machine].parts[slot].outputs
        for field, quantity in quantities(port.signal).items()
        if field != "t"
    ]
    if named:
        field, quantity = drawn.choice(named)
        key = _keys(field, quantity)[0][0]
        yield f"{path}.fault.scale", {field: 1.2}
        yield f"{path}.fault.{drawn.choice(['bias', 'noise', 'stuck'])}", {key: 0.1}
    if is_dataclass(mount := getattr(params, "mount", None)):
        keys = [f.name for f in fields(mount) if isinstance(getattr(mount, f.name), float | int)]
        yield f"{path}.mount_error", {drawn.choice(keys): 0.1}


def _away(path: str, section: Any, drawn: Random) -> Iterator[tuple[str, Any]]:
    if section is None:
        return
    schema = schema_of(section.__class__)
    own = schema["$defs"].get(schema.get("$ref", "").rpartition("/")[2], schema).get("properties", {})
    for name, node in own.items():
        value = getattr(section, name, None)
        if name == "offset_ms":
            yield f"{path}.{name}", round(drawn.uniform(0.1, 0.9) * 1e3 / section.rate_hz, 3)
        elif name in ("hold_s", "silent_s"):
            begin = drawn.choice([0.5, 50.0])
            yield f"{path}.{name}", [[begin, begin + 1.0]]
        elif is_dataclass(value):
            yield from _away(f"{path}.{name}", value, drawn)
        elif f"{path}.{name}" not in UNTOLD:
            for other in _value_away(node, schema["$defs"], value, drawn):
                yield f"{path}.{name}", other


def _value_away(node: dict[str, Any], defs: dict[str, Any], value: Any, drawn: Random) -> list[Any]:
    """Another value by the schema of a key; [] where it is text, a list or a mapping."""
    if "$ref" in node:
        return _value_away(defs[node["$ref"].rpartition("/")[2]], defs, value, drawn)
    if "anyOf" in node:
        found = [v for each in node["anyOf"] for v in _value_away(each, defs, value, drawn)]
        return found[:1]
    if others := [choice for choice in node.get("enum", []) if choice != value]:
        return [drawn.choice(others)]
    if node.get("type") == "boolean":
        return [not value]
    if node.get("type") not in ("number", "integer"):
        return []
    low = node.get("minimum", node.get("exclusiveMinimum", -10.0))
    high = min(node.get("maximum", node.get("exclusiveMaximum", low + 20.0)), low + 1000.0)
    is_number = isinstance(value, float | int) and value
    other = value * drawn.choice([0.6, 1.4]) if is_number else low + drawn.uniform(0.05, 0.5) * (high - low)
    other = min(max(other, low), high)
    other = round(other) if node["type"] == "integer" else round(other, 4)
    return [] if other == value else [other]


def weather_rows(name: str, sets: tuple[str, ...] = ()) -> Iterator[Row]:
    """All keys of the weather."""
    for key, (value, *more) in WEATHER.items():
        own = f"field.weather.{key}"
        kept = [text for text in sets if not text.startswith(f"{own}=")]
        other = {"sun_azimuth_deg": 200.0, "sun_elevation_deg": 50.0}.get(key, USUAL[key])  # it needs both
        yield Row(name, (*kept, *more, f"{own}={value}"), own, (f"{own}={json.dumps(other)}",))


def _others(scenario: Scenario, sets: tuple[str, ...], key: str, kind: Any, field: str) -> tuple[str, ...]:
    """Changes that take a key away, or make it another; () where it cannot be."""
    value: Any = scenario.lifted()
    for part in key.split("."):
        value = value[int(part)] if isinstance(value, list) else value[part]
    rest = tuple(text for text in sets if text.partition("=")[0] != key)
    found = []
    for other in (*_default(kind, field), *_other(value)):
        text = f"{key}={json.dumps(other)}"
        with suppress(SwathError, TypeError):
            assemble(load_scenario(scenario.name, sets=layered(SHORT, (*rest, text)))).close()
            found.append(text)
    return tuple(found[:2])


def _default(kind: Any, field: str) -> list[Any]:
    if not is_dataclass(kind):
        own = kind.model_fields[field]
        return [] if own.is_required() else [own.get_default(call_default_factory=True)]
    (own,) = (f for f in fields(kind) if f.name == field)
    if own.default_factory is not MISSING:
        return [] if is_dataclass(made := own.default_factory()) else [made]
    return [] if own.default is MISSING or is_dataclass(bare(own.default)) else [own.default]


def _other(value: Any) -> list[Any]:
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1, value - 1]
    return [0.9 * value, 1.1 * value, 0.1] if isinstance(value, float) else []


USUAL = {f.name: f.default for f in fields(Weather)}
# scenarios in which each key of the weather is looked at, with what makes more of it felt
WITH_WEATHER: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("straight", ()),
    ("straight", ("field.stand.wind={}", "combine.lidar.level=empirical")),
    ("straight", ("combine.lidar.daylight.shot_noise=20", "field.weather.sun_elevation_deg=30",
                  "field.weather.sun_azimuth_deg=110", "combine.lidar.level=empirical")),
    ("straight", ("combine.lidar.level=empirical", "field.stand.straw_moisture_percent=weather")),
    ("drifting-dust", ()),
    ("evening-camera", ()),
    ("fawn-at-dawn", ()),
)  # fmt: skip
