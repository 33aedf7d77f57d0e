"""One binary time log of ISO 11783-10: TLGnnnnn.xml says what is in TLGnnnnn.bin.

A record is little endian: milliseconds of the day (uint32), days since 1980-01-01 (uint16), the position
fields that the xml leaves open, a count (uint8) and that many pairs of index (uint8) and value (int32).
Values are logged when they change; a column holds the last one, nan before the first. What cannot be read is
left out, counted, and said with file and byte.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field_io.ddi import DDI, label_name, slug, unit_name
from swath.field_io.taskdata import Description, Value
from swath.field_io.taskfiles import hex_number, read_tree

Array = NDArray[np.float64]
EPOCH = np.datetime64("1980-01-01T00:00:00.000", "ms")
DAY_MS = 86_400_000
MOST_CHANNELS = 256  # a record names them by a byte
MOST_VALUES = 100_000_000  # records by channels of a set of task data: 700 hours at 1 Hz of 40 channels
DAYS = (3652, 43_830)  # 1990 to 2100: a date outside is no date
SEASON = 200  # days that the date of a record lies from the middle one of its log at most; else it is none
NOT_AVAILABLE = -(2**31)  # a value that says that there is none
NO_PLACE = (NOT_AVAILABLE, 2**31 - 1)  # latitudes and longitudes that say the same
LONGEST_PAUSE = 600_000  # between two records by which reading finds its way back [ms]
POSITION = {
    "A": ("north", "<i4", 1e-7), "B": ("east", "<i4", 1e-7), "C": ("up", "<i4", 1e-3),
    "D": ("status", "u1", 1.0), "E": ("pdop", "<u2", 0.1), "F": ("hdop", "<u2", 0.1),
    "G": ("satellites", "u1", 1.0), "H": ("utc_ms", "<u4", 1.0), "I": ("utc_days", "<u2", 1.0),
}  # fmt: skip
"""Attributes of PTN in the order of a record: name, type, unit per count (deg, deg, m, -, -, -, -, ms, d)."""


@dataclass(frozen=True)
class Channel:
    """A logged quantity. element: id of the device element; label: what the device calls it, '' = nothing."""

    name: str
    unit: str
    ddi: int
    element: str
    label: str
    scale: float
    offset: float = 0.0

    @property
    def column(self) -> str:
        """Name of its column, with the unit: `crop_flow_kg_s`."""
        unit = {"1": "", "%": "pct"}.get(self.unit, slug(self.unit))
        return f"{self.name}_{unit}" if unit else self.name


@dataclass(frozen=True)
class TimeLog:
    """One TLG. time: shape (n,), ms, NaT before the terminal knew the date; lat, lon [deg], up [m], nan =
    none; position: the other fields by name

    values: shape (n, channel_count), in the channels' units, the last one logged; problems: what was left
    out, each with file and byte; unread: bytes that were skipped, at so many places: gaps
    """

    name: str
    task: str
    device: str
    time: NDArray[np.datetime64]
    lat: Array
    lon: Array
    up: Array
    position: dict[str, Array]
    channels: tuple[Channel, ...]
    values: Array
    problems: tuple[str, ...]
    unread: int
    gaps: int

    def __len__(self) -> int:
        return len(self.time)

    @property
    def begin(self) -> np.datetime64:
        """Its first known time, the epoch where none is known."""
        known = self.time[~np.isnat(self.time)]
        return known[0] if len(known) else EPOCH


def column_names(channels: tuple[Channel, ...]) -> list[str]:
    """One name each; channels of the same quantity on several elements carry the element's id."""
    plain = [c.column for c in channels]
    named = [
        p if plain.index(p) == i else f"{p}_{slug(c.element)}"
        for i, (p, c) in enumerate(zip(plain, channels, strict=True))
    ]
    return [n if named.index(n) == i else f"{n}_{i}" for i, n in enumerate(named)]


@dataclass(frozen=True)
class Layout:
    """Fixed part of a record, and the channels by index."""

    head: np.dtype[Any]
    channels: tuple[Channel, ...]
    scales: dict[str, float]


def check_values(records: int, columns: int, file: Path | str, most: int = MOST_VALUES) -> None:
    """Raise InputError for more values than are held in memory."""
    if records * columns > most:
        expected = f"expected at most {most} values, records by channels, there are {records} by {columns}"
        raise InputError("log", None, expected, file=file)


