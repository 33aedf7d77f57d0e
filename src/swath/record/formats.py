"""Format versions of the files of a run: what is written now, and refusing what is newer."""

from pathlib import Path

from swath.core.errors import InputError

TRACKS = "swath tracks 1"  # metadata `format` of tracks.parquet
RECORDING = "swath recording 1"  # `format` in recording.json, attached to run.mcap


def check_format(found: str, known: str, file: Path) -> None:
    """InputError for a format that is not `known` or an older number of it; "" passes, it is not swath's."""
    name, _, number = found.rpartition(" ")
    expected, _, newest = known.rpartition(" ")
    if found and not (name == expected and number.isdigit() and int(number) <= int(newest)):
        text = f"expected {known} or older; a newer version of swath wrote this"
        raise InputError("format", found, text, file=file)
