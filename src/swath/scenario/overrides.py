"""`--set combine.lidar.level=empirical`: changes to a scenario before it is checked."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, SwathError
from swath.documents.validation import known_keys
from swath.documents.yaml_document import Document, KeyPath, Place, key_path, parse_value
from swath.scenario.catalogue import Catalogue
from swath.scenario.versions import short_key


def apply_overrides(
    document: Document, sets: Sequence[str], catalogue: Catalogue, flags: Mapping[str, str]
) -> None:
    """Change the document in place. Errors about these values will name the flag.

    flags: further changes, by the flag that stands for them: {"--seed 3": "seed=3"}.
    Their order does not matter: what holds for more comes first, a section before its level, a level before
    its parameters; of the same key given twice the last one counts.
    Choosing another level drops the parameters that only the level before it knew.
    """
    changes = []
    for flag, text in [*((f"--set {s}", s) for s in sets), *flags.items()]:
        key, equals, value_text = text.partition("=")
        path = key_path(short_key(key.strip()))
        if not equals or "" in path:
            raise InputError(flag, None, "expected --set key.key=value")
        changes.append((flag, path, value_text))
    changes.sort(key=lambda change: (len(change[1]), change[1][-1] != "level"))
    for flag, path, value_text in changes:
        value = parse_value(value_text, flag)
        if not isinstance(document.data, dict):
            raise document.error((), document.data, "expected a mapping of keys")
        _expand(document.data, path, catalogue)
        if path[-1] == "level" and len(path) == 3:
            _drop_foreign(document, path, value, catalogue)
        _put(document.data, path, value, flag)
        for place in [p for p in document.places if p[: len(path)] == path]:
            del document.places[place]
        for end in range(1, len(path) + 1):
            document.places.setdefault(path[:end], Place(flag))


def _expand(data: dict[str, Any], path: KeyPath, catalogue: Catalogue) -> None:
    """`steer: preview` becomes `steer: {level: preview}` when a key inside it is set."""
    if len(path) >= 3 and _kind(path, catalogue):
        section = data.get(str(path[0]))
        if isinstance(section, dict) and isinstance(section.get(path[1]), str):
            section[str(path[1])] = {"level": section[path[1]]}


def _drop_foreign(document: Document, path: KeyPath, level: Any, catalogue: Catalogue) -> None:
    section = document.data.get(path[0])
    entry = section.get(path[1]) if isinstance(section, dict) else None
    kind = _kind(path, catalogue)
    if not isinstance(entry, dict) or not kind:
        return
    base = document.file.resolve().parent if document.file else None
    try:
        before = known_keys(
            catalogue.registry.get(
                kind, str(entry.get("level", catalogue.default_level(kind))), base=base
            ).params
        )
        after = known_keys(catalogue.registry.get(kind, str(level), base=Path.cwd()).params)
    except (SwathError, OSError, ValueError):
        return  # reported when the scenario is read
    for key in [k for k in entry if k in before and k not in after]:
        del entry[key]


def _kind(path: KeyPath, catalogue: Catalogue) -> str:
    """The slot kind that a path such as machine.slot.key leads into, or `terrain`, `stand`; else empty."""
    name = str(path[1])
    if path[0] == "field":
        return name if name in catalogue.field_levels else ""
    kind = catalogue.kind_of(name)
    return kind.name if kind is not None else ""


def _put(data: Any, path: KeyPath, value: Any, flag: str) -> None:
    for depth, part in enumerate(path):
        is_last = depth == len(path) - 1
        if isinstance(data, list):
            if not isinstance(part, int) or part >= len(data):
                raise InputError(flag, None, f"expected a number below {len(data)} instead of {part!r}")
            if is_last:
                data[part] = value
            data = data[part]
            continue
        if not isinstance(data, dict):
            where = ".".join(str(p) for p in path[:depth])
            raise InputError(flag, None, f"{where} has no keys inside")
        key = str(part)
        if is_last:
            data[key] = value
        elif data.get(key) is None:
            data[key] = {}
        data = data[key]
