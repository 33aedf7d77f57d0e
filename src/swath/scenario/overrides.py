"""`--set combine.lidar.level=empirical`: changes to a scenario before it is checked."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

from swath.core.errors import InputError, SwathError, shortened
from swath.documents.validation import known_keys, unknown_key
from swath.documents.yaml_document import Document, KeyPath, Place, key_path, parse_value
from swath.scenario.resolved import LevelChoice
from swath.scenario.sections import SlotCommon
from swath.scenario.slots import Catalogue
from swath.scenario.versions import SECTIONS, short_key


class Change(NamedTuple):
    """A key and what it becomes. flag: what errors call it."""

    flag: str
    path: KeyPath
    value: Any


def apply_overrides(
    document: Document, sets: Sequence[str], catalogue: Catalogue, flags: Mapping[str, str]
) -> None:
    """Change the document in place. Errors about these values will name the flag.

    flags: further changes, by the flag that stands for them: {"--seed 3": "seed=3"}.
    Their order does not matter: what holds for more comes first, a section before its level, a level before
    its parameters. Two that say different things about a key are an error.
    Choosing another level drops the parameters that only the former level knew; where the former level cannot
    be loaded, it drops every parameter that the new one does not know. Of a section that has every parameter,
    as that of a recorded run, it drops those, too, that stand at the former level's defaults.
    InputError for a key inside a machine that is not there.
    """
    changes = [change_of(flag, text) for flag, text in [*((f"--set {s}", s) for s in sets), *flags.items()]]
    for number, change in enumerate(changes):
        for other in changes[:number]:
            if contradicts(other, change):
                expected = f"expected one of the two, it contradicts {shortened(other.flag, 120)}"
                raise InputError(shortened(change.flag, 120), None, expected)
    changes.sort(key=lambda change: (len(change.path), change.path[-1] != "level"))
    for flag, path, value in changes:
        if not isinstance(document.data, dict):
            raise document.error((), document.data, "expected a mapping of keys")
        _check_machine(document.data, path, value, flag)
        _expand(document.data, path, catalogue)
        if path[-1] == "level" and len(path) == 3:
            _drop_foreign(document, path, value, catalogue)
        put(document.data, path, value, flag)
        for place in [p for p in document.places if p[: len(path)] == path]:
            del document.places[place]
        for end in range(1, len(path) + 1):
            document.places.setdefault(path[:end], Place(flag))


def _check_machine(data: dict[str, Any], path: KeyPath, value: Any, flag: str) -> None:
    """InputError for a key inside a machine that is not there. One that is added says which it is."""
    name = str(path[0])
    keys = path[1:2] or (value if isinstance(value, dict) else ("machine",))
    if name in data or name in SECTIONS or "machine" in keys:
        return
    there = [key for key in data if key not in SECTIONS]
    raise InputError(name, None, unknown_key(name, [*there, *SECTIONS]), file=flag)


def layered(*layers: Sequence[str]) -> list[str]:
    """The changes of several layers as one list; where two contradict each other, the later layer counts."""
    found: list[tuple[str, Change]] = []
    for layer in layers:
        new = [(text, change_of(f"--set {text}", text)) for text in layer]
        for _, change in new:
            found = [kept for text, own in found if (kept := _without(text, own, change))]
        found += new
    return [text for text, _ in found]


def _without(text: str, own: Change, later: Change) -> tuple[str, Change] | None:
    """A change as far as a later one does not contradict it; None where nothing of it is left."""
    if not contradicts(own, later):
        return text, own
    if len(own.path) >= len(later.path) or not isinstance(own.value, dict | list):
        return None
    value = deepcopy(own.value)
    put(value, later.path[len(own.path) :], later.value, later.flag)
    text = f"{text.partition('=')[0]}={json.dumps(value)}"
    return text, Change(f"--set {text}", own.path, value)


def contradicts(one: Change, other: Change) -> bool:
    """Whether two changes say different things about the same key."""
    section, inner = sorted((one, other), key=lambda change: len(change.path))
    if inner.path[: len(section.path)] != section.path:
        return False
    stated = _stated(section.value, inner.path[len(section.path) :])
    return bool(stated) and stated[0] != inner.value


def says_about(text: str, key: str) -> bool:
    """Whether a change such as `combine.lidar.rate_hz=50` says what a key is, whatever the value."""
    nothing = Change(key, key_path(short_key(key)), object())
    return contradicts(change_of(f"--set {text}", text), nothing)


def _stated(value: Any, path: KeyPath) -> tuple[Any, ...]:
    """The value that a section gives to a key inside it, in a tuple; () where it does not set that key."""
    for depth, part in enumerate(path):
        if isinstance(value, dict):
            if part not in value:
                return ()
            value = value[part]
        elif isinstance(value, list):
            if not isinstance(part, int) or part >= len(value):
                return ()
            value = value[part]
        elif isinstance(value, str) and value != "off":  # a level's name stands for {level: name}
            return (value,) if path[depth:] == ("level",) else ()
        else:
            return (value,)
    return (value,)


def change_of(flag: str, text: str) -> Change:
    """What a text such as `combine.lidar.rate_hz=50` changes. InputError, which names the flag."""
    key, equals, value_text = text.partition("=")
    path = key_path(short_key(key.strip()))
    if not equals or "" in path:
        raise InputError(flag, None, "expected --set key.key=value")
    return Change(flag, path, parse_value(value_text, flag))


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
    after = _params_of(catalogue, kind, level, Path.cwd())
    if after is None:
        return  # reported when the scenario is read
    base = document.file.resolve().parent if document.file else None
    before = _params_of(catalogue, kind, entry.get("level", catalogue.default_level(kind)), base)
    of_slot = () if path[0] == "field" else tuple(SlotCommon.model_fields)
    defaults = before if before is not None and before.keys() <= entry.keys() else {}
    for key in [key for key in entry if key not in ("level", *of_slot)]:
        is_foreign = key not in after and (before is None or key in before)
        if is_foreign or json.dumps(entry[key]) == defaults.get(key):
            del entry[key]


def _params_of(catalogue: Catalogue, kind: str, level: Any, base: Path | None) -> dict[str, str] | None:
    """Parameters of a level and their defaults as JSON, "" = none; None where it cannot be had, such as code
    that may not run.
    """
    try:
        found = catalogue.registry.get(kind, str(level), base=base)
    except (SwathError, OSError, ValueError):
        return None
    if found.is_unread:
        return None
    keys = dict.fromkeys(known_keys(found.params), "")
    with suppress(TypeError):  # one has no default
        plain = LevelChoice("", found, found.params()).plain()
        keys = {key: json.dumps(plain[key]) for key in keys}
    return keys


def _kind(path: KeyPath, catalogue: Catalogue) -> str:
    """The slot kind that a path such as machine.slot.key leads into, or `terrain`, `stand`; else empty."""
    name = str(path[1])
    if path[0] == "field":
        return name if name in catalogue.field_levels else ""
    kind = catalogue.kind_of(name)
    return kind.name if kind is not None else ""


def put(data: Any, path: KeyPath, value: Any, flag: str) -> None:
    """Set a key inside mappings and lists. InputError, which names the flag, where there can be none."""
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
