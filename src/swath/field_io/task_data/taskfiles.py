"""The files of an ISO 11783-10 task data set: a folder or a zip, and XML read up to its first mistake."""

import math
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePath, PurePosixPath
from typing import Any
from xml.parsers import expat

from swath.core.errors import InputError, reason_of
from swath.documents.packed import LARGEST_BYTES, is_archive, open_archive, readable

DEEPEST = 32  # elements within each other; task data go to 8
MOST_ELEMENTS = 100_000  # of the kinds that are read
MOST_POINTS = 1_000_000  # of boundaries and lines
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
        if os.path.isdir(path) or not is_archive(path):
            folder = path if os.path.isdir(path) else path.parent
            parts = [p for p in sorted(folder.iterdir()) if _is_part(p) and os.path.isfile(p)]
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


@dataclass
class Node:
    """An element of a kind that is read. points: its PNT as (type, longitude, latitude [deg], nan = none)."""

    tag: str
    attributes: dict[str, str]
    children: list["Node"] = field(default_factory=list)
    points: list[tuple[str, float, float]] = field(default_factory=list)

    def get(self, attribute: str) -> str:
        """An attribute, '' where it is missing."""
        return self.attributes.get(attribute, "")

    def of(self, tag: str) -> list["Node"]:
        """The children of a kind."""
        return [child for child in self.children if child.tag == tag]


@dataclass
class Tree:
    """An XML file.

    top: holds its outermost element
    others: tag -> count of elements of kinds that are not read, without what is inside them
    problem: the first mistake, with its byte, up to which it is read
    """

    top: Node
    others: Counter[str]
    problem: str = ""


def read_tree(data: bytes, kinds: Collection[str]) -> Tree:
    """The elements of some kinds and the outermost one, up to the first mistake.

    No entities are resolved: a file with a DOCTYPE is not task data.
    """
    top, others = Node("", {}), Counter[str]()
    stack, counts = [(top, True)], Counter[str]()
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > DEEPEST:
            raise ValueError(f"more than {DEEPEST} elements within each other")
        node, (parent, is_kept) = Node(tag, attributes), stack[-1]
        is_read = len(stack) == 1 or tag in kinds
        if is_kept and tag == "PNT":
            counts["points"] += 1
            east, north = number(node.get("D"), math.nan), number(node.get("C"), math.nan)
            parent.points.append((node.get("A"), east, north))
        elif is_kept and is_read:
            counts["elements"] += 1
            parent.children.append(node)
        elif is_kept:
            others[tag] += 1
        for key, most in (("elements", MOST_ELEMENTS), ("points", MOST_POINTS)):
            if counts[key] > most:
                raise ValueError(f"more than {most} {key} of the kinds that are read")
        stack.append((node, is_kept and is_read))

    def refuse(*_: Any) -> None:
        raise ValueError("a DOCTYPE is not allowed")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: stack.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except _BROKEN as error:
        return Tree(top, others, f"byte {max(parser.CurrentByteIndex, 0)}: {reason_of(error)}")
    return Tree(top, others)


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
