"""Validation of plain data against dataclasses and models, with errors that name key, value and place.

pydantic does the checking, in strict JSON mode: whole numbers may stand for numbers, nothing else is
converted; unknown keys and numbers that are not finite are refused, in nested dataclasses too.

The errors name near misses: which key was meant, in which unit, and what a value should have looked like.
"""

import dataclasses
import difflib
import json
import re
import unicodedata
from collections.abc import Iterable
from functools import cache
from typing import Any

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from swath.core.errors import InputError, near_miss, raise_all
from swath.core.typed_numbers import list_form, number_form
from swath.core.units import split_unit
from swath.documents.yaml_document import Document, KeyPath, key_path

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
WIRE_PATTERN = r"^([A-Za-z_][A-Za-z0-9_-]*\.){1,2}[A-Za-z_][A-Za-z0-9_]*$"
PATTERNS = {
    NAME_PATTERN: "at most 64 letters, digits, dots, - and _",
    WIRE_PATTERN: "slot.output or machine.slot.output",
}


def as_name(text: str, otherwise: str, most: int = 64) -> str:
    """A text as a name may be (NAME_PATTERN), at most so long; one that is a name already stays."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", plain).lstrip("-_.")[:most] or otherwise


def unknown_key(key: str, known: Iterable[str], what: str = "unknown key", command: str = "") -> str:
    """The text after an unknown key: the nearest known one, and its unit when only the unit differs.

    command: which lists the known ones where they are many
    """
    names = list(known)
    quantity = split_unit(key)[0]
    same = [n for n in names if split_unit(n)[0] == quantity and split_unit(n)[1]]
    if same:
        return f"{what}, did you mean {same[0]!r}? expected in {split_unit(same[0])[1]}"
    near = difflib.get_close_matches(key, names, n=1) or difflib.get_close_matches(
        quantity, [split_unit(n)[0] for n in names], n=1, cutoff=0.75
    )
    if near:
        meant = near[0] if near[0] in names else next(n for n in names if split_unit(n)[0] == near[0])
        return f"{what}, did you mean {meant!r}?"
    if 0 < len(names) <= 16:
        return f"{what}, expected one of {', '.join(names)}"
    return f"{what}, {command} lists them" if command else what


STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)
MOST_ERRORS = 100  # that are reported of one section
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_TYPES = {
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping of keys",
    "model_type": "a mapping of keys",
    "model_attributes_type": "a mapping of keys",
    "dataclass_type": "a mapping of keys",
    "dataclass_exact_type": "a mapping of keys",
    "int_from_float": "a whole number",
    "path_type": "a path",
    "missing": "a value, the key is missing",
    "missing_argument": "a value, the key is missing",
    "missing_keyword_only_argument": "a value, the key is missing",
}
_LIMITS = {
    "greater_than": "> {gt}",
    "greater_than_equal": ">= {ge}",
    "less_than": "< {lt}",
    "less_than_equal": "<= {le}",
    "multiple_of": "a multiple of {multiple_of}",
    "too_short": "at least {min_length} items",
    "too_long": "at most {max_length} items",
    "string_too_short": "at least {min_length} characters",
    "string_too_long": "at most {max_length} characters",
}


@cache
def adapter_of(kind: Any) -> TypeAdapter[Any]:
    """Strict adapter of a dataclass or model. The tuple hands the configuration on to nested dataclasses."""
    return TypeAdapter(tuple[kind], config=STRICT)


@cache
def schema_of(kind: Any) -> dict[str, Any]:
    """JSON Schema of a dataclass or model."""
    whole = adapter_of(kind).json_schema(mode="validation")
    top, defs = whole["prefixItems"][0], whole.get("$defs", {})
    keys = defs.get(top.get("$ref", "").rpartition("/")[2], top).get("properties", {})
    for field in dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ():
        if not field.init:
            keys.pop(field.name, None)
    return {**top, "$defs": defs}


def known_keys(kind: Any) -> list[str]:
    """Keys that a dataclass or model takes."""
    if kind is None:
        return []
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return list(kind.model_fields)
    return [f.name for f in dataclasses.fields(kind) if f.init]


def validate(kind: Any, data: Any, path: KeyPath, document: Document) -> tuple[Any, list[InputError]]:
    """The object made of `data`, or None and the errors found."""
    try:
        return adapter_of(kind).validate_json(json.dumps([data]))[0], []
    except ValidationError as error:
        raw = sorted(error.errors(include_url=False), key=lambda e: e["type"] not in _UNKNOWN)
        found = [_translate(e, kind, data, path, document) for e in raw[:MOST_ERRORS]]
        return None, _one_each(found)
    except InputError as error:  # raised by a __post_init__
        return None, [_under(error, path, document)]


def _one_each(errors: list[InputError]) -> list[InputError]:
    """Where a choice of types fits nothing: what is wrong furthest inside, or all that a value may be."""
    kept: dict[str, InputError] = {}
    for e in errors:
        if any(other.key.startswith(f"{e.key}.") for other in errors):
            continue
        same = kept.setdefault(e.key, e)
        if same.expected != e.expected:
            text = f"{same.expected} or {e.expected.removeprefix('expected ')}"
            kept[e.key] = InputError(e.key, e.value, text, file=e.file, line=e.line)
    return list(kept.values())


def checked(kind: Any, document: Document, data: Any = None, path: KeyPath = ()) -> Any:
    """The object made of `data`, that of the document by default. InputError with its `others`."""
    made, errors = validate(kind, document.data if data is None else data, path, document)
    raise_all(errors)
    return made


def _translate(error: Any, kind: Any, data: Any, path: KeyPath, document: Document) -> InputError:
    code, context = error["type"], error.get("ctx", {})
    loc, value, last_is_there = _locate(error["loc"][1:], data, code)
    key = str(loc[-1]) if loc else ""
    where = (*path, *loc)
    if code in _UNKNOWN:
        siblings = _siblings(schema_of(kind), loc[:-1])
        return document.error(where, None, unknown_key(key, siblings))
    if code in ("float_type", "float_parsing", "int_type", "int_parsing", "decimal_type"):
        what = "a number" if code.startswith("float") else "a whole number"
        named = next((str(p) for p in reversed(where) if isinstance(p, str)), "")
        return document.error(where, _shown(value, last_is_there), number_form(named, value, what))
    if code in ("literal_error", "enum"):
        choices = [c.strip("'") for c in context["expected"].replace(" or ", ", ").split(", ")]
        text = f"expected one of {', '.join(choices)}{near_miss(value, choices)}"
        return document.error(where, _shown(value, last_is_there), text)
    if code in ("union_tag_not_found", "union_tag_invalid"):
        tag = str(context["discriminator"]).strip("'")
        choices = _tags(schema_of(kind), loc)
        given = value.get(tag) if isinstance(value, dict) else None
        text = f"expected one of {', '.join(choices)}{near_miss(given, choices)}"
        return document.error((*where, tag), given, text)
    if code in _TYPES:
        text = "expected " + _TYPES[code] + (list_form(value) if _TYPES[code] == "a list" else "")
        return document.error(where, _shown(value, last_is_there), text)
    if code in _LIMITS:
        numbers = {k: f"{v:g}" if isinstance(v, float) else v for k, v in context.items()}
        limit = _LIMITS[code].format(**numbers)
        return document.error(where, _shown(value, last_is_there), f"expected {limit}")
    if code == "string_pattern_mismatch":
        pattern = context["pattern"]
        return document.error(where, value, f"expected {PATTERNS.get(pattern, 'text like ' + pattern)}")
    if code == "finite_number":
        return document.error(where, value, "expected a finite number")
    message = str(error["msg"]).removeprefix("Value error, ").removeprefix("Assertion failed, ")
    return document.error(where, _shown(value, last_is_there), message)


def _shown(value: Any, is_there: bool) -> Any:
    """What to print as the value: an empty one must be seen as such."""
    return "(nothing)" if value is None and is_there else value


def _locate(loc: tuple[Any, ...], data: Any, code: str) -> tuple[KeyPath, Any, bool]:
    """Location of pydantic without names of union members, the value there, and whether it is there."""
    path: list[str | int] = []
    for index, part in enumerate(loc):
        inside = isinstance(data, dict) and part in data
        inside = inside or (isinstance(data, list) and isinstance(part, int) and part < len(data))
        if inside:
            path.append(part)
            data = data[part]
        elif index == len(loc) - 1 and code.startswith("missing"):
            return (*path, part), None, False
    return tuple(path), data, True


def _siblings(schema: dict[str, Any], loc: KeyPath) -> list[str]:
    """Keys known at a location of a schema; of every member where there is a choice."""
    return list(dict.fromkeys(k for node in _nodes(schema, loc) for k in node.get("properties", {})))


def _tags(schema: dict[str, Any], loc: KeyPath) -> list[str]:
    """Names of the choices at a location of a schema."""
    return [tag for node in _nodes(schema, loc) for tag in node.get("discriminator", {}).get("mapping", {})]


def _nodes(schema: dict[str, Any], loc: KeyPath) -> list[dict[str, Any]]:
    nodes = _unfold(schema, schema["$defs"])
    for part in loc:
        children = [child for node in nodes for child in _child(node, part)]
        nodes = [leaf for child in children for leaf in _unfold(child, schema["$defs"])]
    return nodes


def _unfold(node: dict[str, Any], defs: dict[str, Any]) -> list[dict[str, Any]]:
    if "$ref" in node:
        return _unfold(defs[node["$ref"].rpartition("/")[2]], defs)
    members = node.get("anyOf") or node.get("oneOf") or []
    return [node, *(leaf for member in members for leaf in _unfold(member, defs))]


def _child(node: dict[str, Any], part: str | int) -> list[dict[str, Any]]:
    if isinstance(part, int):
        prefix = node.get("prefixItems", [])
        found = prefix[part] if part < len(prefix) else node.get("items")
    else:
        found = node.get("properties", {}).get(part, node.get("additionalProperties"))
    return [found] if isinstance(found, dict) else []


def _under(error: InputError, path: KeyPath, document: Document) -> InputError:
    """An error of a parameter class with its full key: the class may be nested anywhere under `path`."""
    if error.file is not None:
        return error
    where = (*path, *key_path(error.key))
    if where not in document.places:
        tail = where[len(path) :]
        inside = [p for p in document.paths(path) if p[-len(tail) :] == tail]
        same = [p for p in inside if document.value(p) == error.value] or inside
        where = same[0] if same else where
    written = document.value(where)
    return document.error(where, written if written == error.value else error.value, error.expected)
