"""Frames of BLF and ASC files with their bus, and one axis of time for what begins again at 0."""

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra
from swath.core.files.read_file import open_to_read
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.documents.packed import most_unpacked

Frame = tuple[int, int, int, bool, bytes]
"""Time [ns] since the log began, bus, identifier, whether it has 29 bits, data."""

Times = NDArray[np.int64]
Tell = Callable[[str, int], None]  # takes a note, and how often it holds
LATEST = 1 << 62  # ns: 146 years
BACK = NS  # ns by which a stamp falls behind the one before where a clock began again, or was set
BEGINS_AGAIN = "stamps fall back, as of a clock that began again or was set: what follows is put 1 s behind"
WHOLE_S = 1.0  # s: heads of ASC files may say whole seconds
MANY = 0.01  # of the records of a file: what is worth a note
OBJECT = struct.Struct("<4sHHLL")  # head of an object in BLF: LOBJ, its size, version, size of all, type
CONTAINER, PACKED, PACKING = 10, 2, 16  # type of object, a way of packing, bytes before what is packed
PADDING = 3  # bytes behind an object, at most
LARGEST = 1 << 24  # bytes of an object; frames of Ethernet take 64 kB; estimated
_HEAD = re.compile(
    r"(date|begin\s+triggerblock)\s+\w+\s+(?P<date>.+)|(?P<end>end\s+triggerblock)|//.*"
    r"|base\s+(?P<base>hex|dec)(\s+timestamps\s+(?P<stamps>absolute|relative))?"
    r"|(no)?\s*internal\s+events\s+logged",
    re.IGNORECASE,
)
_STAMP = re.compile(r"\d+\.\d+(?=\s)", re.ASCII)


class Axis:
    """One axis of time for sources whose clocks begin again at 0, or are set back: what follows is put BACK
    behind what was before.

    shifts: of the times between two falls [ns], as an earlier pass has found them; then, as for sources that
    stand one behind the other, each source begins with the first of them
    """

    def __init__(self, shifts: Sequence[int] = (0,), *, is_one_by_one: bool = False) -> None:
        self.shifts = [*shifts]
        self._is_one_by_one = is_one_by_one
        self._latest = -LATEST
        self._last: dict[int, tuple[int, int]] = {}  # source -> its last stamp, and which shift it has

    def time(self, source: int, stamp: int) -> int:
        """A stamp of a source [ns] on it, in the order of the file; one that no file can mean stays."""
        if abs(stamp) > LATEST:
            return stamp
        begin = 0 if self._is_one_by_one else len(self.shifts) - 1
        last, run = self._last.get(source, (stamp, begin))
        if stamp < last - BACK:
            run += 1
            if run == len(self.shifts):
                self.shifts.append(self._latest + BACK - stamp)
        self._last[source] = stamp, run
        t = stamp + self.shifts[run]
        self._reach(t)
        return t

    def times(self, source: int, stamps: Times) -> Times:
        """As `time`, of the next block of a source."""
        made, known = stamps.copy(), np.flatnonzero(stamps <= LATEST)
        for part in np.split(known, np.flatnonzero(np.diff(stamps[known]) < -BACK) + 1):
            if len(part):
                first = int(stamps[part[0]])
                shift = self.time(source, first) - first
                self._last[source] = int(stamps[part[-1]]), self._last[source][1]
                self._reach(int(stamps[part].max()) + shift)
                made[part] += shift
        return made

    def _reach(self, t: int) -> None:
        if t > LATEST:
            raise ValueError("stamps that fall back over and over")
        self._latest = max(self._latest, t)

    def tell(self, tell: Tell) -> None:
        """Note what was put where."""
        if len(self.shifts) > 1:
            tell(f"timeline: {BEGINS_AGAIN}", len(self.shifts) - 1)


def logged(path: Path, tell: Tell, *, is_text: bool) -> Iterator[Frame]:
    """Frames of a BLF or ASC file, to the microsecond; what of it is none, or cannot be read, is told."""
    axis, others = Axis(), dict[str, int]()
    with open_to_read(path, "log", "a log of frames") as file:
        for seconds, m in _in_asc(file, tell) if is_text else _in_blf(file, tell):
            if m.is_error_frame or m.is_remote_frame:
                what = "error frames" if m.is_error_frame else "requests without data"
                others[what] = others.get(what, 0) + 1
                continue
            bus = m.channel + 1 if isinstance(m.channel, int) else 0
            t = round(seconds * 1e6) * 1000
            yield axis.time(bus, t), bus, m.arbitration_id, m.is_extended_id, bytes(m.data)
    axis.tell(tell)
    for what, count in others.items():
        tell(f"unused: {what}", count)


