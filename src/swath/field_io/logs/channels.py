"""Measurements of machinery makers as named channels with unit and time: MF4, and frames in BLF, ASC or MF4.

Frames are decoded by a DBC file: that beside the log with its name, or the only one in its folder; else by
the messages of ISO 11783 that come with swath. Files are read by blocks; a long one takes no more memory.
Messages of several frames (J1939 transport) are put together, at the time of their last frame.
"""

import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from heapq import merge
from io import BytesIO
from pathlib import Path
from traceback import walk_tb
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swath.core.apart.call import apart
from swath.core.errors import Extra, InputError, SwathError, reason_of
from swath.core.files.read_file import open_to_read
from swath.core.number_text import num
from swath.core.units import UNITS, Unit
from swath.documents.formula import computed
from swath.documents.j1939 import TRANSPORT, TRANSPORT_DATA, Transport, dbc_file, parse, value_of
from swath.documents.text_file import read_bytes
from swath.field_io.logs.columns import unit_symbol
from swath.field_io.logs.frames import LATEST, MANY, Axis, Frame, Tell, Times, logged

Array = NDArray[np.float64]
Block = tuple[str, Times, Array]  # channel, times [ns] since the log began, values in its unit
FRAGMENT = 4 << 20  # bytes of an MF4 file in memory at a time
NEVER = 3 << 61  # [ns]: what stands for times after LATEST
TOO_LATE = "timeline: samples more than 146 years from the first, left out"
FRAMES = 1 << 16  # decoded frames in memory at a time
VARIABLES = ("X", "P1", "P2", "P3", "P4", "P5", "P6")  # of conversions, as asammdf calls them
NO_ARITHMETIC = "its conversion, or that of its time, is a formula other than arithmetic"
Key = tuple[int, int, bool]  # of frames: bus, identifier, whether it has 29 bits
BUS = "CAN_DataFrame"  # channel of frames in an MF4 file (ASAM MDF bus logging)
MAGIC = {
    b"MDF     ": "MF4",
    b"UnFinMF ": "MF4",
    b"LOGG": "BLF",
    b"date ": "ASC",
    b"base hex": "ASC",
    b"base dec": "ASC",
}
RIGHT = " right"  # after the unit of a number that counts to the right, where it counts to the left here
LONGEST = 1785  # bytes of a message: of the transport protocol of SAE J1939-21
_LENGTHS = re.compile(
    r"^\s*(?:BO_\s+\d+\s+(?P<message>\w+)\s*:\s*(?P<bytes>\d+)|SG_[^:]*:\s*\d+\s*\|\s*(?P<bits>\d+)\s*@)",
    re.MULTILINE,
)
_KINDS = {unit.symbol: unit for unit in UNITS.values()}
_KINDS |= {"1/km": Unit("1/km", "per length", 1e-3), "W": Unit("W", "power"), "Pa": Unit("Pa", "pressure")}
_SI = {unit.kind: unit.symbol for unit in reversed(_KINDS.values()) if unit.factor == 1.0}
_SI |= {"ratio": "1", "volume flow": "m3/s"}


class Channels(Protocol):
    """A measurement. units: channel -> unit as the file says it, '' where it says none.

    begin, end: first and last time [ns]; notes: what was assumed or could not be read, with how often
    sources: name -> the channels that say it, where several groups, buses or senders do
    spans: channel -> times of its first and last sample [ns]
    lacking: channel -> records that the file states of it and does not have; None where it states none
    is_held: a value holds until the next one, however long that takes
    """

    path: Path
    units: dict[str, str]
    begin: int
    end: int
    notes: dict[str, int]
    sources: dict[str, list[str]]
    lacking: dict[str, int] | None
    spans: dict[str, tuple[int, int]]
    is_held: bool

    def blocks(self, wanted: Collection[str]) -> Iterator[Block]:
        """The samples of some channels, those of each in the order of time."""

    def samples(self, wanted: Collection[str]) -> Iterator[tuple[int, str, float]]:
        """(time [ns], channel, value), of all channels in the order of time."""


def si_unit(text: str) -> tuple[str, float] | None:
    """SI unit of the kind that a unit measures, and the factor to it; None for a unit that is not known."""
    bare = text.removesuffix(RIGHT)
    unit = _KINDS.get(bare) or _KINDS.get(unit_symbol(bare))
    if unit is None or not text:
        return None
    return _SI.get(unit.kind, unit.kind), unit.factor if bare == text else -unit.factor