def _read_layout(name: str, files: Mapping[str, bytes], described: Description) -> Layout:
    file = f"{name}.xml"
    if f"{name}.XML" not in files:
        raise InputError(file, None, "missing: the time log cannot be read without it")
    tree = read_tree(files[f"{name}.XML"], ("TIM", "PTN", "DLV"))
    if tree.problem:
        raise InputError(file, None, f"expected well-formed XML, {tree.problem}")
    outermost = tree.top.children[0]
    time = next((node for node in (outermost, *outermost.of("TIM")) if node.tag == "TIM"), None)
    if time is None or time.attributes.get("A") != "":
        said = None if time is None else time.attributes
        raise InputError("TIM", said, "expected TIM with an empty A: time in every record", file=file)
    parts: list[tuple[str, str]] = [("ms", "<u4"), ("days", "<u2")]
    scales: dict[str, float] = {}
    place = next(iter(time.of("PTN")), None)
    for attribute, (field_name, kind, scale) in POSITION.items():
        if place is not None and place.attributes.get(attribute) == "":
            parts.append((field_name, kind))
            scales[field_name] = scale
    listed = [node.attributes for node in time.of("DLV")]
    if len(listed) > MOST_CHANNELS:
        raise InputError("DLV", len(listed), f"expected at most {MOST_CHANNELS} channels", file=file)
    channels = tuple(_channel(a, described, file) for a in listed)
    return Layout(np.dtype(parts), channels, scales)


def _channel(a: dict[str, str], described: Description, file: str) -> Channel:
    ddi, element = hex_number(a.get("A")), a.get("C", "")
    if ddi is None or not 0 <= ddi <= 0xFFFF:
        raise InputError("DLV.A", a.get("A", ""), "expected a DDI of four hex digits", file=file)
    label, unit, scale, offset = described.values.get((described.owners.get(element, ""), ddi), Value())
    known = DDI.get(ddi)
    if known is not None:
        return Channel(known.name, known.unit, ddi, element, label, known.scale)
    name = label_name(label) or f"ddi_{ddi}"
    return Channel(name, unit_name(unit), ddi, element, label, scale, offset)


def read_time_log(
    name: str, files: Mapping[str, bytes], described: Description, most_values: int = MOST_VALUES
) -> TimeLog:
    """Read one log; files: upper-case name -> content; most_values: records by channels.

    InputError when its xml or bin cannot be used.
    """
    layout = _read_layout(name, files, described)
    if f"{name}.BIN" not in files:
        raise InputError(f"{name}.bin", None, "missing: the log has a description but no records")
    data = files[f"{name}.BIN"]
    starts, problems, unread = _find_records(data, layout, f"{name}.bin")
    check_values(len(starts), len(layout.channels), f"{name}.bin", most_values)
    gaps = len(problems)
    size = layout.head.itemsize
    raw = np.frombuffer(data, np.uint8)
    heads = raw[starts[:, None] + np.arange(size)].copy().view(layout.head)[:, 0]
    time, told = _times(heads["days"].astype(np.int64), heads["ms"].astype(np.int64))
    problems += [f"{name}.bin: {told}"] if told else []
    fields = {key: heads[key].astype(float) * scale for key, scale in layout.scales.items()}
    nothing = np.full(len(starts), np.nan)
    lat, lon = fields.pop("north", nothing), fields.pop("east", nothing)
    nowhere = (np.abs(lat) > 90.0) | (np.abs(lon) > 180.0)
    if nowhere.any():
        first = int(np.flatnonzero(nowhere)[0])
        problems.append(
            f"{name}.bin: byte {starts[first]}: {int(nowhere.sum())} records without a place on earth"
        )
    lat, lon = np.where(nowhere, np.nan, lat), np.where(nowhere, np.nan, lon)
    values = _held(_values(raw, starts + size, layout))
    known = np.flatnonzero(~np.isnat(time))
    back = np.flatnonzero(np.diff(time[known]) < np.timedelta64(0, "ms"))
    if len(back):
        first = starts[known[back[0] + 1]]
        problems.append(f"{name}.bin: byte {first}: time goes back {len(back)} times")
    up = fields.pop("up", nothing)
    task = described.logs.get(name, "")
    owners = [described.owners.get(c.element, "") for c in layout.channels]
    device = max(owners, key=owners.count, default="")
    return TimeLog(
        name, task, device, time, lat, lon, up, fields, layout.channels, values, tuple(problems), unread, gaps
    )


