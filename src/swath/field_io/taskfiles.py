"""The files of an ISO 11783-10 task data set: a folder or a zip, and XML read up to its first mistake."""

import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath, PurePosixPath
from typing import Any
from xml.parsers import expat

from swath.core.errors import InputError, SwathError

LARGEST_BYTES = 1 << 30  # of all files together
_BROKEN = (expat.ExpatError, ValueError)


def is_log_file(path: Path) -> bool:
    """True for the name of a time log, TLGnnnnn.bin or .xml."""
    return path.name.upper().startswith("TLG") and path.suffix.upper() in (".BIN", ".XML")


@contextmanager
def readable(key: str, what: str, path: Path) -> Iterator[None]:
    """Makes an InputError of whatever a parser meets in a damaged file: zlib, struct, index, value errors."""
    try:
        yield
    except SwathError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise InputError(key, None, f"expected {what}: {reason}", file=path) from error


def task_files(path: Path) -> dict[str, bytes]:
    """Upper-case name -> content of every xml and bin of the folder or zip."""
    with readable("taskdata", "readable files", path):
        if path.is_dir() or not zipfile.is_zipfile(path):
            folder = path if path.is_dir() else path.parent
            parts = [p for p in sorted(folder.iterdir()) if _is_part(p) and p.is_file()]
            _check_size(sum(p.stat().st_size for p in parts), path)
            return {p.name.upper(): p.read_bytes() for p in parts}
        with zipfile.ZipFile(path) as archive:
            names = {info: PurePosixPath(info.filename) for info in archive.infolist()}
            top = next((p for p in names.values() if p.name.upper() == "TASKDATA.XML"), None)
            home = top.parent if top else PurePosixPath()
            inside = {i: p for i, p in names.items() if p.parent == home and _is_part(p)}
            _check_size(sum(info.file_size for info in inside), path)
            return {p.name.upper(): archive.read(info) for info, p in inside.items()}


def _is_part(path: PurePath) -> bool:
    return path.suffix.upper() in (".XML", ".BIN")


def _check_size(total: int, path: Path) -> None:
    if total > LARGEST_BYTES:
        raise InputError("taskdata", total, f"expected at most {LARGEST_BYTES} bytes", file=path)


Element = tuple[str, dict[str, str], tuple[tuple[str, dict[str, str]], ...]]


def elements(data: bytes) -> tuple[list[Element], str]:
    """(tag, attributes, those around it) of every element up to the first mistake; and what that is.

    No entities are resolved: a file with a DOCTYPE is not task data.
    """
    found: list[Element] = []
    stack: list[tuple[str, dict[str, str]]] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
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