def kind_of(path: Path) -> str:
    """MF4, BLF or ASC by the first bytes of a file; '' for another one. InputError for an MDF before 4."""
    if not os.path.isfile(path):
        return ""
    with open_to_read(path, "log", "a log") as file:
        head = file.read(16)
    kind = next((kind for magic, kind in MAGIC.items() if head.startswith(magic)), "")
    if kind == "MF4" and head[8:9] in (b"1", b"2", b"3"):  # its version as text: 3.30, 4.10
        version = head[8:].partition(b"\0")[0].decode("ascii", "replace").strip()
        raise InputError("log", path.name, f"expected MDF 4 (.mf4), it is MDF {version}", file=path)
    return kind


def open_channels(path: Path) -> Channels | None:
    """The reader of a measurement; None for a file of another kind. InputError where it cannot be read."""
    kind = kind_of(path)
    if not kind:
        if (named := path.suffix[1:].upper()) in ("MF4", "BLF") and os.path.isfile(path):
            expected = f"expected {named}, which its first bytes are not"
            raise InputError("log", path.name, expected, file=path)
        return None
    return _opened_mf4(path) if kind == "MF4" else _opened_frames(path, kind)


def _computed(text: str) -> Any:
    """What asammdf asks of numexpr, and else of sympy, both of which make code of a formula: without code.

    Its variables stand where it asks: X, and those of a rational conversion. It wrote X for every x.
    """
    asking = sys._getframe(1).f_locals
    known = {name.lower(): asking[name] for name in VARIABLES if name in asking}
    return computed(text.replace("X", "x").replace("P", "p"), known)


def _formulas(conversion: Any) -> Iterator[str]:
    """Formulas of a conversion, and of those that its tables refer to."""
    if hasattr(conversion, "formula"):  # a reference may be a text, too
        yield from filter(None, [conversion.formula])
        for inner in (conversion.referenced_blocks or {}).values():
            yield from _formulas(inner)


def _without_arithmetic(mdf: Any) -> set[tuple[int, int]]:
    """Channels by group and index with a formula that is not computed here."""
    found = set()
    for group, about in enumerate(mdf.groups):
        for index, channel in enumerate(about.channels):
            try:
                for text in _formulas(channel.conversion):
                    computed(text.replace("X", "x"), dict.fromkeys(("x", "x1"), np.zeros(1)))
            except (ValueError, TypeError):
                found.add((group, index))
    return found


@contextmanager
def _mdf(path: Path) -> Iterator[Any]:
    with Extra("mf4", "reading MF4"):
        from asammdf import MDF
        from asammdf.blocks import mdf_v4, v2_v3_blocks, v4_blocks
    for module in (v2_v3_blocks, v4_blocks):
        vars(module).update(evaluate=_computed, lambdify=None)
    on_disk = mdf_v4.NamedTemporaryFile
    with open_to_read(path, "log", "an MF4 file") as file:  # by a path it maps all of it
        try:
            mdf_v4.NamedTemporaryFile = lambda dir: BytesIO()  # what it writes meanwhile stays in memory
            mdf = MDF(file)
        except Exception as error:
            for frame, _ in walk_tb(error.__traceback__):
                half_read: Any = frame.f_locals.get("self")
                if hasattr(half_read, "_closed"):  # it cannot be closed without what it has not read
                    vars(half_read).update(header=None, identification=None)
                    half_read.close()
            raise
        finally:
            mdf_v4.NamedTemporaryFile = on_disk
        with mdf:
            mdf.configure(read_fragment_size=FRAGMENT)
            yield mdf


