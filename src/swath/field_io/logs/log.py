"""A combine's yield log: records in SI units, projected, in driven order, each with its machine.

Broken rows are left out and counted by reason; only a file that holds no usable log is an error.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, capped
from swath.core.number_text import num
from swath.documents.witness import judge
from swath.field.maps.projection import transform, utm_epsg
from swath.field_io import trade
from swath.field_io.logs.clock import (
    MILLISECONDS,
    days_of,
    of_digits,
    over_midnight,
    seconds_of,
    spread,
    usable,
)
from swath.field_io.logs.columns import (
    ADDED,
    CROP,
    FLOWS,
    PLACE,
    QUANTITIES,
    SOURCED,
    UNITS,
    WIDTH,
    Column,
    ColumnMap,
    find_columns,
)
from swath.field_io.logs.coordinates import Others, Reading, check_places, numbers, reading_of
from swath.field_io.logs.machines import separate_machines
from swath.field_io.logs.records import (
    PAUSES,
    check_order,
    declared_machines,
    duration_of,
    longest_step,
    speed_of,
    time_of,
    unrounded,
)
from swath.field_io.logs.sources import SAME, choose
from swath.field_io.logs.table import Table, read_table
from swath.field_io.logs.timeline import counted_on, one_pace, parts_of_header
from swath.field_io.logs.witnesses import (
    AT,
    CANDIDATES,
    CLOCK_UNITS,
    Drive,
    Logged,
    clock_unit,
    drive_of,
    level_pairs,
    settle_units,
)

Array = NDArray[np.float64]
FEWEST_RECORDS = 30  # below, there is no pass to speak of
MOST_NOTES = 20  # of what could not be read
PLAUSIBLE: dict[str, tuple[float, float]] = {
    "speed": (0.0, 15.0), "header_width": (0.0, 20.0), "grain_flow": (0.0, 60.0), "yield": (0.0, 5.0),
    "moisture": (0.0, 0.6), "elevation": (-500.0, 9000.0), "crop_height": (0.0, 5.0), "duration": (0.0, 1e5),
    "distance": (0.0, 1e4),
}  # fmt: skip
"""Limits in SI units (m/s, m, kg/s, kg/m2, share, m, m, s, m). Outside, the number means something else."""
_NEEDED = {"grain_flow": "kg/s", "yield": "kg/m2", "speed": "m/s", "header_width": "m"}
"""A bad value here breaks the row, elsewhere the cell."""
MOST_JUDGED = 10_000  # records on which another reading of the positions is judged
MANY = 0.2  # of the rows: so many left out for one reason are reported
# estimated: cosines of a step to the side of the one before, and of two that are opposite; m, to a pass
SIDEWAYS, TURNED, LEAST_ASIDE = 0.7, -0.9, 1.0
LATEST = 1e19  # of a number that is a time: nanoseconds of the year 2286
MOST_IN_ORDER = 16  # parts of a header, each with a row, of a log without a clock
LEAST_ONCE = 0.99  # of the rows of sections, each once at a time: with less the clock has coarse steps
LEAST_COPIED = 0.2  # of the rows that are there a second time: with less a machine stood
SEASON = 30 * 86400.0  # s: a longer pause lies between two harvests
COUNTS_ON = 0.99  # of the steps of a distance that do not go back: it is that from the start
SAME_OF = {"lat": 0.002, "lon": 0.002, "elevation": 25.0, "moisture": 0.25, "distance": 10.0}
"""Of what `choose` takes its share, deg, m, share, m: the yield does not go with them."""
EVENLY = 0.9  # of the places held for as many records: with less they have few digits
MOST_HELD = 20.0  # records for which a place is held: 1 Hz in a log of 20 Hz
MAP_WIDTH = 10.0  # m, where a map of yields holds no width of the header
WHOLE_CROP_SHARE = 0.2  # of the rows with a flow: so many above what grain can be are no slips
MOST_WHOLE_CROP = 150.0  # kg/s of a forage harvester: the largest are sold for 400 t/h (111 kg/s); estimated
OUT_OF_RANGE = "grain_flow_out_of_range"


@dataclass(frozen=True)
class Log:
    """Records sorted by machine, then time; all arrays have one entry per record, shape (n,).

    machine: index into machine_names; time [s]; duration [s] since the record before; east, north [m] in
        epsg; elevation [m], nan = none; speed [m/s]
    width: of the header in use [m]
    flow: grain at the sensor [kg/s], with what comes through while the header is out
    moisture: share of the wet mass, nan = none; crop_height [m], nan = none
    working: whether the header is in the crop, where the log says so, else True
    crop: data sheet
    row_number: line or record of the file
    row_count: rows in the file, stated: as it says itself, None = it does not
    broken: reason -> rows left out. notes: what was assumed.
    """

    machine: NDArray[np.int64]
    time: Array
    duration: Array
    east: Array
    north: Array
    elevation: Array
    speed: Array
    width: Array
    flow: Array
    moisture: Array
    crop_height: Array
    working: NDArray[np.bool_]
    row_number: NDArray[np.int64]
    machine_names: tuple[str, ...]
    epsg: int
    column_map: ColumnMap
    row_count: int
    broken: dict[str, int]
    notes: tuple[str, ...]
    crop: str = trade.DEFAULT
    stated: int | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def position(self) -> Array:
        """Shape (n, 2) [m]."""
        return np.stack([self.east, self.north], axis=1)

    @property
    def gap(self) -> NDArray[np.bool_]:
        """Shape (n,): the record does not follow the one before: other machine, pause, jump in position.

        A step to the side, behind which the machine drives the other way, is one: none turns on the spot.
        """
        way = np.diff(self.position, axis=0)
        step = np.hypot(*way.T)
        ahead = way / np.maximum(step, 1e-9)[:, None]
        aside = np.abs((ahead[1:-1] * ahead[:-2]).sum(axis=1)) < SIDEWAYS
        turned = aside & ((ahead[2:] * ahead[:-2]).sum(axis=1) < TURNED) & (step[1:-1] > LEAST_ASIDE)
        pause, longest = np.diff(self.time), longest_step(self.time, self.machine)
        reach = np.clip(pause, 1.0, max(3.0, longest / PAUSES))
        far = step > 3.0 * np.maximum(self.speed[1:], 1.0) * reach + 3.0
        far[1:-1] |= turned
        gap: NDArray[np.bool_] = np.r_[True, (np.diff(self.machine) != 0) | (pause > longest) | far]
        return gap

    def keep(self, mask: NDArray[np.bool_]) -> "Log":
        """The records of a mask, shape (n,), in the same order."""
        arrays: dict[str, Any] = {k: v[mask] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **arrays)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def read_log(
    path: Path,
    columns: Path | None = None,
    *,
    header_width: float | None = None,
    crop: str | None = None,
    as_map: bool = False,
) -> Log:
    """Read a yield log: CSV, CSV.gz, a point shapefile (bare, folder, zip), or ISOXML time logs.

    columns: map file (see swath.field_io.logs.columns). header_width [m]: where the log holds none
    crop: data sheet; None = what the log says, without a word wheat. as_map: records in any order, of one
    machine
    Raises InputError when the file is no log or less than 30 rows of it can be used.
    """
    table = read_table(path)
    if header_width is None and table.stated_width is not None:
        table.columns["header_width_m"] = table.stated_width
    found = find_columns(
        list(table.columns), path, columns, table.points is not None, units=table.units,
        needs={**({} if table.points is not None else PLACE), **CROP,
               **(WIDTH if header_width is None and not as_map else {})},
    )  # fmt: skip
    notes = capped(table.notes, MOST_NOTES, "damaged: ")
    row_count = len(table.row_number) + sum(table.broken.values())
    if len(table.row_number) < FEWEST_RECORDS:
        raise InputError(
            "log", len(table.row_number), f"expected at least {FEWEST_RECORDS} whole rows", file=path
        )
    notes += missing(row_count, table.stated)
    found, more = _of_sources(table, found, path)
    notes += more
    places, crs_note, others_of_places = reading_of(table, found, path)
    lon_lat = places.lon_lat
    sheet, others, note = _crop(table, found, crop, path)
    notes += [note] if note else []
    found, values, stand_ins, more = _settled(
        table, found, places, others_of_places, header_width, sheet, path, as_map
    )
    notes += more
    found, note = _as_harvested(values, found, sheet)
    notes += [note] if note else []
    broken = dict(table.broken)
    reasons = {**stand_ins, "other_crop": others, **_broken(places, values, found)}
    _refuse_no_grain(values, found, path)
    good = np.ones(len(lon_lat), dtype=bool)
    for reason, bad in reasons.items():
        broken[reason] = int((bad & good).sum())
        good &= ~bad
    if good.sum() < FEWEST_RECORDS:
        reason, why = first_loss(broken, row_count)
        expected = f"expected at least {FEWEST_RECORDS} usable rows: {why}{_why(reason, values, found)}"
        key = "place" if reason.startswith("position") else "lost"
        raise InputError(key, int(good.sum()), expected, file=path)
    notes += [
        f"lost: {num(n)} of {num(row_count)} rows left out: {reason.replace('_', ' ')}"
        f"{_why(reason, values, found)}"
        for reason, n in broken.items()
        if n > MANY * row_count and reason not in ("copied", "other_section", "other_crop")
    ]
    values = {k: v[good] for k, v in values.items()}
    log = _assemble(table, found, lon_lat[good], values, good, header_width, path, as_map)
    jump = np.zeros(len(log), dtype=bool) if as_map else _jumps(log)
    log = log.keep(~jump)
    again = _repeats(log)
    broken |= {"jump": int(jump.sum()), "duplicated_position": int(again.sum())}
    notes += [crs_note] if crs_note else []
    notes += log.notes
    return replace(
        log.keep(~again),
        row_count=row_count,
        stated=table.stated,
        broken=broken,
        notes=tuple(notes),
        crop=sheet,
    )


def missing(read: int, stated: int | None) -> list[str]:
    """A note where a file states more rows than it has."""
    if stated is None or read >= stated:
        return []
    return [f"damaged: the file states {num(stated)} records and holds {num(read)}"]


def first_loss(left_out: Mapping[str, int], read: int) -> tuple[str, str]:
    """The first stage at which most of what reaches it goes, else the one at which most go, and a sentence.

    left_out: reason -> rows, in the order of the stages
    """
    stages, there = dict[str, tuple[int, int]](), read
    for reason, count in left_out.items():
        stages[reason] = count, there
        there -= count
    most = [reason for reason, (count, before) in stages.items() if count > 0.5 * before]
    reason = most[0] if most else max(stages, key=lambda k: stages[k][0])
    count, before = stages[reason]
    return reason, f"{num(count)} of {num(before)} go: {reason}"


def _why(reason: str, values: dict[str, Array], found: ColumnMap) -> str:
    """The column of what rows were left out for, its middle and limits, and how its unit is said.

    values: in SI units
    """
    key = next((k for k in _NEEDED if reason.startswith(k)), "")
    if key not in found.columns:
        return ""
    if not reason.endswith("out_of_range"):
        return f" ({found.columns[key].column})"
    column, size = found.columns[key], UNITS[QUANTITIES[key]][found.columns[key].unit]
    low, high, middle = (v / size for v in (*PLAUSIBLE[key], float(np.nanmedian(values[key]))))
    limits = f"{num(middle)} {column.unit} at the middle, expected {num(low)} to {num(high)}"
    return f"; {column.column}: {limits}, --columns takes its unit"


def _settled(
    table: Table, found: ColumnMap, places: Reading, others: Others,
    header_width: float | None, sheet: str, path: Path, as_map: bool,
) -> tuple[ColumnMap, dict[str, Array], dict[str, NDArray[np.bool_]], list[str]]:  # fmt: skip
    """Columns with their units settled, all quantities in SI units, reason -> rows that another stands for,
    shape (n,), and notes.
    """
    count = len(table.row_number)
    numeric = {k: c for k, c in {**found.beside, **found.columns}.items() if QUANTITIES[k] != "text"}
    raw = {k: table.numbers(c.column) for k, c in numeric.items() if k not in ("lat", "lon", "time")}
    machine = declared_machines(table, found)[1]
    plane = _plane(places.lon_lat)
    again = _copies(table, found, places.lon_lat, raw, machine)
    clock, day, unit, section, notes = _clock(table, found, machine, np.where(again[:, None], np.nan, plane))
    notes += judge(level_pairs({**found.beside, **found.columns}, raw, table.row_number), path)
    moment = np.stack([machine, _occurrence(machine, section) if clock is None else clock + day], axis=1)
    other, in_middle = _joined(section, raw, moment, places.lon_lat, np.flatnonzero(~again))
    in_middle(places.lon_lat)
    first = ~again & ~other
    if again.any():
        notes.append(f"copies: {num(int(again.sum()))} rows are there twice, and count once")
    by = raw.get("record", np.arange(count, dtype=float)) if clock is None else clock
    cutting = _cutting(raw, not_working(table, found), count)
    season = np.zeros(count, dtype=np.int64)
    if clock is not None:
        season = _seasons(clock * UNITS["time"][unit or found.columns["time"].unit] + day)

    early = np.zeros(count, dtype=bool)
    early[np.lexsort((by, day))[:MOST_JUDGED]] = True

    def order_of(reading: Reading) -> NDArray[np.int64]:
        finite, on_earth, away = reading.placed()
        rows = np.flatnonzero(first & finite & on_earth & ~away)
        return rows[:0] if as_map else rows[np.lexsort((by[rows], day[rows], machine[rows]))]

    def driven(reading: Reading) -> tuple[Array, Drive] | None:
        order, lon_lat = order_of(reading), reading.lon_lat
        order = order if reading is places else order[early[order]]
        if len(order) < FEWEST_RECORDS:
            return None
        epsg = utm_epsg(*np.median(lon_lat[order], axis=0))
        position = np.full((count, 2), np.nan)
        position[order] = transform(lon_lat[order], "EPSG:4326", f"EPSG:{epsg}")
        return position, drive_of(position, lon_lat, order, machine, cutting, season)

    by_machine = (
        []
        if as_map
        else [rows[machine[rows] == k] for rows in [order_of(places)] for k in np.unique(machine)]
    )
    for rows in by_machine:
        notes += _between_held(places.lon_lat, plane, rows)

    def moved(reading: Reading) -> Reading:
        """Another reading with its places moved as those of the log were, in place."""
        in_middle(reading.lon_lat)
        for rows in by_machine:
            _between_held(reading.lon_lat, _plane(reading.lon_lat), rows)
        return reading

    order, known = order_of(places), driven(places)
    drive = Drive((0.0, 0.0), order[:0], order[:0], np.zeros(0)) if known is None else known[1]
    notes += _step_wise(raw, order, drive)
    seconds = None if clock is None else clock * UNITS["time"][unit or found.columns["time"].unit] + day
    found, more = _by_way(table, found, raw, drive, seconds, path)
    notes += more
    logged = Logged(found.columns, raw, None, (), cutting, header_width)
    columns, seconds, pace = dict(found.columns), None, None
    if not as_map:
        time, units = _way_time(columns, raw, clock, day, unit, order)
        of_way = replace(logged, time=time, clock_units=units)
        notes += check_places(
            places,
            lambda: map(moved, others()),
            lambda r: known if r is places else driven(r),
            of_way,
            found,
            path,
        )
    if known is not None:
        check_order(np.arange(len(order), dtype=float), machine[order], *known[0][order].T)
    if clock is not None:
        if not unit:
            unit, more = clock_unit(columns["time"], clock, drive, path)
            notes += more
        columns["time"] = replace(columns["time"], unit=unit)
        seconds = clock * UNITS["time"][unit] + day
    else:
        columns.pop("time", None)
    loser, note = one_pace(columns, raw, seconds, drive)
    notes += [note] if note else []
    if loser == "time":
        seconds = None
    if loser:
        columns.pop(loser, None)
        raw.pop(loser, None)
    pace = seconds
    if seconds is None and "duration" in raw:
        pace = np.full(count, np.nan)
        pace[order] = np.cumsum(raw["duration"][order] * UNITS["time"][columns["duration"].unit])
    area = next((k for k in FLOWS[1:] if k in found.beside), "")
    if pace is None and "speed" not in columns and "grain_flow" in columns and area:
        flow, columns[area] = columns.pop("grain_flow"), found.beside[area]
        raw.pop("grain_flow")
        found = replace(found, beside={k: c for k, c in found.beside.items() if k != area})
        why = f"nothing says how long a record of {flow.column} takes"
        notes.append(f"derived: grain: {columns[area].column} counts: {why}")
    found = replace(found, columns=columns)
    logged = replace(logged, time=pace, cutting=cutting & first)
    found, more = settle_units(found, logged, drive, sheet, path)
    values = {k: np.full(count, np.nan) for k in QUANTITIES if QUANTITIES[k] != "text"}
    values |= {k: raw[k] * UNITS[QUANTITIES[k]][c.unit] for k, c in found.columns.items() if k in raw}
    if seconds is not None:
        values["time"] = seconds
    elif pace is None and "speed" in found.columns and len(drive.step):
        period = float(np.nanmedian(drive.step / np.maximum(values["speed"][drive.after], 0.1)))
        values["duration"] = np.full(count, period)
        more.append(f"clock: no time: records taken as {num(period)} s apart, by speed and positions")
    return found, values, {"copied": again, "other_section": other}, notes + more


def _seasons(time: Array) -> NDArray[np.int64]:
    """Number of the season of each time [s], shape (n,): behind a long pause begins another harvest."""
    held = np.sort(time)
    begins = held[1:][np.diff(held) > SEASON]
    return np.searchsorted(begins, time, side="right").astype(np.int64)


def _way_time(
    columns: dict[str, Column], raw: dict[str, Array], clock: Array | None, day: Array, unit: str,
    order: NDArray[np.int64],
) -> tuple[Array | None, tuple[str, ...]]:  # fmt: skip
    """Time of each row, of the clock or of durations that add up, None without either; its possible units."""
    if clock is not None:
        said = columns["time"]
        units = (unit,) if unit else CLOCK_UNITS if said.is_assumed else (said.unit,)
        return clock + day / UNITS["time"][unit or said.unit], units
    if "duration" not in raw:
        return None, ()
    time = np.full(len(day), np.nan)
    time[order] = np.cumsum(raw["duration"][order])
    return time, (columns["duration"].unit,)


def _cutting(raw: dict[str, Array], idle: NDArray[np.bool_] | None, count: int) -> NDArray[np.bool_]:
    """Records with grain, shape (n,)."""
    grain = next((raw[k] for k in FLOWS if k in raw), np.ones(count))
    flowing = grain[grain > 0.0]
    cutting = grain > (0.2 * float(np.median(flowing)) if len(flowing) else 0.0)
    return cutting if idle is None else cutting & ~idle


def _clock(
    table: Table, found: ColumnMap, machine: NDArray[np.int64], plane: Array
) -> tuple[Array | None, Array, str, Any, list[str]]:
    """Time of each row, None where there is no clock; the midnight it counts from [s]; its unit, '' for that
    of its column; names of the sections that have rows of their own, None = none; notes.

    plane: positions [m]
    """
    column, dates = found.columns.get("time"), found.columns.get("date")
    none = np.zeros(len(table.row_number))
    section = np.array(table.texts(found.columns["section"].column)) if "section" in found.columns else None
    wide = found.columns.get("header_width")
    width = np.ones(len(none)) if wide is None else table.numbers(wide.column)
    parts = "lie side by side: parts of the header"
    if column is None and section is None:
        there = np.asarray(np.isfinite(plane).all(axis=1))
        rank = np.full(len(there), np.nan)
        rank[there] = _occurrence(machine[there], machine[there])
        ways = (np.stack([machine, rank // count], axis=1) for count in range(2, MOST_IN_ORDER + 1))
        tried = (parts_of_header(moment, plane, width) for moment in ways)
        section = next((made for made in tried if made is not None), None)
        notes = [] if section is None else [f"derived: rows behind each other {parts}"]
        return None, none, "", section, notes
    if column is None:
        return None, none, "", section, []
    numbers = table.numbers(column.column)
    numbers[np.abs(numbers) > LATEST] = np.nan
    unit, notes, day = "", [], none
    if np.isfinite(numbers).mean() < 0.5:
        numbers, unit = si_values(table, found, "time"), "s"
    else:
        coded = of_digits(numbers) if column.is_assumed else None
        if coded is not None:
            numbers, day, form = coded
            unit, notes = "s", [f"clock: {column.column} read as {form}, by its digits"]
        held = none if dates is None or day.any() else days_of(table.texts(dates.column))
        if np.isfinite(held).all() and _overlap(numbers, held):
            day = held
        elif unit and not day.any():
            numbers = over_midnight(numbers)
    days = day / UNITS["time"][unit or column.unit]
    if section is None:
        section = parts_of_header(np.stack([machine, numbers + days], axis=1), plane, width)
        notes += [] if section is None else [f"derived: rows of one time {parts}"]
    of_clock = machine
    if section is not None:
        of_clock = np.unique(np.column_stack([machine, section]), axis=0, return_inverse=True)[1].ravel()
    counted, more = counted_on(numbers + days, of_clock, plane)
    notes += more[:1]
    numbers = counted - days if more else numbers
    note = ""
    for one in np.unique(machine) if section is None else ():
        rows = np.flatnonzero((machine == one) & np.isfinite(plane).all(axis=1))
        numbers[rows], more_of = spread(numbers[rows], plane[rows])
        note = more_of or note
    clock, unused = usable(numbers)
    return clock, day, unit, section, [*notes, *filter(None, (note, unused))]


def _plane(lon_lat: Array) -> Array:
    """Positions in a plane [m], shape (n, 2), near enough within a field."""
    known = lon_lat[np.isfinite(lon_lat).all(axis=1)]
    middle = np.median(known, axis=0) if len(known) else np.zeros(2)
    return np.asarray((lon_lat - middle) * (111.2e3 * np.cos(np.radians(middle[1])), 111.2e3))


def _of_sources(table: Table, found: ColumnMap, path: Path) -> tuple[ColumnMap, list[str]]:
    """The columns that count where several say one quantity, those that way and passes decide between left as
    others, and notes. Parts add up, in a column of their own.
    """
    columns, notes, undecided = dict(found.columns), list[str](), dict[str, tuple[Column, ...]]()
    for key, others in found.others.items():
        if key not in SOURCED:
            continue
        if columns[key].parts and key in ADDED:
            columns[key], note = _added(table, key, (columns[key], *others))
            notes.append(note)
            continue
        if key in FLOWS:  # bushels of which crop is not known yet
            is_volume = columns[key].unit == "bu/ac"
            others = tuple(c for c in others if (c.unit == "bu/ac") is is_volume)

        all_of = {c.column: c for c in (columns[key], *others)}
        values = {name: _in_si(table, key, c) for name, c in all_of.items()}
        own = values[columns[key].column]
        for c in others:
            if c.is_assumed or columns[key].is_assumed:
                values[c.column] = values[c.column] / _unit_ratio(key, values[c.column], own)
        lesser = [c.column for c in others if c.is_lesser]
        choice = choose(key, values, partial(_line, key), size=SAME_OF.get(key), file=path, lesser=lesser)
        columns[key] = all_of[choice.name]
        notes += choice.notes
        undecided[key] = tuple(all_of[name] for name in choice.open)
    return replace(found, columns=columns, others={k: c for k, c in undecided.items() if c}), notes


def _line(key: str, name: str) -> str:
    """The line of a map of columns that chooses a column."""
    return f"{key}: {{column: {json.dumps(name)}}}"


def _added(table: Table, key: str, parts: tuple[Column, ...]) -> tuple[Column, str]:
    """The column that is the sum of others, made in the table, and a note."""
    first, sizes = parts[0], UNITS[QUANTITIES[key]]
    units = [first.unit if c.is_assumed or first.is_given else c.unit for c in parts]
    names = tuple(c.column for c in parts)
    whole = " + ".join(names)
    table.columns[whole] = sum(
        table.numbers(name) * (sizes[unit] / sizes[first.unit])
        for name, unit in zip(names, units, strict=True)
    )
    return replace(first, column=whole, parts=names), f"derived: {key}: {whole}, the parts of a header"


def _by_way(
    table: Table, found: ColumnMap, raw: dict[str, Array], drive: Drive, time: Array | None, path: Path
) -> tuple[ColumnMap, list[str]]:
    """Columns with the speed nearest to way over time, and the width nearest to the distance of passes, of
    several that differ; else the first. Notes on these.

    time [s]. Raises InputError for widths of which none is that of the passes.
    """
    columns, notes = dict(found.columns), list[str]()
    for key, others in found.others.items():
        speed = np.nan if time is None else drive.speed(time)
        shown = drive.spacing if key == "header_width" else speed
        values = {c.column: table.numbers(c.column) for c in (columns[key], *others)}
        off = {}
        for c in (columns[key], *others):
            units = sum(CANDIDATES[key], ()) if c.is_assumed else (c.unit,)
            ratio = float(np.nanmedian(values[c.column][drive.after])) / shown if len(drive.after) else np.nan
            off[c.column] = min(abs(np.log(ratio * UNITS[QUANTITIES[key]][unit])) for unit in units)
        first, best = columns[key], min((columns[key], *others), key=lambda c: off[c.column])
        is_shown = max(off.values()) - off[best.column] > SAME / 2.0
        if key == "header_width" and not (is_shown and off[best.column] < AT.agrees[1] - 1.0):
            lines = " or ".join(_line(key, name) for name in off)
            text = f"expected one as wide as passes lie apart; in --columns: {lines}"
            raise InputError("sources", ", ".join(off), text, file=path)
        columns[key] = best if is_shown else first
        raw[key] = values[columns[key].column]
        differ = ", ".join(c.column for c in (first, *others) if c is not columns[key])
        by = "passes" if key == "header_width" else "the way over its time"
        why = f"nearest to {by}" if is_shown else "named first"
        notes.append(f"sources: {key}: {columns[key].column} counts, {why}; {differ} differs")
    return replace(found, columns=columns), notes


def _between_held(lon_lat: Array, plane: Array, rows: NDArray[np.int64]) -> list[str]:
    """Places that are held for several records are moved on along the way, in place; and a note.

    plane [m]; rows: in driven order
    """
    first = np.flatnonzero(np.r_[True, (np.diff(plane[rows], axis=0) != 0.0).any(axis=1)])
    size = np.diff(np.r_[first, len(rows)])
    usual = float(np.median(size)) if len(size) else 0.0
    if len(first) < FEWEST_RECORDS or not 2.0 <= usual <= MOST_HELD or (size == usual).mean() < EVENLY:
        return []
    step = np.diff(plane[rows[first]], axis=0)
    way = np.hypot(*step.T)
    is_driven = way <= AT.longest * float(np.median(way))
    after, before = np.r_[is_driven, False], np.r_[False, is_driven]
    move = np.diff(lon_lat[rows[first]], axis=0)
    ahead = np.where(
        after[:, None], np.r_[move, move[-1:]], np.where(before[:, None], np.r_[move[:1], move], 0.0)
    )
    group = np.repeat(np.arange(len(first)), size)
    behind = (np.arange(len(rows)) - first[group]) / np.maximum(usual, size[group])
    lon_lat[rows] += ahead[group] * behind[:, None]
    return [f"derived: places held for {num(usual)} records, moved on along the way between them"]


def _in_si(table: Table, key: str, column: Column) -> Array:
    if key in ("lat", "lon"):
        return numbers(table, column)
    return table.numbers(column.column) * UNITS[QUANTITIES[key]][column.unit]


def _unit_ratio(key: str, other: Array, own: Array) -> float:
    """By how much the other is greater, where that is the ratio of two units of the quantity; else 1."""
    both = (other > 0.0) & (own > 0.0)
    if key not in CANDIDATES or not both.any():
        return 1.0
    ratio = float(np.median(other[both] / own[both]))
    sizes = np.array([UNITS[QUANTITIES[key]][u] for units in CANDIDATES[key] for u in units])
    ratios = np.divide.outer(sizes, sizes).ravel()
    nearest = float(ratios[np.abs(np.log(ratios / ratio)).argmin()])
    return nearest if AT.agrees[0] < ratio / nearest < AT.agrees[1] else 1.0


def _overlap(times: Array, days: Array) -> bool:
    """Whether the times of different days are times of the day: they begin anew."""
    names = np.unique(days)
    held = [times[(days == d) & np.isfinite(times)] for d in names[:100]]
    spans = [(of_day.min(), of_day.max()) for of_day in held if len(of_day)]
    return any(b[0] < a[1] for a, b in pairwise(spans))


def _step_wise(raw: dict[str, Array], order: NDArray[np.int64], drive: Drive) -> list[str]:
    """Distance that counts on is made the way since the record before, in place; and a note."""
    if "distance" not in raw or len(drive.step) < 2:
        return []
    steps = np.diff(raw["distance"][order])
    if (
        not (np.nan_to_num(steps, nan=-1.0) >= 0.0).mean() > COUNTS_ON
        or np.ptp(raw["distance"][order]) == 0.0
    ):
        return []
    raw["distance"][order] = np.r_[np.nan, steps]
    return ["derived: distance is a running count, taken as the distance between records"]


def _crop(
    table: Table, found: ColumnMap, given: str | None, path: Path
) -> tuple[str, NDArray[np.bool_], str]:
    """Data sheet of the crop, rows of another crop, shape (n,), and what was assumed."""
    none = np.zeros(len(table.row_number), dtype=bool)
    column = found.columns.get("crop")
    texts = table.texts(column.column) if column is not None else []
    texts = texts if any(texts) else []
    if given is not None:
        return given, none, ""
    try:
        sheet, name = trade.crop_of_rows(texts or [table.crop])
    except InputError as error:
        is_variety = column is not None and column.column.lower() == "product"
        if is_variety and not trade.is_other(str(error.value)):
            return (
                trade.DEFAULT,
                none,
                f"crop: product {error.value!r} is not known, taken as {trade.DEFAULT}",
            )
        raise InputError(error.key, error.value, error.expected, file=path) from None
    if sheet is not None:
        same = {text: trade.sheet_of(text) in (sheet, None) for text in set(texts)}
        return (
            sheet,
            np.array([not same[text] for text in texts]) if texts else none,
            f"crop: {sheet} ({name})",
        )
    try:
        named = trade.crop_in_name(path.name)
    except InputError as error:
        raise InputError(error.key, error.value, error.expected, file=path) from None
    if named is not None:
        return named, none, f"crop: {named}, by the name of the log"
    return trade.DEFAULT, none, f"crop: the log names none, taken as {trade.DEFAULT} (--crop)"


def _as_harvested(values: dict[str, Array], found: ColumnMap, sheet: str) -> tuple[ColumnMap, str]:
    """The yield as harvested, of bushels of this crop, or of a dry yield and the moisture; in place."""
    for key in ("yield", "dry_yield"):
        if key in found.columns and found.columns[key].unit == "bu/ac":
            values[key] = values[key] * trade.bushel_kg_factor(sheet)
    if "dry_yield" not in found.columns:
        return found, ""
    moisture = np.clip(np.nan_to_num(values["moisture"]), 0.0, 0.6)
    wet = trade.wet_over_dry(sheet, moisture)
    values["yield"] = values["dry_yield"] * np.where(moisture > 0.0, wet, 1.0)
    renamed = {("yield" if k == "dry_yield" else k): c for k, c in found.columns.items()}
    known = bool((moisture > 0.0).any())
    note = "derived: yield of dry grain, " + (
        "moisture added" if known else "taken as harvested: no moisture"
    )
    return replace(found, columns=renamed), note


def _copies(
    table: Table, found: ColumnMap, lon_lat: Array, raw: Mapping[str, Array], machine: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Rows that are there a second time, shape (n,): none where a machine stood, or the clock is coarse."""
    words = [found.columns[key].column for key in ("time", "date", "section") if key in found.columns]
    said = [np.unique(table.texts(name), return_inverse=True)[1] for name in words]
    again = ~_first(
        np.column_stack([machine, lon_lat, *said, *(raw[k] for k in (*FLOWS, "header_width") if k in raw)])
    )
    return again if again.mean() >= LEAST_COPIED else np.zeros(len(again), dtype=bool)