class _Lines:
    """Lines of an ASC file, and when each was.

    time: of the line that was given out last [s], since the date of the first measurement in the file
    is_over: all were given out; is_begun: a block was begun and did not end
    """

    def __init__(self, file: Iterable[str], date_of: Callable[[str], float]) -> None:
        self._file, self._date_of = iter(file), date_of
        self._base, self._is_relative = "hex", False
        self._dates: list[float] = []  # of measurements and blocks, absolute [s]
        self._measured = self._stamp = self._from = 0.0
        self._block: float | None = None  # of one without a line so far, since the measurement began
        self.time, self.count, self.is_over, self.is_begun = 0.0, 0, False, False

    def part(self) -> Iterator[str]:
        """The head and the lines up to those whose numbers have another base."""
        yield f"base {self._base}\n"
        yield "internal events logged\n"
        for line in self._file:
            found = _HEAD.match(line.strip())
            if found is None:
                self.count += bool(line.strip())
                if stamp := _STAMP.match(line.strip()):
                    self._take(float(stamp[0]))
                yield line
            elif found["base"]:
                self._is_relative = (found["stamps"] or "").lower() == "relative"
                if found["base"].lower() != self._base:
                    self._base = found["base"].lower()
                    return
            elif found["date"]:
                self._begin(found["date"], is_block=not found[0].lower().startswith("date"))
            else:
                self.is_begun = self.is_begun and not found["end"]
        self.is_over = True

    def _begin(self, date: str, *, is_block: bool) -> None:
        self.is_begun = is_block
        try:
            at = self._date_of(date.strip())
        except ValueError:  # of another language
            return
        self._dates.append(at)
        if not is_block or len(self._dates) == 1:
            self._measured, self._stamp, self._from = at - self._dates[0], 0.0, 0.0
        self._block = at - self._dates[0] - self._measured

    def _take(self, stamp: float) -> None:
        """A line with a stamp. It counts from the date of the measurement, from that of the block where it
        would lie before it.
        """
        at = self._stamp + stamp if self._is_relative else stamp
        if self._block is not None:
            is_before = at < self._block - WHOLE_S
            self._from, at, self._block = (self._block, stamp, None) if is_before else (0.0, at, None)
        self._stamp = at
        self.time = self._measured + self._from + at


def _in_asc(file: Any, tell: Tell) -> Iterator[tuple[float, Any]]:
    """Messages of an ASC file and when they were [s]."""
    with Extra("can", "reading frames"):
        import can
    read = damaged = 0
    with TextIOWrapper(file, "utf-8", errors="replace") as text:
        lines = _Lines(text, can.ASCReader._datetime_to_timestamp)
        while not lines.is_over:
            try:
                for m in can.ASCReader(lines.part()):
                    if len(m.data) < m.dlc and not m.is_remote_frame:
                        damaged += 1
                        continue
                    read += 1
                    yield lines.time, m
            except (ValueError, IndexError):  # of a line: what follows is read by another reader
                damaged += 1
    others = lines.count - read - damaged
    if damaged:
        tell("damaged: lines of frames that cannot be read", damaged)
    if others > MANY * lines.count:
        tell("unused: lines that are no frames", others)
    if lines.is_begun:
        tell("damaged: the file ends before the end of its block", 1)


def _in_blf(file: Any, tell: Tell) -> Iterator[tuple[float, Any]]:
    """Messages of a BLF file and when they were [s]."""
    with Extra("can", "reading frames"):
        import can

    size = os.fstat(file.fileno()).st_size
    reader, read, objects, damaged = can.BLFReader(file), 0, 0, 0
    parsed: Any = reader._parse_data
    for one in _objects(_containers(file, tell)):
        try:
            objects += bool(one)
            damaged += not one
            for m in parsed(one):
                read += 1
                yield m.timestamp - (reader.start_timestamp or 0.0), m
        except struct.error:  # shorter than what its type has
            damaged += 1
    if damaged:
        tell("damaged: objects that cannot be read", damaged)
    stated = reader.object_count
    if reader.file_size > size:
        tell(
            f"damaged: the file ends after {num(size)} of the {num(reader.file_size)} bytes of its head",
            1,
        )
    elif not stated and objects:
        tell("damaged: its logger did not end it, what that still held is missing", 1)
    elif stated - objects > MANY * stated:
        tell(f"lost: {num(stated)} objects are stated, {num(objects)} are there", stated - objects)
    if objects - read > MANY * objects:
        tell("unused: objects that are no frames", objects - read)


def _containers(file: Any, tell: Tell) -> Iterator[bytes]:
    """What the containers of a BLF file hold."""
    while len(head := file.read(OBJECT.size)) == OBJECT.size:
        signature, _, _, size, kind = OBJECT.unpack(head)
        if signature != b"LOBJ" or size < OBJECT.size:
            tell("damaged: the file cannot be read further than an object that is none", 1)
            return
        body = file.read(size - OBJECT.size)
        file.read(size % 4)
        if kind == CONTAINER:
            data = body[PACKING:]
            yield _unpacked(data) if int.from_bytes(body[:2], "little") == PACKED else data


def _objects(containers: Iterable[bytes]) -> Iterator[bytes]:
    """The whole objects in containers, one of which may go on in the next; b"" for what is none."""
    rest, is_lost, since = b"", False, 0
    for data in containers:
        rest, at, since = rest + data, 0, since + len(data)
        while (found := rest.find(b"LOBJ", at)) >= 0 and found + OBJECT.size <= len(rest):
            size = int.from_bytes(rest[found + 8 : found + 12], "little")
            is_one = OBJECT.size <= size <= LARGEST
            if is_one and found + size > len(rest):
                break
            if not is_lost and (not is_one or found > at + PADDING):
                yield b""
            if is_one:
                since = 0
                yield rest[found : found + size]
            is_lost, at = not is_one, found + (size if is_one else 1)
        at = max(at, found if found >= 0 else len(rest) - 2 * PADDING)
        rest = rest[at:]
        if since > 2 * LARGEST:
            break
    if len(rest) > PADDING and not is_lost:
        yield b""


def _unpacked(data: bytes) -> bytes:
    """What a container holds. ValueError for one that holds more than its size can."""
    unpacking, most = zlib.decompressobj(), most_unpacked(len(data))
    found = unpacking.decompress(data, most)
    if unpacking.unconsumed_tail:
        raise ValueError(f"a container of {len(data)} bytes unpacks to more than {most}")
    return found
