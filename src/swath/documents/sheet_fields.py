"""How the fields of a class stand in a data sheet: unit, limits and key.

    @dataclass(frozen=True, kw_only=True)
    class Engine:
        rated_power: Annotated[float, Quantity("kw", 1, 2000)]     # key rated_power_kw, 1 to 2000; field in W
        torque_lag: Annotated[float, Quantity("s", 0.02, 5)] = 0.3  # may be left out

pydantic checks what is in the sheet, in its units; the object then holds SI. A field whose type is such a
class itself stands in the section of its `Section`.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from pydantic import BaseModel, Field, create_model

from swath.core.units import UNITS
from swath.core.units import Quantity as Quantity
from swath.documents.validation import STRICT

T = TypeVar("T")
REQUIRED: Any = dataclasses.MISSING


@dataclass(frozen=True)
class Key:
    """Where a field without a unit stands, as in the sheet, if not under its own name."""

    key: str

    def file_key(self, field: str) -> str:
        """The key in the sheet."""
        return self.key or field


@dataclass(frozen=True)
class Section:
    """Where the keys of a field that is such a class itself begin: `engine.`, `tyres.front_`.

    when: key that says whether the sheet has it at all; without it the field is None and its keys may be left
        out
    """

    prefix: str
    when: str = ""


@dataclass(frozen=True)
class Entry:
    """A key of a sheet: its type for pydantic, and whether it has to be there."""

    key: str
    kind: Any
    needed: bool = True


def entries(
    kind: Any, has: Callable[[str], bool] = bool, prefix: str = "", *, optional: bool = False
) -> Iterator[Entry]:
    """The keys of a class, `prefix` before each.

    has: whether a sheet has a key, for sections that it may be without; optional: no key has to be there
    """
    for name, annotation, default in _fields(kind):
        base, section, quantity = _declared(annotation)
        if section is not None:
            left_out = bool(section.when) and not has(section.when)
            yield from entries(base, has, prefix + section.prefix, optional=optional or left_out)
            continue
        key = prefix + quantity.file_key(name)
        needed = default is REQUIRED and not optional
        yield Entry(key, annotated(base, quantity), needed)


@cache
def annotated(base: Any, quantity: Quantity | Key) -> Any:
    """The type of a value with its limits, for pydantic; of every item where it is a list of numbers."""
    if isinstance(quantity, Key) or (quantity.low is None and quantity.high is None):
        return base
    limits = Field(ge=quantity.low, le=quantity.high)
    if base in (int, float):
        return Annotated[base, limits]
    return tuple[tuple(Annotated[float, limits] if a is float else a for a in get_args(base))]  # type: ignore[misc]


def build(kind: Any, prefix: str, value: Callable[[str], Any]) -> Any:
    """The object of a class from checked values of a sheet, in SI. value: by dotted key, None = missing."""
    made = {}
    for name, annotation, default in _fields(kind):
        base, section, quantity = _declared(annotation)
        if section is not None:
            if not section.when or value(section.when) is not None:
                made[name] = build(base, prefix + section.prefix, value)
            elif default is REQUIRED:
                made[name] = None
            continue
        found = value(prefix + quantity.file_key(name))
        if found is not None:
            made[name] = _in_si(found, base, quantity)
    return kind(**made)


def _in_si(value: Any, base: Any, quantity: Quantity | Key) -> Any:
    if isinstance(quantity, Key) or base is int:
        return value
    factor = UNITS[quantity.unit].factor
    if not isinstance(value, list):
        return float(value) * factor
    return tuple(float(v) * factor for v in value)


@cache
def model_of(entries: tuple[Entry, ...]) -> type[BaseModel]:
    """The pydantic model of a whole sheet."""
    tree: dict[str, Any] = {}
    for entry in entries:
        *above, name = entry.key.split(".")
        node = tree
        for part in above:
            node = node.setdefault(part, {})
        known = node.get(name)
        if known is None or not known.needed:  # two classes may read the same key
            node[name] = entry
    return _model("Sheet", tree)


def _model(name: str, tree: dict[str, Any]) -> type[BaseModel]:
    fields: dict[str, Any] = {}
    for key, node in tree.items():
        if isinstance(node, Entry):
            fields[key] = (node.kind, ...) if node.needed else (node.kind | None, None)
            continue
        section = _model(key, node)
        needed = any(field.is_required() for field in section.model_fields.values())
        fields[key] = (section, ...) if needed else (section | None, None)
    return create_model(name, __config__=STRICT, **fields)


@cache
def _fields(kind: Any) -> tuple[tuple[str, Any, Any], ...]:
    """Name, annotation and default of the fields of a dataclass that say how they stand in a sheet."""
    hints = get_type_hints(kind, include_extras=True)
    defaults = {
        f.name: f.default_factory if f.default is REQUIRED else f.default for f in dataclasses.fields(kind)
    }
    return tuple((f.name, hints[f.name], defaults[f.name]) for f in dataclasses.fields(kind) if f.init)


def _declared(annotation: Any) -> tuple[Any, Section | None, Quantity | Key]:
    """The bare type of an annotation and what it says."""
    if get_origin(annotation) is not Annotated:
        return annotation, None, Key("")
    base, *marks = get_args(annotation)
    section = next((m for m in marks if isinstance(m, Section)), None)
    if section is not None and isinstance(base, UnionType):
        base = next(member for member in get_args(base) if member is not type(None))
    quantity: Quantity | Key = next((m for m in marks if isinstance(m, Quantity | Key)), Key(""))
    for mark in marks:
        if not isinstance(mark, Section | Quantity | Key):  # pydantic's own
            base = Annotated[base, mark]
    return base, section, quantity
