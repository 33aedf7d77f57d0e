"""Format versions of the files of a run: what is written now, and refusing what is newer."""

import json
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.units import digits_in

ABOUT = "recording.json"  # attachment of run.mcap: format, version of swath, detail, mountings, crop
TRACKS = "swath tracks 1"  # metadata `format` of tracks.parquet
RECORDING = "swath recording 3"  # `format` in it


def check_format(found: str, known: str, file: Path) -> None:
    """InputError for a format that is not `known` or an older number of it; "" passes, it is not swath's."""
    name, _, number = found.rpartition(" ")
    expected, _, newest = known.rpartition(" ")
    if found and not (name == expected and 0 <= digits_in(number) <= int(newest)):
        text = f"expected {known} or older; a newer version of swath wrote this"
        raise InputError("format", found, text, file=file)


def read_about(attachment: bytes | None) -> dict[str, Any]:
    """What recording.json says; nothing where there is none, or none that can be read."""
    try:
        found = json.loads(attachment or b"{}")
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
