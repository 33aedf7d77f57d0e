"""The files of an ISO 11783-10 task data set: a folder or a zip, and XML read up to its first mistake."""

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

from swath.core.errors import InputError

LARGEST_BYTES = 1 << 30  # of all files together
_BROKEN = (expat.ExpatError, ValueError)


def is_log_file(path: Path) -> bool:
    """True for the name of a time log, TLGnnnnn.bin or .xml."""
    return path.name.upper().startswith("TLG") and path.suffix.upper() in (".BIN", ".XML")


def task_files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Upper-case name -> content of every xml and bin of the folder or zip."""
    total = 0
    try:
        if path.is_dir() or not zipfile.is_zipfile(path):
            folder = path if path.is_dir() else path.parent
            for part in sorted(folder.iterdir()):
                if part.suffix.upper() in (".XML", ".BIN") and part.is_file():
                    total += part.stat().st_size
                    _check_size(total, path)
                    yield part.name.upper(), part.read_bytes()
            return
        with zipfile.ZipFile(path) as archive:
            infos = archive.infolist()
            top = next((i for i in infos if PurePosixPath(i.filename).name.upper() == "TASKDATA.XML"), None)
            home = PurePosixPath(top.filename).parent if top else PurePosixPath()
            for info in infos:
                inside = PurePosixPath(info.filename)
                if inside.parent == home and inside.suffix.upper() in (".XML", ".BIN"):
                    total += info.file_size
                    _check_size(total, path)
                    yield inside.name.upper(), archive.read(info)
    except InputError:
        raise
    except Exception as error:  # zipfile raises what its parsers meet: zlib, struct, runtime errors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError("taskdata", None, f"expected readable files: {reason}", file=path) from error


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