class Mf4:
    """Channels of an MF4 file that are plain numbers; masters, texts and arrays are left out."""

    is_held = True

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: dict[str, int] = Counter()
        self.units: dict[str, str] = {}
        self.sources: dict[str, list[str]] = {}
        self._places: dict[str, tuple[int, int]] = {}
        with _mdf(path) as mdf:
            masters = set(mdf.masters_db.items())
            wrong = _without_arithmetic(mdf)
            lost = {group for group, index in masters if (group, index) in wrong}
            for name, of_name in mdf.channels_db.items():
                if any(place in wrong or place[0] in lost for place in of_name):
                    self.notes[f"unused: {name} is left out: {NO_ARITHMETIC}"] = 1
                kept = [p for p in of_name if p not in wrong and p[0] not in lost]
                places = [p for p in kept if p not in masters and _count(mdf, p[0]) and _is_number(mdf, *p)]
                for group, index in places:
                    about = mdf.groups[group].channel_group.acq_name or str(group)
                    full = name if len(places) == 1 else f"{about}.{name}"
                    full = full if full not in self.units else f"{group}.{name}"
                    full = full if full not in self.units else f"{group}.{name}.{index}"
                    self.units[full] = mdf.get_channel_unit(group=group, index=index) or ""
                    self._places[full] = group, index
                    if len(places) > 1:
                        self.sources.setdefault(name, []).append(full)
            groups = dict.fromkeys(group for group, _ in self._places.values())
            self._about = _groups_of(mdf, groups, lambda note, count: self.notes.update({note: count}))
            self.lacking: dict[str, int] | None = {
                name: self._about.lacking[group] for name, (group, _) in self._places.items()
            }
        never = (NEVER, NEVER)
        self.spans = {name: self._about.spans.get(group, never) for name, (group, _) in self._places.items()}
        known = [span for span in self.spans.values() if span != never]
        self.begin = min((begin for begin, _ in known), default=0)
        self.end = max((end for _, end in known), default=0)

    def blocks(self, wanted: Collection[str]) -> Iterator[Block]:
        """The samples of some channels, those of each in the order of time."""
        with _whole(self.path, "MF4"), _mdf(self.path) as mdf:
            for group in self._groups(wanted):
                for rows in self._rows(mdf, group):
                    yield from rows

    def samples(self, wanted: Collection[str]) -> Iterator[tuple[int, str, float]]:
        """(time [ns], channel, value), of all channels in the order of time."""
        with _whole(self.path, "MF4"), _mdf(self.path) as mdf:
            yield from merge(
                *(_sorted(self._rows(mdf, group)) for group in self._groups(wanted)), key=lambda s: s[0]
            )

    def _groups(self, wanted: Collection[str]) -> list[dict[str, tuple[int, int]]]:
        """Wanted channels by their group."""
        found: dict[int, dict[str, tuple[int, int]]] = {}
        for name, place in self._places.items():
            if name in wanted:
                found.setdefault(place[0], {})[name] = place
        return list(found.values())

    def _rows(self, mdf: Any, channels: Mapping[str, tuple[int, int]]) -> Iterator[list[Block]]:
        """Blocks of the same records of the channels of a group; nan where a value is invalid, or a word."""
        group = next(iter(channels.values()))[0]
        parts = [
            mdf.iter_get(group=group, index=k, samples_only=True, raw=True) for _, k in channels.values()
        ]
        words, raws = Counter[str](), Counter[str]()
        for t, *signals in zip(self._about.times(mdf, group), *parts, strict=True):
            known, rows = t <= LATEST, []
            for name, (raw, invalid) in zip(channels, signals, strict=True):
                conversion = mdf.groups[group].channels[channels[name][1]].conversion
                values, is_word, is_raw = _numbers(raw, conversion)
                words[name] += int(is_word.sum())
                raws[name] += int(is_raw.sum())
                if invalid is not None:
                    values[np.asarray(invalid, bool)] = np.nan
                rows.append((name, t[known], values[known]))
            yield rows
        for name, count in words.items():
            if count:
                self.notes[f"unused: {name} says words, not numbers"] = count
        for name, count in raws.items():
            if count and (unit := self.units[name]):
                self.notes[f"unit: {name}: raw numbers without a conversion, taken as {unit}"] = count


def _is_number(mdf: Any, group: int, index: int) -> bool:
    samples = mdf.get(group=group, index=index, record_count=1, raw=True).samples
    return samples.dtype.kind in "biuf" and samples.ndim == 1