def _joined(
    section: Any, raw: dict[str, Array], moment: Array, lon_lat: Array, rows: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], Callable[[Array], None]]:
    """Rows of sections beside the one that stands for all, shape (n,), and what moves the places (n, 2) of
    the sections of a time to their middle, in place.

    section: of each row, None = none; moment: machine and time; rows: that count. The first section of a time
    gets the widths and flows of all, in place.
    """
    other = np.zeros(len(lon_lat), dtype=bool)
    if section is None or "header_width" not in raw or not len(rows):
        return other, lambda _: None
    place = np.column_stack([moment, lon_lat])
    one = np.unique(section, return_inverse=True)[1]
    is_once = _first(np.column_stack([moment, one]))[rows].mean() > LEAST_ONCE
    held = np.nan_to_num(np.column_stack([moment if is_once else place])[rows])
    index, group = np.unique(held, axis=0, return_index=True, return_inverse=True)[1:]
    group = group.ravel()
    width = np.nan_to_num(raw["header_width"][rows])
    total, size = _sums(group, width), _sums(group, np.ones(len(rows)))
    share = np.where(total > 0.0, width / np.where(total > 0.0, total, 1.0), 1.0 / size)
    for key in FLOWS:
        if key in raw:
            part = 1.0 if key == "grain_flow" else share
            raw[key][rows] = _sums(group, part * np.nan_to_num(raw[key][rows]))
    raw["header_width"][rows] = total
    other[np.delete(rows, index)] = True

    def in_middle(places: Array) -> None:
        for axis in range(2):
            places[rows, axis] = _sums(group, share * places[rows, axis])

    return other, in_middle


