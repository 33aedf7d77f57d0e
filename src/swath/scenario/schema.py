"""JSON Schema of scenario files, made from the levels that are built in.

Every slot is a choice of a level's name, or of a mapping whose `level` says which keys it takes. Levels that
are not built in (entry points, `file.py:Class`) are allowed with any keys: `swath run` checks those.
"""

import dataclasses
import inspect
import re
import typing
from typing import Any

from swath.core.registry import installed
from swath.core.units import split_unit
from swath.documents.validation import schema_of
from swath.scenario.sections import (
    FieldCommon,
    Head,
    Limit,
    MachineCommon,
    RealTime,
    Run,
    SlotCommon,
    StartAlongEdge,
    StartPose,
)
from swath.scenario.slots import CATALOGUE, Catalogue
from swath.scenario.versions import FORMAT

Node = dict[str, Any]
FOREIGN = {"type": "string", "pattern": r"\.py:[A-Za-z_]\w*$"}


def scenario_schema(catalogue: Catalogue = CATALOGUE) -> Node:
    """The whole schema, draft 2020-12."""
    defs: dict[str, Node] = {}
    packages = [{"const": name} for name in installed("evaluator")]
    own: Node = {"anyOf": [FOREIGN, *packages]} if packages else FOREIGN
    machine = _machine(catalogue, defs)
    head = adopt(Head, "head", defs)["properties"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "swath scenario",
        "description": "What runs where, at which level of detail, and which limits it must keep.",
        "type": "object",
        "required": ["format", "field", "machines"],
        "properties": {
            "format": {"const": FORMAT, "description": "of this file"},
            **head,
            "run": adopt(Run, "run", defs),
            "realtime": _realtime(defs),
            "field": _field(catalogue, defs),
            "machines": {"type": "object", "minProperties": 1, "additionalProperties": machine},
            "evaluators": {"type": "array", "items": own, "description": "your own evaluators"},
            "expect": {"type": "object", "description": "limits; one that fails makes the exit code 1"},
        },
        # evaluators of the user's own bring metrics that are not known here
        "if": {"not": {"required": ["evaluators"]}},
        "then": {"properties": {"expect": _expect(catalogue, defs)}},
        "additionalProperties": False,
        "$defs": defs,
    }


def adopt(kind: Any, prefix: str, defs: dict[str, Node]) -> Node:
    """Schema of a class with units and meanings in the descriptions; its definitions go into `defs`."""
    whole = schema_of(kind)
    classes = _classes(kind)
    renamed = {name: f"{prefix}.{name}" for name in whole["$defs"]}
    for name, node in whole["$defs"].items():
        defs[renamed[name]] = _described(_renamed(node, renamed), classes.get(name))
    node = {k: v for k, v in whole.items() if k != "$defs"}
    if "$ref" in node:
        return defs[renamed[node["$ref"].rpartition("/")[2]]]
    return _described(_renamed(node, renamed), kind)


def described(kind: Any, key: str) -> str:
    """What the docs say of a key of a class."""
    return str(adopt(kind, "", {}).get("properties", {}).get(key, {}).get("description", "")).strip()


def meanings(text: str, keys: list[str]) -> dict[str, str]:
    """What a docstring says about each key: `key, key [unit]: meaning; key: meaning`.

    Where several keys are followed by as many meanings with commas between, each gets its own.
    """
    if not keys:
        return {}
    any_key = "|".join(sorted(map(re.escape, keys), key=len, reverse=True))
    pattern = rf"(?:^|[;.]\s+|\n\s*)((?:{any_key})(?:,\s+(?:{any_key}))*)(?:\s*\[[^\]]*\])?\s*[:,]\s+"
    found = list(re.finditer(pattern, text))
    result: dict[str, str] = {}
    for match, after in zip(found, [*found[1:], None][: len(found)], strict=True):
        said = text[match.end() : after.start() if after else len(text)].split("\n\n")[0]
        said = " ".join(said.split()).rstrip(";. ")
        names, parts = re.split(r",\s+", match.group(1)), said.split(", ")
        same = parts if len(parts) == len(names) else [said] * len(names)
        result |= dict(zip(names, same, strict=True))
    return result


def _described(node: Node, kind: Any) -> Node:
    """The node with a description for every key, from the docstrings of its class and those it inherits."""
    properties = node.get("properties", {})
    node.pop("description", None)
    node.pop("title", None)
    said: dict[str, str] = {}
    for base in reversed(getattr(kind, "__mro__", ())):
        own = base.__doc__ or ""
        if not own.startswith(f"{base.__name__}("):  # what dataclasses make up themselves
            keys = {**properties, **getattr(base, "__dataclass_fields__", {})}
            said |= meanings(inspect.cleandoc(own), list(keys))
    for key, entry in properties.items():
        entry.pop("title", None)
        unit = split_unit(key)[1]
        text = entry.get("description") or said.get(key, "")
        if unit and f"[{unit}]" not in text:
            text = f"{text} [{unit}]".strip()
        if text:
            entry["description"] = text
    return node


def _classes(kind: Any) -> dict[str, Any]:
    """Every dataclass that a type mentions, by the names that a schema may have for it."""
    found: dict[str, Any] = {}
    open_ends = [kind]
    while open_ends:
        item = open_ends.pop()
        open_ends += typing.get_args(item)
        whole = f"{getattr(item, '__module__', '')}.{getattr(item, '__qualname__', '')}".replace(".", "__")
        if isinstance(item, type) and dataclasses.is_dataclass(item) and whole not in found:
            found |= {item.__name__: item, whole: item}
            open_ends += typing.get_type_hints(item, include_extras=True).values()
    return found


