"""Files that a case or a candidate names: relative to the file that names them."""

from os.path import isfile  # of a name too long, too, it says no
from pathlib import Path

from swath.core.foreign_code import source_of

SUFFIXES = (".py", ".yaml", ".fmu", ".csv", ".npz")


def from_beside(value: object, folder: Path) -> object:
    """A value of a scenario key, files in a folder (`mine.py:Detector`) as absolute paths."""
    if isinstance(value, dict):
        return {key: from_beside(inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [from_beside(inner, folder) for inner in value]
    if isinstance(value, str):
        file, colon, name = value.partition(":")
        if file.endswith(SUFFIXES) and isfile(source_of(folder / file)):
            return f"{(folder / file).resolve()}{colon}{name}"
    return value
