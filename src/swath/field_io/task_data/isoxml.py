"""Task data of ISO 11783-10 as one table: TASKDATA.XML names devices and logs, TLG files hold the records.

TLGnnnnn.xml says what is in the time log TLGnnnnn.bin. A record is little endian: milliseconds of the day
(uint32), days since 1980-01-01 (uint16), the position fields that the xml leaves open, a count (uint8) and
that many pairs of index (uint8) and value (int32). Values are logged when they change; a column holds the
last one, nan before the first. What cannot be read is left out, counted, and said with file and byte.
"""

import os
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, capped, some_of
from swath.core.number_text import num, percent_of
from swath.documents.packed import member_names
from swath.field.memory_layout import ranked
from swath.field_io.task_data.ddi import CONDENSED, DDI, TOGETHER, label_name, slug, unit_name
from swath.field_io.task_data.taskdata import (
    SECTION,
    WIDTHS,
    YIELDS,
    Description,
    Device,
    Value,
    listed,
    read_description,
)
from swath.field_io.task_data.taskfiles import TaskFiles, hex_number, is_log_file, read_tree, task_files

Array = NDArray[np.float64]
FEW_VALUES, VALUES_PER_BYTE = 20_000_000, 32  # held of any task data; more per byte, up to MOST_VALUES
MOST_PROBLEMS = 100  # that are reported of one set of task data
WIDTH, WORK_STATE = "working_width_m", 141  # a column; a DDI
AT_WORK, NOT_INSTALLED = 1, 3  # condensed states of a section
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
    none; position: the other fields by name.

    values: shape (n, channel_count), in the channels' units, the last one logged
    problems: what was left out, each with file and byte
    unread: bytes that were skipped, at so many places: gaps
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
        """The first known time of a log, the epoch where none is known."""
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
    if len(data) < (said := described.lengths.get(name, 0.0)):
        problems.append(f"damaged: {name}.bin: {num(said)} bytes are stated, it has {num(len(data))}")
    size = layout.head.itemsize
    raw = np.frombuffer(data, np.uint8)
    heads = raw[starts[:, None] + np.arange(size)].copy().view(layout.head)[:, 0]
    time, notes = _times(heads["days"].astype(np.int64), heads["ms"].astype(np.int64))
    problems += [f"clock: {name}.bin: {notes}"] if notes else []
    fields = {key: heads[key].astype(float) * scale for key, scale in layout.scales.items()}
    nothing = np.full(len(starts), np.nan)
    lat, lon = fields.pop("north", nothing), fields.pop("east", nothing)
    nowhere = (np.abs(lat) > 90.0) | (np.abs(lon) > 180.0)
    if nowhere.any():
        first = int(np.flatnonzero(nowhere)[0])
        problems.append(
            f"unused: {name}.bin: byte {starts[first]}: {int(nowhere.sum())} records without a place on earth"
        )
    lat, lon = np.where(nowhere, np.nan, lat), np.where(nowhere, np.nan, lon)
    values = _held(_values(raw, starts + size, layout))
    known = np.flatnonzero(~np.isnat(time))
    back = np.flatnonzero(np.diff(time[known]) < np.timedelta64(0, "ms"))
    if len(back):
        first = starts[known[back[0] + 1]]
        problems.append(f"timeline: {name}.bin: byte {first}: time goes back {len(back)} times")
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
    note = f"{count} records without a date: their time is left out" if count else ""
    if first and (steps >= 0).all() and (steps <= LONGEST_PAUSE).all():
        gap = int(clock[first] - clock[first - 1]) % DAY_MS
        usual = int(np.median(np.diff(clock[is_date]))) if is_date.sum() > 1 else 1000
        clock[:first] += clock[first] - clock[first - 1] - (gap if gap <= LONGEST_PAUSE else usual)
        note = f"{first} records without a date: put before the first that has one"
        note += f", {count - first} later ones have no time" if count > first else ""
        is_date[:first] = True
    times = EPOCH + clock.astype("timedelta64[ms]")
    times[~is_date] = np.datetime64("NaT")
    return times, note


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
            problems.append(f"damaged: {file}: byte {at}: no record, {again - at} bytes skipped")
        else:
            problems.append(
                f"damaged: {file}: byte {at}: expected a whole record, the last {again - at} bytes are none"
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
    row, pair = ranked(counts)
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


@dataclass(frozen=True)
class TaskData:
    """All time logs of a TASKDATA folder, in the order of their first records; problems of every file."""

    path: Path
    logs: tuple[TimeLog, ...]
    described: Description
    problems: tuple[str, ...]

    def __len__(self) -> int:
        return sum(len(log) for log in self.logs)

    @property
    def time(self) -> Array:
        """Seconds since the first record with a date, nan of those without, shape (n,)."""
        all_times = np.concatenate([log.time for log in self.logs])
        first = min((log.begin for log in self.logs if not np.isnat(log.time).all()), default=EPOCH)
        seconds = (all_times - first) / np.timedelta64(1, "s")
        return np.where(np.isnat(all_times), np.nan, seconds.astype(float))

    @property
    def crops(self) -> list[str]:
        """The crop of each log with a yield: of its task's field, else of the list; '' = none is named."""
        found = [self.described.crop_of(self._part(log)) if _marks(log) else "" for log in self.logs]
        known = [name if name in self.described.crops.values() else "" for name in found]
        return known if any(known) else found

    def columns(self) -> dict[str, Any]:
        """Columns of all logs, one after the other: log, machine (text), time_s, lat_deg, lon_deg,
        elevation_m and one per quantity; nan where a log has no such channel. What sections of a machine log
        apart is put together, beside a column for each; fields of different crops make a column crop.
        """
        return self.table()[0]

    def table(self) -> tuple[dict[str, Any], Array | None, tuple[str, ...]]:
        """The columns; widths of the header [m] that machines state where no log holds any, shape (n,), nan =
        none; and what was assumed or left out.
        """
        count = [len(log) for log in self.logs]
        names = {name for log in self.logs for name in column_names(log.channels)}
        check_values(len(self), len(names), self.path)
        made: dict[str, Any] = {"log": np.repeat(np.array([log.name for log in self.logs]), count).tolist()}
        made["time_s"] = self.time
        made["machine"] = np.repeat(np.array([log.device for log in self.logs]), count).tolist()
        made["lat_deg"] = np.concatenate([log.lat for log in self.logs])
        made["lon_deg"] = np.concatenate([log.lon for log in self.logs])
        up = np.concatenate([log.up for log in self.logs])
        if np.isfinite(up).any():
            made["elevation_m"] = up
        notes, stated = Counter[str](), np.full(len(self), np.nan)
        crops = self.crops
        if len({*crops} - {""}) > 1:
            made["crop"] = np.repeat(np.array(crops), count).tolist()
        unsaid = [log.name for log, crop in zip(self.logs, crops, strict=True) if _marks(log) and not crop]
        if unsaid and any(crops):
            notes[f"crop: the tasks of {some_of(unsaid, 5)} name none, taken as the others"] += 1
        start, is_logged = 0, False
        for log in self.logs:
            rows = slice(start, start + len(log))
            start += len(log)
            quantities, found_notes = _quantities(log, self.described)
            at_work = _at_work(log, self.described)
            if (at_work < 1.0).any():
                found_notes.append(
                    f"derived: header width: that of sections at work, {percent_of(at_work.min())} or more"
                )
            if WIDTH in quantities:
                is_logged = True
                if (
                    len(np.unique(quantities[WIDTH][np.isfinite(quantities[WIDTH])])) == 1
                ):  # of the whole header
                    quantities[WIDTH] = quantities[WIDTH] * at_work
            else:
                width, what = self.described.width_of(self._machines(log), _marks(log))
                stated[rows] = (width or np.nan) * at_work
                found_notes += [
                    f"derived: header width: the machine states {num(width)} m ({what}), the log none"
                ] * bool(width)
            notes.update(found_notes)
            for name, values in quantities.items():
                made.setdefault(name, np.full(len(self), np.nan))[rows] = values
        if is_logged:
            made[WIDTH] = np.where(np.isfinite(stated), stated, made[WIDTH])
        return made, None if is_logged or np.isnan(stated).all() else stated, (*notes, *self._unused())

    def _part(self, log: TimeLog) -> str:
        return self.described.tasks[log.task].part if log.task in self.described.tasks else ""

    def _machines(self, log: TimeLog) -> list[str]:
        """Devices whose header a log may be of: those that log a yield, those of its task, a single one."""
        known = self.described.devices
        task = self.described.tasks.get(log.task)
        own = [self.described.owners.get(e, "") for e in _marks(log)] + [log.device]
        ids = [*own, *(task.devices if task else ()), *(known if len(known) == 1 else ())]
        return [i for i in dict.fromkeys(ids) if i in known]

    def _unused(self) -> list[str]:
        """What TASKDATA.XML holds beside the logs."""
        left = Counter[str]()
        for part in self.described.parts.values():
            left.update(polygon.name for polygons in part.polygons.values() for polygon in polygons)
            left["guidance pattern"] += len(part.guidance)
            left.update(part.unused)
        left.update(self.described.unused)
        return [f"unused: task data, not used beside the logs: {listed(left)}"] if left.total() else []


def _marks(log: TimeLog) -> list[str]:
    """Device elements that log a yield."""
    return list(dict.fromkeys(c.element for c in log.channels if c.ddi in YIELDS))


def _quantities(log: TimeLog, described: Description) -> tuple[dict[str, Array], list[str]]:
    """Name -> values, shape (n,), of a log, and what was put together.

    A quantity of several elements of the machine is that of the whole machine, and those of the elements
    under names with their ids.
    """
    made: dict[str, Array] = {}
    notes: list[str] = []
    groups: dict[str, list[int]] = {}
    for k, channel in enumerate(log.channels):
        groups.setdefault(channel.column, []).append(k)
    for name, group in groups.items():
        there: dict[str, int] = {}
        for k in group:
            if np.isfinite(log.values[:, k]).any():
                there.setdefault(log.channels[k].element, k)
        made[name] = log.values[:, next(iter(there.values()), group[0])]
        if len(group) > 1:
            made |= {f"{name}_{slug(log.channels[k].element)}": log.values[:, k] for k in reversed(group)}
        rule = TOGETHER.get(log.channels[group[0]].ddi)
        if rule and len(there) > 1:
            made_of, made_notes = _of_machine(log, described, there, rule, name)
            notes += made_notes
            if made_of is None:
                del made[name]
            else:
                made[name] = made_of
    width = next((n for ddi in WIDTHS if np.isfinite(made.get(n := DDI[ddi].name + "_m", np.nan)).any()), "")
    if width:
        made[WIDTH] = made[width]
        if width != WIDTH:
            notes.append(f"derived: header width: taken from {width}, the log holds no actual one")
    else:
        made.pop(WIDTH, None)
    return made, notes


def _of_machine(
    log: TimeLog, described: Description, there: dict[str, int], rule: str, name: str
) -> tuple[Array | None, list[str]]:
    """The values of a quantity of the whole machine, shape (n,); there: element -> channel; and notes.

    None where several sensors say it: each has a column of its own, of which one is chosen.
    """
    marks = _marks(log)
    owners = {e: described.owners.get(e, "") for e in there}
    medians = {e: float(np.nanmedian(log.values[:, k])) for e, k in there.items()}
    parts, marked = dict[str, list[str]](), list[str]()
    for owner in dict.fromkeys(owners.values()):
        own = [e for e in there if owners[e] == owner]
        device = described.devices.get(owner, Device(""))
        more, more_marked = device.parts(own, marks)
        parts, marked = parts | more, marked + more_marked
    pool = {p: parts[p] for p in marked or parts}
    best = max(pool, key=lambda p: sum(medians[e] for e in pool[p]))
    is_grain = log.channels[next(iter(there.values()))].ddi in YIELDS
    if is_grain and len(pool) > 1 and all(len(of) == 1 for of in pool.values()):
        return None, []
    notes = []
    of = pool[best]
    device = described.devices.get(owners[of[0]], Device(""))
    others = [e for e in there if e not in of and not set(device.above(e)) & set(of)]
    if len(of) > 1 or others:
        how = f"{rule} of " if len(of) > 1 else "of "
        beside = f"; not of {_shown(others, medians)}" if others else ""
        notes.append(f"derived: {name}: {how}{_shown(of, medians)}{beside}")
    return _together(log, there, of, rule), notes


def _together(log: TimeLog, there: dict[str, int], of: list[str], rule: str) -> Array:
    """The values of some elements as one, shape (n,)."""
    values = log.values[:, [there[e] for e in of]]
    if rule == "sum" and len(of) > 1:
        values = np.where(np.stack([_is_off(log, e) for e in of], axis=1), 0.0, values)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of records before the first value
        make: Any = {"sum": np.nansum, "mean": np.nanmean, "highest": np.nanmax}[rule]
        made = make(values, axis=1)
    return np.where(np.isfinite(values).any(axis=1), made, np.nan)


def _at_work(log: TimeLog, described: Description) -> Array:
    """Share of the header's width whose sections work by the condensed states, shape (n,); 1 without such."""
    states = {c.ddi: k for k, c in reversed([*enumerate(log.channels)]) if c.ddi in CONDENSED}
    if not states:
        return np.ones(len(log))
    numbers = np.nan_to_num(np.stack([log.values[:, k] for k in states.values()], axis=1), nan=-1.0)
    bits = numbers.astype(np.int64)[:, :, None] >> np.arange(0, 32, 2) & 3
    place = np.concatenate([CONDENSED[ddi] + np.arange(16) for ddi in states])
    state = bits.reshape(len(log), -1)[:, np.argsort(place)]
    there = (state != NOT_INSTALLED).any(axis=0)
    element = log.channels[next(iter(states.values()))].element
    device = described.devices.get(described.owners.get(element, ""), Device(""))
    parts = [e for e, d in device.elements.items() if d.kind == SECTION and element in device.above(e)]
    widths = np.array([max((device.elements[e].properties.get(ddi, 0.0) for ddi in WIDTHS), default=0.0)
                       for e in parts])  # fmt: skip
    if len(widths) != there.sum() or not (widths > 0.0).all():
        widths = np.ones(int(there.sum()))
    known = (state[:, there] != NOT_INSTALLED).any(axis=1)  # before the first value all of it works
    return np.where(known, (state[:, there] == AT_WORK) @ widths / max(widths.sum(), 1e-9), 1.0)


def _shown(elements: list[str], medians: dict[str, float]) -> str:
    """Some elements with the medians of their values."""
    return some_of((f"{e} ({num(medians[e])})" for e in elements), 4)


def _is_off(log: TimeLog, element: str) -> NDArray[np.bool_]:
    """Records in which an element says that it does not work, shape (n,)."""
    states = [k for k, c in enumerate(log.channels) if c.ddi == WORK_STATE and c.element == element]
    return np.asarray(log.values[:, states[0]] == 0.0) if states else np.zeros(len(log), dtype=bool)


def is_taskdata(path: Path) -> bool:
    """True for a folder or zip that holds a TASKDATA.XML, for that file, and for a TLG file."""
    if os.path.isdir(path):
        return any(p.name.upper() == "TASKDATA.XML" for p in path.iterdir())
    if path.name.upper() == "TASKDATA.XML" or is_log_file(path):
        return True
    return any(PurePosixPath(n).name.upper() == "TASKDATA.XML" for n in member_names(path))


def read_taskdata(path: Path) -> TaskData:
    """Read all time logs of a TASKDATA folder, its zip or its TASKDATA.XML; of a TLG file only that log.

    Raises InputError when nothing can be read: no TASKDATA.XML, no time log, no whole record in any.
    """
    path = Path(path)
    with task_files(path) as files:
        if "TASKDATA.XML" not in files:
            raise InputError("taskdata", None, "expected a TASKDATA.XML beside the time logs", file=path)
        described = read_description(files)
        logs, problems = _read_logs(path, files, described)
    if not logs:
        why = f": {problems[0]}" if problems else ""
        expected = f"expected at least one time log with a whole record{why}"
        raise InputError("taskdata", None, expected, file=path)
    logs.sort(key=lambda log: (log.begin, log.name))
    return TaskData(path, tuple(logs), described, tuple(capped(problems, MOST_PROBLEMS, "damaged: ")))


def _read_logs(path: Path, files: TaskFiles, described: Description) -> tuple[list[TimeLog], list[str]]:
    """The logs that hold a record, and what was wrong with all of them."""
    names = dict.fromkeys(described.logs)
    if described.problems or not names:
        names |= dict.fromkeys(sorted(n[:-4] for n in files if n.startswith("TLG") and n.endswith(".BIN")))
    if is_log_file(path):
        names = {path.stem.upper(): None}
    problems, logs = list(described.problems), []
    left = min(FEW_VALUES + VALUES_PER_BYTE * files.size, MOST_VALUES)
    for name in names:
        try:
            log = read_time_log(name, files, described, left)
        except InputError as error:
            problems.append(f"damaged: {error}")
            continue
        problems += log.problems
        left -= log.values.size
        if len(log):
            logs.append(log)
    return logs, problems