def _renamed(node: Any, names: dict[str, str]) -> Any:
    """A copy in which references point to the new names."""
    if isinstance(node, list):
        return [_renamed(item, names) for item in node]
    if not isinstance(node, dict):
        return node
    copy = {key: _renamed(value, names) for key, value in node.items() if key != "discriminator"}
    if isinstance(copy.get("$ref"), str):
        copy["$ref"] = "#/$defs/" + names[copy["$ref"].rpartition("/")[2]]
    return copy


def _machine(catalogue: Catalogue, defs: dict[str, Node]) -> Node:
    slots = {slot.name: _slot(catalogue, slot.name, defs) for slot in catalogue.slots}
    start = {"anyOf": [adopt(StartAlongEdge, "start", defs), adopt(StartPose, "start", defs)]}
    common = adopt(MachineCommon, "machine", defs)["properties"]
    taken = "|".join(f"{key.partition('_')[2]}$" for key in common if "_" in key)
    return {
        "type": "object",
        "description": "a machine; the key is its name",
        "properties": {**common, "start": start, **slots},
        "patternProperties": {
            rf"^{s.name}_(?!{taken}).": slots[s.name] for s in catalogue.slots if s.is_plural
        },
        "additionalProperties": False,
    }


def _realtime(defs: dict[str, Node]) -> Node:
    node = adopt(RealTime, "realtime", defs)
    step = {
        "type": "object",
        "properties": {
            "slot": {"type": "string", "description": "machine.slot"},
            "level": {"type": "string", "description": "the level to take instead"},
        },
        "required": ["slot", "level"],
        "description": "a cheaper level with its keys; those of the present one that it knows are kept",
    }
    degrade = {"type": "array", "items": step, "description": "cheaper levels, taken one after the other"}
    return {**node, "properties": {**node["properties"], "degrade": degrade}}


def _expect(catalogue: Catalogue, defs: dict[str, Node]) -> Node:
    """Limits by metric or column; or by machine and `field`, then by metric or column."""
    judged = catalogue.judged()
    defs["limit"] = adopt(Limit, "limit", defs)
    one: Node = {"$ref": "#/$defs/limit"}
    said = {name: f"{metric.meaning} [{metric.unit or '-'}]" for name, metric in judged.metrics.items()}
    said = dict.fromkeys(judged.columns, "column of the tracks") | said
    limits = {n: {"anyOf": [one, {"type": "array", "items": one}], "description": t} for n, t in said.items()}
    defs["limits"] = {"type": "object", "properties": limits, "additionalProperties": False}
    return {
        "properties": {name: {"$ref": f"#/$defs/limits/properties/{name}"} for name in limits},
        "additionalProperties": {"$ref": "#/$defs/limits"},
    }


def _slot(catalogue: Catalogue, kind: str, defs: dict[str, Node]) -> Node:
    common = adopt(SlotCommon, "slot", defs)["properties"]
    choice = _choice(catalogue, kind, common, defs)
    choice["anyOf"] += [
        _level_of(catalogue, kind, name, "link", common, defs) for name in catalogue.registry.links()
    ]
    choice["anyOf"].append({"enum": ["off", False], "description": "no such slot"})
    return choice


def _choice(catalogue: Catalogue, kind: str, common: Node, defs: dict[str, Node]) -> Node:
    names, packages = catalogue.registry.names(kind), [*catalogue.registry.installed(kind)]
    members: list[Node] = [
        {"enum": names + packages, "description": "the level, with its defaults"},
        FOREIGN,
    ]
    members += [_level_of(catalogue, kind, name, kind, common, defs) for name in names]
    for other in (FOREIGN, *({"const": name} for name in packages)):
        members.append({"type": "object", "properties": {"level": other, **common}, "required": ["level"]})
    return {"anyOf": members}


def _level_of(
    catalogue: Catalogue, kind: str, name: str, group: str, common: Node, defs: dict[str, Node]
) -> Node:
    """A reference to the definition `group.name` of a level's keys, which is made where there is none yet."""
    title = f"{group}.{name}"
    if title not in defs:
        level = catalogue.registry.get(kind, name)
        node = {"properties": {}} if level.params is None else adopt(level.params, title, defs)
        properties = {"level": {"const": name, "description": level.summary}, **common, **node["properties"]}
        is_default = group == kind and name == catalogue.default_level(kind)
        defs[title] = {
            "type": "object",
            "title": f"{group}: {name}",
            "description": level.summary,
            "properties": properties,
            "required": [*node.get("required", []), *([] if is_default else ["level"])],
            "additionalProperties": False,
        }
    return {"$ref": f"#/$defs/{title}"}


def _field(catalogue: Catalogue, defs: dict[str, Node]) -> Node:
    ground = {kind: _choice(catalogue, kind, {}, defs) for kind in catalogue.field_levels}
    edge, obstacle, boundary, weather = (
        adopt(catalogue.part(p), f"field.{p}", defs) for p in ("edge", "obstacles", "boundary", "weather")
    )
    return {
        "type": "object",
        "properties": {
            "folder": {"type": "string", "description": "an imported field: terrain and stand come from it"},
            **ground,
            "edge": edge,
            "edges": {
                "type": "object",
                "description": "several edges by name, instead of `edge`",
                "additionalProperties": edge,
                "minProperties": 1,
            },
            "obstacles": {"type": "array", "items": obstacle},
            "boundary": boundary,
            "weather": weather,
            **adopt(FieldCommon, "field.common", defs)["properties"],
        },
        "additionalProperties": False,
    }
