"""The values of a run that nobody wrote: what the scenario file and the flags left to swath."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from swath.documents.yaml_document import KeyPath, parse
from swath.scenario.scenario import Scenario
from swath.scenario.sections import SlotCommon
from swath.scenario.versions import lift_machines

NO_BREAK = "\N{NO-BREAK SPACE}"  # between key and value
# Keys of every slot that are the same by default in all of them, said once; rate_hz has no such default.
_SHARED = {
    n: f.default for n, f in SlotCommon.model_fields.items() if not f.is_required() and f.default is not None
}


def defaults(scenario: Scenario) -> dict[str, Any]:
    """The part of `scenario.lifted()` that is written neither in the file nor in a flag, in the same nesting.

    Empty where a scenario writes everything, as that of a run folder does.
    """
    unwritten: dict[str, Any] = _unwritten(scenario.lifted(), scenario.document.data)
    return {key: value for key, value in unwritten.items() if key not in ("name", "summary")}


def default_lines(scenario: Scenario) -> set[int]:
    """Numbers, from 1, of the lines of `scenario.resolved()` on which there is nothing but defaults."""
    unwritten = set(_leaves(defaults(scenario), ()))
    lines: dict[int, bool] = {}
    places = lift_machines(parse(scenario.resolved())).places
    insides = {path[:-1] for path in places if path}
    for path in places.keys() - insides:
        is_default = any(path[:end] in unwritten for end in range(1, len(path) + 1))
        for end in range(1, len(path) + 1):  # a heading is pale when all below it is
            line = places[path[:end]].line or 0
            lines[line] = lines.get(line, True) and is_default
    return {line for line, is_default in lines.items() if is_default}


def paragraphs(scenario: Scenario) -> list[tuple[str, str]]:
    """(title, text) per section and slot that has defaults: `("lidar plants", "sub_rays 19, spot fixed")`.

    A machine's slots are named with it where there are several machines. Values without a default of their
    own (null: the data sheet's or none) close a text by their keys alone. Key and value
    are joined by NO_BREAK.
    """
    unwritten, whole = defaults(scenario), scenario.lifted()
    found = [("scenario", {k: v for k, v in unwritten.items() if not isinstance(v, dict)})]
    found += [(k, unwritten[k]) for k in ("run", "realtime") if k in unwritten]
    found += _parts("field", unwritten.get("field", {}), whole["field"], prefix="field ")
    for name in scenario.machines:
        own = unwritten.get(name, {})
        prefix = f"{name}." if len(scenario.machines) > 1 else ""
        slots = {k: _own(v) if k in scenario.machines[name].slots else v for k, v in own.items()}
        found += _parts(name, slots, whole[name], prefix=prefix)
    shared = ", ".join(_said(key, value) for key, value in _SHARED.items())
    texts = [(title, _listed(values)) for title, values in found if values]
    return [*texts, ("every slot", f"{shared}, where not written otherwise")] if texts else []


def _parts(
    name: str, unwritten: Mapping[str, Any], whole: Mapping[str, Any], *, prefix: str
) -> Iterator[tuple[str, Any]]:
    """The section's own values, then those of each part in it that has a level."""
    levels = {k: v["level"] for k, v in whole.items() if isinstance(v, dict) and "level" in v}
    yield name, {k: v for k, v in unwritten.items() if k not in levels}
    for part, level in levels.items():
        values = unwritten.get(part, {})
        if values:
            yield f"{prefix}{part} {Path(level).name}", values


def _own(slot: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a slot without those that are said once for all."""
    return {k: v for k, v in slot.items() if k not in _SHARED or v != _SHARED[k]}


def _unwritten(value: Any, written: Any) -> Any:
    """What of `value` is not in `written`; empty when all of it is."""
    if isinstance(value, dict):
        if not isinstance(written, dict):  # `lidar: plants` writes the level
            written = {"level": written} if isinstance(written, str) else {}
        unwritten = {k: _unwritten(v, written[k]) if k in written else v for k, v in value.items()}
        return {k: v for k, v in unwritten.items() if k not in written or v not in ({}, [], None)}
    if isinstance(value, list) and isinstance(written, list) and len(value) == len(written):
        found = [_unwritten(v, w) for v, w in zip(value, written, strict=True)]
        return {index: v for index, v in enumerate(found) if v not in ({}, [], None)}
    return None


def _leaves(unwritten: Mapping[Any, Any], path: KeyPath) -> Iterator[KeyPath]:
    for key, value in unwritten.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key)


def _listed(values: Mapping[Any, Any]) -> str:
    said = [_said(str(key), value) for key, value in values.items() if value is not None]
    nulls = [str(key) for key, value in values.items() if value is None]
    return "; ".join([", ".join(said)] * bool(said) + [f"null: {', '.join(nulls)}"] * bool(nulls))


def _said(key: str, value: Any) -> str:
    if isinstance(value, dict) and any(isinstance(k, int) for k in value):  # entries of a list
        return ", ".join(_said(f"{key}.{index}", entry) for index, entry in value.items())
    return f"{key} {_text(value)}".replace(" ", NO_BREAK, 1)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return f"({_listed(value)})" if value else "none"
    if isinstance(value, list):
        return f"[{', '.join(_text(v) for v in value)}]"
    if isinstance(value, bool) or value is None:
        return str(value).lower().replace("none", "null")
    return f"{value:g}" if isinstance(value, float) else str(value)