def _numbers(raw: Any, conversion: Any) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Raw values as the file turns them into numbers, which of them it turns into words, and which it leaves
    as they are. Words are nan.

    A table of words without a word for the rest leaves that as it is, which asammdf calls an empty word.
    """
    made = raw if conversion is None else conversion.convert(raw, as_object=True)
    none = np.zeros(len(raw), bool)
    if made.dtype.kind in "biuf":
        return made.astype(float), none, none
    has_rest = bool((conversion.referenced_blocks or {}).get("default_addr"))
    is_raw = none if has_rest else np.array([v == b"" for v in made], bool)
    is_word = np.array([isinstance(v, bytes | str) for v in made], bool) & ~is_raw
    values = np.full(len(raw), np.nan)
    values[is_raw] = raw[is_raw]
    is_made = ~is_word & ~is_raw
    values[is_made] = made[is_made].astype(float)
    return values, is_word, is_raw


@dataclass(frozen=True)
class _Groups:
    """Groups of an MF4 file on one axis of time.

    lacking: records of each that are stated and not there; spans: first and last time of those with one [ns]
    """

    shifts: list[int]
    lacking: dict[int, int]
    spans: dict[int, tuple[int, int]]

    def times(self, mdf: Any, group: int) -> Iterator[Times]:
        """Times of a group, block by block."""
        axis = Axis(self.shifts, is_one_by_one=True)
        return (axis.times(group, stamps) for stamps in _stamps(mdf, group))


def _stamps(mdf: Any, group: int) -> Iterator[Times]:
    index = mdf.masters_db.get(group, 0)
    return (_ns(signal.timestamps) for signal in mdf.iter_get(group=group, index=index, raw=True))


def _groups_of(mdf: Any, groups: Iterable[int], tell: Tell) -> _Groups:
    """Look through groups; what is not there of them is told."""
    axis, late = Axis(is_one_by_one=True), 0
    lacking = {group: _count(mdf, group) for group in groups}
    stated = sum(lacking.values())
    spans: dict[int, tuple[int, int]] = {}
    for group in lacking:
        for stamps in _stamps(mdf, group):
            lacking[group] -= len(stamps)
            times = axis.times(group, stamps)
            late += int((times > LATEST).sum())
            if len(times := times[times <= LATEST]):
                spans[group] = spans.get(group, (int(times[0]), 0))[0], int(times[-1])
    axis.tell(tell)
    if (lost := sum(lacking.values())) > MANY * stated:
        tell(f"lost: records of {num(stated)} that are stated", lost)
    if late:
        tell(TOO_LATE, late)
    return _Groups(axis.shifts, lacking, spans)


@dataclass(frozen=True)
class _Message:
    """A message on the bus. channels: its signals -> their channels; is_j1939: raw values may say "none"."""

    decoder: Any
    channels: dict[str, str]
    is_j1939: bool

    def values(self, data: bytes) -> Iterator[tuple[str, float]]:
        raw = self.decoder.decode(data, decode_choices=False, scaling=False, allow_truncated=True)
        for signal in self.decoder.signals:
            if signal.name in raw and signal.name in self.channels:
                number = raw[signal.name]
                value = value_of(signal, number) if self.is_j1939 else number * signal.scale + signal.offset
                yield self.channels[signal.name], float("nan") if value is None else float(value)


class Bus:
    """Frames as channels: the signals of their messages, `Message.Signal` where several have the name.

    frames: opens a pass through the file. Of a message of J1939 the number of its group counts, whoever sends
    it; channels of several senders end with their address, `@1C`, those of several buses with it, `@CAN2`.
    """

    is_held = False
    lacking: dict[str, int] | None = None

    def __init__(self, path: Path, frames: Callable[[Tell], Iterator[Frame]]) -> None:
        with Extra("can", "reading frames"):
            import cantools
        self.path, self._of_file = path, frames
        self.notes: dict[str, int] = {}
        file = _database_of(path)
        text = _text_of(read_bytes(file, "database", "a DBC file"))
        try:
            database = cantools.database.load_string(_with_short_signals(text), "dbc")
        except (cantools.Error, ValueError) as error:
            raise InputError(
                "database", file.name, f"expected a DBC file: {reason_of(error)}", file=file
            ) from error
        self.notes[f"form: frames decoded by {file.name}"] = 1
        self._messages: dict[Key, _Message | None] = {}
        self.units: dict[str, str] = {}
        self.sources: dict[str, list[str]] = {}
        self.spans: dict[str, tuple[int, int]] = {}
        spans: dict[Key, tuple[int, int]] = {}
        for t, bus, identifier, is_long, _ in self._frames():
            key = bus, identifier, is_long
            first, last = spans.get(key, (t, t))
            spans[key] = min(first, t), max(last, t)
        self._messages = dict.fromkeys(spans)
        self.begin = min((begin for begin, _ in spans.values()), default=0)
        self.end = max((end for _, end in spans.values()), default=0)
        self._describe(database.messages, spans, is_own=file == dbc_file())
        if not self.units:
            shown = (
                ", ".join(f"{identifier:X}" for _, identifier, _ in list(self._messages)[:5]) or "no frame"
            )
            raise InputError("log", shown, f"expected frames that {file} describes", file=path)

    def _describe(self, messages: list[Any], spans: Mapping[Key, tuple[int, int]], *, is_own: bool) -> None:
        """Which of the identifiers that occur are which message, and the names of their channels."""
        plain = {(m.frame_id, m.is_extended_frame): m for m in messages}
        groups = {parse(m.frame_id).pgn: m for m in messages if is_own or m.protocol == "j1939"}
        found: dict[Key, tuple[Any, bool]] = {}
        for key in self._messages:
            of_group = groups.get(parse(key[1]).pgn) if key[2] else None
            if (message := of_group or plain.get(key[1:])) is not None:
                found[key] = message, of_group is not None
            else:
                self._tell("unused: identifiers not described", 1)
        keys: dict[str, list[Key]] = {}
        for key, (message, _) in found.items():
            keys.setdefault(message.name, []).append(key)
        names = [s.name for m in {m.name: m for m, _ in found.values()}.values() for s in m.signals]
        for key, (message, is_j1939) in found.items():
            buses = {bus for bus, *_ in keys[message.name]}
            senders = {identifier & 0xFF for _, identifier, _ in keys[message.name]}
            end = f"@{key[1] & 0xFF:02X}" * (is_j1939 and len(senders) > 1)
            end += f"@CAN{key[0]}" * (len(buses) > 1)
            channels = {}
            for signal in message.signals:
                bare = signal.name if names.count(signal.name) == 1 else f"{message.name}.{signal.name}"
                is_right = is_own and "> 0 turns right" in (signal.comment or "")
                self.units[bare + end] = (signal.unit or "") + (RIGHT if is_right else "")
                channels[signal.name] = bare + end
                first, last = self.spans.get(bare + end, spans[key])
                self.spans[bare + end] = min(first, spans[key][0]), max(last, spans[key][1])
                if end and bare + end not in self.sources.setdefault(bare, []):
                    self.sources[bare].append(bare + end)
            self._messages[key] = _Message(message, channels, is_j1939)
        self.sources = {name: sorted(several) for name, several in self.sources.items() if several}

    def _tell(self, note: str, count: int) -> None:
        self.notes[note] = self.notes.get(note, 0) + count

    def _frames(self) -> Iterator[Frame]:
        """Frames, and messages of several frames in the place of their last one. What is told of them is
        told anew with each pass.
        """
        transports: dict[int, Transport] = {}
        told: dict[str, int] = Counter()
        for t, bus, identifier, is_long, data in self._of_file(lambda note, n: told.update({note: n})):
            if abs(t) > LATEST:
                told[TOO_LATE] += 1
            elif is_long and identifier >> 8 & 0x3FF00 in (TRANSPORT, TRANSPORT_DATA):
                if (whole := transports.setdefault(bus, Transport()).take(identifier, data)) is not None:
                    yield t, bus, whole[0], True, whole[1]
            else:
                yield t, bus, identifier, is_long, data
        told["lost: messages of several frames that lack one"] += sum(t.lost for t in transports.values())
        self.notes |= {note: count for note, count in told.items() if count}

    def samples(self, wanted: Collection[str]) -> Iterator[tuple[int, str, float]]:
        """(time [ns], channel, value), of all channels in the order of the file."""
        asked = set(wanted)
        needed = {k: m for k, m in self._messages.items() if m and asked & {*m.channels.values()}}
        unread: dict[str, int] = Counter()
        for t, bus, identifier, is_long, data in self._frames():
            message = needed.get((bus, identifier, is_long))
            if message is None:
                continue
            try:
                values = list(message.values(data))
            except Exception:  # cantools raises what bitstruct does, by where the data end
                note = f"damaged: frames of {message.decoder.name} not readable"
                unread[note] += 1
                self.notes[note] = unread[note]
                continue
            yield from ((t, name, value) for name, value in values if name in wanted)

    def blocks(self, wanted: Collection[str]) -> Iterator[Block]:
        """The samples of some channels, those of each in the order of the file."""
        held: dict[str, list[tuple[int, float]]] = {}
        for count, (t, name, value) in enumerate(self.samples(wanted), 1):
            held.setdefault(name, []).append((t, value))
            if count % FRAMES == 0:
                yield from _packed(held)
                held = {}
        yield from _packed(held)


@apart("log", "a whole MF4 file", libraries=("asammdf", "asammdf.blocks.mdf_v4"), kept=(Mf4, Bus))
def _opened_mf4(path: Path) -> Channels:
    """The reader of channels, or of frames. InputError where it cannot be read."""
    with _whole(path, "MF4"):
        with _mdf(path) as mdf:
            has_frames = BUS in mdf.channels_db
        return Bus(path, lambda tell: _in_mf4(path, tell)) if has_frames else Mf4(path)


@apart("log", "a log of frames", libraries=("can", "can.io.blf", "cantools"), kept=(Bus,))
def _opened_frames(path: Path, kind: str) -> Channels:
    """The reader of frames. InputError where they cannot be read."""
    with _whole(path, kind):
        return Bus(path, lambda tell: logged(path, tell, is_text=kind == "ASC"))


@contextmanager
def _whole(path: Path, kind: str) -> Iterator[None]:
    try:
        yield
    except (SwathError, MemoryError):
        raise
    except Exception as error:  # what a broken file raises depends on where it is broken
        raise InputError(
            "damaged", path.name, f"expected a whole {kind} file: {reason_of(error)}", file=path
        ) from error


def _packed(held: Mapping[str, list[tuple[int, float]]]) -> Iterator[Block]:
    for name, pairs in held.items():
        yield name, np.array([t for t, _ in pairs], np.int64), np.array([v for _, v in pairs])


def _sorted(blocks: Iterator[list[Block]]) -> Iterator[tuple[int, str, float]]:
    """Samples of channels with the same times, one time after the other."""
    for rows in blocks:
        for of_one in zip(*(zip(t.tolist(), v.tolist(), strict=True) for _, t, v in rows), strict=False):
            yield from ((t, name, value) for (name, _, _), (t, value) in zip(rows, of_one, strict=True))


def _count(mdf: Any, group: int) -> int:
    """Records of a group."""
    return int(mdf.groups[group].channel_group.cycles_nr)


def _ns(seconds: Any) -> NDArray[np.int64]:
    """Times [ns]; NEVER for those that no file can mean."""
    given = np.asarray(seconds, float)
    known = np.abs(given) <= LATEST * 1e-9
    ns = np.round(np.where(known, given, 0.0) * 1e9).astype(np.int64)
    return np.where(known, ns, NEVER)


def _text_of(data: bytes) -> str:
    """The text of a DBC file, which says of no encoding: UTF-8 where it is that, else that of Windows."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _with_short_signals(text: str) -> str:
    """The text of a DBC file. ValueError for a signal longer than its message, or a message than any."""
    most, name = 0, ""
    for found in _LENGTHS.finditer(text):
        if found["bytes"] is not None:
            most, name = 8 * int(found["bytes"][:9]), found["message"]
            if most > 8 * LONGEST:
                raise ValueError(f"a message {name[:40]} of {found['bytes'][:20]} bytes")
        elif len(found["bits"]) > 6 or int(found["bits"]) > most:
            raise ValueError(f"a signal of {found['bits'][:20]} bits in {name[:40]}, which has {most}")
    return text


