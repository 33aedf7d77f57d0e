"""The section `field` of a scenario: terrain, stand, initial edges, obstacles and boundary."""

from pathlib import Path
from typing import Any

from swath.documents.hints import unknown_key
from swath.documents.validation import known_keys
from swath.scenario.resolved import FieldSection, LevelChoice
from swath.scenario.section_reader import NAME, SectionReader
from swath.scenario.sections import FieldCommon

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
