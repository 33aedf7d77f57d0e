"""Data sheets: YAML files of numbers with their source.

    format: swath sensor 2
    divergence_mrad: {value: 4.7, tag: S, source: "maker's manual 8013796"}

The key carries the unit. A remark on what exactly is meant goes to `note`. The tags are `TAGS`. A plain
number is as good: `divergence_mrad: 4.7` rests on nothing that is said. The bundled sheets have none.
"""

import copy
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from swath.core.errors import MIGRATED_BY, InputError, near_miss, raise_all
from swath.documents.sheet_fields import Entry, build, entries, model_of
from swath.documents.validation import validate
from swath.documents.yaml_document import Document, KeyPath, key_path, read_mapping

FORM = '{value: 4.7, tag: S, source: "the maker\'s manual"}'
TAGS = {
    "S": "seen in the source",
    "D": "derived from other numbers",
    "E": "estimate, for the reason given",
    "U": "uncited estimate: usual in the trade, nothing seen that says so",
}
"""What a number rests on. `S/D` and the like: between two of them."""
# Folder -> word of the format line.
KINDS = {"sensors": "sensor", "machines": "machine", "crops": "crop", "obstacles": "obstacle"}
# Folder -> what is in it, and the command that takes its names.
USED_BY = {
    "scenarios": ("a scenario", "swath run"),
    "jobs": ("a job, the work on a whole field", "swath fleet run"),
    **{kind: (f"a data sheet of {kind}", "swath sheets") for kind in KINDS},
}
VERSION = 2
T = TypeVar("T")


def viewer_layout() -> Path:
    """The layout for Foxglove that shows a run.mcap of a machine called `combine`."""
    return Path(str(files("swath.data") / "foxglove" / "swath.json"))


def sheet_names(kind: str) -> list[str]:
    """Names of the bundled files of a kind: `sensors`, `machines`, `crops`, `scenarios`."""
    return sorted(p.stem for p in sheet_folder(kind).glob("*.yaml"))


@cache
def sheet_folder(kind: str) -> Path:
    """Where the bundled files of a kind lie."""
    return Path(str(files("swath.data") / kind))


def find_sheet(kind: str, name: str, base: Path | None = None) -> Path:
    """Path of a bundled file by name, or of the user's own file (relative to `base`)."""
    if name.endswith((".yaml", ".yml")):
        path = Path(name) if Path(name).is_absolute() else (base or Path.cwd()) / name
    else:
        path = sheet_folder(kind) / f"{name}.yaml"
    if os.path.exists(path):
        return path
    raise InputError(kind, name, expected_name(kind, name))


def expected_name(kind: str, name: str) -> str:
    """What to say of a name that no bundled file of a kind has: what it is where another kind has it."""
    for other, (what, command) in USED_BY.items():
        if name in sheet_names(other):
            return f"this is {what}: {command} {name}; expected {USED_BY[kind][0]}"
    return f"expected a file or one of {', '.join(sheet_names(kind))}{near_miss(name, sheet_names(kind))}"


