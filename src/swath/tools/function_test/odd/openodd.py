"""ASAM OpenODD 1.0 as a file: read and judged by `openodd-py`, which nothing else of swath imports.

The library knows the language: taxonomy, modules, units, and that a value that is missing or open does not by
itself lead out of a domain. It is young and changes fast, so it is pinned, and this module uses three of its
functions: read, judge values, and write what was met.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from swath.core.errors import Extra, InputError
from swath.core.files.temporary import TemporaryFolder
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.documents.yaml_document import Document, read_document

Value = float | str | bool
TAXONOMY, MODULES = "TAXONOMY", "ODD"  # keys of an OpenODD document
_BOOLEAN = {"true": True, "false": False}
_UNKNOWN_UNIT = re.compile(r": (\S+): unknown unit '([^']+)'")


@dataclass(frozen=True)
class Attribute:
    """A concept of the taxonomy.

    name: with its groups, `terrain.side_slope`
    values: of a category, () for a number
    """

    name: str
    values: tuple[str, ...] = ()

    @property
    def layer(self) -> str:
        """The group at the top of the taxonomy that it belongs to."""
        return self.name.partition(".")[0]


@dataclass(frozen=True)
class Domain:
    """An ODD as it was read. documents: its files, the first one with the root module."""

    documents: Sequence[Document]
    odd: Any

    @cached_property
    def attributes(self) -> dict[str, Attribute]:
        """Concepts by name, in the order of the files."""
        return attributes_of(self.documents)

    @property
    def version(self) -> str:
        """As the root module says, "" where it does not."""
        return str(self.odd.version or "")

    @property
    def revision(self) -> str:
        """SHA-256 of what was read."""
        return str(self.odd.revision or "")

    @property
    def roots(self) -> list[str]:
        """Modules that no other one refers to: all of them have to hold."""
        return list(self.odd.roots)

    def rules(self) -> list[tuple[str, str, str]]:
        """Of each module its name, `include_and` or the like, and a condition as text."""
        keys = ("include_and", "include_or", "exclude_and", "exclude_or")
        return [
            (module["name"], key.replace("_", " "), str(condition))
            for module in self.odd.describe()["modules"]
            for key in keys
            for condition in module.get(key, ())
        ]

    def holds(self, values: Mapping[str, Value]) -> bool:
        """Whether values are inside; an attribute that is left out may have any value."""
        judged = {
            name: _BOOLEAN.get(str(v), v) if self._is_boolean(name) else v for name, v in values.items()
        }
        return bool(self.odd.evaluate({**self._open, **judged}).inside)

    def _is_boolean(self, name: str) -> bool:
        attribute = self.attributes.get(name)
        return attribute is not None and attribute.values == tuple(_BOOLEAN)

    def why_outside(self, values: Mapping[str, Value]) -> str:
        """The attribute that leads out, with its value, or all of them together; "" inside."""
        if self.holds(values):
            return ""
        for name, value in values.items():
            if not self.holds({name: value}):
                return f"{name} {num(value)}" if isinstance(value, float) else f"{name} {value}"
        pairs = [(a, b) for a in values for b in values if a < b]
        for a, b in pairs:
            if not self.holds({a: values[a], b: values[b]}):
                return f"{a} {_text(values[a])} with {b} {_text(values[b])}"
        return "a combination of more than two attributes"

    @cached_property
    def _open(self) -> dict[str, Any]:
        return {attribute.name: _library().UNDECIDED for attribute in self.odd.attributes}


def read_domain(files: Sequence[Path], units: Mapping[str, str]) -> Domain:
    """The ODD of OpenODD documents, together. units: in which values will be judged, by attribute.

    InputError for what is not OpenODD; MissingExtra without `openodd-py`.
    """
    library = _library()
    documents = [read_document(file) for file in files]
    known = attributes_of(documents)
    bindings = {name: {"unit": unit} for name, unit in units.items() if unit and name in known}
    while True:
        try:
            return Domain(documents, library.load_openodd(*files, bindings=bindings, name=files[0].stem))
        except (library.OpenOddError, library.UnitError, ValueError) as error:
            found = _UNKNOWN_UNIT.search(str(error))
            if found is None or found[1] in bindings:
                raise _placed(str(error), documents) from error
            bindings[found[1]] = {"unit": found[2]}  # without a conversion a unit is its own: 1/m2


def export_tables(
    attributes: Sequence[Mapping[str, Any]], rows: Sequence[Sequence[Any]], folder: Path, stem: str
) -> bool:
    """Write rows as a current operational domain (COD): table, manifest and taxonomy, in CSV and YAML.

    attributes: with `name`, `unit` and `values`; rows: elapsed [s], latitude, longitude [deg], a value for
    each attribute, None = unknown. False where there is no row.
    """
    document = {"odd": {"samples": {"attributes": list(attributes), "rows": [list(row) for row in rows]}}}
    with TemporaryFolder("odd") as made:
        if _library().export_cod(document, made, stem) is None:
            return False
        for file in sorted(made.iterdir()):
            write_whole(folder / file.name, file.read_text(encoding="utf-8"))
    return True


def attributes_of(documents: Sequence[Document]) -> dict[str, Attribute]:
    """The concepts of the taxonomies of OpenODD documents."""
    found: dict[str, Attribute] = {}
    for document in documents:
        data = document.data if isinstance(document.data, dict) else {}
        _collect(data.get(TAXONOMY) or {}, (), found)
    return found


def _placed(told: str, documents: Sequence[Document]) -> InputError:
    """The library's error, with the file and the line of the module and concept that it names."""
    found = re.match(r"module (\S+?)(?: (\w+): (\S+?):?)?(?: |$)", told)
    for document in documents:
        document.kind = "OpenODD"
        if found and isinstance(document.data, dict) and found[1] in (document.data.get(MODULES) or {}):
            path = tuple(part for part in (MODULES, found[1], found[2], found[3]) if part)
            return document.error(path, None, told)
    return documents[0].error((), None, told)


def _collect(node: Any, above: tuple[str, ...], found: dict[str, Attribute]) -> None:
    for name, inner in node.items() if isinstance(node, dict) else ():
        path = (*above, str(name))
        if isinstance(inner, dict):
            _collect(inner, path, found)
            continue
        if isinstance(inner, list):
            values = tuple(str(value) for value in inner)
        elif str(inner) == "boolean":
            values = tuple(_BOOLEAN)
        else:
            values = ()
        found[".".join(path)] = Attribute(".".join(path), values)


def _text(value: Value) -> str:
    return num(value) if isinstance(value, float) else str(value)


def _library() -> Any:
    with Extra("odd", "reading an ODD"):
        import openodd
    return openodd
