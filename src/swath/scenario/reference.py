"""Keys of a scenario as rows of text, made from the same classes that check them."""

from typing import Any

from swath.documents.yaml_document import dump
from swath.scenario.schema import adopt

Row = tuple[str, str, str, str]


def parameter_rows(kind: Any) -> list[Row]:
    """(key, value, default, meaning) of every key of a class; nested keys with dots."""
    if kind is None:
        return []
    defs: dict[str, Any] = {}
    return rows_of(adopt(kind, "x", defs), defs, "")


def rows_of(node: dict[str, Any], defs: dict[str, Any], prefix: str) -> list[Row]:
    """Rows of the properties of a JSON Schema, those inside with dots. defs: what its references name."""
    rows: list[Row] = []
    for key, entry in node.get("properties", {}).items():
        target = _target(entry, defs)
        if target.get("properties"):
            rows += rows_of(target, defs, f"{prefix}{key}.")
            continue
        default = "" if key in node.get("required", []) else _yaml(entry.get("default"))
        inner = _inside(entry, defs)
        value = _value(entry, defs) if inner is None else inner[1]
        if (band := entry.get("estimate")) is not None:
            whose, by = ("an", f" by {entry['estimate_of']}") if "estimate_of" in entry else ("our", "")
            value += f"; {whose} estimate, {band[0]:g} to {band[1]:g}{by}"
        rows.append((prefix + key, value, default, entry.get("description", "")))
        if inner is not None:
            rows += rows_of(inner[0], defs, f"{prefix}{key}{'[]' if inner[1].startswith('list') else ''}.")
    return rows


def _inside(entry: dict[str, Any], defs: dict[str, Any]) -> tuple[dict[str, Any], str] | None:
    """Schema of the keys inside a list of mappings or a mapping that may be null, and what to call it."""
    members = [m for m in entry.get("anyOf", []) if m.get("type") != "null"]
    for node, words in ((entry.get("items"), "list of keys"), *((m, "keys or null") for m in members)):
        if isinstance(node, dict) and _target(node, defs).get("properties"):
            return _target(node, defs), words
    return None


def _target(entry: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in entry:
        found: dict[str, Any] = defs[entry["$ref"].rpartition("/")[2]]
        return found
    return entry


def _yaml(value: Any) -> str:
    return dump(value, flow=True, width=1000).removesuffix("\n").removesuffix("\n...").strip()


def _value(entry: dict[str, Any], defs: dict[str, Any]) -> str:
    """What may stand there, in words."""
    entry = _target(entry, defs)
    if "const" in entry:
        return f"`{entry['const']}`"
    if "enum" in entry:
        return ", ".join(f"`{v}`" for v in entry["enum"])
    if "anyOf" in entry or "oneOf" in entry:
        return " or ".join(_value(member, defs) for member in entry.get("anyOf", entry.get("oneOf", [])))
    kind = entry.get("type")
    if kind == "array":
        return _list(entry, defs)
    if kind == "object":
        inner = entry.get("additionalProperties")
        if isinstance(inner, dict):
            return f"keys with {_value(inner, defs)}"
        return "{" + ", ".join(entry.get("properties", {})) + "}"
    words = {
        "number": "number",
        "integer": "whole number",
        "string": "text",
        "boolean": "true, false",
        "null": "null",
    }
    low = _bound(entry, "> ", "exclusiveMinimum", ">= ", "minimum")
    high = _bound(entry, "< ", "exclusiveMaximum", "<= ", "maximum")
    if low and high:  # `0 to 5`, `> 0 to 5`
        whole = "whole, " if kind == "integer" else ""
        return f"{whole}{low.removeprefix('>= ')} to {high.removeprefix('<= ')}"
    return f"{words.get(str(kind), str(kind))} {low}{high}".strip()


def _bound(entry: dict[str, Any], *names: str) -> str:
    """A limit of a number with its sign, empty without one. names: sign and key, twice."""
    for sign, name in zip(names[::2], names[1::2], strict=True):
        if name in entry:
            return f"{sign}{entry[name]:g}"
    return ""


def _list(entry: dict[str, Any], defs: dict[str, Any]) -> str:
    if "prefixItems" in entry:
        return "[" + ", ".join(_value(item, defs) for item in entry["prefixItems"]) + "]"
    return f"list of {_value(entry.get('items', {}), defs)}"
