"""JSON files as plain data."""

import json
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.units import rounded
from swath.documents.packed import MIB, readable
from swath.documents.text_file import read_text

MAX_BYTES = 32 * MIB  # a track of a day at 1 Hz has 2
MOST_DIGITS = 300  # of a whole number: floats end behind them


def read_json(path: Path, key: str, what: str) -> Any:
    """Plain data of a JSON file. InputError with this key, `expected what`, for a file that is none."""
    text = read_text(path, key, what, MAX_BYTES)
    with readable(key, what, path):
        return json.loads(text, parse_int=whole_number)


def read_object(path: Path, key: str, what: str) -> dict[str, Any]:
    """As `read_json`, of a file that holds a JSON object."""
    data = read_json(path, key, what)
    if not isinstance(data, dict):
        raise InputError(key, None, f"expected {what}, a JSON object", file=path)
    return data


def whole_number(text: str) -> int:
    """A whole number of JSON (`parse_int`). ValueError for one of too many digits."""
    if len(text) > MOST_DIGITS:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def json_safe(value: Any, digits: int | None = None) -> Any:
    """The value as JSON can say it: plain numbers, lists and dicts; nan and infinity become null.

    digits: to which numbers are rounded, if they are
    """
    if isinstance(value, Mapping):
        return {str(k): json_safe(v, digits) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return json_safe(value.tolist(), digits)
    if isinstance(value, list | tuple):
        return [json_safe(v, digits) for v in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return rounded(value, digits) if isinstance(value, float) and digits else value


def json_text(data: Any) -> str:
    """Data as text for a file or the screen, made plain by `json_safe`."""
    return json.dumps(json_safe(data), indent=2, allow_nan=False)


def write_json(path: Path, data: Any) -> Path:
    """Write data as a JSON file in one go; returns its path."""
    return write_whole(path, json_text(data) + "\n")
