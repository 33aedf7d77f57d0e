"""What a kind of file is to the fuzz."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Kind:
    """make: writes the files into a folder; read: reads them from there."""

    make: Callable[[Path], Any]
    read: Callable[[Path], Any]


def written(name: str, content: str) -> Callable[[Path], Any]:
    """Makes a file of a text."""
    return lambda folder: (folder / name).write_text(content)


def bundled(kind: str, name: str) -> Callable[[Path], Any]:
    """Makes mine.yaml of a bundled data sheet."""
    import shutil

    from swath.documents.data_sheets import find_sheet

    return lambda folder: shutil.copy(find_sheet(kind, name), folder / "mine.yaml")
