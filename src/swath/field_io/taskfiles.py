"""The files of an ISO 11783-10 task data set: a folder or a zip, and XML read up to its first mistake."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePath, PurePosixPath
from typing import Any
from xml.parsers import expat

from swath.core.errors import InputError
from swath.documents.packed import LARGEST_BYTES, is_archive, open_archive, readable

DEEPEST = 32  # elements within each other; task data go to 8
MOST_ELEMENTS = 100_000  # of the kinds that are asked for
_BROKEN = (expat.ExpatError, LookupError, ValueError)  # LookupError: an unknown encoding


def is_log_file(path: Path) -> bool:
    """True for the name of a time log, TLGnnnnn.bin or .xml."""
    return path.name.upper().startswith("TLG") and path.suffix.upper() in (".BIN", ".XML")


class TaskFiles(Mapping[str, bytes]):
    """Upper-case name -> content of every xml and bin, read when it is asked for; size: of all on disk."""

    def __init__(self, parts: Mapping[str, Callable[[], bytes]], path: Path, size: int) -> None:
        self._parts, self._path, self.size = parts, path, size

    def __getitem__(self, name: str) -> bytes:
        read = self._parts[name]
        with readable("taskdata", "readable files", self._path):
            return read()

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)


@contextmanager
def task_files(path: Path) -> Iterator[TaskFiles]:
    """The files of a folder or zip. InputError where it cannot be read, or is larger than task data are."""
    with readable("taskdata", "readable files", path):
        if path.is_dir() or not is_archive(path):
            folder = path if path.is_dir() else path.parent
            parts = [p for p in sorted(folder.iterdir()) if _is_part(p) and p.is_file()]
            total = sum(p.stat().st_size for p in parts)
            if total > LARGEST_BYTES:
                raise InputError("taskdata", total, f"expected at most {LARGEST_BYTES} bytes", file=path)
            yield TaskFiles({p.name.upper(): p.read_bytes for p in parts}, path, total)
            return
        with open_archive(path, "taskdata") as archive:
            names = {info: PurePosixPath(info.filename) for info in archive.infolist()}
            top = next((p for p in names.values() if p.name.upper() == "TASKDATA.XML"), None)
            home = top.parent if top else PurePosixPath()
            inside = {i: p for i, p in names.items() if p.parent == home and _is_part(p)}
            read = {p.name.upper(): partial(archive.read, i) for i, p in inside.items()}
            yield TaskFiles(read, path, path.stat().st_size)


def _is_part(path: PurePath) -> bool:
    return path.suffix.upper() in (".XML", ".BIN")


Element = tuple[str, dict[str, str], tuple[tuple[str, dict[str, str]], ...]]


def elements(data: bytes, wanted: Collection[str]) -> tuple[list[Element], str]:
    """(tag, attributes, those around it) of the wanted elements up to the first mistake; and what that is.

    No entities are resolved: a file with a DOCTYPE is not task data.
    """
    found: list[Element] = []
    stack: list[tuple[str, dict[str, str]]] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) >= DEEPEST:
            raise ValueError(f"more than {DEEPEST} elements within each other")
        if tag in wanted:
            if len(found) >= MOST_ELEMENTS:
                raise ValueError(f"more than {MOST_ELEMENTS} elements {', '.join(sorted(wanted))}")
            found.append((tag, attributes, tuple(stack)))
        stack.append((tag, attributes))

    def refuse(*_: Any) -> None:
        raise ValueError("a DOCTYPE is not allowed")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: stack.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except _BROKEN as error:
        return found, f"byte {max(parser.CurrentByteIndex, 0)}: {error}"
    return found, ""


def number(text: str | None, default: float) -> float:
    """A finite number of an attribute, else the default."""
    try:
        value = float(text) if text else default
    except ValueError:
        return default
    return value if math.isfinite(value) else default


def hex_number(text: str | None) -> int | None:
    """A hexadecimal number of an attribute, None where it is none."""
    try:
        return int(text or "", 16)
    except ValueError:
        return None
