"""JSON files as plain data."""

import json
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.documents.packed import MIB, readable

MAX_BYTES = 64 * MIB  # a track of a day at 1 Hz has 2


def read_json(path: Path, key: str, what: str) -> Any:
    """Plain data of a JSON file. InputError with this key, `expected what`, for a file that is none."""
    if not path.is_file():
        raise InputError(key, str(path), f"expected {what}, there is no such file")
    with readable(key, what, path):
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(key, size, f"expected at most {MAX_BYTES} bytes", file=path)
        return json.loads(path.read_text(encoding="utf-8-sig"))