def _times(days: NDArray[np.int64], ms: NDArray[np.int64]) -> tuple[NDArray[np.datetime64], str]:
    """Times of records, NaT where none is known, and what was assumed; of a log that never knows the date the
    times of its own clock.

    A terminal that starts without a date counts from one of its own, often with the right time of day: such
    records come before the first with a date by their clock, else by the usual step.
    """
    clock = days * DAY_MS + ms
    is_date = (days >= DAYS[0]) & (days <= DAYS[1])
    if not is_date.any():
        return EPOCH + clock.astype("timedelta64[ms]"), "no record has a date: times of its own clock"
    middle = np.sort(days[is_date])[is_date.sum() // 2]
    is_date &= np.abs(days - middle) <= SEASON
    first, count = int(is_date.argmax()), int((~is_date).sum())
    steps = np.diff(clock[:first])
    told = f"{count} records without a date: their time is left out" if count else ""
    if first and (steps >= 0).all() and (steps <= LONGEST_PAUSE).all():
        gap = int(clock[first] - clock[first - 1]) % DAY_MS
        usual = int(np.median(np.diff(clock[is_date]))) if is_date.sum() > 1 else 1000
        clock[:first] += clock[first] - clock[first - 1] - (gap if gap <= LONGEST_PAUSE else usual)
        told = f"{first} records without a date: put before the first that has one"
        told += f", {count - first} later ones have no time" if count > first else ""
        is_date[:first] = True
    times = EPOCH + clock.astype("timedelta64[ms]")
    times[~is_date] = np.datetime64("NaT")
    return times, told


def _record_end(data: bytes, at: int, layout: Layout) -> int:
    """Byte behind the record with a date at `at`; 0 when what stands there is no whole one."""
    day = int.from_bytes(data[at + 4 : at + 6], "little")
    return _any_record_end(data, at, layout) if DAYS[0] <= day <= DAYS[1] else 0


def _any_record_end(data: bytes, at: int, layout: Layout) -> int:
    """The same with any date."""
    size = layout.head.itemsize
    if at + size + 1 > len(data):
        return 0
    if int.from_bytes(data[at : at + 4], "little") >= DAY_MS + 1000:
        return 0
    end = at + size + 1 + 5 * data[at + size]
    if end > len(data):
        return 0
    index = data[at + size + 1 : end : 5]
    is_whole = all(i < len(layout.channels) for i in index) and len(set(index)) == len(index)
    return end if is_whole else 0


def _undated_end(data: bytes, at: int, layout: Layout) -> int:
    """The same of one from before the terminal knew the date: on Earth or nowhere, and another follows."""
    end = _any_record_end(data, at, layout)
    if not end:
        return 0
    head = np.frombuffer(data, layout.head, 1, at)[0]
    for key, limit in (("north", 90.0), ("east", 180.0)):
        count = int(head[key]) if key in layout.scales else 0
        if abs(count) * layout.scales.get(key, 0.0) > limit and count not in NO_PLACE:
            return 0
    return end if end == len(data) or _any_record_end(data, end, layout) else 0


def _find_records(data: bytes, layout: Layout, file: str) -> tuple[NDArray[np.int64], list[str], int]:
    """First byte of each whole record, shape (n,); what was skipped, and how many bytes that were."""
    starts: list[int] = []
    problems: list[str] = []
    at = unread = 0
    while at < len(data):
        end = _record_end(data, at, layout) or _undated_end(data, at, layout)
        if end:
            starts.append(at)
            at = end
            continue
        again = _next_run(data, at + 1, layout)
        unread += again - at
        if again < len(data):
            problems.append(f"{file}: byte {at}: no record, {again - at} bytes skipped")
        else:
            problems.append(
                f"{file}: byte {at}: expected a whole record, the last {again - at} bytes are none"
            )
        at = again
    return np.array(starts, dtype=np.int64), problems, unread


def _next_run(data: bytes, at: int, layout: Layout) -> int:
    """Where reading can go on: two whole records within minutes of each other, or one that ends the file."""
    for start in range(at, len(data) - layout.head.itemsize):
        end = _record_end(data, start, layout)
        if not end:
            continue
        if end == len(data):
            return start
        if _record_end(data, end, layout) and abs(_clock(data, end) - _clock(data, start)) <= LONGEST_PAUSE:
            return start
    return len(data)


def _clock(data: bytes, at: int) -> int:
    """Time of the record at a byte [ms]."""
    days = int.from_bytes(data[at + 4 : at + 6], "little")
    return days * DAY_MS + int.from_bytes(data[at : at + 4], "little")


def _values(raw: NDArray[np.uint8], counts_at: NDArray[np.int64], layout: Layout) -> Array:
    """Logged values, shape (record_count, channel_count), nan where a record has none."""
    values = np.full((len(counts_at), len(layout.channels)), np.nan)
    counts = raw[counts_at].astype(np.int64)
    row = np.repeat(np.arange(len(counts)), counts)
    before = np.cumsum(counts) - counts
    pair = np.arange(len(row)) - before[row]
    at = counts_at[row] + 1 + 5 * pair
    number = raw[at[:, None] + np.arange(1, 5)].copy().view("<i4")[:, 0] if len(at) else np.zeros(0, "<i4")
    index = raw[at]
    scale = np.array([c.scale for c in layout.channels])
    offset = np.array([c.offset for c in layout.channels])
    if len(at):
        shown = (number.astype(float) + offset[index]) * scale[index]
        values[row, index] = np.where(number == NOT_AVAILABLE, np.nan, shown)
    return values


def _held(values: Array) -> Array:
    """Every nan replaced by the last number above it, in place, column by column."""
    row = np.arange(len(values))
    for column in values.T:
        last = np.maximum.accumulate(np.where(np.isfinite(column), row, 0))
        column[:] = column[last]
    return values
