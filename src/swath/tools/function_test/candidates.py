"""Candidates: named changes of a scenario that are tested against each other."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from swath.core.errors import InputError
from swath.documents.yaml_document import read_mapping
from swath.tools.function_test.case import from_beside

MOST = 1000  # candidates: the scenarios of all are read before the first run
EVERY, SHIPPED = "*", "shipped"  # machine in a key: each with such a slot; what a detector is held against


def read_candidates(path: Path | None) -> Mapping[str, Sequence[str]]:
    """Changes by name, as after `--set`, from a file `NAME: {KEY: VALUE}`; `{base: {}}` without a file.

    `mine.py:Detector` in the place of a file is an edge detector, beside the one that each scenario has.
    Files that values name (`mine.py:Detector`) are relative to that file. Raises InputError.
    """
    if path is None:
        return {"base": ()}
    if ".py:" in path.name:
        part = from_beside(path.name, path.parent)
        return {SHIPPED: (), path.name.rpartition(":")[2]: [f"{EVERY}.edge.level={json.dumps(part)}"]}
    document = read_mapping(path, "candidates")
    if not document.data:
        raise document.error((), None, "expected names, each with scenario keys and values")
    if len(document.data) > MOST:
        raise document.error((), len(document.data), f"expected at most {MOST} candidates")
    found: dict[str, list[str]] = {}
    for name, sets in document.data.items():
        if not isinstance(sets, dict):
            raise document.error((name,), sets, "expected scenario keys and values, {} for none")
        found[name] = [f"{key}={json.dumps(from_beside(value, path.parent))}" for key, value in sets.items()]
    if any(not name or "/" in name for name in found):
        raise InputError("candidates", str(list(found)), "expected names without /", file=path)
    return found