@dataclass(frozen=True)
class Sheet:
    """A data sheet as written (`document`), and its plain values without tags and sources (`values`).

    mistakes: against the form of its entries; `check` lists them with the others
    """

    path: Path
    document: Document
    values: dict[str, Any]
    mistakes: tuple[InputError, ...] = ()

    def __contains__(self, key: str) -> bool:
        return self.value(key) is not None

    def value(self, key: str) -> Any:
        """Plain value or section at a dotted key, in the unit of the sheet; None where there is none."""
        node: Any = self.values
        for part in key_path(key):
            node = node.get(part) if isinstance(node, Mapping) else None
        return node

    def number(self, key: str) -> float:
        """The number at a dotted key, in the unit of the sheet. InputError when there is none."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            expected = f"expected a number of the data sheet{near_miss(key, self.numbers())}"
            raise InputError(key, None, expected, file=self.path)
        return float(value)

    def error(self, key: str, expected: str) -> InputError:
        """The error about a dotted key, with its value, file and line."""
        value = self.value(key)
        return self.document.error(key_path(key), None if isinstance(value, dict) else value, expected)

    def read(self, kind: type[T]) -> T:
        """The object, in SI, of the class whose fields say how they stand in the sheet (`sheet_fields.py`).

        Raises InputError unless the sheet has the keys of this class, within their limits, and no others.
        """
        self.check(*entries(kind, self.__contains__))
        return self.build(kind)

    def check(self, *entries: Entry) -> None:
        """Raise InputError unless the sheet has these keys, within their limits, and no others.

        It is the first mistake; its `others` are the rest, those against the form of an entry included. Of a
        sheet of another kind that is the only one.
        """
        _, errors = validate(model_of(entries), self.values, (), self.document)
        mistaken = {mistake.key for mistake in self.mistakes}
        errors = [*self.mistakes, *(e for e in errors if e.key not in mistaken)]
        errors = [e for e in errors if e.key == "kind"] or errors
        raise_all(errors)

    def build(self, kind: type[T], prefix: str = "") -> T:
        """The object of a class whose keys were checked; `prefix` stands before each."""
        try:
            made: T = build(kind, prefix, self.value)
        except InputError as error:  # raised by a __post_init__
            raise self.error(error.key, error.expected) from error
        return made

    def changed(self, values: Mapping[str, float], *, new: Collection[str] = ()) -> "Sheet":
        """A copy with other numbers, by dotted key. Raises InputError for a key that it has not.

        new: keys that are added where they are missing; their section has to be there
        """
        data = copy.deepcopy(self.document.data)
        for key, value in values.items():
            if key not in new:
                self.number(key)
            section, _, name = key.rpartition(".")
            node = data
            for part in key_path(section) if section else ():
                node = node[part]
            if isinstance(node.get(name), dict):
                node[name]["value"] = float(value)
            else:
                node[name] = float(value)
        document = replace(self.document, data=data)
        return Sheet(self.path, document, *plain_values(document))

    def numbers(self) -> dict[str, dict[str, Any]]:
        """Dotted key -> entry {value, tag, source} of every number, in file order; a plain one is {value}."""
        return {".".join(map(str, path)): entry for path, entry in _entries(self.document.data, ())}


def read_sheet(kind: str, name: str, base: Path | None = None) -> Sheet:
    """A bundled data sheet by name or the user's own file (relative to `base`). kind: as in `KINDS`.

    Raises InputError for what is no data sheet of that kind.
    """
    path = find_sheet(kind, name, base)
    document = read_mapping(path, "data sheet")
    wanted, given = f"swath {KINDS[kind]} {VERSION}", document.data.get("format")
    if given is None:
        raise document.error(("format",), None, f"expected `{wanted}`; {MIGRATED_BY}")
    if given != wanted:
        raise document.error(("format",), given, f"expected {wanted}")
    return Sheet(path, document, *plain_values(document))


def plain_values(document: Document) -> tuple[dict[str, Any], tuple[InputError, ...]]:
    """The values of a data sheet without tags and sources, and what is wrong with its entries."""
    mistakes: list[InputError] = []
    values = {key: _plain(value, (key,), document, mistakes) for key, value in document.data.items()}
    return values, tuple(mistakes)


def _plain(node: Any, path: KeyPath, document: Document, mistakes: list[InputError]) -> Any:
    if not isinstance(node, dict):
        return node
    if not {"value", "tag", "source"} & set(node):
        return {key: _plain(value, (*path, key), document, mistakes) for key, value in node.items()}
    if "value" not in node:
        mistakes.append(document.error(path, None, f"expected a number, or {FORM}"))
    for key in set(node) - {"value", "tag", "source", "note"}:
        hint = ": the key carries the unit, a remark goes to `note`" if key == "unit" else ""
        mistakes.append(document.error((*path, key), node[key], f"unknown key, expected {FORM}{hint}"))
    tag = node.get("tag", "U")
    if not isinstance(tag, str) or not set(tag.split("/")) <= set(TAGS):
        tags = ", ".join(f"{tag} {meaning}" for tag, meaning in TAGS.items())
        mistakes.append(document.error((*path, "tag"), tag, f"expected one of {tags}"))
    return node.get("value")


def _entries(node: Any, path: KeyPath) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    if isinstance(node, dict) and "value" in node:
        yield path, node
    elif isinstance(node, dict):
        for key, value in node.items():
            yield from _entries(value, (*path, key))
    elif isinstance(node, int | float | list) and not isinstance(node, bool):
        yield path, {"value": node}
