"""What a field is, and the start on a state of it that an earlier run left."""

import hashlib
import os
from pathlib import Path
from typing import Any

from swath.documents.contents import file_hash
from swath.field.field import Field
from swath.field.paging.state_file import read_state
from swath.scenario.scenario import Scenario

IRRELEVANT = ("state_file", "origin", "obstacles")  # keys of the section that leave the crop as it is


def begin_field(field: Field, scenario: Scenario) -> None:
    """Let a field start as its `state_file` says. InputError where that is of another field."""
    name = scenario.field.common.state_file
    field.start_from(None if name is None else read_state(Path(name), about(scenario)))


def about(scenario: Scenario) -> dict[str, Any]:
    """What makes a field this one: its keys and seed, files by their content."""
    section = {k: v for k, v in scenario.field.plain().items() if k not in IRRELEVANT}
    return _flat({**section, "seed": scenario.field_seed}, "field.")


def _flat(data: Any, prefix: str) -> dict[str, Any]:
    pairs = data.items() if isinstance(data, dict) else enumerate(data)
    found: dict[str, Any] = {}
    for key, value in pairs:
        if isinstance(value, dict | list):
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = _content(value)
    return found


def _content(value: Any) -> Any:
    """A digest in the place of an absolute path; anything else as it is."""
    if not isinstance(value, str) or not (path := Path(value)).is_absolute() or not os.path.exists(path):
        return value
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if os.path.isdir(path) else [path]:
        if os.path.isfile(file):
            digest.update(file.name.encode() + b"\0" + bytes.fromhex(file_hash(file)))
    return f"{path.name} {digest.hexdigest()[:16]}"