def _occurrence(machine: NDArray[np.int64], section: Any) -> Array:
    """How often the section of a machine was there before, shape (n,): the time of rows without a clock."""
    if section is None:
        return np.zeros(len(machine))
    group = np.unique(np.column_stack([machine, section]), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(group, kind="stable")
    rank = np.arange(len(group)) - np.searchsorted(group[order], group[order])
    made = np.empty(len(group))
    made[order] = rank
    return made


def _first(keys: Array) -> NDArray[np.bool_]:
    """The first row of each kind, shape (n,)."""
    first = np.zeros(len(keys), dtype=bool)
    first[np.unique(np.nan_to_num(keys), axis=0, return_index=True)[1]] = True
    return first


def _sums(group: NDArray[np.int64], values: Array) -> Array:
    """The sum of each record's group, shape (n,)."""
    return np.asarray(np.bincount(group, values), dtype=float)[group]


def _refuse_no_grain(values: dict[str, Array], found: ColumnMap, path: Path) -> None:
    """InputError where the flow is none of grain. values: in SI units."""
    flow = values["grain_flow"]
    flowing, most = flow[flow > 0.0], PLAUSIBLE["grain_flow"][1]
    if len(flowing) and (flowing > most).mean() > WHOLE_CROP_SHARE:
        middle = float(np.median(flowing))
        is_crop = middle <= MOST_WHOLE_CROP
        why = ": this crop is whole plants (forage)" if is_crop else _why(OUT_OF_RANGE, values, found)
        expected = f"expected grain, at most {num(most)} kg/s{why}"
        raise InputError("plausible", f"flows of {num(middle)} kg/s", expected, file=path)


Limits = dict[str, tuple[float, float]]
"""Quantity -> smallest and largest value that it can have."""


def si_values(table: Table, found: ColumnMap, key: str) -> Array:
    """A quantity in the units used inside, nan where it is missing."""
    column = found.columns.get(key)
    if column is None:
        return np.full(len(table.row_number), np.nan)
    if key in ("lat", "lon"):
        return numbers(table, column)
    values = table.numbers(column.column)
    if key == "time" and np.isfinite(values).sum() < 0.5 * len(values):
        date = found.columns.get("date")
        return seconds_of(table.texts(column.column), None if date is None else table.texts(date.column))
    with np.errstate(over="ignore"):
        values = values * UNITS[QUANTITIES[key]][column.unit]
    if key == "time" and column.is_assumed and np.nanmedian(np.abs(values)) > MILLISECONDS:
        return values / 1000.0
    return values


def si_values_within(table: Table, found: ColumnMap, key: str, limits: Limits) -> Array:
    """A quantity in the units used inside, nan where it is missing or cannot be."""
    values = si_values(table, found, key)
    low, high = limits[key]
    return np.where((values >= low) & (values <= high), values, np.nan)


def _broken(places: Reading, values: dict[str, Array], found: ColumnMap) -> dict[str, NDArray[np.bool_]]:
    """Reason -> rows, shape (n,), that cannot be used."""
    finite, on_earth, away = places.placed()
    reasons = {
        "position_not_a_number": ~finite,
        "position_out_of_range": finite & ~on_earth,
        "position_far_away": away,
    }
    for key in _NEEDED:
        if key in found.columns:
            low, high = PLAUSIBLE[key]
            value = values[key]
            reasons[f"{key}_not_a_number"] = ~np.isfinite(value)
            reasons[f"{key}_out_of_range"] = np.isfinite(value) & ((value < low) | (value > high))
    for key in ("moisture", "elevation", "crop_height", "duration", "distance"):
        low, high = PLAUSIBLE[key]
        values[key] = np.where((values[key] >= low) & (values[key] <= high), values[key], np.nan)
    return reasons


def not_working(table: Table, found: ColumnMap) -> NDArray[np.bool_] | None:
    """Rows whose header does not work, shape (n,); None where the log does not say."""
    column = found.columns.get("work_state")
    if column is None:
        return None
    idle = {"out", "off", "0", "32", "up", "false", "no", "raised"}  # 32: Ag Leader, bit 0 is the header down
    return np.array([word.lower().removesuffix(".0") in idle for word in table.texts(column.column)])


def _assemble(
    table: Table,
    found: ColumnMap,
    lon_lat: Array,
    values: dict[str, Array],
    good: NDArray[np.bool_],
    header_width: float | None,
    path: Path,
    as_map: bool,
) -> Log:
    """Project, sort, distinguish machines and fill in what follows from other columns."""
    epsg = utm_epsg(*np.median(lon_lat, axis=0))
    east, north = transform(lon_lat, "EPSG:4326", f"EPSG:{epsg}").T
    names, machine, notes = declared_machines(table, found, good)
    if "time" in found.columns:
        order = np.lexsort((values["time"], machine))
    else:
        order = (
            np.lexsort((values["record"], machine))
            if "record" in found.columns
            else np.argsort(machine, kind="stable")
        )
    time, time_note = time_of(values, found, machine, order)
    notes += [time_note] if time_note else []
    if as_map:
        names, machine, order = ("1",), np.zeros_like(machine), np.arange(len(machine))
        time = order.astype(float)
    if "machine" not in found.columns and not as_map:
        machine = separate_machines(time, east, north)
        names = tuple(str(i + 1) for i in range(machine.max() + 1))
        if len(names) > 1:
            notes.append(f"machines: no column of them: {len(names)} distinguished by their positions")
    order = np.lexsort((time, machine))
    machine, time, east, north = machine[order], time[order], east[order], north[order]
    values = {k: v[order] for k, v in values.items()}
    period, duration = duration_of(time, machine, values["duration"])
    time = unrounded(time, machine, period)
    speed = speed_of(values, found, time, duration, machine, east, north)
    width = values["header_width"]
    if not np.isfinite(width).any():
        if as_map and "grain_flow" not in found.columns:
            header_width = header_width or MAP_WIDTH  # only of the cells in which the ground is counted
        if header_width is None:
            expected = "expected a column (name it with --columns), or --header-width-m"
            raise InputError("columns", None, f"header_width: {expected}", file=path)
        width = np.full(len(time), header_width)
    idle, flow = not_working(table, found), values["grain_flow"]
    working = np.ones(len(good), dtype=bool) if idle is None else ~idle
    if "grain_flow" not in found.columns:
        flow = values["yield"] * width * speed
    if abs(period - 1.0) > 0.05:
        notes.append(f"clock: one record every {num(period)} s")
    return Log(
        machine, time, duration, east, north, values["elevation"], speed, width, flow, values["moisture"],
        values["crop_height"], working[good][order], table.row_number[good][order], names, epsg, found, 0, {},
        tuple(notes),
    )  # fmt: skip


def _jumps(log: Log) -> NDArray[np.bool_]:
    """Records off the track of their neighbours, shape (n,)."""
    p, m = log.position, log.machine
    jump = np.zeros(len(p), dtype=bool)
    limit = 12.0 + 3.0 * log.speed[1:-1]
    before, after = np.hypot(*(p[1:-1] - p[:-2]).T), np.hypot(*(p[2:] - p[1:-1]).T)
    across = np.hypot(*(p[2:] - p[:-2]).T)
    one = (m[2:] == m[1:-1]) & (m[1:-1] == m[:-2])
    jump[1:-1] = one & (before > limit) & (after > limit) & (across < limit)
    return jump


def _repeats(log: Log) -> NDArray[np.bool_]:
    """Records of a machine on the very spot of the one before, shape (n,)."""
    step = np.hypot(*np.diff(log.position, axis=0).T)
    return np.asarray(np.r_[False, (step == 0.0) & (np.diff(log.machine) == 0)])
