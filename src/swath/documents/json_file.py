"""JSON files as plain data."""

import json
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.documents.packed import MIB, readable
from swath.documents.text_file import read_text

MAX_BYTES = 32 * MIB  # a track of a day at 1 Hz has 2
MOST_DIGITS = 300  # of a whole number: floats end behind them


def read_json(path: Path, key: str, what: str) -> Any:
    """Plain data of a JSON file. InputError with this key, `expected what`, for a file that is none."""
    text = read_text(path, key, what, MAX_BYTES)
    with readable(key, what, path):
        return json.loads(text, parse_int=_whole_number)


def read_object(path: Path, key: str, what: str) -> dict[str, Any]:
    """As `read_json`, of a file that holds a JSON object."""
    data = read_json(path, key, what)
    if not isinstance(data, dict):
        raise InputError(key, None, f"expected {what}, a JSON object", file=path)
    return data


def _whole_number(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)