def _database_of(path: Path) -> Path:
    """The DBC file that a log is decoded by."""
    beside = path.with_suffix(".dbc")
    found = [beside] if os.path.isfile(beside) else sorted(path.parent.glob("*.dbc"))
    if len(found) > 1:
        names = ", ".join(file.name for file in found)
        raise InputError("database", names, f"expected one of them named {beside.name}", file=path)
    return found[0] if found else dbc_file()


def _in_mf4(path: Path, tell: Tell) -> Iterator[Frame]:
    """Frames of an MF4 file, by the time."""
    with _mdf(path) as mdf:
        places = dict(mdf.channels_db[BUS])
        if places.keys() & {group for group, _ in _without_arithmetic(mdf)}:
            raise InputError("log", BUS, f"expected plain frames, {NO_ARITHMETIC}", file=path)
        about = _groups_of(mdf, places, tell)
        yield from merge(
            *(_of_group(mdf, group, index, about) for group, index in places.items()), key=lambda f: f[0]
        )


def _of_group(mdf: Any, group: int, index: int, about: _Groups) -> Iterator[Frame]:
    times = about.times(mdf, group)
    for signal, t in zip(mdf.iter_get(group=group, index=index, samples_only=True), times, strict=True):
        samples = signal[0]
        part = {name.removeprefix(f"{BUS}."): samples[name] for name in samples.dtype.names}
        lengths = part.get("DataLength", np.full(len(samples), 8))
        longs = part.get("IDE", part["ID"] > 0x7FF)
        buses = part.get("BusChannel", np.zeros(len(samples), int)).tolist()
        rows = zip(t.tolist(), buses, part["ID"].tolist(), longs, part["DataBytes"], lengths, strict=True)
        for at, bus, identifier, is_long, data, length in rows:
            yield at, bus, identifier & 0x1FFFFFFF, bool(is_long), bytes(data)[: int(length)]
